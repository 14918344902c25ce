"""Actuators whose leases have ended: who may arm them, in which state, and what they say of it.

The actuators run; the trusted part is played by the test, which writes commands with leases, or
runs over the clock of the test. Leases here last longer than any test.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

import processes
import soter
from generators.c_packages import make
from generators.channel_programs import (
    AC,
    LAW,
    PROGRAM,
    SC,
    Number,
    Words,
    ended,
    going,
    library,
    number_of,
    soon,
    source_in,
)
from generators.posix_packages import owned, report

if TYPE_CHECKING:
    import ctypes
    from collections.abc import Iterator, Sequence
    from pathlib import Path

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

LONG_NS = 10**15
NEVER = -1
PERIOD_NS, LATE_NS = 200_000_000, 20_000_000
"""Of the DM of the program."""
HEAD, SURE, SAFER = 3, 1, 2
LEASE = HEAD + 9
MAX_AGE_NS = 600_000_000
"""Words of soter_status.h: of the head; of a module, after its mode."""


@pytest.fixture(scope="module")
def actuator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return patient_actuator(tmp_path_factory.mktemp("actuator"))


def patient_actuator(folder: Path) -> Path:
    """The program of the actuators, which take leases of any length."""
    soter.load(source_in(folder)).build("posix", folder / "out", "Vehicle")
    law = folder / "out" / "stop_lease.c"
    text, count = re.subn(
        r"\.longest = INT64_C\(\d+\)", f".longest = {2 * LONG_NS}", law.read_text()
    )
    assert count == 1
    law.write_text(text)
    done = make(folder / "out", "CFLAGS=-O1 -Werror", "stop_actuator")
    assert done.returncode == 0, done.stderr
    return folder / "out" / "stop_actuator"


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The trusted part over the clock of the test."""
    folder = tmp_path_factory.mktemp("vehicle")
    source = source_in(folder, PROGRAM.replace("position > 30.0", "position > 45.0"))
    return owned(source, folder / "out", "Vehicle")


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return library(tmp_path_factory.mktemp("library"))


def leases(code: ctypes.CDLL, program: Path, folder: Path, *, writes: bool) -> Words:
    """The channel of commands with their leases: stamp, end, until when to begin, the command."""
    table = program.with_name("soter_posix_app.c").read_text()
    (name, number) = re.findall(r'\.channel = "([^"]+)",\s+\.hash = UINT64_C\((\w+)\)', table)[0]
    return Words(code, folder, name, int(number, 16), 4, writes=writes)


def arm(program: Path, folder: Path, *words: str) -> tuple[int, str]:
    """As a person does: the exit code and what is said."""
    command: list[str | Path] = [program, "--channels", folder, "--arm", *words]
    done = processes.run(command, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


class Played:
    """Actuators whose first lease has ended, and the trusted part that the test plays."""

    def __init__(self, code: ctypes.CDLL, program: Path, folder: Path) -> None:
        self.out = leases(code, program, folder, writes=True)
        number = number_of(program.with_name("stop"), "speed")
        self.speed = Number(code, folder, "speed", number, writes=False)
        soon(lambda: self.speed.read() == LAW)
        soon(self.obeyed_once)
        soon(lambda: self.speed.read() == LAW)

    def obeyed_once(self) -> bool:
        """A lease that ends at once; they have to be awake to take it."""
        now = time.monotonic_ns()
        self.out.write(now, now + 200_000_000, NEVER, SC)
        return SC in self.turns(5)

    def command(self, value: float, *, begin: bool, over: bool = False) -> None:
        now = time.monotonic_ns()
        until = now if over else now + LONG_NS
        self.out.write(now, until, now + LONG_NS if begin else NEVER, value)
        self.turns(5)

    def turns(self, count: int) -> set[float]:
        """What was applied in so many turns of the actuators from now on, in which they listen."""
        found = set()
        for _ in range(count):
            self.speed.read()
            soon(lambda: self.speed.read() is not None and self.speed.fresh)
            found.add(self.speed.read())
        return found

    def holds_law(self) -> bool:
        return self.turns(100) == {LAW}


def test_a_command_in_a_state_to_begin_from_is_armed_and_obeyed(
    actuator: Path, code: ctypes.CDLL, tmp_path: Path
) -> None:
    with going(actuator, tmp_path) as process:
        played = Played(code, actuator, tmp_path)
        played.command(AC, begin=True)
        assert played.holds_law(), "nobody has armed them"
        told, said = arm(actuator, tmp_path)
        assert told == 0, said
        assert f"armed: process {process.pid}\n" in said
        soon(lambda: played.speed.read() == AC)
        counts = ended(process)
    assert (counts["armed"], counts["not_armed"]) == (1, 0)


@pytest.mark.parametrize(
    ("begin", "over", "why"),
    [
        (False, False, "safer does not hold in every module, or what it reads is old"),
        (True, True, "the trusted part gives no lease"),
    ],
)
def test_what_no_proof_speaks_of_is_not_armed_but_by_an_explicit_word(
    actuator: Path, code: ctypes.CDLL, tmp_path: Path, begin: bool, over: bool, why: str
) -> None:
    with going(actuator, tmp_path) as process:
        played = Played(code, actuator, tmp_path)
        played.command(AC, begin=begin, over=over)
        told, said = arm(actuator, tmp_path)
        assert told == 1
        assert f"not armed: Guard: {why}" in said
        played.command(AC, begin=True)
        assert played.holds_law(), "the request was answered: nothing begins by itself later"
        played.command(AC, begin=begin, over=over)
        told, said = arm(actuator, tmp_path, "--unchecked")
        assert told == 0, said
        assert "no proof" in said
        played.command(AC, begin=False)
        soon(lambda: played.speed.read() == AC)
        counts = ended(process)
    assert (counts["armed"], counts["not_armed"]) == (1, 1)


def test_who_arms_what_is_armed_already_is_told_so_and_changes_nothing(
    actuator: Path, code: ctypes.CDLL, tmp_path: Path
) -> None:
    already = "Guard: armed already: nothing was changed\n"
    with going(actuator, tmp_path) as process:
        soon(lambda: arm(actuator, tmp_path) == (0, already))  # since they began
        played = Played(code, actuator, tmp_path)
        played.command(AC, begin=True)
        told, said = arm(actuator, tmp_path)
        assert (told, already in said) == (0, False), said
        assert arm(actuator, tmp_path, "--unchecked") == (0, already)
        soon(lambda: played.speed.read() == AC)
        ended(process)


def test_who_asks_where_no_actuators_run_is_told(actuator: Path, tmp_path: Path) -> None:
    told, said = arm(actuator, tmp_path)
    assert told == 1
    assert "no actuators of this program run" in said


def test_a_process_of_another_program_gets_no_signal(
    actuator: Path, code: ctypes.CDLL, tmp_path: Path
) -> None:
    header = actuator.with_name("soter_actuator_app.h").read_text()
    (number,) = re.findall(r"ACTUATOR_STATUS_HASH UINT64_C\((\w+)\)", header)
    told = Words(code, tmp_path, "soter.actuators", int(number, 16), 6, writes=True)
    with processes.started([sys.executable, "-c", "input()"], stdin=processes.PIPE) as other:
        told.write(other.pid, 0, 0, 3, 0, 0)
        done, said = arm(actuator, tmp_path)
        assert done == 1
        assert "no actuators of this program run" in said
        assert other.poll() is None, "the signal would have ended it"


# ---------------------------------------------------------------- what an answer tells

NOBODY = 1
UNLOOKED = "without a look at the state"
ANSWERS = (
    (
        "others began meanwhile, and nobody asked them",
        False,
        (NOBODY, 0, 0, 1, 0, 0),
        1,
        "do not answer",
    ),
    ("others began, who were asked before", False, (NOBODY, 4, 1, 2, 1, 0), 1, "do not answer"),
    ("somebody else armed without a look", False, (0, 3, 1, 1, 2, 0), 0, f"armed, {UNLOOKED}"),
    ("somebody else armed with a look", True, (0, 3, 1, 1, 1, 0), 0, "armed: process"),
)
"""Whether `--unchecked` was asked; what actuators say then, 0 the process that was asked."""


@pytest.mark.parametrize(
    ("unchecked", "words", "told", "said"), [a[1:] for a in ANSWERS], ids=[a[0] for a in ANSWERS]
)
def test_an_answer_is_that_of_who_was_asked_and_says_how_it_was_armed(
    actuator: Path,
    code: ctypes.CDLL,
    tmp_path: Path,
    unchecked: bool,
    words: tuple[int, ...],
    told: int,
    said: str,
) -> None:
    options = ["--unchecked"] * unchecked
    with asked(
        actuator, code, tmp_path, words, options, stdout=processes.PIPE, stderr=processes.STDOUT
    ) as process:
        assert said in process.communicate()[0].decode()
        assert process.returncode == told


def test_who_armed_is_told_by_the_exit_code_where_nobody_reads_words(
    actuator: Path, code: ctypes.CDLL, tmp_path: Path
) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with asked(actuator, code, tmp_path, (0, 3, 1, 2, 1, 0), [], stdout=writer) as process:
        os.close(writer)
        assert process.wait() == 0


@contextmanager
def asked(
    program: Path,
    code: ctypes.CDLL,
    folder: Path,
    words: Sequence[int],
    options: Sequence[str],
    **streams: Any,
) -> Iterator[processes.Process]:
    """`--arm`, and actuators that the test plays: a process that the request ends, then `words`."""
    header = program.with_name("soter_actuator_app.h").read_text()
    (number,) = re.findall(r"ACTUATOR_STATUS_HASH UINT64_C\((\w+)\)", header)
    told = Words(code, folder, "soter.actuators", int(number, 16), 6, writes=True)
    of_its_name = shutil.copy(shutil.which("sleep") or "", folder / program.name)
    with processes.started([of_its_name, str(LONG_NS)]) as other:
        told.write(other.pid, 2, 1, 3, 0, 0)
        command: list[str | Path] = [program, "--channels", folder, "--arm", *options]
        with processes.started(command, **streams) as process:

            def has_asked() -> bool:
                told.write(other.pid, 2, 1, 3, 0, 0)
                return other.poll() is not None

            soon(has_asked)
            told.write(words[0] or other.pid, *words[1:])
            yield process


# ---------------------------------------------------------------- what the trusted part says


def run_at(
    vehicle: Path, code: ctypes.CDLL, folder: Path, position: float, until: str
) -> tuple[list[int], list[int]]:
    """The last command with its lease, and the last status, of a run at this position."""
    sensor = Number(code, folder, "position", number_of(vehicle, "position"), writes=True)
    sensor.write(position)
    table = vehicle.with_name("soter_app.h").read_text()
    (number,) = re.findall(r"APP_STATUS_HASH UINT64_C\((\w+)\)", table)
    status = Words(code, folder, "soter.status", int(number, 16), 24, writes=False)
    channel = leases(code, vehicle, folder, writes=False)
    events = [f"clock:{time.monotonic_ns()}:0"]
    options = ["--channels", str(folder), "--until", until, "--wait", "0"]
    report(vehicle, *options, events=events)
    given, told = channel.read(), status.read()
    assert given is not None
    assert told is not None
    return given[1], told[1]


def test_the_status_says_which_reading_the_leases_ended_with(
    vehicle: Path, code: ctypes.CDLL, tmp_path: Path
) -> None:
    _, words = run_at(vehicle, code, tmp_path, 10.0, "1.5")
    _, stale, ended, topic, age_ns, most_ns = words[LEASE : LEASE + 6]
    assert (stale > 0, ended, topic) == (True, 1, 1), "position is the first of those outside"
    assert most_ns == MAX_AGE_NS < age_ns < MAX_AGE_NS + PERIOD_NS
    _, words = run_at(vehicle, code, tmp_path, 10.0, "0.35")
    assert words[LEASE + 1 : LEASE + 6] == [0] * 5, "they go on"


@pytest.mark.parametrize(
    ("position", "safer", "ac"), [(10.0, True, True), (39.5, False, False), (42.0, False, False)]
)
def test_a_lease_says_until_when_actuators_may_begin_by_what_the_last_look_found(
    vehicle: Path, code: ctypes.CDLL, tmp_path: Path, position: float, safer: bool, ac: bool
) -> None:
    (stamp, _, begin, _), words = run_at(vehicle, code, tmp_path, position, "0.35")
    assert (stamp < begin <= stamp + PERIOD_NS) == safer, "until the DM looks again"
    assert (begin > 0) == safer
    module = words[HEAD:]
    assert (module[0] == 1, module[SAFER] == 1) == (ac, safer)
    assert module[SURE] == (begin - LATE_NS if ac else 0), "both count from the last look"
