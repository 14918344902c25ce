"""Runs of one program share what they can, and nothing of it shows in what they compute."""

from __future__ import annotations

import copy
import pickle
import random
import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from soter.api.running import KEPT_MAX, PreparedSystems
from soter.core import steps
from soter.native import extern_bindings

if TYPE_CHECKING:
    from pathlib import Path

TEXT = """
soter 1;
param GAIN: float = 1.0;
param WAIT: duration = 20ms;
param HARD: bool = false;
topic x: float;
topic sign: float = 1.0;
topic u: float in [-1.0, 1.0];
plant Boat period 10ms { reads u; drives x = p; state p: float; der p = GAIN * u; }
extern node Pilot period WAIT { subscribes x; publishes u; }
node Stay period 20ms { publishes u; step { publish u = 0.5; } }
node Sign period 50ms { publishes sign; step { publish sign = GAIN; } }
rta Guard { ac Pilot; sc Stay; period 100ms; safe true; ttf HARD; safer x < 0.2; }
system One default { boat: Boat; sign: Sign; module Guard; until 1s; }
system Two { boat: Boat; sign: Sign; module Guard; until 2s; }
"""
VALUES: dict[str, tuple[object, ...]] = {
    "GAIN": (1.0, -0.0, 0.0, 2.5),
    "WAIT": ("20ms", "40ms"),
    "HARD": (True, False),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "boat.soter"
    file.write_text(TEXT)
    return file


def facts(run: soter.Run) -> tuple[object, ...]:
    """All that a run computed, but for the hash of what was kept of it."""
    tallies = {n: (t.steps, t.silent) for n, t in run.extern_tallies.items()}
    return (
        *(run.final.tobytes(), run.instants, run.changes, run.first_faults, run.decided),
        *(run.params, run.notes, run.violations, tallies, run.externs, run.reached_s),
    )


@pytest.mark.parametrize("engine", ["native", "interp"])
def test_a_run_is_the_same_whatever_ran_before_it(path: Path, engine: str) -> None:
    rng = random.Random(f"prepared {engine}")  # noqa: S311 - no secret
    program = soter.load(path)
    for _ in range(12):
        level = rng.choice((-1.0, 0.25))
        how: dict[str, Any] = {
            "system": rng.choice((None, "One", "Two")),
            "seed": rng.randrange(4),
            "params": {n: rng.choice(v) for n, v in VALUES.items() if rng.random() < 0.5},
            "engine": engine,
        }
        answer = {"Pilot": lambda _, level=level: level}
        warm = program.bind("Pilot", answer["Pilot"]).simulate(**how)
        cold = soter.load(path).bind("Pilot", answer["Pilot"]).simulate(**how)
        assert warm.trace_sha256 == cold.trace_sha256, how
        assert facts(warm)[:-2] == facts(cold)[:-2], how
        other = "interp" if engine == "native" else "native"
        assert program.simulate(**{**how, "engine": other}).trace_sha256 == warm.trace_sha256


def test_zero_and_minus_zero_are_two_values(path: Path) -> None:
    program = soter.load(path).bind("Pilot", lambda _: 0.0)
    how: dict[str, Any] = {"until": "2s"}
    hashes = [program.simulate(params={"GAIN": g}, **how).trace_sha256 for g in (0.0, -0.0, 0.0)]
    assert hashes[0] == hashes[2] != hashes[1]


def test_a_system_is_lowered_once(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = soter.load(path).bind("Pilot", lambda _: 0.0)
    lowered = []
    lower = steps.lower

    def counting(system: Any) -> Any:
        lowered.append(system.name)
        return lower(system)

    monkeypatch.setattr(extern_bindings, "lower", counting)
    for seed in range(3):
        program.bind("Pilot", lambda _, s=seed: 0.1 * s)
        program.simulate(seed=seed)
        program.simulate("One", seed=seed, until="0.2s", engine="interp", trace=False)
    assert lowered == ["One"]
    program.simulate("Two")
    program.simulate(params={"GAIN": 2.0})
    assert lowered == ["One", "Two", "One"]


def test_only_so_much_is_kept(path: Path) -> None:
    program = soter.load(path).bind("Pilot", lambda _: 0.0)
    how: dict[str, Any] = {"engine": "interp", "until": "50ms"}
    first = program.simulate(params={"GAIN": 0.0}, **how).trace_sha256
    for i in range(KEPT_MAX + 3):
        program.simulate(params={"GAIN": float(i)}, **how)
        assert len(program._prepared._kept) <= KEPT_MAX
    assert program.simulate(params={"GAIN": 0.0}, **how).trace_sha256 == first


def test_what_fails_is_not_kept(path: Path) -> None:
    program = soter.load(path)
    with pytest.raises(soter.SoterError, match="U002"):
        program.simulate("Three")
    with pytest.raises(soter.SoterError, match="U004"):
        program.simulate(params={"GIAN": 1.0})
    with pytest.raises(soter.SoterError, match="X001"):
        program.simulate()
    assert program.bind("Pilot", lambda _: 0.0).simulate().violations == 0


def test_a_class_is_made_anew_for_every_run(path: Path) -> None:
    class Ramp:
        def __init__(self) -> None:
            self.level = 0.0

        def step(self, _: object) -> float:
            self.level += 0.01
            return self.level

    program = soter.load(path).bind("Pilot", Ramp)
    assert program.simulate().trace_sha256 == program.simulate().trace_sha256


def test_c_that_changes_is_compiled_again(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    level = tmp_path / "level.h"
    code = '#include "boat.h"\n#include "level.h"\n'
    code += "int go(const boat_Guard_Pilot_in *in, boat_Guard_Pilot_out *out) {\n"
    code += "(void)in; out->u = LEVEL; out->has_u = true; return 0; }\n"
    (tmp_path / "pilot.c").write_text(code)
    program = soter.load(path).bind("Pilot", "c:pilot.c:go")
    last = []
    for text in ("0.5", "0.25", "0.5"):
        level.write_text(f"#define LEVEL {text}\n")
        last.append(float(program.simulate("Two", params={"HARD": False}).array("u")[-1]))
    assert last == [0.5, 0.25, 0.5]


def test_the_program_stays_what_was_loaded(path: Path) -> None:
    program = soter.load(path).bind("Pilot", lambda _: 0.0)
    before = program.simulate().trace_sha256
    path.write_text(TEXT.replace("der p = GAIN * u", "der p = GAIN * u + 0.5"))
    assert program.simulate().trace_sha256 == before
    assert soter.load(path).bind("Pilot", lambda _: 0.0).simulate().trace_sha256 != before


def test_threads_may_run_one_program(path: Path) -> None:
    program = soter.load(path).bind("Pilot", lambda inputs: -inputs.x)
    gains = (1.0, 3.0)
    expected = {
        (g, s): soter.load(path)
        .bind("Pilot", lambda inputs: -inputs.x)
        .simulate(seed=s, params={"GAIN": g})
        .trace_sha256
        for g in gains
        for s in range(3)
    }
    digests: list[tuple[tuple[float, int], str | None]] = []

    def work(number: int) -> None:
        for turn in range(12):
            gain, seed = gains[(number + turn) % 2], turn % 3
            run = program.simulate(seed=seed, params={"GAIN": gain})
            digests.append(((gain, seed), run.trace_sha256))

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(digests) == 48
    assert all(expected[how] == sha256 for how, sha256 in digests)


def test_copies_start_with_nothing() -> None:
    for made in (copy.deepcopy(PreparedSystems()), pickle.loads(pickle.dumps(PreparedSystems()))):  # noqa: S301 - our own
        assert made._kept == {}


# ---------------------------------------------------------------- hashing and recording less


@pytest.mark.parametrize("engine", ["native", "interp"])
def test_a_run_without_its_hash_is_the_same_run(path: Path, engine: str) -> None:
    program = soter.load(path).bind("Pilot", lambda inputs: inputs.x)
    whole = program.simulate(engine=engine)
    assert whole.trace_sha256 is not None
    for trace in (True, False, ["x"], []):
        bare = program.simulate(engine=engine, trace=trace, sha256=False)
        assert bare.trace_sha256 is None
        assert facts(bare) == facts(whole)


@pytest.mark.parametrize("engine", ["native", "interp"])
@pytest.mark.parametrize("names", [["x"], ["boat.truth", "u"], ["Guard", "sign"], "x", [], ("u",)])
def test_what_is_recorded_is_that_part_of_the_trace(path: Path, engine: str, names: Any) -> None:
    program = soter.load(path).bind("Pilot", lambda inputs: inputs.x)
    whole = program.simulate(engine=engine)
    some = program.simulate(engine=engine, trace=names)
    assert some.trace_sha256 == whole.trace_sha256
    assert some.trace is not None
    assert some.trace.dtype.itemsize < whole.require_trace().dtype.itemsize
    assert np.array_equal(some.time_s(), whole.time_s())
    for name in [names] if isinstance(names, str) else names:
        if name == "Guard":
            assert np.array_equal(some.mode(name), whole.mode(name))
        else:
            assert np.array_equal(some.array(name), whole.array(name))
            assert some.topic(name).tobytes() == whole.topic(name).tobytes()


def test_what_was_not_recorded_is_refused_with_what_would_help(path: Path, tmp_path: Path) -> None:
    program = soter.load(path).bind("Pilot", lambda inputs: inputs.x)
    with pytest.raises(soter.SoterError, match="U001") as caught:
        program.simulate(trace=["boat.thruth"])
    assert "boat.truth" in caught.value.diagnostics[0].helps[0]
    run = program.simulate(trace=["x"])
    for ask in (
        lambda: run.topic("u"),
        lambda: run.array("boat.truth.p"),
        lambda: run.mode("Guard"),
    ):
        with pytest.raises(soter.SoterError, match="did not record") as caught:
            ask()
        assert "trace=[" in caught.value.diagnostics[0].helps[0]
    with pytest.raises(soter.SoterError, match="no topic and no truth"):
        run.topic("y")
    with pytest.raises(soter.SoterError, match="recorded only `x`"):
        program.write_log(run, tmp_path / "run.mcap")
    with pytest.raises(soter.SoterError, match="recorded only `x`"):
        program.write_report(run, tmp_path / "run.html")


def test_a_report_and_a_log_hold_everything(path: Path, tmp_path: Path) -> None:
    program = soter.load(path).bind("Pilot", lambda inputs: inputs.x)
    run = program.simulate(trace=["x"], report=tmp_path / "run.html")
    assert run.mode("Guard").shape == run.time_s().shape
    logs: list[int] = []
    for trace, sha256 in ((True, True), (["x"], True), (False, False)):
        log = tmp_path / f"{len(logs)}.mcap"
        program.simulate(trace=trace, sha256=sha256, log=log)
        logs.append(len(log.read_bytes()))
    assert logs[0] == logs[1] > 0
    assert abs(logs[2] - logs[0]) < 200, "but for the hash"
