"""The parts of a zip that Stable-Baselines3 saved: settings as JSON, tensors as torch wrote them.

Purpose: bytes become plain values and arrays of NumPy, without torch; nothing is unpickled.
Non-goals: what they mean (`sb3_file.py`).
"""

from __future__ import annotations

import base64
import binascii
import io
import json
import zipfile
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.policy.pickle_data import Made, Name, Persistent, read_pickle
from soter.policy.policy_errors import FILE_MAX, bad_policy

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.policy.network import Floats

PART_MAX, PARTS_MAX = 64 * 2**20, 10_000
"""Bytes of a part of the file, unpacked."""


def opened(path: Path, data: bytes, otherwise: str) -> zipfile.ZipFile:
    """The parts of a zip; X014 in the words of `otherwise` where Python reads none."""
    if data.count(b"PK\1\2") > PARTS_MAX:
        raise bad_policy(path, f"it has more than {PARTS_MAX:,} parts")
    try:
        parts = zipfile.ZipFile(io.BytesIO(data))
    except Exception as error:
        raise bad_policy(path, otherwise) from error
    if sum(info.file_size for info in parts.infolist()) > FILE_MAX:
        raise bad_policy(path, f"unpacked it is larger than {FILE_MAX >> 20} MiB")
    return parts


def part(path: Path, parts: zipfile.ZipFile, name: str) -> bytes:
    """A part, unpacked; X014 where it is missing, damaged or larger than is read."""
    try:
        with parts.open(name) as stream:
            data = stream.read(PART_MAX + 1)
    except KeyError:
        raise bad_policy(path, f"it has no part `{name}`: it is none of `model.save`") from None
    except Exception as error:
        raise bad_policy(path, f"its part `{name}` is damaged: {error}") from error
    if len(data) > PART_MAX:
        raise bad_policy(path, f"its part `{name}` is larger than {PART_MAX >> 20} MiB")
    return data


def settings(path: Path, parts: zipfile.ZipFile) -> dict[str, Any]:
    """What its JSON says by name; X014 where there is none."""
    try:
        said = json.loads(part(path, parts, "data"))
    except (ValueError, RecursionError) as error:
        raise bad_policy(path, f"its part `data` is no JSON: {error}") from error
    if not isinstance(said, dict):
        raise bad_policy(path, "its part `data` is no JSON object")
    return said


def version(parts: zipfile.ZipFile) -> str:
    """Of the library that saved it."""
    try:
        with parts.open("_stable_baselines3_version") as stream:
            text = stream.read(20).decode("ascii", "replace").strip()
    except Exception:  # noqa: BLE001 - it is missing or damaged, and only told
        return "of an unknown version"
    return text if text.replace(".", "").isalnum() else "of an unknown version"


def decoded(path: Path, value: object) -> Any:  # noqa: ANN401 - whatever it holds
    """A value of `data`: as JSON has it, or as its pickle says; SoterError X014, PickleError."""
    if not isinstance(value, dict) or ":serialized:" not in value:
        return value
    try:
        return read_pickle(base64.b64decode(str(value[":serialized:"]), validate=True))
    except binascii.Error as error:
        raise bad_policy(path, f"a value of its part `data` is no base64: {error}") from error


# ---------------------------------------------------------------- torch's file of tensors


def tensors(path: Path, data: bytes) -> dict[str, Floats]:
    """The float32 tensors of a `state_dict` that `torch.save` wrote, by name, each in its shape.

    SoterError X014.
    """
    with opened(path, data, "its part `policy.pth` is no zip of `torch.save`") as parts:
        names = [n for n in parts.namelist() if n.endswith("/data.pkl")]
        if len(names) != 1:
            raise bad_policy(path, "its part `policy.pth` is no file of `torch.save`")
        folder = names[0].removesuffix("data.pkl")
        order = f"{folder}byteorder"
        if order in parts.namelist() and part(path, parts, order) != b"little":
            raise bad_policy(path, "its tensors are big-endian, which are not read here")
        state = read_pickle(part(path, parts, names[0]))
        if not isinstance(state, Made):
            raise bad_policy(path, "its part `policy.pth` holds no tensors by name")
        read = cache(partial(part, path, parts))  # of one part there may be many tensors
        return {
            name: _tensor(path, read, folder, made)
            for name, made in state.items.items()
            if isinstance(made, Made) and not _counts(made)
        }


def _counts(made: Made) -> bool:
    """Whether it is a tensor of whole numbers: how often something was done, no weights."""
    storage = made.arguments[0] if made.arguments else None
    about = storage.about if isinstance(storage, Persistent) else ()
    kind = about[1] if isinstance(about, tuple) and len(about) > 1 else None
    return isinstance(kind, Name) and kind.text == "torch.LongStorage"


def _tensor(path: Path, read: Callable[[str], bytes], folder: str, made: Made) -> Floats:
    """The numbers of one tensor."""
    try:
        storage, offset, size, stride = made.arguments[:4]
        assert isinstance(storage, Persistent)
        _, kind, key = storage.about[:3]
        text = kind.text if isinstance(kind, Name) else ""
        if made.name != "torch._utils._rebuild_tensor_v2" or text != "torch.FloatStorage":
            raise bad_policy(path, f"a tensor is a `{(text or made.name)[:60]}`: float32 is read")
        flat = np.frombuffer(read(f"{folder}data/{key}"), "<f4")
        count = int(np.prod(size, dtype=np.int64))
        whole = [int(np.prod(size[i + 1 :], dtype=np.int64)) for i in range(len(size))]
        if list(stride) != whole or offset < 0 or offset + count > flat.size:
            raise bad_policy(path, "a tensor does not lie in its part row by row")
        tensor: Floats = flat[offset : offset + count].reshape(size)
    except (AssertionError, AttributeError, TypeError, ValueError, OverflowError) as error:
        raise bad_policy(path, "its part `policy.pth` holds what is no tensor") from error
    return tensor
