"""Reads files that users name, with a limit, and the text that says what an extern is bound to.

Purpose: `read_bytes` is the one way to read programs, data, logs and files of other commands, with
a reason when that fails. Reading ends, whatever file is named, and is never from a device by
accident. `binding_of` splits `"python:file.py:name"`, `"c:file.c:name"`, `"onnx:file.onnx"`,
`"sb3:file.zip"`, `"onnx:file.onnx:h0=hn"` and `"sb3:file.zip:vecnormalize.pkl"` into their parts.
Non-goals: the content, and diagnostics: the caller makes them; whether the files of a binding exist
(`simulate/externs/`).
"""

from __future__ import annotations

import io
import json
import os
import re
import stat
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from soter.diagnostics.similar_names import closest
from soter.diagnostics.system_texts import reason

MIB = 2**20
TEXT_MAX = 64 * MIB
"""Most bytes of a text file that another command wrote: report, mapping, times."""
PIPE_MAX = 1024 * MIB
"""Most bytes that are read of a log from a pipe."""
NONBLOCK = getattr(os, "O_NONBLOCK", 0)


class ReadError(OSError):
    """Reports why a file cannot be read. `missing` is true if the file does not exist."""

    def __init__(self, why: str, *, missing: bool = False) -> None:
        super().__init__(why)
        self.missing = missing


def read_bytes(path: Path, limit: int = TEXT_MAX, *, special: bool = False) -> bytes:
    """Gives the content of a file of at most `limit` bytes; raises `ReadError`.

    Pipes and devices are only read if `special` allows them: an import of one could wait for ever.
    A pipe without a writer is not waited for.
    """
    with open_finite_file(path, limit, pipes=special, devices=special) as file:
        try:
            size = 0 if isinstance(file, io.BytesIO) else os.fstat(file.fileno()).st_size
            data = _read_at_most(file, limit + 1, size) if size <= limit else None
        except OSError as error:
            raise ReadError(reason(error)) from error
    if data is None or len(data) > limit:
        raise ReadError(f"it is too large: at most {limit // MIB} MiB are read")
    return data


def _read_at_most(file: BinaryIO, most: int, size: int) -> bytes:
    """Gives at most `most` bytes of a file; takes only as much memory as it reads."""
    parts, room = [], most
    while part := file.read(min(room, size + MIB)):
        parts.append(part)
        room -= len(part)
    return b"".join(parts)


def read_json_text(path: Path) -> str:
    """Gives the text of a UTF-8 file. Raises ReadError, or ValueError if it is not UTF-8."""
    return read_bytes(path, special=True).decode("utf-8")


def open_finite_file(
    path: Path, limit: int = PIPE_MAX, *, pipes: bool = True, devices: bool = False
) -> BinaryIO:
    """Opens a file that surely ends; reads a pipe up to `limit` + 1 bytes. Raises ReadError."""
    try:
        _require_readable_kind(path.stat().st_mode, pipes=pipes, devices=devices)
        handle = os.open(path, os.O_RDONLY | NONBLOCK | getattr(os, "O_CLOEXEC", 0))
        if stat.S_ISFIFO(os.fstat(handle).st_mode):
            return io.BytesIO(_read_pipe(handle, limit + 1))
    except ReadError:
        raise
    except (FileNotFoundError, NotADirectoryError):
        raise ReadError("there is no such file", missing=True) from None
    except OSError as error:
        raise ReadError(reason(error)) from error
    except (ValueError, RuntimeError) as error:
        raise ReadError(f"its name is impossible: {error}") from error
    os.set_blocking(handle, True)
    return os.fdopen(handle, "rb")


def _require_readable_kind(mode: int, *, pipes: bool, devices: bool) -> None:
    if stat.S_ISDIR(mode):
        raise ReadError("it is a folder")
    allowed = stat.S_ISREG(mode) or (stat.S_ISFIFO(mode) and pipes)
    if not allowed and not (stat.S_ISCHR(mode) and devices):
        raise ReadError("it is no ordinary file")


def _read_pipe(handle: int, most: int) -> bytes:
    """Gives at most `most` bytes of a pipe, and closes its handle."""
    with os.fdopen(handle, "rb", buffering=0) as pipe:
        first = pipe.read(most)  # None: there is a writer, but nothing yet
        if first == b"":
            raise ReadError("nobody writes into this pipe")
        content = bytearray(first or b"")
        os.set_blocking(handle, True)
        while len(content) < most and (part := pipe.read(most - len(content))):
            content += part
    return bytes(content)


def path_beside(path: Path, name: str) -> Path | None:
    """Gives the path of the file `name` in the folder of `path`, as `path` is written.

    None if the file lies outside of that folder. If `path` is a link, the file may also lie in the
    folder of the link's target.
    """
    at = path.parent / name
    try:
        folders = (path.parent.resolve(), path.resolve().parent)
        stays = any(at.resolve().is_relative_to(folder) for folder in folders)
    except (OSError, ValueError, RuntimeError):
        return None
    return at if name and stays and not Path(name).is_absolute() else None


def near_name_helps(path: Path) -> tuple[str, ...]:
    """Gives help for a missing file: a similar name in its folder, or that the folder is absent."""
    try:
        with os.scandir(path.parent) as entries:
            names = sorted(entry.name for entry in entries if _is_file_entry(entry))
    except (OSError, ValueError):
        return (f"there is no folder `{path.parent}`",)
    close = closest(path.name, names)
    return (f"did you mean `{path.parent / close[0]}`?",) if close else ()


def _is_file_entry(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_file()
    except OSError:  # for instance links in a circle
        return False


def parse_json(text: str | bytes) -> Any:  # noqa: ANN401  any JSON document
    """Parses JSON; raises ValueError if it is wrong or repeats a name, RecursionError if deep."""
    return json.loads(text, object_pairs_hook=_dict_of_unique_keys)


def _dict_of_unique_keys(pairs: list[tuple[str, object]]) -> dict[str, object]:
    value_by_name: dict[str, object] = {}
    for name, value in pairs:
        if name in value_by_name:
            raise ValueError(f"`{name[:40]}` is given twice")
        value_by_name[name] = value
    return value_by_name


NAMED = ("python", "c")
"""Kinds of bindings that name something inside the file."""
NO_STATISTICS = "none"
"""Written in place of a statistics file: none is used, whatever lies beside the policy."""
POLICIES = ("onnx", "sb3")
"""Kinds of files that hold a learned policy."""
CLIP = "clip"
OF_ONNX = re.compile(rf"({CLIP}|[^=,]+=[^=,]+)(,[^=,]+=[^=,]+)*(,{CLIP})?")
"""What may follow an ONNX file: `clip` limits answers; `input=output` is a pair to remember."""
FORMS = {
    "python": "python:file.py:name",
    "c": "c:file.c:name",
    "onnx": "onnx:file.onnx",
    "sb3": "sb3:file.zip",
}


class BindingText(NamedTuple):
    """The parts of the text of a binding: its kind, its file, and the function in the file.

    For a policy, `name` is its statistics file, the outputs that it remembers, or "".
    """

    kind: str
    file: str
    name: str

    @property
    def is_policy(self) -> bool:
        """Whether a file with a learned policy answers for the extern."""
        return self.kind in POLICIES

    @property
    def in_python(self) -> bool:
        """Whether Python answers for the extern. Only linked C does not."""
        return self.kind != "c"

    @property
    def files(self) -> tuple[str, ...]:
        """Gives all files that the binding names."""
        return (self.file, self.name) if self.statistics else (self.file,)

    @property
    def statistics(self) -> str:
        """Gives the name of a policy's statistics file; "" if none is named."""
        named = self.kind == "sb3" and self.name != NO_STATISTICS
        return self.name if named else ""

    @property
    def remembered(self) -> str:
        """Gives the pairs `input=output` by which an ONNX policy remembers outputs; "" if none."""
        return ",".join(part for part in self.name.split(",") if part != CLIP)

    @property
    def is_clipped(self) -> bool:
        """Whether an ONNX file's answer is limited to the sets of its topics."""
        return self.kind == "onnx" and CLIP in self.name.split(",")

    def in_folder(self, folder: Path) -> BindingText:
        """Gives the same binding with its files in `folder`."""
        name = str(folder / self.name) if self.statistics else self.name
        return BindingText(self.kind, str(folder / self.file), name)

    def __str__(self) -> str:
        return ":".join(self if self.name else self[:2])


def binding_of(text: str | None) -> BindingText | None:
    """Gives the parts of the text of a binding; None if the text is no binding."""
    parts = (text or "").split(":")
    if not all(parts) or parts[0] not in FORMS:
        return None
    name = parts[2] if len(parts) > 2 else ""
    if parts[0] == "onnx" and name and not OF_ONNX.fullmatch(name):
        return None
    least = 3 if parts[0] in NAMED else 2
    return BindingText(parts[0], parts[1], name) if (least <= len(parts) <= 3) else None


def is_answered_by_python(text: str | None) -> bool:
    """Whether a text is a binding by which Python answers: any binding but linked C."""
    binding = binding_of(text)
    return binding is not None and binding.in_python
