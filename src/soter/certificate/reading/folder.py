"""The folder of a certificate: every byte covered, nothing besides; and the program in it.

Purpose: `read_certificate` reads a folder and checks what docs/verification.md (section 4) lays
down: names, hashes, the canonical manifest, sizes of tables. `read_program` makes a checked program
of the files below `program/` and the manifest's parameters, and reads nothing else.
`refuse_cells`: where nothing is claimed of K, K is empty.
Non-goals: believing anything that stands in it (`rechecker.py`); what the program says about a
module (`reading/problem.py`), which claims a part of a group rests on (`proof_methods.py`).

The argument: the seal is the hash of the manifest, which has the hash of every other file; each
file is read once, and what is checked are those bytes. A table that is asked for is noted: at the
end those that nobody asked for are refused (`unused_tables`).
"""

from __future__ import annotations

import codecs
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

from soter.certificate.report import NotRecheckedError, RecheckAssumption, RejectedError
from soter.diagnostics.diagnostic import Diagnostics, Severity, SoterError
from soter.language.elaborate.passes.system_numbers import has_param
from soter.language.front_end import check_file
from soter.language.load.loader import load
from soter.language.model.types import BoolType, DurationType, EnumType, FloatType, IntType
from soter.language.syntax import tree
from soter.report.wording import visible
from soter.version import why_format_is_unreadable

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from soter.language.front_end import CheckResult
    from soter.language.model.typed import TypedProgram


MANIFEST, SEAL = "manifest.json", "SEAL"
FORMAT = 2
"""The version of the format of certificates: 1 had other texts, which nobody read."""
MANIFEST_KEYS = "schema files main params modules program_sha256"
CELLS_MAX = 200_000_000
"""Cells of all grids of a certificate together, at most."""
ENTRIES_MAX = 100_000
"""Files and folders of a certificate, at most."""
MANIFEST_MAX = 64 << 20
PROGRAM_MAX = 32 << 20
FILE_MAX = 2 * CELLS_MAX
"""Bytes of any other file, at most: a table of ranks over the largest grid."""
BYTES_MAX = 2 << 30
"""Bytes of all files together, at most."""
FREE = frozenset({"P3", "ttf", "safer"})
RETURN = frozenset({"P2b"})
OF_SETS = FREE | RETURN | {"P2a", "start"}
"""Claims that rest on K."""


class NotACertificateError(Exception):
    """The folder has no certificate."""


@dataclass(eq=False)
class Certificate:
    """A folder whose hashes are right. `used` collects the names of the tables read so far."""

    folder: Path
    manifest: dict[str, Any]
    contents: dict[str, bytes]
    used: set[str]
    cells: int = 0
    """How many cells the grids have that were asked for so far."""

    @property
    def seal(self) -> str:
        """The SHA-256 hash of the manifest, in hexadecimal; it covers all other files."""
        return hashlib.sha256(canonical_json(self.manifest)).hexdigest()

    @property
    def unused_tables(self) -> list[str]:
        """The names of the tables that nobody read, so that no claim rests on them."""
        return sorted({n for n in self.contents if n.startswith("sets/")} - self.used)

    def breakpoints(self, path: object) -> tuple[float, ...]:
        """An axis's breakpoints; raises RejectedError unless two or more, finite and rising."""
        data = self.table_bytes(path)
        if len(data) % 8 or len(data) < 16:
            raise RejectedError(f"`{path}` holds no breakpoints")
        breakpoints = tuple(np.frombuffer(data, dtype="<f8").tolist())
        if not all(map(math.isfinite, breakpoints)):
            raise RejectedError(f"`{path}`: a breakpoint is not finite")
        if any(a >= b for a, b in pairwise(breakpoints)):
            raise RejectedError(f"`{path}`: breakpoints do not increase")
        return breakpoints

    def number_table(self, path: object, shape: tuple[int, ...], kind: str) -> NDArray[Any]:
        """A table of that shape, `kind` being `<u1` or `<u2`; RejectedError for another size."""
        data, dtype = self.table_bytes(path), np.dtype(kind)
        if len(data) != math.prod(shape) * dtype.itemsize:
            raise RejectedError(f"`{path}` is not the size of its grid")
        return np.frombuffer(data, dtype=dtype).reshape(shape)

    def set_of_cells(self, path: object, shape: tuple[int, ...]) -> NDArray[np.bool_]:
        """A set of cells of that shape; RejectedError for another size, or bits behind its end."""
        cells = math.prod(shape)
        data = self.number_table(path, (-(-cells // 8),), "<u1")
        every = np.unpackbits(data, bitorder="little")
        if every[cells:].any():
            raise RejectedError(f"`{path}`: bits are set behind the last cell")
        return every[:cells].astype(np.bool_).reshape(shape)

    def count_cells(self, shape: tuple[int, ...]) -> None:
        """Counts cells; raises NotRecheckedError if all grids together exceed `CELLS_MAX`."""
        self.cells += math.prod(shape)
        if self.cells > CELLS_MAX:
            raise NotRecheckedError(f"more than {CELLS_MAX:,} cells in all grids: not looked at")

    def table_bytes(self, path: object) -> bytes:
        """Reads a file below `sets/`, notes its name; raises RejectedError if it is missing."""
        if not isinstance(path, str) or not path.startswith("sets/") or path not in self.contents:
            raise RejectedError(f"there is no table `{path}`")
        self.used.add(path)
        return self.contents[path]


def read_certificate(folder: Path) -> Certificate:
    """Reads the certificate in a folder; raises NotACertificateError if the folder has none.

    Raises RejectedError for a bad one, NotRecheckedError if it is too large or cannot be read.
    """
    if not folder.is_dir():
        raise NotACertificateError(f"`{folder}` is not a folder")
    if not (folder / MANIFEST).is_file() or not (folder / SEAL).is_file():
        raise NotACertificateError(f"`{folder}` holds no `{MANIFEST}` and `{SEAL}`")
    contents = {name: _read_file(folder, name, size) for name, size in _file_sizes(folder).items()}
    raw, seal = contents.pop(MANIFEST), contents.pop(SEAL)
    if seal != (hashlib.sha256(raw).hexdigest() + "\n").encode():
        raise RejectedError("the seal does not fit the manifest")
    manifest = _parse_manifest(raw)
    _require_this_format(manifest.get("schema"))
    files = manifest.get("files")
    if not isinstance(files, dict):
        raise RejectedError("the manifest lists no files")
    for name in sorted(files.keys() ^ contents.keys()):
        side = "missing" if name in files else "not listed in the manifest"
        raise RejectedError(f"`{name}` is {side}")
    for name, data in contents.items():
        if not name.startswith(("program/", "sets/")):
            raise RejectedError(f"`{name}` stands outside `program/` and `sets/`")
        if hashlib.sha256(data).hexdigest() != files[name]:
            raise RejectedError(f"`{name}` was changed")
    return Certificate(folder, manifest, contents, set())


def _require_this_format(number: object) -> None:
    """Raises NotRecheckedError for the format of another version of Soter."""
    if type(number) is not int or number < 1:
        raise RejectedError("the manifest does not say the version of its format")
    if other := why_format_is_unreadable(number, FORMAT):
        raise NotRecheckedError(f"{other}: make it again with `soter verify --cert`")


def _file_sizes(folder: Path) -> dict[str, int]:
    """The size in bytes of every file, by name in sorted order; does not open the files.

    Raises RejectedError for links, devices and empty folders, NotRecheckedError for too many files
    or bytes.
    """
    sizes: dict[str, int] = {}
    folders: set[str] = set()
    waiting = [folder]
    while waiting:
        at = waiting.pop()
        for path, status in _folder_entries(at):
            name = path.relative_to(folder).as_posix()
            if len(sizes) + len(folders) >= ENTRIES_MAX:
                raise NotRecheckedError(f"more than {ENTRIES_MAX:,} files and folders: not read")
            if stat.S_ISDIR(status.st_mode):
                folders.add(name)
                waiting.append(path)
            elif not stat.S_ISREG(status.st_mode):
                raise RejectedError(f"`{name}` is neither a file nor a folder")
            elif status.st_size > {MANIFEST: MANIFEST_MAX, "program": PROGRAM_MAX}.get(
                name.partition("/")[0], FILE_MAX
            ):
                raise NotRecheckedError(
                    f"`{name}` has {status.st_size:,} bytes: too many to be read"
                )
            else:
                sizes[name] = status.st_size
    needed = {p.as_posix() for name in sizes for p in PurePosixPath(name).parents}
    for name in sorted(folders - needed):
        raise RejectedError(f"the folder `{name}` is empty")
    if sum(sizes.values()) > BYTES_MAX:
        raise NotRecheckedError(f"the files are larger than {BYTES_MAX:,} bytes: not read")
    return dict(sorted(sizes.items()))


def _folder_entries(at: Path) -> Iterator[tuple[Path, os.stat_result]]:
    """Lists a folder without following links; raises NotRecheckedError if unreadable."""
    try:
        with os.scandir(at) as entries:
            for entry in entries:
                yield Path(entry.path), entry.stat(follow_symlinks=False)
    except OSError as error:
        raise NotRecheckedError(f"`{at.name}` cannot be read: {error.strerror}") from None


def _read_file(folder: Path, name: str, size: int) -> bytes:
    """A plain file's bytes; RejectedError unless `size` many, NotRecheckedError if unreadable."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        with os.fdopen(os.open(folder / name, flags), "rb") as file:
            data = file.read(size + 1) if stat.S_ISREG(os.fstat(file.fileno()).st_mode) else None
    except OSError as error:
        raise NotRecheckedError(f"`{name}` cannot be read: {error.strerror}") from None
    if data is None or len(data) != size:
        raise RejectedError(f"`{name}` was changed while it was read")
    return data


def _parse_manifest(raw: bytes) -> dict[str, Any]:
    try:
        manifest = json.loads(raw.decode("utf-8"))
        again = canonical_json(manifest)
    except (ValueError, RecursionError) as error:
        raise RejectedError(f"the manifest is not JSON: {error}") from None
    if not isinstance(manifest, dict) or again != raw:
        raise RejectedError("the manifest is not in its canonical form")
    return manifest


def canonical_json(manifest: object) -> bytes:
    """Encodes JSON with sorted keys, no spaces, only ASCII, and a final newline."""
    text = json.dumps(manifest, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return (text + "\n").encode()


def read_program(certificate: Certificate) -> tuple[CheckResult, dict[str, Any]]:
    """The checked program and its parameter values; raises SoterError if it has errors.

    Raises RejectedError if it is missing or has another hash than the manifest, NotRecheckedError
    if all its errors are words that an earlier version of Soter had.
    """
    main = certificate.manifest["main"]
    if not isinstance(main, str) or f"program/{main}" not in certificate.contents:
        raise RejectedError(f"the main file `{main}` is not in the certificate")
    path = str(certificate.folder / "program" / main)
    _refuse_files_not_sealed(certificate, path)
    checked = check_file(path)
    overrides: dict[str, Any] = {}
    if checked.program is not None:
        overrides = _parameter_values(certificate, checked.program)
        checked = check_file(path, None, overrides)
    if not checked.ok or checked.program is None:
        error = SoterError(checked.diagnostics.items)
        if all(d.code == "S026" for d in error.diagnostics if d.severity is Severity.ERROR):
            raise NotRecheckedError(f"its program is of an older soter: {error}")
        raise error
    if checked.program.sha256 != certificate.manifest["program_sha256"]:
        raise RejectedError("the program is another one than the manifest says")
    _refuse_bytes_not_sealed(certificate, checked)
    return checked, overrides


def _refuse_bytes_not_sealed(certificate: Certificate, checked: CheckResult) -> None:
    """Raises RejectedError if a file that the front end read has other bytes than were sealed."""
    assert checked.loaded is not None
    root = certificate.folder.resolve()
    for path, digest in checked.loaded.contents.items():
        sealed = certificate.contents[path.resolve().relative_to(root).as_posix()]
        texts = sealed, sealed.removeprefix(codecs.BOM_UTF8)
        if digest not in [hashlib.sha256(x).hexdigest() for x in texts]:
            raise RejectedError(f"`{path.name}` was changed while it was being read")


def files_of_program(path: str) -> list[Path]:
    """The main file, all its imports, and their data files. Raises SoterError as `load` does."""
    diagnostics = Diagnostics()
    loaded = load(path, diagnostics)
    if loaded is None:
        raise SoterError(diagnostics.items)
    paths = [f.path for f in loaded.files]
    for file in loaded.files:
        constants = [d for d in file.file.declarations if isinstance(d, tree.ConstDecl)]
        paths += [file.path.parent / d.data for d in constants if d.data is not None]
    return paths


def _refuse_files_not_sealed(certificate: Certificate, path: str) -> None:
    """Raises RejectedError unless the program reads exactly the files below `program/`."""
    root, paths = certificate.folder.resolve(), files_of_program(path)
    unread = {name for name in certificate.contents if name.startswith("program/")}
    for path_read in paths:
        resolved = path_read.resolve()
        name = resolved.relative_to(root).as_posix() if resolved.is_relative_to(root) else ""
        if name not in certificate.contents:
            raise RejectedError(f"the program reads `{path_read.name}` outside the certificate")
        unread.discard(name)
    for name in sorted(unread):
        raise RejectedError(f"the program does not read `{name}`")


def _parameter_values(certificate: Certificate, program: TypedProgram) -> dict[str, Any]:
    params = certificate.manifest["params"]
    if not isinstance(params, dict):
        raise RejectedError("`params` is not as it should be")
    value_by_name = {}
    for name, value in params.items():
        param = program.param(name)
        if param is None or not has_param(program, program.systems.values(), name):
            raise RejectedError(f"the program has no parameter `{name}`")
        value_by_name[name] = _parameter_value(param.type, value, name)
    return value_by_name


def _parameter_value(type_: object, value: object, name: str) -> object:
    if isinstance(type_, FloatType):
        return number_from_hexadecimal(value, name)
    kind = {BoolType: bool, IntType: int, DurationType: int, EnumType: int}.get(type(type_))
    if kind is None or type(value) is not kind:
        raise RejectedError(f"parameter `{name}` is not as it should be")
    if isinstance(type_, EnumType) and value not in range(len(type_.members)):
        raise RejectedError(f"parameter `{name}` is no member of its type")
    return value


def number_from_hexadecimal(text: object, name: str) -> float:
    """The finite number that a text of `float.hex` encodes. Raises RejectedError otherwise."""
    try:
        value = float.fromhex(text)  # type: ignore[arg-type]  # checked here
    except (TypeError, ValueError, OverflowError):
        raise RejectedError(f"`{name}` is no hexadecimal number") from None
    if text != value.hex() or value - value != 0.0:
        raise RejectedError(f"`{name}` is not written as it should be")
    return value


def refuse_cells(cores: Sequence[NDArray[Any]], claims: set[str], recover_ns: object) -> None:
    """Raises RejectedError for cells of K or a time to return that no claim needs.

    `cores`: K of each group, of any shape.
    """
    if not claims & OF_SETS and any(core.any() for core in cores):
        raise RejectedError("K holds cells, and nothing is claimed of them")
    if not claims & RETURN and recover_ns is not None:
        raise RejectedError("no claim rests on the time to return")


def require_keys(entry: object, names: str, holder: str, optional: str = "") -> None:
    """Raises RejectedError unless an entry has all keys in `names` and no others but `optional`."""
    if not isinstance(entry, dict):
        raise RejectedError(f"{holder} is not as it should be")
    allowed = {*names.split(), *(name for name in optional.split() if name in entry)}
    for name in sorted(entry.keys() ^ allowed):
        raise RejectedError(f"{holder} has {'no' if name in allowed else 'an unknown'} `{name}`")


def stated_assumptions(manifest: dict[str, Any]) -> list[RecheckAssumption]:
    """The assumptions that the prover wrote; RejectedError unless they are a list of text pairs."""
    stated = manifest.get("assumptions", [])
    if not isinstance(stated, list) or any(
        not isinstance(pair, list) or [*map(type, pair)] != [str, str] for pair in stated
    ):
        raise RejectedError("`assumptions` is not as it should be")
    return [RecheckAssumption(visible(key), visible(text)) for key, text in stated]
