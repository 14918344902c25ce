"""Guesses what a name that means nothing here was meant to be.

Purpose: before the checker calls a name unknown or of the wrong kind, this file searches all
declarations, such as states of plants, locals of nodes and instances of systems, and words of other
languages. It answers what the name is, where it is declared, and what to write instead, mostly as
an edit.
Non-goals: names that are nearly right (`diagnostics/similar_names.py`), declarations of imports
(`scope.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, TypeGuard

from soter.diagnostics.diagnostic import Edit, Fix, Span
from soter.diagnostics.fixes import insert, replace
from soter.language.syntax import tree
from soter.language.syntax.their_words import THEIRS, helps_for_word

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.diagnostics.diagnostic import Help


MEMBERS_SHOWN = 3
OF_AN_OBJECT = ("self", "this")
_TYPES = ("float", "int", "bool", "duration")


def type_helps(name: str, span: Span) -> tuple[Help, ...]:
    """Gives helps for the name of a type in another language; () for any other name."""
    if name.lower() in _TYPES:
        return (replace(span, name.lower()),)
    first = THEIRS.get(name, "").split(" ")[0]
    return helps_for_word(name, span) if first in (*_TYPES, "type", "fun") else ()


def value_helps(declared: Iterable[tree.Decl], name: str, span: Span) -> tuple[Help, ...]:
    """Gives helps for a value of another language, or an enum member without its enum."""
    ours = THEIRS.get(name, "")
    if ours in ("true", "false") or ours.startswith("var ") or "." in ours:
        return helps_for_word(name, span)
    owners = [
        f"{decl.name.text}.{name}"
        for decl in declared
        if isinstance(decl, tree.TypeDecl)
        and isinstance(decl.type, tree.EnumTypeExpr)
        and any(m.text == name for m in decl.type.members)
    ]
    return tuple(replace(span, owner) for owner in owners[:MEMBERS_SHOWN])


def function_helps(expr: tree.CallExpr, name: str, span: Span) -> tuple[Help, ...]:
    """Gives helps for calls such as `len(xs)`, `not (a)` and `now()`."""
    arguments = expr.arguments
    if name == "not" and len(arguments) == 1:
        return (replace(Span(span.source, span.start, arguments[0].span.start), "!("),)
    if name == "len" and len(arguments) == 1:
        return (replace(expr.span, f"{arguments[0].span.text}.len"),)
    if name in ("now", "get_time", "clock", "millis", "rostime") and not arguments:
        return (replace(expr.span, "time", "write `time`: seconds since the start"),)
    if name in ("range", "xrange"):
        return ("a loop counts over a range: `for i in 0..10 { ... }`",)
    return ()


def range_helps(call: tree.SyntaxExpr) -> tuple[Help, ...]:
    """Gives helps for `range(3)` and `range(1, 3)` in a loop."""
    if not isinstance(call, tree.CallExpr) or not isinstance(call.callee, tree.NameExpr):
        return ()
    if call.callee.name.text not in ("range", "xrange") or not 1 <= len(call.arguments) <= 2:
        return ()
    low = call.arguments[0].span.text if len(call.arguments) == 2 else "0"
    high = call.arguments[-1]
    if isinstance(high, tree.CallExpr) and high.callee.span.text == "len" and high.arguments:
        return (replace(call.span, f"{low}..{high.arguments[0].span.text}.len"),)
    return (replace(call.span, f"{low}..{high.span.text}"),)


def library_helps(qualifier: tree.Name, name: tree.Name, wanted: str) -> tuple[Help, ...] | None:
    """Gives helps for `math.sin` and `std_msgs.Bool`; None if `qualifier` may be a user's file."""
    span = qualifier.span.to(name.span)
    if wanted == "type" and qualifier.text.endswith("_msgs"):
        return type_helps(name.text, span) or (
            "declare its fields: `type Name = { x: float, y: float };`",
        )
    if not is_library(qualifier.text):
        return None
    return type_helps(name.text, span) or (replace(span, THEIRS.get(name.text, name.text)),)


def is_library(name: str) -> bool:
    """Whether `name` is a library of another language, such as `math`, that Soter has built in."""
    return THEIRS.get(f"{name}.") == ""


def helps_for_foreign_qualifier(name: tree.Name, field: tree.Name) -> tuple[Help, ...]:
    """Gives helps for `self.last` and `math.pi`: the name after the dot, or its value."""
    if is_library(name.text):
        return library_helps(name, field, "name") or ()
    if name.text not in OF_AN_OBJECT:
        return ()
    span = Span(name.span.source, name.span.start, field.span.start)
    return (Fix(f"write `{field.text}`", (Edit(span, ""),)),)


def help_to_declare(name: tree.Name) -> tuple[Help, ...]:
    """Gives an edit that declares the unknown name to which the program assigns."""
    return (insert(name.span, "let ", f"declare it: `let {name.text} = ...;`"),)


_DECLARATION = re.compile(r"^(?:extern|node|plant|rta|system|test|type|fun|topic)\b", re.MULTILINE)


def listing_fix(word: str, name: str, owner: Span) -> Fix:
    """Gives the edit that adds `name` to the list after `word` in the node or plant at `owner`.

    `word` is `subscribes`, `publishes` or `reads`; if the body has no such list, the edit adds it.
    """
    text = owner.source.text
    item = _item_match(word, owner)
    title = f"add `{name}` to `{word}`"
    if item is not None:
        return Fix(title, (Edit(Span(owner.source, item.end(), item.end()), f", {name}"),))
    opener = text.find("{", owner.end) + 1
    return Fix(title, (Edit(Span(owner.source, opener, opener), f"\n  {word} {name};"),))


def _item_match(word: str, owner: Span) -> re.Match[str] | None:
    """Finds the clause that begins with `word` in the declaration named at `owner`; or None."""
    text = owner.source.text
    next_ = _DECLARATION.search(text, owner.end)
    end = next_.start() if next_ else len(text)
    return re.compile(rf"\b{word}\b[^;{{}}]*(?=;)").search(text, owner.end, end)


def place_of_publication(name: str, owner: Span) -> Span | None:
    """Gives the place at which the node named at `owner` lists `name` as published; or None."""
    item = _item_match("publishes", owner)
    word = item and re.compile(rf"\b{re.escape(name)}\b").search(
        owner.source.text, item.start() + len("publishes"), item.end()
    )
    return Span(owner.source, word.start(), word.end()) if word else None


def publishing_helps(
    declared: Iterable[tree.Decl], topic: str, owner: tree.Name | Span
) -> tuple[Help, ...]:
    """Gives helps for a node that publishes an unlisted `topic`: list it, or leave it out."""
    span = owner if isinstance(owner, Span) else owner.span
    misspelt, declarations = span.text, list(declared)
    module_of: dict[str, str] = {}
    for d in declarations:
        if isinstance(d, tree.RtaDecl):
            refs = [r.text for r in (d.ac, d.sc, *d.plans) if isinstance(r, tree.Ref)]
            module_of |= dict.fromkeys(refs, d.name.text)
    others = [
        d.name.text
        for d in declarations
        if isinstance(d, tree.NodeDecl)
        and d.name.text != misspelt
        and any(p.topic.text == topic for p in d.publishes)
    ]
    if misspelt in module_of or not others:
        return (listing_fix("publishes", topic, span),)
    module = module_of.get(others[0])
    who = f"module `{module}`" if module else f"node `{others[0]}`"
    return (
        f"leave it out: {who} drives `{topic}`, and a topic has one driver",
        f"in the place of {who}, `{misspelt}` has it in `publishes`, too",
    )


SHOWN = 3


@dataclass(frozen=True)
class Meaning:
    """The meaning of a name in another scope: what it is, where it is declared, and a help."""

    subject: str
    span: Span
    help: str
    weak: bool = False
    """Whether the name may be the same by chance, as those of parameters and locals often are."""


def meanings(decls: Iterable[tree.Decl], name: str) -> Iterator[Meaning]:
    """Yields the meanings of `name` inside declarations of a file, in their order."""
    declared = tuple(decls)
    for decl in declared:
        if isinstance(decl, tree.PlantDecl):
            yield from _plant_meanings(decl, name)
        elif isinstance(decl, tree.NodeDecl):
            yield from _node_meanings(decl, name)
        elif isinstance(decl, tree.FunDecl):
            for parameter, _ in decl.parameters:
                if parameter.text == name:
                    subject = f"a parameter of function `{decl.name.text}`"
                    yield Meaning(subject, parameter.span, "only its function sees it", weak=True)
        elif isinstance(decl, (tree.SystemDecl, tree.TestDecl)):
            yield from _loop_meanings(decl, name)
        if isinstance(decl, tree.SystemDecl):
            for item in decl.instances:
                if _is_instance_named(item, name) and item.what.text != name:
                    subject = f"an instance of `{item.what.text}` in system `{decl.name.text}`"
                    yield Meaning(subject, item.name.span, _help_for_instance(declared, item))


def _loop_meanings(decl: tree.SystemDecl | tree.TestDecl, name: str) -> Iterator[Meaning]:
    """Yields the meanings of `name` as the variable of a loop in a system or test."""
    todo: list[object] = [getattr(decl, f.name) for f in fields(decl)]
    while todo:
        item = todo.pop()
        if isinstance(item, tuple):
            todo += item
        elif isinstance(item, tree.Repeated):
            todo += item.items
            if item.name.text == name:
                subject = f"the loop variable of a `for` of `{decl.name.text}`"
                how = "it is known inside of the braces of its `for` only: move this line there"
                yield Meaning(subject, item.name.span, how)
                return


def _plant_meanings(plant: tree.PlantDecl, name: str) -> Iterator[Meaning]:
    owner = f"of plant `{plant.name.text}`"
    for state in plant.states:
        if state.name.text == name:
            driven = topic_driven_by_state(plant, name)
            seen = [t.text for t, value in plant.drives if _mentions_name(value, name)]
            how = "only its plant sees it"
            if driven:
                how = f"what is measured of it is `{driven}`"
            elif seen:
                how = f"only its plant sees it; what it drives of it is {quoted_names(seen)}"
            yield Meaning(f"a state {owner}", state.name.span, how)
    for disturbance in plant.disturbances:
        if disturbance.name.text == name:
            how = "only its plant sees it; a proof counts with all values of its set"
            yield Meaning(f"a disturbance {owner}", disturbance.name.span, how)
    for let in plant.lets:
        if let.name.text == name:
            how = "only its plant sees it; what all may use is a `const`, or a `fun`"
            yield Meaning(f"a `let` {owner}", let.name.span, how)


def _node_meanings(node: tree.NodeDecl, name: str) -> Iterator[Meaning]:
    how = "only its node sees it: publish it on a topic"
    locals_ = [*node.locals, *_declarations_in(node.step), *_declarations_in(node.takeover)]
    for local in locals_:
        if local.name.text == name:
            subject = f"a local of node `{node.name.text}`"
            yield Meaning(subject, local.name.span, how, weak=True)


def _declarations_in(part: object) -> Iterator[tree.LetStmt | tree.VarStmt]:
    if isinstance(part, (tree.LetStmt, tree.VarStmt)):
        yield part
    elif isinstance(part, tuple):
        for inner in part:
            yield from _declarations_in(inner)
    elif is_dataclass(part) and isinstance(part, (tree.Block, tree.SyntaxStmt)):
        for field in fields(part):
            yield from _declarations_in(getattr(part, field.name))


def _help_for_instance(decls: Iterable[tree.Decl], item: tree.Instance) -> str:
    decl = next((d for d in decls if d.name.text == item.what.text), None)
    if isinstance(decl, tree.PlantDecl):
        topics = quoted_names([topic.text for topic, _ in decl.drives])
        return f"only properties of its system see `{item.name.text}.truth`; others read {topics}"
    return "only its system sees it"


def topic_driven_by_state(plant: tree.PlantDecl, state: str) -> str:
    """Gives the topic, or its field, that a plant drives with the bare name `state`; else ""."""
    for topic, value in plant.drives:
        if isinstance(value, tree.NameExpr) and value.name.text == state:
            return topic.text
        for field, part in value.fields if isinstance(value, tree.RecordExpr) else ():
            if isinstance(part, tree.NameExpr) and part.name.text == state:
                return f"{topic.text}.{field.text}"
    return ""


def topic_of_truth(
    decls: Iterable[tree.Decl], names: list[tree.Name]
) -> tuple[str, tree.Decl] | None:
    """Gives the topic that publishes the state `c.truth`, `c.x` or `Cart.truth`, and its plant."""
    plant = _plant_named({d.name.text: d for d in decls}, names[0].text)
    if plant is None or not plant.drives:
        return None
    parts = [n.span.text if isinstance(n, tree.ElementName) else n.text for n in names[1:]]
    if parts and parts[0] == "truth":
        parts.pop(0)
    if parts:
        state, bracket, index = parts[0].partition("[")
        driven = topic_driven_by_state(plant, state.rstrip())
        return (".".join([driven + bracket + index, *parts[1:]]), plant) if driven else None
    topic, value = plant.drives[0]
    states = {s.name.text for s in plant.states}
    tells_all = (
        isinstance(value, tree.RecordExpr)
        and {n.text for n, part in value.fields if isinstance(part, tree.NameExpr)} == states
    )
    return (topic.text, plant) if tells_all else None


def _plant_named(declared: dict[str, tree.Decl], name: str) -> tree.PlantDecl | None:
    """Gives the plant called `name`, or the plant of an instance called `name`; or None."""
    found = declared.get(name)
    for system in declared.values():
        if found is None and isinstance(system, tree.SystemDecl):
            names = (i.what.text for i in system.instances if _is_instance_named(i, name))
            found = declared.get(next(names, ""))
    return found if isinstance(found, tree.PlantDecl) else None


def _mentions_name(value: object, name: str) -> bool:
    if isinstance(value, tree.NameExpr):
        return value.name.text == name
    if isinstance(value, tuple):
        return any(_mentions_name(v, name) for v in value)
    inner = fields(value) if isinstance(value, tree.SyntaxExpr) and is_dataclass(value) else ()
    return any(_mentions_name(getattr(value, f.name), name) for f in inner)


def _is_instance_named(item: object, name: str) -> TypeGuard[tree.Instance]:
    return isinstance(item, tree.Instance) and item.name.text == name


def helps_for_other_kind(
    decls: Iterable[tree.Decl], decl: tree.Decl, wanted: str, span: Span
) -> tuple[Help, ...]:
    """Gives helps with names of kind `wanted` that belong to `decl`, which is of another kind.

    For a node in place of a topic: what it publishes; for a topic in place of a type: its type.
    """
    declared = tuple(decls)
    if wanted == "topic":
        return _help_with_topics(declared, decl)
    if wanted == "type" and isinstance(decl, tree.TopicDecl):
        return (replace(span, decl.type.span.text, f"its type is `{decl.type.span.text}`"),)
    if wanted == "node":
        return _help_with_nodes(declared, decl)
    if wanted == "plant":
        plants = [d.name.text for d in declared if isinstance(d, tree.PlantDecl)]
        return _help_with_names("plants are", plants)
    if wanted == "module" and isinstance(decl, tree.NodeDecl):
        name = decl.name.text
        modules = [d for d in declared if isinstance(d, tree.RtaDecl)]
        owners = [d.name.text for d in modules if name in _node_names(d)]
        return _help_with_names("it is a node of", owners)
    if wanted == "value" and isinstance(decl, (tree.NodeDecl, tree.PlantDecl)):
        return _help_with_topics(declared, decl)
    if wanted == "parameter" and isinstance(decl, tree.ConstDecl):
        return ("declare it with `param`",)
    return ()


def _help_with_names(label: str, names: list[str], then: str = "") -> tuple[Help, ...]:
    """Gives a help that lists names in a sentence; () if `names` is empty."""
    return (f"{label} {quoted_names(names)}{then}",) if names else ()


def _help_with_nodes(decls: tuple[tree.Decl, ...], decl: tree.Decl) -> tuple[Help, ...]:
    """Gives a help that lists the nodes of a topic or module, or all nodes."""
    known = [d for d in decls if isinstance(d, tree.NodeDecl)]
    if isinstance(decl, tree.TopicDecl):
        by = [d.name.text for d in known if decl.name.text in _published_names(d)]
        return _help_with_names("it is published by", by)
    if isinstance(decl, tree.RtaDecl):
        return _help_with_names("its nodes are", _node_names(decl))
    return _help_with_names("nodes are", [d.name.text for d in known])


def _help_with_topics(decls: tuple[tree.Decl, ...], decl: tree.Decl) -> tuple[Help, ...]:
    """Gives a help that lists the topics of a node, plant, module or type."""
    if isinstance(decl, tree.NodeDecl):
        topics, verb = _published_names(decl), "publishes"
    elif isinstance(decl, tree.PlantDecl):
        topics, verb = [t.text for t, _ in decl.drives], "drives"
    elif isinstance(decl, tree.RtaDecl):
        inside = _node_names(decl)
        nodes = [d for d in decls if isinstance(d, tree.NodeDecl) and d.name.text in inside]
        topics, verb = [t for d in nodes for t in _published_names(d)], "publishes"
    elif isinstance(decl, tree.TypeDecl):
        declared = [d for d in decls if isinstance(d, tree.TopicDecl)]
        topics = [d.name.text for d in declared if d.type.span.text == decl.name.text]
        return _help_with_names("topics of this type are", topics)
    else:
        return ()
    return _help_with_names(f"it {verb}", list(dict.fromkeys(topics)), ": name the topic")


def whole_topic_helps(decls: Iterable[tree.Decl], topic: tree.Decl, part: Span) -> tuple[Help, ...]:
    """Gives helps for `pose.x` at `part` where a topic is needed: all of the record, or `pose`."""
    assigned = part.source.text[part.end :].lstrip().startswith("=")
    if not assigned or not isinstance(topic, tree.TopicDecl):
        return (replace(part, topic.name.text),)
    record = next((d for d in decls if d.name.text == topic.type.span.text), None)
    if not isinstance(record, tree.TypeDecl) or not isinstance(record.type, tree.RecordTypeExpr):
        return (f"give all of `{topic.name.text}` at once",)
    fields_ = ", ".join(f"{name.text}: ..." for name, _ in record.type.fields)
    return (f"give all of its fields at once: `{topic.name.text} = {{ {fields_} }}`",)


def is_published_or_driven(decls: Iterable[tree.Decl], topic: str) -> bool:
    """Whether a node publishes a topic of this name, or a plant drives it."""
    return any(
        (isinstance(d, tree.NodeDecl) and topic in _published_names(d))
        or (isinstance(d, tree.PlantDecl) and topic in [t.text for t, _ in d.drives])
        for d in decls
    )


def _published_names(node: tree.NodeDecl) -> list[str]:
    return [p.topic.text for p in node.publishes]


def _node_names(module: tree.RtaDecl) -> list[str]:
    parts = (module.ac, module.sc, *module.plans)
    return list(dict.fromkeys(p.text for p in parts if isinstance(p, tree.Ref)))


def quoted_names(names: list[str]) -> str:
    """Gives the first few names in backticks: `a`, `b`."""
    shown = ", ".join(f"`{n}`" for n in names[:SHOWN])
    return shown + (" and others" if len(names) > SHOWN else "")
