"""The cache of built files. An entry is used only if it is complete and only we could write it.

Purpose: an entry is a folder NAME-CONTENT with its files and their seals (hashes). It is made in
another folder and then moved, so it is complete or absent. An entry that is damaged, or that others
could have written, is made again. The least recently used entries are removed first.
`included_files` and `files_below` find the files that compiled code depends on, for CONTENT and for
packages. `has_macro_includes` finds includes whose file names macros make, which are not followed.
Non-goals: what is in an entry; folders above the cache that others may write to; headers in angle
brackets; which names macros make (`kept_state.py` finds them).
"""

from __future__ import annotations

import contextlib
import fnmatch
import hashlib
import os
import re
import shutil
import stat
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import read_bytes

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator


LIMIT = "SOTER_CACHE_MB"
LIMIT_MB = 2048
"""The default limit of the cache in MB, without $SOTER_CACHE_MB and without a file `limit`."""
LIMIT_LONGEST = 64
"""How many characters of the file `limit` are read."""
LIMIT_FILE = "limit"
YOUNG_S = 600.0
"""An entry used within this time is never removed: another process may be about to load it."""
LOOK_S = 60.0
"""For so long after one check of the limit no process checks it again: new entries are young."""
LOOKED_FILE = "looked"
"""A file whose time is that of the last check of the limit, and whose text is the limit then."""
SEALS = "seals"
MAKING = ".soter-making-"
MB = 1_000_000
OTHERS = stat.S_IWGRP | stat.S_IWOTH

_ours: set[Path] = set()
"""Entries that this process has made or used."""


def cache_dir() -> Path:
    """The folder of the cache: $SOTER_CACHE, else the user's cache folder."""
    chosen = os.environ.get("SOTER_CACHE")
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "soter"


def digest(parts: Iterable[str]) -> str:
    """The SHA-256 of a sequence of texts, which also depends on where each text ends."""
    sha = hashlib.sha256()
    for part in parts:
        data = part.encode("utf-8", "surrogatepass")
        sha.update(len(data).to_bytes(8, "little"))
        sha.update(data)
    return sha.hexdigest()


def cached_folder(
    name: str, content: str, files: tuple[str, ...], make: Callable[[Path], None]
) -> Path:
    """The cache's folder with `files`; if it is missing, `make(folder)` fills a new folder.

    `content` is a hash of everything that the files depend on. Raises SoterError X006 if the cache
    cannot be used; errors of `make` are passed on.
    """
    if find_cached(name, content, files) is None:
        with new_entry(name, content, files) as made:
            make(made)
    return _entry_folder(cache_dir(), name, content)


def find_cached(name: str, content: str, files: tuple[str, ...]) -> Path | None:
    """The cache's folder with `files`, else None; SoterError X006 if others may write to it."""
    folder = cache_dir()
    _refuse_a_folder_of_others(folder)
    entry = _entry_folder(folder, name, content)
    if not _is_whole(entry, content, files):
        return None
    with contextlib.suppress(OSError):  # a read-only cache can be used, too
        os.utime(entry)
    _ours.add(entry)
    return entry


@contextlib.contextmanager
def new_entry(name: str, content: str, files: tuple[str, ...]) -> Iterator[Path]:
    """Yields an empty folder that the `with` block fills, then makes it an entry of the cache.

    `content` is as for `cached_folder`. Raises SoterError X006 if the cache cannot be used.
    """
    entry = _entry_folder(cache_dir(), name, content)
    most, _ = cache_limit()
    with _writable_folder() as folder:
        with tempfile.TemporaryDirectory(dir=folder, prefix=MAKING) as work:
            made = Path(work) / "made"
            made.mkdir(mode=0o700)
            yield made
            _seal_entry(made, content, files)
            _move_entry(made, entry, Path(work) / "old", content, files)
        _ours.add(entry)
        _remove_old_entries(folder, most)


@contextlib.contextmanager
def _writable_folder() -> Iterator[Path]:
    """The cache's folder, made if it is missing; an OSError becomes SoterError X006."""
    folder = cache_dir()
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        _refuse_a_folder_of_others(folder)
        yield folder
    except OSError as error:
        raise _unusable_cache_error(
            f"cannot write to the cache folder `{folder}`: {reason(error)}"
        ) from error


@contextlib.contextmanager
def work_folder() -> Iterator[Path]:
    """A temporary folder inside the cache; raises SoterError X006 if none can be made."""
    with _writable_folder() as folder:
        work = tempfile.TemporaryDirectory(dir=folder, prefix=MAKING)
    with work as name:
        yield Path(name)


def _entry_folder(folder: Path, name: str, content: str) -> Path:
    return folder.absolute() / f"{name}-{content[:32]}"


# ---------------------------------------------------------------- whole and ours


def _file_sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _seals_text(folder: Path, content: str, files: tuple[str, ...]) -> str:
    return "\n".join([content, *(_file_sha256(folder / name) for name in files)])


def _seal_entry(made: Path, content: str, files: tuple[str, ...]) -> None:
    """Deletes all but `files`, makes these writable for this user alone, and writes their seals."""
    wanted = {Path(name).parts[0] for name in files}
    for path in made.iterdir():
        if path.name not in wanted:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    (made / SEALS).write_text(_seals_text(made, content, files), encoding="utf-8")
    for name in (*files, SEALS):
        (made / name).chmod(0o600)


def _is_whole(entry: Path, content: str, files: tuple[str, ...]) -> bool:
    """Whether an entry is complete and undamaged, and no other user could have written to it.

    Loading half a library ends the process; loading another user's library runs their code.
    """
    try:
        ours = stat.S_ISDIR(entry.lstat().st_mode) and is_trusted_file(entry.lstat())
        for name in (*files, SEALS):
            status = (entry / name).lstat()
            ours = ours and stat.S_ISREG(status.st_mode) and is_trusted_file(status)
        seals = (entry / SEALS).read_text(encoding="utf-8") if ours else ""
        return ours and seals == _seals_text(entry, content, files)
    except (OSError, UnicodeDecodeError):
        return False


def is_trusted_file(status: os.stat_result) -> bool:
    """Whether a file belongs to this user or root, and nobody else may write to it."""
    return status.st_uid in {os.geteuid(), 0} and not status.st_mode & OTHERS


def _refuse_a_folder_of_others(folder: Path) -> None:
    try:
        status = folder.stat()
    except OSError:
        return  # it does not exist yet; making it reports errors
    if not is_trusted_file(status):
        mine = status.st_uid in {os.geteuid(), 0}
        why = "others may write to it" if mine else "it belongs to another user"
        fix = (f"if nobody has: chmod go-w '{folder}'",) if mine else ()
        message = f"the cache folder `{folder}` is not used: {why}"
        raise _unusable_cache_error(message, ("what is in it is loaded and run",), fix)


def _unusable_cache_error(
    message: str, notes: tuple[str, ...] = (), helps: tuple[str, ...] = ()
) -> SoterError:
    other = "choose another with the environment variable SOTER_CACHE"
    return SoterError((Diagnostic("X006", message, notes=notes, helps=(*helps, other)),))


def _move_entry(made: Path, entry: Path, old: Path, content: str, files: tuple[str, ...]) -> None:
    """Moves an entry into place, unless another process was faster."""
    if _is_whole(entry, content, files):
        return
    try:
        made.rename(entry)
    except OSError:
        if _is_whole(entry, content, files):
            return
        entry.rename(old)
        made.rename(entry)


# ---------------------------------------------------------------- room


def cache_limit() -> tuple[int, str]:
    """The cache's limit in bytes, and where it is set; raises X006 if it is no number."""
    text, where = os.environ.get(LIMIT, "").strip(), LIMIT
    if not text:
        file = cache_dir() / LIMIT_FILE
        where = str(file)
        with (
            contextlib.suppress(OSError, UnicodeDecodeError),
            file.open(encoding="ascii") as stream,
        ):
            text = stream.read(LIMIT_LONGEST).strip()
    if text and not (text.isascii() and text.isdigit()):
        help_ = (
            f"give a number of megabytes, or unset it for {LIMIT_MB}"
            if where == LIMIT
            else "set it again: soter cache limit 2048"
        )
        message = f"{where} is `{text[:40]}`"
        raise SoterError((Diagnostic("X006", message, helps=(help_,)),))
    return (int(text) if text else LIMIT_MB) * MB, where if text else "by default"


def set_limit(megabytes: int) -> None:
    """Stores the limit of the cache, and removes entries beyond it; raises SoterError X006."""
    with _writable_folder() as folder:
        with tempfile.TemporaryDirectory(dir=folder, prefix=MAKING) as work:
            made = Path(work) / LIMIT_FILE
            made.write_text(f"{megabytes}\n", encoding="ascii")
            made.replace(folder / LIMIT_FILE)
        (folder / LOOKED_FILE).unlink(missing_ok=True)
    _remove_old_entries(folder, cache_limit()[0])


def cache_entries() -> list[tuple[float, int, Path]]:
    """The entries of the cache, oldest first: time of last use (s since 1970), bytes, folder.

    Raises SoterError X006 if the folder of the cache cannot be read.
    """
    try:
        return [(at, size, Path(entry)) for at, size, entry in sorted(_entries_in(cache_dir()))]
    except FileNotFoundError:
        return []
    except OSError as error:
        message = f"cannot read the cache folder `{cache_dir()}`: {reason(error)}"
        raise _unusable_cache_error(message) from error


def clear_cache() -> tuple[int, int]:
    """Removes all entries; gives their number and their bytes. Raises X006 if an entry remains."""
    _refuse_a_folder_of_others(cache_dir())
    removable = cache_entries()
    for _, _, entry in removable:
        try:
            shutil.rmtree(entry)
        except FileNotFoundError:
            continue
        except OSError as error:
            message = f"cannot remove `{entry}`: {reason(error)}"
            raise _unusable_cache_error(message) from error
    return len(removable), sum(size for _, size, _ in removable)


def _remove_old_entries(folder: Path, most: int) -> None:
    """Removes the least recently used entries beyond `most` bytes; keeps those of this process."""
    now = time.time()
    if _was_enforced_lately(folder, most, now):
        return
    (folder / LOOKED_FILE).write_text(f"{most}\n", encoding="ascii")
    used = sorted(_entries_in(folder))
    size = sum(n for _, n, _ in used)
    for at, n, entry in used:
        if size <= most or now - at < YOUNG_S:
            return
        if Path(entry) not in _ours:
            size -= n
            shutil.rmtree(entry, ignore_errors=True)


def _was_enforced_lately(folder: Path, most: int, now: float) -> bool:
    """Whether a process has enforced the same limit in the last `LOOK_S` seconds."""
    file = folder / LOOKED_FILE
    try:
        lately = 0.0 <= now - file.stat().st_mtime < LOOK_S
        return lately and file.read_text(encoding="utf-8") == f"{most}\n"
    except (OSError, UnicodeDecodeError):
        return False


def _entries_in(folder: Path) -> list[tuple[float, int, str]]:
    """The entries in a folder, each as time of last use, bytes and path."""
    used = []
    with os.scandir(folder.absolute()) as listed:
        for entry in listed:
            try:
                if not entry.is_dir(follow_symlinks=False):
                    continue
                names, size = _names_and_bytes(entry.path)
                if entry.name.startswith(MAKING) or SEALS in names:
                    last = entry.stat(follow_symlinks=False).st_mtime
                    used.append((last, size, entry.path))
            except OSError:
                continue  # another process removes it
    return used


def _names_and_bytes(folder: str) -> tuple[set[str], int]:
    """The names in a folder, and the bytes of all files below it."""
    names, size = set(), 0
    with os.scandir(folder) as listed:
        for entry in listed:
            names.add(entry.name)
            size += entry.stat(follow_symlinks=False).st_size
            if entry.is_dir(follow_symlinks=False):
                size += _names_and_bytes(entry.path)[1]
    return names, size


SOTER = Path(__file__).resolve().parents[1]


def files_below(folder: Path, *patterns: str) -> list[Path]:
    """All files below a folder that match a pattern, sorted; FileNotFoundError if no file does."""
    wanted = re.compile("|".join(map(fnmatch.translate, patterns))).match
    names = [f"{at}{os.sep}{n}" for at, _, files in os.walk(folder) for n in files if wanted(n)]
    paths = [Path(name) for name in sorted(names, key=lambda name: name.replace(os.sep, "\0"))]
    if not paths:
        shown = ", ".join(patterns)
        raise FileNotFoundError(f"soter is not whole: no {shown} below {folder.name}/")
    return paths


@cache
def soter_sha256() -> str:
    """A hash of all source files of Soter, the prelude included."""
    sha = hashlib.sha256()
    below = len(SOTER.as_posix()) + 1
    for path in files_below(SOTER, "*.py", "*.c", "*.h", "*.soter"):
        sha.update(path.as_posix()[below:].encode())
        sha.update(hashlib.sha256(path.read_bytes()).digest())
    return sha.hexdigest()


INCLUDE = re.compile(
    r'^[ \t]*(?:#|%:)[ \t]*(?:include(?:_next)?|import|embed|define|if|elif)\b[^"\n]*"([^"\n]+)"',
    re.MULTILINE,
)
"""A name in quotes in a directive that includes a file, that defines a macro (as `#include NAME`
may use it), or that tests whether a file exists (`__has_include`)."""
INCBIN = re.compile(r'\.incbin[ \t]*\\?"([^"\\\n]+)')
"""A file whose bytes the assembler directive `.incbin` puts into the object."""
MACRO_INCLUDE = re.compile(
    r"^[ \t]*(?:#|%:)[ \t]*(?:include(?:_next)?|import|embed)[ \t]*([A-Za-z_]\w*)(.*)$",
    re.MULTILINE,
)
"""An include whose file name is a macro: its name, and the rest of the line."""
FILES_MAX = 1000


def included_files(*sources: str | Path, folders: tuple[Path, ...] = ()) -> dict[Path, str]:
    """The text of C files and of all that they include in quotes, by path; X003 if unreadable.

    `folders`: where headers are looked for besides the folder of the file that includes them.
    """
    waiting, text_by_path = [Path(s).resolve() for s in sources], dict[Path, str]()
    while waiting and len(text_by_path) < FILES_MAX:
        path = waiting.pop()
        if path in text_by_path:
            continue
        text_by_path[path] = _read_source(path)
        text = text_by_path[path].replace("\\\n", "")
        for name in (*INCLUDE.findall(text), *INCBIN.findall(text)):
            places = ((place / name).resolve() for place in (path.parent, *folders))
            waiting += [p for p in places if p.is_file()][:1]
    return text_by_path


def has_macro_includes(texts: Collection[str]) -> bool:
    """Whether C includes a file through a macro that is not simply a file name in quotes."""
    joined = [t.replace("\\\n", "") for t in texts]
    for name, rest in (found for t in joined for found in MACRO_INCLUDE.findall(t)):
        defined = re.compile(rf"^[ \t]*(?:#|%:)[ \t]*define[ \t]+{name}\b(?!\()(.*)$", re.MULTILINE)
        names = [d.strip() for t in joined for d in defined.findall(t)]
        if rest.lstrip().startswith("(") or not names or any(d[:1] not in '"<' for d in names):
            return True
    return False


def _read_source(path: Path) -> str:
    try:
        return read_bytes(path).decode("utf-8", "surrogateescape")
    except OSError as error:
        message = f"cannot read the extern's C file `{path}`: {reason(error)}"
        raise SoterError((Diagnostic("X003", message),)) from error
