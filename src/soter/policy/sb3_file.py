"""A policy that Stable-Baselines3 saved, and the statistics of a VecNormalize, without torch.

Purpose: `policy.zip` (`model.save`) and `vecnormalize.pkl` (`env.save`) become a `Policy`: the
network that `predict(deterministic=True)` is, what the files say of observations and actions, and
what they do not say. Nothing of them is unpickled.
Non-goals: images, dicts, memory, policies of classes that Stable-Baselines3 does not have; what
was trained with `use_sde` and a squashed output.
"""

from __future__ import annotations

import base64
import binascii
import io
import json
import zipfile
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from soter.policy.network import (
    Affine,
    Clipped,
    Elementwise,
    Layer,
    Network,
    Policy,
    Relu,
    Standardised,
    Tanh,
    in_numbers,
    problem_of,
)
from soter.policy.pickle_data import Made, Name, Persistent, PickleError, array_of, read_pickle
from soter.policy.policy_errors import FILE_MAX, bad_policy, content_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    import numpy.typing as npt

    from soter.policy.network import Doubles, Floats

PART_MAX, PARTS_MAX = 64 * 2**20, 10_000
"""Bytes of a part of the file, unpacked."""
ACTIVATIONS: dict[str, Layer] = {
    "torch.nn.modules.activation.Tanh": Tanh(),
    "torch.nn.modules.activation.ReLU": Relu(),
}


class _Kind(NamedTuple):
    """How a class of policies keeps the network that `predict` asks."""

    algorithms: str
    hidden: str
    """What the names of its hidden layers begin with."""
    last: str
    """Name of the last layer; "" where it is the last of the hidden ones."""
    activation: Layer
    """Where the file does not say another."""
    squashed: bool
    """Whether tanh and the bounds of the actions follow."""
    choice: bool = False


KINDS = {
    "stable_baselines3.common.policies.ActorCriticPolicy": _Kind(
        "PPO, A2C", "mlp_extractor.policy_net.", "action_net", Tanh(), squashed=False
    ),
    "stable_baselines3.sac.policies.SACPolicy": _Kind(
        "SAC", "actor.latent_pi.", "actor.mu", Relu(), squashed=True
    ),
    "stable_baselines3.td3.policies.TD3Policy": _Kind(
        "TD3, DDPG", "actor.mu.", "", Relu(), squashed=True
    ),
    "stable_baselines3.dqn.policies.DQNPolicy": _Kind(
        "DQN", "q_net.q_net.", "", Relu(), squashed=False, choice=True
    ),
}
IGNORED = frozenset(
    {"net_arch", "activation_fn", "use_sde", "ortho_init", "log_std_init", "full_std", "n_critics"}
    | {"use_expln", "optimizer_class", "optimizer_kwargs", "normalize_images"}
    | {"share_features_extractor"}
)
"""Words of `policy_kwargs` that change nothing of what is asked, or are read elsewhere."""


def read_sb3(path: Path, statistics: Path | None = None) -> Policy:
    """The policy of a file; `statistics`: that of its VecNormalize. SoterError X003, X014."""
    no_zip = "it is no zip, which is what Stable-Baselines3's `model.save` writes"
    try:
        with _opened(path, content_of(path), no_zip) as parts:
            policy = _policy(path, parts)
    except (PickleError, RecursionError) as error:
        raise bad_policy(path, str(error)) from error
    return _normalised(policy, statistics)


def _policy(path: Path, parts: zipfile.ZipFile) -> Policy:
    said = _settings(path, parts)
    kind, name = _kind(path, said)
    observations = _space(path, said, "observation_space")
    actions = _space(path, said, "action_space")
    tensors = _tensors(path, _part(path, parts, "policy.pth"))
    inputs = _inputs(path, observations)
    options = _decoded(path, said.get("policy_kwargs"))
    activation = _activation(path, kind, options)
    layers: list[Layer] = []
    for layer in _linear_layers(path, kind, tensors):
        layers += [*([activation] if layers else []), layer]
    choice = actions.name.endswith(".Discrete")
    layers += _ending(path, kind, actions, choice=choice)
    network = Network(inputs, tuple(layers), choice)
    _require_fit(path, network, actions)
    version = _version(parts)
    return Policy(
        str(path),
        network,
        {
            "file": f"Stable-Baselines3 {version}, {name.rpartition('.')[2]} ({kind.algorithms})",
            "observation": _shown(path, observations),
            "action": _shown(path, actions),
            "answer": _ended(kind, choice=choice),
        },
        box=_box(path, observations),
    )


# ---------------------------------------------------------------- the parts of the file


def _opened(path: Path, data: bytes, otherwise: str) -> zipfile.ZipFile:
    """The parts of a zip; X014 in the words of `otherwise` where Python reads none."""
    if data.count(b"PK\1\2") > PARTS_MAX:
        raise bad_policy(path, f"it has more than {PARTS_MAX:,} parts")
    try:
        opened = zipfile.ZipFile(io.BytesIO(data))
    except Exception as error:
        raise bad_policy(path, otherwise) from error
    if sum(part.file_size for part in opened.infolist()) > FILE_MAX:
        raise bad_policy(path, f"unpacked it is larger than {FILE_MAX >> 20} MiB")
    return opened


def _part(path: Path, parts: zipfile.ZipFile, name: str) -> bytes:
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


def _settings(path: Path, parts: zipfile.ZipFile) -> dict[str, Any]:
    try:
        said = json.loads(_part(path, parts, "data"))
    except (ValueError, RecursionError) as error:
        raise bad_policy(path, f"its part `data` is no JSON: {error}") from error
    if not isinstance(said, dict):
        raise bad_policy(path, "its part `data` is no JSON object")
    return said


def _version(parts: zipfile.ZipFile) -> str:
    try:
        with parts.open("_stable_baselines3_version") as stream:
            text = stream.read(20).decode("ascii", "replace").strip()
    except Exception:  # noqa: BLE001 - it is missing or damaged, and only told
        return "of an unknown version"
    return text if text.replace(".", "").isalnum() else "of an unknown version"


def _decoded(path: Path, value: object) -> Any:  # noqa: ANN401 - whatever it holds
    """A value of `data`: as JSON has it, or as its pickle says."""
    if not isinstance(value, dict) or ":serialized:" not in value:
        return value
    try:
        return read_pickle(base64.b64decode(str(value[":serialized:"]), validate=True))
    except binascii.Error as error:
        raise bad_policy(path, f"a value of its part `data` is no base64: {error}") from error


def _kind(path: Path, said: Mapping[str, Any]) -> tuple[_Kind, str]:
    value = _decoded(path, said.get("policy_class"))
    name = value.text if isinstance(value, Name) else "of its own"
    if name not in KINDS:
        known = ", ".join(f"{k.rpartition('.')[2]} ({v.algorithms})" for k, v in KINDS.items())
        raise bad_policy(path, f"its policy class is `{name[:80]}`", f"what can be read: {known}")
    return KINDS[name], name


def _space(path: Path, said: Mapping[str, Any], which: str) -> Made:
    space = _decoded(path, said.get(which))
    if not isinstance(space, Made) or not isinstance(space.state, dict):
        raise bad_policy(path, f"it does not say its {which.replace('_', ' ')}")
    name = space.name.rpartition(".")[2]
    if name not in {"Box", "Discrete"} or (name, which) == ("Discrete", "observation_space"):
        raise bad_policy(
            path,
            f"its {which.replace('_', ' ')} is a `{name[:40]}`",
            "observations may be a Box with one axis, actions that or a Discrete",
        )
    return space


def _inputs(path: Path, observations: Made) -> int:
    shape = observations.state.get("_shape")
    if not isinstance(shape, tuple) or len(shape) != 1 or not isinstance(shape[0], int):
        raise bad_policy(path, f"its observations have the shape {shape!r:.60}: one axis is read")
    return shape[0]


def _bounds(path: Path, space: Made) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """The least and the largest number of each, of a Box of any numbers."""
    low, high = (array_of(space.state.get(k)).reshape(-1) for k in ("low", "high"))
    if low.shape != high.shape or not low.size:
        raise bad_policy(path, "the bounds of a Box are not one for each number")
    return low, high


def _box(path: Path, observations: Made) -> tuple[Doubles, Doubles] | None:
    """The hull of all numbers: of stacked frames the space's bounds stand in another order."""
    low, high = (bound.astype(np.float64) for bound in _bounds(path, observations))
    if low.size != _inputs(path, observations) or not (np.isfinite(low) & np.isfinite(high)).all():
        return None
    return np.full_like(low, low.min()), np.full_like(high, high.max())


def _shown(path: Path, space: Made) -> str:
    if space.name.endswith(".Discrete"):
        return f"Discrete({_whole(space, 'n')})"
    low, high = _bounds(path, space)
    limits = ", ".join(f"[{a:g}, {b:g}]" for a, b in zip(low[:8], high[:8], strict=False))
    return f"Box of {low.size}: {limits}{', ...' if low.size > 8 else ''}"


# ---------------------------------------------------------------- the network


def _activation(path: Path, kind: _Kind, options: object) -> Layer:
    if not isinstance(options, dict):
        raise bad_policy(path, "its `policy_kwargs` are no dict")
    more = sorted(set(options) - IGNORED)
    if more:
        raise bad_policy(path, f"its `policy_kwargs` have `{more[0][:40]}`, which is not read here")
    name = options.get("activation_fn")
    if name is None:
        return kind.activation
    text = name.text if isinstance(name, Name) else str(name)
    if text not in ACTIVATIONS:
        raise bad_policy(path, f"its activation is `{text[:60]}`", "Tanh and ReLU are read")
    return ACTIVATIONS[text]


def _linear_layers(path: Path, kind: _Kind, tensors: Mapping[str, Floats]) -> Iterator[Affine]:
    numbers = sorted(
        int(middle)
        for key in tensors
        if key.startswith(kind.hidden) and key.endswith(".weight")
        if (middle := key[len(kind.hidden) : -len(".weight")]).isdecimal()
    )
    if numbers != list(range(0, 2 * len(numbers), 2)):
        raise bad_policy(path, f"its layers `{kind.hidden}...` are no linear ones with activations")
    names = [f"{kind.hidden}{n}" for n in numbers] + ([kind.last] if kind.last else [])
    for name in names:
        weight, bias = tensors.get(f"{name}.weight"), tensors.get(f"{name}.bias")
        if weight is None or bias is None:
            raise bad_policy(path, f"it has no layer `{name}`")
        if weight.ndim != 2 or bias.shape != weight.shape[:1] or not weight.size:
            raise bad_policy(path, f"its layer `{name}` is no matrix and a number for each row")
        yield Affine(weight, bias)


def _ending(path: Path, kind: _Kind, actions: Made, *, choice: bool) -> list[Layer]:
    """What `predict` does to what the last linear layer says."""
    if choice:
        if kind.squashed or _whole(actions, "start", 0) != 0:
            raise bad_policy(
                path, "its actions are a Discrete that it cannot answer, or not from 0"
            )
        return []
    if kind.choice:
        raise bad_policy(path, "it chooses one of several actions, but its action space is a Box")
    low, high = _bounds(path, actions)
    if low.dtype != np.float32 or high.dtype != np.float32:
        raise bad_policy(path, "the bounds of its actions are no float32 numbers")
    if not kind.squashed:
        return [Clipped(low, high)]
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise bad_policy(path, "its actions have no bounds, which it scales its answer to")
    half = np.float32(0.5) * (high - low)  # exact: a power of two
    scaled: list[Layer] = [Elementwise("+", np.ones_like(low)), Elementwise("*", half)]
    return [Tanh(), *scaled, Elementwise("+", low), Clipped(low, high)]


def _whole(space: Made, which: str, default: int = -1) -> int:
    """An int of a Discrete, which older files have as Python's and newer ones as NumPy's."""
    value = space.state.get(which, default)
    if isinstance(value, Made):
        numbers = array_of(value)
        value = int(numbers) if numbers.ndim == 0 and numbers.dtype.kind == "i" else default
    return value if isinstance(value, int) else default


def _ended(kind: _Kind, *, choice: bool) -> str:
    if choice:
        return "the index of the largest number (deterministic)"
    return "tanh, scaled to the action space" if kind.squashed else "clipped to the action space"


def _require_fit(path: Path, network: Network, actions: Made) -> None:
    why = problem_of(network)
    if not why and network.choice:
        count = _whole(actions, "n")
        if count != network.outputs:
            why = f"its action space has {count} actions, its network {network.outputs}"
    if why:
        raise bad_policy(path, why)


# ---------------------------------------------------------------- torch's file of tensors


def _tensors(path: Path, data: bytes) -> dict[str, Floats]:
    """The float32 tensors of a `state_dict` that `torch.save` wrote, by name."""
    with _opened(path, data, "its part `policy.pth` is no zip of `torch.save`") as parts:
        names = [n for n in parts.namelist() if n.endswith("/data.pkl")]
        if len(names) != 1:
            raise bad_policy(path, "its part `policy.pth` is no file of `torch.save`")
        folder = names[0].removesuffix("data.pkl")
        order = f"{folder}byteorder"
        if order in parts.namelist() and _part(path, parts, order) != b"little":
            raise bad_policy(path, "its tensors are big-endian, which are not read here")
        state = read_pickle(_part(path, parts, names[0]))
        if not isinstance(state, Made):
            raise bad_policy(path, "its part `policy.pth` holds no tensors by name")
        part = cache(partial(_part, path, parts))  # of one part there may be many tensors
        return {
            name: _tensor(path, part, folder, made)
            for name, made in state.items.items()
            if isinstance(made, Made)
        }


def _tensor(path: Path, part: Callable[[str], bytes], folder: str, made: Made) -> Floats:
    """The numbers of one tensor."""
    try:
        storage, offset, size, stride = made.arguments[:4]
        assert isinstance(storage, Persistent)
        _, kind, key = storage.about[:3]
        text = kind.text if isinstance(kind, Name) else ""
        if made.name != "torch._utils._rebuild_tensor_v2" or text != "torch.FloatStorage":
            raise bad_policy(path, f"a tensor is a `{(text or made.name)[:60]}`: float32 is read")
        flat = np.frombuffer(part(f"{folder}data/{key}"), "<f4")
        count = int(np.prod(size, dtype=np.int64))
        whole = [int(np.prod(size[i + 1 :], dtype=np.int64)) for i in range(len(size))]
        if list(stride) != whole or offset < 0 or offset + count > flat.size:
            raise bad_policy(path, "a tensor does not lie in its part row by row")
        tensor: Floats = flat[offset : offset + count].reshape(size)
    except (AssertionError, AttributeError, TypeError, ValueError, OverflowError) as error:
        raise bad_policy(path, "its part `policy.pth` holds what is no tensor") from error
    return tensor


# ---------------------------------------------------------------- VecNormalize


def _normalised(policy: Policy, statistics: Path | None) -> Policy:
    """The policy with the statistics in front of it, or with the assumption that there are none."""
    facts = dict(policy.facts)
    if statistics is None:
        assumed = "observations are not normalised: no file of a VecNormalize is named"
        return replace(policy, assumed=(*policy.assumed, assumed))
    try:
        layer = _statistics(statistics)
    except (PickleError, RecursionError) as error:
        raise bad_policy(statistics, str(error)) from error
    if layer is None:
        facts["normalised"] = f"`{statistics.name}` says that observations are not (norm_obs)"
        return replace(policy, facts=facts)
    size, inputs = layer.mean.size, policy.network.inputs
    facts["normalised"] = f"by `{statistics.name}`, clipped to {layer.limit:g}"
    if size == inputs:
        layers = (layer, *policy.network.layers)
        return replace(policy, network=replace(policy.network, layers=layers), facts=facts)
    if size and inputs % size == 0:
        facts["normalised"] += f", each of {inputs // size} frames before they are stacked"
        return replace(policy, facts=facts, per_frame=layer)
    raise bad_policy(statistics, f"it is of {in_numbers(size)}, the policy takes {inputs}")


def _statistics(path: Path) -> Standardised | None:
    """What a VecNormalize does to observations; None where nothing."""
    made = read_pickle(content_of(path))
    state = made.state if isinstance(made, Made) and made.name.endswith(".VecNormalize") else None
    if not isinstance(state, dict):
        raise bad_policy(path, "it is no VecNormalize that `env.save` wrote")
    if state.get("norm_obs") is not True:
        return None
    mean, variance = _moments(path, state)
    epsilon, limit = state.get("epsilon"), state.get("clip_obs")
    if not (isinstance(epsilon, float) and isinstance(limit, (int, float)) and limit > 0):
        raise bad_policy(path, "its `epsilon` and `clip_obs` are no positive numbers")
    if mean.ndim != 1 or mean.shape != variance.shape or mean.dtype != np.float64:
        raise bad_policy(path, "its mean and variance are no lists of float64 of one length")
    shifted = variance + epsilon
    if not (np.isfinite(mean).all() and np.isfinite(shifted).all() and (shifted > 0.0).all()):
        raise bad_policy(path, "its mean and variance are not finite, or a variance is negative")
    return Standardised(mean, np.sqrt(shifted), float(limit))


def _moments(path: Path, state: dict[str, Any]) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    moments = state.get("obs_rms")
    if not isinstance(moments, Made) or not isinstance(moments.state, dict):
        raise bad_policy(path, "its observations are no Box: it has no single mean and variance")
    return array_of(moments.state.get("mean")), array_of(moments.state.get("var"))
