"""What a name that means nothing was meant to be, where another language tells.

Purpose: helps for unknown types, values and functions, most of them edits.
Non-goals: names that are nearly right (`diagnostics/similar_names.py`), phrases
(`language/syntax/foreign_idioms.py`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.diagnostics.fix import Edit, Fix, insert, replace
from soter.diagnostics.span import Span
from soter.language.syntax import foreign_words, tree

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.diagnostics.fix import Help

MEMBERS_SHOWN = 3
_SECOND_WORD = re.compile(r"[ \t]+(int|long|short|char|double)\b")
LIBRARIES = foreign_words.LIBRARIES | {"random"}
OF_AN_OBJECT = ("self", "this")


def a_type(name: str, span: Span) -> tuple[Help, ...]:
    """For a type of C, Python, Rust or ROS; nothing where it is none."""
    meant = foreign_words.type_meant(name)
    second = _SECOND_WORD.match(span.source.text, span.end)
    if meant is not None:
        whole = span if second is None else Span(span.source, span.start, second.end())
        return (replace(whole, "float" if second and second[1] == "double" else meant),)
    advice = foreign_words.type_advice(name)
    return (advice,) if advice is not None else ()


def a_value(declared: Iterable[tree.Decl], name: str, span: Span) -> tuple[Help, ...]:
    """For `True`, `AC`, `M_PI`, `None`, a member without its enum."""
    meant = foreign_words.value_meant(name)
    if meant is not None:
        return (replace(span, meant),)
    if foreign_words.is_nothing(name):
        return (
            "there is no null: every value is one of its type, 0 or `false` where none is said",
        )
    owners = [
        f"{decl.name.text}.{name}"
        for decl in declared
        if isinstance(decl, tree.TypeDecl)
        and isinstance(decl.type, tree.EnumTypeExpr)
        and any(m.text == name for m in decl.type.members)
    ]
    return tuple(replace(span, owner) for owner in owners[:MEMBERS_SHOWN])


def a_function(expr: tree.CallExpr, name: str, span: Span) -> tuple[Help, ...]:
    """For `len(xs)`, `not (a)`, `now()`, `fabs(x)`."""
    arguments = expr.arguments
    if name == "not" and len(arguments) == 1:
        return (replace(Span(span.source, span.start, arguments[0].span.start), "!("),)
    if name == "len" and len(arguments) == 1:
        return (replace(expr.span, f"{arguments[0].span.text}.len"),)
    if name in ("now", "get_time", "clock", "millis", "rostime") and not arguments:
        return (replace(expr.span, "time", "write `time`: seconds since the start"),)
    if name in ("range", "xrange"):
        return ("a loop counts over a range: `for i in 0..10 { ... }`",)
    if name == "print" or name.startswith("printf"):
        return ("publish the value, or read it in the log: every topic is logged",)
    advice = foreign_words.function_advice(name)
    if advice is not None:
        return (advice,)
    meant = foreign_words.function_meant(name)
    return (replace(span, meant),) if meant is not None else ()


def a_range(call: tree.SyntaxExpr) -> tuple[Help, ...]:
    """For `range(3)` and `range(1, 3)` behind `for i in`."""
    if not isinstance(call, tree.CallExpr) or not isinstance(call.callee, tree.NameExpr):
        return ()
    if call.callee.name.text not in ("range", "xrange") or not 1 <= len(call.arguments) <= 2:
        return ()
    low = call.arguments[0].span.text if len(call.arguments) == 2 else "0"
    high = call.arguments[-1]
    if isinstance(high, tree.CallExpr) and high.callee.span.text == "len" and high.arguments:
        return (replace(call.span, f"{low}..{high.arguments[0].span.text}.len"),)
    return (replace(call.span, f"{low}..{high.span.text}"),)


def of_a_library(qualifier: tree.Name, name: tree.Name, wanted: str) -> tuple[Help, ...] | None:
    """For `math.sin`, `np.clip`, `std_msgs.Bool`; None where it looks like a file of one's own."""
    whole = qualifier.span.to(name.span)
    if wanted == "type" and qualifier.text.endswith("_msgs"):
        meant = foreign_words.type_meant(name.text)
        if meant is not None:
            return (replace(whole, meant),)
        advice = foreign_words.type_advice(name.text)
        return (advice or "declare its fields: `type Name = { x: float, y: float };`",)
    if qualifier.text not in foreign_words.LIBRARIES:
        return None
    if wanted == "type":
        return a_type(name.text, whole) or ("declare it: `type Name = { x: float };`",)
    meant = (
        foreign_words.value_meant(name.text) or foreign_words.function_meant(name.text) or name.text
    )
    return (replace(whole, meant),)


def without_object(name: tree.Name, field: tree.Name) -> tuple[Help, ...]:
    """For `self.last` and `math.pi`: the name alone, or what it is worth."""
    if name.text in foreign_words.LIBRARIES:
        return of_a_library(name, field, "name") or ()
    if name.text not in OF_AN_OBJECT:
        return ()
    span = Span(name.span.source, name.span.start, field.span.start)
    return (Fix(f"write `{field.text}`", (Edit(span, ""),)),)


def a_declaration(name: tree.Name) -> tuple[Help, ...]:
    """For an assignment to a name that is not there: it declares it."""
    return (insert(name.span, "let ", f"declare it: `let {name.text} = ...;`"),)


_DECLARATION = re.compile(r"^(?:extern|node|plant|rta|system|test|type|fun|topic)\b", re.MULTILINE)


def listed_too(word: str, name: str, owner: Span) -> Fix:
    """`name` behind the others of `word` in the body of the node or plant called `owner`.

    `word` is `subscribes`, `publishes` or `reads`; where the body has none, it gets one.
    """
    text = owner.source.text
    item = _item(word, owner)
    title = f"add `{name}` to `{word}`"
    if item is not None:
        return Fix(title, (Edit(Span(owner.source, item.end(), item.end()), f", {name}"),))
    opener = text.find("{", owner.end) + 1
    return Fix(title, (Edit(Span(owner.source, opener, opener), f"\n  {word} {name};"),))


def _item(word: str, owner: Span) -> re.Match[str] | None:
    """The item that `word` begins in the body of the declaration called `owner`."""
    text = owner.source.text
    next_ = _DECLARATION.search(text, owner.end)
    end = next_.start() if next_ else len(text)
    return re.compile(rf"\b{word}\b[^;{{}}]*(?=;)").search(text, owner.end, end)


def in_publishes(name: str, owner: Span) -> Span | None:
    """Where the node called `owner` lists `name` among what it publishes; None where unseen."""
    item = _item("publishes", owner)
    word = item and re.compile(rf"\b{re.escape(name)}\b").search(
        owner.source.text, item.start() + len("publishes"), item.end()
    )
    return Span(owner.source, word.start(), word.end()) if word else None


def published_too(
    declared: Iterable[tree.Decl], topic: str, owner: tree.Name | Span
) -> tuple[Help, ...]:
    """`topic` behind what the node called `owner` publishes, unless another one drives it.

    The controllers of a module publish what it does, each of them.
    """
    span = owner if isinstance(owner, Span) else owner.span
    own, declarations = span.text, list(declared)
    module_of: dict[str, str] = {}
    for d in declarations:
        if isinstance(d, tree.RtaDecl):
            refs = [r.text for r in (d.ac, d.sc) if isinstance(r, tree.Ref)]
            module_of |= dict.fromkeys(refs, d.name.text)
    others = [
        d.name.text
        for d in declarations
        if isinstance(d, tree.NodeDecl)
        and d.name.text != own
        and any(p.topic.text == topic for p in d.publishes)
    ]
    if own in module_of or not others:
        return (listed_too("publishes", topic, span),)
    module = module_of.get(others[0])
    who = f"module `{module}`" if module else f"node `{others[0]}`"
    return (
        f"leave it out: {who} drives `{topic}`, and a topic has one driver",
        f"in the place of {who}, `{own}` has it in `publishes`, too",
    )
