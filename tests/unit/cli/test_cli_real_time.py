"""`soter run --real-time`: told as any run, with a timing report; externs are processes."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

import pytest

from generators.packages import EXAMPLES
from generators.real_time import cart_with_extern

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Soter = Callable[..., Any]

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

GOOD = """
def step(inputs):
    return max(-3.0, min(3.0, 4.0 * (inputs.goal - inputs.motion.x) - 1.0 * inputs.motion.v))
"""
COUNTED = """
import os, time, sys
count = 0
def step(inputs):
    global count
    count += 1
    if count > 20:
        {body}
    return 1.0
"""
RUN = ("run", "cart.soter", "--real-time", "--json", "--until", "1s")


@pytest.fixture
def apart(here: Path) -> Path:
    text = cart_with_extern(here / "made", "python:fast.py:step").read_text()
    (here / "cart.soter").write_text(text)
    (here / "fast.py").write_text(GOOD)
    return here


def undisturbed(document: dict) -> bool:  # type: ignore[type-arg]
    timing = document["real_time"]
    workers = timing["workers"].values()
    return timing["misses"] == 0 and not any(w["later"] + w["missing"] for w in workers)


def test_an_undisturbed_run_is_told_like_one_in_virtual_time(soter: Soter, apart: Path) -> None:
    expected = soter("run", "cart.soter", "--json", "--until", "1s").document
    for _ in range(10):
        done = soter(*RUN, "--log", "out.mcap", "--report", "out.html")
        assert done.exit == 0
        if undisturbed(done.document):
            break
    found = done.document
    assert undisturbed(found)
    for name in ("trace_sha256", "violations", "instants", "modules", "mode_changes", "final"):
        assert found.get(name) == expected.get(name), name
    assert (apart / "out.mcap").stat().st_size > 1000
    assert (apart / "out.html").stat().st_size > 1000
    assert found["real_time"]["workers"]["SafeCart.Fast"]["answered"] == 101
    assert expected["real_time"] is None


@pytest.mark.parametrize(
    "body",
    ["os._exit(0)", "os.abort()", "time.sleep(60)", "while True: pass", "sys.exit(3)",
     "raise ValueError('boom')", "return float('nan')", "return 1e9", "return [1, 2]",
     "os.kill(os.getpid(), 9)", "x = bytearray(1 << 40)"],
)  # fmt: skip
def test_a_policy_that_fails_takes_nothing_with_it(soter: Soter, apart: Path, body: str) -> None:
    (apart / "fast.py").write_text(COUNTED.format(body=body))
    done = soter(*RUN)
    found = done.document
    assert done.exit == 0
    assert found["violations"] == 0
    assert found["instants"] == 201
    assert found["modules"]["SafeCart"]["gate_faults"] >= 1
    takeovers = found["real_time"]["modules"]["SafeCart"]["takeovers"]
    assert takeovers["silent"] + takeovers["gate"] >= 1


def test_a_policy_that_cannot_be_loaded_leaves_its_module_with_sc(
    soter: Soter, apart: Path
) -> None:
    (apart / "fast.py").write_text("raise RuntimeError('not today')\n")
    done = soter(*RUN)
    assert done.exit == 0
    assert done.document["modules"]["SafeCart"]["ac_share"] == 0.0
    assert any("not ready" in n for n in done.document["real_time"]["notes"])


@pytest.mark.usefixtures("apart")
def test_people_are_told_how_late_it_was(soter: Soter) -> None:
    done = soter("run", "cart.soter", "--real-time", "--until", "200ms")
    for words in ("in real time", "policy ", "instants", "SafeCart.dm complete", "worker SafeCart"):
        assert words in done.out


@pytest.mark.usefixtures("here")
def test_people_are_told_of_leases(soter: Soter) -> None:
    stop = str(EXAMPLES / "wall" / "stop.soter")
    done = soter("run", stop, "--system", "Track", "--real-time", "--until", "200ms")
    (line,) = [x for x in done.out.splitlines() if "leases Guard" in x]
    late = soter("run", stop, "--system", "Track", "--real-time", "--until", "200ms", "--json")
    leases = late.document["real_time"]["leases"]["Guard"]
    assert " given" in line
    assert leases["given"] > 0 or leases["ended_ns"] is not None


def test_what_is_not_bound_is_refused_before_it_runs(soter: Soter, apart: Path) -> None:
    text = (apart / "cart.soter").read_text()
    (apart / "cart.soter").write_text(text.replace(' from "python:fast.py:step"', ""))
    assert soter(*RUN).codes == ["X001"]


def test_a_plant_in_python_is_only_paced_and_the_run_says_so(soter: Soter, here: Path) -> None:
    (here / "p.soter").write_text(
        "soter 1;\ntopic x: float in [0.0, 3.0];\n"
        "extern plant Sim period 10ms { state p: float = 1.0; drives x = p; }\n"
        "system S { sim: Sim; until 100ms; always x < 3.0; }\n"
    )
    (here / "sim.py").write_text("def step(inputs):\n    return inputs.state.p\n")
    done = soter("run", "p.soter", "--bind", "sim=python:sim.py:step", "--real-time")
    assert done.exit == 0
    assert "not the real-time runtime (extern plant `sim` is bound to Python)" in done.out


@pytest.mark.parametrize("what", ["var n: int = 0;", "takes [1ms, 2ms];"])
def test_a_process_has_no_locals_in_the_state_and_takes_what_it_takes(
    soter: Soter, apart: Path, what: str
) -> None:
    text = (apart / "cart.soter").read_text()
    text = text.replace("  publishes accel;\n}", f"  publishes accel;\n  {what}\n}}", 1)
    (apart / "cart.soter").write_text(text)
    assert soter("check", "cart.soter").exit == 0
    assert soter(*RUN).codes == ["X008"]


def test_a_system_in_the_world_is_built_and_not_run(soter: Soter, here: Path) -> None:
    (here / "p.soter").write_text(
        "soter 1;\ntopic x: float; topic y: float;\n"
        "node N period 10ms { subscribes x; publishes y; step { publish y = x; } }\n"
        "system S { external topic x; external topic y; node N; }\n"
    )
    done = soter("run", "p.soter", "--real-time", "--until", "1s", "--json")
    assert done.codes == ["X008"]
