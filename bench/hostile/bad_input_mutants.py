"""Files made wrong: bytes, numbers, JSON of other types, and what is no file at all.

Purpose: `placed` puts one wrong file into a folder and says what is wrong with it. One in six is no
ordinary file (a folder, a pipe that nobody writes, /dev/zero, links in a circle, 20 GB of holes);
the others are the sample, changed: bytes, tokens, values and types where it is JSON.
Non-goals: which files there are (`bad_input_samples.py`).
"""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
from contextlib import suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from random import Random

    from bench.hostile.bad_input_samples import Format

HUGE = 20 * 2**30
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
NUMBERS = (
    b"1e999",
    b"-1",
    b"0",
    b"99999999999999999999999",
    b"1e-320",
    b"NaN",
    b"-Infinity",
    b"1e308",
    b"4294967296",
    b"9223372036854775808",
    b"-0.0",
    b"0x10",
    b"1_0",
    b"\xd9\xa3",
    b"",
    b"1" * 5000,
)
PIECES = (
    b"\x00",
    b"\xff\xfe",
    b"\xc3\x28",
    b"\xef\xbb\xbf",
    b"\xed\xa0\x80",
    b"\x1b[2J",
    b"\r",
    b"\n\n",
    b'"',
    b"\\",
    b"{",
    b"]",
    b",",
    b"'",
    b"\xe2\x80\xae",
    b"/*",
    b"#",
    b"\x89MCAP0\r\n",
)
ELSE: tuple[Any, ...] = (
    None,
    True,
    0,
    -1,
    1.5,
    10**30,
    1e308,
    float("nan"),
    "",
    "x",
    "\ud800",
    "\x1b[2J",
    "../../x",
    "/dev/zero",
    [],
    {},
    [[]],
    {"": {}},
    "a" * 70_000,
)
BOMB_DEPTH = 100_000


def placed(one: Format, k: int, chance: Random, folder: Path) -> str:
    """Put mutant `k` of a format in place of its file in the folder; what was done, in words."""
    path = folder / chance.choice(one.files)
    if k % 6 == 5:
        names = [n for n in SPECIAL if one.stdin == "" or n not in NO_STREAM]
        name = chance.choice(names)
        with suppress(OSError):
            path.unlink()
        SPECIAL[name](path)
        how = f"{path.name} is {name}"
    else:
        raw = path.read_bytes()
        is_json = one.json or path.suffix == ".json"
        change = chance.choice((*((other_json,) * 4 if is_json else ()), *BYTES))
        for _ in range(chance.choice((1, 1, 1, 2, 5))):
            raw = change(raw, chance)
        path.write_bytes(raw)
        how = f"{path.name}: {change.__name__}"
    if one.sealed is not None and chance.random() < 0.7:
        with suppress(OSError, ValueError, TypeError, KeyError, AttributeError):
            one.sealed(folder)
            how += ", sealed again"
    return how


# ---------------------------------------------------------------- bytes


def flipped(raw: bytes, chance: Random) -> bytes:
    """One to eight bits are others."""
    made = bytearray(raw)
    for _ in range(chance.choice((1, 1, 2, 8)) if made else 0):
        made[chance.randrange(len(made))] ^= 1 << chance.randrange(8)
    return bytes(made)


def cut(raw: bytes, chance: Random) -> bytes:
    """Its end is missing."""
    return raw[: chance.randrange(len(raw) + 1)]


def without(raw: bytes, chance: Random) -> bytes:
    """A piece is missing."""
    at = chance.randrange(len(raw) + 1)
    return raw[:at] + raw[at + chance.choice((1, 4, 40, 400)) :]


def twice(raw: bytes, chance: Random) -> bytes:
    """A piece stands there twice."""
    at, to = sorted((chance.randrange(len(raw) + 1), chance.randrange(len(raw) + 1)))
    return raw[:to] + raw[at:to] + raw[to:]


def put_in(raw: bytes, chance: Random) -> bytes:
    """Bytes that mean something to somebody, somewhere."""
    at = chance.randrange(len(raw) + 1)
    return raw[:at] + chance.choice(PIECES) + raw[at:]


def noise(raw: bytes, chance: Random) -> bytes:
    """A piece is random bytes."""
    at, n = chance.randrange(len(raw) + 1), chance.choice((1, 8, 100))
    return raw[:at] + chance.randbytes(n) + raw[at + n :]


def other_number(raw: bytes, chance: Random) -> bytes:
    """A number is another one, perhaps none that fits anywhere."""
    spans = [m.span() for m in NUMBER.finditer(raw[:200_000])]
    if not spans:
        return put_in(raw, chance)
    at, to = chance.choice(spans)
    return raw[:at] + chance.choice(NUMBERS) + raw[to:]


def other_line(raw: bytes, chance: Random) -> bytes:
    """Two lines, or two words, have changed places."""
    by = chance.choice((b"\n", b" ", b",", b"="))
    parts = raw.split(by)
    i, j = chance.randrange(len(parts)), chance.randrange(len(parts))
    parts[i], parts[j] = parts[j], parts[i]
    return by.join(parts)


def other_word(raw: bytes, chance: Random) -> bytes:
    """A word stands where another was."""
    spans = [m.span() for m in re.finditer(rb"\w+", raw[:200_000])]
    if len(spans) < 2:
        return flipped(raw, chance)
    (at, to), (a, b) = chance.choice(spans), chance.choice(spans)
    return raw[:at] + raw[a:b] + raw[to:]


BYTES: tuple[Callable[[bytes, Random], bytes], ...] = (
    flipped,
    cut,
    without,
    twice,
    put_in,
    noise,
    other_number,
    other_number,
    other_line,
    other_word,
)


# ---------------------------------------------------------------- JSON


def other_json(raw: bytes, chance: Random) -> bytes:
    """A value of a document is of another type, missing, or nested out of all measure."""
    try:
        document = json.loads(raw)
    except (ValueError, RecursionError):
        return flipped(raw, chance)
    if chance.random() < 0.02:
        return b"[" * BOMB_DEPTH
    places: list[tuple[Any, Any]] = [(None, None)]
    _places(document, places)
    inside, key = chance.choice(places)
    value = chance.choice(ELSE)
    if inside is None:
        document = value if chance.random() < 0.2 else document
    elif isinstance(inside, dict) and chance.random() < 0.3:
        del inside[key]
    else:
        inside[key] = value
    return json.dumps(document).encode()


def _places(value: Any, places: list[tuple[Any, Any]]) -> None:  # noqa: ANN401 - JSON
    keys = (
        list(value)
        if isinstance(value, dict)
        else range(len(value))
        if isinstance(value, list)
        else ()
    )
    for key in keys:
        places.append((value, key))
        _places(value[key], places)


# ---------------------------------------------------------------- no files


def _sparse(path: Path) -> None:
    with path.open("wb") as stream:
        stream.truncate(HUGE)


def _in_a_circle(path: Path) -> None:
    beside = path.with_name(path.name + ".circle")
    beside.symlink_to(path)
    path.symlink_to(beside)


def _socket(path: Path) -> None:
    here = os.getcwd()  # noqa: PTH109 - names of sockets are short
    try:
        os.chdir(path.parent)
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(path.name)
    finally:
        os.chdir(here)


def _full_folder(path: Path) -> None:
    path.mkdir()
    shutil.copy(__file__, path / path.name)


SPECIAL: dict[str, Callable[[Path], object]] = {
    "missing": lambda _: None,
    "empty": lambda path: path.write_bytes(b""),
    "a folder": lambda path: path.mkdir(),
    "a folder that is not empty": _full_folder,
    "a pipe that nobody writes": os.mkfifo,
    "/dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "/dev/null": lambda path: path.symlink_to("/dev/null"),
    "a link in a circle": _in_a_circle,
    "a link to nothing": lambda path: path.symlink_to("nowhere"),
    "20 GB of holes": _sparse,
    "a socket": _socket,
    "/proc/self/mem": lambda path: path.symlink_to("/proc/self/mem"),
    "a megabyte of noise": lambda path: path.write_bytes(os.urandom(2**20)),
    "one byte": lambda path: path.write_bytes(b"\x80"),
}
NO_STREAM = frozenset(
    {
        "a folder",
        "a folder that is not empty",
        "a pipe that nobody writes",
        "a socket",
        "missing",
        "a link in a circle",
        "a link to nothing",
        "/dev/zero",
        "/proc/self/mem",
        "20 GB of holes",
    }
)
"""What standard input cannot be, or whose end nobody waits for."""
