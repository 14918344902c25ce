"""Write a file so that it is either there in full or not there at all.

Purpose: a full disk, a crash or an interrupt never leaves half a file, nor harms the one that
stood there before.
Non-goals: locking; of two writers of one path the last to finish wins.
"""

from __future__ import annotations

import os
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def whole_file(path: Path) -> Iterator[IO[bytes]]:
    """Give a binary stream whose bytes stand at `path` once the block has ended without error.

    The bytes go to a temporary name in the same folder, are synced to the disk and renamed over
    `path`. Missing parent folders are made. Raises `OSError` as the system reports it; the
    temporary file is removed on any error, an interrupt included.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    temporary = Path(name)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        # mkstemp makes the file private; give it the rights any new file would have.
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def _umask() -> int:
    """Return the process's file mode creation mask; it can only be read by setting it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def reason(error: OSError) -> str:
    """Say why the system refused, in lower case, without the number and the path."""
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]
