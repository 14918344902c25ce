"""The problem of one module in one record, and small questions about it.

Purpose: `Facts` is what nearly every file of the re-checker asks: inputs with their ranges, axes,
times, the plants, SC and the systems they are in.
Non-goals: reading them off the program (`problem.py`, `module_times.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any, Literal

from soter.certificate.extras import extras
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.language.evaluate.statements import Evaluator
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.typed import AgeRead, ModeRead
from soter.language.model.types import leaf_name, leaves

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.certificate.reading.derived_times import DerivedTimes, TimingSetting, Ways
    from soter.certificate.reading.symbolic_reading import Ranges
    from soter.language.model import typed
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type

InputKind = Literal["state", "control", "disturbance", "error", "other"]


class DiffersError(RejectedError):
    """The certificate differs from the program."""


@dataclass(frozen=True)
class Input:
    """One scalar input. `owner` is a component for states and disturbances, otherwise a topic."""

    kind: InputKind
    name: str
    owner: int
    leaf: int
    low: float
    high: float
    variable: str = ""
    of_others: bool = False
    """Of a disturbance: that somebody else publishes it, and a plant of the proof reads it."""
    unit: str = ""
    """The unit of its declared type."""


@dataclass(frozen=True)
class StateParameter:
    """A discrete plant state without dynamics."""

    name: str
    owner: int
    variable: str
    leaf: int
    values: tuple[int, ...]
    begins: tuple[int, ...]
    """The values with which a run may start."""


@dataclass(eq=False)
class Facts:
    """The facts about a module in the program; a state has the range of its initial values."""

    system: System
    module: Module
    sc: Component
    plants: tuple[Component, ...]
    kind: Literal["flow", "map"]
    flying: System
    """The system that runs, and the module in it; `system` is another one for an abstraction."""
    flying_module: Module
    ways: Ways = field(init=False)
    setting: TimingSetting = field(init=False)
    derived: DerivedTimes = field(init=False)
    """The times that the re-checker derives; `times` may have longer ones of the manifest."""
    states: list[Input] = field(default_factory=list)
    controls: list[Input] = field(default_factory=list)
    disturbances: list[Input] = field(default_factory=list)
    errors: list[Input] = field(default_factory=list)
    others: list[Input] = field(default_factory=list)
    parameters: list[StateParameter] = field(default_factory=list)
    axes: dict[int, tuple[float, float]] = field(default_factory=dict)
    """State -> its declared extent."""
    extents: tuple[tuple[float, float], ...] = ()
    """State by state the ends of its grid in the certificate; those of `axes` where declared."""
    open_ends: set[int] = field(default_factory=set)
    """States with an open upper end: nothing is claimed above it, where no run is taken to get."""
    unbounded: set[int] = field(default_factory=set)
    """States whose axis has no ends: what lies beyond belongs to its outer cells."""
    turning: set[int] = field(default_factory=set)
    """States whose axis is a full turn that wraps around (`left_out_states.py`)."""
    left_out: list[Input] = field(default_factory=list)
    """States of which a certificate has no sets, as nothing that is asked depends on them."""
    view: str = ""
    """The view that this problem is of, "" without views; `whole`: the module with all views."""
    whole: typed.ModuleSymbol | None = None
    leaves: dict[int, tuple[int, tuple[str, ...]]] = field(default_factory=dict)
    """State -> the topic leaf that is declared as its axis."""
    times: dict[str, int] = field(default_factory=dict)
    """The times that every claim is held to, by manifest name: never less than `derived`."""
    thread: str = ""
    """The assumption on the thread that keeps them; "" where no execution times are declared."""
    at_rest: bool = False
    """Whether a certificate has cells at rest: then a rate may jump, and no claim may rest on
    solutions being unique."""
    levels: int = 3
    in_sets: tuple[int, ...] = ()
    """The topics of which it was shown that all that is published of a state that SC keeps lies in
    their sets; none before P2a is shown."""
    local_ranges: Ranges = field(default_factory=dict)
    """In which ranges the floats of SC's locals stay, as a certificate says."""
    running: dict[int, int] = field(default_factory=dict)
    """Topic of the module -> the same in the system that runs."""

    @property
    def delay_ns(self) -> int:
        """d: the greatest age of the state behind a command, when the command acts."""
        return self.times["d_ns"]

    @property
    def jitter_ns(self) -> int:
        """j, the length of the window in which SC's output acts, equal after each release."""
        return self.times["j_ns"]

    @property
    def has_late_commands(self) -> bool:
        """Whether commands may act so late that several outputs are on their way at once."""
        return 2 * self.jitter_ns > self.times["delta_ns"]

    @property
    def start_ns(self) -> int:
        """The time in ns up to which any command may act, as SC has answered no state before."""
        return max(self.times["h0_ns"], self.derived.start)

    @property
    def verdict_delay_ns(self) -> int:
        """The longest time in ns from a state until a verdict on it or a later state is in force.

        A read is at most A old, so from A after the state on, every DM sees it. The next DM is due
        within Delta, starts late and answers late.
        """
        t = self.times
        return t["A_ns"] + t["Delta_ns"] + t["J_dm_ns"] + t["R_dm_ns"]

    @property
    def ns_between_verdicts(self) -> int:
        """The longest time in ns between the states behind two successive verdicts."""
        return self.times["A_ns"] + self.times["Delta_ns"] + self.times["J_dm_ns"]

    @property
    def symbol(self) -> typed.ModuleSymbol:
        """The declaration of the module."""
        return self.module.symbol

    @property
    def is_computed(self) -> bool:
        """Whether the program leaves `ttf` and `safer` to the prover."""
        return self.symbol.ttf is None and self.symbol.safer is None

    @property
    def ttf(self) -> typed.TypedExpr | None:
        """`ttf` without the parts that read an age, as no state decides these."""
        ttf = self.symbol.ttf
        return (
            ttf if ttf is None or not has_kind(AgeRead, [ttf]) else extras.views.without_ages(ttf)
        )

    @property
    def reads_any_mode(self) -> bool:
        """Whether SC or a predicate reads the mode of a module."""
        code = () if self.sc.node is None else self.sc.node.step
        return reads_mode([*code, *self.symbol.predicates])

    @property
    def controllers(self) -> list[Component]:
        """The controllers of the module: AC and SC, which alone may publish its outputs."""
        index = self.flying_module.index
        return [c for c in self.flying.components if c.module == index and c.role in ("ac", "sc")]

    def topics_read_by_dm(self, ttf: typed.TypedExpr | None) -> list[typed.TopicSymbol]:
        """The topics that `safer` and this form of `ttf` read; a computed predicate adds none."""
        return list(topic_reads(*(p for p in (ttf, self.symbol.safer) if p is not None)))

    def parameter_combinations(self) -> Iterator[tuple[int, ...]]:
        """Every combination of parameter values."""
        return product(*(p.values for p in self.parameters))


def driven_topics(facts: Facts) -> dict[int, tuple[Component, typed.TypedExpr]]:
    """Maps each driven topic to the plant that drives it and the expression it publishes."""
    return {
        c.scope.topics[topic]: (c, expr)
        for c in facts.plants
        if c.plant is not None
        for topic, expr in c.plant.drives
    }


def topics_read(facts: Facts) -> tuple[list[int], list[int]]:
    """The driven topics that the DM reads, and the driven topics that SC reads."""
    driven = driven_topics(facts)
    by_dm = [facts.module.scope.topics[t] for t in facts.topics_read_by_dm(facts.symbol.ttf)]
    by_sc = [facts.sc.scope.topics[t] for t in topics_read_by_sc(facts.sc)]
    if facts.symbol.rest is not None:  # what is computed of it reads what the module reads
        by_dm = [*facts.module.scope.topics.values(), *by_sc]
    elif facts.is_computed:  # computed predicates read what carries the axes
        by_dm = [topic for topic, _ in facts.leaves.values()] or list(driven)
    return [list(dict.fromkeys(i for i in of if i in driven)) for of in (by_dm, by_sc)]  # type: ignore[return-value]


def bounded_topics(facts: Facts) -> list[int]:
    """The driven topics with a declared set; a plant stops before it publishes outside the set.

    All topics of an abstraction are included: once stopped, it tells nothing about the vehicle.
    """
    return [
        index
        for index in driven_topics(facts)
        if any(b is not None for b in facts.system.topics[index].bounds)
    ]


def named_leaves(name: str, of: Type) -> Iterator[tuple[int, str, Type]]:
    """Yields number, name and type of each leaf of a value called `name`."""
    for k, (path, leaf) in enumerate(leaves(of)):
        yield k, leaf_name(name, path), leaf


def has_kind(kind: type, code: Iterable[object]) -> bool:
    """Whether a piece of code contains an expression of the type `kind`."""
    return any(isinstance(node, kind) for node in nodes(code))


def reads_mode(code: Iterable[object]) -> bool:
    """Whether a piece of code reads the mode of a module."""
    return has_kind(ModeRead, code)


def topics_of_others(c: Component, module: Module) -> list[typed.TopicSymbol]:
    """The topics that move a plant and are no outputs of the module, in the order of its reads."""
    assert c.plant is not None
    moves = [*(e for _, e in c.plant.lets), *c.plant.der.values(), *c.plant.next.values()]
    mentioned = topic_reads(*moves)
    outputs = set(module.outputs)
    return [t for t in c.plant.reads if t in mentioned and c.scope.topics[t] not in outputs]


def topics_read_by_sc(sc: Component) -> list[typed.TopicSymbol]:
    """The topics that SC reads, also in `on takeover`; NotRecheckedError if SC is extern."""
    if sc.node is None or sc.node.extern:
        raise NotRecheckedError("SC is not Soter source: nothing is known about its commands")
    return list(topic_reads(*(sc.node.takeover or ()), *sc.node.step))


def const_value(facts: Facts, expr: typed.TypedExpr | None) -> Any:  # noqa: ANN401  a Soter value
    """The value of a constant expression of the module; 0 for None."""
    return 0 if expr is None else Evaluator(facts.module.scope.params).value(expr)
