"""Whoever reads what actuators say, or nobody: they apply the law, are armed, and end as told.

Of the actuators, which the machine's clock drives, it is asked what they apply, not when.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import pytest

import processes
from correct.test_arming import arm, leases, patient_actuator
from generators.c_packages import make
from generators.channel_programs import AC, LAW, Number, library, number_of, soon
from unit.runtime.test_messages_end_nobody import ENDS, READERS

if TYPE_CHECKING:
    import ctypes
    from pathlib import Path

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

STAYS = [signal.SIGPIPE, signal.SIGXFSZ, signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU, 32, 33]
FAULTS = [signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT, signal.SIGFPE, signal.SIGSYS]


@pytest.fixture(scope="module")
def actuator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return patient_actuator(tmp_path_factory.mktemp("actuator"))


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return library(tmp_path_factory.mktemp("library"))


class Acting:
    """Actuators that obey a command whose lease is long, until the test says otherwise."""

    def __init__(self, code: ctypes.CDLL, program: Path, folder: Path) -> None:
        self.program, self.folder = program, folder
        self.out = leases(code, program, folder, writes=True)
        number = number_of(program.with_name("stop"), "speed")
        self.speed = Number(code, folder, "speed", number, writes=False)

    def obeys(self, for_ns: int = 10**15) -> None:
        """A command with a lease is taken."""

        def obeyed() -> bool:
            now = time.monotonic_ns()
            self.out.write(now, now + for_ns, now + for_ns, AC)
            return self.speed.read() == AC

        soon(obeyed)

    def law(self) -> None:
        """Waits for the law."""
        soon(lambda: self.speed.read() == LAW)


def spoken(actuator: Path, folder: Path, stack: ExitStack, **given: Any) -> Any:
    """The actuators, which say what they do."""
    given.setdefault("stdout", processes.DEVNULL)
    words = [str(actuator), "--channels", str(folder)]
    return stack.enter_context(processes.started(words, **given))


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
@pytest.mark.parametrize("reader", READERS)
def test_whoever_reads_the_actuators_the_law_is_applied_and_they_are_armed(
    actuator: Path,
    code: ctypes.CDLL,
    tmp_path: Path,
    reader: str,
    stream: str,
) -> None:
    """They say that they obey, and that a lease has ended: each may be their last word."""
    files = READERS[reader]()
    with ExitStack() as stack:
        process = spoken(actuator, tmp_path, stack, **{stream: files[-1]})
        acting = Acting(code, actuator, tmp_path)
        acting.law()
        for _ in range(2):
            acting.obeys(300_000_000)
            acting.law()
            told, said = arm(actuator, tmp_path, "--unchecked")
            assert told == 0, said
        acting.obeys()
        process.send_signal(signal.SIGTERM)
        acting.law()
        assert process.wait(processes.TIMEOUT_S) in (0, 1)
    for file in files:
        os.close(file)


@pytest.mark.parametrize("closed", range(1, 8))
def test_no_channel_becomes_a_closed_descriptor(
    actuator: Path,
    code: ctypes.CDLL,
    tmp_path: Path,
    closed: int,
) -> None:
    """Words would be written into it."""

    def before() -> None:
        for number in (n for n in range(3) if closed >> n & 1):
            os.close(number)

    with ExitStack() as stack:
        process = spoken(actuator, tmp_path, stack, preexec_fn=before)
        acting = Acting(code, actuator, tmp_path)
        acting.law()
        for _ in range(2):
            acting.obeys(100_000_000)
            acting.law()
            assert arm(actuator, tmp_path, "--unchecked")[0] == 0
        process.send_signal(signal.SIGTERM)
        assert process.wait(processes.TIMEOUT_S) == 0
    assert [p.name for p in tmp_path.iterdir() if b"the la" in p.read_bytes()] == []


@pytest.mark.parametrize("number", ENDS)
def test_a_signal_ends_the_actuators_with_the_law(
    actuator: Path,
    code: ctypes.CDLL,
    tmp_path: Path,
    number: signal.Signals,
) -> None:
    with ExitStack() as stack:
        process = spoken(actuator, tmp_path, stack)
        acting = Acting(code, actuator, tmp_path)
        acting.law()
        acting.obeys()
        process.send_signal(number)
        assert process.wait(processes.TIMEOUT_S) == 0
        assert acting.speed.read() == LAW, "the last word"


@pytest.mark.parametrize("number", STAYS)
def test_a_signal_of_a_pipe_a_file_or_a_terminal_is_none(
    actuator: Path,
    code: ctypes.CDLL,
    tmp_path: Path,
    number: signal.Signals,
) -> None:
    with ExitStack() as stack:
        process = spoken(actuator, tmp_path, stack)
        acting = Acting(code, actuator, tmp_path)
        acting.law()
        acting.obeys(300_000_000)
        process.send_signal(number)
        acting.law()
        assert process.poll() is None


BLOCKS = """\
#include "soter_actuator.h"

#include <poll.h>
#include <unistd.h>

void soter_actuate(uint32_t module, const void* command, bool obeys) {
  (void)module;
  (void)command;
  (void)obeys;
  while (access("device", F_OK) == 0) {
    (void)poll(NULL, 0, 1);
  }
}
"""


@pytest.mark.parametrize("held_up", ["by a signal", "by a device"])
def test_a_request_that_nobody_answered_arms_nobody_later(
    actuator: Path, code: ctypes.CDLL, tmp_path: Path, held_up: str
) -> None:
    """The command has said that the actuators do not answer: then it may not act."""
    if held_up == "by a device":
        (actuator.parent / "actuate.c").write_text(BLOCKS)
        assert make(actuator.parent, "CFLAGS=-O1 -Werror", "stop_actuator").returncode == 0
    device = tmp_path / "device"
    with ExitStack() as stack:
        process = spoken(actuator, tmp_path, stack, cwd=tmp_path)
        acting = Acting(code, actuator, tmp_path)
        acting.law()
        acting.obeys(100_000_000)
        acting.law()
        device.touch()
        if held_up == "by a signal":
            process.send_signal(signal.SIGSTOP)
        told, said = arm(actuator, tmp_path, "--unchecked")
        assert told == 1
        assert "do not answer" in said
        device.unlink()
        process.send_signal(signal.SIGCONT)
        for _ in range(200):
            now = time.monotonic_ns()
            acting.out.write(now, now + 10**9, now + 10**9, AC)
            time.sleep(0.001)
            assert acting.speed.read() == LAW
        assert arm(actuator, tmp_path, "--unchecked")[0] == 0, "another one counts"
        acting.obeys()


def test_a_request_is_answered_before_a_device_holds_the_actuators_up(
    actuator: Path, code: ctypes.CDLL, tmp_path: Path
) -> None:
    """The command that is armed acts as soon as the device goes on: so it is no failure."""
    (actuator.parent / "actuate.c").write_text(BLOCKS.replace('"device"', 'obeys ? "device" : ""'))
    assert make(actuator.parent, "CFLAGS=-O1 -Werror", "stop_actuator").returncode == 0
    with ExitStack() as stack:
        spoken(actuator, tmp_path, stack, cwd=tmp_path)
        acting = Acting(code, actuator, tmp_path)
        acting.law()
        acting.obeys(100_000_000)
        acting.law()
        (tmp_path / "device").touch()
        now = time.monotonic_ns()
        acting.out.write(now, now + 10**15, now + 10**15, AC)
        assert arm(actuator, tmp_path)[0] == 0
        (tmp_path / "device").unlink()
        acting.obeys()


ACTUATE = """\
#include "soter_actuator.h"

#include <stdio.h>
#include <string.h>

void soter_actuate(uint32_t module, const void* command, bool obeys) {
  static FILE* out;
  double speed = 0.0;
  (void)module;
  (void)obeys;
  out = out == NULL ? fopen("applied", "w") : out;
  (void)memcpy(&speed, command, sizeof speed);
  rewind(out);
  (void)fprintf(out, "%-9g\\n", speed);
  (void)fflush(out);
}
"""


@pytest.mark.parametrize("number", FAULTS)
def test_a_fault_of_the_actuators_gives_the_devices_the_law_until_they_are_ended(
    actuator: Path, code: ctypes.CDLL, tmp_path: Path, number: signal.Signals
) -> None:
    """Somebody cut the file of a channel, say."""
    (actuator.parent / "actuate.c").write_text(ACTUATE)
    assert make(actuator.parent, "CFLAGS=-O1 -Werror", "stop_actuator").returncode == 0
    applied = tmp_path / "applied"
    with ExitStack() as stack:
        process = spoken(actuator, tmp_path, stack, cwd=tmp_path, stderr=processes.PIPE)
        acting = Acting(code, actuator, tmp_path)
        acting.law()
        acting.obeys()
        soon(lambda: float(applied.read_text() or "0") == AC)
        process.send_signal(number)
        soon(lambda: float(applied.read_text() or "0") == LAW)
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=processes.TIMEOUT_S)
    assert process.returncode == 70
    assert f"soter has a defect: signal:{number.value}: ".encode() in said
