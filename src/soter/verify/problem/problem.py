"""The verification problem of one module, and what its proof takes for granted, as plain data.

Purpose: what `extract.py` reads off a program and everything else in this room works on
(docs/verification.md, section 1); `Quantities`: which leaf of a plant or topic each input of the
dynamics is, in order; `Modes`: whose modes the module reads. `Assumption`, and those that every
proof says alike; `remaining`: what is left of a problem's assumptions once a proof has shown some
of them and added others. Nothing is ever taken out of a list, and nothing by its wording.
`VerificationScope` and `ScopeGuarantee`, of which reports are made.
Non-goals: computing anything; finding the inputs (`inputs.py`), the assumptions (`assumptions.py`,
`induction/problem.py`), C (`verify/enclose/`), what a verification is about (`verify/scope.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Literal

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

    Read = tuple[str, typed.ModuleSymbol | str]
    Names = tuple[tuple[Read, typed.TopicSymbol], ...]


@dataclass(frozen=True)
class Leaf:
    """One scalar leaf: of a plant state or disturbance (`owner` = component) or of a topic.

    `member` is the state's or disturbance's name, "" for a topic; `path` the field path below.
    """

    owner: int
    member: str
    path: tuple[str, ...]
    name: str
    """Full name for people: `tube.q3.x`, `control.y`."""
    unit: str = ""
    """As it is declared."""


@dataclass(frozen=True)
class Quantities:
    """The inputs of the emitted functions, in order (docs/verification.md, section 1)."""

    states: tuple[Leaf, ...]
    controls: tuple[Leaf, ...]
    disturbances: tuple[Leaf, ...]
    errors: tuple[Leaf, ...]
    others: tuple[Leaf, ...]
    parameters: tuple[Leaf, ...]
    """Discrete plant states without dynamics: `param[]`, not forms."""
    turning: frozenset[int] = frozenset()
    """States of axes that wrap: they are read modulo a full turn (`problem/left_out_states.py`)."""

    @property
    def inputs(self) -> tuple[Leaf, ...]:
        """Everything that is a form, in order."""
        return self.states + self.controls + self.disturbances + self.errors + self.others


ProblemKind = Literal["flow", "map", "nodes", "tubes"]
FARTHEST: Final = 2.0**1000
"""A state whose axis has no ends is taken to lie within: a sum of two is a double."""
NODES: Final = "nodes"
"""`Problem.kind` where the state is what nodes publish and keep: no plant, no sets."""
TUBES: Final = "tubes"
"""`Problem.kind` where the DM follows SC from each estimate: a flow, and no sets."""


@dataclass(frozen=True)
class Interval:
    """A closed interval."""

    low: float
    high: float


@dataclass(frozen=True)
class Times:
    """Every time of a proof in ns, derived from `schedule`. `declared` names those that were."""

    schedule: Schedule
    horizon: int | None = None
    """H as declared; None: what is needed."""
    declared: frozenset[str] = frozenset()
    rests: tuple[str, ...] = ()
    """What these times rest on where execution times are declared, in words."""

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
        """A."""
        return self.schedule.age_dm

    @property
    def age_sc(self) -> int:
        """A_sc."""
        return self.schedule.age_sc

    @property
    def late_dm(self) -> int:
        """J_dm."""
        return self.schedule.dm.late

    @property
    def late_sc(self) -> int:
        """J_sc, without waiting for the DM."""
        return self.schedule.sc.late

    @property
    def response_dm(self) -> int:
        """R_dm."""
        return self.schedule.dm.response

    @property
    def response_sc(self) -> int:
        """R_sc."""
        return self.schedule.sc.response

    @property
    def acts(self) -> int:
        """L, nodes behind the module not included."""
        return max(o.most for o in self.schedule.outputs)

    @property
    def acts_least(self) -> int:
        """L_min, of the last part of the way: nodes are not included."""
        return min(o.least for o in self.schedule.outputs)

    @property
    def acted(self) -> int:
        """W, of a shield."""
        return self.schedule.acted

    @property
    def phase_dm(self) -> int:
        """Of the DM's first release."""
        return self.schedule.dm.phase

    @property
    def phase_sc(self) -> int:
        """Of SC's first release."""
        return self.schedule.sc.phase

    @property
    def h_star(self) -> int:
        """H*, or h_0 where that is longer and an "AC" verdict does not show that SC can read."""
        return self.schedule.needed

    @property
    def horizon_ns(self) -> int:
        """H."""
        return self.h_star if self.horizon is None else self.horizon

    @property
    def delay_sc(self) -> int:
        """d: how old the state is that a command answers."""
        return self.schedule.delay

    @property
    def jitter_sc(self) -> int:
        """j: the length of the window in which a command begins to act."""
        return self.schedule.jitter

    @property
    def lease_ns(self) -> int:
        """From a release of SC to the end of the lease that its step gives, at most."""
        return self.schedule.lease

    @property
    def decision(self) -> int:
        """Delta + A + J_dm: from a state to the DM's next look, at worst."""
        return self.schedule.look

    @property
    def start(self) -> int:
        """h_0: by then an output of SC has acted that answers a state."""
        return self.schedule.start


@dataclass(frozen=True)
class Axis:
    """One axis of a group's grid."""

    state: int
    """Index among the states."""
    name: str
    edges: tuple[float, ...]
    """Breakpoints, strictly increasing; n + 1 of them for n cells."""
    open: bool = False
    """Nothing is claimed of runs beyond the last breakpoint, and no run is taken to get there."""
    unbounded: bool = False
    """The first and the last cell have no outer end: what lies beyond belongs to them."""
    wraps: bool = False
    """It is a full turn, and nothing reads how many of them its state has made."""
    unit: str = ""
    """As the program declares it for the state, for people."""
    written: tuple[tuple[float, str], ...] = ()
    """Ends that the program writes, each with its text."""

    def end(self, value: float) -> str:
        """An end as the program writes it, where it does: six digits of PI are no full turn."""
        return dict(self.written).get(value, f"{value:.6g}")

    @property
    def reach(self) -> tuple[float, ...]:
        """Breakpoints, the outer ones as far out as their cells go."""
        if not self.unbounded:
            return self.edges
        return (-FARTHEST, *self.edges[1:-1], FARTHEST)


@dataclass(frozen=True)
class Group:
    """States that are analysed together."""

    axes: tuple[Axis, ...]
    representation: str = "grid"
    """"grid" or "polytope"."""
    span: Span | None = None


@dataclass(frozen=True)
class DiscreteParameter:
    """A discrete plant state without dynamics; proved for each of its values."""

    name: str
    values: tuple[int, ...]


@dataclass(frozen=True)
class Jumps:
    """What of an abstraction's state stands in topics, so that it may change at once.

    `told`: the assumptions. `entered`: keys of those that say that the state then lies in R(H) ->
    what is said of each where that is shown. `unkept`: that nobody was shown to keep to `enters`,
    also one of them; "": somebody was, or there is none.
    """

    told: tuple[Assumption, ...] = ()
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
    """The grid's extent for each state."""
    initial: tuple[Interval, ...]
    controls: tuple[Interval, ...]
    disturbances: tuple[Interval, ...]
    errors: tuple[Interval, ...]
    others: tuple[Interval, ...]
    parameters: tuple[DiscreteParameter, ...]
    groups: tuple[Group, ...]
    """In chain order: a group depends on itself and earlier ones."""
    times: Times
    declared_groups: tuple[Group, ...] = ()
    """The groups as the program has them, where smaller cells were chosen for it."""
    levels: int = LEVELS_DEFAULT
    levels_open: bool = False
    """The program leaves that number open: it is chosen (`verify/claims/choice.py`)."""
    cells_open: bool = True
    """Smaller cells than declared may be chosen there."""
    has_core_hint: bool = False
    computed: bool = False
    """The module has neither `ttf` nor `safer`: they are to be computed."""
    synthesize: bool = False
    """SC is to be found (`soter verify --synthesize`)."""
    topic_leaf_of_state: dict[int, tuple[int, int]] = field(default_factory=dict)
    """State -> (topic, leaf) that equals it, where there is one."""
    state_of_leaf: Mapping[tuple[int, int], int] = field(default_factory=dict)
    """(topic, leaf) -> the state that it equals, for every leaf that does."""
    assumptions: tuple[Assumption, ...] = ()
    """Before the proof: it may show some of them, and add others (`ModuleResult.assumptions`)."""
    name: str = ""
    """Full name of the module in its own system, for people; with the name of the view."""
    view: str = ""
    """Name of the view, if it is one."""
    beside: Mapping[str, str] = field(default_factory=dict)
    """Topics of SC that no plant drives -> the node that publishes them in every step."""
    whole: System | None = None
    """Of a view: the verification system with all of the module's predicates."""
    jumps: Jumps = field(default_factory=Jumps)
    modes: Modes | None = None
    """Whose modes the module reads; None: nobody else's."""
    influences: tuple[Influence, ...] = ()
    """What others publish and what moves the plants: the last disturbances of each plant."""
    turns_read: Mapping[str, str] = field(default_factory=dict)
    """Of axes that are a full turn and do not wrap around: their state -> who reads its turns."""
    above: str = ""
    """The module in whose place of AC this one stands: what is claimed is claimed while it is in
    AC; "" where there is none."""
    below: tuple[str, ...] = ()
    """The module that stands in the place of AC, the one in the place of its AC, and so on."""
    commands: tuple[tuple[float, ...], ...] = ()
    """For synthesis: the finite set of each control, in their order."""
    parameter_starts: tuple[tuple[int, ...], ...] = ()
    """First values of each parameter: the declared one, and that of the map of what flies."""
    still: frozenset[int] = frozenset()
    """States without dynamics: constants of a run."""
    schemes: tuple[tuple[float, int, int], ...] = ()
    """Of each state the step of its plant's scheme in s, the order of that, and the number of the
    plant (`enclose/scheme_error.py`). A step of 0: the scheme is not covered, which is an
    assumption."""
    recover_ns: int | None = None
    """T of P2b where it is declared: `recover within d;`."""
    stays: bool = False
    """`recover never;` or `returns never;`: P2b is not asked, SC may keep control for ever."""
    progress_texts: tuple[str, ...] = ()
    """What P2b takes for granted at all times, as it is written."""
    law: Problem | None = None
    """The same module with its fail-safe law in the place of SC; None: none is declared."""
    law_unread: str = ""
    """Why a declared law determines no such problem."""

    def starts_with(self, parameter: tuple[int, ...]) -> bool:
        """Whether a run may start with these values of the parameters."""
        pairs = zip(parameter, self.parameter_starts, strict=True)
        return all(value in starts for value, starts in pairs)

    @property
    def returning(self) -> str:
        """The predicate under which P2b gives control back: `safer` with all other modes in AC."""
        return "back" if self.modes is not None and self.modes.waits else "safer"

    @property
    def stronger(self) -> str:
        """What helps where some S_j is empty; of levels that are chosen there are no fewer."""
        fewer = "" if self.levels_open or self.levels <= LEVELS_LEAST else "fewer levels, "
        return f"{fewer}a smaller period, smaller errors, a stronger SC"

    def in_horizon(self, ns: int) -> int:
        """A time as proofs take it: a map's is a whole number of its periods."""
        if self.kind == "map":
            return -(-ns // self.plant_period_ns) * self.plant_period_ns
        return ns


@dataclass(frozen=True)
class Assumption:
    """`key`: what it is about, the same for the same thing in every proof; `text`: in words."""

    key: str
    text: str


SCHEME = Assumption(
    "scheme",
    "the plant is the only solution of its differential equation (where the right-hand side jumps: "
    "with any rate between those on both sides); not the simulator's scheme",
)
"""Of a proof that is about the differential equation alone."""
EVERY_SOLUTION = Assumption(
    SCHEME.key,
    "the plant is any absolutely continuous solution of its differential equation, with any rate "
    "between those on both sides where its right-hand side jumps; not the simulator's scheme",
)
"""Of such a proof that does not rest on solutions being unique, as where SC comes to rest."""
FRESH = Assumption("fresh", "P2b: what the DM reads is fresh, and no gate fault keeps AC out")


def of_latch(module: ModuleSymbol) -> list[Assumption]:
    """That the operator acknowledges, where only then the DM gives control back."""
    return [
        Assumption(
            f"acknowledged {topic.name}",
            f"P2b: the operator acknowledges: a press of {topic.name} is in force when `safer` "
            "holds; without one SC keeps control",
        )
        for topic in module.acknowledgements
    ]


def remaining(
    before: Iterable[Assumption], *, added: Iterable[Assumption], shown: Collection[str]
) -> tuple[Assumption, ...]:
    """The assumptions of a problem but for those whose keys were `shown`, and the `added` ones.

    KeyError where one was shown that nobody had made, or whose key several have: then it is not
    known which of them was meant.
    """
    before = tuple(dict.fromkeys(before))
    keys = [a.key for a in before]
    unclear = [key for key in shown if keys.count(key) != 1]
    if unclear:
        raise KeyError(", ".join(sorted(unclear)))
    return tuple(dict.fromkeys((*(a for a in before if a.key not in shown), *added)))


def texts(assumptions: Iterable[Assumption]) -> list[str]:
    """In words, each once."""
    return list(dict.fromkeys(a.text for a in assumptions))


@dataclass(frozen=True)
class ScopeGuarantee:
    """What a module takes for granted of somebody else, and why it may.

    `how`: "enforced" (the language lets no other value arrive), "declared" (a range of the world,
    printed as an assumption), "guaranteed" (a part of the `safe` of the module `by`, if that is
    proved), "published" (the proof of the module `by` is about the plant that drives it, if that is
    proved) or "assumed".
    """

    module: str
    what: str
    by: str
    how: str


@dataclass(frozen=True)
class VerificationScope:
    """`also`: modules of other systems that pose the same problem; `rest`: what is not covered."""

    also: tuple[str, ...] = ()
    rest: tuple[str, ...] = ()
    params: tuple[tuple[str, Value], ...] = ()
    """Every parameter of the program with the value that this is about."""
    guarantees: tuple[ScopeGuarantee, ...] = ()


@dataclass(frozen=True)
class Modes:
    """Whose modes a module reads.

    `topics`: what stands for a mode -> the name of its module; `margins`: what stands for a margin
    -> what is assumed of it; `waits`: whose modes `safer` reads; `never`: why nothing shows that
    all of these are in AC at some time; "": nothing speaks against.
    """

    topics: Mapping[typed.TopicSymbol, str] = field(default_factory=dict)
    margins: Mapping[typed.TopicSymbol, str] = field(default_factory=dict)
    waits: tuple[str, ...] = ()
    never: str = ""

    @property
    def assumptions(self) -> list[Assumption]:
        """What is not restricted, and what P2b rests on."""
        assumptions = [
            Assumption(f"mode {name}", f"mode({name}): SC or AC, anew at every read")
            for name in self.topics.values()
        ]
        assumptions += [Assumption(f"margin {t.name}", text) for t, text in self.margins.items()]
        if self.waits:
            text = (
                f"for P2b alone: {said(self.waits)} in AC; otherwise `safer` may not hold and SC "
                "keeps control"
            )
            assumptions.append(Assumption("waits", text))
        if self.never:
            text = f"for P2b nothing can be assumed: {self.never}"
            assumptions.append(Assumption("waits for ever", text))
        return assumptions


NO_MODES = Modes()


def said(names: tuple[str, ...]) -> str:
    """`A is`, or `A and B are`."""
    *most, last = names
    return f"{', '.join(most)} and {last} are" if most else f"{last} is"
