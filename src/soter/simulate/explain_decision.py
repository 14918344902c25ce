"""Explains why a decision module decided as it did: which predicate was true, on which values.

Purpose: an `Explainer` finds, for a DM step of a trace, which topic was too old, which part of
`ttf` or `safer` was true on which values, and which output of AC the gate refused. It evaluates the
checked predicates once more on what the step read, so that the C has to record nothing but facts.
Non-goals: deciding; words for a change as such (`decisions.py`).

What a DM read is put together from two states: a topic has its value of this instant if its writer
steps before the DM in the deployed order (plants, inputs), else that of the instant before. Under
`order any` the predicates may differ from what the DM recorded; then none is told (`Why.known`).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from itertools import repeat
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from soter.core.layout import COMPONENT, HEADER, MODULE, decode_from
from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.predicates import PredicateEvaluator
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model.tree_walk import conjuncts, disjuncts
from soter.language.model.types import (
    BoolType,
    EnumType,
    FloatType,
    IntType,
    leaf_name,
    leaves,
    positions,
)
from soter.semantics.configuration import AC, NEVER
from soter.simulate.stale_reads import stale_reads

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.layout import StateLayout
    from soter.language.model.system import Module, System
    from soter.language.model.types import Type, Value
    from soter.simulate.stale_reads import Stale

T = TypeVar("T")
Number = float | int | bool | str
COMPARED = {"<", "<=", ">", ">=", "==", "!="}
NEAR, BEYOND = 0.1, 0.01
"""Shares of an axis: what is near its end, and where it is asked whether `safe` holds beyond."""
NEAR_AN_END = "; the grid ends at {} = {}: `safe` holds beyond, which counts as unsafe there"
SHOWN = 6
"""The digits of a number in words, if they show that two compared sides differ."""


@dataclass(frozen=True)
class Operand:
    """One side of a comparison: its text, and its value."""

    text: str
    value: Number


@dataclass(frozen=True)
class PredicatePart:
    """A part of a predicate; `value` is None where it faulted, and `fault` says how.

    `operands`: both sides of a comparison; for computed predicates the estimate, with its `level`:
    0 outside S_0, 1 in S_0, 2 in S_(m-2).
    """

    text: str
    value: bool | None
    operands: tuple[Operand, ...] = ()
    fault: str = ""

    def __str__(self) -> str:
        if self.fault:
            return f"{self.text}: step fault `{self.fault}`"
        return self.text if self.value else f"not {self.text}"


class GateFault(NamedTuple):
    """The AC whose last step the gate refused, and the kind of its fault."""

    node: str
    fault: str


@dataclass(frozen=True)
class DecisionReason:
    """The reason of a DM step.

    `ttf`, `safer`: their parts (any part makes `ttf` true, all make `safer`); empty where they are
    not `known`. `owed`: how many outputs AC owed. `led`: which part of the tube around SC's runs
    failed; only for changes of mode (`change_records`).
    """

    known: bool
    ttf: tuple[PredicatePart, ...]
    safer: tuple[PredicatePart, ...]
    stale: tuple[Stale, ...]
    gate_fault: GateFault | None
    owed: int
    led: str = ""

    def words(self, before: str, after: str) -> list[str]:
        """The reasons in words, one phrase each; empty if AC only stays."""
        if after == "AC":
            return [str(p) for p in self.safer] if before == "SC" else []
        phrases = [str(s) for s in self.stale]
        if before == "AC":
            phrases += [str(p) for p in self.ttf if p.value or p.value is None]
            phrases += [self.led] if self.led else []
            if self.gate_fault is not None:
                phrases.append("`{1}` of {0}".format(*self.gate_fault))
            return phrases
        phrases += [str(p) for p in self.safer if not p.value]
        return phrases + ([f"AC owes {self.owed} clean outputs"] if self.owed else [])


class TopicRead(NamedTuple):
    """What a step read of a topic; `age_ns`: None where nothing was ever published."""

    topic: str
    type: Type
    value: Value
    age_ns: int | None


class Explainer:
    """Explains DM steps of a system; compiles a module's predicates when it first asks for them."""

    def __init__(self, system: System, layout: StateLayout) -> None:
        self.system = system
        self.layout = layout
        self._readers: dict[int, _PredicateReader] = {}

    def explain(self, module: int, before: bytes | None, at: bytes) -> DecisionReason:
        """The reason of a module's DM step in the instant that ended in the state `at`.

        `before`: the state at the end of the instant before, None at the first one.
        """
        return self._reader(module).explain(before, at)

    def reads(self, module: int, before: bytes | None, at: bytes) -> tuple[TopicRead, ...]:
        """The reads of that DM step; () if steps come in any order, as they are unknown then."""
        return () if self.system.shuffled else self._reader(module).reads(before, at)

    def _reader(self, module: int) -> _PredicateReader:
        if module not in self._readers:
            self._readers[module] = _PredicateReader(
                self.system, self.layout, self.system.modules[module]
            )
        return self._readers[module]

    def safe(self, module: int) -> Callable[[bytes], bool] | None:
        """A function that says whether `safe` holds on the topics of a state; a fault counts as no.

        None if `safe` calls an extern function.
        """
        reader = _PredicateReader(self.system, self.layout, self.system.modules[module])
        return reader.safe()


class _PredicateReader:
    """The compiled predicates of one module, and what its DM reads."""

    def __init__(self, system: System, layout: StateLayout, module: Module) -> None:
        self.system, self.layout, self.module = system, layout, module
        self._evaluator = PredicateEvaluator.of(module.scope)
        self._early = published_before(system, module.dm)
        symbol = module.symbol
        self._level_known: int | None = None
        """The level that the facts of a step imply, if there is one level; None: compute it."""
        self._refused_known: bool | None = None
        """Whether the judged commands were refused, if the facts imply it; None: compute it."""
        evaluator = Evaluator.of(module.scope)
        holds = evaluator.expression(symbol.safe)
        self._safe = None if evaluator.unbound else holds
        self._ttf = [] if symbol.ttf is None else self._parts(disjuncts(symbol.ttf))
        self._safer = [] if symbol.safer is None else self._parts(conjuncts(symbol.safer))

    def explain(self, before: bytes | None, at: bytes) -> DecisionReason:
        """The reason of a step; see `Explainer.explain`."""
        facts = self._module_record(at, self.module)
        env = self._environment(before, at)
        ttf: tuple[PredicatePart, ...] = ()
        safer: tuple[PredicatePart, ...] = ()
        if self.module.symbol.rest is not None:
            self._level_known = 2 if facts["safer"] else 0
            self._refused_known = bool(facts["ttf"])
        if not self._evaluator.unbound:  # an extern function is asked once, by the run
            ttf = tuple(part(env) for part in self._ttf)
            safer = tuple(part(env) for part in self._safer)
        known = bool(facts["ttf"]) == _any_part(ttf) and bool(facts["safer"]) == _all_parts(safer)
        stale = (
            tuple(stale_reads(self.system, self.module, env.stamps, env.time_ns))
            if facts["stale"]
            else ()
        )
        return DecisionReason(
            known=known,
            ttf=ttf if known else (),
            safer=safer if known else (),
            stale=stale,
            gate_fault=self._gate_fault(before) if facts["saw_gate_fault"] else None,
            owed=0 if before is None else self._module_record(before, self.module)["clean_needed"],
        )

    def safe(self) -> Callable[[bytes], bool] | None:
        """See `Explainer.safe`."""
        return None if self._safe is None else lambda at: self._is_safe(self._environment(at, at))

    def _is_safe(self, env: Environment) -> bool:
        """Whether `safe` is true without a fault; False if it asks an extern function."""
        try:
            return self._safe is not None and bool(self._safe(env))
        except StepFault:
            return False

    # ------------------------------------------------------------ what the step read

    def reads(self, before: bytes | None, at: bytes) -> tuple[TopicRead, ...]:
        """See `Explainer.reads`."""
        env, topics = self._environment(before, at), self.system.topics
        ages = {
            i: env.time_ns - env.stamps[i] for i in self.module.inputs if env.stamps[i] != NEVER
        }
        return tuple(
            TopicRead(topics[i].name, topics[i].type, env.topics[i], ages.get(i))
            for i in self.module.inputs
        )

    def _environment(self, before: bytes | None, at: bytes) -> Environment:
        ct = HEADER.unpack_from(at, 0)["ct"]
        layout, topics = self.layout, self.system.topics

        def value(i: int) -> Value:
            raw = at if i in self._early else before
            if raw is None:
                return topics[i].default
            return decode_from(raw, layout.topic_offset(i), topics[i].type)

        def stamp(i: int) -> int:
            raw = at if i in self._early else before
            if raw is None:
                return NEVER
            stamp_ns: int = struct.unpack_from("<q", raw, layout.stamp_offset + 8 * i)[0]
            return stamp_ns

        def mode(i: int) -> int:
            other = self.system.modules[i]
            raw = at if other.dm < self.module.dm else before
            if raw is None:
                return AC if other.forced == "ac" else 1 - AC
            return self._module_record(raw, other)["mode"]

        def margin_ns(i: int) -> int:
            looked = self.system.modules[i].looked
            assert looked is not None
            if mode(i) != AC:
                return 0
            looks = value(looked)
            assert isinstance(looks, int)
            return self.system.modules[i].margin_ns(looks, ct - stamp(looked))

        return Environment(
            topics=_LazySequence(value, len(topics)),
            stamps=_LazySequence(stamp, len(topics)),
            time_ns=ct,
            period_ns=self.module.period_ns,
            mode=mode,
            margin_ns=margin_ns,
        )

    def _module_record(self, raw: bytes, module: Module) -> dict[str, int]:
        return MODULE.unpack_from(raw, self.layout.module_offset + module.index * MODULE.size)

    def _gate_fault(self, before: bytes | None) -> GateFault | None:
        """The gate fault that the DM saw: of the instant before, as AC steps after its DM."""
        if before is None:
            return None
        at = self.layout.component_offset + self.module.ac * COMPONENT.size
        kind = COMPONENT.unpack_from(before, at)["last_fault"]
        name = self.system.components[self.module.ac].name
        return GateFault(name, FaultKind(kind).name.lower()) if kind else None

    # ------------------------------------------------------------ parts of predicates

    def _parts(self, parts: list[typed.TypedExpr]) -> list[Callable[[Environment], PredicatePart]]:
        compile_part = self._computed_part if self.module.computed else self._predicate_part
        return list(map(compile_part, parts))

    def _computed_part(self, e: typed.TypedExpr) -> Callable[[Environment], PredicatePart]:
        """The evaluator of a part of a computed predicate: a level, or judged commands."""
        if isinstance(e, typed.TypedUnary) and self.module.shield is None:
            return self._level_part(e.operand, for_ttf=True)  # not `safer`
        return self._level_part(e) if isinstance(e, typed.TypedBinary) else self._shield_part(e)

    def _shield_part(self, e: typed.TypedExpr) -> Callable[[Environment], PredicatePart]:
        """The evaluator of `!permits`, with what the DM read and the command that is held."""
        refused = self._evaluator.expression(e)
        module, topics = self.module, self.system.topics
        named = [
            (leaf_name(topics[i].name, path), i, path)
            for i in (*module.inputs, *module.outputs)
            for path, _ in leaves(topics[i].type)
        ]

        def part(env: Environment) -> PredicatePart:
            operands = tuple(
                Operand(name, _leaf(topics[i].type, env.topics[i], path)) for name, i, path in named
            )
            values = ", ".join(f"{o.text} = {_short(o.value)}" for o in operands)
            text = f"{values}: a command that may still act is not permitted"
            known = self._refused_known
            return PredicatePart(text, bool(refused(env)) if known is None else known, operands)

        return part

    def _predicate_part(self, e: typed.TypedExpr) -> Callable[[Environment], PredicatePart]:
        whole = self._evaluator.expression(e)
        sides: list[tuple[typed.TypedExpr, Any]] = []
        if isinstance(e, typed.TypedBinary) and e.op in COMPARED:
            sides = [(s, self._evaluator.expression(s)) for s in (e.left, e.right)]
        scalar = (FloatType, IntType, BoolType, EnumType)
        scalars = bool(sides) and all(isinstance(s.type, scalar) for s, _ in sides)
        plain = _text(e)

        def part(env: Environment) -> PredicatePart:
            try:
                value = bool(whole(env))
                operands = [Operand(_text(s), _number(s, of(env))) for s, of in sides if scalars]
            except StepFault as fault:
                return PredicatePart(plain, None, (), fault.kind.name.lower())
            if not operands:
                return PredicatePart(plain, value)
            assert isinstance(e, typed.TypedBinary)
            text = _comparison_text(operands[0], e.op, operands[1], sides[1][0])
            return PredicatePart(text, value, tuple(operands))

        return part

    def _near_an_end(self, leaf: typed.TypedExpr, x: Operand, env: Environment) -> str:
        """Says that the grid ends near an estimate, and `safe` goes on behind it; else ""."""
        low, high = self.module.grid_ends.get(x.text, (-math.inf, math.inf))
        for end, out in ((low, low - high), (high, high - low)):
            if (end - float(x.value)) / out < NEAR:
                beyond_end = copy(env)
                beyond_end.topics = self._with(leaf, end + BEYOND * out, env.topics)
                return NEAR_AN_END.format(x.text, _short(end)) if self._is_safe(beyond_end) else ""
        return ""

    def _with(self, leaf: typed.TypedExpr, x: float, topics: Sequence[Value]) -> Sequence[Value]:
        """A copy of all topics with one leaf replaced."""
        where: list[Any] = []
        while not isinstance(leaf, typed.TopicRead):
            assert isinstance(leaf, (typed.TypedField, typed.Index))
            where, leaf = [getattr(leaf.index, "value", leaf.index), *where], leaf.target
        return with_number(topics[:], [self.module.scope.topics[leaf.topic], *where], x)

    def _level_part(
        self, e: typed.TypedExpr, *, for_ttf: bool = False
    ) -> Callable[[Environment], PredicatePart]:
        """The evaluator of `level(x, ...) < 1` or `>= 2`; of several plans, that of the first."""
        e = disjuncts(e)[0]
        assert isinstance(e, typed.TypedBinary)
        assert isinstance(e.left, typed.TypedCall)
        level = self._evaluator.expression(e.left)
        leaves_ = e.left.arguments
        arguments = [(leaf_path_name(a), self._evaluator.expression(a)) for a in leaves_]
        below = 2 if for_ttf else 1
        for_ttf = for_ttf or e.op == "<"
        outside, inside = "outside S_0", "deep inside S_0"
        if self.module.symbol.rest is not None:
            outside, inside = "from where SC is not led to rest", "from where SC is led to rest"

        def part(env: Environment) -> PredicatePart:
            estimate = [Operand(name, float(of(env))) for name, of in arguments]
            known_level = self._level_known
            level_value = int(level(env)) if known_level is None else known_level
            where = ", ".join(f"{o.text} = {_short(o.value)}" for o in estimate)
            value = level_value < below if for_ttf else level_value > 1
            text = f"{where} {outside if for_ttf else inside}"
            if for_ttf and value:
                text += "".join(map(self._near_an_end, leaves_, estimate, repeat(env)))
            return PredicatePart(text, value, (*estimate, Operand("level", level_value)))

        return part


# ---------------------------------------------------------------- reading two states


class _LazySequence(Sequence[T]):
    """A sequence that computes each value when somebody asks for it."""

    def __init__(self, of: Callable[[int], T], size: int) -> None:
        self._of = of
        self._size = size

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, i: Any) -> Any:  # noqa: ANN401 - an index, or a slice of them
        if isinstance(i, slice):
            return [self._of(k) for k in range(*i.indices(self._size))]
        return self._of(i)


def with_number(value: Sequence[Value], where: Sequence[int], x: float) -> Sequence[Value]:
    """A value with one number replaced, at a path from the outside in."""
    first, *rest = where
    return (*value[:first], with_number(value[first], rest, x) if rest else x, *value[first + 1 :])


def _leaf(t: Type, value: Any, path: Sequence[str]) -> Number:  # noqa: ANN401 - of a topic
    """The number at a path of `leaves` in a topic's value."""
    for k in positions(t, path):
        value = value[k]
    number: Number = value
    return number


def published_before(system: System, dm: int) -> frozenset[int]:
    """The topics whose publishers all step before a DM in the deployed order, inputs included."""
    late = {i for c in system.components if c.index >= dm for i in c.writes}
    looks = {m.looked for m in system.modules if m.dm >= dm and m.looked is not None}
    judging = [m.shield for m in system.modules if m.shield is not None]
    shields = {s.topic for s in judging} | {s.proposed for s in judging if s.proposed is not None}
    return frozenset({t.index for t in system.topics} - late - looks - shields)


def _any_part(parts: tuple[PredicatePart, ...]) -> bool:
    """The value of `ttf` by its parts, as a DM takes it: a fault is true; no part: true."""
    return next((True for p in parts if p.value or p.value is None), not parts)


def _all_parts(parts: tuple[PredicatePart, ...]) -> bool:
    return bool(parts) and all(p.value for p in parts)


# ---------------------------------------------------------------- words


def _text(e: typed.TypedExpr) -> str:
    return " ".join(e.span.text.split())


def _number(e: typed.TypedExpr, value: Value) -> Number:
    if isinstance(e.type, EnumType):
        assert isinstance(value, int)
        return e.type.members[value]
    assert isinstance(value, (bool, int, float))
    return value


def _comparison_text(left: Operand, op: str, right: Operand, of: typed.TypedExpr) -> str:
    """A comparison with its values, as `Room(m) = 0.11 < LIMIT = 0.0`; a literal appears once."""
    a, b = _short(left.value), _short(right.value)
    if a == b and left.value != right.value:
        a, b = repr(left.value), repr(right.value)
    side = right.text if isinstance(of, typed.Literal) and not of.name else f"{right.text} = {b}"
    return f"{left.text} = {a} {op} {side}"


def _short(value: Number) -> str:
    return f"{value:.{SHOWN}g}" if isinstance(value, float) else str(value)


def leaf_path_name(e: typed.TypedExpr) -> str:
    """The name of the topic leaf that a computed predicate reads."""
    if isinstance(e, typed.TypedField):
        assert hasattr(e.target.type, "fields")
        return f"{leaf_path_name(e.target)}.{e.target.type.fields[e.index][0]}"
    if isinstance(e, typed.Index) and isinstance(e.index, typed.Literal):
        return f"{leaf_path_name(e.target)}[{e.index.value}]"
    assert isinstance(e, typed.TopicRead)
    return e.topic.name
