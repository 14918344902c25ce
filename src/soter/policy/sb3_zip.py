"""Opens a file that Stable-Baselines3 saved, part by part.

Purpose: parts of a zip as bytes within bounds, settings as plain values; nothing is unpickled.
Non-goals: tensors, spaces and statistics (`sb3_tensors.py`, `sb3_spaces.py`, `sb3_statistics.py`);
what the parts mean together (`sb3_file.py`).
"""

from __future__ import annotations

import base64
import binascii
import io
import json
import zipfile
from typing import TYPE_CHECKING, Any

from soter.policy.pickle_data import read_pickle
from soter.policy.policy_errors import FILE_MAX, bad_policy_error

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


PART_MAX, PARTS_MAX = 64 * 2**20, 10_000
"""Bytes of one part of the file, unpacked, and how many parts, at most."""
EXPORT = "export it as ONNX: `soter explain X014` has the lines"


def open_zip(path: Path, data: bytes, otherwise: str) -> zipfile.ZipFile:
    """Opens the zip in these bytes; raises X014 with the text `otherwise` if they are no zip."""
    if data.count(b"PK\1\2") > PARTS_MAX:
        raise bad_policy_error(path, f"it has more than {PARTS_MAX:,} parts")
    try:
        parts = zipfile.ZipFile(io.BytesIO(data))
    except Exception as error:
        raise bad_policy_error(path, otherwise) from error
    if sum(info.file_size for info in parts.infolist()) > FILE_MAX:
        raise bad_policy_error(path, f"unpacked it is larger than {FILE_MAX >> 20} MiB")
    return parts


def zip_part(path: Path, parts: zipfile.ZipFile, name: str) -> bytes:
    """A part of the zip, unpacked; raises X014 if it is missing, damaged or too large."""
    try:
        with parts.open(name) as stream:
            data = stream.read(PART_MAX + 1)
    except KeyError:
        raise bad_policy_error(
            path, f"it has no part `{name}`: it is none of `model.save`"
        ) from None
    except Exception as error:
        raise bad_policy_error(path, f"its part `{name}` is damaged: {error}") from error
    if len(data) > PART_MAX:
        raise bad_policy_error(path, f"its part `{name}` is larger than {PART_MAX >> 20} MiB")
    return data


def settings(path: Path, parts: zipfile.ZipFile) -> dict[str, Any]:
    """The settings of the policy by name, from its JSON; raises X014 if it has none."""
    try:
        data = json.loads(zip_part(path, parts, "data"))
    except (ValueError, RecursionError) as error:
        raise bad_policy_error(path, f"its part `data` is no JSON: {error}") from error
    if not isinstance(data, dict):
        raise bad_policy_error(path, "its part `data` is no JSON object")
    return data


def version(parts: zipfile.ZipFile) -> str:
    """The version of Stable-Baselines3 that wrote the file."""
    try:
        with parts.open("_stable_baselines3_version") as stream:
            text = stream.read(20).decode("ascii", "replace").strip()
    except Exception:  # noqa: BLE001 - it is missing or damaged, and only shown
        return "of an unknown version"
    return text if text.replace(".", "").isalnum() else "of an unknown version"


def decode_value(path: Path, value: object) -> Any:  # noqa: ANN401 - whatever it holds
    """A value of the settings, from JSON or its pickle; raises SoterError X014, PickleError."""
    if not isinstance(value, dict) or ":serialized:" not in value:
        return value
    try:
        return read_pickle(base64.b64decode(str(value[":serialized:"]), validate=True))
    except binascii.Error as error:
        raise bad_policy_error(path, f"a value of its part `data` is no base64: {error}") from error


def flag(path: Path, data: Mapping[str, Any], name: str, *, default: bool | None = None) -> bool:
    """The value of a setting that is True or False; raises X014 for any other value."""
    value = data.get(name, default)
    if not isinstance(value, bool):
        raise bad_policy_error(path, f"its `{name}` is neither True nor False", EXPORT)
    return value
