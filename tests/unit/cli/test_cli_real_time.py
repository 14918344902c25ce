"""`soter run --real-time`: told as any run, with a timing report; externs are processes.

The clock is the test's (`owned_clock.c`).
"""

from __future__ import annotations

import re
import sys
from typing import TYPE_CHECKING, Any

import pytest

from generators.c_packages import CART, EXAMPLES
from generators.posix_packages import cart_with_extern, over, owned

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
STOPPED = "held:395000000:2000000000"
RUN = ("run", "cart.soter", "--real-time", "--json", "--until", "1s")


@pytest.fixture
def apart(here: Path) -> Path:
    text = cart_with_extern(here / "made", "python:fast.py:step").read_text()
    (here / "cart.soter").write_text(text)
    (here / "fast.py").write_text(GOOD)
    return here


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The driver of the cart whose AC is in Python, over the clock of the test."""
    folder = tmp_path_factory.mktemp("program")
    return owned(cart_with_extern(folder / "source", "python:fast.py:step"), folder / "out")


def test_an_undisturbed_run_is_told_like_one_in_virtual_time(
    soter: Soter, apart: Path, program: Path
) -> None:
    expected = soter("run", "cart.soter", "--json", "--until", "1s").document
    with over(program):
        done = soter(*RUN, "--log", "out.mcap", "--report", "out.html")
    assert done.exit == 0
    document = done.document
    worker = document["real_time"]["workers"]["SafeCart.Fast"]
    assert worker["later"] == worker["missing"] == document["real_time"]["misses"] == 0
    for name in ("trace_sha256", "violations", "instants", "modules", "mode_changes", "final"):
        assert document.get(name) == expected.get(name), name
    assert (apart / "out.mcap").stat().st_size > 1000
    assert (apart / "out.html").stat().st_size > 1000
    assert worker["answered"] == 101
    assert expected["real_time"] is None


# ---------------------------------------------------------------- a trusted part that is late


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return owned(CART, tmp_path_factory.mktemp("cart"))


@pytest.mark.usefixtures("here")
def test_a_trusted_part_that_was_late_is_no_success_in_words_json_and_report(
    soter: Soter, cart: Path, here: Path
) -> None:
    run = ("run", "cart.soter", "--real-time", "--until", "500ms")
    with over(cart, STOPPED):
        words = soter(*run, "--report", "out.html")
        told = soter(*run, "--json")
    assert words.exit == told.exit == 4
    assert told.document["real_time"]["misses"] == 241
    (note,) = told.document["notes"]
    assert note.startswith("the trusted part was late: 241 misses, 0 are allowed (--misses)")
    assert note.endswith("the last command of SafeCart stayed, as it has no fail-safe law")
    assert note in words.out
    assert "LATE  the trusted part was: see the note" in words.out
    assert note in (here / "out.html").read_text()
    assert "longest silence 2005.0 ms, after 0.390 s" in words.out
    assert "1 with misses, 0 in which only plants or ACs were late" in words.out
    with over(cart, STOPPED):
        assert soter(*run, "--misses", "240").exit == 4
        allowed = soter(*run, "--misses", "241", "--json").document
    assert (allowed["exit"], allowed["real_time"]["misses_allowed"]) == (0, 241)
    assert allowed["notes"] == []


@pytest.mark.usefixtures("here")
def test_misses_are_counted_in_real_time_only(soter: Soter) -> None:
    done = soter("run", "cart.soter", "--misses", "3")
    assert done.exit == 2
    assert "`--misses` does nothing without `--real-time`" in done.err


# ---------------------------------------------------------------- externs that fail


@pytest.mark.parametrize(
    "body",
    ["os._exit(0)", "os.abort()", "time.sleep(60)", "while True: pass", "sys.exit(3)",
     "raise ValueError('boom')", "return float('nan')", "return 1e9", "return [1, 2]",
     "os.kill(os.getpid(), 9)", "x = bytearray(1 << 40)"],
)  # fmt: skip
def test_a_policy_that_fails_takes_nothing_with_it(
    soter: Soter, apart: Path, program: Path, body: str
) -> None:
    (apart / "fast.py").write_text(COUNTED.format(body=body))
    silent = body in ("time.sleep(60)", "while True: pass")
    with over(program, *(["answers:20:0"] if silent else [])):
        done = soter(*RUN)
    document = done.document
    assert done.exit == 0
    assert document["violations"] == 0
    assert document["instants"] == 201
    assert document["modules"]["SafeCart"]["gate_faults"] >= 1
    takeovers = document["real_time"]["modules"]["SafeCart"]["takeovers"]
    assert takeovers["silent"] + takeovers["gate"] >= 1


STOPS = """
import os
count = 0
def step(inputs):
    global count
    count += 1
    if count == 20:
        process = os.getpid()
        for _ in range({up}):
            process = int(open(f"/proc/{{process}}/stat").read().rpartition(")")[2].split()[1])
        os.kill(process, 19)
    return 1.0
"""


@pytest.mark.parametrize("up", [1, 2])
def test_a_policy_that_stops_who_started_it_gets_a_verdict_all_the_same(
    soter: Soter, apart: Path, program: Path, up: int
) -> None:
    """First who keeps the workers, then the driver."""
    (apart / "fast.py").write_text(STOPS.format(up=up))
    with over(program):
        done = soter(*RUN)
    assert (done.exit, done.document["instants"]) == (0, 201)


def test_a_policy_that_cannot_be_loaded_leaves_its_module_with_sc(
    soter: Soter, apart: Path, program: Path
) -> None:
    (apart / "fast.py").write_text("raise RuntimeError('not today')\n")
    with over(program):
        done = soter(*RUN)
    assert done.exit == 0
    assert done.document["modules"]["SafeCart"]["ac_share"] == 0.0
    assert any("not ready" in n for n in done.document["real_time"]["notes"])


@pytest.mark.usefixtures("apart")
def test_people_are_told_how_late_it_was(soter: Soter) -> None:
    """Built as it is shipped, by the machine's clock: however late it was."""
    done = soter("run", "cart.soter", "--real-time", "--until", "200ms", "--misses", "1000000")
    assert done.exit == 0
    for words in ("in real time", "policy ", "instants", "SafeCart.dm complete", "worker SafeCart"):
        assert words in done.out


@pytest.mark.usefixtures("here")
@pytest.mark.long
def test_people_are_told_of_leases(soter: Soter, tmp_path: Path) -> None:
    stop = EXAMPLES / "wall" / "stop.soter"
    run = ("run", str(stop), "--system", "Track", "--real-time", "--until", "200ms")
    track = owned(stop, tmp_path / "out", "Track")
    with over(track):
        (line,) = [x for x in soter(*run).out.splitlines() if "leases Guard" in x]
    assert line.endswith(" given")
    with over(track, "held:100000000:50000000"):
        late = soter(*run)
    assert late.exit == 4
    assert re.search(r"leases Guard: \d+ given, none from 0\.1\d* s on: the law", late.out)
    assert re.search(r"Guard was held by its law for the last \d+\.\d ms of it", late.out)


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
