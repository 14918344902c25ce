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
from soter.explore.engine.coverage import coverage_of, empty_counters, progress_of
from soter.explore.model.exploration_plan import IndependentPart, loose_parts_of, parts_of, plan_of
from soter.explore.model.explorer_model import generate_model
from soter.explore.model.symmetric_blocks import SymmetricInstances
from soter.explore.search_options import (
    STATUSES,
    STEPS_MAX,
    SearchOptions,
    constant,
    knows_ends,
    reduce_bits,
)
from soter.native.cache import files_below
from soter.native.shared_library import RUNTIME, address, declarations, interface, library, opened

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from soter.core.core import CoreSystem
    from soter.core.layout import Bytes, Words
    from soter.explore.checkpoints import Saver
    from soter.explore.engine.coverage import EngineProgress, Observations
    from soter.explore.model.symmetric_blocks import Family
    from soter.language.model.system import System


HERE = Path(__file__).parent / "c"
FLAGS = ("-pthread",)
NAMED = """soter_explore_options *, soter_explore_progress *, soter_explore_result *,
soter_explore_coverage *, soter_trace_step[], soter_broken[], soter_field[], soter_family[],
uint64_t *, uint8_t *, double *"""
"""The types that a search uses; cffi parses each name once beforehand, which takes 15 ms."""
LOOK_S = 0.1
"""Seconds between two looks at how far a search is."""

S = TypeVar("S")
"""The type of a trace's steps."""


def sources() -> tuple[Path, ...]:
    """The files of the explorer's C, headers included."""
    return tuple(files_below(HERE, "*.[ch]"))


def ffi() -> Any:  # noqa: ANN401 - cffi has no types
    """The explorer's declarations, for cffi."""
    headers = (RUNTIME / "soter.h", HERE / "soter_explore.h")
    return interface(*(declarations(header) for header in headers))


@dataclass(frozen=True)
class RawChoice:
    """An answered choice: hash of the stream's name (FNV-1a), alternatives, which one."""

    stream: int
    count: int
    pick: int


@dataclass(frozen=True)
class RawStep:
    """A step of a trace; `actor` counts in `Engine.actors`, -1 at the start.

    `kind`: 0 step, 1 lost release, 2 start of an overrunning step, 3 it takes effect, 4 birth.
    """

    actor: int
    kind: int
    release_ns: int
    time_ns: int
    choices: tuple[RawChoice, ...]


@dataclass(frozen=True, kw_only=True)
class EngineSettings(SearchOptions):
    """How the engine searches: the user's options, and those that only tests and `Search` set.

    `plainly`: run every step, remember none. `go_on`: do not stop at a violation. `keep`: keep
    what is stored for `Engine.configurations`. `closes`: end where all that comes later was there
    before, if the plan is one that `repeats`.
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
    """What a search found; `status`: one of STATUSES; `broken`: (what, index) of soter_broken.

    `steps` are all of one kind: numbers of the engine (`Searched`), or names (`search.Found`).
    """

    status: str
    broken: tuple[int, int] | None
    steps: tuple[S, ...]
    states: int = 0
    transitions: int = 0
    combined: int = 0
    """How many of `transitions` combine what groups of actors do, so that no step was run."""
    runs: int = 0
    table_bytes: int = 0
    frontier_bytes: int = 0
    depth: int = 0
    seconds: float = 0.0
    covered_ns: int = 0
    """All that is observed before this time was judged; `TIME_MAX`: all there is; 0: sampling."""
    closed_ns: int = 0
    """All that comes after this time was there before; 0: that is not known."""
    closable: bool = False
    """Whether `closed_ns` was looked for, or would be before a later horizon."""
    stopped: str = ""
    """What ended it early: "interrupted" (Ctrl-C), "time" (its time was over)."""
    total_bytes: int = 0
    """The bytes of tables, frontiers and remembered steps, which `memory` bounds."""
    needed_bytes: int = 0
    """For status "no_memory" the bytes that the first tables take."""
    threads: int = 1
    """How many threads searched."""
    chooser: int = -1
    """For status "choices" the actor that asks for too many; -1: the start."""
    apart: bool = False
    """Whether its steps are only those of one part of the system, not of an execution of all."""


Searched = SearchResult[RawStep]


class Engine:
    """The explorer on one system that was flattened for a test."""

    def __init__(
        self, system: System, lowered: CoreSystem | None = None, extra: tuple[str, ...] = ()
    ) -> None:
        """`extra`: more compiler flags (tests)."""
        assert system.test is not None, f"{system.name} is no test"
        lowered = lowered or lower(system)
        self.system = system
        self.plan = plan_of(system, lowered)
        self.parts = parts_of(system, lowered, self.plan)
        self.loose = loose_parts_of(system, lowered, self.plan)
        self.generated = generate_model(system, lowered, self.plan)
        self.actors = self.plan.actors
        self.path = library(self.generated.unit, "-O2", (*FLAGS, *extra), sources())
        self.ffi = ffi()
        self.lib = opened(self.ffi, self.path)
        for name in NAMED.split(","):
            self.ffi.typeof(name.strip())
        self.model = address(self.ffi, self.path, self.generated.symbol, "const soter_model *")
        self.bits = int(self.model.bits)
        self.words = int(self.model.words)
        self.configuration_size = int(self.model.configuration_size)
        self._kept = self.ffi.NULL
        self.wanted: Callable[[], bool] = lambda: False
        """Tells whether searches should end; asked ten times a second."""
        self.seen = empty_counters(system, self.generated)
        self.equal = SymmetricInstances(system, lowered, self.generated)

    def close(self) -> None:
        """Frees the memory of kept configurations."""
        if self._kept != self.ffi.NULL:
            self.lib.soter_explore_free(self._kept)
            self._kept = self.ffi.NULL

    def take_stored(self) -> Any:  # noqa: ANN401 - cdata
        """What the last search kept; the caller has to free it (`soter_explore_free`)."""
        kept, self._kept = self._kept, self.ffi.NULL
        return kept

    # ------------------------------------------------------------ searching

    def explore(
        self,
        settings: EngineSettings,
        look: Callable[[EngineProgress], None] | None = None,
        patience_s: float = math.inf,
        saver: Saver | None = None,
    ) -> Searched:
        """Searches until the end, a bound or Ctrl-C; `look` is told ten times a second.

        After `patience_s` seconds the search ends. `saver` stores it, and may let it go on from
        there: `SoterError` D006, D012, D014.
        """
        coverage = self.coverage()

        def search(options: Any, progress: Any, result: Any, trace: Any) -> None:  # noqa: ANN401
            self.lib.soter_explore(
                self.model, options, progress, coverage, result, trace, STEPS_MAX
            )

        search_result = self._run(settings, look, search, patience_s, saver)
        self.equal.spread(self.families(settings), self.seen)
        return search_result

    def least(
        self,
        settings: EngineSettings,
        broken: tuple[int, int],
        look: Callable[[EngineProgress], None] | None = None,
        patience_s: float = math.inf,
    ) -> Searched:
        """The least trace to a violation of the same thing; its status is then `violated`.

        After `patience_s` seconds the search ends.
        """
        what = self.ffi.new("soter_broken *", {"what": broken[0], "index": broken[1]})

        def search(options: Any, progress: Any, result: Any, trace: Any) -> None:  # noqa: ANN401
            self.lib.soter_explore_least(
                self.model, options, what[0], progress, result, trace, STEPS_MAX
            )

        return self._run(settings, look, search, patience_s)

    def _run(
        self,
        settings: EngineSettings,
        look: Callable[[EngineProgress], None] | None,
        search: Callable[[Any, Any, Any, Any], None],
        patience_s: float = math.inf,
        saver: Saver | None = None,
    ) -> Searched:
        self.close()
        options = self.options(settings)
        if saver is not None:
            saver.begin(self.ffi, options)
        progress = self.ffi.new("soter_explore_progress *")
        result = self.ffi.new("soter_explore_result *")
        trace = self.ffi.new("soter_trace_step[]", STEPS_MAX)  # untouched pages cost nothing
        began = time.perf_counter()
        try:
            stopped = self.run_in_thread(
                lambda: search(options, progress, result, trace), progress, look, patience_s, saver
            )
            seconds = time.perf_counter() - began
            if saver is not None:
                saver.end(progress, result)
        finally:
            if saver is not None:
                saver.close()
        self._kept = result.kept
        return replace(self._searched(result, trace, seconds), stopped=stopped)

    def run_in_thread(
        self,
        do: Callable[[], object],
        progress: Any,  # noqa: ANN401 - cdata
        look: Callable[[EngineProgress], None] | None,
        patience_s: float,
        saver: Saver | None = None,
    ) -> str:
        """Runs `do` in a thread of its own; what ended it early, "" where nothing did."""
        failures: list[BaseException] = []
        done = threading.Event()

        def work() -> None:
            try:
                do()
            except BaseException as error:  # noqa: BLE001 - raised again below
                failures.append(error)
            finally:
                done.set()

        threading.Thread(target=work, name="soter explorer").start()
        stopped = self._await_end(done, progress, look, patience_s, saver)
        if failures:
            raise failures[0]
        return stopped

    def _await_end(
        self,
        done: threading.Event,
        progress: Any,  # noqa: ANN401 - cdata
        look: Callable[[EngineProgress], None] | None,
        patience_s: float,
        saver: Saver | None,
    ) -> str:
        """Waits for the search and returns what ended it; an interruption ends it in order.

        Not with `Thread.join`: after an interruption Python 3.11 takes the thread for ended, and
        the memory to which it still writes would be freed.
        """
        failure: BaseException | None = None
        stopped, began = "", time.perf_counter()
        while not done.is_set():
            try:
                while not done.wait(max(min(LOOK_S, patience_s), 0.001)):
                    seconds = time.perf_counter() - began
                    if not progress.stop and (self.wanted() or seconds > patience_s):
                        progress.stop, stopped = 1, "interrupted" if self.wanted() else "time"
                    if saver is not None:
                        saver.look(progress)
                    if look is not None and not progress.stop:
                        look(progress_of(progress, seconds))
            except KeyboardInterrupt:
                progress.stop, stopped = 1, "interrupted"
            except BaseException as error:  # noqa: BLE001 - raised again when the search has ended
                progress.stop = 1
                failure = failure or error
        if failure is not None:
            raise failure
        return stopped

    def options(self, s: EngineSettings) -> Any:  # noqa: ANN401 - cdata
        """The `soter_explore_options` of a search; what it points to lives until the next call."""
        known = [{"what": what, "index": index} for what, index in s.known]
        self._known = self.ffi.new("soter_broken[]", known)  # lives as long as the options
        return self.ffi.new(
            "soter_explore_options *",
            {
                "strategy": getattr(self.lib, constant(s.strategy)),
                "storage": getattr(self.lib, constant(s.storage)),
                "reduce": reduce_bits(s.reduction, between=s.between),
                "threads": s.threads,
                "memory": s.memory,
                "max_states": s.max_states,
                "max_ran": s.max_ran,
                "seed": s.seed & (2**64 - 1),
                "runs": s.runs,
                "bug_depth": s.bug_depth,
                "actors": s.part.actors if s.part else 0,
                "properties": s.part.properties if s.part else 0,
                "timeds": s.part.timeds if s.part else 0,
                "keep": s.keep,
                "plainly": s.plainly,
                "unguided": s.unguided,
                "go_on": s.go_on,
                "closes": s.closes and knows_ends(s.reduction) and self.plan.repeats,
                "known": self._known,
                "knowns": len(s.known),
                **(s.noted.options(self.ffi) if s.noted else {}),
                **self.equal.options(self.ffi, self.families(s)),
            },
        )

    def families(self, s: EngineSettings) -> tuple[Family, ...]:
        """The equal instances that a search uses.

        None where it looks for other violations than the known ones, which one instance may have
        and the other not, or where it notes what it sees for parts that a property joins.
        """
        return () if s.known or s.noted is not None else self.equal.of(s, s.part)

    def coverage(self) -> Any:  # noqa: ANN401 - cdata
        """The `soter_explore_coverage` by which the engine adds what it sees to `seen`."""
        return coverage_of(self.seen, self.ffi)

    def _searched(self, r: Any, trace: Any, seconds: float) -> Searched:  # noqa: ANN401 - cdata
        status = STATUSES[int(r.status)]
        broken = (int(r.broken.what), int(r.broken.index)) if status == "violated" else None
        return Searched(
            status=status,
            broken=broken,
            states=int(r.states),
            transitions=int(r.transitions),
            combined=int(r.combined),
            runs=int(r.runs),
            table_bytes=int(r.table_bytes),
            frontier_bytes=int(r.frontier_bytes),
            depth=int(r.depth),
            seconds=seconds,
            covered_ns=max(int(r.covered_ns), 0),
            closed_ns=int(r.closed_ns),
            closable=bool(r.closable),
            steps=tuple(self._step(trace[i]) for i in range(min(int(r.length), STEPS_MAX))),
            total_bytes=int(r.table_bytes) + int(r.frontier_bytes) + int(r.memo_bytes),
            needed_bytes=int(r.needed_bytes),
            threads=int(r.threads),
            chooser=int(r.chooser) if r.chooser < len(self.actors) else -1,
        )

    def _step(self, s: Any) -> RawStep:  # noqa: ANN401 - cdata
        choices = tuple(
            RawChoice(int(c.stream), int(c.count), int(c.pick)) for c in s.choice[0 : s.choices]
        )
        actor = int(s.actor) if s.actor < len(self.actors) else -1
        return RawStep(actor, int(s.kind), int(s.release_ns), int(s.time_ns), choices)

    # ------------------------------------------------------------ traces and configurations

    def replay(
        self, steps: Sequence[RawStep], seed: int = 0
    ) -> tuple[int, tuple[int, int] | None, npt.NDArray[np.uint8]]:
        """How many steps of a trace are possible, what the last one breaks, and configurations.

        There is a configuration after each step, (steps, configuration_size).
        """
        trace = self._raw(steps)
        configurations = np.zeros((len(steps), self.configuration_size), dtype=np.uint8)
        violates = self.ffi.new("bool *")
        broken = self.ffi.new("soter_broken *")
        possible = self.lib.soter_explore_replay(
            self.model, seed, trace, len(steps), self._pointer(configurations), violates, broken
        )
        violation = (int(broken.what), int(broken.index)) if violates[0] else None
        return int(possible), violation, configurations

    def complete(self, settings: EngineSettings, steps: Sequence[RawStep]) -> Searched | None:
        """An execution of the whole system from one of `settings.part`; None where it is none."""
        whole = self.ffi.new("soter_trace_step[]", STEPS_MAX)
        broken = self.ffi.new("soter_broken *")
        options, part = self.options(settings), self._raw(steps)
        length = self.lib.soter_explore_complete(
            self.model, options, part, len(steps), whole, STEPS_MAX, broken
        )
        if length == 0:
            return None
        made = tuple(self._step(whole[i]) for i in range(length))
        violation = (int(broken.what), int(broken.index))
        return Searched(status="violated", broken=violation, depth=length, steps=made)

    def violated_at_start(self, patience_s: float = math.inf) -> bool:
        """Whether a start, before any step, violates a property, deadlines aside; True if stopped.

        It is seen only where others step before the part that the property looks at: then parts
        must not be explored alone.
        """
        progress = self.ffi.new("soter_explore_progress *")
        verdicts: list[bool] = []

        def look() -> None:
            verdicts.append(bool(self.lib.soter_explore_starts_broken(self.model, progress)))

        return bool(self.run_in_thread(look, progress, None, patience_s)) or verdicts[0]

    def _raw(self, steps: Sequence[RawStep]) -> Any:  # noqa: ANN401 - cdata
        trace = self.ffi.new("soter_trace_step[]", max(len(steps), 1))
        for raw, s in zip(trace, steps, strict=False):
            raw.actor = s.actor if s.actor >= 0 else 2**32 - 1
            raw.kind, raw.release_ns, raw.time_ns = s.kind, s.release_ns, s.time_ns
            raw.choices = len(s.choices)
            for to, choice in zip(raw.choice, s.choices, strict=False):
                to.stream, to.count, to.pick = choice.stream, choice.count, choice.pick
        return trace

    def configurations(self) -> Bytes:
        """The configurations that the last search stored, (states, configuration_size), if kept."""
        if self._kept == self.ffi.NULL:
            return np.zeros((0, self.configuration_size), dtype=np.uint8)
        count = int(self.lib.soter_explore_kept(self.model, self._kept, self.ffi.NULL))
        configurations = np.zeros((count, self.configuration_size), dtype=np.uint8)
        self.lib.soter_explore_kept(self.model, self._kept, self._pointer(configurations))
        return configurations

    def packed(self, configuration: Bytes) -> Words:
        """Packs a configuration into words: (configuration_size,) -> (words,)."""
        words = np.zeros(self.words, dtype=np.uint64)
        to = self.ffi.cast("uint64_t *", words.ctypes.data)
        self.model.pack(self._pointer(configuration), to)
        return words

    def unpack(self, words: Words, configuration: Bytes) -> None:
        """Reads packed words, (words,), into a configuration that was started once."""
        of = self.ffi.cast("uint64_t *", words.ctypes.data)
        self.model.unpack(of, self._pointer(configuration))

    def _pointer(self, array: npt.NDArray[Any]) -> Any:  # noqa: ANN401 - cdata
        return self.ffi.cast("void *", array.ctypes.data)
