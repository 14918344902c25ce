"""Runs a system with its externs bound, and keeps what runs of one program share.

Purpose: `simulate` chooses the engine, runs until the end or a signal, and keeps the log.
`PreparedSystems` keeps, for the last few choices of system, parameters and bindings, everything
that does not depend on seed, end and Python objects; it reads C files of externs again before every
run. Several threads may use it; a copy or a pickle of it is empty.
Non-goals: files of the program, which were read when it was loaded.
"""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from dataclasses import dataclass
from functools import partial as partial_
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from soter.addons import load_module
from soter.api.computed_ttf import compute_ttf
from soter.core.layout import state_layout
from soter.diagnostics.current_phase import phase
from soter.language.front_end import CheckResult, system_of
from soter.native.extern_bindings import Bindings, bind, bindings_of_derived, bindings_with_objects
from soter.report.wording import changed_parameters
from soter.semantics.externs import Stop
from soter.simulate.externs.c_extern import linked_c_hash
from soter.simulate.externs.callables import (
    close_externs,
    load_callables,
    policy_assumptions,
    require_runnable,
)
from soter.simulate.interrupt import (
    ANY_END,
    INTERRUPT,
    StopRequest,
    current_stop_request,
    raise_signal_again,
    signal_name,
    stoppable_run,
)
from soter.simulate.run import NativeProgram, Pacer, run_interpreted
from soter.verify.proof_cache import stored_verdicts
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.language.model.system import System
    from soter.language.model.types import Value
    from soter.simulate.result import Run
    from soter.simulate.run_log import RunLog
    from soter.simulate.run_options import RunOptions


KEPT_MAX = 16
T = TypeVar("T")


class RecentlyUsed(OrderedDict[tuple[object, ...], T]):
    """A cache with the results for the last `KEPT_MAX` requested keys."""

    def get_or_make(
        self, key: tuple[object, ...], make: Callable[[], T], *, again: bool = False
    ) -> T:
        """The result kept for `key`, or a new one from `make` if none is kept or if `again`."""
        if again or key not in self:
            self[key] = make()
        self.move_to_end(key)
        if len(self) > KEPT_MAX:
            self.popitem(last=False)
        return self[key]


@dataclass(eq=False)
class PreparedSystem:
    """A system that was lowered to Core, and compiled if the native engine ran it.

    `bindings` are from the run that prepared it; bindings by text are the same in every run.
    """

    system: System
    computed: tuple[str, ...]
    bindings: Bindings
    linked: str = ""
    """The hash of the C files of externs with which `native` was compiled."""
    native: NativeProgram | None = None
    arm: str | None = None
    """The arm of a campaign by whose rules it runs; None: by the program's own."""


class PreparedSystems:
    """Keeps the systems that a `Program` has prepared for runs."""

    def __init__(self) -> None:
        self._kept: RecentlyUsed[PreparedSystem] = RecentlyUsed()
        self._lock = threading.RLock()

    def __reduce__(self) -> tuple[type[PreparedSystems], tuple[()]]:
        return PreparedSystems, ()

    def prepared_system(
        self,
        checked: CheckResult,
        name: str | None,
        values: Mapping[str, Value],
        targets: Mapping[str, object],
    ) -> PreparedSystem:
        """The system `name` with these parameters and bindings; prepares it if it is not kept.

        Only bindings by text distinguish systems: Python objects may be exchanged. Parameters are
        compared by their text: 0.0 is not -0.0, and 1 is not true. Raises as `system_of` and `bind`
        do; after an error nothing is kept.
        """
        default = checked.default_system() if name is None else None
        texts = [(n, t if isinstance(t, str) else None) for n, t in targets.items()]
        chosen = name if default is None else default.name
        key = (chosen, repr(sorted(values.items())), tuple(texts))

        def prepare() -> PreparedSystem:
            system = system_of(checked, name, values)
            computed = tuple(compute_ttf(system, bound=targets))
            return PreparedSystem(system, computed, bind(system, targets))

        with self._lock:
            return self._kept.get_or_make(key, prepare)

    def system_of_arm(
        self, prepared: PreparedSystem, name: str, folder: str | Path | None
    ) -> PreparedSystem:
        """The system under the rules of a campaign's arm; not cached. Raises U001 or D006."""
        system = prepared.system
        named = load_module("soter.campaign.arms").system_of_arm(system, name, Path(folder or "."))
        if named is system:
            return prepared
        bindings = bindings_of_derived(prepared.bindings, named)
        return PreparedSystem(named, prepared.computed, bindings, arm=name)

    def native_program(self, prepared: PreparedSystem) -> NativeProgram:
        """The compiled system; compiled again if the C of an extern has changed."""
        with self._lock:
            core = prepared.bindings.core
            linked = linked_c_hash(prepared.system, core)
            if prepared.native is None or prepared.linked != linked:
                prepared.native = NativeProgram(prepared.system, core=core)
                prepared.linked = linked
            return prepared.native


def simulate(
    preparations: PreparedSystems,
    prepared: PreparedSystem,
    targets: Mapping[str, object],
    options: RunOptions,
    *,
    until_ns: int,
    writer: RunLog | None,
) -> Run:
    """Runs a system as `Program.simulate` describes; raises KeyboardInterrupt unless `partial`."""
    stop, bindings = current_stop_request(), bindings_with_objects(prepared.bindings, targets)
    paced = ""
    if options.real_time:
        from soter.simulate.real_time import why_not_real_time  # noqa: PLC0415 - only then

        paced = why_not_real_time(bindings, options.engine)
    bound: dict[str, object] = {}
    if options.recorded is not None or (options.real_time and not paced):
        seed, engine, go = _engine_setup(bindings, options)
    else:
        seed, engine, apart = options.seed, options.engine, options.apart and hasattr(os, "fork")
        bound = load_callables(bindings, engine, stop, apart=apart)
        go = _engine_function(engine, preparations, prepared)
    answered = bindings.file_hashes()
    _begin_log(writer, bindings, answered, seed, engine)
    try:
        phase(f"running {bindings.system.name}", anew=True)
        with stoppable_run(stop, INTERRUPT if writer is None else ANY_END):
            run = go(
                until_ns,
                seed,
                bound,
                keep_trace=options.trace,
                hash_trace=options.sha256,
                progress=options.progress,
                stop=stop,
                pacer=Pacer() if paced else None,
                also=None if writer is None else writer.see,
            )
    except Stop:  # before the first instant
        raise KeyboardInterrupt from None
    except BaseException as error:
        if writer is not None:
            writer.end_by(error)
        raise
    finally:
        close_externs(bound)
    run.externs, run.extern_files = bindings.binding_texts(), answered
    run.paced = paced
    run.page = _inline_page
    run.computed = [*prepared.computed, *policy_assumptions(bound)]
    run.proofs = stored_verdicts(prepared.system) if prepared.arm is None else {}
    _end_log(writer, run, stop)
    if run.interrupted and not options.partial:
        raise_signal_again(stop)
    return run


def _engine_setup(bindings: Bindings, options: RunOptions) -> tuple[int, str, Callable[..., Run]]:
    """The seed, name and run function of the engine for a recording or for real time."""
    from soter.simulate.flight_recording import FlightRecording  # noqa: PLC0415 - only here
    from soter.simulate.real_time import run_real_time, run_recorded  # noqa: PLC0415 - only here

    def fly_in_real_time(until_ns: int, seed: int, _bound: object, **how: Any) -> Run:  # noqa: ANN401
        """Runs in real time, which needs no pacer and shows its progress itself."""
        wanted = {k: how[k] for k in ("keep_trace", "hash_trace", "stop", "also")}
        return run_real_time(bindings, until_ns, seed, quiet=not options.apart, **wanted)

    if options.recorded is None:
        require_runnable(bindings, options.engine)
        return options.seed, options.engine, fly_in_real_time
    recording = FlightRecording(Path(options.recorded), bindings.system)

    def recorded(_until_ns: int, _seed: int, _bound: object, **how: Any) -> Run:  # noqa: ANN401
        """Replays the recorded flight."""
        return run_recorded(recording, **{k: how[k] for k in ("keep_trace", "hash_trace", "also")})

    return recording.seed, "recorded", recorded


def _begin_log(
    writer: RunLog | None,
    bindings: Bindings,
    answered: Mapping[str, Mapping[str, str]],
    seed: int,
    engine: str,
) -> None:
    if writer is None:
        return
    hashes = {f"{n} sha256 {f}": h for n, files in answered.items() for f, h in files.items()}
    layout = state_layout(bindings.system)
    writer.begin(bindings.system, layout, seed, engine, {**bindings.binding_texts(), **hashes})


def _end_log(writer: RunLog | None, run: Run, stop: StopRequest) -> None:
    if writer is not None:
        writer.end(run, signal_name(stop) if run.interrupted else run.cut)


def _engine_function(
    engine: str, preparations: PreparedSystems, prepared: PreparedSystem
) -> Callable[..., Run]:
    """The function that runs the system; lowers and compiles it first, before the run starts."""
    if engine == "interp":
        return partial_(run_interpreted, prepared.system)
    return partial_(preparations.native_program(prepared).run, observed=True)


def _inline_page(run: Run) -> str:
    """The report of a run as HTML text; "" without a full trace or the extra `report`."""
    from soter.simulate.run_report import inline_report  # noqa: PLC0415 - an extra

    if run.trace is None or run.recorded is not None:
        return ""
    program = run.system.program.path
    return inline_report(run, Path(program).name, _report_facts(run, program))


def _report_facts(run: Run, program: str) -> dict[str, str]:
    """The facts about a run that its report shows, by name."""
    return {
        "program": program,
        "program sha256": run.system.program.sha256,
        "seed": str(run.seed),
        "engine": run.engine,
        "trace sha256": run.trace_sha256 or "",
        **{f"param {name}": text for name, (text, _) in changed_parameters(run.system).items()},
        **{f"extern {name}": text for name, text in run.externs.items()},
        "soter": VERSION,
    }


def write_report(run: Run, path: str | Path, program: str, *, self_contained: bool = False) -> Path:
    """Writes the HTML report of a traced run. Raises SoterError D006 or D007."""
    from soter.simulate.run_report import write_report as write  # noqa: PLC0415 - an extra

    name = Path(program).name
    return write(run, path, name, _report_facts(run, program), self_contained=self_contained)
