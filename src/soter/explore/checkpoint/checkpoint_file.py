"""The file of a checkpoint: what it is of, and that it is whole.

Purpose: a head of fixed size, which says of which search it is and seals the rest, and behind it
what the explorer wrote (`soter_explore_checkpoint.c`). The head is written last, then the file
takes its place at once: it is there whole or not at all. A file is read only if every byte of it is
as it was written; what differs from the search that is to go on is said in words.
Non-goals: what the explorer wrote; when it is written (`saver.py`). Whoever makes such a file by
hand, seals included, is believed.
"""

from __future__ import annotations

import hashlib
import json
import mmap
import os
import re
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.os_error_text import reason
from soter.language.model.durations import show_ns
from soter.native.package_sources import soter_sha256
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

ENDING = ".checkpoint"
MAGIC = b"soter checkpoint\n"
SCHEMA = 1
HEAD = 2**16
"""Bytes of the head: MAGIC, the SHA-256 of what follows in it (hex, a line), JSON and spaces."""
_SEAL = len(MAGIC) + 64 + 1
_PIECE = 2**22
ABOUT = {
    "program_sha256": "the program",
    "system": "the system",
    "test": "the test",
    "params": "parameters",
    "skew_ns": "the skew",
    "horizon_ns": "the horizon",
    "strategy": "the strategy",
    "storage": "the storage",
    "reduction": "the reduction",
    "seed": "the seed",
    "machine": "the machine",
}
"""What has to be the same for a search to go on, in the order of its telling."""


class DamagedCheckpointError(Exception):
    """What is in a file is no checkpoint; the message says why."""


@dataclass(frozen=True)
class SavedCheckpoint:
    """A checkpoint that was read and is whole: its head, and what the explorer wrote."""

    path: Path
    head: Mapping[str, Any]
    payload: memoryview


def machine() -> str:
    """What numbers of the explorer look like here."""
    return f"{sys.byteorder} endian, {sys.maxsize.bit_length() + 1} bits"


def path_of(folder: Path, test: str) -> Path:
    """Where the checkpoint of a test lies."""
    return folder / (re.sub(r"[^A-Za-z0-9_.=+-]", "_", test) + ENDING)


# ---------------------------------------------------------------- writing


def seal(file: int, head: Mapping[str, object]) -> None:
    """Write the head of a file whose payload is there, and let all of it reach the disk.

    OSError where that cannot be.
    """
    told = hashlib.sha256()
    size = os.fstat(file).st_size - HEAD
    at = 0
    while at < size:
        piece = os.pread(file, min(_PIECE, size - at), HEAD + at)
        if not piece:
            raise OSError("it became shorter")
        told.update(piece)
        at += len(piece)
    payload = {"bytes": size, "sha256": told.hexdigest()}
    document = {
        "schema": SCHEMA,
        "soter": VERSION,
        "code": soter_sha256(),
        **head,
        "payload": payload,
    }
    text = json.dumps(document, allow_nan=False).encode()
    rest = text.ljust(HEAD - _SEAL)
    assert len(rest) == HEAD - _SEAL, len(text)
    os.pwrite(file, MAGIC + hashlib.sha256(rest).hexdigest().encode() + b"\n" + rest, 0)
    os.fsync(file)


def take_place(made: Path, path: Path) -> None:
    """Let a sealed file take the place of the last one; OSError."""
    made.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


# ---------------------------------------------------------------- reading


def read(path: Path) -> SavedCheckpoint:
    """A checkpoint; `SoterError` D012 where a file is none, or is not as it was written."""
    try:
        return _read(path)
    except OSError as error:
        raise no_checkpoint(path, reason(error)) from error
    except DamagedCheckpointError as error:
        raise no_checkpoint(path, str(error)) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise no_checkpoint(path, "its head says something else") from error


def _read(path: Path) -> SavedCheckpoint:
    if path.exists() and not path.is_file():  # a pipe would be waited for, for ever
        raise DamagedCheckpointError("it is no regular file")
    with path.open("rb") as stream:
        block = stream.read(HEAD)
        if not block.startswith(MAGIC):
            raise DamagedCheckpointError("it does not begin as one")
        if len(block) < HEAD:
            raise DamagedCheckpointError("its end is missing")
        seal_, rest = block[len(MAGIC) : _SEAL], block[_SEAL:]
        if seal_ != hashlib.sha256(rest).hexdigest().encode() + b"\n":
            raise DamagedCheckpointError("its head is not as it was written")
        head = json.loads(rest)
        if (head.get("schema"), head.get("soter"), head.get("code")) != (
            SCHEMA,
            VERSION,
            soter_sha256(),
        ):
            whose = "this number, other code" if head.get("soter") == VERSION else head.get("soter")
            raise DamagedCheckpointError(f"another version of soter wrote it: {whose}")
        size = os.fstat(stream.fileno()).st_size - HEAD
        if size != head["payload"]["bytes"]:
            less = size < head["payload"]["bytes"]
            raise DamagedCheckpointError(
                "its end is missing" if less else "something stands behind its end"
            )
        mapped = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    payload = memoryview(mapped)[HEAD:]
    if hashlib.sha256(payload).hexdigest() != head["payload"]["sha256"]:
        raise DamagedCheckpointError("it is not as it was written")
    return SavedCheckpoint(path, head, payload)


def require_same(saved: SavedCheckpoint, about: Mapping[str, object]) -> None:
    """`SoterError` D013 where it is of another search than `about` (keys of ABOUT)."""
    then = saved.head["about"]
    wanted = json.loads(json.dumps(dict(about)))
    notes = [
        f"{what}: {_shown(name, then.get(name))} then, {_shown(name, wanted.get(name))} now"
        for name, what in ABOUT.items()
        if then.get(name) != wanted.get(name)
    ]
    if notes:
        problem = Diagnostic(
            "D013",
            f"`{saved.path}` is of another search",
            notes=tuple(notes),
            helps=("go on as it began, or begin anew in another folder: --checkpoint",),
        )
        raise SoterError((problem,))


def _shown(name: str, value: object) -> str:
    if name.endswith("_ns") and isinstance(value, int):
        return show_ns(value)
    if name == "program_sha256":
        return str(value)[:12]
    if isinstance(value, dict):
        return ", ".join(f"{k} = {v}" for k, v in value.items()) or "none"
    return str(value)


def no_checkpoint(path: Path, reason: str) -> SoterError:
    """D012: there is nothing to go on from."""
    hint = "`soter test FILE --checkpoint DIR` writes one for every test, and begins anew"
    problem = Diagnostic("D012", f"`{path}` is no checkpoint: {reason}", helps=(hint,))
    return SoterError((problem,))
