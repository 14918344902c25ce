"""The results of exploring a program's tests, as plain data, and what the tests show together.

Purpose: a `TestResult` has the verdict on a test, what was covered, which bound was reached, the
trace of a violation, and the assumptions; an `ExploreReport` has one for each test of a program.
`wholes_by_parts`, last in the file, makes a `WholeByParts` of them by a theorem (docs/testing.md,
"Contracts"): tests of one system, each with some of it replaced, may together show something of
the whole; if not, it says why. A contract is judged as its owner steps, so contracts may rely on
each other in a circle.
Non-goals: finding anything, printing; systems whose tests have no contract in place of anything.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.explore.engine.coverage import Coverage
from soter.explore.judge import test_plan
from soter.explore.search_options import CHOICES_MAX, STEPS_MAX, WORDS_MAX
from soter.language.check.dots_and_brackets import quoted
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from soter.explore.replay import Replayed
    from soter.explore.search_options import SearchOptions
    from soter.explore.trace import ViolationId
    from soter.explore.vacuous_tests import VacuousPart
    from soter.language.model.system import System
    from soter.language.model.typed import TestSymbol


ENDS_ONLY = ("all", "instants", "groups")
"""Reductions that store only ends of instants, where that can be."""
DEAR, DEAR_S = 64, 2.0
"""With so many transitions a configuration, and seconds, or more another reduction is suggested."""
EXHAUSTED, VIOLATED, BOUND = "exhausted", "violated", "bound"

UNJUDGED, UNDRIVEN, PICKED = "unjudged", "undriven", "picked"
GRID, DRAWN = "grid", "drawn"
MEMORY, STATES, RUNS, SAMPLED, INTERRUPTED = "memory", "states", "runs", "sampled", "interrupted"
TIME, CHOICES, WIDTH, LENGTH, PART = "time", "choices", "width", "length", "part"
PATIENCE, NOT_ASKED = "patience", "not_asked"
BOUNDS = {
    UNJUDGED: "nothing was judged: no property of the test was ever looked at",
    UNDRIVEN: "an input keeps its default all the time: other values of it were not tried",
    PICKED: "an input takes only values that are picked: others of its set were not tried",
    GRID: "the program calculates with times, or compares many of them: a grid of them, which was "
    "tried, is not all of them",
    DRAWN: "a disturbance that holds its value was drawn by chance, once for all executions: no "
    "other was tried (without `hold`, in a plant of its own with that period, they are)",
    MEMORY: "the memory that was allowed is full (--memory)",
    STATES: "as many configurations as were allowed are stored (--max-states)",
    RUNS: "executions drawn by {strategy} never cover everything (--runs; --strategy bfs does)",
    SAMPLED: "a continuum is sampled at three values: what lies between was not looked at",
    INTERRUPTED: "interrupted",
    TIME: "the time that was allowed is over (--time)",
    CHOICES: (
        f"{{who}} asks for more than {CHOICES_MAX} choices, and the explorer has room for no more: "
        "draw less in one step"
    ),
    WIDTH: (
        "a configuration takes {words:,} words of 64 bits, and the explorer has room for "
        f"{WORDS_MAX:,}: give what it stores narrower ranges, or make arrays and queues shorter"
    ),
}
"""Why a search that has no violation to show did not cover everything."""
ENDED = frozenset({UNJUDGED, UNDRIVEN, PICKED, GRID, DRAWN, SAMPLED})
"""The bounds of searches that came to their end."""
NOT_SHORTEST = {
    PATIENCE: "the search for it took longer than its part of {minimise:g} s (--minimise)",
    NOT_ASKED: "it was not looked for (--minimise 0)",
    MEMORY: "the search for it needs more memory than was allowed (--memory)",
    STATES: "the search for it needs more configurations than were allowed (--max-states)",
    INTERRUPTED: "the search for it was interrupted",
    CHOICES: f"a step asks for more than {CHOICES_MAX} choices: not all of them were tried",
    LENGTH: f"the explorer has room for traces of {STEPS_MAX:,} steps",
}
"""Why the execution that shows a violation may not be the shortest one."""
UNSHOWN = {
    MEMORY: "it needs more memory than was allowed: more --memory or a shorter --horizon may show "
    "one",
    TIME: "the time that was allowed is over: more --time shows one",
    INTERRUPTED: "the search was interrupted: let it end",
    LENGTH: f"it has more than {STEPS_MAX:,} steps: a shorter --horizon may show one with fewer",
    PART: "what one part of the system does could not be completed to an execution of all of it: "
    "--reduction ample looks at the whole",
}
"""Why no execution can be shown that violates what is violated, and how to get one."""


@dataclass(eq=False)
class TestResult:
    """The result of the search of one test, with its statistics and the violation found.

    `verdict`: EXHAUSTED, VIOLATED, or BOUND if the search stopped at `bound`, a key of BOUNDS.
    `states`: number of stored configurations. `transitions`: steps made between them. `runs`:
    number of drawn executions. `depth`: steps of the longest execution seen. `bits`: of a packed
    configuration. `seconds`: of the search alone. `table_bytes`: memory of stored configurations,
    `frontier_bytes`: of those still to be followed. If the test is violated, `broken`, `replayed`
    and the file `trace` are set. `minimal`: no execution to that violation has fewer steps;
    `least_bound`: why that was not shown. `minimise_s`: seconds spent on that and on shrinking. If
    no execution shows the violation, only `broken` is set, and `unshown` says why: the compiled
    steps found it, and no interpreter has replayed it.
    """

    __test__ = False  # not a test of pytest's

    name: str
    system: System
    options: SearchOptions
    verdict: str
    bound: str | None
    states: int
    transitions: int
    runs: int
    seconds: float
    depth: int
    bits: int
    table_bytes: int
    frontier_bytes: int
    quantum_ns: int | None = None
    """The grid on which steps that may be late chose their times; None where none had a choice."""
    total_bytes: int = 0
    """The bytes of tables, frontiers and remembered steps, which `SearchOptions.memory` bounds."""
    covered_ns: int | None = 0
    """Everything observable before this time was judged, in all executions; None: sampling.

    It is the horizon where the search came to its end.
    """
    closed_ns: int | None = None
    """After this time only configurations come that came before, so the verdict holds for ever;
    None: the search did not see that before the horizon."""
    short_of: str | None = None
    """Another bound, one of ENDED, that a search which did not end has as well; None: none."""
    threads: int = 1
    """How many threads searched."""
    why: str = ""
    """Which bound was reached, in words."""
    parts: int = 1
    """How many parts of the system, which share no data, were explored apart."""
    contracts: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """For each instance that a contract replaces, the tests in which it runs itself."""
    stands_for: tuple[tuple[str, str], ...] = ()
    """Each instance with a replacement that somebody reads, and the node or plant in its place."""
    coverage: Coverage = field(default_factory=Coverage)
    vacuous: tuple[VacuousPart, ...] = ()
    """The parts of the test that say nothing; each is also a sentence of `assumptions`."""
    assumptions: tuple[str, ...] = ()
    broken: ViolationId | None = None
    replayed: Replayed | None = None
    minimal: bool = False
    least_bound: str | None = None
    unshown: str | None = None
    minimise_s: float = 0.0
    shrunk_from: int = 0
    """How many steps the trace had, with the start, before it was shrunk; 0: it was not."""
    trace: Path | None = None
    page: Path | None = None
    others: tuple[TestResult, ...] = ()
    """Results for other properties that can be violated, each with a trace (`all_properties`)."""
    others_bound: str | None = None
    """Why `others` may not be all; None: the search for more ended, or there was none."""

    @property
    def threads_fewer(self) -> str:
        """The reason why fewer threads ran than the user asked for; "" if as many ran."""
        return self.options.why_fewer_threads(self.threads)

    @property
    def states_per_s(self) -> float:
        """Configurations stored per second; if none are stored, steps of executions per second."""
        count = self.states or self.transitions
        return count / self.seconds if self.seconds > 0 else 0.0

    @property
    def bytes_per_state(self) -> float:
        """The memory of the table in bytes, divided by the number of stored configurations."""
        return self.table_bytes / self.states if self.states else 0.0

    @property
    def not_shortest(self) -> str:
        """The reason why the trace may not be the shortest; "" if it is, or if no trace exists."""
        if self.replayed is None or self.least_bound is None:
            return ""
        return why_not_shortest(self.least_bound, self.options)

    @property
    def violated_there(self) -> tuple[str, ...]:
        """The properties violated at the end of the trace; the trace's property comes first."""
        if self.replayed is None or self.broken is None:
            return ()
        others = [b.text for b in self.replayed.steps[-1].violated if b != self.broken]
        return (self.broken.text, *others)

    @property
    def not_shown(self) -> str:
        """The reason why no execution shows the violation, and a remedy; "" if one shows it."""
        if self.unshown is None:
            return ""
        why = UNSHOWN[self.unshown]
        return (
            f"found by the compiled steps, not replayed: no execution of it can be shown, as {why}"
        )

    @property
    def covered_text(self) -> str:
        """A sentence on how far all executions were covered; "" if no bound was reached."""
        if self.bound is None or self.covered_ns is None:
            return ""
        assert self.system.test is not None
        horizon = show_ns(self.system.test.horizon_ns)
        if self.bound in ENDED:
            return f"but for that, all executions up to {horizon} were covered"
        left_out = f"; also, {BOUNDS[self.short_of]}" if self.short_of in ENDED else ""
        if self.covered_ns == 0:
            return f"no part of {horizon} was covered in all executions{left_out}"
        return (
            f"all executions were covered before {show_ns(self.covered_ns)} of {horizon}{left_out}"
        )

    @property
    def parts_clause(self) -> str:
        """A clause on the parts that were explored alone; "" if there was only one."""
        return f"; {self.parts} parts that share no data, explored apart" if self.parts > 1 else ""

    @property
    def slow_search_note(self) -> str:
        """A note that `--reduction ample` may be faster; "" if the search was not slow.

        A search that stores only the ends of instants follows paths many times that meet between
        two ends.
        """
        ends_only = self.options.strategy == "bfs" and self.options.reduction in ENDS_ONLY
        each = self.transitions / max(self.states, 1)
        if not ends_only or each < DEAR or self.seconds < DEAR_S:
            return ""
        return (
            f"each configuration took {each:,.0f} transitions, as only ends of instants are "
            "stored: `--reduction ample` stores what lies between, too, and may be faster"
        )

    @property
    def for_ever_clause(self) -> str:
        """A clause that says that the verdict holds for ever; "" if the search did not show it."""
        if self.closed_ns is None:
            return ""
        return (
            f"; it holds for ever: whatever comes after {show_ns(self.closed_ns)} was there before"
        )

    @property
    def interrupted(self) -> bool:
        """Whether the user stopped the search, or the work on its trace."""
        return INTERRUPTED in (self.bound, self.least_bound, self.unshown, self.others_bound)

    def __repr__(self) -> str:
        finding = f" {self.broken.text}" if self.broken else f" {self.bound}" if self.bound else ""
        return f"<soter.TestResult {self.name} {self.verdict}{finding}, {self.states:,} states>"


def bound_text(
    bound: str, options: SearchOptions, who: str = "a step", words: int = WORDS_MAX
) -> str:
    """The text of the bound reached; `who`: the step with too many choices, `words`: how many."""
    return BOUNDS[bound].format(strategy=options.strategy, who=who, words=words)


def why_not_shortest(bound: str, options: SearchOptions) -> str:
    """The reason, in words for people, why a trace may not be the shortest one."""
    why = NOT_SHORTEST[bound].format(minimise=options.minimise)
    first = f"; {options.strategy} met this one first" if options.strategy != "bfs" else ""
    return f"{why}{first}"


@dataclass(eq=False)
class ExploreReport:
    """The report of `Program.explore`, with a result for each test, in the program's order."""

    path: str
    program_sha256: str
    tests: tuple[TestResult, ...]
    not_started: tuple[str, ...] = ()
    """The names of tests that would have come after one that was interrupted."""

    @property
    def verdict(self) -> str:
        """The worst verdict of the tests: violated, then bound, then exhausted."""
        verdicts = {t.verdict for t in self.tests} | {BOUND for _ in self.not_started}
        return next((v for v in (VIOLATED, BOUND) if v in verdicts), EXHAUSTED)

    @property
    def interrupted(self) -> bool:
        """Whether the user stopped a test; the tests after it are then missing."""
        return any(t.interrupted for t in self.tests) or bool(self.not_started)

    def _repr_html_(self) -> str:
        from soter.report.tables import notebook_table  # noqa: PLC0415 - in notebooks only

        rows = [
            (t.name, t.verdict, "" if t.broken is None else t.broken.text, f"{t.states:,}")
            for t in self.tests
        ]
        heads = ("test", "verdict", "violated", "states")
        return notebook_table(f"{self.path}: {self.verdict}", heads, rows, self.not_started)

    def unclean_contracts_note(self, test: TestResult) -> str:
        """A note on tests of contracts on which `test` relies that are not clean; "" if all are."""
        asked = {name for names in test.contracts.values() for name in names}
        unclean_tests = [t.name for t in self.tests if t.name in asked and t.verdict != EXHAUSTED]
        names = " and ".join(f"`{name}`" for name in unclean_tests)
        return f"but {names}, asked for a contract that it rests on, did not end clean" * bool(
            unclean_tests
        )

    def __getitem__(self, test: str) -> TestResult:
        """The result of the test with this name; raises KeyError if no test has the name."""
        for t in self.tests:
            if t.name == test:
                return t
        raise KeyError(test)

    def __repr__(self) -> str:
        summary = ", ".join(f"{t.name} {t.verdict}" for t in self.tests)
        return f"<soter.ExploreReport {self.path}: {summary}>"


@dataclass(frozen=True)
class WholeByParts:
    """The conclusion on a whole system, up to `horizon_ns`, from tests that replace parts of it.

    `held`: each instance that a contract replaces, and the tests in which the instance itself runs.
    `assumed`: (test, instance, replacement) for each other replacement whose outputs are read.
    `missing`: reasons why the tests show nothing of the whole system; () if they do.
    """

    system: str
    tests: tuple[str, ...]
    horizon_ns: int
    held: tuple[tuple[str, tuple[str, ...]], ...]
    assumed: tuple[tuple[str, str, str], ...]
    missing: tuple[str, ...]

    @property
    def text(self) -> str:
        """The conclusion in a sentence or two."""
        if self.missing:
            return f"{self.system} is not shown as a whole: {'; '.join(self.missing)}"
        until = show_ns(self.horizon_ns)
        verdict = (
            f"{self.system} holds as a whole, by parts, up to {until}: no execution of it breaks a "
            f"contract or a property of {quoted(self.tests)}, as whatever a contract stands for "
            "there runs as it is in another of them"
        )
        by_test: dict[tuple[str, str], list[str]] = {}
        for test, replaced, by in self.assumed:
            by_test.setdefault((replaced, by), []).append(test)
        means = [
            f"{replaced} is what {by} may do ({', '.join(tests)})"
            for (replaced, by), tests in by_test.items()
        ]
        if not means:
            return f"{verdict}. Nothing is assumed of its parts"
        return f"{verdict}. Assumed: {'; '.join(means)}"


def wholes_by_parts(results: Iterable[TestResult]) -> tuple[WholeByParts, ...]:
    """The conclusion for each group of comparable tests in which a contract replaces a part."""
    alike: dict[Hashable, list[TestResult]] = {}
    for result in results:
        symbol = result.system.program.tests.get(result.name)
        if symbol is not None:
            alike.setdefault(_comparison_key(result, symbol), []).append(result)
    return tuple(
        [_whole_by_parts(group) for group in alike.values() if any(r.contracts for r in group)]
    )


def _comparison_key(result: TestResult, symbol: TestSymbol) -> Hashable:
    """The settings that are equal in all tests of one group, so that their executions compare."""
    plan, system = test_plan(result.system), result.system
    names = [c.name for c in system.components]
    faults = {(names[f.component], f.kind, f.by_ns, f.at_most, f.least_ns) for f in plan.faults}
    inputs = {(system.topics[d.topic].name, d.every_ns, repr(d.values)) for d in system.inputs}
    return (
        system.program.sha256,
        symbol.system.name,
        frozenset((name, repr(value)) for name, value in system.params.items()),
        plan.skew_ns,
        plan.quantum_ns,
        plan.ordered,
        frozenset(faults),
        frozenset(inputs),
    )


def _whole_by_parts(group: list[TestResult]) -> WholeByParts:
    names = {r.name for r in group}
    held: dict[str, set[str]] = {}
    for result in group:
        for instance, tests in result.contracts.items():
            held.setdefault(instance, set()).update(names.intersection(tests))
    as_it_is = {
        instance: tuple(
            r.name for r in group if r.name in tests and instance not in dict(r.stands_for)
        )
        for instance, tests in held.items()
    }
    return WholeByParts(
        system=group[0].system.name if group else "",
        tests=tuple(r.name for r in group),
        horizon_ns=min(test_plan(r.system).horizon_ns for r in group),
        held=tuple(sorted(as_it_is.items())),
        assumed=tuple((r.name, replaced, by) for r in group for replaced, by in r.stands_for),
        missing=tuple(_why_not_whole(group, as_it_is)),
    )


def _why_not_whole(group: list[TestResult], as_it_is: dict[str, tuple[str, ...]]) -> Iterator[str]:
    """Yields the reasons why these tests show nothing of the whole system."""
    for result in group:
        if result.verdict != EXHAUSTED:
            yield f"{result.name} is not exhausted and clean"
    for instance, tests in as_it_is.items():
        if not tests:
            replaced = f"{instance} is replaced by its contract"
            yield f"{replaced} and runs as it is in no test that is asked"
