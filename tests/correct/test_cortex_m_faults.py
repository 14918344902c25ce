"""What an untrusted step does to a core without processes: DM and SC go on, and SC takes over.

Six kinds of harm, from any of fifty releases on. What the trusted part does is compared, byte for
byte, with a run on this machine in which the same steps fail in a civil way.
"""

from __future__ import annotations

import hashlib
import re
from itertools import count
from typing import TYPE_CHECKING

import pytest

import soter
from correct.test_cortex_m import BOARDS, make, wanted
from generators.shipped_programs import ROOT
from long_tests import examples
from soter.core.steps import lower
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram
from soter.targets.cortex_m_board import Replay
from soter.targets.cortex_m_package import cortex_m_package
from soter.targets.takeover_bounds import takeover_bounds
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.model.system import System

KINDS = ("endless", "wild writes", "stack", "division by zero", "runs data", "protection")
EARLY = frozenset((1, 2, 3, 4, 5))
"""What the core notices at once; an endless step is noticed when its budget ends."""
LIMITS = examples(2)
UNTIL_NS = 1_500_000_000
MARK = (0x600DF00D).to_bytes(4, "little")
RUNS = count(1)
FAST = re.compile(r"^node Fast .*?^}\n", re.MULTILINE | re.DOTALL)
EXTERN = """\
extern node Fast period 10ms from "c:hostile_ac.c:hostile" {
  subscribes motion, goal;
  publishes accel;
}
"""


def hostile_system(folder: Path) -> System:
    text, number = FAST.subn(EXTERN, (ROOT / "examples" / "wall" / "cart.soter").read_text())
    assert number == 1
    (folder / "cart.soter").write_text(text)
    source = ROOT / "tests" / "generators" / "hostile_ac.c"
    (folder / "hostile_ac.c").write_text(source.read_text())
    return system_of(check_file(str(folder / "cart.soter")), "Protected")


def here(system: System, limit: int, monkeypatch: pytest.MonkeyPatch) -> tuple[str, str]:
    """The hashes of the loop, computed from a run on this machine: all, and what is trusted."""
    monkeypatch.setenv("HOSTILE_LIMIT", str(1000 * next(RUNS) + limit))
    native = NativeProgram(system)
    run = native.run(UNTIL_NS, 1, keep_trace=True, hash_trace=True)
    assert run.trace is not None
    trusted = hashlib.sha256()
    assert native.dtype.fields is not None
    begin = native.dtype.fields["stamps"][1]
    for state in run.trace:
        for module in state["modules"]:
            trusted.update(bytes([module["mode"]]))
        trusted.update(state.tobytes()[begin:])
    assert run.trace_sha256
    return run.trace_sha256, trusted.hexdigest()


@all_rows("name", BOARDS)
@all_rows("kind", range(len(KINDS)), ids=KINDS)
def test_the_trusted_part_goes_on_and_sc_takes_over(
    kind: int, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    board = wanted(name)
    system = hostile_system(tmp_path)
    (bound,) = takeover_bounds(system)
    replay = Replay(UNTIL_NS, 1)
    package = cortex_m_package(system, lower(system), tmp_path / "out", board, replay).write()
    traced = ("LOOP=-DSOTER_TRACED", f"CFLAGS=-Os -DKIND={kind}")
    made = make(package.folder, "cart_loop.elf", *traced)
    assert made.returncode == 0, made.stderr
    image = (package.folder / "cart_loop.elf").read_bytes()
    assert image.count(MARK) == 1
    for limit in range(1, 3 * LIMITS, 3):
        changed = image.replace(MARK, limit.to_bytes(4, "little"))
        (package.folder / "cart_loop.elf").write_bytes(changed)
        said = make(package.folder, "-s", "run-loop", *traced).stdout
        facts = dict(re.findall(r"^(\w+) (\w+)", said, re.MULTILINE))
        whole, trusted = here(system, limit, monkeypatch)
        assert facts["trusted_sha256"] == trusted, (limit, said)
        assert facts["trace_sha256"] == whole or kind not in EARLY, (limit, said)
        assert 0 < int(facts["takeover"]) <= bound.longest, (limit, said)


# ---------------------------------------------------------------- the trusted part, and actuators

NOTHING, SILENCE, FAULT, HANG, CHECK = range(5)
WHEN = 1000
"""The tick, a millisecond each, at which something happens."""
AGE = 20
"""ms: `max_age` of the position."""


def told_by_the_board(kind: int, folder: Path) -> list[tuple[int, str, int]]:
    """Which start, who is obeyed, from which tick on."""
    wanted("mps2-an500")
    board = ROOT / "tests" / "generators" / "telling_board.c"
    shuttle = ROOT / "examples" / "wall" / "shuttle_firmware.soter"
    package = soter.load(shuttle).build("cortex-m", folder / "out", board=str(board))
    done = make(package.folder, "-s", "run-loop", f"CFLAGS=-Os -DKIND={kind}")
    assert "another law" not in done.stdout
    lines = re.findall(r"^start (\d+): (the law|a lease) from (\d+)$", done.stdout, re.MULTILINE)
    return [(int(start), who, int(tick)) for start, who, tick in lines]


def test_the_law_is_held_until_the_start_set_was_checked(tmp_path: Path) -> None:
    first, second = told_by_the_board(NOTHING, tmp_path)
    assert first == (1, "the law", 1)
    assert second[:2] == (1, "a lease")
    assert second[2] < 100


def test_a_sensor_that_falls_silent_ends_the_lease_for_good(tmp_path: Path) -> None:
    *_, last = told_by_the_board(SILENCE, tmp_path)
    assert last[:2] == (1, "the law")
    assert WHEN < last[2] <= WHEN + AGE + 15, "its age, SC's period, and when it is late"


@pytest.mark.parametrize("kind", [FAULT, CHECK, HANG], ids=["fault", "check", "hang"])
def test_a_trusted_part_that_ends_leaves_the_law_and_a_restart_checks_the_start_set(
    kind: int, tmp_path: Path
) -> None:
    """After the reset the robot is where `safer` does not hold: the law, until it does."""
    lines = told_by_the_board(kind, tmp_path)
    law = lines[2]
    assert law[:2] == (1, "the law")
    assert WHEN < law[2] <= WHEN + 15, "a lease is 13 ms long, and looked at every millisecond"
    assert lines[3] == (2, "the law", 1)
    assert lines[4][:2] == (2, "a lease")
    assert WHEN // 2 <= lines[4][2] <= WHEN // 2 + 100, "two looks of a DM after it is safer"


# ---------------------------------------------------------------- in time, and how late

INSIDE, BEYOND = 3000, 12_000
"""Turns of a loop in SC that take 0.34 ms in the emulator, and 1.4 ms: of 0.2 and 1 ms allowed."""


@pytest.mark.parametrize(("busy", "obeyed"), [(INSIDE, True), (BEYOND, False)])
def test_an_sc_that_is_out_later_than_late_and_inside_its_response_keeps_its_lease(
    busy: int, obeyed: bool, tmp_path: Path
) -> None:
    """It steps five times as often as its DM: it begins by a reading of the clock of its own."""
    wanted("mps2-an500")
    walls = ROOT / "examples" / "wall"
    for name in ("shuttle.soter", "shuttle_firmware.soter"):
        text = (walls / name).read_text()
        (tmp_path / name).write_text(text.replace("late dm 1ms, sc 1ms", "late dm 100us, sc 200us"))
    board = ROOT / "tests" / "generators" / "telling_board.c"
    package = soter.load(tmp_path / "shuttle_firmware.soter").build(
        "cortex-m", tmp_path / "out", board=str(board)
    )
    program = package.folder / "shuttle_firmware.c"
    text, number = re.subn(
        r"(soter_fault shuttle_firmware_Guard_Back_step\([^{;]*\{\n)",
        rf"\1  for (volatile int busy = 0; busy < {busy}; busy++) {{\n  }}\n",
        program.read_text(),
    )
    assert number == 1
    program.write_text(text)
    said = make(package.folder, "-s", "run-loop", "CFLAGS=-Os -DKIND=0").stdout
    lines = re.findall(r"^start (\d+): (the law|a lease) from (\d+)$", said, re.MULTILINE)
    assert ([who for _, who, _ in lines] == ["the law", "a lease"]) == obeyed, said
