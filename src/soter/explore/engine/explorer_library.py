"""The explorer as a shared library: a system's generated C, its model and `soter_explore*.c`.

Purpose: an `Engine` compiles them together, once for each content, and calls the explorer through
cffi, with plain numbers in and out. A search runs in a thread of its own, so that Ctrl-C, or a
caller that wants it to end, ends it in order, with what it has found until then.
Non-goals: names of actors and streams, verdicts, reports (`search.py`, `explore/command.py`).
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from soter.core.steps import lower
from soter.explore.engine.coverage import coverage_struct, empty_counters, read_progress
from soter.explore.model.exploration_plan import (
    IndependentPart,
    find_joined_parts,
    find_parts,
    make_plan,
)
from soter.explore.model.explorer_model import generate_model
from soter.explore.search_options import (
    CHOICES_MAX,
    STATUSES,
    STEPS_MAX,
    SearchOptions,
    c_constant,
    reduction_bits,
    stores_only_ends,
)
from soter.native.c_interface import address, declarations, interface, open_library
from soter.native.cache import files_below
from soter.native.shared_library import RUNTIME, library

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from soter.core.core import CoreSystem
    from soter.explore.engine.coverage import EngineProgress, Observations
    from soter.language.model.system import System

    Steps = npt.NDArray[np.void]
    """(n,) of `STEP`."""


C_FOLDER = Path(__file__).parent / "c"
FLAGS = ("-pthread",)
C_TYPES = """soter_explore_options *, soter_explore_progress *, soter_explore_result *,
soter_explore_coverage *, soter_trace_step[], soter_broken[], uint64_t *, uint8_t *"""
"""The types that a search uses; cffi parses each name once beforehand, which takes 15 ms."""
LOOK_S = 0.1
"""Seconds between two looks at the progress of a search."""

S = TypeVar("S")
"""The type of a trace's steps."""


def c_sources() -> tuple[Path, ...]:
    """The C files of the explorer, headers included."""
    return tuple(files_below(C_FOLDER, "*.[ch]"))


def explorer_interface() -> Any:  # noqa: ANN401 - cffi has no types
    """The cffi object with the declarations of the explorer's C."""
    headers = (RUNTIME / "soter.h", C_FOLDER / "soter_explore.h")
    return interface(*(declarations(header) for header in headers))


@dataclass(frozen=True)
class RawChoice:
    """An answered choice: the FNV-1a hash of its stream, the number of alternatives, the pick."""

    stream: int
    count: int
    pick: int


@dataclass(frozen=True)
class RawStep:
    """A step of a trace; `actor` is an index into `Engine.actors`, or -1 at the start.

    `kind`: 0 step, 1 lost release, 2 start of a step that overruns, 3 its effect, 4 birth.
    """

    actor: int
    kind: int
    release_ns: int
    time_ns: int
    choices: tuple[RawChoice, ...]


NOBODY = 2**32 - 1
"""The `actor` of the start."""
CHOICE = np.dtype([("stream", "u8"), ("count", "u4"), ("pick", "u4")], align=True)
STEP = np.dtype(
    [
        ("actor", "u4"),
        ("kind", "u4"),
        ("release", "i8"),
        ("time", "i8"),
        ("choices", "u4"),
        ("choice", CHOICE, (CHOICES_MAX,)),
    ],
    align=True,
)
"""`soter_trace_step`."""


def array_pointer(ffi: Any, kind: str, array: npt.NDArray[Any]) -> Any:  # noqa: ANN401 - cffi
    """The address of the first element of an array of any shape, as the C type `kind`."""
    return ffi.cast(kind, array.ctypes.data)


def steps_to_array(steps: Sequence[RawStep]) -> Steps:
    """The steps as an array of `STEP` records, (n,)."""
    made = np.zeros(len(steps), dtype=STEP)
    for row, step in zip(made, steps, strict=True):
        row["actor"] = step.actor if step.actor >= 0 else NOBODY
        row["kind"], row["release"], row["time"] = step.kind, step.release_ns, step.time_ns
        row["choices"] = len(step.choices)
        for place, choice in enumerate(step.choices):
            row["choice"][place] = (choice.stream, choice.count, choice.pick)
    return made


def array_to_steps(made: Steps) -> tuple[RawStep, ...]:
    """The steps in an array of `STEP` records, (n,)."""
    raw_steps = []
    for row in made:
        asked = row["choice"][: int(row["choices"])].tolist()
        actor = -1 if row["actor"] == NOBODY else int(row["actor"])
        choices = tuple([RawChoice(*c) for c in asked])
        raw_steps.append(
            RawStep(actor, int(row["kind"]), int(row["release"]), int(row["time"]), choices)
        )
    return tuple(raw_steps)


@dataclass(frozen=True, kw_only=True)
class EngineSettings(SearchOptions):
    """The settings of the engine: the user's options, and those that tests and `Search` set.

    `plainly`: run every step, remember no step. `go_on`: do not stop at a violation. `keep`: keep
    the stored configurations until the next search. `closes`: end as soon as all later
    configurations came before, if the plan `repeats`.
    """

    keep: bool = False
    plainly: bool = False
    go_on: bool = False
    closes: bool = False
    part: IndependentPart | None = None
    """The only part of the system to search; None: all of it."""
    known: tuple[tuple[int, int], ...] = ()
    """Violations (what, index) at which a search does not stop: it looks for others."""
    noted: Observations | None = None
    max_ran: int = 0
    """The most steps that are run and not combined of others; 0: no bound."""
    between: bool = False
    """Whether configurations between ends of instants are stored, whatever `reduction` says."""


@dataclass(frozen=True, kw_only=True)
class SearchResult(Generic[S]):
    """The result of a search; `status`: from STATUSES; `broken`: (what, index) of soter_broken.

    In `Searched`, `steps` have numbers of the engine; in `search.Found`, names of the program.
    """

    status: str
    broken: tuple[int, int] | None
    steps: tuple[S, ...]
    states: int = 0
    transitions: int = 0
    combined: int = 0
    """How many of `transitions` combine known steps of groups of actors, and were not run."""
    runs: int = 0
    table_bytes: int = 0
    frontier_bytes: int = 0
    depth: int = 0
    seconds: float = 0.0
    covered_ns: int = 0
    """Everything observable before this time was judged; `TIME_MAX`: all times; 0: sampling."""
    closed_ns: int = 0
    """Every configuration after this time came before; 0: that is not known."""
    closable: bool = False
    """Whether `closed_ns` was looked for, or would be before a later horizon."""
    stopped: str = ""
    """The reason for an early end: "interrupted" (Ctrl-C), "time" (its time was over), or ""."""
    total_bytes: int = 0
    """The bytes of tables, frontiers and remembered steps, which `memory` bounds."""
    needed_bytes: int = 0
    """For status "no_memory" the bytes that the first tables take."""
    threads: int = 1
    """How many threads searched."""
    chooser: int = -1
    """For status "choices" the actor that asks for too many; -1: the start."""
    apart: bool = False
    """Whether only one part of the system shows the violation, and no execution of all of it."""


Searched = SearchResult[RawStep]


class Engine:
    """The compiled explorer for one system that was flattened for a test."""

    def __init__(
        self, system: System, lowered: CoreSystem | None = None, extra: tuple[str, ...] = ()
    ) -> None:
        """Compiles the explorer for the system; `extra`: more compiler flags, for tests."""
        assert system.test is not None, f"{system.name} is no test"
        lowered = lowered or lower(system)
        self.system = system
        self.plan = make_plan(system, lowered)
        self.parts = find_parts(system, lowered, self.plan)
        self.joined_parts = find_joined_parts(system, lowered, self.plan)
        self.generated = generate_model(system, lowered, self.plan)
        self.actors = self.plan.actors
        self.path = library(self.generated.unit, "-O2", (*FLAGS, *extra), c_sources())
        self.ffi = explorer_interface()
        self.lib = open_library(self.ffi, self.path)
        for name in C_TYPES.split(","):
            self.ffi.typeof(name.strip())
        assert STEP.itemsize == self.ffi.sizeof("soter_trace_step"), STEP
        assert STEP.fields is not None
        assert STEP.fields["choice"][1] == self.ffi.offsetof("soter_trace_step", "choice"), STEP
        self.model = address(self.ffi, self.path, self.generated.symbol, "const soter_model *")
        self.bits = int(self.model.bits)
        self.words = int(self.model.words)
        self.configuration_size = int(self.model.configuration_size)
        self._kept = self.ffi.NULL
        self.should_stop: Callable[[], bool] = lambda: False
        """Says whether searches should end; called ten times a second."""
        self.seen = empty_counters(system, self.generated)

    def close(self) -> None:
        """Frees the configurations that the last search kept."""
        if self._kept != self.ffi.NULL:
            self.lib.soter_explore_free(self._kept)
            self._kept = self.ffi.NULL

    def take_stored(self) -> Any:  # noqa: ANN401 - cdata
        """Hands over the kept configurations; the caller frees them with `soter_explore_free`."""
        kept, self._kept = self._kept, self.ffi.NULL
        return kept

    # ------------------------------------------------------------ searching

    def explore(
        self,
        settings: EngineSettings,
        look: Callable[[EngineProgress], None] | None = None,
        patience_s: float = math.inf,
    ) -> Searched:
        """Searches to the end, to a bound, to Ctrl-C, or for `patience_s` seconds.

        `look` receives the progress ten times a second.
        """
        coverage = self.coverage()

        def search(options: Any, progress: Any, result: Any, trace: Any) -> None:  # noqa: ANN401
            self.lib.soter_explore(
                self.model, options, progress, coverage, result, trace, STEPS_MAX
            )

        return self._run_search(settings, look, search, patience_s)

    def find_shortest_trace(
        self,
        settings: EngineSettings,
        broken: tuple[int, int],
        look: Callable[[EngineProgress], None] | None = None,
        patience_s: float = math.inf,
    ) -> Searched:
        """Searches the shortest trace to the violation `broken` for at most `patience_s` seconds.

        The status is `violated` if it found the trace.
        """
        violation = self.ffi.new("soter_broken *", {"what": broken[0], "index": broken[1]})

        def search(options: Any, progress: Any, result: Any, trace: Any) -> None:  # noqa: ANN401
            self.lib.soter_explore_least(
                self.model, options, violation[0], progress, result, trace, STEPS_MAX
            )

        return self._run_search(settings, look, search, patience_s)

    def _run_search(
        self,
        settings: EngineSettings,
        look: Callable[[EngineProgress], None] | None,
        search: Callable[[Any, Any, Any, Any], None],
        patience_s: float = math.inf,
    ) -> Searched:
        self.close()
        options = self.option_struct(settings)
        progress = self.ffi.new("soter_explore_progress *")
        result = self.ffi.new("soter_explore_result *")
        trace = self.ffi.new("soter_trace_step[]", STEPS_MAX)  # untouched pages cost nothing
        began = time.perf_counter()
        stopped = self.run_in_thread(
            lambda: search(options, progress, result, trace), progress, look, patience_s
        )
        seconds = time.perf_counter() - began
        self._kept = result.kept
        return replace(self._read_result(result, trace, seconds), stopped=stopped)

    def run_in_thread(
        self,
        do: Callable[[], object],
        progress: Any,  # noqa: ANN401 - cdata
        look: Callable[[EngineProgress], None] | None,
        patience_s: float,
    ) -> str:
        """Runs `do` in a thread; returns why it ended early ("interrupted", "time"), or ""."""
        failures: list[BaseException] = []
        done = threading.Event()

        def run_to_end() -> None:
            try:
                do()
            except BaseException as error:  # noqa: BLE001 - raised again below
                failures.append(error)
            finally:
                done.set()

        threading.Thread(target=run_to_end, name="soter explorer").start()
        stopped = self._await_end(done, progress, look, patience_s)
        if failures:
            raise failures[0]
        return stopped

    def _await_end(
        self,
        done: threading.Event,
        progress: Any,  # noqa: ANN401 - cdata
        look: Callable[[EngineProgress], None] | None,
        patience_s: float,
    ) -> str:
        """Waits for the thread, even after Ctrl-C; returns the reason for an early end, or "".

        It does not call `Thread.join`: after an interruption Python 3.11 takes the thread for
        ended, and would free the memory to which the thread still writes.
        """
        failure: BaseException | None = None
        stopped, began = "", time.perf_counter()
        while not done.is_set():
            try:
                while not done.wait(max(min(LOOK_S, patience_s), 0.001)):
                    seconds = time.perf_counter() - began
                    if not progress.stop and (self.should_stop() or seconds > patience_s):
                        progress.stop, stopped = 1, "interrupted" if self.should_stop() else "time"
                    if look is not None and not progress.stop:
                        look(read_progress(progress, seconds))
            except KeyboardInterrupt:
                progress.stop, stopped = 1, "interrupted"
            except BaseException as error:  # noqa: BLE001 - raised again when the search has ended
                progress.stop = 1
                failure = failure or error
        if failure is not None:
            raise failure
        return stopped

    def option_struct(self, settings: EngineSettings) -> Any:  # noqa: ANN401 - cdata
        """The `soter_explore_options` of a search; its pointers are valid until the next call."""
        only_ends = stores_only_ends(settings.reduction)
        known = [{"what": kind, "index": index} for kind, index in settings.known]
        self._known = self.ffi.new("soter_broken[]", known)  # lives as long as the options
        return self.ffi.new(
            "soter_explore_options *",
            {
                "strategy": getattr(self.lib, c_constant(settings.strategy)),
                "storage": getattr(self.lib, c_constant(settings.storage)),
                "reduce": reduction_bits(settings.reduction, between=settings.between),
                "threads": settings.threads,
                "memory": settings.memory,
                "max_states": settings.max_states,
                "max_ran": settings.max_ran,
                "seed": settings.seed & (2**64 - 1),
                "runs": settings.runs,
                "actors": settings.part.actors if settings.part else 0,
                "properties": settings.part.properties if settings.part else 0,
                "timeds": settings.part.timeds if settings.part else 0,
                "keep": settings.keep,
                "plainly": settings.plainly,
                "go_on": settings.go_on,
                "closes": settings.closes and self.plan.repeats and only_ends,
                "known": self._known,
                "knowns": len(settings.known),
                **(settings.noted.option_fields(self.ffi) if settings.noted else {}),
            },
        )

    def coverage(self) -> Any:  # noqa: ANN401 - cdata
        """The `soter_explore_coverage` by which the engine adds what it sees to `seen`."""
        return coverage_struct(self.seen, self.ffi)

    def _read_result(self, result: Any, trace: Any, seconds: float) -> Searched:  # noqa: ANN401 - cdata
        status = STATUSES[int(result.status)]
        violation = result.broken
        broken = (int(violation.what), int(violation.index)) if status == "violated" else None
        return Searched(
            status=status,
            broken=broken,
            states=int(result.states),
            transitions=int(result.transitions),
            combined=int(result.combined),
            runs=int(result.runs),
            table_bytes=int(result.table_bytes),
            frontier_bytes=int(result.frontier_bytes),
            depth=int(result.depth),
            seconds=seconds,
            covered_ns=max(int(result.covered_ns), 0),
            closed_ns=int(result.closed_ns),
            closable=bool(result.closable),
            steps=self._steps_in_trace(trace, min(int(result.length), STEPS_MAX)),
            total_bytes=int(result.table_bytes)
            + int(result.frontier_bytes)
            + int(result.memo_bytes),
            needed_bytes=int(result.needed_bytes),
            threads=int(result.threads),
            chooser=int(result.chooser) if result.chooser < len(self.actors) else -1,
        )

    # ------------------------------------------------------------ traces

    def _steps_in_trace(self, trace: Any, length: int) -> tuple[RawStep, ...]:  # noqa: ANN401 - cdata
        return array_to_steps(np.frombuffer(self.ffi.buffer(trace), STEP, length))

    def complete_trace(self, settings: EngineSettings, steps: Sequence[RawStep]) -> Searched | None:
        """Extends an execution of `settings.part` to all of the system; None if impossible."""
        trace = self.ffi.new("soter_trace_step[]", STEPS_MAX)
        broken = self.ffi.new("soter_broken *")
        options, part = self.option_struct(settings), steps_to_array(steps)
        start = array_pointer(self.ffi, "soter_trace_step *", part)
        length = self.lib.soter_explore_complete(
            self.model, options, start, len(steps), trace, STEPS_MAX, broken
        )
        if length == 0:
            return None
        made, violation = self._steps_in_trace(trace, length), (broken.what, broken.index)
        return Searched(status="violated", broken=violation, depth=length, steps=made)

    def is_violated_at_start(self, patience_s: float = math.inf) -> bool:
        """Whether a start violates a property before any step; True also if the search was stopped.

        Deadlines do not count. If a start does, parts are not explored alone: they would miss such
        a violation if another part steps before the part that the property reads.
        """
        progress = self.ffi.new("soter_explore_progress *")
        verdicts: list[bool] = []

        def judge_starts() -> None:
            verdicts.append(bool(self.lib.soter_explore_starts_broken(self.model, progress)))

        return bool(self.run_in_thread(judge_starts, progress, None, patience_s)) or verdicts[0]
