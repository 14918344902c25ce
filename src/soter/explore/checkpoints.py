"""Checkpoints: the file in which a search is written down, and who writes it while it goes on.

Purpose: a head of fixed size says of which search the file is and seals the rest, which the
explorer wrote (`soter_explore_checkpoint.c`). The head is written last, then the file takes its
place at once: it is there whole or not at all. A file is read only if every byte is as it was
written; what differs from the search that is to go on is said in words. `Checkpoint` belongs to one
test; `Saver` asks the explorer for it again and again while one part of the system is searched.
Non-goals: what the explorer wrote; options (`checked_options.py`). Whoever makes such a file by
hand, seals included, is believed.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import mmap
import os
import re
import sys
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from soter.diagnostics.diagnostic import Diagnostic, SoterError, reason
from soter.explore.search_options import STATUSES
from soter.language.model.types import show_ns
from soter.native.cache import soter_sha256
from soter.version import VERSION

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
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


COUNTS = (
    "states",
    "transitions",
    "table_bytes",
    "frontier_bytes",
    "depth",
    "total_bytes",
    "threads",
    "covered_ns",
    "closed_ns",
    "closable",
)
"""What is kept of the search of a part that came to its end, besides its seconds."""
NOTHING_TO_WRITE = {STATUSES.index(s) for s in ("exhausted", "violated", "damaged")}
UNWRITTEN = "the last one could not be written"


class EndedPart(Protocol):
    """What the search of a part found (`SearchResult`): COUNTS and these."""

    @property
    def states(self) -> int:
        """Configurations."""

    @property
    def seconds(self) -> float:
        """Of the search."""


@dataclass
class Checkpoint:
    """Of one test: where it lies, of what it is, what it goes on from.

    `states`: configurations of the last one written, of all parts; `problem`: why a later one could
    not be.
    """

    path: Path
    every_s: float
    about: Mapping[str, object]
    saved: SavedCheckpoint | None = None
    states: int = 0
    problem: str = ""
    resumed: int = field(init=False, default=0)
    """Configurations that were there when it went on."""

    def __post_init__(self) -> None:
        if self.saved is not None:
            self.states = self.resumed = int(self.saved.head["states"])

    @property
    def part(self) -> int:
        """The part of the system that was searched."""
        return 0 if self.saved is None else int(self.saved.head["part"])

    @property
    def parts(self) -> int | None:
        """How many parts were explored apart; None: it begins."""
        return None if self.saved is None else int(self.saved.head["parts"])

    @property
    def seconds(self) -> float:
        """That the part had been searched for, s."""
        return 0.0 if self.saved is None else float(self.saved.head["seconds"])

    @property
    def ended(self) -> tuple[Mapping[str, Any], ...]:
        """The parts before it, as `counts_of` told them."""
        return () if self.saved is None else tuple(self.saved.head["ended"])

    def try_out(self) -> None:
        """Whether it could be written, now; `SoterError` D006, D014."""
        os.close(self.open(".ending"))
        beside(self.path, ".ending").unlink()

    def saver(self, part: int, parts: int, ended: Sequence[EndedPart]) -> Saver:
        """For the search of one part of so many; `ended` are those before it."""
        resumes = self.saved is not None and part == self.part
        return Saver(self, part, parts, ended, self.saved if resumes else None)

    def open(self, ending: str) -> int:
        """A new file beside it, behind the room for its head; `SoterError` D006, D014."""
        path = beside(self.path, ending)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
            file = os.open(path, flags, 0o666)
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(file)
                message = f"another search writes to `{self.path}`"
                raise SoterError((Diagnostic("D014", message),)) from None
            os.ftruncate(file, 0)
            os.lseek(file, HEAD, os.SEEK_SET)
        except OSError as error:
            message = f"cannot write `{path}`: {reason(error)}"
            raise SoterError((Diagnostic("D006", message),)) from error
        return file


def beside(path: Path, ending: str) -> Path:
    """A file that becomes the checkpoint when it is whole."""
    return path.with_name(path.name + ending)


def counts_of(search_result: EndedPart) -> dict[str, float]:
    """What a head keeps of the search of a part."""
    return {
        "seconds": search_result.seconds,
        **{name: getattr(search_result, name) for name in COUNTS},
    }


class Saver:
    """Asks the explorer for a checkpoint, again and again, and at the end of its search."""

    def __init__(
        self,
        to: Checkpoint,
        part: int,
        parts: int,
        ended: Sequence[EndedPart],
        saved: SavedCheckpoint | None,
    ) -> None:
        self._to = to
        self._head = {
            "about": dict(to.about),
            "part": part,
            "parts": parts,
            "ended": [counts_of(f) for f in ended],
        }
        self._before = sum(f.states for f in ended)
        self._saved = saved
        self._began_s = self._last_s = time.perf_counter()
        self._end = -1
        self._asked = -1
        """The file that the explorer writes to, or was asked to; -1: none."""
        self._written = 0
        self._payload: Any = None

    @property
    def seconds(self) -> float:
        """That this part was searched for before, s."""
        return self._to.seconds if self._saved is not None else 0.0

    @property
    def states(self) -> int:
        """Of the last checkpoint that was written; 0: there is none."""
        return self._to.states

    def begin(self, ffi: Any, options: Any) -> None:  # noqa: ANN401 - cffi has no types
        """Say in `soter_explore_options` where to write, and what to go on from."""
        self._end = self._to.open(".ending")
        options.save_to = self._end + 1
        if self._saved is not None:
            self._payload = ffi.from_buffer("uint8_t[]", self._saved.payload)
            options.resume = self._payload
            options.resume_bytes = len(self._saved.payload)

    def look(self, progress: Any) -> None:  # noqa: ANN401 - cdata
        """Ask for one where it is time, take what was written (`soter_explore_progress`)."""
        if self._asked >= 0:
            if progress.save_to == 0:
                self._take(progress)
        elif time.perf_counter() - self._last_s >= self._to.every_s and not progress.stop:
            try:
                self._asked = self._to.open(".writing")
            except SoterError as error:
                self._to.problem = error.diagnostics[0].message
                self._last_s = time.perf_counter()
            else:
                progress.save_to = self._asked + 1

    def end(self, progress: Any, result: Any) -> None:  # noqa: ANN401 - cdata
        """Take the last one; nothing is left beside it."""
        if self._asked >= 0 and progress.save_to == 0:
            self._take(progress)
        if result.saved:
            self._seal(self._end, ".ending", int(result.states))
        elif int(result.status) not in NOTHING_TO_WRITE:
            self._to.problem = UNWRITTEN
        self.close()

    def close(self) -> None:
        """Give back what is open; files beside it go away."""
        for file, ending in ((self._end, ".ending"), (self._asked, ".writing")):
            if file >= 0:
                os.close(file)
                with contextlib.suppress(OSError):
                    beside(self._to.path, ending).unlink()
        self._end = self._asked = -1
        self._payload = None

    def _take(self, progress: Any) -> None:  # noqa: ANN401 - cdata
        if progress.saved > self._written:
            self._seal(self._asked, ".writing", int(progress.saved_states))
        else:
            self._to.problem = UNWRITTEN
        self._written = int(progress.saved)
        os.close(self._asked)
        with contextlib.suppress(OSError):
            beside(self._to.path, ".writing").unlink()
        self._asked = -1
        self._last_s = time.perf_counter()

    def _seal(self, file: int, ending: str, states: int) -> None:
        """Seal what was written and put it in its place; `problem` says why not."""
        head = {
            **self._head,
            "states": self._before + states,
            "seconds": self.seconds + time.perf_counter() - self._began_s,
        }
        try:
            seal(file, head)
            take_place(beside(self._to.path, ending), self._to.path)
        except OSError as error:
            self._to.problem = reason(error)
        else:
            self._to.states, self._to.problem = self._before + states, ""
