"""Parses `system` declarations with their `faults { ... }`, and `test` declarations.

Purpose: the tables of the items in their bodies, and the readers of these items.
Non-goals: composition and well-formedness (`language/elaborate/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Span
from soter.diagnostics.fixes import exchange, replace
from soter.language.syntax import tree
from soter.language.syntax.lexer import EOF, NAME, printable
from soter.language.syntax.parsing import instance_arrays
from soter.language.syntax.parsing.bodies import LEADERLESS
from soter.language.syntax.parsing.instance_arrays import dotted
from soter.language.syntax.parsing.items import (
    Item,
    Items,
    assign,
    clauses,
    commas,
    each,
    expr,
    group,
    interval,
    made,
    name,
    often,
    once,
    only,
    pair,
    reader_named_by_word,
    ref,
    semicolon,
    spanned,
    time,
    time_value,
    word,
)
from soter.language.syntax.parsing.token_cursor import Panic
from soter.language.syntax.their_words import THEIRS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.language.syntax.parsing.bodies import BodyParser
    from soter.language.syntax.parsing.items import Parts, Step


GIVEN = ("late", "overrun", "bias", "noise", "scale")
"""Kinds of faults with `by`, an amount."""
TIMED = ("late", "overrun")
"""Kinds of faults whose amount is a time."""


def _parse_fault(parser: BodyParser, kind: str, start: int) -> tree.SystemFault:
    """Parses `kind target [by X] [at N per T] [for T];`."""
    target = instance_arrays.parse_path(parser, f"what `{kind}` is about")
    by: tuple[tree.SyntaxExpr, ...] = ()
    if kind in GIVEN:
        parser.expect_word("by", f"and how much, after what `{kind}` is about")
        by = _parse_amounts(parser, parser.time if kind in TIMED else parser.expr)
    rate = per = lasts = None
    if kind != "late" or parser.is_word("at"):
        parser.expect_word("at", "and how often: `at 2 per 1h`")
        rate = parser.expr("how often")
        parser.expect_word("per", "after the number: `at 2 per 1h`")
        per = parser.time("`per`")
        if parser.accept("for"):
            lasts = parser.time("`for`")
    parser.expect_semicolon("the fault")
    return tree.SystemFault(kind, target, by, rate, per, lasts, parser.span_from(start))


def _parse_amounts(
    parser: BodyParser, one: Callable[[str], tree.SyntaxExpr]
) -> tuple[tree.SyntaxExpr, ...]:
    if not parser.accept("["):
        return (one("how much"),)
    amounts = [one("how much")]
    while parser.accept(","):
        amounts.append(one("how much"))
    parser.expect("]", "after the last of them")
    return tuple(amounts)


_order = spanned(word("any", "after `order`"), semicolon("the order"))
OF_TESTS = ("late", "skip", "overrun")
"""Kinds of faults that a test may have, too."""
KINDS = (*OF_TESTS, "nan", "stuck", "silent", "saturated", "bias", "noise", "scale")
FAULT_ITEMS: Items = {
    "order": often(
        "faults",
        lambda *at: tree.SystemFault("order", None, (), None, None, None, _order(*at)),
        "order any",
    ),
    **dict.fromkeys(KINDS, often("faults", _parse_fault)),
}


def parse_system(parser: BodyParser) -> tree.Decl:
    """Parses a `system` declaration."""
    start = parser.starts[parser.take()]
    name = parser.declare("the name of the system")
    default = parser.accept_word("default")
    deploys = parser.ref("the name of a system") if parser.accept_word("deploys") else None
    parts = parser.body(f"system `{printable(name.text)}`", SYSTEM_ITEMS, _parse_instance)
    span = parser.span_from(start)
    fields = parts.fields(SYSTEM_ITEMS)
    return tree.SystemDecl(name, span, default=default, deploys=deploys, **fields)


def _parse_instance(parser: BodyParser, parts: Parts) -> bool:
    """Parses `name: What;` if it is at the cursor; gives whether it was."""
    i = parser.i
    _refuse_leads_to(parser, i)
    element = parser.kinds[i : i + 2] == [NAME, "["] and (
        parser.kinds[instance_arrays.index_after_brackets(parser, i + 1)] == ":"
    )
    colon = parser.kinds[i + 1] == ":" or element
    if colon and not element and parser.texts[i] in SYSTEM_ITEMS and parser.kinds[i + 2] != NAME:
        return False
    if not colon and not _lacks_colon(parser, i):
        return False
    start = parser.starts[i]
    name = instance_arrays.parse_element(parser, parser.name("the name of an instance"))
    if colon:
        parser.i += 1
    else:
        message = f"expected `:` after the name of the instance, found {parser.found()}"
        parser.report("S005", message, parser.after_previous(), "`:` is missing here")
    made_of = parser.ref("what the instance is made of")
    renames, sets = _parse_braces(parser, made_of)
    parser.expect_semicolon("the instance")
    instance = tree.Instance(name, made_of, None, renames, parser.span_from(start), sets)
    parts.several["instances"].append(instance)
    return True


def _refuse_leads_to(parser: BodyParser, i: int) -> None:
    """Reports `p leadsto q within d;`, a property of tests only."""
    at = i
    while parser.kinds[at] not in (";", "{", "}", EOF) and parser.texts[at] != "leadsto":
        at += 1
    if at > i and parser.texts[at] == "leadsto" and parser.kinds[at] == NAME:
        raise parser.failure(
            "S010",
            "a system cannot ask what `leadsto` what",
            parser.token_span(at),
            notes=("`leadsto` and `eventually` belong in a test: only an exploration judges",),
        )


def _lacks_colon(parser: BodyParser, i: int) -> bool:
    """Whether `c Cart;` is at token `i`, where `c` does not resemble the word of an item."""
    if parser.kinds[i] != NAME or parser.kinds[i + 1] != NAME:
        return False
    if parser.kinds[i + 2] not in (";", "{", "."):
        return False
    word = parser.texts[i]
    if word in SYSTEM_ITEMS or word in THEIRS:
        return False
    return parser.word_close_to(word, SYSTEM_ITEMS) is None


def _parse_instance_item(parser: BodyParser, kind: str, start: int) -> tree.Instance:
    made_of = parser.ref(f"the name of a {kind}")
    renames, sets = _parse_braces(parser, made_of)
    parser.expect_semicolon(f"the {kind}")
    return tree.Instance(made_of.name, made_of, kind, renames, parser.span_from(start), sets)


def _parse_braces(
    parser: BodyParser, made_of: tree.Ref
) -> tuple[tuple[tuple[tree.Ref, tree.DottedPath], ...], tuple[tree.SetParam, ...]]:
    """Parses `{ topic = other, set K = 3 }` after an instance; gives the wires and the settings."""
    if parser.kinds[parser.i] != "{":
        return (), ()
    opener = parser.take()
    pairs: list[tuple[tree.Ref, tree.DottedPath]] = []
    sets: list[tree.SetParam] = []
    try:
        while True:
            after = _parse_wire_or_setting(parser, made_of, pairs, sets)
            if not parser.accept_comma("}", after, opener):
                break
    except Panic:
        while parser.kinds[parser.i] not in ("}", ";", EOF):
            parser.i += 1
        parser.accept("}")
        parser.damaged = True
    return tuple(pairs), tuple(sets)


def _parse_wire_or_setting(
    parser: BodyParser,
    made_of: tree.Ref,
    pairs: list[tuple[tree.Ref, tree.DottedPath]],
    sets: list[tree.SetParam],
) -> str:
    """Parses one wire or setting; gives the words for it in the message about a missing comma."""
    if parser.is_word("set") and parser.kinds[parser.i + 1] == NAME:
        start = parser.starts[parser.take()]
        sets.append(instance_arrays.parse_setting(parser, "set", start, inside=True))
        return "the value of the parameter"
    pair = _parse_reversed_wire(parser)
    if pair is None:
        inner = parser.ref(f"a topic of `{printable(made_of.text)}`")
        parser.assign("between the two names of a topic")
        pair = inner, instance_arrays.parse_path(parser, "the name of a topic")
    pairs.append(pair)
    return "the renamed topic"


def _parse_reversed_wire(parser: BodyParser) -> tuple[tree.Ref, tree.DottedPath] | None:
    """Parses a reversed wire, `r[0].pose = ahead`, and reports S005; None if it is not here."""
    i = parser.i
    behind = instance_arrays.index_after_brackets(parser, i + 1)
    while parser.kinds[behind] == "." and parser.kinds[behind + 1] == NAME:
        behind = instance_arrays.index_after_brackets(parser, behind + 2)
    alone = parser.kinds[behind + 1] == NAME and parser.kinds[behind + 2] in (",", "}")
    if "[" not in parser.kinds[i:behind] or parser.kinds[behind] != "=" or not alone:
        return None
    outer = parser.token_span(i).to(parser.token_span(behind - 1))
    inner = parser.token_span(behind + 1)
    helps = (exchange(outer, inner, f"write `{inner.text} = {outer.text}`"),)
    message = "the topic inside of the instance stands before the `=`, that of the system behind it"
    parser.report("S005", message, outer, helps=helps)
    path = instance_arrays.parse_path(parser, "the name of a topic")
    parser.i += 1
    return parser.ref("a topic inside"), path


def _parse_faults(parser: BodyParser, _word: str, _start: int) -> tuple[tree.SystemFault, ...]:
    parts = parser.body("`faults`", FAULT_ITEMS)
    return tuple(parts.several["faults"])


def _parse_always(parser: BodyParser, kind: str, start: int) -> tree.PropertyItem:
    _skip_property_name(parser)
    condition = parser.value("the property")
    return tree.PropertyItem(kind, None, condition, None, parser.span_from(start))


def _skip_property_name(parser: BodyParser) -> None:
    """Reports S015 for the name in `always calm: e;`, and skips the name."""
    i = parser.i
    if parser.kinds[i] != NAME or parser.kinds[i + 1] != ":":
        return
    span = parser.token_span(i).to(parser.token_span(i + 1))
    whole = Span(parser.source, span.start, parser.starts[i + 2])
    helps = (replace(whole, "", f"leave `{span.text}` out"),)
    parser.report("S015", "a property has no name", span, helps=helps)
    parser.i += 2


def _parse_force(parser: BodyParser, _word: str, start: int) -> tree.Force:
    module = instance_arrays.parse_path(parser, "the name of a module after `force`")
    to = parser.texts[parser.i]
    if to not in ("ac", "sc"):
        raise parser.failure(
            "S005", f"expected `ac` or `sc` after the module, found {parser.found()}"
        )
    parser.i += 1
    parser.expect_semicolon("the forced mode")
    return tree.Force(module, to, parser.span_from(start))


def _parse_inline(parser: BodyParser, _word: str, start: int) -> Iterator[tree.Inline]:
    while True:
        node = instance_arrays.parse_path(parser, "the name of a node after `inline`")
        yield tree.Inline(node, parser.span_from(start))
        if not parser.accept(","):
            break
    parser.expect_semicolon("the nodes of `inline`")


def _parse_stated(parser: BodyParser, kind: str, start: int) -> tree.StatedValues:
    """Parses `guarantees t.x in { a, b };` or `assumes ...`: values of a stand-in's topic."""
    topic = instance_arrays.parse_path(parser, f"the name of a topic after `{kind}`")
    parser.expect("in", "after the topic")
    values = _parse_values(parser)
    parser.expect_semicolon("the values")
    return tree.StatedValues(kind, topic, values, parser.span_from(start))


_BOUND = group(
    pair, dotted("the topic or one of its fields"), word("within", "after the measured value"),
    expr("the bound of the error"),
)  # fmt: skip


_OF_AN_EXTERNAL_TOPIC: dict[str, Step] = {
    "every": time("`every`"),
    "delayed": time("`delayed`"),
    "measured": commas(_BOUND),
}


def _parse_external(parser: BodyParser, _word: str, start: int) -> tree.ExternalTopic:
    """Parses `external topic t [every d] [delayed d] [measured t.x within e, ...];`."""
    parser.expect("topic", "after `external`")
    topic = parser.path("the name of a topic")
    found = clauses(parser, "external topic", _OF_AN_EXTERNAL_TOPIC)
    parser.expect_semicolon("the external topic")
    return tree.ExternalTopic(
        topic,
        found.get("every"),
        found.get("delayed"),
        found.get("measured", ()),
        parser.span_from(start),
    )


def _parse_input(parser: BodyParser, _word: str, start: int) -> tree.DriveInput:
    topic = instance_arrays.parse_path(parser, "the name of an input topic")
    found = clauses(parser, "input", {"in": _parse_values, "every": time("`every`")})
    if "every" not in found:
        parser.expect_word("every", "after the input")
        found["every"] = parser.time("`every`")
    parser.expect_semicolon("`every`")
    return tree.DriveInput(topic, found.get("in"), found["every"], parser.span_from(start))


def _parse_values(parser: BodyParser) -> tuple[tree.SyntaxExpr, ...]:
    parser.expect("{", "before the values")
    if parser.accept("}"):
        return ()  # the checker says what it says of every empty choice
    values = [parser.expr("a value")]
    while parser.accept(","):
        values.append(parser.expr("a value"))
    if not parser.accept("}"):
        message = f"expected `,` or `}}` after the value, found {parser.found()}"
        parser.report("S005", message)
        parser.damaged = True
        while parser.kinds[parser.i] not in ("}", ";", EOF):
            parser.i += 1
        parser.accept("}")
        parser.quiet = parser.i
    return tuple(values)


def parse_test(parser: BodyParser) -> tree.Decl:
    """Parses a `test` declaration."""
    start = parser.starts[parser.take()]
    name = parser.declare("the name of the test")
    parts = parser.body(f"test `{printable(name.text)}`", TEST_ITEMS, _parse_leads_to)
    return tree.TestDecl(name, parser.span_from(start), **parts.fields(TEST_ITEMS))


def _parse_late(parser: BodyParser, kind: str, start: int) -> tree.TimingFaultItem:
    component = instance_arrays.parse_path(parser, f"the name of a node after `{kind}`")
    parser.expect_word("by", "and a time after the node")
    by = parser.time_value("`by`")
    return tree.TimingFaultItem(kind, component, by, None, parser.span_from(start))


def _parse_skip(parser: BodyParser, _word: str, start: int) -> tree.TimingFaultItem:
    component = instance_arrays.parse_path(parser, "the name of a node after `skip`")
    at_most: tree.SyntaxExpr | None = None
    if parser.accept_word("at"):
        parser.expect_word("most", "after `at`")
        at_most = parser.value("`at most`")
    else:
        parser.expect_semicolon("the node that may skip a step")
    return tree.TimingFaultItem("skip", component, None, at_most, parser.span_from(start))


def _parse_eventually(parser: BodyParser, _word: str, start: int) -> tree.PropertyItem:
    _skip_property_name(parser)
    condition = parser.expr("the property")
    within = _parse_within(parser)
    return tree.PropertyItem("eventually", None, condition, within, parser.span_from(start))


def _parse_leads_to(parser: BodyParser, parts: Parts) -> bool:
    """Parses `premise leadsto condition within d;` if it is at the cursor; gives whether it was."""
    i = parser.i
    kinds, texts = parser.kinds, parser.texts
    if texts[i] in TEST_ITEMS and kinds[i + 1] not in (".", "<", "<=", "==", "&&", "||"):
        return False
    at = i
    while kinds[at] not in (";", "}", EOF) and texts[at] != "leadsto":
        at += 1
    if texts[at] != "leadsto":
        return False
    start = parser.starts[i]
    premise = parser.expr("the premise")
    parser.expect_word("leadsto", "after the premise")
    condition = parser.expr("the property")
    within = _parse_within(parser)
    span = parser.span_from(start)
    item = tree.PropertyItem("leadsto", premise, condition, within, span)
    parts.several["properties"].append(item)
    return True


def _parse_within(parser: BodyParser) -> tree.SyntaxExpr:
    if parser.accept_word("within"):
        return parser.time_value("`within`")
    message = f"expected `within` and a time after the property, found {parser.found()}"
    parser.report(
        "S005",
        message,
        parser.after_previous(),
        notes=("a property that may wait forever cannot be tested",),
    )
    parser.expect_semicolon("the property")
    return tree.ErrorExpr(parser.after_previous())


_HISTOGRAM = (
    word("in", "and the range of the histogram: `in [0.0, 5.0] / 50`"),
    interval("the range of the histogram"), word("/", "and the number of bins after the range"),
    expr("the number of bins"),
)  # fmt: skip
_IN_BOTH: Items = {
    "replace": often(
        "replaces",
        made(
            tree.Replace, dotted("the name of what is replaced"),
            word("by", "after what is replaced"), ref("the name of the replacement"),
            semicolon("the replacement"),
        ),
    ),
    "set": often("sets", instance_arrays.parse_setting),
    "input": often("inputs", _parse_input),
    "always": often("properties", _parse_always),
    "never": often("properties", _parse_always),
}  # fmt: skip
SYSTEM_ITEMS: Items = {
    "module": often("instances", _parse_instance_item),
    "node": often("instances", _parse_instance_item),
    "until": once("until", reader_named_by_word("time_value")),
    "always": _IN_BOTH["always"],
    "never": _IN_BOTH["never"],
    "force": often("forces", _parse_force),
    "inline": each("inlines", _parse_inline),
    **_IN_BOTH,
}
TEST_ITEMS: Items = {
    "system": once("system", only(ref("the name of a system"), semicolon("the system"))),
    "replace": _IN_BOTH["replace"],
    "skew": once("skew", reader_named_by_word("time_value")),
    "horizon": once("horizon", reader_named_by_word("time_value")),
    "always": _IN_BOTH["always"],
    "never": _IN_BOTH["never"],
    "eventually": often("properties", _parse_eventually),
    "quantum": once("quantum", reader_named_by_word("time_value")),
    "order": once(
        "order",
        spanned(word("deployed", "after `order`"), semicolon("the order")),
        "order deployed",
    ),
    "late": often("faults", _parse_late),
    "overrun": often("faults", _parse_late),
    "skip": often("faults", _parse_skip),
    "input": _IN_BOTH["input"],
    "set": _IN_BOTH["set"],
    "assumes": often("stated", _parse_stated),
    "guarantees": often("stated", _parse_stated),
}
_IN_LOOPS = dict(SYSTEM_ITEMS)
_LOOP = Item({}, instance_arrays.loop(_IN_LOOPS, _parse_instance), "loop")
_IN_LOOPS["for"] = SYSTEM_ITEMS["for"] = _LOOP
SYSTEM_ITEMS |= {
    "faults": once("faults", _parse_faults, none=()),
    "measure": often(
        "measures",
        made(
            tree.MeasureItem, name("the name of a measure"),
            assign("after the name of the measure"), expr("what is measured"), *_HISTOGRAM,
            word("every", "after the bins"), time_value("`every`"),
        ),
    ),
    "external": often("externals", _parse_external, "external topic"),
}  # fmt: skip
TEST_ITEMS["for"] = Item({}, instance_arrays.loop(TEST_ITEMS, _parse_leads_to), "loop")
LEADERLESS["test"] = ("`p leadsto q`",)
LEADERLESS["system"] = ("`name: What`",)
