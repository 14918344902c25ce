"""Read files that a program names: whole, within bounds, and never from a device by accident.

Purpose: one way to read for sources and data, with the reasons people need when it fails.
Non-goals: decoding, diagnostics (`loader.py`, `data.py`).
"""

from __future__ import annotations

import os
import stat
from typing import TYPE_CHECKING

from soter.diagnostics.near import closest
from soter.diagnostics.refused import reason

if TYPE_CHECKING:
    from pathlib import Path


class ReadError(Exception):
    """A file that cannot be read; `missing` where there is none. The text says why."""

    def __init__(self, reason: str, *, missing: bool = False) -> None:
        super().__init__(reason)
        self.missing = missing


def read_bytes(path: Path, limit: int, *, special: bool = False) -> bytes:
    """The content of a file of at most `limit` bytes; raises `ReadError`.

    Pipes and devices are read only where they are `special`ly allowed: an import of one would
    wait for ever.
    """
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise ReadError("it is a folder")
        if not stat.S_ISREG(mode) and not special:
            raise ReadError("it is no ordinary file")
        with path.open("rb") as file:
            data = file.read(limit + 1)
    except (FileNotFoundError, NotADirectoryError):
        raise ReadError("there is no such file", missing=True) from None
    except OSError as error:
        raise ReadError(reason(error)) from error
    except (ValueError, RuntimeError) as error:
        raise ReadError(f"its name is impossible: {error}") from error
    if len(data) > limit:
        raise ReadError(f"it is too large: at most {limit // 2**20} MiB are read")
    return data


def near_names(path: Path) -> tuple[str, ...]:
    """A help line about a file that is missing: one with a similar name, or the folder."""
    try:
        names = sorted(entry.name for entry in os.scandir(path.parent) if entry.is_file())
    except (OSError, ValueError):
        return (f"there is no folder `{path.parent}`",)
    close = closest(path.name, names)
    return (f"did you mean `{path.parent / close[0]}`?",) if close else ()
