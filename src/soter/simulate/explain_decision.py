"""Explains why a decision module decided as it did: which predicate was true, on which values.

Purpose: an `Explainer` finds, for a DM step of a trace, which topic was too old, which part of
`ttf` or `safer` was true on which values, and which output of AC the gate refused. It evaluates the
checked predicates once more on what the step read, so that the C has to record nothing but facts.
Non-goals: deciding; words for a change as such (`decisions.py`).

The values that a DM read come from two states: a topic has its value of this instant if its writer
steps before the DM in the deployed order (plants, inputs), else that of the instant before. Under
`order any` the predicates may differ from the DM's facts; then none is given (`known` is False).
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

    PartEvaluator = Callable[[Environment], "PredicatePart"]

T = TypeVar("T")
Number = float | int | bool | str
COMPARED = {"<", "<=", ">", ">=", "==", "!="}
NEAR, BEYOND = 0.1, 0.01
"""Shares of an axis: how near its end an estimate is noted, and how far beyond `safe` is tried."""
NEAR_AN_END = "; the grid ends at {} = {}: `safe` holds beyond, which counts as unsafe there"
SHOWN = 6
"""How many digits a number in a text has, unless two compared sides would look equal."""


@dataclass(frozen=True)
class Operand:
    """One side of a comparison: its text in the program, and its value."""

    text: str
    value: Number


@dataclass(frozen=True)
class PredicatePart:
    """A part of a predicate with its value; the value is None if the evaluation raised `fault`.

    `operands`: both sides of a comparison; for a computed predicate the estimate and its `level`: 0
    outside S_0, 1 in S_0, 2 in S_(m-2).
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
    """The name of the AC whose last output the gate refused, and the kind of the fault."""

    node: str
    fault: str


@dataclass(frozen=True)
class DecisionReason:
    """The reason for the decision of a DM step.

    `ttf`, `safer`: the parts of these predicates, empty if not `known`. One true part makes `ttf`
    true; all parts must be true for `safer`. `owed`: how many clean outputs AC owed. `led`: the
    failed part of the tube around SC's runs, only for changes of mode (`change_records`).
    """

    known: bool
    ttf: tuple[PredicatePart, ...]
    safer: tuple[PredicatePart, ...]
    stale: tuple[Stale, ...]
    gate_fault: GateFault | None
    owed: int
    led: str = ""

    def words(self, before: str, after: str) -> list[str]:
        """The reasons in words, one phrase each; empty if AC simply stays in control."""
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
    """A topic that a DM step read, with value and age; None: it was never published."""

    topic: str
    type: Type
    value: Value
    age_ns: int | None


class Explainer:
    """Explains the DM steps of a system; it compiles the predicates of a module on first use."""

    def __init__(self, system: System, layout: StateLayout) -> None:
        self.system = system
        self.layout = layout
        self._readers: dict[int, _PredicateReader] = {}

    def explain(self, module: int, before: bytes | None, at: bytes) -> DecisionReason:
        """The reason for a module's DM step in the instant that ended in the state `at`.

        `before`: the state at the end of the previous instant, None at the first instant.
        """
        return self._reader(module).explain(before, at)

    def topics_read(self, module: int, before: bytes | None, at: bytes) -> tuple[TopicRead, ...]:
        """The topics that this DM step read; () under `order any`, which leaves them unknown."""
        return () if self.system.shuffled else self._reader(module).topics_read(before, at)

    def _reader(self, module: int) -> _PredicateReader:
        if module not in self._readers:
            self._readers[module] = _PredicateReader(
                self.system, self.layout, self.system.modules[module]
            )
        return self._readers[module]

    def safe_predicate(self, module: int) -> Callable[[bytes], bool] | None:
        """A function that says for a state whether `safe` holds there; a fault gives False.

        The result is None if `safe` calls an extern function.
        """
        reader = _PredicateReader(self.system, self.layout, self.system.modules[module])
        return reader.safe_predicate()


class _PredicateReader:
    """The compiled predicates of one module, and the topics that its DM reads."""

    def __init__(self, system: System, layout: StateLayout, module: Module) -> None:
        self.system, self.layout, self.module = system, layout, module
        self._evaluator = PredicateEvaluator.for_scope(module.scope)
        self._early = early_topics(system, module.dm)
        symbol = module.symbol
        self._level_known: int | None = None
        """The level that the facts of a step imply; None: the predicate has to compute it."""
        self._refused_known: bool | None = None
        """Whether the facts of a step imply that commands were refused; None: compute it."""
        evaluator = Evaluator.for_scope(module.scope)
        holds = evaluator.compiled(symbol.safe)
        self._safe = None if evaluator.unbound else holds
        self._ttf = [] if symbol.ttf is None else self._part_evaluators(disjuncts(symbol.ttf))
        self._safer = [] if symbol.safer is None else self._part_evaluators(conjuncts(symbol.safer))

    def explain(self, before: bytes | None, at: bytes) -> DecisionReason:
        """The reason for a step, as `Explainer.explain` describes it."""
        facts = self._module_record(at, self.module)
        env = self._environment(before, at)
        ttf: tuple[PredicatePart, ...] = ()
        safer: tuple[PredicatePart, ...] = ()
        if self.module.symbol.rest is not None:
            self._level_known = 2 if facts["safer"] else 0
            self._refused_known = bool(facts["ttf"])
        if not self._evaluator.unbound:  # only the run itself may call an extern function
            ttf = tuple(part(env) for part in self._ttf)
            safer = tuple(part(env) for part in self._safer)
        known = bool(facts["ttf"]) == _is_ttf_true(ttf) and bool(facts["safer"]) == _is_safer_true(
            safer
        )
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

    def safe_predicate(self) -> Callable[[bytes], bool] | None:
        """The function that `Explainer.safe_predicate` describes."""
        return None if self._safe is None else lambda at: self._is_safe(self._environment(at, at))

    def _is_safe(self, env: Environment) -> bool:
        """Whether `safe` is true without a fault; False if it calls an extern function."""
        try:
            return self._safe is not None and bool(self._safe(env))
        except StepFault:
            return False

    # ------------------------------------------------------------ what the step read

    def topics_read(self, before: bytes | None, at: bytes) -> tuple[TopicRead, ...]:
        """The topics that `Explainer.topics_read` describes."""
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

        def topic_value(i: int) -> Value:
            raw = at if i in self._early else before
            if raw is None:
                return topics[i].default
            return decode_from(raw, layout.topic_offset(i), topics[i].type)

        def topic_stamp_ns(i: int) -> int:
            raw = at if i in self._early else before
            if raw is None:
                return NEVER
            stamp_ns: int = struct.unpack_from("<q", raw, layout.stamp_offset + 8 * i)[0]
            return stamp_ns

        def module_mode(i: int) -> int:
            other = self.system.modules[i]
            raw = at if other.dm < self.module.dm else before
            if raw is None:
                return AC if other.forced == "ac" else 1 - AC
            return self._module_record(raw, other)["mode"]

        def module_margin_ns(i: int) -> int:
            looked = self.system.modules[i].looked
            assert looked is not None
            if module_mode(i) != AC:
                return 0
            looks = topic_value(looked)
            assert isinstance(looks, int)
            return self.system.modules[i].margin_ns(looks, ct - topic_stamp_ns(looked))

        return Environment(
            topics=_LazySequence(topic_value, len(topics)),
            stamps=_LazySequence(topic_stamp_ns, len(topics)),
            time_ns=ct,
            period_ns=self.module.period_ns,
            mode=module_mode,
            margin_ns=module_margin_ns,
        )

    def _module_record(self, raw: bytes, module: Module) -> dict[str, int]:
        return MODULE.unpack_from(raw, self.layout.module_offset + module.index * MODULE.size)

    def _gate_fault(self, before: bytes | None) -> GateFault | None:
        """The gate fault of the previous instant, which the DM saw because AC steps after it."""
        if before is None:
            return None
        at = self.layout.component_offset + self.module.ac * COMPONENT.size
        kind = COMPONENT.unpack_from(before, at)["last_fault"]
        name = self.system.components[self.module.ac].name
        return GateFault(name, FaultKind(kind).name.lower()) if kind else None

    # ------------------------------------------------------------ parts of predicates

    def _part_evaluators(self, parts: list[typed.TypedExpr]) -> list[PartEvaluator]:
        compile_part = self._computed_evaluator if self.module.computed else self._plain_evaluator
        return list(map(compile_part, parts))

    def _computed_evaluator(self, e: typed.TypedExpr) -> PartEvaluator:
        """The evaluator of a part of a computed predicate: of a level, or of judged commands."""
        if isinstance(e, typed.TypedUnary) and self.module.shield is None:
            return self._level_evaluator(e.operand, for_ttf=True)  # not `safer`
        if isinstance(e, typed.TypedBinary):
            return self._level_evaluator(e)
        return self._shield_evaluator(e)

    def _shield_evaluator(self, e: typed.TypedExpr) -> PartEvaluator:
        """The evaluator of `!permits`, whose operands are the inputs and the held command."""
        refused = self._evaluator.compiled(e)
        module, topics = self.module, self.system.topics
        named = [
            (leaf_name(topics[i].name, path), i, path)
            for i in (*module.inputs, *module.outputs)
            for path, _ in leaves(topics[i].type)
        ]

        def evaluated_part(env: Environment) -> PredicatePart:
            operands = tuple(
                Operand(n, _leaf_value(topics[i].type, env.topics[i], path)) for n, i, path in named
            )
            values = ", ".join(f"{o.text} = {_rounded(o.value)}" for o in operands)
            text = f"{values}: a command that may still act is not permitted"
            known = self._refused_known
            return PredicatePart(text, bool(refused(env)) if known is None else known, operands)

        return evaluated_part

    def _plain_evaluator(self, e: typed.TypedExpr) -> PartEvaluator:
        whole = self._evaluator.compiled(e)
        sides: list[tuple[typed.TypedExpr, Any]] = []
        if isinstance(e, typed.TypedBinary) and e.op in COMPARED:
            sides = [(s, self._evaluator.compiled(s)) for s in (e.left, e.right)]
        scalar = (FloatType, IntType, BoolType, EnumType)
        scalars = bool(sides) and all(isinstance(s.type, scalar) for s, _ in sides)
        plain = e.span.text_on_one_line

        def evaluated_part(env: Environment) -> PredicatePart:
            try:
                value = bool(whole(env))
                operands = [
                    Operand(s.span.text_on_one_line, _scalar(s, of(env)))
                    for s, of in sides
                    if scalars
                ]
            except StepFault as fault:
                return PredicatePart(plain, None, (), fault.kind.name.lower())
            if not operands:
                return PredicatePart(plain, value)
            assert isinstance(e, typed.TypedBinary)
            text = _comparison_text(operands[0], e.op, operands[1], sides[1][0])
            return PredicatePart(text, value, tuple(operands))

        return evaluated_part

    def _grid_end_note(self, leaf: typed.TypedExpr, x: Operand, env: Environment) -> str:
        """A note for an estimate near the end of the grid, if `safe` holds beyond; else ""."""
        low, high = self.module.grid_ends.get(x.text, (-math.inf, math.inf))
        for end, out in ((low, low - high), (high, high - low)):
            if (end - float(x.value)) / out < NEAR:
                beyond = copy(env)
                beyond.topics = self._topics_with_leaf(leaf, end + BEYOND * out, env.topics)
                return NEAR_AN_END.format(x.text, _rounded(end)) if self._is_safe(beyond) else ""
        return ""

    def _topics_with_leaf(
        self, leaf: typed.TypedExpr, x: float, topics: Sequence[Value]
    ) -> Sequence[Value]:
        """A copy of all topics in which the leaf that the expression reads has the value `x`."""
        where: list[Any] = []
        while not isinstance(leaf, typed.TopicRead):
            assert isinstance(leaf, (typed.TypedField, typed.Index))
            where, leaf = [getattr(leaf.index, "value", leaf.index), *where], leaf.target
        return value_with_number(topics[:], [self.module.scope.topics[leaf.topic], *where], x)

    def _level_evaluator(self, e: typed.TypedExpr, *, for_ttf: bool = False) -> PartEvaluator:
        """The evaluator of `level(x, ...) < 1` or `>= 2`, for the first of several plans."""
        e = disjuncts(e)[0]
        assert isinstance(e, typed.TypedBinary)
        assert isinstance(e.left, typed.TypedCall)
        level = self._evaluator.compiled(e.left)
        leaves_ = e.left.arguments
        arguments = [(leaf_path_name(a), self._evaluator.compiled(a)) for a in leaves_]
        below = 2 if for_ttf else 1
        for_ttf = for_ttf or e.op == "<"
        outside, inside = "outside S_0", "deep inside S_0"
        if self.module.symbol.rest is not None:
            outside, inside = "from where SC is not led to rest", "from where SC is led to rest"

        def evaluated_part(env: Environment) -> PredicatePart:
            estimate = [Operand(name, float(of(env))) for name, of in arguments]
            known_level = self._level_known
            level_value = int(level(env)) if known_level is None else known_level
            where = ", ".join(f"{o.text} = {_rounded(o.value)}" for o in estimate)
            value = level_value < below if for_ttf else level_value > 1
            text = f"{where} {outside if for_ttf else inside}"
            if for_ttf and value:
                text += "".join(map(self._grid_end_note, leaves_, estimate, repeat(env)))
            return PredicatePart(text, value, (*estimate, Operand("level", level_value)))

        return evaluated_part


# ---------------------------------------------------------------- reading two states


class _LazySequence(Sequence[T]):
    """A sequence that computes each value when it is read."""

    def __init__(self, of: Callable[[int], T], size: int) -> None:
        self._of = of
        self._size = size

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, i: Any) -> Any:  # noqa: ANN401 - an index, or a slice of them
        if isinstance(i, slice):
            return [self._of(k) for k in range(*i.indices(self._size))]
        return self._of(i)


def value_with_number(value: Sequence[Value], where: Sequence[int], x: float) -> Sequence[Value]:
    """A copy of a nested value in which the number at the path `where` is replaced by `x`."""
    first, *rest = where
    new = value_with_number(value[first], rest, x) if rest else x
    return (*value[:first], new, *value[first + 1 :])


def _leaf_value(t: Type, value: Any, path: Sequence[str]) -> Number:  # noqa: ANN401 - of a topic
    """The number in a topic's value at `path`, in the form that `leaves` gives."""
    for k in positions(t, path):
        value = value[k]
    number: Number = value
    return number


def early_topics(system: System, dm: int) -> frozenset[int]:
    """The topics, inputs included, that change only before a DM steps in the deployed order."""
    late = {i for c in system.components if c.index >= dm for i in c.writes}
    looks = {m.looked for m in system.modules if m.dm >= dm and m.looked is not None}
    judging = [m.shield for m in system.modules if m.shield is not None]
    shields = {s.topic for s in judging} | {s.proposed for s in judging if s.proposed is not None}
    return frozenset({t.index for t in system.topics} - late - looks - shields)


def _is_ttf_true(parts: tuple[PredicatePart, ...]) -> bool:
    """Whether `ttf` holds by its parts: one is true or faulted, or the parts are missing."""
    return next((True for p in parts if p.value or p.value is None), not parts)


def _is_safer_true(parts: tuple[PredicatePart, ...]) -> bool:
    return bool(parts) and all(p.value for p in parts)


# ---------------------------------------------------------------- words


def _scalar(e: typed.TypedExpr, value: Value) -> Number:
    if isinstance(e.type, EnumType):
        assert isinstance(value, int)
        return e.type.members[value]
    assert isinstance(value, (bool, int, float))
    return value


def _comparison_text(left: Operand, op: str, right: Operand, of: typed.TypedExpr) -> str:
    """A comparison with values, as `Room(m) = 0.11 < LIMIT = 0.0`; a literal appears once."""
    a, b = _rounded(left.value), _rounded(right.value)
    if a == b and left.value != right.value:
        a, b = repr(left.value), repr(right.value)
    side = right.text if isinstance(of, typed.Literal) and not of.name else f"{right.text} = {b}"
    return f"{left.text} = {a} {op} {side}"


def _rounded(value: Number) -> str:
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
