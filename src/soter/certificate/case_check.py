"""The claims of one case, a combination of parameter values, asked of its groups in order.

Purpose: `CaseCheck` asks each claim of each group, and shows the tasks that come of it.
`proved_claims` says what an entry claims, `check_static_claims` compares P1 with the program.
`TaskProcesses` deals tasks out to processes, which tell what came of each. They see what there was
when they were forked; only answers come back. There is no thread: this process may fork again.
`require_defined_rates` shows, over the whole grid at once, each obligation of the rates (a divisor
is not 0, an index is there, an assertion holds) that no group shows cell by cell.
Non-goals: how a group shows a claim (`grid/grid_group.py`), certificates (`rechecker.py`).

The argument: a state of the module is one of each group. Each part of `safe` is the share of one
group, and each group shows that SC keeps its K there; of `ttf` and `safer` each shows that they let
AC have control only where its R(H) is. What a group asks is a list of tasks, of which each one has
to answer that nothing went wrong.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import BrokenExecutor
from contextlib import closing
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from typing import TYPE_CHECKING, Any

from soter.certificate.cell_predicates import cells_published_in_set, certain_cells
from soter.certificate.extras import extras
from soter.certificate.reading.case_model import (
    CaseModel,
    new_command_terms,
)
from soter.certificate.reading.folder import FREE, OF_SETS
from soter.certificate.reading.module_facts import (
    bounded_topics,
    const_value,
)
from soter.certificate.reading.module_times import DELAYS
from soter.certificate.reading.symbolic_values import scalar_leaves
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.compile_terms import all_certain
from soter.certificate.terms.terms import input_atoms
from soter.diagnostics.current_phase import share_done
from soter.workers.child_process import end_with_parent

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Sequence
    from multiprocessing.connection import Connection

    from soter.certificate.cell_sets import Axes, Cells
    from soter.certificate.grid.grid_group import GridCheck, GridGroup, Task
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model import typed
    from soter.language.model.system import Module, System

    Extents = tuple[tuple[float, float], ...]

CLAIMS = ("P1a", "P1b", "P1c", "P2a", "P2b", "P3", "ttf", "safer", "start", "failsafe")
ELSEWHERE = ("DM",)
"""Claims of a certificate that are not confirmed here: the re-checker looks at no compiled code."""
PROVED = "proved"
VERDICTS = ("proved", "assumed", "undecided", "refuted")


def proved_claims(claimed: object) -> set[str]:
    """The claims that are called proved; RejectedError for an unknown name, or no proved claim."""
    if not isinstance(claimed, dict):
        raise RejectedError("`claims` is not as it should be")
    for name, verdict in claimed.items():
        if name not in (*CLAIMS, *ELSEWHERE) or verdict not in VERDICTS:
            raise RejectedError(f"the claim `{name}: {verdict}` is unknown")
    claims = {name for name, verdict in claimed.items() if verdict == PROVED and name in CLAIMS}
    if not claims:
        raise RejectedError("nothing is claimed")
    return claims


def check_module_claims(system: System, module: Module, claims: dict[str, str]) -> None:
    """Raises RejectedError if P1a or P1b is false, or P2b for a DM that never returns control."""
    ac, sc = (system.components[i] for i in (module.ac, module.sc))
    latch = module.symbol.latch
    if claims.get("P2b") == PROVED and latch is not None and latch.topic is None:
        raise RejectedError("P2b: the DM never gives control back (`returns never`)")
    if claims.get("P1a") == PROVED and max(ac.period_ns, sc.period_ns) > module.period_ns:
        raise RejectedError("P1a: a controller is slower than the DM")
    outputs = [{*c.writes} for c in (ac, sc) if c.node]
    same = module.outputs and all(of == set(module.outputs) for of in outputs)
    if claims.get("P1b") == PROVED and not same:
        raise RejectedError("P1b: AC and SC do not publish the same topics")


def p1c_verdict(facts: Facts) -> str:
    """The verdict on P1c, H apart: "proved" if it rests on declared times alone, else "assumed"."""
    verify = facts.symbol.verify
    declared = all(getattr(verify, name) is not None for _, name in DELAYS.values())
    return "proved" if declared and not facts.ways.undeclared else "assumed"


def check_static_claims(facts: Facts, claims: dict[str, str]) -> None:
    """Compares P1a, P1b, P1c with the program; raises RejectedError if a claim says too much."""
    check_module_claims(facts.flying, facts.flying_module, claims)
    if claims.get("P1c") not in (PROVED, "assumed"):
        return
    if facts.times["H_ns"] < facts.times["H_star_ns"]:
        raise RejectedError("P1c: the horizon is shorter than H*")
    seen = {r.name for r in facts.setting.by_dm}
    blind = [r.name for r in facts.setting.by_sc if r.name not in seen]
    if blind and facts.times["H_ns"] < facts.start_ns:
        # an "AC" verdict shows nothing of what SC alone reads: only from h_0 on it is there
        raise RejectedError(f"P1c: `{blind[0]}`, which the DM does not read, may come after H")
    if claims["P1c"] == PROVED != p1c_verdict(facts):
        raise RejectedError("P1c rests on times that are not declared: it is assumed, not proved")


def can_fork() -> bool:
    """Whether this operating system can fork processes."""
    return "fork" in multiprocessing.get_all_start_methods()


class TaskProcesses:
    """Processes that share the tasks 0, 1, ...; each process calls `answer` on its tasks."""

    def __init__(self, tasks: int, answer: Callable[[int], Any], workers: int) -> None:
        fork = multiprocessing.get_context("fork")
        self._left = set(range(tasks))
        self._processes: list[Any] = []
        self._answers: list[Connection] = []
        for first in range(workers):
            ours, theirs = fork.Pipe(duplex=False)
            arguments = range(first, tasks, workers), answer, theirs, os.getpid()
            process = fork.Process(target=_answer_tasks, args=arguments)
            process.start()
            theirs.close()
            self._processes.append(process)
            self._answers.append(ours)

    def answers(self) -> Generator[tuple[int, Any]]:
        """Yields each finished task with its answer; raises an error that a process raised.

        Raises BrokenExecutor if a process ended too early. At the end all processes are ended.
        """
        try:
            while self._left:
                ready = wait(self._answers)
                for side in [x for x in self._answers if x in ready]:
                    try:
                        number, answer = side.recv()
                    except EOFError:
                        self._answers.remove(side)
                        continue
                    if isinstance(answer, BaseException):
                        raise answer
                    self._left.remove(number)
                    yield number, answer
                if self._left and not self._answers:
                    raise BrokenExecutor("a process of the re-check was ended")
        finally:
            self.end_processes()

    def end_processes(self) -> None:
        """Ends all processes without waiting for their tasks."""
        for process in self._processes:
            process.kill()
            process.join()
            process.close()
        for side in self._answers:
            side.close()
        self._processes, self._answers = [], []


def _answer_tasks(tasks: range, answer: Callable[[int], Any], to: Connection, parent: int) -> None:
    end_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who is interrupted ends this one
    for k in tasks:
        try:
            to.send((k, answer(k)))
        except Exception as error:  # noqa: BLE001  whoever asked is told
            to.send((k, error))
            return


@dataclass(eq=False)
class CaseCheck:
    """Checks the claims about one combination of parameter values, for all groups of states."""

    model: CaseModel
    groups: Sequence[GridGroup]
    claims: set[str]
    entry: dict[str, Any]
    workers: int
    lawful: Sequence[Cells] | None = None
    """K_fs of each group, where SC is to keep the state in what the fail-safe law keeps."""
    checks: list[GridCheck] = field(default_factory=list)
    tasks: list[Task] = field(default_factory=list)
    done: float = 0.0
    """The work of the tasks that are done, in the unit of `Task`."""

    def show_claims(self) -> None:
        """Collects and runs the tasks that show the claims; raises RejectedError if one fails."""
        self._collect_tasks()
        self._run_tasks()

    def _collect_tasks(self) -> None:
        facts, claims = self.model.facts, self.claims
        lawful = [None] * len(self.groups) if self.lawful is None else self.lawful
        pairs = zip(self.groups, lawful, strict=True)
        self.checks = [g.make_check(self.model, kept) for g, kept in pairs]
        if facts.unbounded:
            extras.left_out_states.require_unread_states(self.model, len(self.groups))
        each = zip(self.groups, self.checks, strict=True)
        require_defined_rates(self.model, [g.states for g, c in each if c.shows_rates_defined])
        if claims & OF_SETS:
            self._add_core_tasks()
        if claims & FREE:
            self._add_tasks(c.free_tasks(facts.times["H_ns"]) for c in self.checks)
            if facts.is_computed:
                self._add_tasks(c.tasks_for_levels(facts.ns_between_verdicts) for c in self.checks)
            else:
                self._add_predicate_tasks()
        if "P2b" in claims:
            self._add_return_tasks()
        if "start" in claims:
            self._add_start_tasks()

    def _add_tasks(self, tasks: Iterable[Iterable[Task]]) -> None:
        for some in tasks:
            self.tasks += some

    def _certain_cells(self, expr: typed.TypedExpr, *, errors: bool) -> list[Cells]:
        parts = [g.tables for g in self.groups]
        inside = narrowed_extents(self.model.extents, parts)
        model = CaseModel(self.model.facts, self.model.parameter, inside)
        return certain_cells(model, parts, expr, errors=errors)

    def _add_core_tasks(self) -> None:
        """Adds the tasks about K: SC leads back to K, and keeps `safe` and the sets of topics."""
        facts = self.model.facts
        shown = self._certain_cells(facts.symbol.safe, errors=False)
        for check, cells in zip(self.checks, shown, strict=True):
            check.note_safe_cells(cells)
        parts = [g.tables for g in self.groups]
        for topic in bounded_topics(facts):
            shown = cells_published_in_set(self.model, parts, topic)
            for check, cells in zip(self.checks, shown, strict=True):
                check.keep_in_topic_set(topic, cells)
        facts.in_sets = tuple(bounded_topics(facts))
        self._add_tasks(c.core_tasks() for c in self.checks)

    def _add_predicate_tasks(self) -> None:
        """Adds the tasks of P3: each state where `ttf` may be false or `safer` true is in R(H)."""
        symbol = self.model.facts.symbol
        predicates = ("ttf", self.model.facts.ttf, False), ("safer", symbol.safer, True)
        for name, expr, admits in predicates:
            if not self.claims & {"P3", name}:
                continue
            if expr is None:
                raise NotRecheckedError("computed predicates are not rechecked yet")
            self._add_tasks(c.predicate_tasks(name, expr, admits=admits) for c in self.checks)

    def _add_return_tasks(self) -> None:
        """Adds the tasks of P2b: from all of K SC leads through W to Q, and keeps Q in `safer`."""
        self._compare_recover_time()
        safer, count = self.model.facts.symbol.safer, len(self.checks)
        calm = [None] * count if safer is None else self._certain_cells(safer, errors=True)
        self._add_tasks(c.return_tasks(cells) for c, cells in zip(self.checks, calm, strict=True))

    def _compare_recover_time(self) -> None:
        """Raises RejectedError if SC may return later, by any group, than the program says."""
        facts, wanted = self.model.facts, self.entry["recover_ns"]
        declared = facts.symbol.verify.recover
        if declared is None:
            if wanted is not None:
                raise RejectedError("the program declares no time to return")
            return
        if wanted != const_value(facts, declared):
            raise RejectedError("the time to return is another one in the program")
        longest = max((c.holds_to_return for c in self.checks), default=0)
        bound = longest * facts.times["delta_ns"] + facts.jitter_ns  # a_N is late by j at most
        bound += facts.verdict_delay_ns
        if bound > wanted:
            raise RejectedError("SC may take longer to return than the program allows")

    def _add_start_tasks(self) -> None:
        """Adds the tasks that initial states stay in K until SC acts, under any earlier command."""
        facts = self.model.facts
        pairs = zip(facts.parameters, self.model.parameter, strict=True)
        if not all(v in p.begins for p, v in pairs):
            return  # no run starts with these values
        self._add_tasks(c.start_tasks(facts.start_ns) for c in self.checks)
        for c in facts.controls:
            if not c.low <= scalar_leaves(facts.system.topics[c.owner].default)[c.leaf] <= c.high:
                raise RejectedError(f"the default of `{c.name}` is outside its set")

    def _run_tasks(self) -> None:
        self.tasks = self.tasks[::-1]  # the long ones first: ranks are asked for last
        workers, times = min(self.workers, len(self.tasks)), self.model.facts.times

        def task_result(k: int) -> tuple[str, int]:
            failed = self.tasks[k][0]()
            delays = [c.delay_ns for check in self.checks for c in check.chain_checks]
            return failed, min(delays, default=times["d_ns"])

        answers: Generator[tuple[int, Any]] = ((k, task_result(k)) for k in range(len(self.tasks)))
        if workers > 1 and can_fork():
            answers = TaskProcesses(len(self.tasks), task_result, workers).answers()
        with closing(answers):  # processes end where a claim fails
            for k, (failed, delay) in answers:
                times["d_ns"] = min(times["d_ns"], delay)  # what is shown of older reads holds, too
                self._note_answer(k, failed)

    def _note_answer(self, k: int, failed: str) -> None:
        if failed != "":  # only an empty text says that the task showed its part
            case = ", ".join(
                f"{p.name} = {v}"
                for p, v in zip(self.model.facts.parameters, self.model.parameter, strict=True)
            )
            raise RejectedError(failed + (f" ({case})" if case else ""))
        self.done += self.tasks[k][1]
        share_done(self.done / sum(work for _, work in self.tasks))


def require_defined_rates(model: CaseModel, groups: Sequence[Sequence[int]]) -> None:
    """Raises NotRecheckedError if a rate may be undefined on the grid and no group checks it.

    `groups`: the states of each group whose check demands defined rates, as its flow is not linear
    and runs could leave its grid. An obligation on states of several groups is left to one of
    these; there the other states range over their grids.
    """
    if model.facts.kind == "map":
        return  # a map's obligations are demanded of every cell
    terms, states = model.new_terms()
    model.rates(terms, states, new_command_terms(model.facts, terms))
    shown = [{states[i].atom for i in members} for members in groups]
    left = []
    for truth in terms.obligations:
        inputs = input_atoms(terms, [truth])
        if any(inputs & members_of_group for members_of_group in shown):
            continue
        if shown and not inputs & {x.atom for x in states}:
            continue  # about commands and disturbances alone: every such group asks it
        left.append(truth)
    if not all_certain(terms, left):
        raise NotRecheckedError("a plant's equation that is not defined everywhere on the grid")


def narrowed_extents(extents: Extents, parts: Iterable[Axes]) -> Extents:
    """The ranges of all states; a state in `parts` gets the ends of its grid."""
    ends = list(extents)
    for part in parts:
        for state, edges in zip(part.states, part.grid.edges, strict=True):
            ends[state] = edges[0], edges[-1]
    return tuple(ends)
