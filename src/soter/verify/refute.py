"""Looks for a run that leaves C, the states where `safe` holds, for the verdict `refuted`.

Purpose: `search_leaving_run` makes many short native runs of the closed system under attack
(`attacked_system.py`), with the environment and the AC at their bounds in seeded patterns
(`semantics/adverse_draws.py`). A run found natively is run again by the interpreter, recorded as
choices, and replayed from these alone; only that replay refutes. `enter_refutations` does this for
claims that are not proved, and enters what was found.
Non-goals: proving (that nothing was found means nothing); delays and jitter: virtual time has none.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from soter.codegen.unit import generate
from soter.core.layout import NEVER, state_dtype
from soter.language.elaborate.derived_systems import without_latches
from soter.native.loaded_program import Library, RunStatus
from soter.native.shared_library import library
from soter.semantics.adverse_draws import CHANCE, CORNER, HOLDS, MIXED, TOGETHER, TURN, AdverseDraws
from soter.semantics.externs import UnboundExternError
from soter.semantics.recorded_draws import Recorder
from soter.verify.attacked_system import (
    DRAWN,
    OWN,
    NotAttackableError,
    attacked_system,
    may_read_time,
    true_topics_known_ns,
)
from soter.verify.claims.claims import CLAMP
from soter.verify.claims.results import NO_CORE, PROVED, REFUTED, UNDECIDED
from soter.verify.counterexample import (
    CYCLE,
    LEAVES,
    Counterexample,
    replay_choices,
    run_that_leaves,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.language.model.system import System
    from soter.verify.claims.results import Finding, ModuleResult
    from soter.verify.problem.problem import Problem


ROUNDS = ((200, 32), (1000, 64), (200, 256), (4000, 64), (1000, 512))
"""The rounds, (length of a run in DM periods, seeds a pattern); the last ones are repeated."""
CYCLE_LENGTHS = (50, 100, 200, 500, 1000, 2000, 4000, 8000, 16000)
"""After these numbers of DM periods it is checked whether a run under SC repeats itself."""
CYCLE_TURNS = 4
CYCLE_SEEDS = 32
CONFIRMATIONS_MAX = 8
"""The number of native finds that the interpreter may not confirm before the search ends."""


@dataclass(frozen=True)
class RefutationSearch:
    """The result of a search: the number of runs, and the counterexample if one was found."""

    found: Counterexample | None
    runs: int
    hindrance: str = ""
    """Why nothing could be tried, in words; "" if something was tried."""


def search_leaving_run(system: System, module: str, budget_s: float = 10.0) -> RefutationSearch:
    """Looks for a run from the declared initial states that leaves C, for `budget_s` CPU seconds.

    `system`: the verification system (`Problem.system`; `module` is the name it has there), or a
    real one without externs.
    """
    return _search_by_attacks(system, module, budget_s, _leaving_runs)


def search_run_without_return(
    system: System, module: str, budget_s: float = 5.0
) -> RefutationSearch:
    """Searches for a run on which SC gets control and the DM never returns it to AC (P2b)."""
    return _search_by_attacks(system, module, budget_s, _cycling_runs)


def _search_by_attacks(
    system: System,
    module: str,
    budget_s: float,
    runs: Callable[[_Attack, _SearchBudget], Iterator[Counterexample]],
) -> RefutationSearch:
    """Runs the attacks in turn until a run is confirmed, none is left, or the time is over."""
    index = next(m.index for m in system.modules if m.name == module)
    attacks, hindrance = _possible_attacks(system, index)
    clock = _SearchBudget(budget_s)
    counterexample = None
    streams = [runs(a, clock) for a in attacks]
    confirmations = 0
    while (
        streams
        and counterexample is None
        and confirmations < CONFIRMATIONS_MAX
        and clock.has_time()
    ):
        for stream in list(streams):
            candidate = next(stream, None)
            if candidate is None:
                streams.remove(stream)
            elif candidate is not _NOTHING:
                confirmations += 1
                counterexample = _confirmed_by_interpreter(candidate, system)
                if counterexample is not None:
                    break
    return RefutationSearch(counterexample, clock.runs, hindrance)


def _possible_attacks(system: System, index: int) -> tuple[list[_Attack], str]:
    hindrance = ""
    attacks = []
    externs = {c.index for c in system.components if c.extern}
    for controller in (DRAWN, OWN):
        if externs - ({system.modules[index].ac} if controller == DRAWN else set()):
            hindrance = "extern code runs in the closed system"
            continue
        try:
            attacks.append(_Attack(system, index, controller))
        except NotAttackableError as error:
            hindrance = str(error)
    return attacks, "" if attacks else hindrance


def _confirmed_by_interpreter(candidate: Counterexample, system: System) -> Counterexample | None:
    """The candidate with its choices, if a replay of these alone confirms it; else None."""
    index = next(m.index for m in system.modules if m.name == candidate.module)
    variant = attacked_system(system, index, candidate.controller)
    recorder = Recorder(AdverseDraws(candidate.seed))
    try:
        # of a cycle all choices are constant: one turn meets every stream
        turn_ns = true_topics_known_ns(variant) + variant.hyperperiod_ns
        first = run_that_leaves(
            variant, recorder, candidate.time_ns if candidate.shows == LEAVES else turn_ns
        )
    except UnboundExternError:
        return None
    if candidate.shows == LEAVES:
        if first is None:
            return None
        candidate = replace(candidate, time_ns=first.time_ns)
    written = replace(candidate, choices=recorder.choices)
    again = replay_choices(written, system)
    return None if again is None else replace(written, steps=again.steps)


class _SearchBudget:
    """A budget in CPU seconds of this process, which a busy machine hardly changes."""

    def __init__(self, budget_s: float) -> None:
        self.budget_s = budget_s
        self.runs = 0
        self._began = time.process_time()

    def has_time(self) -> bool:
        spent = time.process_time() - self._began
        return spent < self.budget_s


class _Attack:
    """A system under attack, compiled to draw values at the bounds of their sets."""

    def __init__(self, system: System, index: int, controller: str) -> None:
        self.variant = attacked_system(system, index, controller)
        self.index = index
        self.controller = controller
        self.module = self.variant.modules[index]
        unit = generate(self.variant)
        self.layout = unit.layout
        self.dtype = state_dtype(unit.layout)
        path = library(unit, "-O2", ("-DSOTER_ADVERSARY",))
        self.library = Library(path, unit.prefix, unit.layout.size)

    def new_state(self, seed: int) -> Any:  # noqa: ANN401 - bytes of a state
        return self.library.new_state(seed)

    def run_until(self, state: Any, until_ns: int) -> Any:  # noqa: ANN401 - a numpy record
        status, _, _ = self.library.run_until(state, until_ns)
        assert status is RunStatus.END, status
        return state.view(self.dtype)[0]

    def new_candidate(
        self, shows: str, seed: int, time_ns: int, cycle_ns: int | None
    ) -> Counterexample:
        return Counterexample(
            module=self.module.name,
            shows=shows,
            controller=self.controller,
            seed=seed,
            time_ns=time_ns,
            cycle_ns=cycle_ns,
            choices={},
        )


_NOTHING = Counterexample(
    module="", shows="", controller="", seed=0, time_ns=0, cycle_ns=None, choices={}
)
"""A mark in a stream of candidates: nothing was found yet, and the clock should be checked."""


def _leaving_runs(attack: _Attack, clock: _SearchBudget) -> Iterator[Counterexample]:
    """Gives candidates that leave C, endlessly, from seeds of each pattern and ever longer runs."""
    known_ns = true_topics_known_ns(attack.variant)
    first = 1
    number = 0
    patterns = (CORNER, TURN, HOLDS, TOGETHER, MIXED, CHANCE)
    while True:
        periods, seeds = ROUNDS[min(number, len(ROUNDS) - 1 - number % 2)]
        until_ns = known_ns + periods * attack.module.period_ns
        for pattern in patterns:
            for k in range(first, first + seeds):
                seed = (pattern << 56) | k
                row = attack.run_until(attack.new_state(seed), until_ns)
                clock.runs += 1
                seen_ns = int(row["properties"][0]["first_ns"])
                if seen_ns != NEVER and seen_ns >= known_ns:
                    yield attack.new_candidate(LEAVES, seed, seen_ns, None)
                if k % 8 == 0:
                    yield _NOTHING
        first += seeds
        number += 1


def _cycling_runs(attack: _Attack, clock: _SearchBudget) -> Iterator[Counterexample]:
    """Gives candidates that repeat a state; with constant choices such runs repeat for ever."""
    if may_read_time(attack.variant, attack.index):
        return
    turn_ns = attack.variant.hyperperiod_ns
    for periods in CYCLE_LENGTHS:
        at_ns = -(-periods * attack.module.period_ns // turn_ns) * turn_ns
        for k in range(1, CYCLE_SEEDS + 1):
            seed = (CORNER << 56) | k
            state = attack.new_state(seed)
            row = attack.run_until(state, at_ns)
            began, returns = (
                _repeating_state(attack, state, row),
                int(row["modules"][attack.index]["to_ac"]),
            )
            clock.runs += 1
            for turn in range(1, CYCLE_TURNS + 1):
                row = attack.run_until(state, at_ns + turn * turn_ns)
                module_row = row["modules"][attack.index]
                if module_row["mode"] or int(module_row["to_ac"]) != returns or module_row["stale"]:
                    break
                if _repeating_state(attack, state, row) == began:
                    yield attack.new_candidate(CYCLE, seed, at_ns + turn * turn_ns, turn * turn_ns)
                    break
            yield _NOTHING


def _repeating_state(attack: _Attack, state: Any, row: Any) -> bytes:  # noqa: ANN401 - numpy
    """The bytes of topics, locals, plants and modes; equal bytes mean that a run repeats."""
    first = min(g.offset for g in attack.layout.groups)
    flags = row["components"][["oe", "latched", "had_control"]]
    modes = row["modules"][["mode", "gate_fault", "clean_needed"]]
    return bytes(state[first:]) + repr(flags.tolist()).encode() + repr(modes.tolist()).encode()


SAFETY = ("P2a", "P3", "ttf", "safer", "start", "P1c")


def enter_refutations(problem: Problem, result: ModuleResult) -> None:
    """Searches for counterexamples to undecided claims, and enters those that it finds."""
    findings = result.findings
    if problem.synthesize or problem.computed:
        return  # the DM or SC that would run is not there yet
    if any(findings[p].verdict == UNDECIDED for p in SAFETY):
        began = time.perf_counter()
        search = search_leaving_run(problem.system, problem.module.name)
        if search.found is not None:
            for name in _refuted_properties(findings, search.found):
                _enter_refutation(findings, name, search.found, time.perf_counter() - began)
        else:
            _note_runs(findings, SAFETY, search)
    if findings["P2b"].verdict == UNDECIDED:
        began = time.perf_counter()
        search = search_run_without_return(without_latches(problem.system), problem.module.name)
        if search.found is not None:
            _enter_refutation(findings, "P2b", search.found, time.perf_counter() - began)
        else:
            _note_runs(findings, ("P2b",), search)


def _refuted_properties(findings: dict[str, Finding], run: Counterexample) -> list[str]:
    """The names of the properties that a run leaving C refutes.

    By the theorem one of the unproved properties is false: P2a, if it is unproved and SC has
    control at the end; otherwise P3, because AC had control too long.
    """
    open_ = [p for p in SAFETY if findings[p].verdict == UNDECIDED]
    last = [step["modes"].get(run.module) for step in run.steps[-1:]]
    if "P2a" in open_ and (last == ["SC"] or findings["P3"].verdict == PROVED):
        return ["P2a"]
    if "P3" in open_:
        return [p for p in ("P3", "ttf") if p in open_]
    return open_[:1]


def _enter_refutation(
    findings: dict[str, Finding], name: str, run: Counterexample, seconds: float
) -> None:
    finding = findings[name]
    finding.seconds += seconds
    finding.method = "a run, replayed in the interpreter"
    end = f"{run.time_ns / 1e9:g} s"
    finding.weaken_to(
        REFUTED,
        f"a run leaves C at {end}"
        if run.shows == "leaves_safe"
        else f"a run on which SC has control for ever (it repeats itself from {end})",
        # a wider grid does not help against a run; to stay within a set may
        finding.hint if name != "P2a" or finding.hint == CLAMP else "",
    )
    finding.counterexample = run


def _note_runs(
    findings: dict[str, Finding], names: tuple[str, ...], search: RefutationSearch
) -> None:
    """Enters in undecided findings the number of runs that were tried without success."""
    note = search.hindrance or f"{search.runs:,} runs under attack found nothing"
    for name in names:
        finding = findings[name]
        if finding.verdict == UNDECIDED:
            finding.counts["runs"] = search.runs
            if finding.text != NO_CORE:  # P2a has the note then
                finding.tried.append(note)
