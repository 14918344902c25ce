"""Systems and tests: which parts run together, and what is asked of them.

Purpose: the bodies of `system` and `test`, item by item.
Non-goals: composition and well-formedness (`language/elaborate/`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import exchange, replace
from soter.diagnostics.source import Span
from soter.language.syntax import tree
from soter.language.syntax.parsing import instance_arrays
from soter.language.syntax.parsing.bodies import LEADERLESS, OnceParts
from soter.language.syntax.parsing.faults import FAULT_ITEMS, FaultParts
from soter.language.syntax.parsing.misplaced_words import at_word_of_elsewhere
from soter.language.syntax.parsing.token_cursor import Panic
from soter.language.syntax.tokens import EOF, NAME, visible
from soter.language.syntax.word_tables import meaning

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.syntax.parsing.bodies import BodyParser


@dataclass(slots=True)
class _SystemParts(OnceParts):
    instances: list[tree.Instance | tree.Repeated] = field(default_factory=list)
    properties: list[tree.PropertyItem | tree.Repeated] = field(default_factory=list)
    forces: list[tree.Force | tree.Repeated] = field(default_factory=list)
    replaces: list[tree.Replace | tree.Repeated] = field(default_factory=list)
    stated: list[tree.StatedValues | tree.Repeated] = field(default_factory=list)
    sets: list[tree.SetParam | tree.Repeated] = field(default_factory=list)
    inputs: list[tree.DriveInput | tree.Repeated] = field(default_factory=list)
    faults: list[tree.TimingFaultItem | tree.Repeated] = field(default_factory=list)
    disturbed: list[tree.SystemFault] = field(default_factory=list)
    measures: list[tree.MeasureItem] = field(default_factory=list)
    inlines: list[tree.Inline | tree.Repeated] = field(default_factory=list)
    externals: list[tree.ExternalTopic] = field(default_factory=list)
    loops: int = 0  # around these items


def system(parser: BodyParser) -> tree.Decl:
    """A system."""
    start = parser.starts[parser.i]
    parser.i += 1
    name = parser.declare("the name of the system")
    default = parser.accept_word("default")
    deploys = parser.ref("the name of a system") if parser.accept_word("deploys") else None
    parts = _SystemParts()
    what = f"system `{visible(name.text)}`"
    parser.body(what, parts, _SYSTEM_ITEMS, _instance)
    return tree.SystemDecl(
        name,
        parser.span_from(start),
        default=default,
        instances=tuple(parts.instances),
        until=parts.once.get("until"),
        properties=tuple(parts.properties),
        forces=tuple(parts.forces),
        replaces=tuple(parts.replaces),
        sets=tuple(parts.sets),
        inputs=tuple(parts.inputs),
        faults=tuple(parts.disturbed),
        measures=tuple(parts.measures),
        inlines=tuple(parts.inlines),
        externals=tuple(parts.externals),
        deploys=deploys,
    )


def _instance(parser: BodyParser, parts: _SystemParts) -> bool:
    """`name: What;` if that stands here."""
    i = parser.i
    _no_leads_to(parser, i)
    element = parser.kinds[i + 1] == "[" and instance_arrays.at_instance(parser, i)
    colon = parser.kinds[i + 1] == ":" or element
    if colon and not element and parser.texts[i] in _SYSTEM_ITEMS and parser.kinds[i + 2] != NAME:
        return False
    if not colon and not _instance_without_colon(parser, i):
        return False
    start = parser.starts[i]
    name = instance_arrays.element(parser, parser.name("the name of an instance"))
    if colon:
        parser.i += 1
    else:
        message = f"expected `:` after the name of the instance, found {parser.found()}"
        parser.report("S005", message, parser.after_previous(), "`:` is missing here")
    what = parser.ref("what the instance is made of")
    renames, sets = _inside_of(parser, what)
    parser.semicolon("the instance")
    span = parser.span_from(start)
    parts.instances.append(tree.Instance(name, what, None, renames, span, sets))
    return True


def _no_leads_to(parser: BodyParser, i: int) -> None:
    """`p leadsto q within d;` is a property of tests only."""
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


def _instance_without_colon(parser: BodyParser, i: int) -> bool:
    """`c Cart;`, where `c` is no item word and not nearly one."""
    if parser.kinds[i] != NAME or parser.kinds[i + 1] != NAME:
        return False
    if parser.kinds[i + 2] not in (";", "{", "."):
        return False
    word = parser.texts[i]
    if word in _SYSTEM_ITEMS or at_word_of_elsewhere(parser) or meaning("item", word, "system"):
        return False
    return parser.close_word(word, _SYSTEM_ITEMS) is None


def _use(parser: BodyParser, parts: _SystemParts) -> None:
    start = parser.starts[parser.i]
    kind = "node" if parser.texts[parser.i] == "node" else "module"
    parser.i += 1
    what = parser.ref(f"the name of a {kind}")
    renames, sets = _inside_of(parser, what)
    parser.semicolon(f"the {kind}")
    instance = tree.Instance(what.name, what, kind, renames, parser.span_from(start), sets)
    parts.instances.append(instance)


def _inside_of(
    parser: BodyParser, what: tree.Ref
) -> tuple[tuple[tuple[tree.Ref, tree.DottedPath], ...], tuple[tree.SetParam, ...]]:
    """`{ topic = other, set K = 3 }` behind what an instance is made of: wires and settings."""
    if parser.kinds[parser.i] != "{":
        return (), ()
    opener = parser.i
    parser.i += 1
    pairs: list[tuple[tree.Ref, tree.DottedPath]] = []
    sets: list[tree.SetParam] = []
    try:
        while True:
            after = _wire_or_setting(parser, what, pairs, sets)
            if not parser.comma("}", after, opener):
                break
    except Panic:
        while parser.kinds[parser.i] not in ("}", ";", EOF):
            parser.i += 1
        parser.accept("}")
        parser.damaged = True
    return tuple(pairs), tuple(sets)


def _wire_or_setting(
    parser: BodyParser,
    what: tree.Ref,
    pairs: list[tuple[tree.Ref, tree.DottedPath]],
    sets: list[tree.SetParam],
) -> str:
    """One of them is read; what it is called where a comma is missing behind it."""
    if parser.is_word("set") and parser.kinds[parser.i + 1] == NAME:
        sets.append(instance_arrays.setting(parser, inside=True))
        return "the value of the parameter"
    pair = _reversed_wire(parser)
    if pair is None:
        inner = parser.ref(f"a topic of `{visible(what.text)}`")
        parser.assign("between the two names of a topic")
        pair = inner, instance_arrays.path(parser, "the name of a topic")
    pairs.append(pair)
    return "the renamed topic"


def _reversed_wire(parser: BodyParser) -> tuple[tree.Ref, tree.DottedPath] | None:
    """`r[0].pose = ahead`, S005: the topic inside comes first; None where that does not stand."""
    i = parser.i
    behind = instance_arrays.behind_indices(parser, i + 1)
    while parser.kinds[behind] == "." and parser.kinds[behind + 1] == NAME:
        behind = instance_arrays.behind_indices(parser, behind + 2)
    alone = parser.kinds[behind + 1] == NAME and parser.kinds[behind + 2] in (",", "}")
    if "[" not in parser.kinds[i:behind] or parser.kinds[behind] != "=" or not alone:
        return None
    outer = parser.token_span(i).to(parser.token_span(behind - 1))
    inner = parser.token_span(behind + 1)
    helps = (exchange(outer, inner, f"write `{inner.text} = {outer.text}`"),)
    message = "the topic inside of the instance stands before the `=`, that of the system behind it"
    parser.report("S005", message, outer, helps=helps)
    path = instance_arrays.path(parser, "the name of a topic")
    parser.i += 1
    return parser.ref("a topic inside"), path


def _faults(parser: BodyParser, parts: _SystemParts) -> None:
    """`faults { ... }`."""
    at = parser.i
    parser.i += 1
    inner = FaultParts()
    parser.body("`faults`", inner, FAULT_ITEMS)
    parser.keep_once(parts, "faults", True, at)
    parts.disturbed += inner.found


def _measure(parser: BodyParser, parts: _SystemParts) -> None:
    """`measure name = e in [low, high] / bins every d;`."""
    start = parser.starts[parser.i]
    parser.i += 1
    name = parser.name("the name of a measure")
    parser.assign("after the name of the measure")
    value = parser.expr("what is measured")
    parser.expect("in", "and the range of the histogram: `in [0.0, 5.0] / 50`")
    interval = parser.interval("the range of the histogram")
    parser.expect("/", "and the number of bins after the range")
    bins = parser.expr("the number of bins")
    parser.expect_word("every", "after the bins")
    every = parser.time_value("`every`")
    span = parser.span_from(start)
    parts.measures.append(tree.MeasureItem(name, value, interval, bins, every, span))


def _until(parser: BodyParser, parts: _SystemParts) -> None:
    at = parser.i
    parser.i += 1
    parser.keep_once(parts, "until", parser.time_value("`until`"), at)


def _always(parser: BodyParser, parts: _SystemParts) -> None:
    start = parser.starts[parser.i]
    kind = "never" if parser.texts[parser.i] == "never" else "always"
    parser.i += 1
    _no_name(parser)
    condition = parser.value("the property")
    span = parser.span_from(start)
    parts.properties.append(tree.PropertyItem(kind, None, condition, None, span))


def _no_name(parser: BodyParser) -> None:
    """S015 for `always calm: e;`; on with the property."""
    i = parser.i
    if parser.kinds[i] != NAME or parser.kinds[i + 1] != ":":
        return
    span = parser.token_span(i).to(parser.token_span(i + 1))
    whole = Span(parser.source, span.start, parser.starts[i + 2])
    helps = (replace(whole, "", f"leave `{span.text}` out"),)
    parser.report("S015", "a property has no name", span, helps=helps)
    parser.i += 2


def _force(parser: BodyParser, parts: _SystemParts) -> None:
    start = parser.starts[parser.i]
    parser.i += 1
    module = instance_arrays.path(parser, "the name of a module after `force`")
    to = parser.texts[parser.i]
    if to not in ("ac", "sc"):
        raise parser.failure(
            "S005", f"expected `ac` or `sc` after the module, found {parser.found()}"
        )
    parser.i += 1
    parser.semicolon("the forced mode")
    parts.forces.append(tree.Force(module, to, parser.span_from(start)))


def _inline(parser: BodyParser, parts: _SystemParts) -> None:
    start = parser.starts[parser.i]
    parser.i += 1
    while True:
        what = instance_arrays.path(parser, "the name of a node after `inline`")
        parts.inlines.append(tree.Inline(what, parser.span_from(start)))
        if not parser.accept(","):
            break
    parser.semicolon("the nodes of `inline`")


def _replace(parser: BodyParser, parts: _SystemParts) -> None:
    start = parser.starts[parser.i]
    parser.i += 1
    what = instance_arrays.path(parser, "the name of what is replaced")
    parser.expect_word("by", "after what is replaced")
    by = parser.ref("the name of the replacement")
    parser.semicolon("the replacement")
    parts.replaces.append(tree.Replace(what, by, parser.span_from(start)))


def _set(parser: BodyParser, parts: _SystemParts) -> None:
    parts.sets.append(instance_arrays.setting(parser))


def _input(parser: BodyParser, parts: _SystemParts) -> None:
    start = parser.starts[parser.i]
    parser.i += 1
    topic = instance_arrays.path(parser, "the name of an input topic")
    values = tuple(_values(parser)) if parser.accept("in") else None
    parser.expect_word("every", "after the input")
    every = parser.time_value("`every`")
    item = tree.DriveInput(topic, values, every, parser.span_from(start))
    parts.inputs.append(item)


def _stated(parser: BodyParser, parts: _SystemParts) -> None:
    """`guarantees t.x in { a, b };`, `assumes ...`: values of what stands for its publisher."""
    start = parser.starts[parser.i]
    kind = "assumes" if parser.texts[parser.i] == "assumes" else "guarantees"
    parser.i += 1
    topic = instance_arrays.path(parser, f"the name of a topic after `{kind}`")
    parser.expect("in", "after the topic")
    values = tuple(_values(parser))
    parser.semicolon("the values")
    parts.stated.append(tree.StatedValues(kind, topic, values, parser.span_from(start)))


def _external(parser: BodyParser, parts: _SystemParts) -> None:
    """`external topic t [every d] [delayed d] [measured t.x within e, ...];`."""
    start = parser.starts[parser.i]
    parser.i += 1
    parser.expect("topic", "after `external`")
    topic = parser.path("the name of a topic")
    every = parser.time("`every`") if parser.accept_word("every") else None
    delayed = parser.time("`delayed`") if parser.accept_word("delayed") else None
    measured: list[tuple[tree.DottedPath, tree.SyntaxExpr]] = []
    if parser.accept_word("measured"):
        while True:
            path = instance_arrays.path(parser, "the topic or one of its fields")
            parser.expect_word("within", "after the measured value")
            measured.append((path, parser.expr("the bound of the error")))
            if not parser.accept(","):
                break
    parser.semicolon("the external topic")
    span = parser.span_from(start)
    parts.externals.append(tree.ExternalTopic(topic, every, delayed, tuple(measured), span))


def _values(parser: BodyParser) -> list[tree.SyntaxExpr]:
    """`{ a, b }`: the values of an input, or of a stand-in."""
    parser.expect("{", "before the values")
    if parser.accept("}"):
        return []  # the checker says what it says of every empty choice
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
    return values


def test(parser: BodyParser) -> tree.Decl:
    """A test."""
    start = parser.starts[parser.i]
    parser.i += 1
    name = parser.declare("the name of the test")
    parts = _SystemParts()
    parser.body(f"test `{visible(name.text)}`", parts, _TEST_ITEMS, _leads_to)
    once = parts.once.get
    return tree.TestDecl(
        name,
        parser.span_from(start),
        system=once("system"),
        replaces=tuple(parts.replaces),
        skew=once("skew"),
        horizon=once("horizon"),
        properties=tuple(parts.properties),
        quantum=once("quantum"),
        faults=tuple(parts.faults),
        inputs=tuple(parts.inputs),
        sets=tuple(parts.sets),
        stated=tuple(parts.stated),
        order=once("order"),
    )


def _order(parser: BodyParser, parts: _SystemParts) -> None:
    """`order deployed;`."""
    at = parser.i
    parser.i += 1
    parser.expect_word("deployed", "after `order`")
    parser.semicolon("the order")
    parser.keep_once(parts, "order", parser.span_from(parser.starts[at]), at)


def _tested_system(parser: BodyParser, parts: _SystemParts) -> None:
    at = parser.i
    parser.i += 1
    system = parser.ref("the name of a system")
    parser.semicolon("the system")
    parser.keep_once(parts, "system", system, at)


def _test_time(parser: BodyParser, parts: _SystemParts) -> None:
    at = parser.i
    word = parser.texts[at] if parser.texts[at] in ("horizon", "quantum") else "skew"
    parser.i += 1
    parser.keep_once(parts, word, parser.time_value(f"`{word}`"), at)


def _late(parser: BodyParser, parts: _SystemParts) -> None:
    """`late N by d;` and `overrun N by d;`."""
    start = parser.starts[parser.i]
    kind = "overrun" if parser.texts[parser.i] == "overrun" else "late"
    parser.i += 1
    component = instance_arrays.path(parser, f"the name of a node after `{kind}`")
    parser.expect_word("by", "and a time after the node")
    by = parser.time_value("`by`")
    fault = tree.TimingFaultItem(kind, component, by, None, parser.span_from(start))
    parts.faults.append(fault)


def _skip(parser: BodyParser, parts: _SystemParts) -> None:
    """`skip N [at most k];`."""
    start = parser.starts[parser.i]
    parser.i += 1
    component = instance_arrays.path(parser, "the name of a node after `skip`")
    at_most: tree.SyntaxExpr | None = None
    if parser.accept_word("at"):
        parser.expect_word("most", "after `at`")
        at_most = parser.value("`at most`")
    else:
        parser.semicolon("the node that may skip a step")
    fault = tree.TimingFaultItem("skip", component, None, at_most, parser.span_from(start))
    parts.faults.append(fault)


def _eventually(parser: BodyParser, parts: _SystemParts) -> None:
    start = parser.starts[parser.i]
    parser.i += 1
    _no_name(parser)
    condition = parser.expr("the property")
    within = _within(parser)
    span = parser.span_from(start)
    parts.properties.append(tree.PropertyItem("eventually", None, condition, within, span))


def _leads_to(parser: BodyParser, parts: _SystemParts) -> bool:
    """`premise leadsto condition within d;` if that stands here."""
    i = parser.i
    kinds, texts = parser.kinds, parser.texts
    if texts[i] in _TEST_ITEMS and kinds[i + 1] not in (".", "<", "<=", "==", "&&", "||"):
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
    within = _within(parser)
    span = parser.span_from(start)
    parts.properties.append(tree.PropertyItem("leadsto", premise, condition, within, span))
    return True


def _within(parser: BodyParser) -> tree.SyntaxExpr:
    if parser.accept_word("within"):
        return parser.time_value("`within`")
    message = f"expected `within` and a time after the property, found {parser.found()}"
    parser.report(
        "S005",
        message,
        parser.after_previous(),
        notes=("a property that may wait forever cannot be tested",),
    )
    parser.semicolon("the property")
    return tree.ErrorExpr(parser.after_previous())


_SYSTEM_ITEMS: dict[str, Callable[[BodyParser, _SystemParts], None]] = {
    "module": _use,
    "node": _use,
    "until": _until,
    "always": _always,
    "never": _always,
    "force": _force,
    "inline": _inline,
    "replace": _replace,
    "set": _set,
    "input": _input,
}
_TEST_ITEMS: dict[str, Callable[[BodyParser, _SystemParts], None]] = {
    "system": _tested_system,
    "replace": _replace,
    "skew": _test_time,
    "horizon": _test_time,
    "always": _always,
    "never": _always,
    "eventually": _eventually,
    "quantum": _test_time,
    "order": _order,
    "late": _late,
    "overrun": _late,
    "skip": _skip,
    "input": _input,
    "set": _set,
    "assumes": _stated,
    "guarantees": _stated,
}
_IN_LOOPS = dict(_SYSTEM_ITEMS)
_IN_LOOPS["for"] = _SYSTEM_ITEMS["for"] = instance_arrays.loop(_IN_LOOPS, _instance)
_SYSTEM_ITEMS["faults"] = _faults
_SYSTEM_ITEMS["measure"] = _measure
_SYSTEM_ITEMS["external"] = _external
_TEST_ITEMS["for"] = instance_arrays.loop(_TEST_ITEMS, _leads_to)
LEADERLESS["test"] = ("`p leadsto q`",)
LEADERLESS["system"] = ("`name: What`",)
