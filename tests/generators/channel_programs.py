"""Programs that meet the world through channels, for tests: a stop, its world, its actuators.

Purpose: the three processes of a system with a fail-safe law, and a channel from Python.
Non-goals: judging how late a machine is: all times of the program are generous.
"""

from __future__ import annotations

import ctypes
import json
import re
import signal
import struct
import time
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import processes
import soter
from generators.c_packages import make
from soter.native.shared_library import RUNTIME

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from processes import Process

AC, SC, LAW = 1.0, 0.25, -0.5
PROGRAM = f"""soter 1;
// What moves tells who moves it: AC {AC}, SC {SC}, the law {LAW}.
topic position: float in [-50.0, 50.0] max_age 600ms;
topic speed: float in [-1.0, 1.0] = 0.0;

plant Cart period 50ms {{
  reads speed;
  drives position = x;
  state x: float = 0.0;
  der x = speed;
}}
node Fast period 100ms {{ publishes speed; step {{ publish speed = {AC}; }} }}
node Stop period 100ms {{  // beyond 30 m a defect: the value is not in the topic's set
  subscribes position;
  publishes speed;
  step {{ publish speed = position > 30.0 ? 2.0 : {SC}; }}
}}

rta Guard {{
  ac Fast;
  sc Stop;
  period 200ms;
  safe abs(position) < 45.0;
  ttf abs(position) > 40.0;
  safer abs(position) < 39.0;
  failsafe speed = {LAW};
  verify {{
    grid position in [-45.0, 45.0] / 100;
    late dm 20ms, sc 20ms;
    response dm 20ms, sc 20ms;
  }}
}}
system Track default {{ c: Cart; module Guard; until 2s; always abs(c.truth.x) < 45.0; }}
system Vehicle {{ external topic position; external topic speed; module Guard; }}
system World {{ c: Cart; external topic position; external topic speed; }}
"""


@dataclass(frozen=True)
class Programs:
    """What was built: the trusted part, its actuators, the world around it."""

    trusted: Path
    actuator: Path
    world: Path


def source_in(folder: Path, text: str = PROGRAM) -> Path:
    """The program, or another text, as FOLDER/stop.soter."""
    source = folder / "stop.soter"
    source.write_text(text)
    return source


def programs(folder: Path) -> Programs:
    """All three, compiled without a warning."""
    source = source_in(folder)
    for system in ("Vehicle", "World"):
        soter.load(source).build("posix", folder / system, system)
        done = make(folder / system, "CFLAGS=-O2 -Werror")
        assert done.returncode == 0, done.stdout + done.stderr
    trusted = folder / "Vehicle" / "stop"
    return Programs(trusted, trusted.with_name("stop_actuator"), folder / "World" / "stop")


# ---------------------------------------------------------------- a channel from Python


class Outside(ctypes.Structure):
    """soter_outside of soter_outside.h."""

    _fields_ = (
        ("place", ctypes.c_void_p * 2),
        ("bell", ctypes.c_void_p),
        ("room", ctypes.c_void_p),
        ("size", ctypes.c_size_t),
        ("hash", ctypes.c_uint64),
        ("number", ctypes.c_uint64),
        ("file", ctypes.c_int),
    )


def library(folder: Path) -> ctypes.CDLL:
    """`soter_outside.c`, to be called from here."""
    posix = RUNTIME / "posix"
    made = folder / "outside.so"
    names = ("soter_outside.c", "soter_channel.c", "soter_posix_check.c")
    sources: list[str | Path] = [posix / name for name in names]
    flags = ["-O1", "-shared", "-fPIC", f"-I{posix}", f"-I{RUNTIME}", "-o", str(made)]
    processes.run(["cc", *flags, *sources], check=True)
    shared_library = ctypes.CDLL(str(made))
    shared_library.soter_outside_open.restype = ctypes.c_char_p
    shared_library.soter_outside_read.restype = ctypes.c_bool
    return shared_library


class Number:
    """A channel of one float; its writer until it is dropped."""

    def __init__(
        self, code: ctypes.CDLL, folder: Path, name: str, number: int, *, writes: bool
    ) -> None:
        self._code, self._channel = code, Outside()
        self.wrong = code.soter_outside_open(
            ctypes.byref(self._channel),
            str(folder).encode(),
            name.encode(),
            ctypes.c_uint64(number),
            ctypes.c_size_t(8),
            ctypes.c_bool(writes),
        )
        self._last = None if writes else float("nan")
        self.fresh = False

    def __del__(self) -> None:
        self._code.soter_outside_close(ctypes.byref(self._channel))

    def wait(self, most_ns: int) -> None:
        self._code.soter_outside_wait(ctypes.byref(self._channel), ctypes.c_int64(most_ns))

    def write(self, value: float, behind_ns: int = 0) -> None:
        measured = ctypes.c_int64(time.monotonic_ns() - behind_ns)
        given = ctypes.c_double(value)
        self._code.soter_outside_write(ctypes.byref(self._channel), measured, ctypes.byref(given))

    def read(self) -> float:
        """The last value that anybody wrote; NaN before the first."""
        stamp, value = ctypes.c_int64(), ctypes.c_double()
        self.fresh = self._code.soter_outside_read(
            ctypes.byref(self._channel), ctypes.byref(stamp), ctypes.byref(value), None
        )
        if self.fresh:
            self._last = value.value
        assert self._last is not None
        return self._last


class Words:
    """A channel of whole numbers of 64 bits; its writer until it is dropped."""

    def __init__(
        self, code: ctypes.CDLL, folder: Path, name: str, number: int, count: int, *, writes: bool
    ) -> None:
        self._code, self._channel, self._count = code, Outside(), count
        wrong = code.soter_outside_open(
            ctypes.byref(self._channel),
            str(folder).encode(),
            name.encode(),
            ctypes.c_uint64(number),
            ctypes.c_size_t(8 * count),
            ctypes.c_bool(writes),
        )
        assert wrong is None, wrong

    def __del__(self) -> None:
        self._code.soter_outside_close(ctypes.byref(self._channel))

    def write(self, *words: float) -> None:
        """Now; a float is written as its bits."""
        kinds = "".join("d" if isinstance(w, float) else "q" for w in words)
        now = ctypes.c_int64(time.monotonic_ns())
        message = struct.pack(f"={kinds}", *words)
        assert len(message) == 8 * self._count
        self._code.soter_outside_write(ctypes.byref(self._channel), now, message)

    def read(self) -> tuple[int, list[int]] | None:
        """When it was written, and the numbers; None where nothing new is there."""
        stamp, room = ctypes.c_int64(), (ctypes.c_int64 * self._count)()
        fresh = self._code.soter_outside_read(
            ctypes.byref(self._channel), ctypes.byref(stamp), ctypes.byref(room), None
        )
        return (stamp.value, [*room]) if fresh else None


def number_of(program: Path, topic: str) -> int:
    """Of the layout of a topic, as the package's header has it."""
    header = program.with_name(f"{program.name}_channels.h").read_text()
    (hex_digits,) = re.findall(rf'"{topic}", UINT64_C\((0x[0-9a-f]+)\)', header)
    return int(hex_digits, 16)


# ---------------------------------------------------------------- processes


@contextmanager
def going(program: Path, folder: Path, *options: str) -> Iterator[Process]:
    """A program of `Programs`, until the block is left."""
    command = [str(program), "--channels", str(folder), "--json", "--quiet", *options]
    with processes.started(command, stdout=processes.PIPE, stderr=processes.PIPE) as process:
        yield process


def ended(process: Process) -> dict[str, Any]:
    """Ends a program; its report."""
    process.send_signal(signal.SIGTERM)
    out, said = process.communicate(timeout=processes.TIMEOUT_S)
    assert out, said
    run_report: dict[str, Any] = json.loads(out)
    return run_report


def soon(what: Callable[[], bool]) -> None:
    """Waits until something is so; generous, as machines are busy."""
    end = time.monotonic() + processes.TIMEOUT_S
    while not what():
        assert time.monotonic() < end, "it is not so"
        time.sleep(0.01)
