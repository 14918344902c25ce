"""Makes the image of a package for a board, with the figures of its run.

Purpose: `build_image` makes an image by the package's Makefile, with arm-none-eabi-gcc, runs it
where QEMU emulates the board, and measures it (flash, RAM, stack, instructions), or says why there
is none. `cross_compiler` is the compiler for it, by which its stack is bounded.
Non-goals: what the package holds (`cortex_m_package.py`); execution times, which counts of
instructions are not.
"""

from __future__ import annotations

import re
import shlex
import shutil
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import SoterError, mistake
from soter.native.compiler import Compiler, CompilerOutput, module_command, run_compiler
from soter.report.wording import visible
from soter.targets.cortex_m_board import SOFT, Board
from soter.targets.cortex_m_package import LIMIT_S
from soter.version import pip_command

if TYPE_CHECKING:
    from soter.native.stack_bound import StackBound
    from soter.targets.package import Package

CC = "arm-none-eabi-gcc"
QEMU = "qemu-system-arm"
OLDEST = 10
"""The first version of gcc whose `-fcallgraph-info` and linker are those of the Makefile."""
TIMEOUT_S = 300
RUN_S = LIMIT_S + 20
LARGEST = 5
OVERFLOW = re.compile(r"region `(FLASH|RAM)' overflowed by (\d+) bytes")
SYMBOL = re.compile(r"^\S+ (\d+) (\w) (\S+)$", re.MULTILINE)
COUNTS = re.compile(
    r"^instructions of (?:an instant|a step of (\S+)) (\d+) at most, (\d+) on average, "
    r"(\d+) times$",
    re.MULTILINE,
)
SELF_TEST = re.compile(r"^instructions of the self-test (\d+)$", re.MULTILINE)
ERROR_LINE = re.compile(r"error|undefined|BOARD_AC_BYTES|multiple definition")
"""Finds the lines of a compiler or linker that say what is wrong."""
STACK = re.compile(r"^stack (\d+) bytes used$", re.MULTILINE)
TRACE = re.compile(r"^trace_sha256 (\w{64})$", re.MULTILINE)


@dataclass(frozen=True)
class StepCount:
    """How many instructions `number` steps of a component (or an extern node's gate) take."""

    name: str
    most: int
    mean: int
    number: int


@dataclass(frozen=True)
class Image:
    """The bytes and instructions of an image; None if not made or run, `why` says the reason."""

    flash: int | None = None
    ram: int | None = None
    stack_used: int | None = None
    instant_most: int | None = None
    instant_mean: int | None = None
    self_test: int | None = None
    steps: tuple[StepCount, ...] = ()
    trace_sha256: str = ""
    same_as_host: bool | None = None
    compiler: str = ""
    why: str = ""

    def text_lines(self) -> list[str]:
        """The image's memory and instructions in lines for people, or why the image is missing."""
        if self.flash is None:
            return [f"none: {self.why}"]
        lines = [
            f"{self.flash:,} bytes of flash, {self.ram:,} of RAM beside the stack ({self.compiler})"
        ]
        if self.instant_most is None:
            return [*lines, self.why]
        same = ", the host's trace" if self.same_as_host else ""
        most, mean = self.instant_most, self.instant_mean
        return [
            *lines,
            f"{self.stack_used:,} bytes of stack used{same}",
            f"{most:,} instructions an instant at most, {mean:,} on average",
            *(f"{s.most:,} instructions a step of {s.name} at most" for s in self.steps),
            f"{self.self_test:,} instructions the test of the arithmetic, once at the start",
        ]


def missing_tool(board: Board) -> str:
    """Describes a tool for the image that is missing or too old; "" if all tools are present."""
    if shutil.which("make") is None:
        return "there is no `make`"
    if shutil.which(CC) is None:
        return f"there is no `{CC}` (Debian: gcc-arm-none-eabi, libnewlib-arm-none-eabi)"
    version = compiler_version()
    number = re.search(r"\) (\d+)\.", version)
    if number is None or int(number[1]) < OLDEST:
        return f"`{CC}` is too old: {version}; version {OLDEST} at least"
    if board.core in SOFT and find_spec("ziglang") is None:
        return (
            f"{board.core} computes doubles without hardware, and those of gcc's library are not "
            f"rounded right: {pip_command('compiler')} brings others"
        )
    return ""


def compiler_version() -> str:
    """The first line of the compiler's version text."""
    output = run_compiler([CC, "--version"], Path.cwd(), TIMEOUT_S)
    return visible((output.text.splitlines() or [""])[0])


def cross_compiler(board: Board) -> Compiler | None:
    """The compiler of a board, with the flags of the Makefile; None if a tool is missing."""
    path = shutil.which(CC)
    if path is None or missing_tool(board):
        return None
    return Compiler((path,), compiler_version(), ("-Os", "-mthumb", *board.flags))


def require_enough_stack(bound: StackBound, board: Board) -> None:
    """Raises SoterError X015 if the trusted part needs more stack than the board has."""
    if bound.bytes is None or bound.bytes <= board.stack_bytes:
        return
    over = bound.bytes - board.stack_bytes
    message = f"the program does not fit onto `{board.name}`: {over:,} bytes too many for its stack"
    raise mistake("X015", message, notes=(f"{bound.bytes:,} bytes: {' > '.join(bound.way)}",))


def build_image(package: Package, board: Board) -> Image:
    """Builds the image of a written package and runs it; raises SoterError X015, X016, X004."""
    if why := missing_tool(board):
        return Image(why=why)
    done = _run_make(package, package.image)
    if done.code != 0:
        raise _link_error(package, board, done.text)
    flash, ram = _flash_and_ram_bytes(package.folder / package.image, board)
    sized = {"flash": flash, "ram": ram, "compiler": compiler_version()}
    if not board.qemu or shutil.which(QEMU) is None:
        absent = "QEMU does not emulate this board" if not board.qemu else f"there is no `{QEMU}`"
        return Image(**sized, why=f"it was not run: {absent}")  # type: ignore[arg-type]
    ran, log = _run_in_qemu(package)
    stack, trace, test = (x.search(log) for x in (STACK, TRACE, SELF_TEST))
    counts = [StepCount(name, *(int(x) for x in numbers)) for name, *numbers in COUNTS.findall(log)]
    if not counts or trace is None or test is None:
        raise _run_error(f"the image does not run in QEMU: {visible((log or ran).strip()[-300:])}")
    instant, *steps = counts
    return Image(
        **sized,  # type: ignore[arg-type]
        stack_used=None if stack is None else int(stack[1]),
        instant_most=instant.most,
        instant_mean=instant.mean,
        self_test=int(test[1]),
        steps=tuple(steps),
        trace_sha256=trace[1],
        same_as_host=True if "the same trace as on the host" in ran else None,
    )


def _run_in_qemu(package: Package) -> tuple[str, str]:
    """The output of `make run`, and of the image itself; SoterError X016 if it does not run."""
    ran = run_compiler(["make", "-s", "run"], package.folder, RUN_S)
    if ran.code is None or "it has not ended within" in ran.text:
        raise _run_error(f"the run in QEMU does not end within {LIMIT_S} s")
    output = (package.folder / "run.txt").read_text(encoding="utf-8", errors="replace")
    if (refused := re.search(r"^not run: (.*)$", output, re.MULTILINE)) is not None:
        raise _run_error(f"the image refuses to run: {visible(refused[1])}")
    if re.search("another trace than on the host", ran.text):
        raise _run_error("the image computes another trace than this machine")
    return ran.text, output


def _flash_and_ram_bytes(image: Path, board: Board) -> tuple[int, int]:
    """The bytes of flash that an image needs, and its bytes of RAM without the stack."""
    output = run_compiler(["arm-none-eabi-size", image.name], image.parent, TIMEOUT_S).text
    text, data, bss = (int(x) for x in output.splitlines()[1].split()[:3])
    return text + data, data + bss - board.stack_bytes


def _link_error(package: Package, board: Board, text: str) -> SoterError:
    over = dict(OVERFLOW.findall(text))
    if not over:
        lines = [visible(x[:300]) for x in text.splitlines() if ERROR_LINE.search(x)]
        message = f"`{CC}` does not make an image of the package `{package.folder}`"
        return mistake("X004", message, notes=tuple(lines[:8]))
    sizes = {"FLASH": ("flash", board.flash_bytes), "RAM": ("RAM", board.ram_bytes)}
    parts = [
        f"{int(by):,} bytes too many for {sizes[region][0]} of {sizes[region][1]:,}"
        for region, by in over.items()
    ]
    message = f"the program does not fit onto `{board.name}`: {', '.join(parts)}"
    largest = _largest_symbols(package, "trdw" if "FLASH" in over else "bd")
    return mistake("X015", message, notes=(f"largest: {', '.join(largest)}",))


def _largest_symbols(package: Package, kinds: str) -> list[str]:
    """The largest symbols of an image that is too large; `kinds` are symbol types of `nm`."""
    _run_make(package, package.image, "CFLAGS=-Os -Wl,--noinhibit-exec")
    words = ["arm-none-eabi-nm", "--print-size", "--radix=d", package.image]
    output = run_compiler(words, package.folder, TIMEOUT_S).text
    (package.folder / package.image).unlink(missing_ok=True)
    found = [
        (int(size), name) for size, kind, name in SYMBOL.findall(output) if kind.lower() in kinds
    ]
    return [f"`{name}` {size:,} bytes" for size, name in sorted(found, reverse=True)[:LARGEST]]


def _run_make(package: Package, *words: str) -> CompilerOutput:
    zig = f"ZIG={shlex.join(module_command('ziglang'))}"
    return run_compiler(["make", *words, zig], package.folder, TIMEOUT_S)


def _run_error(message: str) -> SoterError:
    return mistake("X016", message, 'docs/bare-metal.md, "When the image refuses to run"')
