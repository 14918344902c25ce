"""The parts of what Stable-Baselines3 saved: settings, tensors, spaces, statistics of observations.

Purpose: bytes become plain values and arrays of NumPy, without torch; nothing is unpickled.
`Observed` does as `preprocess_obs` of Stable-Baselines3: numbers stay, a choice among n becomes n
numbers of which one is 1, and observations by name stand one after the other. `normalised` reads
`vecnormalize.pkl` (`env.save`) as it was named, or as it lies where people leave it, and puts it in
front of a network; it says what it found without being asked for.
Non-goals: what the parts mean together (`sb3_file.py`); images; rewards.
"""

from __future__ import annotations

import base64
import binascii
import io
import json
import math
import re
import zipfile
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from soter.language.load.named_files import NO_STATISTICS
from soter.policy.network import OneHot, Policy, Standardised, numbers_text
from soter.policy.pickle_data import Made, Name, Persistent, PickleError, read_array, read_pickle
from soter.policy.policy_errors import FILE_MAX, bad_policy, read_policy_bytes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    import numpy.typing as npt

    from soter.policy.network import Doubles, Floats, Layer


PART_MAX, PARTS_MAX = 64 * 2**20, 10_000
"""Bytes of one part of the file, unpacked, and how many parts, at most."""


def open_zip(path: Path, data: bytes, otherwise: str) -> zipfile.ZipFile:
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
    """The settings of the policy, from its JSON, by name; X014 where there is none."""
    try:
        data = json.loads(part(path, parts, "data"))
    except (ValueError, RecursionError) as error:
        raise bad_policy(path, f"its part `data` is no JSON: {error}") from error
    if not isinstance(data, dict):
        raise bad_policy(path, "its part `data` is no JSON object")
    return data


def version(parts: zipfile.ZipFile) -> str:
    """The version of the library that saved it."""
    try:
        with parts.open("_stable_baselines3_version") as stream:
            text = stream.read(20).decode("ascii", "replace").strip()
    except Exception:  # noqa: BLE001 - it is missing or damaged, and only shown
        return "of an unknown version"
    return text if text.replace(".", "").isalnum() else "of an unknown version"


def decode_value(path: Path, value: object) -> Any:  # noqa: ANN401 - whatever it holds
    """A value of `data`, from JSON or from its pickle; SoterError X014, PickleError."""
    if not isinstance(value, dict) or ":serialized:" not in value:
        return value
    try:
        return read_pickle(base64.b64decode(str(value[":serialized:"]), validate=True))
    except binascii.Error as error:
        raise bad_policy(path, f"a value of its part `data` is no base64: {error}") from error


def truth(path: Path, data: Mapping[str, Any], name: str, *, default: bool | None = None) -> bool:
    """A setting that is True or False; X014 of anything else, which Python may take as either."""
    value = data.get(name, default)
    if not isinstance(value, bool):
        raise bad_policy(path, f"its `{name}` is neither True nor False", EXPORT)
    return value


# ---------------------------------------------------------------- torch's file of tensors


def tensors(path: Path, data: bytes) -> dict[str, Floats]:
    """The float32 tensors of a `state_dict` that `torch.save` wrote, by name, each in its shape.

    SoterError X014.
    """
    with open_zip(path, data, "its part `policy.pth` is no zip of `torch.save`") as parts:
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
    """Whether it is a tensor of whole numbers, which counts something and holds no weights."""
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


NUMBERS_MAX, NAME_MAX = 1_000_000, 80
EXPORT = "export it as ONNX: `soter explain X014` has the lines"


class ObservationLayout(NamedTuple):
    """What a policy observes.

    `sizes`: for each number, among how many it chooses, 0 where it is taken as it is. `box`: the
    least and the largest numbers, where finite. `keys`: names of observations with their counts.
    `shapes`: of each that is a Box its axes, by name, "" of a single one.
    """

    sizes: tuple[int, ...]
    shown: str
    box: tuple[Doubles, Doubles] | None = None
    keys: tuple[tuple[str, int], ...] = ()
    shapes: Mapping[str, tuple[int, ...]] = {}

    @property
    def layers(self) -> list[Layer]:
        """The layers that prepare an observation for the network."""
        return [OneHot(self.sizes)] if any(self.sizes) else []


def space_kind(space: Made) -> str:
    """The name of a space's class."""
    return space.name.rpartition(".")[2]


def require_space(path: Path, space: object, which: str, kinds: Mapping[str, object]) -> Made:
    """The space, which has to be of one of these kinds; SoterError X014."""
    if not isinstance(space, Made) or not isinstance(space.state, dict):
        raise bad_policy(path, f"it does not say its {which}")
    if space_kind(space) not in kinds:
        why = f"its {which} is a `{space_kind(space)[:40]}`"
        raise bad_policy(path, why, f"what can be read: {', '.join(kinds)}")
    return space


def read_observation(path: Path, space: object) -> ObservationLayout:
    """Reads what a policy observes from its space; SoterError X014 for any other space."""
    made = require_space(path, space, "observation space", OBSERVED)
    return OBSERVED[space_kind(made)](path, made)


def _box(path: Path, space: Made) -> ObservationLayout:
    shape = space_shape(path, space)
    low, high = bounds(path, space)
    if len(shape) == 3 and low.dtype == np.uint8:
        raise bad_policy(path, f"its observations are images of shape {shape}", EXPORT)
    if low.size != math.prod(shape):
        raise bad_policy(path, "the bounds of a Box are not one for each number")
    ends = low.astype(np.float64), high.astype(np.float64)
    hull = None
    if all(np.isfinite(end).all() for end in ends):
        # of stacked frames the space's bounds stand in another order
        hull = np.full(low.size, ends[0].min()), np.full(low.size, ends[1].max())
    return ObservationLayout((0,) * low.size, space_text(path, space), hull, shapes={"": shape})


def space_shape(path: Path, space: Made) -> tuple[int, ...]:
    """The axes of a Box; SoterError X014."""
    shape = space.state.get("_shape")
    if not isinstance(shape, tuple) or not all(isinstance(n, int) and n > 0 for n in shape):
        raise bad_policy(path, f"a Box of it has the shape {shape!r:.60}")
    return shape


def _box_observation(path: Path, space: Made) -> ObservationLayout:
    sizes = choice_counts(path, space)
    low, high = np.zeros(len(sizes)), np.array(sizes, np.float64) - 1.0
    return ObservationLayout(sizes, space_text(path, space), (low, high))


def _bits(path: Path, space: Made) -> ObservationLayout:
    count, n = bits(path, space), space.state.get("n")
    shapes = {"": n} if isinstance(n, tuple) and len(n) > 1 else {}
    box = np.zeros(count), np.ones(count)
    return ObservationLayout((0,) * count, space_text(path, space), box, shapes=shapes)


def _dict_observation(path: Path, space: Made) -> ObservationLayout:
    kept = space.state.get("spaces")
    inner = kept.items if isinstance(kept, Made) else kept  # an OrderedDict is made
    if not isinstance(inner, dict) or not inner:
        raise bad_policy(path, "its observations by name have no names")
    parts = {name: read_observation(path, part) for name, part in inner.items()}
    if not all(name.isprintable() and len(name) <= NAME_MAX for name in inner):
        raise bad_policy(path, "a name of its observations is no name")
    if sum(len(part.sizes) for part in parts.values()) > NUMBERS_MAX:
        raise bad_policy(path, "it observes more numbers than are read")
    if nested := [name for name, part in parts.items() if part.keys]:
        raise bad_policy(path, f"its observation `{nested[0][:40]}` is by name again", EXPORT)
    return ObservationLayout(
        tuple(size for part in parts.values() for size in part.sizes),
        ", ".join(f"`{name}` {part.shown}" for name, part in parts.items()),
        _together([part.box for part in parts.values()]),
        tuple((name, len(part.sizes)) for name, part in parts.items()),
        {name: part.shapes[""] for name, part in parts.items() if part.shapes},
    )


def _together(boxes: list[tuple[Doubles, Doubles] | None]) -> tuple[Doubles, Doubles] | None:
    """The bounds of all numbers as one pair of arrays; None if a number is unbounded."""
    known = [box for box in boxes if box is not None]
    if len(known) < len(boxes):
        return None
    low, high = (np.concatenate(ends) for ends in zip(*known, strict=True))
    return low, high


OBSERVED = {
    "Box": _box,
    "Discrete": _box_observation,
    "MultiDiscrete": _box_observation,
    "MultiBinary": _bits,
    "Dict": _dict_observation,
}


def bounds(path: Path, space: Made) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """The least and the largest of each number, (n,), of a Box; SoterError X014."""
    low, high = (read_array(space.state.get(k)).reshape(-1) for k in ("low", "high"))
    if low.shape != high.shape or not low.size:
        raise bad_policy(path, "the bounds of a Box are not one for each number")
    return low, high


def choice_counts(path: Path, space: Made) -> tuple[int, ...]:
    """The numbers of choices of a Discrete or a MultiDiscrete, from 0 on; SoterError X014.

    X014, too, where they begin at another number.
    """
    if space_kind(space) == "Discrete":
        sizes, starts = [whole(space, "n")], [whole(space, "start", 0)]
    else:
        start = space.state.get("start")
        sizes = read_array(space.state.get("nvec")).reshape(-1).tolist()
        starts = [] if start is None else read_array(start).reshape(-1).tolist()
    if not all(isinstance(n, int) and n > 0 for n in sizes) or sum(sizes) > NUMBERS_MAX:
        raise bad_policy(path, "it does not say how many there are to choose from")
    if any(starts):
        raise bad_policy(path, "what it chooses from does not begin at 0", EXPORT)
    return tuple(sizes)


def bits(path: Path, space: Made) -> int:
    """How many bits a MultiBinary has; SoterError X014."""
    n = space.state.get("n")
    sizes = n if isinstance(n, tuple) else (whole(space, "n"),)
    count = math.prod(x if isinstance(x, int) and x > 0 else 0 for x in sizes)
    if not 0 < count <= NUMBERS_MAX // 100:
        raise bad_policy(path, "it does not say how many bits it has, or too many")
    return count


def whole(space: Made, which: str, default: int = -1) -> int:
    """An int of a Discrete: Python's in older files, NumPy's in newer ones."""
    value = space.state.get(which, default)
    if isinstance(value, Made):
        numbers = read_array(value)
        value = int(numbers) if numbers.ndim == 0 and numbers.dtype.kind == "i" else default
    return value if isinstance(value, int) else default


def space_text(path: Path, space: Made) -> str:
    """A space in a few words."""
    kind = space_kind(space)
    if kind == "MultiBinary":
        return f"MultiBinary({bits(path, space)})"
    if kind != "Box":
        return f"{kind}({', '.join(map(str, choice_counts(path, space)))})"
    low, high = bounds(path, space)
    return f"Box of {low.size}: {', '.join(_intervals(low, high))}"


def _intervals(low: npt.NDArray[Any], high: npt.NDArray[Any]) -> Iterator[str]:
    for a, b in zip(low[:8], high[:8], strict=True):
        yield f"[{a:g}, {b:g}]"
    if low.size > 8:
        yield "..."


OWN = ("{0}_vecnormalize.pkl", "{0}_vec_normalize.pkl", "{0}/vecnormalize.pkl")
"""Names of the file with the statistics of one policy, `{0}.zip`; the last is RL Zoo's."""
OF_FOLDER = ("vecnormalize.pkl", "vec_normalize.pkl")
CHECKPOINT = re.compile(r"(.+)_(\d+_steps)")
"""What `CheckpointCallback` calls a policy; its statistics are `NAME_vecnormalize_N_steps.pkl`."""


def statistics_beside(path: Path) -> Path | None:
    """The statistics that lie beside a policy; SoterError X014 where two may be meant."""
    names = [name.format(path.stem) for name in OWN]
    if saved := CHECKPOINT.fullmatch(path.stem):
        names.append(f"{saved[1]}_vecnormalize_{saved[2]}.pkl")
    for group in (names, OF_FOLDER):
        files = [at for name in group if (at := path.parent / name).is_file()]
        if len(files) > 1:
            why = f"`{files[0].name}` and `{files[1].name}` lie beside it"
            raise bad_policy(path, why, *_ways(path, files[0]))
        if files:
            return files[0]
    return None


def _ways(path: Path, statistics: Path) -> tuple[str, ...]:
    """Help lines: how to name the statistics that are meant."""
    named = statistics.name if statistics.parent == path.parent else statistics
    return (
        f'name them: "sb3:{path.name}:{named}", or `--statistics` of `soter policy`',
        f'or say that there are none: "sb3:{path.name}:{NO_STATISTICS}"',
    )


def with_statistics(policy: Policy, named: Path | None) -> Policy:
    """The policy with its statistics in front of it, or with what is assumed without them.

    SoterError X003, X014.
    """
    path = Path(policy.path)
    facts = dict(policy.facts)
    if named is not None and named.name == NO_STATISTICS:
        facts["normalised"] = "not, as was said"
        return replace(policy, facts=facts)
    found = None if named is not None else statistics_beside(path)
    statistics = named or found
    if statistics is None:
        assumed = "observations are not normalised: no file of a VecNormalize is named or beside it"
        return replace(policy, assumed=(*policy.assumed, assumed))
    try:
        made = _before(policy, statistics, facts)
    except (PickleError, RecursionError) as error:
        raise bad_policy(statistics, str(error)) from error
    if found is None:
        return made
    assumed = f"observations are normalised by `{found.relative_to(path.parent)}`, found beside it"
    return replace(made, assumed=(*made.assumed, assumed), beside=found)


def _before(policy: Policy, statistics: Path, facts: dict[str, str]) -> Policy:
    """The policy with a layer of its statistics in front."""
    state = _state(statistics)
    if not truth(statistics, state, "norm_obs"):
        facts["normalised"] = f"`{statistics.name}` says that observations are not (norm_obs)"
        return replace(policy, facts=facts)
    layer = _statistics(statistics, state, policy.keys)
    size, inputs = layer.mean.size, policy.network.inputs
    facts["normalised"] = f"by `{statistics.name}`, clipped to {layer.limit.min():g}"
    if size == inputs:
        layers = (layer, *policy.network.layers)
        return replace(policy, network=replace(policy.network, layers=layers), facts=facts)
    if size and inputs % size == 0 and not policy.keys:
        facts["normalised"] += f", each of {inputs // size} frames before they are stacked"
        return replace(policy, facts=facts, per_frame=layer)
    why = f"it is of {numbers_text(size)}, the policy takes {inputs}"
    raise bad_policy(statistics, why, *_ways(Path(policy.path), statistics)[1:])


def _state(path: Path) -> dict[str, Any]:
    """What a VecNormalize keeps."""
    made = read_pickle(read_policy_bytes(path))
    known = isinstance(made, Made) and made.name.partition(".")[0] == "stable_baselines3"
    state = made.state if known and made.name.endswith(".VecNormalize") else None
    if not isinstance(state, dict):
        raise bad_policy(path, "it is no VecNormalize that `env.save` wrote")
    return state


def _statistics(
    path: Path, state: dict[str, Any], keys: tuple[tuple[str, int], ...]
) -> Standardised:
    """The layer that does what it does to observations, by name in the order of the policy."""
    epsilon, limit = state.get("epsilon"), state.get("clip_obs")
    if not (isinstance(epsilon, (int, float)) and isinstance(limit, (int, float)) and limit > 0):
        raise bad_policy(path, "its `epsilon` and `clip_obs` are no positive numbers")
    of = state.get("obs_rms")
    by_name = {"": of} if isinstance(of, Made) else of
    if not isinstance(by_name, dict) or (isinstance(of, Made) and keys):
        raise bad_policy(path, "it has no mean and variance of what the policy observes")
    counts = dict(keys) if keys else {"": -1}
    if unknown := sorted(set(by_name) - set(counts)):
        raise bad_policy(path, f"it is of `{unknown[0][:40]}`, which the policy does not observe")
    blocks = [
        _block(path, by_name.get(key), count, epsilon, limit) for key, count in counts.items()
    ]
    return Standardised(*(np.concatenate(column) for column in zip(*blocks, strict=True)))


def _block(
    path: Path, moments: object, count: int, epsilon: float, limit: float
) -> tuple[Doubles, Doubles, Doubles]:
    """Mean, deviation and limit, (n,) each, of one observation; without moments it stays as is."""
    if moments is None:
        return np.zeros(count), np.ones(count), np.full(count, np.inf)
    if not isinstance(moments, Made) or not isinstance(moments.state, dict):
        raise bad_policy(path, "its statistics have no mean and variance")
    mean, variance = (read_array(moments.state.get(k)) for k in ("mean", "var"))
    if mean.shape != variance.shape or {mean.dtype, variance.dtype} != {np.dtype(np.float64)}:
        raise bad_policy(path, "its mean and variance are no lists of float64 of one length")
    if count not in (-1, mean.size):
        raise bad_policy(path, f"it is of {numbers_text(mean.size)}, the policy takes {count}")
    mean, shifted = mean.reshape(-1), variance.reshape(-1) + epsilon
    if not (np.isfinite(mean).all() and np.isfinite(shifted).all() and (shifted > 0.0).all()):
        raise bad_policy(path, "its mean and variance are not finite, or a variance is negative")
    return mean, np.sqrt(shifted), np.full(mean.size, float(limit))
