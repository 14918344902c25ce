"""What a name means elsewhere, where it means nothing or something else.

Purpose: before a name is called unknown or of the wrong kind, every declaration is looked through:
states and disturbances of plants, locals of nodes, parameters of functions, instances of systems.
What it is, where it stands, and what to write instead.
Non-goals: names that are nearly right (`diagnostics/similar_names.py`), names of other languages
(`foreign_name_hints.py`), declarations of imports (`scope.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass
from typing import TYPE_CHECKING, TypeGuard

from soter.diagnostics.fix import replace
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.diagnostics.fix import Help
    from soter.diagnostics.span import Span

SHOWN = 3


@dataclass(frozen=True)
class Meaning:
    """What a name is in another scope: in words, where it is declared, and a help."""

    what: str
    span: Span
    help: str
    weak: bool = False
    """Names of functions' parameters and of locals are often the same by chance."""


def meanings(decls: Iterable[tree.Decl], name: str) -> Iterator[Meaning]:
    """What `name` is inside of declarations of a file, in their order; lazily."""
    declared = tuple(decls)
    for decl in declared:
        if isinstance(decl, tree.PlantDecl):
            yield from _in_a_plant(decl, name)
        elif isinstance(decl, tree.NodeDecl):
            yield from _in_a_node(decl, name)
        elif isinstance(decl, tree.FunDecl):
            for parameter, _ in decl.parameters:
                if parameter.text == name:
                    what = f"a parameter of function `{decl.name.text}`"
                    yield Meaning(what, parameter.span, "only its function sees it", weak=True)
        elif isinstance(decl, (tree.SystemDecl, tree.TestDecl)):
            yield from _in_a_loop(decl, name)
        if isinstance(decl, tree.SystemDecl):
            for item in decl.instances:
                if _is_called(item, name) and item.what.text != name:
                    what = f"an instance of `{item.what.text}` in system `{decl.name.text}`"
                    yield Meaning(what, item.name.span, _instead_of_instance(declared, item))


def _in_a_loop(decl: tree.SystemDecl | tree.TestDecl, name: str) -> Iterator[Meaning]:
    """The loop variable of a `for` of a system or test, or of one inside of that."""
    todo: list[object] = [getattr(decl, f.name) for f in fields(decl)]
    while todo:
        item = todo.pop()
        if isinstance(item, tuple):
            todo += item
        elif isinstance(item, tree.Repeated):
            todo += item.items
            if item.name.text == name:
                what = f"the loop variable of a `for` of `{decl.name.text}`"
                how = "it is known inside of the braces of its `for` only: move this line there"
                yield Meaning(what, item.name.span, how)
                return


def _in_a_plant(plant: tree.PlantDecl, name: str) -> Iterator[Meaning]:
    owner = f"of plant `{plant.name.text}`"
    for state in plant.states:
        if state.name.text == name:
            driven = driven_by(plant, name)
            seen = [t.text for t, value in plant.drives if _mentions(value, name)]
            how = "only its plant sees it"
            if driven:
                how = f"what is measured of it is `{driven}`"
            elif seen:
                how = f"only its plant sees it; what it drives of it is {listed(seen)}"
            yield Meaning(f"a state {owner}", state.name.span, how)
    for disturbance in plant.disturbances:
        if disturbance.name.text == name:
            how = "only its plant sees it; a proof counts with all values of its set"
            yield Meaning(f"a disturbance {owner}", disturbance.name.span, how)
    for let in plant.lets:
        if let.name.text == name:
            how = "only its plant sees it; what all may use is a `const`, or a `fun`"
            yield Meaning(f"a `let` {owner}", let.name.span, how)


def _in_a_node(node: tree.NodeDecl, name: str) -> Iterator[Meaning]:
    how = "only its node sees it: publish it on a topic"
    own = [*node.locals, *_declared_in(node.step), *_declared_in(node.takeover)]
    for local in own:
        if local.name.text == name:
            what = f"a local of node `{node.name.text}`"
            yield Meaning(what, local.name.span, how, weak=True)


def _declared_in(part: object) -> Iterator[tree.LetStmt | tree.VarStmt]:
    """All `let` and `var` of a block, those of the blocks in it, too."""
    if isinstance(part, (tree.LetStmt, tree.VarStmt)):
        yield part
    elif isinstance(part, tuple):
        for inner in part:
            yield from _declared_in(inner)
    elif is_dataclass(part) and isinstance(part, (tree.Block, tree.SyntaxStmt)):
        for field in fields(part):
            yield from _declared_in(getattr(part, field.name))


def _instead_of_instance(decls: Iterable[tree.Decl], item: tree.Instance) -> str:
    what = next((d for d in decls if d.name.text == item.what.text), None)
    if isinstance(what, tree.PlantDecl):
        topics = listed([topic.text for topic, _ in what.drives])
        return f"only properties of its system see `{item.name.text}.truth`; others read {topics}"
    return "only its system sees it"


def driven_by(plant: tree.PlantDecl, state: str) -> str:
    """The topic, or the field of one, that a plant drives with a state as it is; "" if none."""
    for topic, value in plant.drives:
        if isinstance(value, tree.NameExpr) and value.name.text == state:
            return topic.text
        for field, part in value.fields if isinstance(value, tree.RecordExpr) else ():
            if isinstance(part, tree.NameExpr) and part.name.text == state:
                return f"{topic.text}.{field.text}"
    return ""


def truth_as_topic(
    decls: Iterable[tree.Decl], names: list[tree.Name]
) -> tuple[str, tree.Decl] | None:
    """What the plant drives for `c.truth...`, `c.x`, `Cart.truth...`, and the plant.

    `c` is an instance of the plant in some system of these declarations.
    """
    declared = {d.name.text: d for d in decls}
    first = names[0].text
    plant = declared.get(first)
    for system in declared.values():
        if plant is None and isinstance(system, tree.SystemDecl):
            of = (i.what.text for i in system.instances if _is_called(i, first))
            plant = declared.get(next(of, ""))
    if not isinstance(plant, tree.PlantDecl) or not plant.drives:
        return None
    parts = [n.span.text if isinstance(n, tree.ElementName) else n.text for n in names[1:]]
    if parts and parts[0] == "truth":
        parts.pop(0)
    if parts:
        state, bracket, index = parts[0].partition("[")
        driven = driven_by(plant, state.rstrip())
        return (".".join([driven + bracket + index, *parts[1:]]), plant) if driven else None
    topic, value = plant.drives[0]
    states = {s.name.text for s in plant.states}
    whole = (
        isinstance(value, tree.RecordExpr)
        and {n.text for n, part in value.fields if isinstance(part, tree.NameExpr)} == states
    )
    return (topic.text, plant) if whole else None


def _mentions(value: object, name: str) -> bool:
    """Whether a name stands somewhere in an expression."""
    if isinstance(value, tree.NameExpr):
        return value.name.text == name
    if isinstance(value, tuple):
        return any(_mentions(v, name) for v in value)
    inner = fields(value) if isinstance(value, tree.SyntaxExpr) and is_dataclass(value) else ()
    return any(_mentions(getattr(value, f.name), name) for f in inner)


def _is_called(item: object, name: str) -> TypeGuard[tree.Instance]:
    return isinstance(item, tree.Instance) and item.name.text == name


def instead(
    decls: Iterable[tree.Decl], decl: tree.Decl, wanted: str, span: Span
) -> tuple[Help, ...]:
    """What is of the kind `wanted` and belongs to `decl`, which is of another one.

    A node where a topic is meant: what it publishes; a topic where a type is meant: its type.
    """
    declared = tuple(decls)
    name = decl.name.text
    if wanted == "topic":
        return _its_topics(declared, decl)
    if wanted == "type" and isinstance(decl, tree.TopicDecl):
        return (replace(span, decl.type.span.text, f"its type is `{decl.type.span.text}`"),)
    if wanted == "node":
        known = [d for d in declared if isinstance(d, tree.NodeDecl)]
        if isinstance(decl, tree.TopicDecl):
            by = [d.name.text for d in known if name in _published(d)]
            return (f"it is published by {listed(by)}",) if by else ()
        if isinstance(decl, tree.RtaDecl):
            return (f"its nodes are {listed(_nodes_of(decl))}",) if _nodes_of(decl) else ()
        return (f"nodes are {listed([d.name.text for d in known])}",) if known else ()
    if wanted == "plant":
        plants = [d.name.text for d in declared if isinstance(d, tree.PlantDecl)]
        return (f"plants are {listed(plants)}",) if plants else ()
    if wanted == "module" and isinstance(decl, tree.NodeDecl):
        of = [d.name.text for d in declared if isinstance(d, tree.RtaDecl) and _has(d, name)]
        return (f"it is a node of {listed(of)}",) if of else ()
    if wanted == "value" and isinstance(decl, (tree.NodeDecl, tree.PlantDecl)):
        return _its_topics(declared, decl)
    return ()


def _its_topics(decls: tuple[tree.Decl, ...], decl: tree.Decl) -> tuple[Help, ...]:
    """The topics of a node, plant, module or type, as one sentence."""
    if isinstance(decl, tree.NodeDecl):
        topics, verb = _published(decl), "publishes"
    elif isinstance(decl, tree.PlantDecl):
        topics, verb = [t.text for t, _ in decl.drives], "drives"
    elif isinstance(decl, tree.RtaDecl):
        inside = _nodes_of(decl)
        nodes = [d for d in decls if isinstance(d, tree.NodeDecl) and d.name.text in inside]
        topics, verb = [t for d in nodes for t in _published(d)], "publishes"
    elif isinstance(decl, tree.TypeDecl):
        of = [d for d in decls if isinstance(d, tree.TopicDecl)]
        topics = [d.name.text for d in of if d.type.span.text == decl.name.text]
        return (f"topics of this type are {listed(topics)}",) if topics else ()
    else:
        return ()
    topics = list(dict.fromkeys(topics))
    return (f"it {verb} {listed(topics)}: name the topic",) if topics else ()


def whole_topic(decls: Iterable[tree.Decl], topic: tree.Decl, part: Span) -> tuple[Help, ...]:
    """What stands for `topic.field`, at `part`, where a topic is named: `publish pose.x = e`, say.

    The whole record where it is given a value, the name alone everywhere else.
    """
    given = part.source.text[part.end :].lstrip().startswith("=")
    if not given or not isinstance(topic, tree.TopicDecl):
        return (replace(part, topic.name.text),)
    record = next((d for d in decls if d.name.text == topic.type.span.text), None)
    if not isinstance(record, tree.TypeDecl) or not isinstance(record.type, tree.RecordTypeExpr):
        return (f"give all of `{topic.name.text}` at once",)
    fields_ = ", ".join(f"{name.text}: ..." for name, _ in record.type.fields)
    return (f"give all of its fields at once: `{topic.name.text} = {{ {fields_} }}`",)


def is_driven(decls: Iterable[tree.Decl], topic: str) -> bool:
    """Whether a node publishes a topic of this name, or a plant drives it."""
    return any(
        (isinstance(d, tree.NodeDecl) and topic in _published(d))
        or (isinstance(d, tree.PlantDecl) and topic in [t.text for t, _ in d.drives])
        for d in decls
    )


def _published(node: tree.NodeDecl) -> list[str]:
    return [p.topic.text for p in node.publishes]


def _nodes_of(module: tree.RtaDecl) -> list[str]:
    parts = (module.ac, module.sc)
    return list(dict.fromkeys(p.text for p in parts if isinstance(p, tree.Ref)))


def _has(module: tree.RtaDecl, name: str) -> bool:
    return name in _nodes_of(module)


def listed(names: list[str]) -> str:
    """`a`, `b`: the first few of them."""
    shown = ", ".join(f"`{n}`" for n in names[:SHOWN])
    return shown + (" and others" if len(names) > SHOWN else "")
