"""Reads the tensors that `torch.save` wrote, without torch.

Purpose: `policy.pth` of a file of Stable-Baselines3 becomes arrays of NumPy by name; nothing is
unpickled.
Non-goals: which layer a tensor belongs to (`sb3_file.py`).
"""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from soter.policy.pickle_data import Made, Name, Persistent, read_pickle
from soter.policy.policy_errors import bad_policy_error
from soter.policy.sb3_zip import open_zip, zip_part

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.policy.network import Floats


def read_tensors(path: Path, data: bytes) -> dict[str, Floats]:
    """The float32 tensors that `torch.save` wrote, by name, each in its shape; raises X014."""
    with open_zip(path, data, "its part `policy.pth` is no zip of `torch.save`") as parts:
        names = [n for n in parts.namelist() if n.endswith("/data.pkl")]
        if len(names) != 1:
            raise bad_policy_error(path, "its part `policy.pth` is no file of `torch.save`")
        folder = names[0].removesuffix("data.pkl")
        order = f"{folder}byteorder"
        if order in parts.namelist() and zip_part(path, parts, order) != b"little":
            raise bad_policy_error(path, "its tensors are big-endian, which are not read here")
        state = read_pickle(zip_part(path, parts, names[0]))
        if not isinstance(state, Made):
            raise bad_policy_error(path, "its part `policy.pth` holds no tensors by name")
        read = cache(partial(zip_part, path, parts))  # of one part there may be many tensors
        return {
            name: _read_tensor(path, read, folder, made)
            for name, made in state.items.items()
            if isinstance(made, Made) and not _is_counter(made)
        }


def _is_counter(made: Made) -> bool:
    """Whether a tensor holds ints, and so is a counter and no weight."""
    storage = made.arguments[0] if made.arguments else None
    about = storage.about if isinstance(storage, Persistent) else ()
    kind = about[1] if isinstance(about, tuple) and len(about) > 1 else None
    return isinstance(kind, Name) and kind.text == "torch.LongStorage"


def _read_tensor(path: Path, read: Callable[[str], bytes], folder: str, made: Made) -> Floats:
    try:
        storage, offset, size, stride = made.arguments[:4]
        assert isinstance(storage, Persistent)
        _, kind, key = storage.about[:3]
        text = kind.text if isinstance(kind, Name) else ""
        if made.name != "torch._utils._rebuild_tensor_v2" or text != "torch.FloatStorage":
            raise bad_policy_error(
                path, f"a tensor is a `{(text or made.name)[:60]}`: float32 is read"
            )
        flat = np.frombuffer(read(f"{folder}data/{key}"), "<f4")
        count = int(np.prod(size, dtype=np.int64))
        row_by_row = [int(np.prod(size[i + 1 :], dtype=np.int64)) for i in range(len(size))]
        if list(stride) != row_by_row or offset < 0 or offset + count > flat.size:
            raise bad_policy_error(path, "a tensor does not lie in its part row by row")
        tensor: Floats = flat[offset : offset + count].reshape(size)
    except (AssertionError, AttributeError, TypeError, ValueError, OverflowError) as error:
        raise bad_policy_error(path, "its part `policy.pth` holds what is no tensor") from error
    return tensor
