"""What is kept of a run: the same on both engines, whole or stopped half-way."""

from __future__ import annotations

import hashlib
import os
import signal
import threading
from typing import TYPE_CHECKING

import numpy as np
import pytest

from soter.semantics.externs import Stop
from soter.simulate import run_observer
from soter.simulate.decisions import PredicateValues, decision_reason, decision_steps
from soter.simulate.explain_decision import Explainer
from soter.simulate.interrupt import StopRequest, stoppable_run
from soter.simulate.run import NativeProgram, run_interpreted
from soter.simulate.run_fields import DOCUMENT, final_numbers, final_values

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.system import System

    Cart = Callable[[str], System]

S = 10**9


def test_both_engines_leave_the_same_record(cart: Cart) -> None:
    native = NativeProgram(cart("Protected")).run(5 * S, 3, keep_trace=True, hash_trace=True)
    interpreted = run_interpreted(cart("Protected"), 5 * S, 3, keep_trace=True)
    assert native.changes == interpreted.changes
    decided = [list(decision_steps(r.system, r.require_trace())) for r in (native, interpreted)]
    assert decided[0] == decided[1]
    one, two = DOCUMENT.of(native), DOCUMENT.of(interpreted)
    for name in ("engine", "wall_s"):
        one.pop(name)
        two.pop(name)
    assert one == two


def test_the_hash_is_that_of_the_trace(cart: Cart) -> None:
    run = NativeProgram(cart("Protected")).run(3 * S, 3, keep_trace=True, hash_trace=True)
    assert run.trace is not None
    assert hashlib.sha256(run.trace.tobytes()).hexdigest() == run.trace_sha256
    assert len(run.trace) == run.instants == 601


def test_a_long_trace_lies_in_a_file(cart: Cart, monkeypatch: pytest.MonkeyPatch) -> None:
    program = NativeProgram(cart("Protected"))
    inside = program.run(30 * S, 3, keep_trace=True)
    monkeypatch.setattr(run_observer, "IN_MEMORY_BYTES", 1000)
    outside = program.run(30 * S, 3, keep_trace=True)
    assert isinstance(outside.trace, np.memmap)
    assert inside.trace is not None
    assert outside.trace.tobytes() == inside.trace.tobytes()


def test_changes_are_found_across_blocks(cart: Cart, monkeypatch: pytest.MonkeyPatch) -> None:
    program = NativeProgram(cart("Protected"))
    whole = program.run(30 * S, 1, hash_trace=True)
    monkeypatch.setattr("soter.simulate.run.CHUNK_BYTES", 1)
    blocks = program.run(30 * S, 1, hash_trace=True)
    assert len(whole.changes) == 7
    assert blocks.changes == whole.changes
    assert blocks.trace_sha256 == whole.trace_sha256


def test_decisions_have_reasons(cart: Cart) -> None:
    run = NativeProgram(cart("Protected")).run(5 * S, 1, keep_trace=True)
    first, second = run.decisions[:2]
    assert (first.before, first.after, first.reason) == (
        "SC",
        "AC",
        "safer: far enough inside φ_safe",
    )
    assert (second.after, second.reason) == (
        "SC",
        "ttf: must hold wherever φ_safe could be left within 2Δ (`soter verify` checks that)",
    )
    explainer = Explainer(run.system, run.layout)
    every = list(decision_steps(run.system, run.require_trace(), None, explainer))
    assert len(every) == 101
    assert [d for d in every if d.before != d.after] == run.decisions


def test_every_reason_is_said() -> None:
    calm = PredicateValues(ttf=False, safer=True, stale=False, gate_fault=False)
    assert decision_reason("AC", "AC", calm) == ""
    bad = PredicateValues(ttf=True, safer=False, stale=True, gate_fault=True, clean_needed=2)
    assert decision_reason("AC", "SC", bad) == (
        "ttf: must hold wherever φ_safe could be left within 2Δ (`soter verify` checks that) "
        "and stale: an input is older than its max_age, or inputs are of different instants "
        "and gate fault: an output of AC was refused"
    )
    assert decision_reason("SC", "SC", bad) == (
        "stale: an input is older than its max_age, or inputs are of different instants "
        "and not safer yet and AC owes 2 clean outputs"
    )


def test_final_values_by_full_name(cart: Cart) -> None:
    run = NativeProgram(cart("Protected")).run(S, 1, keep_trace=True)
    assert run.trace is not None
    values = final_values(run)
    assert values["goal"] == 9.5
    assert values["c.truth"] == {"x": run.trace["c"]["x"][-1], "v": run.trace["c"]["v"][-1]}
    assert final_numbers(run)["motion.x"] == run.trace["topics"]["motion"]["x"][-1]


# ---------------------------------------------------------------- stopping


def test_a_stop_ends_at_an_instant_and_is_a_run_until_there(cart: Cart) -> None:
    stop = StopRequest()
    with stoppable_run(stop):

        def enough(share: float) -> None:
            stop.wanted = share > 0.01

        program = NativeProgram(cart("Protected"))
        part = program.run(3600 * S, 1, keep_trace=True, progress=enough, stop=stop)
    assert part.interrupted
    assert part.trace is not None
    assert 36 < part.reached_s < 3600
    assert part.reached_s == part.trace["header"]["ct"][-1] / 1e9
    assert len(part.trace) == part.instants


def test_the_interpreter_stops_too(cart: Cart) -> None:
    stop = StopRequest()
    with stoppable_run(stop):

        def enough(_: float) -> None:
            stop.wanted = True

        part = run_interpreted(cart("Protected"), 3600 * S, 1, progress=enough, stop=stop)
    assert part.interrupted
    assert part.instants >= 1


def test_ctrl_c_asks_and_inside_an_extern_breaks_off() -> None:
    stop = StopRequest()
    with stoppable_run(stop):
        os.kill(os.getpid(), signal.SIGINT)
        assert stop.wanted
        stop.in_extern = True
        with pytest.raises(Stop):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_other_handlers_and_threads_are_left_alone() -> None:
    def own(*_: object) -> None:
        return

    before = signal.signal(signal.SIGINT, own)
    try:
        with stoppable_run(StopRequest()):
            assert signal.getsignal(signal.SIGINT) is own
    finally:
        signal.signal(signal.SIGINT, before)
    seen = []

    def elsewhere() -> None:
        stop = StopRequest()
        with stoppable_run(stop):
            seen.append(stop.wanted)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [False]
