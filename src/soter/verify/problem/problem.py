"""The verification problem of one module, and the assumptions of its proof, as plain data.

Purpose: `extract.py` makes a `Problem` from a program, and all of `verify/` works on it
(docs/verification.md, section 1). `Quantities` says which leaf of a plant or topic each input of
the dynamics is, `Modes` whose modes the module reads. An `Assumption` that all proofs state alike
is a constant here; `assumptions_left` gives those that are left once a proof has shown some, by
their keys, and added others. `VerificationScope` and `ScopeGuarantee` say what a report covers.
Non-goals: computing anything; finding the inputs (`inputs.py`), the assumptions (`assumptions.py`,
`induction/problem.py`), C (`verify/enclose/`), what a verification is about (`verify/scope.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal

from soter.language.model.assumption_words import in_words
from soter.language.model.system import LEVELS_DEFAULT, LEVELS_LEAST

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from soter.core.core import CoreSystem
    from soter.diagnostics.diagnostic import Span
    from soter.language.elaborate.views_for_proofs import Influence
    from soter.language.model import typed
    from soter.language.model.system import Module, System
    from soter.language.model.typed import ModuleSymbol
    from soter.language.model.types import Value
    from soter.verify.problem.schedule import Schedule


@dataclass(frozen=True)
class Leaf:
    """A scalar part of a plant's state, of a disturbance or of a topic.

    `owner` is the number of the component or topic; `member` is the name of the state or
    disturbance, "" for a topic; `path` leads from the member to the scalar.
    """

    owner: int
    member: str
    path: tuple[str, ...]
    name: str
    """The full name, for people: `tube.q3.x`, `control.y`."""
    unit: str = ""
    """The unit as it is declared."""


@dataclass(frozen=True)
class Quantities:
    """The inputs of the emitted functions, in the order of docs/verification.md, section 1."""

    states: tuple[Leaf, ...]
    controls: tuple[Leaf, ...]
    disturbances: tuple[Leaf, ...]
    errors: tuple[Leaf, ...]
    others: tuple[Leaf, ...]
    parameters: tuple[Leaf, ...]
    """Discrete plant states that never change: exact values `param[]`, not forms."""
    turning: frozenset[int] = frozenset()
    """States whose axis wraps: they are read modulo a full turn (`axes.py`)."""

    @property
    def inputs(self) -> tuple[Leaf, ...]:
        """All inputs that the functions take as forms, in order."""
        return self.states + self.controls + self.disturbances + self.errors + self.others


ProblemKind = Literal["flow", "map", "nodes", "tubes"]
FARTHEST: Final = 2.0**1000
"""A proof assumes that a state whose axis has no ends stays below this: two sum to a double."""
NODES: Final = "nodes"
"""`Problem.kind` of a proof by induction, about topics and locals of nodes: no plants, no sets."""
TUBES: Final = "tubes"
"""`Problem.kind` of a proof by tubes, whose DM follows SC from each estimate: no sets."""


@dataclass(frozen=True)
class Interval:
    """A closed interval of numbers."""

    low: float
    high: float


@dataclass(frozen=True)
class Times:
    """Every time of a proof in ns, derived from `schedule` (docs/proof.md, "The model of time")."""

    schedule: Schedule
    horizon: int | None = None
    """The declared H; None if the program declares none, so that H is H*."""
    declared: frozenset[str] = frozenset()
    rests: tuple[str, ...] = ()
    """Assumptions behind these times where execution times are declared, in words."""

    @property
    def delta_dm(self) -> int:
        """Delta, the period of the DM."""
        return self.schedule.dm.period

    @property
    def delta_sc(self) -> int:
        """The period of SC."""
        return self.schedule.sc.period

    @property
    def age_dm(self) -> int:
        """A, the greatest age of the state that the DM reads when it decides for AC."""
        return self.schedule.age_dm

    @property
    def age_sc(self) -> int:
        """A_sc, the greatest age of the state that SC reads."""
        return self.schedule.age_sc

    @property
    def late_dm(self) -> int:
        """J_dm, the longest time from a release of the DM to its start."""
        return self.schedule.dm.late

    @property
    def late_sc(self) -> int:
        """J_sc, the longest time from a release of SC to its start, without waiting for the DM."""
        return self.schedule.sc.late

    @property
    def response_dm(self) -> int:
        """R_dm: the DM's response time, from its start."""
        return self.schedule.dm.response

    @property
    def response_sc(self) -> int:
        """R_sc: SC's response time, from its start."""
        return self.schedule.sc.response

    @property
    def acts(self) -> int:
        """L: the longest time from an output to its effect, nodes behind the module not counted."""
        return max(o.most for o in self.schedule.outputs)

    @property
    def acts_least(self) -> int:
        """L_min: the shortest time from an output to its effect; nodes behind it not counted."""
        return min(o.least for o in self.schedule.outputs)

    @property
    def replaced_window(self) -> int:
        """W, of a shield: a command that was replaced longer ago than this no longer acts."""
        return self.schedule.replaced_window

    @property
    def phase_dm(self) -> int:
        """The time of the DM's first release."""
        return self.schedule.dm.phase

    @property
    def phase_sc(self) -> int:
        """The time of SC's first release."""
        return self.schedule.sc.phase

    @property
    def h_star(self) -> int:
        """H*, the least H; or h_0 if it is longer and SC reads topics that the DM does not read."""
        return self.schedule.least_horizon

    @property
    def horizon_ns(self) -> int:
        """H, the look-ahead: the declared one, else the least one."""
        return self.h_star if self.horizon is None else self.horizon

    @property
    def delay_sc(self) -> int:
        """d: the greatest age of the state that a command answers when it begins to act."""
        return self.schedule.delay

    @property
    def jitter_sc(self) -> int:
        """j, the length of the time window in which a command begins to act."""
        return self.schedule.jitter

    @property
    def lease_ns(self) -> int:
        """The longest time from a release of SC to the end of the lease given by its step."""
        return self.schedule.lease

    @property
    def between_states(self) -> int:
        """Delta + A + J_dm, the longest time between two states that the DM reads in turn."""
        return self.schedule.longest_between_states

    @property
    def start(self) -> int:
        """h_0: the time by which a first command of SC acts that answers a state, not a default."""
        return self.schedule.start


@dataclass(frozen=True)
class Axis:
    """One axis of a group's grid."""

    state: int
    """The index of its state."""
    name: str
    edges: tuple[float, ...]
    """The breakpoints, strictly increasing; n + 1 of them for n cells."""
    open: bool = False
    """Whether no run is assumed to pass the last breakpoint, beyond which nothing is claimed."""
    unbounded: bool = False
    """Whether the outermost cells have no outer end, so that they hold all values beyond."""
    wraps: bool = False
    """Whether the axis is a full turn, and nothing reads how many turns its state has made."""
    unit: str = ""
    """The unit that the program declares for the state, for people."""
    written: tuple[tuple[float, str], ...] = ()
    """The ends that the program writes, each with its text."""

    def end_in_words(self, value: float) -> str:
        """The text of an end as in the program; otherwise the number with six digits."""
        return dict(self.written).get(value, f"{value:.6g}")

    @property
    def far_breakpoints(self) -> tuple[float, ...]:
        """The breakpoints; on an axis without ends the outermost are -`FARTHEST` and `FARTHEST`."""
        if not self.unbounded:
            return self.edges
        return (-FARTHEST, *self.edges[1:-1], FARTHEST)


@dataclass(frozen=True)
class Group:
    """A group of states that are analysed together on one grid."""

    axes: tuple[Axis, ...]
    span: Span | None = None


@dataclass(frozen=True)
class DiscreteParameter:
    """A discrete plant state that never changes; the proof is made for each of its values."""

    name: str
    values: tuple[int, ...]


@dataclass(frozen=True)
class Jumps:
    """The jumps of an abstraction's state when topics that the abstraction's map reads change.

    `assumptions` has the assumptions about jumps. `entered` has, by the key of each assumption that
    the state lies in R(H) after a jump, the text to show if this is shown. `unkept` says why
    `enters` shows nothing of the topics of some abstraction; "" if no abstraction is such.
    """

    assumptions: tuple[Assumption, ...] = ()
    entered: Mapping[str, str] = field(default_factory=dict)
    unkept: str = ""


@dataclass(eq=False, kw_only=True)
class Problem:
    """One module with its verification plants.

    `states`, `controls`, ... are the ranges of the inputs of `quantities`, in the same order.
    """

    system: System
    """The verification system: the module and its verification plants, nothing else."""
    core: CoreSystem
    module: Module
    quantities: Quantities
    kind: ProblemKind
    plant_period_ns: int
    states: tuple[Interval, ...]
    """The range of each state: its axis, or its topic's set."""
    initial: tuple[Interval, ...]
    controls: tuple[Interval, ...]
    disturbances: tuple[Interval, ...]
    errors: tuple[Interval, ...]
    others: tuple[Interval, ...]
    parameters: tuple[DiscreteParameter, ...]
    groups: tuple[Group, ...]
    """The groups as declared, then those of states that no line names."""
    times: Times
    declared_groups: tuple[Group, ...] = ()
    """The groups as the program has them, if smaller cells were chosen; else empty."""
    levels: int = LEVELS_DEFAULT
    levels_open: bool = False
    """Whether the program leaves the levels open, so `choose_cells_and_levels.py` chooses them."""
    cells_open: bool = True
    """Whether `choose_cells_and_levels.py` may choose smaller cells than declared."""
    has_core_hint: bool = False
    computed: bool = False
    """Whether the module has neither `ttf` nor `safer`, so that they are computed."""
    synthesize: bool = False
    """Whether SC is to be found (`soter verify --synthesize`)."""
    topic_leaf_of_state: dict[int, tuple[int, int]] = field(default_factory=dict)
    """The (topic, leaf) that equals a state, for every state that has one."""
    state_of_leaf: Mapping[tuple[int, int], int] = field(default_factory=dict)
    """The state that a (topic, leaf) equals, for every leaf that equals one."""
    assumptions: tuple[Assumption, ...] = ()
    """The assumptions before a proof, which may show some and add others (`ModuleResult`)."""
    name: str = ""
    """The module's full name in its own system, for people; with the name of the view."""
    view: str = ""
    """The name of the view, if it is one; else ""."""
    beside: Mapping[str, str] = field(default_factory=dict)
    """For each topic of SC that no plant drives, the node that publishes it in every step."""
    whole: System | None = None
    """For a view the verification system with all of the module's predicates; else None."""
    jumps: Jumps = field(default_factory=Jumps)
    modes: Modes | None = None
    """The modes of other modules that the module reads; None if it reads none."""
    influences: tuple[Influence, ...] = ()
    """The topics by which others move the plants: the last disturbances of each plant."""
    turns_read: Mapping[str, str] = field(default_factory=dict)
    """For each angle whose axis does not wrap, by its name, a function that reads its turns."""
    commands: tuple[tuple[float, ...], ...] = ()
    """For synthesis the commands to try of each control."""
    parameter_starts: tuple[tuple[int, ...], ...] = ()
    """The first values of each parameter: the declared one, and the one in runs that fly."""
    still: frozenset[int] = frozenset()
    """The states that never change: constants of a run."""
    schemes: tuple[tuple[float, int, int], ...] = ()
    """For each state the step of its plant's scheme in s, the scheme's order and the plant's number
    (`grid/scheme_error.py`). A step of 0: the scheme is not covered, which is an assumption."""
    recover_ns: int | None = None
    """The time T of P2b if it is declared: `recover within d;`."""
    stays: bool = False
    """Whether SC may keep control for ever (`recover never;`, `returns never;`): no P2b then."""
    progress_texts: tuple[str, ...] = ()
    """The texts of the conditions that P2b takes for granted at all times (`progress`)."""
    law: Problem | None = None
    """The same module with its fail-safe law in the place of SC; None if it declares none."""
    law_unread: str = ""
    """Why a declared law determines no such problem; "" where it does."""

    def may_start_with(self, parameter: tuple[int, ...]) -> bool:
        """Whether a run may start with this combination of parameter values."""
        pairs = zip(parameter, self.parameter_starts, strict=True)
        return all(value in starts for value, starts in pairs)

    @property
    def return_predicate(self) -> str:
        """The name of P2b's predicate: `back` if `safer` waits for other modes, else `safer`."""
        return "back" if self.modes is not None and self.modes.waits else "safer"

    @property
    def advice_where_empty(self) -> str:
        """Advice for an empty S_j; it names fewer levels only if the program declares more."""
        fewer = "" if self.levels_open or self.levels <= LEVELS_LEAST else "fewer levels, "
        return f"{fewer}a smaller period, smaller errors, a stronger SC"

    @property
    def lead_ns(self) -> int:
        """The time in ns after H for which a command must be harmless to be a moved command.

        The command is not replaced until AC's next step, may act for some time after that, and
        answers an estimate of some age. No claim depends on this time.
        """
        period: int = self.system.components[self.module.ac].period_ns
        times = self.times
        return period + (0 if self.kind == "map" else times.replaced_window + times.age_dm)

    def whole_periods(self, ns: int) -> int:
        """Rounds a time in ns up to whole periods of a map; a flow keeps it as it is."""
        if self.kind == "map":
            return -(-ns // self.plant_period_ns) * self.plant_period_ns
        return ns


@dataclass(frozen=True)
class Assumption:
    """One assumption: `text`, and a `key` that is the same in every proof with this assumption."""

    key: str
    text: str


NS = 1e-9
ORDER = 4
"""Schemes of a higher order are not covered (`grid/scheme_error.py`)."""
SCHEME = Assumption("scheme", in_words("scheme"))
"""The assumption of a proof that is about the differential equation alone."""
EVERY_SOLUTION = Assumption(SCHEME.key, in_words("every solution"))
"""The same for a proof that does not need solutions to be unique, as where SC comes to rest."""
FRESH = Assumption("fresh", in_words("fresh"))


def latch_assumptions(module: ModuleSymbol) -> list[Assumption]:
    """The assumptions that the operator acknowledges, if the DM waits for that to give control."""
    return [
        Assumption(f"acknowledged {topic.name}", in_words("acknowledged", topic.name))
        for topic in module.acknowledgements
    ]


def assumptions_left(
    before: Iterable[Assumption], *, added: Iterable[Assumption], shown: Collection[str]
) -> tuple[Assumption, ...]:
    """The assumptions `before` without those whose keys are in `shown`, then those in `added`.

    Raises `KeyError` if a key in `shown` belongs to no assumption or to several.
    """
    before = tuple(dict.fromkeys(before))
    keys = [a.key for a in before]
    unclear = [key for key in shown if keys.count(key) != 1]
    if unclear:
        raise KeyError(", ".join(sorted(unclear)))
    return tuple(dict.fromkeys((*(a for a in before if a.key not in shown), *added)))


def assumption_texts(assumptions: Iterable[Assumption]) -> list[str]:
    """The texts of the assumptions, without repetitions."""
    return list(dict.fromkeys(a.text for a in assumptions))


@dataclass(frozen=True)
class ScopeGuarantee:
    """A fact `what` on which a module relies, and which `by`, outside of the module, must keep.

    `how` says why it holds: "enforced" (the language lets no other value arrive), "declared" (a
    range of the world, printed as an assumption), "guaranteed" (a part of the `safe` of the module
    `by`, if that is proved), "published" (the proof of the module `by` is about the plant that
    drives the topic, if that is proved) or "assumed".
    """

    module: str
    what: str
    by: str
    how: str


@dataclass(frozen=True)
class VerificationScope:
    """The scope of a report. `also`: further modules with the same problem; `rest`: uncovered."""

    also: tuple[str, ...] = ()
    rest: tuple[str, ...] = ()
    params: tuple[tuple[str, Value], ...] = ()
    """Every parameter of the program with the value that the report holds for."""
    guarantees: tuple[ScopeGuarantee, ...] = ()


@dataclass(frozen=True)
class Modes:
    """The modes and margins of other modules that a module reads.

    `topics` has the module's name by each topic that stands for a mode; `margins` has an assumption
    by each topic that stands for a margin. `waits` has the modules whose modes `safer` reads;
    `never` says why these may never all be in AC, or "".
    """

    topics: Mapping[typed.TopicSymbol, str] = field(default_factory=dict)
    margins: Mapping[typed.TopicSymbol, str] = field(default_factory=dict)
    waits: tuple[str, ...] = ()
    never: str = ""

    @property
    def assumptions(self) -> list[Assumption]:
        """The assumptions about these modes and margins, and those that P2b needs."""
        assumptions = [
            Assumption(f"mode {name}", f"mode({name}): SC or AC, anew at every read")
            for name in self.topics.values()
        ]
        assumptions += [Assumption(f"margin {t.name}", text) for t, text in self.margins.items()]
        if self.waits:
            text = (
                f"for P2b alone: {subjects_in_words(self.waits)} in AC; otherwise `safer` may not "
                "hold and SC keeps control"
            )
            assumptions.append(Assumption("waits", text))
        if self.never:
            text = f"for P2b nothing can be assumed: {self.never}"
            assumptions.append(Assumption("waits for ever", text))
        return assumptions


NO_MODES = Modes()


def subjects_in_words(names: tuple[str, ...]) -> str:
    """The subject of a sentence with its verb: `A is`, or `A, B and C are`."""
    *most, last = names
    return f"{', '.join(most)} and {last} are" if most else f"{last} is"
