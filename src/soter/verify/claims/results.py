"""The results of a verification, as plain data.

Purpose: the verdict on each property and how it was reached (`Finding`), and the sets of every case
and group, which certificates, monitors, computed predicates and reports use. Symbols: head of
`verify/grid/sets.py`; the index g is one group's part.
Non-goals: computing or printing anything.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from soter.verify.problem.problem import SCHEME, VerificationScope, assumptions_left

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from soter.diagnostics.diagnostic import Diagnostic, Span
    from soter.language.front_end import CheckResult
    from soter.verify.problem.problem import Assumption, Group, Problem
    from soter.verify.search.hint_text import Hints

PROVED, REFUTED, UNDECIDED, ASSUMED = "proved", "refuted", "undecided", "assumed"
WORSE = (PROVED, ASSUMED, UNDECIDED, REFUTED)
"""The verdicts from the best to the worst."""
NO_CORE = "there is no K"
"""The text of each claim that needs K, where K is empty; P2a has the reason."""
PROPERTIES = ("P1a", "P1b", "P1c", "P2a", "P2b", "P3", "ttf", "safer", "start", "failsafe", "DM")
"""All properties, in the order of every output. `start`: the declared initial states are among
those proved; `failsafe`: the fail-safe law keeps C once the lease has ended (`product_sets.py`);
`DM`: the decision module's generated code decides as declared (`deploy/dm_check.py`)."""
STAYS = "not asked: `{}`, SC may keep control for ever"
"""The text of P2b where it is not asked; {} is the clause of the program that says so."""
REGIONS_SHOWN = 3
"""The most regions of a finding that are shown to people."""
UNCLAIMED = ("DM",)
"""The properties that no certificate claims, as they are about generated code."""


@dataclass(frozen=True)
class Region:
    """A box of true states where a claim is not shown: names of states with their ranges."""

    axes: tuple[tuple[str, float, float], ...]
    parameters: tuple[tuple[str, int], ...] = ()

    def __str__(self) -> str:
        parts = [f"{name} = {value}" for name, value in self.parameters]
        parts += [f"{name} in [{low:.6g}, {high:.6g}]" for name, low, high in self.axes]
        return ", ".join(parts)

    @property
    def ranges(self) -> dict[str, list[float]]:
        """The ends [low, high] of each state, by name."""
        return {name: [low, high] for name, low, high in self.axes}


@dataclass(frozen=True)
class Vacuity:
    """The reason why a proof says little: AC never or hardly ever has control.

    `how_often`: how often AC has control, "not shown" if unknown; `what`: the reason: `ttf`,
    `safer`, `safe` or `core` (K itself); `share`: the share of K (of C for `core`) in which AC may
    have control; `parameters`: those of the worst case. See `diagnosis/vacuity.py`.
    """

    how_often: str
    what: str
    share: float
    text: str
    parameters: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True)
class Cause:
    """The cause that runs show for an unproved claim (`diagnosis/open_claims.py`).

    `kind`: a word for machines (docs/json.md); `text`: a sentence on what was measured; `hint`:
    advice; `numbers`: the measured values.
    """

    kind: str
    text: str
    hint: str = ""
    numbers: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class LeavingRun:
    """A run of the *model* under SC alone that leaves C; it is no run of the program.

    `states` has a row for each of `time_s`, in the order of `names`. `safe`: whether the run left C
    inside the grid. If not, it left the grid by the end `side` (-1 low, 1 high) of `axis`.
    """

    names: tuple[str, ...]
    time_s: NDArray[np.float64]
    states: NDArray[np.float64]
    axis: str
    side: int
    safe: bool
    start: str
    """Where the run starts: `the declared start`, `the middle of C` or `inside C`."""
    chosen: tuple[str, ...]
    """The disturbances and errors that were chosen against SC, in words."""
    parameter: tuple[int, ...] = ()
    """The parameter values of its case."""

    def __str__(self) -> str:
        """One line that describes the run."""
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
    """The figures of a module in a run; `ac_share`: AC's share of the time; 0 bytes: no tables."""

    takeovers_per_min: float
    ac_share: float
    table_bytes: int

    def __str__(self) -> str:
        """A clause that states the figures."""
        tables = f", {self.table_bytes:,} bytes of tables" if self.table_bytes else ""
        return f"{self.takeovers_per_min:.4g} takeovers a minute, AC {self.ac_share:.1%}{tables}"


@dataclass(frozen=True)
class RemedyCost:
    """The costs of changes that prove a module, measured in runs of `system` with seed 1.

    `before`: None if the unchanged program has no tables to fly. `not_measured`: why figures are
    missing, else "". `diagnosis/tried_remedies.py` makes these costs.
    """

    system: str
    until_s: float = 0.0
    before: FlownFigures | None = None
    after: FlownFigures | None = None
    not_measured: str = ""

    def __str__(self) -> str:
        """One line that states the costs."""
        if self.not_measured:
            return f"not measured: {self.not_measured}"
        run = f"{self.until_s:g} s of {self.system} simulated, seed 1"
        return f"{run}: before {self.before or 'nothing can fly'}; with it {self.after}"


@dataclass
class Finding:
    """The verdict on one property.

    `method`: how it was reached; `text`: a sentence on the finding; `hint`: advice for an undecided
    claim; `counterexample`: the run that refutes it (`verify/counterexample.py`); `causes`,
    `leaving`: measurements for an undecided claim.
    """

    verdict: str
    """The verdict, which `weaken_to` can make worse, and nothing can make better."""
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
    """The remedies that were verified, each with its outcome (`diagnosis/tried_remedies.py`)."""
    remedied: Problem | None = None
    """The problem with the remedies that prove every claim; None: no remedies do."""
    cost: RemedyCost | None = None
    """The costs of these remedies; None: no remedies prove every claim."""
    saved: Path | None = None
    """The file that the counterexample was saved to."""

    def __setattr__(self, name: str, value: object) -> None:
        if name == "verdict" and hasattr(self, "verdict"):
            raise AttributeError("a verdict is made once: `weaken_to` says what else it rests on")
        super().__setattr__(name, value)

    def weaken_to(self, verdict: str, text: str = "", hint: str = "") -> None:
        """Replaces the verdict unless it is already worse than `verdict`.

        A `text` that is not empty then replaces the text, and `hint` the hint.
        """
        if WORSE.index(verdict) < WORSE.index(self.verdict):
            return
        self.__dict__["verdict"] = verdict
        if text:
            self.text, self.hint = text, hint

    @property
    def holds(self) -> bool:
        """Whether the verdict is `proved` or `assumed`."""
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
    """The cells on which `safe` may be true."""
    lets_ac: NDArray[np.bool_] | None = None
    """The cells on which `ttf` may be false, so that AC may keep control."""
    gives_back: NDArray[np.bool_] | None = None
    """The cells on which `safer` may be true, so that AC may get control."""
    target: NDArray[np.bool_] | None = None
    """The states all of whose estimates satisfy `safer`; Q was searched in this set."""
    home: NDArray[np.uint8] | None = None
    rank: NDArray[np.uint16] | None = None
    rank_holds: NDArray[np.uint8] | None = None
    finer: tuple[str, Group] | None = None
    return_ns: int = 0
    """The longest time from W to Q in ns."""
    levels: list[NDArray[np.bool_]] = field(default_factory=list)
    """The sets of estimates S_0, S_1, ..., where predicates are computed."""
    tops: NDArray[np.uint8] | None = None
    """Of a shield, shape (cells..., command cells): for command cell i one more than the last cell
    up to which commands may act together with those of i; 0: those of i may not act."""
    lasting: NDArray[np.uint8] | None = None
    """Of a shield `toward sc`, same shape: 1 where commands of a command cell may act longer."""
    command: int | None = None
    """The control that moves the group, where the module has a shield."""
    deployed: tuple[NDArray[np.bool_], NDArray[np.bool_]] | None = None
    """S_0 and S_(m-2) in the DM's table: estimates in those of every case; None: no table."""
    solver: object | None = None
    """The group's engine (`verify/grid/sets.py`), for further computations."""

    @property
    def edges(self) -> tuple[tuple[float, ...], ...]:
        """The breakpoints of each axis."""
        return tuple(a.edges for a in self.group.axes)


@dataclass(eq=False)
class CaseSets:
    """The sets of all groups under one combination of parameter values."""

    parameter: tuple[int, ...]
    proofs: Sequence[Any]
    """Each a `GridProof` (`grid/claims.py`), which knows this file."""

    @property
    def groups(self) -> list[GroupSets]:
        """The sets of the groups."""
        return [p.found for p in self.proofs]


@dataclass(eq=False, repr=False)
class ModuleResult:
    """The findings about a module, and the sets that support them."""

    problem: Problem
    findings: dict[str, Finding]
    cases: list[CaseSets]
    laws: list[CaseSets] = field(default_factory=list)
    """The sets of the fail-safe law, one for each case; empty: the law is not proved."""
    seconds: float = 0.0
    shares: dict[str, float] = field(default_factory=dict)
    """Shares of the grid's volume, the least over the parameters: `core` (K), `free` (R(H)),
    `lets_ac`, `gives_back` and, where predicates are computed, `estimates` (S_0)."""
    recover_s: float | None = None
    """The time T in s within which AC has control again, as proved by P2b; None: not proved."""
    vacuity: Vacuity | None = None
    """Why the proof says little, for the headline; None: there is no such reason."""
    at_the_start: str = ""
    """A line which says that AC cannot have control at the start; "": it can."""
    notes: tuple[str, ...] = ()
    """Notes on how the module was proved that are no assumptions."""
    cells_why: str = ""
    """The claim for which smaller cells than declared were chosen; "": none were."""
    levels_why: str = ""
    """What is not shown with the default number of levels; "": not fewer levels were chosen."""
    levels_cost: RemedyCost | None = None
    """The costs of fewer levels; `before` is with the default number."""
    added: tuple[Assumption, ...] = ()
    """The assumptions that the proof makes beyond those of its problem."""
    shown: frozenset[str] = frozenset()
    """The keys of assumptions of its problem that the proof shows to hold."""
    ask_rechecker: Callable[[], str] | None = None
    """The function that gives `not_rechecked`; None: python-flint is not installed."""

    def __repr__(self) -> str:
        held = ", ".join(f"{name} {f.verdict}" for name, f in self.findings.items())
        return f"<soter.ModuleResult {self.name} {self.headline}: {held}>"

    @property
    def name(self) -> str:
        """The module's full name."""
        return self.problem.name

    @property
    def assumptions(self) -> tuple[Assumption, ...]:
        """All assumptions on which the verdicts depend."""
        return assumptions_left(self.problem.assumptions, added=self.added, shown=self.shown)

    @property
    def verdict(self) -> str:
        """Refuted or undecided if a finding is, else proved if one is, else assumed."""
        verdicts = {f.verdict for f in self.findings.values()}
        for verdict in (REFUTED, UNDECIDED):
            if verdict in verdicts:
                return verdict
        return PROVED if PROVED in verdicts else ASSUMED

    @property
    def assumed(self) -> list[str]:
        """The names of assumed properties, and SCHEME's key if it is assumed, for a headline."""
        names = [n for n, f in self.findings.items() if f.verdict == ASSUMED]
        return [*names, *(a.key for a in self.assumptions if a.key == SCHEME.key)]

    @property
    def verdict_note(self) -> str:
        """The note that is shown beside the verdict (`tubes/verify.py`); "" without a note."""
        return ""

    @cached_property
    def not_rechecked(self) -> str | None:
        """Why `soter recheck` cannot check the module; "": it can; None if unproved or unknown."""
        held = self.verdict in (PROVED, ASSUMED)
        return self.ask_rechecker() if held and self.ask_rechecker is not None else None

    @property
    def headline(self) -> str:
        """The verdict, with a note if the proof says little or cannot be re-checked."""
        if self.verdict not in (PROVED, ASSUMED):
            return self.verdict
        verdict = self.verdict + self.verdict_note
        verdict += "" if self.vacuity is None else f", but {self.vacuity.text}"
        return f"{verdict}, not re-checked: {self.not_rechecked}" if self.not_rechecked else verdict

    @property
    def cells(self) -> int:
        """The number of cells of all groups and cases together."""
        return sum(p.cells for c in self.cases for p in c.proofs)

    @property
    def core_share(self) -> float:
        """The share of the grid's volume that K covers."""
        return self.shares.get("core", 0.0)


@dataclass(frozen=True, eq=False)
class Try:
    """One try of a search: its hints, its outcome in words (`gave`), and its CPU seconds.

    `untried`: the try would have taken too long, and `cpu_s` is an estimate. `cut`: it was stopped.
    """

    hints: str
    gave: str
    cpu_s: float
    untried: bool = False
    cut: bool = False


@dataclass(eq=False)
class ProofSearch:
    """The tries for a module, the best hints (`found`), and the program with them (`checked`)."""

    module: str
    own: bool
    """Whether the program has hints of its own, which leave the module undecided."""
    tries: list[Try] = field(default_factory=list)
    found: Hints | None = None
    checked: CheckResult | None = None
    result: ModuleResult | None = None
    ended: bool = False
    """Whether the budget of the search was used up."""
    refused: Diagnostic | None = None
    """Why no model of the module can be made with any hints; None: one can."""
    proved: bool = False
    """Whether the module is proved with `found`, and its AC may get control.

    Where hints in the program prove P2a, AC has to get control for certain.
    """

    @property
    def cells_in_vain(self) -> bool:
        """Whether the search tried a grid to the end and still did not prove the module."""
        ended = (t.hints for t in self.tries if not (t.untried or t.cut))
        return not self.proved and any("grid " in hints for hints in ended)

    @property
    def text(self) -> str:
        """The text of the program with the best hints; "" if the search found no hints."""
        loaded = None if self.checked is None else self.checked.loaded
        return "" if loaded is None else loaded.main.source.text


@dataclass(eq=False, repr=False)
class VerifyReport:
    """The report that `Program.verify` returns: a result per module, and the program's hash."""

    path: str
    program_sha256: str
    system: str
    modules: tuple[ModuleResult, ...]
    seconds: float
    command: str = ""
    """The command line that verifies the same again."""
    coverage: VerificationScope = field(default_factory=VerificationScope)
    """What the report covers beside these modules, and what it does not cover."""
    contents: Mapping[Path, str] = field(default_factory=dict, repr=False)
    """SHA-256 of every file that the program was made of, as it was read, by path."""
    places: Mapping[str, Span] = field(default_factory=dict, repr=False, compare=False)
    """The place of each module in the files that were read, which lack hints that were found."""
    searches: tuple[ProofSearch, ...] = ()
    """The searches for hints, one for each module for which hints were searched."""
    page: Callable[[VerifyReport], str] | None = field(default=None, repr=False, compare=False)
    """The function that makes the page of `--report` as an HTML text, for notebooks."""

    @property
    def verdict(self) -> str:
        """The worst of the modules' verdicts; `proved` for a program without modules."""
        verdicts = {m.verdict for m in self.modules}
        for verdict in (REFUTED, UNDECIDED, ASSUMED):
            if verdict in verdicts:
                return verdict
        return PROVED

    @property
    def together(self) -> str:
        """The verdict on all modules together (Theorem 4.1).

        It is the worst of the modules' verdicts. It is `assumed` if all are proved but one relies
        on a module's guarantee that is not proved here.
        """
        proved = {m.name.removesuffix(f" as {m.problem.view}") for m in self.modules}
        promised = (g.by for g in self.coverage.guarantees if g.how == "guaranteed")
        return self.verdict if proved.issuperset(promised) or self.verdict != PROVED else ASSUMED

    def _repr_html_(self) -> str:
        from soter.report.tables import framed_document, notebook_table  # noqa: PLC0415 - in notebooks only

        rows = [
            (m.name, name, f.verdict, f.text)
            for m in self.modules
            for name, f in m.findings.items()
        ]
        count = sum(len(m.assumptions) for m in self.modules)
        head = f"{self.path} {self.system}: {self.verdict} under {count} assumptions"
        table = notebook_table(head, ("module", "property", "verdict", "how"), rows)
        return table if self.page is None else table + framed_document(self.page(self))

    @property
    def safe_text_by_module(self) -> dict[str, str]:
        """The text of the predicate `safe` that each module keeps, by the module's name."""
        safe_by_module = {}
        for m in self.modules:
            name = m.name.removesuffix(f" as {m.problem.view}")
            views = m.problem.whole  # the module as it flies, beside the plants of a view
            module = m.problem.module if views is None else views.modules[0]
            safe_by_module[name] = module.symbol.safe.span.text_on_one_line + m.verdict_note
        return safe_by_module

    @property
    def composed(self) -> bool:
        """Whether the report has several modules, or one that relies on another's guarantee."""
        taken = any(g.how == "guaranteed" for g in self.coverage.guarantees)
        return taken or len(self.modules) > 1

    def __getitem__(self, module: str) -> ModuleResult:
        """The result of one module, by full name; raises `KeyError` if no module has this name."""
        return {m.name: m for m in reversed(self.modules)}[module]

    def __repr__(self) -> str:
        headlines = ", ".join(f"{m.name} {m.headline}" for m in self.modules)
        return f"<soter.VerifyReport {self.path}: {headlines}>"
