"""What a decision module should find in a state, for its check.

Purpose: `ttf` and `safer` by the reference interpreter, and states that hold given values.
Non-goals: trying it (`dm_check.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core.layout import encode_into, size_of
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.predicates.decision_predicates import PredicateEvaluator
from soter.language.evaluate.predicates.numbers_in_predicates import maybe_nan
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import AgeRead
from soter.verify.deploy.dm_test_inputs import SC

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.codegen.unit import Unit
    from soter.language.model.system import Module, System
    from soter.language.model.types import Value

NOW_NS = 10**15


class ExpectedFacts:
    """What the reference interpreter says about a module's predicates."""

    def __init__(self, system: System, module: Module) -> None:
        self.system = system
        evaluator = PredicateEvaluator.of(module.scope, {})
        symbol = module.symbol
        evaluator.looked_at = maybe_nan(system, module)  # topics are NaN here, which none ever is
        self._ttf = None if symbol.ttf is None else evaluator.expression(symbol.ttf)
        self._safer = None if symbol.safer is None else evaluator.expression(symbol.safer)
        self.period_ns = module.period_ns
        self.reads_ages = any(isinstance(n, AgeRead) for n in nodes([symbol.ttf, symbol.safer]))
        self._image = bytearray()
        """A state with all topics at their defaults."""

    def truths(self, topics: tuple[Value, ...], ages: Mapping[int, int]) -> tuple[bool, bool]:
        """(ttf, safer); unknown is unsafe. `ages`: of topics that are not of now, in ns."""
        env = Environment(
            topics=topics,
            stamps=tuple(NOW_NS - ages.get(i, 0) for i in range(len(topics))),
            time_ns=NOW_NS,
            period_ns=self.period_ns,
            in_control=True,
            mode=lambda _: SC,
            truth=lambda _: (),
        )
        truths = []
        for predicate, unknown in ((self._ttf, True), (self._safer, False)):
            try:
                truths.append(unknown if predicate is None else bool(predicate(env)))
            except StepFault:
                truths.append(unknown)
        return truths[0], truths[1]

    def state(self, unit: Unit, topics: tuple[Value, ...]) -> bytearray:
        """A state that holds these values."""
        defaults = [t.default for t in self.system.topics]
        self._image = self._image or _with(bytearray(unit.layout.size), unit, defaults)
        new = (None if v is d else v for v, d in zip(topics, defaults, strict=True))
        return _with(bytearray(self._image), unit, tuple(new))


def _with(out: bytearray, unit: Unit, topics: Sequence[Value | None]) -> bytearray:
    """A state in which these topics are new; None: as it was."""
    for at, m in (
        (g.offset, m) for g in unit.layout.groups if g.owner < 0 for m in g.struct.members
    ):
        if (value := topics[m.index]) is not None:
            out[at + m.offset : at + m.offset + size_of(m.type)] = bytes(size_of(m.type))
            encode_into(out, at + m.offset, m.type, value)
    return out
