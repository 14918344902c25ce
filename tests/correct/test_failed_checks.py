"""A check of the run-time that fails: nothing goes on as if it held, and actuators hold the law.

What fails is broken on purpose, by C that is linked into the program and calls a function of the
run-time as nobody may, in a step of the AC or of the SC.
"""

from __future__ import annotations

import ctypes
import os
import re
import signal
import struct
import sys
import time
from contextlib import suppress
from typing import TYPE_CHECKING

import pytest

import processes
import soter
from generators.c_packages import EXAMPLES, make
from generators.channel_programs import (
    AC,
    LAW,
    PROGRAM,
    SC,
    Number,
    going,
    library,
    number_of,
    soon,
    source_in,
)
from generators.elf import undefined_symbols
from generators.posix_packages import FORGIVING, PATIENT, QUIET, owned
from soter.native.cache import SOTER
from soter.native.compiler import STRICT, WARNINGS, find_compiler

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")

DEFECT = 70
GONE = 1
"""`soter run` of a process in which linked C has ended all (X011)."""
BREAKS = """\
#include <stdlib.h>
#include <string.h>
@INCLUDE@
static double step_of(const char* who, double x, int* steps) {
  const char* const breaks = getenv("BREAKS");
  ++*steps;
  if (breaks != NULL && strcmp(breaks, who) == 0 && *steps == 8) {
    @CALL@;
  }
  return x;
}
double ac_of(double x);
double ac_of(double x) {
  static int steps;
  return step_of("ac", x, &steps);
}
double sc_of(double x);
double sc_of(double x) {
  static int steps;
  return step_of("sc", x, &steps);
}
"""
CALLS = {
    "posix": ('#include "soter_channel.h"', "soter_channel_write(NULL, NULL, 0, NULL)"),
    "c": ('#include "soter.h"', "soter_progress(NULL, NULL)"),
}
SAID = {
    "posix": r"soter_channel\.c:\d+: not segment != NULL && \(uintptr_t\)segment % .*",
    "c": r"soter_kernel\.c:\d+: not p != NULL",
}
"""What a target is made to call, and what is said of it."""


def broken(folder: Path, target: str) -> Path:
    """The stop, whose AC and SC call C that breaks an invariant in its eighth step, if asked to."""
    include, call = CALLS[target]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "breaks.c").write_text(BREAKS.replace("@INCLUDE@", include).replace("@CALL@", call))
    text = PROGRAM.replace(f"publish speed = {AC};", f"publish speed = ac_of({AC});")
    text = text.replace(f"2.0 : {SC};", f"2.0 : sc_of({SC});")
    assert text.count("c_of(") == 2
    text = text.replace(
        "\nplant Cart",
        '\nextern fun ac_of(x: float): float from "c:breaks.c:ac_of";\n'
        'extern fun sc_of(x: float): float from "c:breaks.c:sc_of";\n\nplant Cart',
        1,
    )
    return source_in(folder, text)


# ---------------------------------------------------------------- at a desk


@pytest.mark.parametrize("who", ["ac", "sc"])
def test_a_run_in_virtual_time_ends_as_a_defect(tmp_path: Path, who: str) -> None:
    source = broken(tmp_path, "c")
    soter.load(source).build("c", tmp_path / "out")
    done = make(tmp_path / "out", "CFLAGS=-O2 -Werror -DNDEBUG")
    assert done.returncode == 0, done.stderr
    environment = {**os.environ, "BREAKS": who}
    made: list[str | Path] = [tmp_path / "out" / "stop"]
    run: list[str | Path] = [sys.executable, "-m", "soter", "run", source]
    for command, code in ((made, DEFECT), (run, GONE)):
        found = processes.run(command, capture_output=True, text=True, env=environment)
        assert found.returncode == code, found.stdout + found.stderr
        assert re.search(f"soter has a defect.*: {SAID['c']}\n", found.stderr)
        assert "safe" not in found.stdout
    fine = processes.run(made, capture_output=True, text=True)
    assert fine.returncode == 0, "nobody asked for it"


# ---------------------------------------------------------------- in real time


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The trusted part over the clock of the test."""
    folder = tmp_path_factory.mktemp("vehicle")
    return owned(broken(folder, "posix"), folder / "out", "Vehicle")


@pytest.fixture(scope="module")
def code(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return library(tmp_path_factory.mktemp("library"))


@pytest.mark.parametrize("who", ["ac", "sc"])
def test_the_driver_ends_at_once_and_says_where(
    vehicle: Path, code: ctypes.CDLL, tmp_path: Path, who: str
) -> None:
    position = Number(code, tmp_path, "position", number_of(vehicle, "position"), writes=True)
    position.write(1.0)
    events = f"clock:{time.monotonic_ns()}:0"
    options = [*QUIET, *PATIENT, "--channels", str(tmp_path), "--until", "2", "--wait", "0"]
    environment = {**os.environ, "OWNED_CLOCK": events, "BREAKS": who}
    done = processes.run([vehicle, *options], capture_output=True, text=True, env=environment)
    assert done.returncode == DEFECT, done.stdout + done.stderr
    assert re.fullmatch(f"soter has a defect: {SAID['posix']}\n", done.stderr)
    assert done.stdout == "", "a report would be one of a run"


def test_nobody_who_does_not_read_holds_it_up(vehicle: Path, tmp_path: Path) -> None:
    """Standard error is a pipe that is full: the line is lost, and the end comes all the same."""
    _, full = os.pipe()
    os.set_blocking(full, False)
    with suppress(BlockingIOError):
        while True:
            os.write(full, b" " * 4096)
    os.set_blocking(full, True)
    options = [*QUIET, *PATIENT, "--channels", str(tmp_path), "--until", "2", "--wait", "0"]
    environment = {**os.environ, "BREAKS": "sc", "OWNED_CLOCK": ""}
    done = processes.run([vehicle, *options], stderr=full, env=environment)
    assert done.returncode == DEFECT


@pytest.mark.real_time
@pytest.mark.parametrize("who", ["ac", "sc"])
def test_the_actuators_hold_the_law_when_a_check_fails_in_a_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: ctypes.CDLL, who: str
) -> None:
    made = broken(tmp_path / "source", "posix")
    for system in ("Vehicle", "World"):
        soter.load(made).build("posix", tmp_path / system, system)
        assert make(tmp_path / system, "CFLAGS=-O2 -Werror").returncode == 0
    trusted = tmp_path / "Vehicle" / "stop"
    channels = tmp_path / "channels"
    channels.mkdir()
    speed = Number(code, channels, "speed", number_of(trusted, "speed"), writes=False)
    with (
        going(trusted.with_name("stop_actuator"), channels) as actuator,
        going(tmp_path / "World" / "stop", channels, *FORGIVING),
    ):
        soon(lambda: speed.read() == LAW)
        monkeypatch.setenv("BREAKS", who)
        with going(trusted, channels) as process:
            soon(lambda: speed.read() in {AC, SC})
            assert process.wait(timeout=processes.TIMEOUT_S) == DEFECT
        soon(lambda: speed.read() == LAW)
        time.sleep(0.5)
        assert speed.read() == LAW, "and it stays"
        assert actuator.poll() is None


# ---------------------------------------------------------------- the actuators themselves

ACTUATE = """\
#include "soter_actuator.h"
#include "soter_channel.h"

#include <stdio.h>
#include <string.h>

/* What was applied, a line each; the first command that is obeyed breaks an invariant. */
void soter_actuate(uint32_t module, const void* command, bool obeys) {
  static FILE* out;
  double speed = 0.0;
  (void)module;
  out = out == NULL ? fopen("applied", "w") : out;
  (void)memcpy(&speed, command, sizeof speed);
  (void)fprintf(out, "%g\\n", speed);
  (void)fflush(out);
  if (obeys) {
    soter_channel_write(NULL, NULL, 0, NULL);
  }
}
"""


def test_actuators_whose_own_check_fails_hold_the_law_until_they_are_ended(
    code: ctypes.CDLL, tmp_path: Path
) -> None:
    out, applied = tmp_path / "out", tmp_path / "applied"
    soter.load(source_in(tmp_path)).build("posix", out, "Vehicle")
    (out / "actuate.c").write_text(ACTUATE)
    assert make(out, "CFLAGS=-O2 -Werror", "stop_actuator").returncode == 0
    table = (out / "soter_actuator_app.c").read_text()
    (name,) = re.findall(r'\.channel = "([^"]+)"', table)
    number = int(
        re.findall(r"\.name = [^}]*?\.hash = UINT64_C\((0x[0-9a-f]+)\),\n *\.size", table)[-1], 16
    )
    (longest,) = re.findall(r"\.longest = INT64_C\((\d+)\)", (out / "stop_lease.c").read_text())
    channel = ctypes.create_string_buffer(64)
    opened = code.soter_outside_open(
        channel,
        str(tmp_path).encode(),
        name.encode(),
        ctypes.c_uint64(number),
        ctypes.c_size_t(32),
        ctypes.c_bool(1),
    )
    assert opened is None

    def told() -> list[float]:
        lines = applied.read_text().split("\n") if applied.is_file() else []
        return [float(line) for line in lines[:-1]]

    def obeys() -> bool:
        now = time.monotonic_ns()
        message = struct.pack("qqqd", now, now + int(longest), -1, AC)
        code.soter_outside_write(channel, ctypes.c_int64(now), message)
        return AC in told()

    words = [str(out / "stop_actuator"), "--channels", str(tmp_path), "--quiet"]
    with processes.started(words, stderr=processes.PIPE, cwd=tmp_path) as process:
        soon(obeys)
        after = len(told()) + 20
        soon(lambda: len(told()) > after)
        obeys()  # nothing is taken any more
        soon(lambda: len(told()) > after + 100)
        assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=processes.TIMEOUT_S)
    found = told()
    assert found.count(AC) == 1
    assert set(found[found.index(AC) + 1 :]) == {LAW}
    assert process.returncode == DEFECT
    assert re.fullmatch(f"soter has a defect: {SAID['posix']}\n", said.decode())


# ---------------------------------------------------------------- on a board

SHUTTLE = EXAMPLES / "wall" / "shuttle_firmware.soter"
ALLOWED = frozenset(("memset", "memcpy", "memmove", "strcmp", "sqrt", "__stack_chk_fail"))
BOARD = """\
#include "Vehicle_firmware.h"
#include "shuttle_firmware_lease.h"

#include <stddef.h>

static Vehicle vehicle;
static volatile double drive = 9.0;

void* memset(void* to, int c, size_t n) {
  for (size_t i = 0; i < n; i++) { ((volatile unsigned char*)to)[i] = (unsigned char)c; }
  return to;
}
void* memcpy(void* to, const void* from, size_t n) {
  const unsigned char* const bytes = from;
  for (size_t i = 0; i < n; i++) { ((volatile unsigned char*)to)[i] = bytes[i]; }
  return to;
}
void* memmove(void* to, const void* from, size_t n) {
  return memcpy(to, from, n); /* nothing here overlaps */
}
int strcmp(const char* a, const char* b) {
  while (*a != 0 && *a == *b) { a++; b++; }
  return *a - *b;
}

double sqrt(double x) {
  __asm__("sqrtsd %0, %0" : "+x"(x));
  return x;
}

static __attribute__((noreturn)) void end(int code) {
  __asm__ volatile("syscall" : : "a"(231), "D"(code) : "rcx", "r11", "memory");
  for (;;) { }
}

void soter_check_failed(const char* file, int line, const char* what) {
  (void)file; (void)line; (void)what;
  drive = ((const shuttle_firmware_Guard_command*)shuttle_firmware_Guard_lease.law)->speed;
  end(drive == 0.0 ? 42 : 43);
}

void board(void);
__attribute__((force_align_arg_pointer)) void board(void) {
  if (Vehicle_start(&vehicle, 1) != NULL) { end(1); }
  for (int64_t now = 1; now < 1000000000; now += 5000000) {
    (void)Vehicle_publish_goal(&vehicle, 12.0, now, now);
    (void)Vehicle_publish_position(&vehicle, 1.0, now, now);
    (void)Vehicle_step(&vehicle, now);
    (void)Vehicle_read_speed(&vehicle, (double*)(uintptr_t)&drive, NULL);
  }
  if (drive == 0.0) { end(2); } /* AC drives */
  (void)Vehicle_step(@LOOP@, 1000000000);
  end(0);
}
__asm__(".globl _start\\n_start: call board\\n");
"""


def objects(folder: Path, *flags: str) -> Path:
    """All of a package but the command, in one object, from a compiler that knows of no library."""
    soter.load(SHUTTLE).build("c", folder)
    kept = [f for f in sorted(folder.glob("*.c")) if f.name not in {"main.c", "soter_app.c"}]
    made = folder / "whole.o"
    words = [
        *find_compiler().command,
        *STRICT,
        *WARNINGS,
        "-O2",
        "-ffreestanding",
        "-nostdlib",
        *flags,
    ]
    done = processes.run([*words, f"-I{folder}", "-r", "-o", made, *kept], capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
    return made


@pytest.mark.parametrize("flags", [(), ("-DSOTER_UNCHECKED",)])
def test_what_ships_needs_no_library_for_its_checks(tmp_path: Path, flags: tuple[str, ...]) -> None:
    needs = undefined_symbols(objects(tmp_path, *flags).read_bytes()) - {"_GLOBAL_OFFSET_TABLE_"}
    assert ("soter_check_failed" in needs) == (flags == ())
    assert needs - {"soter_check_failed"} <= ALLOWED


@pytest.mark.skipif(os.uname().machine != "x86_64", reason="ends by a system call of x86-64")
@pytest.mark.parametrize(("loop", "code"), [("&vehicle", 0), ("NULL", 42)])
def test_a_board_without_any_library_gives_the_law(tmp_path: Path, loop: str, code: int) -> None:
    whole = objects(tmp_path, "-fno-stack-protector", "-fno-pic")
    (tmp_path / "board.c").write_text(BOARD.replace("@LOOP@", loop))
    words = [
        *find_compiler().command,
        "-std=gnu99",
        "-O1",
        "-ffreestanding",
        "-nostdlib",
        "-static",
    ]
    words += ["-fno-stack-protector", "-fno-pic", "-no-pie", f"-I{tmp_path}", "-fno-builtin"]
    linked: list[str | Path] = [tmp_path / "board.c", whole, "-o", tmp_path / "board"]
    done = processes.run([*words, *linked], capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
    assert processes.run([tmp_path / "board"]).returncode == code


RUNTIME = SOTER / "runtime"
PRINTING = frozenset(("stdio.h", "cstdio", "iostream", "ostream", "fstream"))
PRINT = {
    "bridge/soter_simulation_core.hpp",
    "posix/soter_posix.h",
    "ros1/soter_simulation.hpp",
    "ros2/soter_simulation.hpp",
}
"""Headers of programs for an operating system, which no loop of one's own includes."""


def included(path: Path) -> set[str]:
    """The names of all that a file of the run-time includes, also through others of it."""
    ours = list(RUNTIME.rglob("*.h*"))
    found, todo = set[str](), [path]
    while todo:
        text = todo.pop().read_text(encoding="utf-8")
        new = set(re.findall(r'#\s*include\s*["<]([^">]+)[">]', text)) - found
        found |= new
        todo += [p for p in ours if p.name in new]
    return found


def test_no_header_that_ships_draws_in_printf() -> None:
    headers = [p for p in RUNTIME.rglob("*") if p.suffix in {".h", ".hpp"}]
    printing = {str(p.relative_to(RUNTIME)) for p in headers if included(p) & PRINTING}
    assert printing == PRINT
    for_boards = [*RUNTIME.glob("*.c"), *RUNTIME.glob("cortex_m/**/*.c")]
    assert {p.name for p in for_boards if included(p) & PRINTING} == {"soter_main.c"}
