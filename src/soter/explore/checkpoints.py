"""Checkpoints: the file in which a search is stored, and its writing while the search goes on.

Purpose: a head of fixed size names the search and seals the rest, which the explorer writes
(`soter_explore_checkpoint.c`). The head is written last, then the file is moved into its place: it
is there whole or not at all. A file is read only if every byte is as it was written; if it belongs
to another search, the difference is told in words. A `Checkpoint` belongs to one test; its `Saver`
asks the explorer for it again and again while one part of the system is searched.
Non-goals: what the explorer wrote; options (`api/exploring.py`). Whoever makes such a file by
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
_SEAL_BYTES = len(MAGIC) + 64 + 1
_READ_BYTES = 2**22
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
"""What must be the same for a search to go on, with its words, in the order of telling."""


class DamagedCheckpointError(Exception):
    """The content of a file is no checkpoint; the text says why."""


@dataclass(frozen=True)
class SavedCheckpoint:
    """A checkpoint that was read whole: its head, and what the explorer wrote."""

    path: Path
    head: Mapping[str, Any]
    payload: memoryview


def machine() -> str:
    """How this machine stores the explorer's numbers, in words."""
    return f"{sys.byteorder} endian, {sys.maxsize.bit_length() + 1} bits"


def checkpoint_path(folder: Path, test: str) -> Path:
    """The path of a test's checkpoint."""
    return folder / (re.sub(r"[^A-Za-z0-9_.=+-]", "_", test) + ENDING)


# ---------------------------------------------------------------- writing


def seal(file: int, head: Mapping[str, object]) -> None:
    """Writes the head of a file whose payload is there, and lets all of it reach the disk.

    `OSError` where that fails.
    """
    digest = hashlib.sha256()
    size = os.fstat(file).st_size - HEAD
    done = 0
    while done < size:
        piece = os.pread(file, min(_READ_BYTES, size - done), HEAD + done)
        if not piece:
            raise OSError("it became shorter")
        digest.update(piece)
        done += len(piece)
    payload = {"bytes": size, "sha256": digest.hexdigest()}
    document = {
        "schema": SCHEMA,
        "soter": VERSION,
        "code": soter_sha256(),
        **head,
        "payload": payload,
    }
    text = json.dumps(document, allow_nan=False).encode()
    rest = text.ljust(HEAD - _SEAL_BYTES)
    assert len(rest) == HEAD - _SEAL_BYTES, len(text)
    os.pwrite(file, MAGIC + hashlib.sha256(rest).hexdigest().encode() + b"\n" + rest, 0)
    os.fsync(file)


def take_place(made: Path, path: Path) -> None:
    """Moves a sealed file to the place of the last one; `OSError`."""
    made.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


# ---------------------------------------------------------------- reading


def read_checkpoint(path: Path) -> SavedCheckpoint:
    """Reads a checkpoint; `SoterError` D012 where a file is none, or is not as it was written."""
    try:
        return _read_whole(path)
    except OSError as error:
        raise no_checkpoint(path, reason(error)) from error
    except DamagedCheckpointError as error:
        raise no_checkpoint(path, str(error)) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise no_checkpoint(path, "its head says something else") from error


def _read_whole(path: Path) -> SavedCheckpoint:
    if path.exists() and not path.is_file():  # a pipe would be waited for, for ever
        raise DamagedCheckpointError("it is no regular file")
    with path.open("rb") as stream:
        block = stream.read(HEAD)
        if not block.startswith(MAGIC):
            raise DamagedCheckpointError("it does not begin as one")
        if len(block) < HEAD:
            raise DamagedCheckpointError("its end is missing")
        seal_line, rest = block[len(MAGIC) : _SEAL_BYTES], block[_SEAL_BYTES:]
        if seal_line != hashlib.sha256(rest).hexdigest().encode() + b"\n":
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
        f"{what}: {_value_text(name, then.get(name))} then, "
        f"{_value_text(name, wanted.get(name))} now"
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


def _value_text(name: str, value: object) -> str:
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
    """What the search of a part found (`SearchResult`): the fields of COUNTS, and these."""

    @property
    def states(self) -> int:
        """How many configurations it stored."""

    @property
    def seconds(self) -> float:
        """How many seconds it took."""


@dataclass
class Checkpoint:
    """The checkpoint of one test: its path, what it is about, and what the search goes on from.

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
    """How many configurations were there when the search went on."""

    def __post_init__(self) -> None:
        if self.saved is not None:
            self.states = self.resumed = int(self.saved.head["states"])

    @property
    def part(self) -> int:
        """The part of the system that was searched."""
        return 0 if self.saved is None else int(self.saved.head["part"])

    @property
    def parts(self) -> int | None:
        """How many parts were explored apart; None: the search begins."""
        return None if self.saved is None else int(self.saved.head["parts"])

    @property
    def seconds(self) -> float:
        """For how many seconds the part had been searched."""
        return 0.0 if self.saved is None else float(self.saved.head["seconds"])

    @property
    def ended_counts(self) -> tuple[Mapping[str, Any], ...]:
        """The counts of the parts before it, as `part_counts` gave them."""
        return () if self.saved is None else tuple(self.saved.head["ended"])

    def try_out(self) -> None:
        """Tries whether a checkpoint could be written now; `SoterError` D006, D014."""
        os.close(self.open(".ending"))
        beside(self.path, ".ending").unlink()

    def saver(self, part: int, parts: int, ended: Sequence[EndedPart]) -> Saver:
        """The saver for the search of one of `parts` parts; `ended`: results of those before."""
        resumes = self.saved is not None and part == self.part
        return Saver(self, part, parts, ended, self.saved if resumes else None)

    def open(self, ending: str) -> int:
        """Opens a new file beside it, placed behind the head's room; `SoterError` D006, D014."""
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
    """The path of the file that becomes the checkpoint when it is whole."""
    return path.with_name(path.name + ending)


def part_counts(search_result: EndedPart) -> dict[str, float]:
    """The counts that a head keeps of the search of a part."""
    return {
        "seconds": search_result.seconds,
        **{name: getattr(search_result, name) for name in COUNTS},
    }


class Saver:
    """Asks the explorer for a checkpoint, again and again, and at the end of its search."""

    def __init__(
        self,
        checkpoint: Checkpoint,
        part: int,
        parts: int,
        ended: Sequence[EndedPart],
        saved: SavedCheckpoint | None,
    ) -> None:
        self._checkpoint = checkpoint
        self._head = {
            "about": dict(checkpoint.about),
            "part": part,
            "parts": parts,
            "ended": [part_counts(f) for f in ended],
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
        """For how many seconds this part was searched before."""
        return self._checkpoint.seconds if self._saved is not None else 0.0

    @property
    def states(self) -> int:
        """How many configurations the last written checkpoint has; 0: there is none."""
        return self._checkpoint.states

    def begin(self, ffi: Any, options: Any) -> None:  # noqa: ANN401 - cffi has no types
        """Enters in `soter_explore_options` where to write, and what to go on from."""
        self._end = self._checkpoint.open(".ending")
        options.save_to = self._end + 1
        if self._saved is not None:
            self._payload = ffi.from_buffer("uint8_t[]", self._saved.payload)
            options.resume = self._payload
            options.resume_bytes = len(self._saved.payload)

    def look(self, progress: Any) -> None:  # noqa: ANN401 - cdata
        """Asks for a checkpoint if it is time, and takes one that was written."""
        if self._asked >= 0:
            if progress.save_to == 0:
                self._finish_save(progress)
        elif time.perf_counter() - self._last_s >= self._checkpoint.every_s and not progress.stop:
            try:
                self._asked = self._checkpoint.open(".writing")
            except SoterError as error:
                self._checkpoint.problem = error.diagnostics[0].message
                self._last_s = time.perf_counter()
            else:
                progress.save_to = self._asked + 1

    def end(self, progress: Any, result: Any) -> None:  # noqa: ANN401 - cdata
        """Takes the last checkpoint and leaves no other files."""
        if self._asked >= 0 and progress.save_to == 0:
            self._finish_save(progress)
        if result.saved:
            self._seal(self._end, ".ending", int(result.states))
        elif int(result.status) not in NOTHING_TO_WRITE:
            self._checkpoint.problem = UNWRITTEN
        self.close()

    def close(self) -> None:
        """Closes what is open, and removes the files beside the checkpoint."""
        for file, ending in ((self._end, ".ending"), (self._asked, ".writing")):
            if file >= 0:
                os.close(file)
                with contextlib.suppress(OSError):
                    beside(self._checkpoint.path, ending).unlink()
        self._end = self._asked = -1
        self._payload = None

    def _finish_save(self, progress: Any) -> None:  # noqa: ANN401 - cdata
        if progress.saved > self._written:
            self._seal(self._asked, ".writing", int(progress.saved_states))
        else:
            self._checkpoint.problem = UNWRITTEN
        self._written = int(progress.saved)
        os.close(self._asked)
        with contextlib.suppress(OSError):
            beside(self._checkpoint.path, ".writing").unlink()
        self._asked = -1
        self._last_s = time.perf_counter()

    def _seal(self, file: int, ending: str, states: int) -> None:
        """Seals what was written and puts it in its place; `problem` says why it cannot."""
        head = {
            **self._head,
            "states": self._before + states,
            "seconds": self.seconds + time.perf_counter() - self._began_s,
        }
        try:
            seal(file, head)
            take_place(beside(self._checkpoint.path, ending), self._checkpoint.path)
        except OSError as error:
            self._checkpoint.problem = reason(error)
        else:
            self._checkpoint.states, self._checkpoint.problem = self._before + states, ""
