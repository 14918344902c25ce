"""Writes a file so that it is either there in full or not there at all.

Purpose: a full disk, a crash or an interrupt never leaves half a file, nor harms an older one. In a
folder that Soter fills with its own names, it follows no link that leads elsewhere.
Non-goals: locking; of two writers of one path the last to finish wins. The diagnostics of errors:
whoever writes a report or a log makes them.
"""

from __future__ import annotations

import os
import re
import secrets
from contextlib import contextmanager, suppress
from pathlib import Path, PurePath
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


PART = ".part"
"""The ending of the temporary file while a file is being written."""


@contextmanager
def atomic_write(path: Path) -> Iterator[IO[bytes]]:
    """Gives a binary stream whose bytes replace `path` after the block has ended without error.

    The bytes go to a temporary file in the same folder, are synced to the disk and renamed to
    `path` (a link is followed). Missing parent folders are made. Raises `OSError` as the system
    reports it. Any error, also an interrupt, removes the temporary file. An existing path that is
    no regular file, such as `/dev/null`, is written directly, as it must not be replaced.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        with target.open("wb") as stream:
            yield stream
        return
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.name}.{os.getpid()}-{secrets.token_hex(4)}{PART}")
    try:
        with temporary.open("xb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(target)
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def path_without_links(folder: Path, name: str) -> Path:
    """The path of Soter's own file `name` in a folder; raises OSError if a part of it is a link."""
    path = folder
    for part in PurePath(name).parts:
        path /= part
        _require_no_link(path)
    return path


def require_no_links(folder: Path) -> None:
    """Raises OSError if a folder that Soter fills contains a link at any depth."""
    for at, folders, files in os.walk(folder):
        for name in (*folders, *files):
            _require_no_link(Path(at, name))


def _require_no_link(path: Path) -> None:
    if path.is_symlink():
        raise OSError(f"`{path}` is a link, and what that leads to is not written: remove it")


def files_left_by(folder: Path, process: int) -> list[tuple[Path, Path]]:
    """Unfinished files of an ended process in a folder: (temporary path, intended path)."""
    mark = f".{process}-"
    return [
        (part, part.with_name(part.name[1 : part.name.rindex(mark)]))
        for part in sorted(folder.glob(f".*{mark}*{PART}"))
    ]


def unfinished_files(path: Path) -> list[Path]:
    """The temporary files for `path` from processes that have ended."""
    target = path.resolve()
    named = re.compile(rf"\.{re.escape(target.name)}\.([0-9]+)-[0-9a-f]{{8}}{re.escape(PART)}")
    with suppress(OSError):
        parts = [(p, named.fullmatch(p.name)) for p in sorted(target.parent.iterdir())]
        return [p for p, match in parts if match and not _is_running(int(match.group(1)))]
    return []


def _is_running(process: int) -> bool:
    """Whether a process exists; it counts as running if the system does not tell."""
    if os.name != "posix":
        return True  # on this system signal 0 would end the process
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        pass
    return True
