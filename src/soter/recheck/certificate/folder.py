"""The folder of a certificate: every byte covered, nothing besides.

Purpose: read and check what docs/verification.md (section 4) lays down: names, hashes, the
canonical manifest, sizes of tables.
Non-goals: believing anything that stands in it (`rechecker.py`).
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import stat
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.recheck.certificate.errors import RejectedError

if TYPE_CHECKING:
    from numpy.typing import NDArray

MANIFEST, SEAL = "manifest.json", "SEAL"
SCHEMA = 1
AXES_MAX = 6
CELLS_MAX = 200_000_000


class NotACertificateError(Exception):
    """There is no certificate in this place."""


@dataclass(eq=False)
class Certificate:
    """A folder whose hashes are right; `used` notes which files the claims rest on."""

    folder: Path
    manifest: dict[str, Any]
    contents: dict[str, bytes]
    used: set[str]

    # ------------------------------------------------------------ tables

    def edges(self, path: object) -> tuple[float, ...]:
        """The breakpoints of an axis.

        RejectedError where they are fewer than two, not finite, or do not rise.
        """
        data = self._bytes(path)
        if len(data) % 8 or len(data) < 16:
            raise RejectedError(f"`{path}` holds no breakpoints")
        found = tuple(float(x) for x in np.frombuffer(data, dtype="<f8"))
        if not all(math.isfinite(x) for x in found):
            raise RejectedError(f"`{path}`: a breakpoint is not finite")
        if any(a >= b for a, b in pairwise(found)):
            raise RejectedError(f"`{path}`: breakpoints do not increase")
        return found

    def numbers(self, path: object, shape: tuple[int, ...], kind: str) -> NDArray[Any]:
        """A table of whole numbers of that shape, `kind` being `<u1` or `<u2`.

        RejectedError where the file is not of its size.
        """
        data = self._bytes(path)
        dtype = np.dtype(kind)
        if len(data) != math.prod(shape) * dtype.itemsize:
            raise RejectedError(f"`{path}` is not the size of its grid")
        return np.frombuffer(data, dtype=dtype).reshape(shape)

    def bits(self, path: object, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """A set of cells of that shape; what fills up the last byte must be zero.

        RejectedError where it is not, or the file not of its size.
        """
        data = self._bytes(path)
        cells = math.prod(shape)
        if len(data) != -(-cells // 8):
            raise RejectedError(f"`{path}` is not the size of its grid")
        every = np.unpackbits(np.frombuffer(data, dtype="<u1"), bitorder="little")
        if every[cells:].any():
            raise RejectedError(f"`{path}`: bits are set behind the last cell")
        return every[:cells].astype(np.bool_).reshape(shape)

    def plain(self, path: object) -> bytes:
        """A file as it is."""
        return self._bytes(path)

    def _bytes(self, path: object) -> bytes:
        if not isinstance(path, str) or not path.startswith("sets/") or path not in self.contents:
            raise RejectedError(f"there is no table `{path}`")
        self.used.add(path)
        return self.contents[path]


def read_certificate(folder: Path) -> Certificate:
    """The certificate in a folder. `NotACertificateError`, or `RejectedError` for a bad one."""
    if not folder.is_dir():
        raise NotACertificateError(f"`{folder}` is not a folder")
    if not (folder / MANIFEST).is_file() or not (folder / SEAL).is_file():
        raise NotACertificateError(f"`{folder}` holds no `{MANIFEST}` and `{SEAL}`")
    contents = _everything(folder)
    raw, seal = contents.pop(MANIFEST), contents.pop(SEAL)
    if seal != (hashlib.sha256(raw).hexdigest() + "\n").encode():
        raise RejectedError("the seal does not fit the manifest")
    manifest = _parsed(raw)
    files = manifest.get("files")
    if not isinstance(files, dict):
        raise RejectedError("the manifest lists no files")
    for name in sorted(files.keys() ^ contents.keys()):
        side = "missing" if name in files else "not listed in the manifest"
        raise RejectedError(f"`{name}` is {side}")
    for name, digest in files.items():
        if PurePosixPath(name).parts[0] not in ("program", "sets"):
            raise RejectedError(f"`{name}` stands outside `program/` and `sets/`")
        if hashlib.sha256(contents[name]).hexdigest() != digest:
            raise RejectedError(f"`{name}` was changed")
    if manifest.get("schema") != SCHEMA:
        raise RejectedError(f"a manifest of schema {manifest.get('schema')}, not {SCHEMA}")
    return Certificate(folder, manifest, contents, set())


def _everything(folder: Path) -> dict[str, bytes]:
    """Every file below the folder; anything but plain files and needed folders is refused."""
    contents: dict[str, bytes] = {}
    folders: set[str] = set()
    waiting = [folder]
    while waiting:
        at = waiting.pop()
        with os.scandir(at) as entries:
            for entry in entries:
                path = Path(entry.path)
                name = path.relative_to(folder).as_posix()
                mode = entry.stat(follow_symlinks=False).st_mode
                if stat.S_ISDIR(mode):
                    folders.add(name)
                    waiting.append(path)
                elif stat.S_ISREG(mode):
                    contents[name] = path.read_bytes()
                else:
                    raise RejectedError(f"`{name}` is neither a file nor a folder")
    needed = {p.as_posix() for name in contents for p in PurePosixPath(name).parents}
    for name in sorted(folders - needed):
        raise RejectedError(f"the folder `{name}` is empty")
    return contents


def _parsed(raw: bytes) -> dict[str, Any]:
    try:
        manifest = json.loads(raw.decode("utf-8"))
        again = canonical(manifest)
    except (ValueError, RecursionError) as error:
        raise RejectedError(f"the manifest is not JSON: {error}") from None
    if not isinstance(manifest, dict) or again != raw:
        raise RejectedError("the manifest is not in its canonical form")
    return manifest


def canonical(manifest: object) -> bytes:
    """JSON with sorted keys, no spaces, plain ASCII, and a newline at the end."""
    text = json.dumps(manifest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return (text + "\n").encode()
