"""What a verification found, as plain data.

Purpose: verdicts per property with how they were reached; the sets of every case and group, as
certificates, monitors, computed predicates and reports take them.
Non-goals: computing or printing anything.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from soter.verify.problem.problem import SCHEME, VerificationScope, remaining

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from soter.report.proof_page import RegionFigure
    from soter.verify.polytope.extract_group import ExtractedGroup
    from soter.verify.polytope.half_spaces import Polytope
    from soter.verify.polytope.proofs import PolytopeSets
    from soter.verify.problem.problem import Assumption, Group, Problem

PROVED, REFUTED, UNDECIDED, ASSUMED = "proved", "refuted", "undecided", "assumed"
WORSE = (PROVED, ASSUMED, UNDECIDED, REFUTED)
"""Each is worse than those before it."""
NO_CORE = "there is no K"
"""What every claim that rests on K says where there is none: P2a says why."""
PROPERTIES = ("P1a", "P1b", "P1c", "P2a", "P2b", "P3", "ttf", "safer", "start", "failsafe", "DM")
"""In this order everywhere; `start` is that the declared initial states are among those proved,
`failsafe` that the fail-safe law keeps C once the lease has ended (`product_sets.py`),
`DM` that the generated C of the decision module is the switching logic (`dm_check.py`)."""
STAYS = "not asked: `{}`, SC may keep control for ever"
"""With the clause that says so."""
REGIONS_SHOWN = 3
"""Of a finding, for people."""
UNCLAIMED = ("DM",)
"""What no certificate claims: that is about C."""


@dataclass(frozen=True)
class Region:
    """A box of true states where a claim could not be shown: names of states and their ranges."""

    axes: tuple[tuple[str, float, float], ...]
    parameters: tuple[tuple[str, int], ...] = ()

    def __str__(self) -> str:
        parts = [f"{name} = {value}" for name, value in self.parameters]
        parts += [f"{name} in [{low:.6g}, {high:.6g}]" for name, low, high in self.axes]
        return ", ".join(parts)

    @property
    def ranges(self) -> dict[str, list[float]]:
        """Both ends by name."""
        return {name: [low, high] for name, low, high in self.axes}


@dataclass(frozen=True)
class Vacuity:
    """That a proof says little: AC never, or hardly ever, has control (`vacuity.py`).

    `how_often`: "not shown" where nothing says that it ever has; `what`: of `ttf`, `safer`, `safe`,
    `core` (K itself) or "above" (the module above); `share`: of K, of C for `core`; `parameters`:
    of the worst case where there are several.
    """

    how_often: str
    what: str
    share: float
    text: str
    parameters: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True)
class Cause:
    """Why a claim could not be shown, as runs show it (`open_claims.py`).

    `kind`: for machines (docs/json.md); `text`: what was measured, one sentence; `hint`: what
    would help; `numbers`: the measurement.
    """

    kind: str
    text: str
    hint: str = ""
    numbers: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class LeavingRun:
    """A run of the *model* under SC alone that leaves C; no run of the program.

    `states` has a row for each of `time_s`, in the order of `names`; `safe` says that it left C
    inside the grid, otherwise it left the grid by the end `side` (-1 low, 1 high) of `axis`.
    """

    names: tuple[str, ...]
    time_s: NDArray[np.float64]
    states: NDArray[np.float64]
    axis: str
    side: int
    safe: bool
    start: str
    """Whose start it is: `the declared start`, `the middle of C`, `inside C`."""
    chosen: tuple[str, ...]
    """What the adversary did, for people."""
    parameter: tuple[int, ...] = ()
    """Of the case."""

    def __str__(self) -> str:
        """One line."""
        first = ", ".join(f"{n} = {x:.6g}" for n, x in zip(self.names, self.states[0], strict=True))
        last = self.states[-1][self.names.index(self.axis)]
        where = "leaves `safe`" if self.safe else "leaves the grid"
        by = f" with {', '.join(self.chosen)}" if self.chosen else ""
        return (
            f"from {self.start} ({first}) SC's run of the model {where} at {self.axis} = {last:.6g}"
            f" after {self.time_s[-1]:.4g} s{by}"
        )


@dataclass(frozen=True)
class FlownFigures:
    """What a run says of a module. `ac_share`: of the time; `table_bytes`: 0 without tables."""

    takeovers_per_min: float
    ac_share: float
    table_bytes: int

    def __str__(self) -> str:
        """A clause."""
        tables = f", {self.table_bytes:,} bytes of tables" if self.table_bytes else ""
        return f"{self.takeovers_per_min:.4g} takeovers a minute, AC {self.ac_share:.1%}{tables}"


@dataclass(frozen=True)
class RemedyCost:
    """What changes that prove a module cost, in runs of `system` with seed 1 (`tried_remedies.py`).

    `before`: None where the program as it stands has no tables to fly. `not_measured`: why there
    are no figures at all, "" where there are.
    """

    system: str
    until_s: float = 0.0
    before: FlownFigures | None = None
    after: FlownFigures | None = None
    not_measured: str = ""

    def __str__(self) -> str:
        """One line."""
        if self.not_measured:
            return f"not measured: {self.not_measured}"
        run = f"{self.until_s:g} s of {self.system} simulated, seed 1"
        return f"{run}: before {self.before or 'nothing can fly'}; with it {self.after}"


@dataclass
class Finding:
    """The verdict on one property.

    `method`: how; `text`: what was found, one sentence; `hint`: what would help where undecided;
    `counterexample`: the run of a refutation (`verify/counterexample.py`); `causes`,
    `leaving`: what was measured where it is undecided.
    """

    verdict: str
    """The worst of what it rests on: `rest_on` makes it worse, and nothing makes it better."""
    seconds: float = 0.0
    method: str = ""
    text: str = ""
    hint: str = ""
    regions: list[Region] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    counterexample: object | None = None
    causes: list[Cause] = field(default_factory=list)
    leaving: LeavingRun | None = None
    tried: list[str] = field(default_factory=list)
    """What of the remedies was verified, and what came of it (`tried_remedies.py`)."""
    remedied: Problem | None = None
    """Where every claim is proved with what was tried: that problem."""
    cost: RemedyCost | None = None
    """What that costs; None where nothing that was tried proves every claim."""
    saved: Path | None = None
    """The file of the counterexample."""

    def __setattr__(self, name: str, value: object) -> None:
        if name == "verdict" and hasattr(self, "verdict"):
            raise AttributeError("a verdict is made once: `rest_on` says what else it rests on")
        super().__setattr__(name, value)

    def rest_on(self, verdict: str, text: str = "", hint: str = "") -> None:
        """It rests on this, too: the verdict is the worse of both.

        `text` and `hint` say why where that makes it worse, or as bad as it is.
        """
        if WORSE.index(verdict) < WORSE.index(self.verdict):
            return
        self.__dict__["verdict"] = verdict
        if text:
            self.text, self.hint = text, hint

    @property
    def holds(self) -> bool:
        """Whether it may be relied on."""
        return self.verdict in (PROVED, ASSUMED)


@dataclass(eq=False)
class GroupSets:
    """The sets of one group under one combination of parameter values.

    Arrays have one entry a cell, in C order over the group's axes: `allowed` C_g, `core` the
    witnesses of K (0: not in K, otherwise N), `free` R(H); `home` those of Q, `rank` (0: not in W)
    and `rank_holds` of W, on other cells where these are `finer` (size in words, axes).
    """

    group: Group
    allowed: NDArray[np.bool_]
    core: NDArray[np.uint8]
    free: NDArray[np.bool_] | None = None
    possible: NDArray[np.bool_] | None = None
    """Cells on which `safe` may be true."""
    lets_ac: NDArray[np.bool_] | None = None
    """Cells on which `ttf` may be false."""
    gives_back: NDArray[np.bool_] | None = None
    """Cells on which `safer` may be true."""
    target: NDArray[np.bool_] | None = None
    """States all of whose estimates satisfy `safer`: what Q was looked for in."""
    home: NDArray[np.uint8] | None = None
    rank: NDArray[np.uint16] | None = None
    rank_holds: NDArray[np.uint8] | None = None
    finer: tuple[str, Group] | None = None
    return_ns: int = 0
    """The longest time from W to Q."""
    levels: list[NDArray[np.bool_]] = field(default_factory=list)
    """S_0, S_1, ... on estimates, where predicates are computed."""
    tops: NDArray[np.uint8] | None = None
    """Where the module has a shield, (cells..., command cells): of the least command cell that may
    act the number of cells up to the greatest that may; 0: none."""
    lasting: NDArray[np.uint8] | None = None
    """Of a shield `toward sc`, of the same shape: 1 where commands of a cell may act longer."""
    command: int | None = None
    """The control that moves the group, where a shield asks."""
    deployed: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None
    """(S_0, S_(m-2)) as the DM holds them: what is in those of every case. None: no table."""
    solver: object | None = None
    """The engine's group (`verify/grid/sets.py`), for whoever computes more."""

    @property
    def edges(self) -> tuple[tuple[float, ...], ...]:
        """Breakpoints per axis."""
        return tuple(a.edges for a in self.group.axes)


@dataclass(eq=False)
class PolytopePart:
    """A polytope group under one combination of parameter values.

    `limits`: C_g, a box over the group's own states; `multipliers`: of what was proved, by part of
    the proof; `shares`: sampled, for people.
    """

    group: Group
    limits: list[tuple[float, float]] = field(default_factory=list)
    model: ExtractedGroup | None = None
    sets: PolytopeSets | None = None
    multipliers: dict[str, list[NDArray[np.float64]]] = field(default_factory=dict)
    shares: dict[str, float] = field(default_factory=dict)
    boxes: dict[str, int] = field(default_factory=dict)
    """Boxes that were looked at for an inclusion, by predicate."""
    deployed: tuple[Polytope, Polytope] | None = None
    """(S_0, S_(m-2)) as the DM holds them, up to rounding: as for grids."""
    return_ns: int = 0


class GroupResult(ABC):
    """One group under one combination of parameter values, as results are read.

    `found`: its sets, in a class of the method that proves it.
    """

    group: Group
    found: object
    mark = ""
    """Of its files in a certificate: no two methods have the same."""

    @property
    def cells(self) -> int:
        """Of its grid, where it has one."""
        return 0

    @property
    @abstractmethod
    def pair(self) -> object | None:
        """(S_0, S_(m-2)) of computed predicates, as the method's tables take them; None: none."""

    @abstractmethod
    def entry(self, problem: Problem, stem: str, files: dict[str, bytes]) -> dict[str, object]:
        """The group in a certificate; what it names is put into `files`."""

    @abstractmethod
    def figures(self, note: str) -> list[RegionFigure]:
        """Its regions, for the report."""


@dataclass(eq=False)
class CaseSets:
    """All groups under one combination of parameter values."""

    parameter: tuple[int, ...]
    proofs: Sequence[GroupResult]

    @property
    def groups(self) -> list[GroupSets]:
        """The sets of the grids."""
        return [p.found for p in self.proofs if isinstance(p.found, GroupSets)]

    @property
    def polytopes(self) -> list[PolytopePart]:
        """The sets of the polytopes."""
        return [p.found for p in self.proofs if isinstance(p.found, PolytopePart)]


@dataclass(eq=False, repr=False)
class ModuleResult:
    """Everything that was found about a module."""

    problem: Problem
    findings: dict[str, Finding]
    cases: list[CaseSets]
    laws: list[CaseSets] = field(default_factory=list)
    """The sets of the fail-safe law, case by case; empty: it is not proved."""
    seconds: float = 0.0
    shares: dict[str, float] = field(default_factory=dict)
    """Shares of the grid box's volume: `core`, `free`, `lets_ac`, `gives_back` of states and, where
    predicates are computed, `estimates` (S_0); the least over the parameters."""
    recover_s: float | None = None
    """The T that P2b was proved with, in s."""
    vacuity: Vacuity | None = None
    """That the sets are empty, or nearly: said in the headline."""
    at_the_start: str = ""
    """A line where AC cannot have control at the start."""
    notes: tuple[str, ...] = ()
    """Lines about how it was proved that are no assumptions."""
    cells_why: str = ""
    """The claim that is not shown on the declared cells, where smaller ones were chosen."""
    levels_why: str = ""
    """What is not shown with as many levels as there are by default, where fewer were chosen."""
    levels_cost: RemedyCost | None = None
    """What these cost: `before` is with as many as by default."""
    added: tuple[Assumption, ...] = ()
    """What the proof takes for granted beyond its problem."""
    shown: frozenset[str] = frozenset()
    """Keys of those assumptions of its problem that the proof shows."""
    ask_rechecker: Callable[[], str] | None = None
    """Gives `not_rechecked`; None: python-flint is not installed."""

    def __repr__(self) -> str:
        held = ", ".join(f"{name} {f.verdict}" for name, f in self.findings.items())
        return f"<soter.ModuleResult {self.name} {self.headline}: {held}>"

    @property
    def name(self) -> str:
        """Full name of the module."""
        return self.problem.name

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """Everything that the verdicts rest on."""
        return remaining(self.problem.assumptions, added=self.added, shown=self.shown)

    @property
    def verdict(self) -> str:
        """Of the module: refuted before undecided before proved."""
        verdicts = {f.verdict for f in self.findings.values()}
        for verdict in (REFUTED, UNDECIDED):
            if verdict in verdicts:
                return verdict
        return PROVED if PROVED in verdicts else ASSUMED

    @property
    def assumed(self) -> list[str]:
        """What a headline names as assumed: properties, and the scheme of the plants."""
        names = [n for n, f in self.findings.items() if f.verdict == ASSUMED]
        return [*names, *(a.key for a in self.assumptions if a.key == SCHEME.key)]

    @property
    def whilst(self) -> str:
        """Of a module below another one: when its `safe` is claimed; "" at all times."""
        return f" while {self.problem.above} is in AC" if self.problem.above else ""

    @cached_property
    def not_rechecked(self) -> str | None:
        """Why `soter recheck` cannot check it; "": it can. None: not proved, or nobody to ask."""
        held = self.verdict in (PROVED, ASSUMED)
        return self.ask_rechecker() if held and self.ask_rechecker is not None else None

    @property
    def headline(self) -> str:
        """The verdict and, where it says little or nobody else can check it, that."""
        if self.verdict not in (PROVED, ASSUMED):
            return self.verdict
        verdict = self.verdict + self.whilst
        verdict += "" if self.vacuity is None else f", but {self.vacuity.text}"
        return f"{verdict}, not re-checked: {self.not_rechecked}" if self.not_rechecked else verdict

    @property
    def cells(self) -> int:
        """Cells of all groups and cases together."""
        return sum(p.cells for c in self.cases for p in c.proofs)

    @property
    def core_share(self) -> float:
        """Share of the grid's volume that is K."""
        return self.shares.get("core", 0.0)


@dataclass(eq=False, repr=False)
class VerifyReport:
    """What `Program.verify` gives: one result a module, and the hash of what was proved."""

    path: str
    program_sha256: str
    system: str
    modules: tuple[ModuleResult, ...]
    seconds: float
    command: str = ""
    """The command line that verifies the same again."""
    coverage: VerificationScope = field(default_factory=VerificationScope)
    """What it is about beside these modules, and what it is not."""
    contents: Mapping[Path, str] = field(default_factory=dict, repr=False)
    """SHA-256 of every file that the program was made of, as it was read, by path."""
    page: Callable[[VerifyReport], str] | None = field(default=None, repr=False, compare=False)
    """Gives the page of `--report` as one HTML text; for notebooks."""

    @property
    def verdict(self) -> str:
        """The worst of the modules' verdicts; `proved` where there is none to be doubted."""
        verdicts = {m.verdict for m in self.modules}
        for verdict in (REFUTED, UNDECIDED, ASSUMED):
            if verdict in verdicts:
                return verdict
        return PROVED

    @property
    def together(self) -> str:
        """Of the conjunction (Theorem 4.1).

        The worst of the modules' verdicts; `assumed` where all are proved and one takes for granted
        what another one should guarantee that is not proved here.
        """
        proved = {m.name.removesuffix(f" as {m.problem.view}") for m in self.modules}
        promised = (g.by for g in self.coverage.guarantees if g.how == "guaranteed")
        return self.verdict if proved.issuperset(promised) or self.verdict != PROVED else ASSUMED

    def _repr_html_(self) -> str:
        from soter.report.tables import framed, notebook_table  # noqa: PLC0415 - in notebooks only

        rows = [
            (m.name, name, f.verdict, f.text)
            for m in self.modules
            for name, f in m.findings.items()
        ]
        count = sum(len(m.assumptions) for m in self.modules)
        head = f"{self.path} {self.system}: {self.verdict} under {count} assumptions"
        told = notebook_table(head, ("module", "property", "verdict", "how"), rows)
        return told if self.page is None else told + framed(self.page(self))

    @property
    def said(self) -> dict[str, str]:
        """What each module keeps: its `safe`, as it is written, by the module's name."""
        safe_by_module = {}
        for m in self.modules:
            name = m.name.removesuffix(f" as {m.problem.view}")
            views = m.problem.whole  # the module as it flies, beside the plants of a view
            module = m.problem.module if views is None else views.modules[0]
            safe_by_module[name] = " ".join(module.symbol.safe.span.text.split()) + m.whilst
        return safe_by_module

    @property
    def composed(self) -> bool:
        """Whether several modules are spoken of, or one that rests on what another guarantees."""
        taken = any(g.how == "guaranteed" for g in self.coverage.guarantees)
        return taken or len(self.modules) > 1

    def __getitem__(self, module: str) -> ModuleResult:
        """The result of one module, by full name; KeyError where there is none."""
        return {m.name: m for m in reversed(self.modules)}[module]

    def __repr__(self) -> str:
        headlines = ", ".join(f"{m.name} {m.headline}" for m in self.modules)
        return f"<soter.VerifyReport {self.path}: {headlines}>"
