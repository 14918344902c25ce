"""Reads a board: one C file with a memory map and the functions of `cortex_m/soter_board.h`.

Purpose: `read_board` finds the file, reads its numbers, and refuses a memory map that cannot be.
Non-goals: what its functions do; linking (`cortex_m_package.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import SoterError, mistake
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import read_bytes
from soter.native.shared_library import RUNTIME

if TYPE_CHECKING:
    from collections.abc import Iterable


BOARDS = RUNTIME / "cortex_m" / "boards"
"""The boards that ship, all of which QEMU emulates."""
DEFINE = re.compile(
    r"^[ \t]*#[ \t]*define[ \t]+BOARD_(\w+)[ \t]+"
    r'(?:"([^"\n]*)"|(0[xX][0-9a-fA-F]{1,16}|0|[1-9][0-9]{0,18}))(?=\s|/\*|//|$)',
    re.MULTILINE,
)
"""A number has to be the same in C and in Python: not octal, without a suffix."""
MACHINE = re.compile(r"[\w.,=-]*")
"""The form of a QEMU machine's name, which has to be a word of a Makefile."""
FUNCTIONS = ("start", "sense", "actuate", "watchdog", "say", "end")
NUMBERS = ("CLOCK_HZ", "FLASH_AT", "FLASH_BYTES", "RAM_AT", "RAM_BYTES", "STACK_BYTES", "AC_BYTES")
CORES = {
    "cortex-m0": ("-mcpu=cortex-m0", "-mfloat-abi=soft"),
    "cortex-m4": ("-mcpu=cortex-m4", "-mfloat-abi=soft"),
    "cortex-m7": ("-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard"),
}
"""The flags of gcc by core; only the last one has doubles in hardware."""
UNGUARDED = frozenset({"cortex-m0"})
"""Cores on which nothing keeps extern nodes from writing anywhere."""
SOFT = {"cortex-m4": "cortex_m4-vfp4d16sp"}
"""The name in zig of each core for which libgcc rounds doubles wrongly."""
END = 2**32
LEAST_STACK = 1024


@dataclass(frozen=True)
class Board:
    """A board: its memory map in bytes, its SysTick clock in Hz, and its QEMU machine (`qemu`)."""

    name: str
    text: str
    core: str
    clock_hz: int
    flash_at: int
    flash_bytes: int
    ram_at: int
    ram_bytes: int
    stack_bytes: int
    ac_bytes: int
    """Bytes for the part that is not trusted, its variables and its stack: a power of two."""
    qemu: str = ""

    @property
    def flags(self) -> tuple[str, ...]:
        """The flags that tell gcc which core the board has."""
        return CORES[self.core]


def read_board(board: str) -> Board:
    """Reads a board by its name or its file; raises SoterError X017 if it cannot be found."""
    path = BOARDS / f"{board.replace('-', '_')}.c"
    if not path.is_file():
        path = Path(board)
        if path.suffix != ".c":
            known = ", ".join(f"`{name}`" for name in board_names())
            raise _board_error(
                board,
                "there is none of that name, and no such file",
                f"there are {known}, or a file: --board my_board.c",
            )
    try:
        text = read_bytes(path).decode("utf-8")
    except OSError as error:
        raise _board_error(board, reason(error)) from error
    except UnicodeDecodeError as error:
        raise _board_error(board, "it is no text") from error
    return parsed_board(path.stem, text)


def board_names() -> list[str]:
    """The names of the boards that Soter ships."""
    return sorted(p.stem.replace("_", "-") for p in BOARDS.glob("*.c"))


def parsed_board(name: str, text: str) -> Board:
    """Parses the text of a board file; raises SoterError X017 if it is wrong."""
    defined = DEFINE.findall(text)
    words = {key: word for key, word, number in defined if not number}
    numbers = {key: int(number, 0) for key, _, number in defined if number}
    keys = [key for key, _, _ in defined]
    twice = [f"`BOARD_{n}` is defined twice" for n in dict.fromkeys(keys) if keys.count(n) > 1]
    problems = [*_number_problems(numbers), *twice, *_word_problems(words, text)]
    if problems:
        raise _board_error(name, problems[0], notes=problems[1:])
    board = Board(
        name=name,
        text=text,
        core=words["CORE"],
        clock_hz=numbers["CLOCK_HZ"],
        flash_at=numbers["FLASH_AT"],
        flash_bytes=numbers["FLASH_BYTES"],
        ram_at=numbers["RAM_AT"],
        ram_bytes=numbers["RAM_BYTES"],
        stack_bytes=numbers["STACK_BYTES"],
        ac_bytes=numbers["AC_BYTES"],
        qemu=words.get("QEMU", ""),
    )
    problems = list(_memory_map_problems(board))
    if problems:
        raise _board_error(name, problems[0], notes=problems[1:])
    return board


def _number_problems(numbers: dict[str, int]) -> Iterable[str]:
    for n in NUMBERS:
        if n not in numbers:
            yield f"`#define BOARD_{n} ...` is not there, or no number such as 131072 or 0x20000"
    for n in NUMBERS:
        if numbers.get(n, 0) >= END:
            yield f"`BOARD_{n}` is {numbers[n]:,}: no word of 32 bits"


def _word_problems(words: dict[str, str], text: str) -> Iterable[str]:
    """Yields a problem for each mistake in a board's core, QEMU machine, or functions."""
    if words.get("CORE") not in CORES:
        yield "`BOARD_CORE` has to be one of " + ", ".join(f'"{core}"' for core in CORES)
    if "QEMU" not in words and re.search(r"define[ \t]+BOARD_QEMU\b", text):
        yield "`BOARD_QEMU` is no word in quotes"
    if MACHINE.fullmatch(words.get("QEMU", "")) is None:
        yield "`BOARD_QEMU` is no name of a machine of QEMU"
    for f in FUNCTIONS:
        if re.search(rf"\bsoter_board_{f}\([^;{{]*\)\s*\{{", text) is None:
            yield f"`soter_board_{f}` is not defined"


def _memory_map_problems(board: Board) -> Iterable[str]:
    regions = (("flash", board.flash_at, board.flash_bytes), ("RAM", board.ram_at, board.ram_bytes))
    for region, at, size in regions:
        if size == 0 or at + size > END:
            yield f"{region} of {size:,} bytes at {at:#x} is empty, or goes beyond 4 GiB"
        if at % 8 != 0 or size % 8 != 0:
            yield f"{region} does not begin or end at a multiple of 8 bytes"
    (_, one, first), (_, other, second) = regions
    common = min(one + first, other + second) - max(one, other)
    if common > 0:
        yield f"flash and RAM overlap: {common:,} bytes from {max(one, other):#x} on"
    if board.clock_hz == 0:
        yield "`BOARD_CLOCK_HZ` is 0"
    if board.ac_bytes < 2 * LEAST_STACK or board.ac_bytes & (board.ac_bytes - 1) != 0:
        yield f"`BOARD_AC_BYTES` is {board.ac_bytes:,}: a power of two, {2 * LEAST_STACK} at least"
    if board.ac_bytes > board.ram_bytes:
        yield f"`BOARD_AC_BYTES` is {board.ac_bytes:,}: more than RAM"
    flash = max(board.flash_bytes, 1)
    if flash & (flash - 1) != 0 or board.flash_at % flash != 0:
        yield "flash is no power of two, or begins at no multiple of it: no region of an MPU"
    if not LEAST_STACK <= board.stack_bytes <= board.ram_bytes or board.stack_bytes % 8 != 0:
        yield (
            f"a stack of {board.stack_bytes:,} bytes: it has to be a multiple of 8, "
            f"{LEAST_STACK} at least, and to fit into RAM"
        )


def _board_error(name: str, why: str, *helps: str, notes: Iterable[str] = ()) -> SoterError:
    message = f"the board `{name}` cannot be used: {why}"
    return mistake("X017", message, *helps, notes=tuple(notes))


@dataclass(frozen=True)
class Replay:
    """A run that an image repeats: its end in ns, its seed, its trace's hash on this machine."""

    until_ns: int
    seed: int
    sha256: str = ""
    recording: str = ""
    """Values of topics from outside, as text (`recording_text`); "" where there are none."""
