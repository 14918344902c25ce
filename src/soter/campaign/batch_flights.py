"""Flights of one system in compiled batches: their events, their digests, their last states.

Purpose: `Flyer` flies a recipe through `c/soter_batch.c`; `Fleet` does so for a system.
Flights whose C may keep something from call to call have processes of their own (`soter_apart.c`).
Non-goals: statistics (`statistics.py`), workers and files (`store.py`, `fly_campaign.py`).
"""

from __future__ import annotations

import mmap
import os
import signal
import threading
from dataclasses import replace
from functools import partial
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.campaign.recipe import make_recipe
from soter.campaign.store import FlightOutcome, MetricSample
from soter.core.steps import lower
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.evaluate.arithmetic import require_default_float_rules
from soter.language.load.named_files import POLICIES
from soter.native.c_interface import address, declarations, interface, open_library
from soter.native.cache import cached_folder, digest
from soter.native.compiler import FAST, compile_with, find_compiler, vector_flags
from soter.native.kept_state import why_input_is_unknown
from soter.native.shared_library import (
    FAULTS,
    KERNEL,
    LIBRARY,
    REPORT,
    RUNTIME,
    c_texts,
    include_flags,
    library,
    library_flags,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy.typing as npt

    from soter.campaign.recipe import Recipe
    from soter.core.core import CoreSystem
    from soter.language.model.system import Component, System

BATCH = Path(__file__).resolve().parent / "c" / "soter_batch.c"
APART = BATCH.with_name("soter_apart.c")
ENGINE = (BATCH, BATCH.with_suffix(".h"))
COMPILED_WITH = (*ENGINE, RUNTIME / "soter_sha256.c", RUNTIME / "soter_sha256.h")
"""The C files that are compiled beside a program and the kernel."""
TO_SC, TO_AC, VIOLATED, LATCHED = range(4)
EPISODE_NS = 2_000_000_000
"""Disengagements of a module that lie no further apart are one episode."""
EVENT = np.dtype([("time", "<i8"), ("kind", "<u4"), ("index", "<u4")])
LOOK = np.dtype([("count", "<u4"), ("_", "<u4"), ("sum", "<f8"), ("least", "<f8"), ("most", "<f8")])
SPARE = 3
"""How many states a batch needs besides one for each flight."""
CHANGED, UNLOADED = -2, -3
"""`SOTER_APART_CHANGED` and `SOTER_APART_UNLOADED` of `soter_apart.h`."""
MODULES_MAX = 64
"""With more modules than that, saves cannot be counted."""
ROOM = 1 << 14
BATCH_BYTES = 1 << 22
"""Bytes of last states in one call."""
AT_ONCE = 32
"""Flights in one call at most: between calls the campaign can be stopped."""


class Flyer:
    """A compiled recipe that is flown under many seeds; threads may call `fly` at once."""

    def __init__(self, recipe: Recipe) -> None:
        """Compiles the recipe, or takes it from the cache."""
        self.recipe, self.dtype = recipe, recipe.dtype
        self.until_ns, self.horizon_ns = recipe.until_ns, recipe.horizon_ns
        unit = recipe.unit
        path = library(unit, recipe.optimise, (*FAST, *vector_flags()), COMPILED_WITH)
        headers = (RUNTIME / "soter.h", BATCH.with_suffix(".h"), APART.with_suffix(".h"))
        self.ffi = interface(*(declarations(header) for header in headers))
        self.path, tables = path, [f"{unit.prefix}_{name}" for name in ("program", "measured")]
        if recipe.keeps:  # never loaded here: what its C does as it is loaded is its flight's
            self.lib = open_library(self.ffi, _process_library())
            names = (os.fsencode(path), *(t.encode("ascii") for t in tables))
            self._names = [self.ffi.new("char[]", name) for name in names]
            self._program = self.ffi.new("soter_library *", self._names)
            self._measured = self.ffi.NULL
        else:
            self.lib = open_library(self.ffi, path)
            at = partial(address, self.ffi, path)
            self._program = at(tables[0], "const soter_program *")
            self._measured = at(tables[1], "const soter_measured *")
        self._of_thread = threading.local()
        most = 1 if recipe.keeps else BATCH_BYTES // unit.layout.size
        self.at_once = max(1, min(AT_ONCE, most))

    def fly(self, numbers: Sequence[int], first_seed: int) -> list[FlightOutcome]:
        """Flies the flights of these numbers, in order; flight k has the seed `first_seed` + k."""
        flights: list[FlightOutcome] = []
        for begin in range(0, len(numbers), self.at_once):
            flights += self._fly_batch(numbers[begin : begin + self.at_once], first_seed)
        return flights

    def _fly_batch(self, numbers: Sequence[int], first_seed: int) -> list[FlightOutcome]:
        room = getattr(self._of_thread, "room", ROOM)
        batch: list[FlightOutcome] = []
        while len(batch) < len(numbers):
            left = numbers[len(batch) :]
            output = _BatchOutput(self, len(left), room)
            for k, number in enumerate(left):
                output.flights[k].seed = (first_seed + number) & (2**64 - 1)
            done = self._run_batch(output, left)
            records, at = output.states.view(self.dtype), 0
            for k in range(done):
                flight = output.flights[k]
                events = output.events[at : at + flight.events]
                at += flight.events
                digests = [
                    self.ffi.string(h).decode("ascii") for h in (flight.digest, flight.trajectory)
                ]
                flown = self._read_flight(left[k], flight.seed, events, records[k][0], digests)
                batch.append(replace(flown, **output.saves_and_measures(k)))
            if done < len(left):
                room *= 4
                self._of_thread.room = room
        return batch

    def _run_batch(self, output: _BatchOutput, numbers: Sequence[int]) -> int:
        """Flies a batch; returns how many flights had room for events; SoterError X011, X012."""
        call = (self._program, output.flights, len(numbers), output.order)
        if not self.recipe.keeps:
            flown = int(self.lib.soter_batch(*call, self.ffi.new("size_t *")))
            require_default_float_rules()
            return flown
        done = shared_zeros((1,), np.int64)
        status = self.lib.soter_batch_apart(*call, self.ffi.cast("int64_t *", done.ctypes.data))
        if done[0] == UNLOADED:
            open_library(self.ffi, self.path)
        if done[0] < 0:
            seed, changed = int(output.flights[0].seed), done[0] == CHANGED
            raise _process_error(numbers[0], seed, status, changed=changed)
        return int(done[0])

    def _read_flight(
        self,
        number: int,
        seed: int,
        events: Any,  # noqa: ANN401 - records
        last: Any,  # noqa: ANN401 - a record
        digests: Sequence[str],
    ) -> FlightOutcome:
        recipe, modules = self.recipe, range(len(self.recipe.forced))
        broken = [
            text
            for index, text in recipe.properties
            for _ in range(int(last["properties"][index]["count"]))
        ]
        broken += [
            f"{name} latched"
            for index, name in recipe.components
            if int(last["components"][index]["latched"])
        ]
        bad = events[events["kind"] >= VIOLATED]["time"]
        starts = [0 if forced else None for forced in self.recipe.forced]  # else in SC
        spans = [_ac_spans(events, k, starts[k], self.until_ns) for k in modules]
        return FlightOutcome(
            number=number,
            seed=int(seed),
            seconds=self.until_ns / 1e9,
            ac_s=tuple(_total_s(s) for s in spans),
            all_ac_s=_total_s(_common_spans(spans)) if spans else 0.0,
            disengagements=tuple(
                int((_events_of_module(events, k)["kind"] == TO_SC).sum()) for k in modules
            ),
            episodes=tuple(_episode_count(events, k) for k in modules),
            gate_faults=tuple(int(last["modules"][k]["gate_faults"]) for k in modules),
            violations=int(last["header"]["violations"]),
            first_s=float(bad.min()) / 1e9 if len(bad) else None,
            broken=tuple(broken),
            digest=digests[0],
            trajectory=digests[1],
        )


class Fleet(Flyer):
    """A system that is flown on this machine."""

    def __init__(
        self,
        system: System,
        until_ns: int,
        optimise: str = "-O3",
        *,
        core: CoreSystem | None = None,
        horizon_ns: int = 0,
    ) -> None:
        """Compiles the system. Raises U003 if only Python answers one of its externs.

        `horizon_ns`: how long AC flies on after it lost control, to count saves; 0: not at all.
        """
        core = core or lower(system)
        _require_externs_in_c(system, core)
        if horizon_ns and len(system.modules) > MODULES_MAX:
            many = f"saves of {len(system.modules)} modules cannot be counted"
            raise SoterError((Diagnostic("U003", many, notes=(f"at most {MODULES_MAX}",)),))
        self.system, self.core = system, core
        recipe = make_recipe(system, core, until_ns, horizon_ns=horizon_ns, optimise=optimise)
        if horizon_ns and recipe.keeps:
            message = (
                f"saves cannot be counted: the C of an extern may keep something ({recipe.keeps})"
            )
            note = "AC is flown on with a copy of the state, and there is none of what C keeps"
            helps = ("fly without `--saves`, or let the function keep nothing",)
            raise SoterError((Diagnostic("U003", message, notes=(note,), helps=helps),))
        super().__init__(recipe)

    def code_fields(self) -> dict[str, Any]:
        """The fields of `CampaignIdentity` about the C that flies. Raises SoterError X003 or X004.

        With an extern's C they include the compiler, as compilers may give different bits.
        """
        unit, compiler = self.recipe.unit, find_compiler()
        ours = c_texts(*(RUNTIME / n for n in (*KERNEL, FAULTS)), *COMPILED_WITH)
        linked = {Path(p).name: digest([]) for p, _ in self.recipe.files}
        for p, text in self.recipe.files:
            linked[Path(p).name] = digest([linked[Path(p).name], text])
        if unit.c_sources:
            linked["compiler"] = digest([compiler.identity, *library_flags("-O2")])
        return {
            "code_sha256": digest([unit.header, unit.source, *ours]),
            "linked": linked,
            "unknown": why_input_is_unknown(unit),
        }


def _process_library() -> Path:
    """Compiles the library of `soter_apart.c`, which loads flight libraries. Raises X003, X004."""
    compiler, flags = find_compiler(), (*library_flags(), *include_flags(APART))

    def compile_in(work: Path) -> None:
        command = [*compiler.command, *flags, "-o", LIBRARY, str(APART), "-ldl"]
        compile_with(command, work, "processes for flights do not compile", (REPORT,))

    content = digest((compiler.identity, *flags, *c_texts(APART)))
    return cached_folder("apart", content, (LIBRARY,), compile_in) / LIBRARY


def shared_zeros(shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Zeros of this shape, in memory that this process shares with copies of itself."""
    count = prod(shape)
    memory = mmap.mmap(-1, max(1, count * np.dtype(dtype).itemsize))
    return np.frombuffer(memory, dtype, count).reshape(shape)


def _process_error(number: int, seed: int, status: int, *, changed: bool) -> SoterError:
    """The error of a flight whose process an extern's C ended or changed; `status`: of waitpid."""
    code = os.waitstatus_to_exitcode(status) if status >= 0 else 0
    how = (
        f"it was ended by {signal.Signals(-code).name}"
        if code < 0
        else (
            f"it ended by itself, with exit status {code}"
            if status >= 0
            else "none could be started"
        )
    )
    message = f"flight {number}, seed {seed}: "
    if changed:
        message += "linked C changed how the processor rounds: what it flew is not what is meant"
        return SoterError((Diagnostic("X012", message),))
    return SoterError((Diagnostic("X011", f"{message}its process is gone", notes=(how,)),))


class _BatchOutput:
    """The arrays that one call of the batch driver fills, for `count` flights."""

    def __init__(self, fleet: Flyer, count: int, room: int) -> None:
        ffi, modules, bins = fleet.ffi, len(fleet.recipe.forced), fleet.recipe.bins
        self.fleet = fleet
        zeros = shared_zeros if fleet.recipe.keeps else np.zeros
        size = ffi.sizeof("soter_flight")
        self.kept = zeros((count, size), np.uint8)
        self.flights = ffi.cast("soter_flight *", self.kept.ctypes.data)
        self.states = zeros((count + SPARE, fleet.dtype.itemsize), np.uint8)
        self.events = zeros((room,), EVENT)
        self.looks = zeros((count, len(bins)), LOOK)
        self.histogram = zeros((count, sum(bins)), np.uint32)
        self.saves = zeros((count, modules), np.uint32)
        self.precautions = zeros((count, modules), np.uint32)
        self.order = ffi.new("soter_order *")
        self.order.until_ns = fleet.until_ns
        self.order.horizon_ns = fleet.horizon_ns
        self.order.episode_ns = EPISODE_NS
        self.order.measured = fleet._measured  # noqa: SLF001
        self.order.room = room
        places = (
            ("states", "void *", self.states),
            ("events", "soter_event *", self.events),
            ("looks", "soter_look *", self.looks),
            ("histogram", "uint32_t *", self.histogram),
            ("saves", "uint32_t *", self.saves),
            ("precautions", "uint32_t *", self.precautions),
        )
        for name, kind, array in places:
            setattr(self.order, name, ffi.cast(kind, array.ctypes.data))

    def saves_and_measures(self, k: int) -> dict[str, Any]:
        """The fields of flight number k of the call: its looks, and its saves if counted."""
        fields: dict[str, Any] = {"looks": tuple(self._metric_samples(k))}
        if self.fleet.horizon_ns:
            fields["saves"] = tuple(self.saves[k].tolist())
            fields["precautions"] = tuple(self.precautions[k].tolist())
        return fields

    def _metric_samples(self, k: int) -> Iterator[MetricSample]:
        at = 0
        for i, bins in enumerate(self.fleet.recipe.bins):
            count, _, total, least, most = self.looks[k, i].tolist()
            yield MetricSample(
                count, total, least, most, tuple(self.histogram[k, at : at + bins].tolist())
            )
            at += bins


IN_C = (
    "make it a plant in Soter whose step is a function in C: `extern fun move(s: State, u: Vec2): "
    'State from "c:plant.c:move";` and `next s = move(s, command);`'
)


def _help_for_extern_nodes(outside: Sequence[Component], program: str) -> tuple[str, ...]:
    """The help lines on replacements for a node that Python or a policy answers."""
    kind, _, file = (outside[0].binding or "" if outside else "").partition(":")
    written: tuple[str, ...] = ()
    if kind in POLICIES and Path(file.partition(":")[0]).is_file():
        name = outside[0].name.rpartition(".")[2]
        command = f"soter policy {file.partition(':')[0]} --node {program}:{name} -o {name}.c"
        where = " where it is a chain of layers without memory" if kind == "onnx" else ""
        into_c = f"`{command}` writes the policy as C{where}"
        written = (
            f"{into_c}, for `--bind {name}=c:{name}.c:{name}_step`",
            "`soter policy FILE -o learned.soter` writes it as a function in Soter",
        )
    return (
        *written,
        "replace it in the system by a node in Soter: `replace NODE by OTHER;`",
        "or bind it to C: `--bind NODE=c:file.c:function`",
    )


def _require_externs_in_c(system: System, core: CoreSystem) -> None:
    """Raises SoterError U003 if a node, plant or function is extern and not bound to C."""

    def in_c(binding: str | None) -> bool:
        return (binding or "").startswith("c:")

    outside = [c for c in system.components if c.extern and not (c.node and in_c(c.binding))]
    names = [c.name for c in outside]
    kind, helps = "node", _help_for_extern_nodes(outside, system.program.path)
    if outside and outside[0].plant is not None:
        kind, helps = "plant", (IN_C,)
    if not names:
        functions = [f for f in core.functions if f.result is None]
        names = [f.source_name for f in functions if not in_c(f.source)]
        kind, helps = "function", ("bind it to C: `--bind NAME=c:file.c:function`",)
    if names:
        message = f"{kind} `{names[0]}` is extern: a campaign flies what is compiled"
        raise SoterError((Diagnostic("U003", message, helps=helps),))


def _events_of_module(events: npt.NDArray[Any], module: int) -> npt.NDArray[Any]:
    """The mode changes of one module among the events (n,)."""
    module_events: npt.NDArray[Any] = events[
        (events["kind"] <= TO_AC) & (events["index"] == module)
    ]
    return module_events


def _ac_spans(
    events: npt.NDArray[Any], module: int, since: int | None, until_ns: int
) -> list[tuple[int, int]]:
    """Spans (from, to) in ns in AC, from events (n,); `since`: begin of AC before, or None."""
    spans: list[tuple[int, int]] = []
    for time, kind in _events_of_module(events, module)[["time", "kind"]].tolist():
        if kind == TO_AC:
            since = time
        elif since is not None:
            spans.append((since, time))
            since = None
    return spans + ([(since, until_ns)] if since is not None else [])


def _common_spans(spans: list[list[tuple[int, int]]]) -> list[tuple[int, int]]:
    """The spans in which all these lists overlap."""
    overlap = spans[0]
    for other in spans[1:]:
        common, i, k = [], 0, 0
        while i < len(overlap) and k < len(other):
            low, high = max(overlap[i][0], other[k][0]), min(overlap[i][1], other[k][1])
            if low < high:
                common.append((low, high))
            if overlap[i][1] < other[k][1]:
                i += 1
            else:
                k += 1
        overlap = common
    return overlap


def _total_s(spans: Iterable[tuple[int, int]]) -> float:
    return sum(b - a for a, b in spans) / 1e9


def _episode_count(events: npt.NDArray[Any], module: int) -> int:
    """The number of episodes in events (n,); close disengagements count as one episode."""
    module_events = _events_of_module(events, module)
    times = module_events[module_events["kind"] == TO_SC]["time"]
    if not len(times):
        return 0
    return 1 + int((np.diff(times) > EPISODE_NS).sum())
