"""Plants, systems and tests: the world a program runs in.

Purpose: the bodies of `plant`, `extern plant`, `system` and `test`, item by item.
Non-goals: composition and well-formedness (`program/`).
"""

# ruff: noqa: SLF001 - the tables at the end name the methods of the class before them

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.syntax import tree
from soter.syntax.bodies import HOMES, LEADERLESS, OnceParts
from soter.syntax.cursor import Panic
from soter.syntax.nodes import NodeParser
from soter.syntax.tokens import EOF, NAME, visible

if TYPE_CHECKING:
    from collections.abc import Callable


_ONE_DRIVES = "write one `drives` for each topic"


@dataclass(slots=True)
class _PlantParts(OnceParts):
    extern: bool = False
    reads: list[tree.Ref] = field(default_factory=list)
    drives: list[tuple[tree.Ref, tree.Expr | None]] = field(default_factory=list)
    states: list[tree.PlantState] = field(default_factory=list)
    disturbances: list[tree.Disturbance] = field(default_factory=list)
    lets: list[tree.PlantLet] = field(default_factory=list)
    der: list[tuple[tree.Name, tree.Expr]] = field(default_factory=list)
    next: list[tuple[tree.Name, tree.Expr]] = field(default_factory=list)
    measured: list[tuple[tree.Path, tree.Expr]] = field(default_factory=list)


@dataclass(slots=True)
class _SystemParts(OnceParts):
    instances: list[tree.Instance] = field(default_factory=list)
    properties: list[tree.Property] = field(default_factory=list)
    forces: list[tree.Force] = field(default_factory=list)
    replaces: list[tree.Replace] = field(default_factory=list)
    sets: list[tree.SetParam] = field(default_factory=list)
    inputs: list[tree.DriveInput] = field(default_factory=list)
    faults: list[tree.TimingFault] = field(default_factory=list)


class SystemParser(NodeParser):
    """The part of the parser that reads plants, systems and tests."""

    __slots__ = ()

    # ------------------------------------------------------------ plants

    def _plant(self) -> tree.Decl:
        start = self.starts[self.i]
        extern = self.accept("extern")
        self.i += 1
        name = self.declare("the name of the plant")
        period = self._period("plant", name)
        source, source_span = self._from() if extern else self._stray_from("plant")
        parts = _PlantParts(extern=extern)
        self._body(f"plant `{visible(name.text)}`", parts, _PLANT_ITEMS)
        return tree.PlantDecl(
            name,
            self.span_from(start),
            period,
            extern,
            source,
            source_span,
            tuple(parts.reads),
            tuple(parts.drives),
            tuple(parts.states),
            tuple(parts.disturbances),
            tuple(parts.lets),
            tuple(parts.der),
            tuple(parts.next),
            parts.once.get("integrate"),
            tuple(parts.measured),
        )

    def _reads(self, parts: _PlantParts) -> None:
        self.i += 1
        parts.reads.extend(self._refs("the name of a topic"))
        self.semicolon("the read topics")

    def _drives(self, parts: _PlantParts) -> None:
        self.i += 1
        while self._driven(parts):
            self.i += 1

    def _driven(self, parts: _PlantParts) -> bool:
        """`topic = value;`; whether a comma stands for the `;`, and another topic behind it."""
        topic = self.ref("the name of a topic")
        value: tree.Expr | None = None
        if self.kinds[self.i] in ("=", ":=", "=="):
            self.assign("after the driven topic")
            value = self.expr("the driven value")
            if self.kinds[self.i] == "," and self.kinds[self.i + 1] == NAME:
                self.missing_semicolon("the driven value", (_ONE_DRIVES,))
                parts.drives.append((topic, value))
                return True
            value = self.ended(value, "the driven value")
        elif self.kinds[self.i] == ",":
            self.report(
                "S005",
                "expected `;` after the driven topic, found `,`",
                helps=(_ONE_DRIVES,),
            )
            self.damaged = True
            self.skip_statement()
        elif parts.extern:
            self.semicolon("the driven topic")
        else:
            self.report(
                "S024" if self.kinds[self.i] == ";" else "S005",
                f"expected `=` and a value after the driven topic, found {self.found()}",
                helps=("only an extern plant drives a topic without saying what",),
            )
            value = tree.ErrorExpr(topic.span)
            self.skip_statement()
        parts.drives.append((topic, value))
        return False

    def _state(self, parts: _PlantParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        name = self.name("the name of a state")
        type_ = self._typed("the state")
        interval = self._interval("the initial range") if self.accept("in") else None
        initial: tree.Expr | None = None
        if self.kinds[self.i] in ("=", ":=", "=="):
            self.assign("before the initial value")
            initial = self.value("the initial value")
        else:
            self.no_initial("the type of the state")
        span = self.span_from(start)
        parts.states.append(tree.PlantState(name, type_, interval, initial, span))

    def _disturbance(self, parts: _PlantParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        name = self.name("the name of a disturbance")
        type_ = self._typed("the disturbance")
        hold: tree.Expr | None = None
        if self.kinds[self.i] != "in" and isinstance(type_, tree.RangedIntType):
            # `int in [a, b]` reads as a type first; here the range is the disturbance's.
            interval = type_.interval
            type_ = tree.BuiltinType(type_.span, "int")
        elif self.accept("in"):
            interval = self._interval("the range of the disturbance")
        else:
            message = f"expected `in` and a range after the disturbance, found {self.found()}"
            self.report("S005", message, notes=("a proof needs the bound of every disturbance",))
            error = tree.ErrorExpr(self.after_previous())
            interval = tree.Interval(error, error, error.span)
        if self.accept_word("hold"):
            hold = self.time("`hold`")
        self.semicolon("the disturbance")
        span = self.span_from(start)
        parts.disturbances.append(tree.Disturbance(name, type_, interval, hold, span))

    def _plant_let(self, parts: _PlantParts) -> None:
        statement = self._let()
        if isinstance(statement, tree.LetStmt):
            parts.lets.append(
                tree.PlantLet(statement.name, statement.type, statement.value, statement.span)
            )

    def _der(self, parts: _PlantParts) -> None:
        parts.der.append(self._equation("der"))

    def _next(self, parts: _PlantParts) -> None:
        parts.next.append(self._equation("next"))

    def _equation(self, word: str) -> tuple[tree.Name, tree.Expr]:
        self.i += 1
        name = self.name(f"the name of a state after `{word}`")
        start = self.i
        try:
            self.assign("after the state")
        except Panic:
            self.skip_expression(start)
            self.accept(";")
            return name, tree.ErrorExpr(self.after_previous())
        return name, self.value("the equation")

    def _integrate(self, parts: _PlantParts) -> None:
        at = self.i
        self.i += 1
        method = self.texts[self.i]
        if method not in ("rk4", "euler"):
            raise self.failure(
                "S005", f"expected `rk4` or `euler` after `integrate`, found {self.found()}"
            )
        self.i += 1
        substeps = self.expr("the number of substeps") if self.accept_word("substeps") else None
        self.semicolon("the method of integration")
        self.keep_once(parts, "integrate", (method, substeps), at)

    def _measured(self, parts: _PlantParts) -> None:
        self.i += 1
        while True:
            path = self.path("a topic or one of its fields")
            self.expect_word("within", "after the measured value")
            parts.measured.append((path, self.expr("the bound of the error")))
            if not self.accept(","):
                break
        self.semicolon("the measurement bounds")

    # ------------------------------------------------------------ systems and tests

    def _system(self) -> tree.Decl:
        start = self.starts[self.i]
        self.i += 1
        name = self.declare("the name of the system")
        default = self.accept_word("default")
        parts = _SystemParts()
        what = f"system `{visible(name.text)}`"
        self._body(what, parts, _SYSTEM_ITEMS, self._instance)
        return tree.SystemDecl(
            name,
            self.span_from(start),
            default,
            tuple(parts.instances),
            parts.once.get("until"),
            tuple(parts.properties),
            tuple(parts.forces),
            tuple(parts.replaces),
            tuple(parts.sets),
            tuple(parts.inputs),
        )

    def _instance(self, parts: _SystemParts) -> bool:
        """`name: What;` if that stands here."""
        i = self.i
        self._no_leads_to(i)
        colon = self.kinds[i + 1] == ":"
        if colon and self.texts[i] in _SYSTEM_ITEMS and self.kinds[i + 2] != NAME:
            return False
        if not colon and not self._instance_without_colon(i):
            return False
        start = self.starts[i]
        name = self.name("the name of an instance")
        if colon:
            self.i += 1
        else:
            message = f"expected `:` after the name of the instance, found {self.found()}"
            self.report("S005", message, self.after_previous(), "`:` is missing here")
        what = self.ref("what the instance is made of")
        renames = self._renames_of(what)
        self.semicolon("the instance")
        parts.instances.append(tree.Instance(name, what, None, renames, self.span_from(start)))
        return True

    def _no_leads_to(self, i: int) -> None:
        """`p leadsto q within d;` is a property of tests only."""
        at = i
        while self.kinds[at] not in (";", "{", "}", EOF) and self.texts[at] != "leadsto":
            at += 1
        if at > i and self.texts[at] == "leadsto" and self.kinds[at] == NAME:
            raise self.failure(
                "S010",
                "a system cannot ask what `leadsto` what",
                self.token_span(at),
                notes=("`leadsto` and `eventually` belong in a test: only an exploration judges",),
            )

    def _instance_without_colon(self, i: int) -> bool:
        """`c Cart;`, where `c` is no item word and not nearly one."""
        if self.kinds[i] != NAME or self.kinds[i + 1] != NAME:
            return False
        if self.kinds[i + 2] not in (";", "{", "."):
            return False
        word = self.texts[i]
        return word not in _SYSTEM_ITEMS and self.close_word(word, _SYSTEM_ITEMS) is None

    def _use(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        kind = "node" if self.texts[self.i] == "node" else "module"
        self.i += 1
        what = self.ref(f"the name of a {kind}")
        renames = self._renames_of(what)
        self.semicolon(f"the {kind}")
        instance = tree.Instance(what.name, what, kind, renames, self.span_from(start))
        parts.instances.append(instance)

    def _renames_of(self, what: tree.Ref) -> tuple[tuple[tree.Ref, tree.Ref], ...]:
        if self.kinds[self.i] != "{":
            return ()
        opener = self.i
        self.i += 1
        pairs: list[tuple[tree.Ref, tree.Ref]] = []
        while True:
            inner = self.ref(f"a topic of `{visible(what.text)}`")
            self.assign("between the two names of a topic")
            pairs.append((inner, self.ref("the name of a topic")))
            if not self.comma("}", "the renamed topic", opener):
                return tuple(pairs)

    def _until(self, parts: _SystemParts) -> None:
        at = self.i
        self.i += 1
        self.keep_once(parts, "until", self.time_value("`until`"), at)

    def _always(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        kind = "never" if self.texts[self.i] == "never" else "always"
        self.i += 1
        condition = self.value("the property")
        span = self.span_from(start)
        parts.properties.append(tree.Property(kind, None, condition, None, span))

    def _force(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        module = self.path("the name of a module after `force`")
        to = self.texts[self.i]
        if to not in ("ac", "sc"):
            raise self.failure(
                "S005", f"expected `ac` or `sc` after the module, found {self.found()}"
            )
        self.i += 1
        self.semicolon("the forced mode")
        parts.forces.append(tree.Force(module, to, self.span_from(start)))

    def _replace(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        what = self.path("the name of what is replaced")
        self.expect_word("by", "after what is replaced")
        by = self.ref("the name of the replacement")
        self.semicolon("the replacement")
        parts.replaces.append(tree.Replace(what, by, self.span_from(start)))

    def _set(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        param = self.ref("the name of a parameter")
        self.assign("after the parameter")
        value = self.value("the value of the parameter")
        parts.sets.append(tree.SetParam(param, value, self.span_from(start)))

    def _input(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        topic = self.path("the name of an input topic")
        values = tuple(self._values()) if self.accept("in") else None
        self.expect_word("every", "after the input")
        every = self.time_value("`every`")
        item = tree.DriveInput(topic, values, every, self.span_from(start))
        parts.inputs.append(item)

    def _values(self) -> list[tree.Expr]:
        """`{ a, b }`: the values of an input."""
        self.expect("{", "before the values of the input")
        if self.accept("}"):
            return []  # the checker says what it says of every empty choice
        values = [self.expr("a value")]
        while self.accept(","):
            values.append(self.expr("a value"))
        if not self.accept("}"):
            message = f"expected `,` or `}}` after the value, found {self.found()}"
            self.report("S005", message)
            self.damaged = True
            while self.kinds[self.i] not in ("}", ";", EOF):
                self.i += 1
            self.accept("}")
            self.quiet = self.i
        return values

    def _test(self) -> tree.Decl:
        start = self.starts[self.i]
        self.i += 1
        name = self.declare("the name of the test")
        parts = _SystemParts()
        self._body(f"test `{visible(name.text)}`", parts, _TEST_ITEMS, self._leads_to)
        once = parts.once.get
        return tree.TestDecl(
            name,
            self.span_from(start),
            once("system"),
            tuple(parts.replaces),
            once("skew"),
            once("horizon"),
            tuple(parts.properties),
            once("quantum"),
            tuple(parts.faults),
            tuple(parts.inputs),
        )

    def _tested_system(self, parts: _SystemParts) -> None:
        at = self.i
        self.i += 1
        system = self.ref("the name of a system")
        self.semicolon("the system")
        self.keep_once(parts, "system", system, at)

    def _test_time(self, parts: _SystemParts) -> None:
        at = self.i
        word = self.texts[at] if self.texts[at] in ("horizon", "quantum") else "skew"
        self.i += 1
        self.keep_once(parts, word, self.time_value(f"`{word}`"), at)

    def _late(self, parts: _SystemParts) -> None:
        """`late N by d;` and `overrun N by d;`."""
        start = self.starts[self.i]
        kind = "overrun" if self.texts[self.i] == "overrun" else "late"
        self.i += 1
        component = self.path(f"the name of a node after `{kind}`")
        self.expect_word("by", "and a time after the node")
        by = self.time_value("`by`")
        fault = tree.TimingFault(kind, component, by, None, self.span_from(start))
        parts.faults.append(fault)

    def _skip(self, parts: _SystemParts) -> None:
        """`skip N [at most k];`."""
        start = self.starts[self.i]
        self.i += 1
        component = self.path("the name of a node after `skip`")
        at_most: tree.Expr | None = None
        if self.accept_word("at"):
            self.expect_word("most", "after `at`")
            at_most = self.value("`at most`")
        else:
            self.semicolon("the node that may skip a step")
        fault = tree.TimingFault("skip", component, None, at_most, self.span_from(start))
        parts.faults.append(fault)

    def _eventually(self, parts: _SystemParts) -> None:
        start = self.starts[self.i]
        self.i += 1
        condition = self.expr("the property")
        within = self._within()
        span = self.span_from(start)
        parts.properties.append(tree.Property("eventually", None, condition, within, span))

    def _leads_to(self, parts: _SystemParts) -> bool:
        """`premise leadsto condition within d;` if that stands here."""
        i = self.i
        kinds, texts = self.kinds, self.texts
        if texts[i] in _TEST_ITEMS and kinds[i + 1] not in (".", "<", "<=", "==", "&&", "||"):
            return False
        at = i
        while kinds[at] not in (";", "}", EOF) and texts[at] != "leadsto":
            at += 1
        if texts[at] != "leadsto":
            return False
        start = self.starts[i]
        premise = self.expr("the premise")
        self.expect_word("leadsto", "after the premise")
        condition = self.expr("the property")
        within = self._within()
        span = self.span_from(start)
        parts.properties.append(tree.Property("leadsto", premise, condition, within, span))
        return True

    def _within(self) -> tree.Expr:
        if self.accept_word("within"):
            return self.time_value("`within`")
        message = f"expected `within` and a time after the property, found {self.found()}"
        self.report(
            "S005",
            message,
            self.after_previous(),
            notes=("a property that may wait forever cannot be tested",),
        )
        self.semicolon("the property")
        return tree.ErrorExpr(self.after_previous())


_PLANT_ITEMS: dict[str, Callable[[SystemParser, _PlantParts], None]] = {
    "reads": SystemParser._reads,
    "drives": SystemParser._drives,
    "state": SystemParser._state,
    "disturbance": SystemParser._disturbance,
    "let": SystemParser._plant_let,
    "der": SystemParser._der,
    "next": SystemParser._next,
    "integrate": SystemParser._integrate,
    "measured": SystemParser._measured,
}
_SYSTEM_ITEMS: dict[str, Callable[[SystemParser, _SystemParts], None]] = {
    "module": SystemParser._use,
    "node": SystemParser._use,
    "until": SystemParser._until,
    "always": SystemParser._always,
    "never": SystemParser._always,
    "force": SystemParser._force,
    "replace": SystemParser._replace,
    "set": SystemParser._set,
    "input": SystemParser._input,
}
_TEST_ITEMS: dict[str, Callable[[SystemParser, _SystemParts], None]] = {
    "system": SystemParser._tested_system,
    "replace": SystemParser._replace,
    "skew": SystemParser._test_time,
    "horizon": SystemParser._test_time,
    "always": SystemParser._always,
    "never": SystemParser._always,
    "eventually": SystemParser._eventually,
    "quantum": SystemParser._test_time,
    "late": SystemParser._late,
    "overrun": SystemParser._late,
    "skip": SystemParser._skip,
    "input": SystemParser._input,
}
LEADERLESS["test"] = ("`p leadsto q`",)
LEADERLESS["system"] = ("`name: What`",)
HOMES["a plant"] = frozenset(_PLANT_ITEMS)
HOMES["a system"] = frozenset(_SYSTEM_ITEMS)
HOMES["a test"] = frozenset(_TEST_ITEMS)
