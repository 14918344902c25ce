"""Reads a policy that Stable-Baselines3 or sb3-contrib saved, without torch.

Purpose: `policy.zip` (`model.save`), with the statistics of a VecNormalize, becomes a `Policy`: the
network that `predict(deterministic=True)` computes, what the files say of observations and actions,
and what is assumed. Nothing of them is unpickled.
Non-goals: images, policies of classes that the two do not have.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from soter.policy.network import (
    ACTIVATIONS,
    Activation,
    Affine,
    Clipped,
    Elementwise,
    Layer,
    Lstm,
    Network,
    Policy,
    Relu,
    Tanh,
    network_problem,
)
from soter.policy.pickle_data import Name, PickleError
from soter.policy.policy_errors import bad_policy_error, read_policy_bytes
from soter.policy.sb3_spaces import (
    NUMBERS_MAX,
    bit_count,
    box_bounds,
    choice_counts,
    observation_layout,
    require_space,
    space_kind,
    space_shape,
    space_text,
)
from soter.policy.sb3_statistics import policy_with_statistics
from soter.policy.sb3_tensors import read_tensors
from soter.policy.sb3_zip import EXPORT, decode_value, flag, open_zip, settings, version, zip_part

if TYPE_CHECKING:
    import zipfile
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from soter.policy.network import Floats
    from soter.policy.pickle_data import Made

    Tensors = Mapping[str, Floats]


class _Kind(NamedTuple):
    """How a class of policies stores the network that `predict` uses."""

    algorithms: str
    hidden: tuple[str, ...]
    """How the names of its hidden layers begin."""
    last: str
    """The name of the last layer; "": it is the last of the hidden ones."""
    activation: Layer
    """The activation, unless the file names another."""
    squashed: bool = False
    """Whether tanh and the bounds of the actions follow, unless the file says otherwise."""
    values: bool = False
    """Whether it answers the value of each action."""
    pairs: bool = False
    """Whether a bit is the choice between two numbers."""
    memory: str = ""
    """How the names of its LSTM begin."""


_ACTOR_CRITIC = _Kind(
    "PPO, A2C, TRPO",
    ("mlp_extractor.shared_net.", "mlp_extractor.policy_net."),
    "action_net",
    Tanh(),
)
_MASKABLE = _ACTOR_CRITIC._replace(algorithms="MaskablePPO", pairs=True)
_RECURRENT = _ACTOR_CRITIC._replace(algorithms="RecurrentPPO", memory="lstm_actor.")
_SAC = _Kind("SAC", ("actor.latent_pi.",), "actor.mu", Relu(), squashed=True)
_TD3 = _Kind("TD3, DDPG", ("actor.mu.",), "", Relu(), squashed=True)
_DQN = _Kind("DQN", ("q_net.q_net.",), "", Relu(), values=True)
_QRDQN = _DQN._replace(algorithms="QRDQN", hidden=("quantile_net.quantile_net.",))
_ARS = _Kind("ARS", ("action_net.",), "", Relu(), squashed=True)
KINDS = {
    "stable_baselines3.common.policies.ActorCriticPolicy": _ACTOR_CRITIC,
    "stable_baselines3.common.policies.MultiInputActorCriticPolicy": _ACTOR_CRITIC,
    "stable_baselines3.sac.policies.SACPolicy": _SAC,
    "stable_baselines3.sac.policies.MultiInputPolicy": _SAC,
    "stable_baselines3.td3.policies.TD3Policy": _TD3,
    "stable_baselines3.td3.policies.MultiInputPolicy": _TD3,
    "stable_baselines3.dqn.policies.DQNPolicy": _DQN,
    "stable_baselines3.dqn.policies.MultiInputPolicy": _DQN,
    "sb3_contrib.common.maskable.policies.MaskableActorCriticPolicy": _MASKABLE,
    "sb3_contrib.common.maskable.policies.MaskableMultiInputActorCriticPolicy": _MASKABLE,
    "sb3_contrib.common.recurrent.policies.RecurrentActorCriticPolicy": _RECURRENT,
    "sb3_contrib.common.recurrent.policies.RecurrentMultiInputActorCriticPolicy": _RECURRENT,
    "sb3_contrib.qrdqn.policies.QRDQNPolicy": _QRDQN,
    "sb3_contrib.qrdqn.policies.MultiInputPolicy": _QRDQN,
    "sb3_contrib.tqc.policies.TQCPolicy": _SAC._replace(algorithms="TQC"),
    "sb3_contrib.tqc.policies.MultiInputPolicy": _SAC._replace(algorithms="TQC"),
    "sb3_contrib.crossq.policies.CrossQPolicy": _SAC._replace(algorithms="CrossQ"),
    "sb3_contrib.ars.policies.ARSPolicy": _ARS,
    "sb3_contrib.ars.policies.ARSLinearPolicy": _ARS._replace(squashed=False),
}
ACTED = dict.fromkeys(("Box", "Discrete", "MultiDiscrete", "MultiBinary"))
IGNORED = frozenset(
    {"net_arch", "activation_fn", "use_sde", "ortho_init", "log_std_init", "full_std", "n_critics"}
    | {"use_expln", "optimizer_class", "optimizer_kwargs", "normalize_images", "with_bias"}
    | {"share_features_extractor", "squash_output", "clip_mean", "n_quantiles", "sde_net_arch"}
    | {"lstm_hidden_size", "n_lstm_layers", "shared_lstm", "enable_critic_lstm"}
    | {"batch_norm", "batch_norm_eps", "batch_norm_momentum", "renorm_warmup_steps"}
)
"""Keys of `policy_kwargs` that do not change what is answered, or are read elsewhere."""
MEAN_LIMIT = 2.0
"""`clip_mean` where the file does not say it."""
NORM_EPSILON = 1e-3
"""`batch_norm_eps` where the file does not say it."""


def read_sb3(path: Path, statistics: Path | None = None) -> Policy:
    """The policy in a file; `statistics`: the file of its VecNormalize. Raises X003, X014.

    With None, the statistics come from a file beside the policy's file, if it exists.
    """
    no_zip = "it is no zip, which is what Stable-Baselines3's `model.save` writes"
    try:
        with open_zip(path, read_policy_bytes(path), no_zip) as parts:
            policy = _read_policy(path, parts)
    except (PickleError, RecursionError) as error:
        raise bad_policy_error(path, str(error), EXPORT) from error
    return policy_with_statistics(policy, statistics)


def _read_policy(path: Path, parts: zipfile.ZipFile) -> Policy:
    data = settings(path, parts)
    kind, name = _policy_kind(path, data)
    layout = observation_layout(path, decode_value(path, data.get("observation_space")))
    actions = require_space(
        path, decode_value(path, data.get("action_space")), "action space", ACTED
    )
    weights = read_tensors(path, zip_part(path, parts, "policy.pth"))
    if any("features_extractor." in key for key in weights):
        raise bad_policy_error(path, "its features are computed by layers of their own", EXPORT)
    options = _policy_options(path, data)
    squashed = space_kind(actions) == "Box" and flag(
        path, options, "squash_output", default=kind.squashed
    )
    layers = [*layout.layers, *_layers(path, kind, options, weights)]
    last, choices = _choice_layers(path, kind, actions, layers[-1])
    layers[-1:] = last
    if not choices:
        layers += _action_layers(path, actions, squashed=squashed)
    network = Network(len(layout.sizes), tuple(layers), choices)
    if why := network_problem(network):
        raise bad_policy_error(path, why)
    return Policy(
        str(path),
        network,
        {
            "file": f"Stable-Baselines3 {version(parts)}, {name} ({kind.algorithms})",
            "observation": layout.shown,
            "action": space_text(path, actions),
            "answer": _answer_text(choices, squashed=squashed),
        },
        _mask_assumption(kind),
        box=layout.box,
        keys=layout.keys,
        shapes=layout.shapes,
        acted=space_shape(path, actions) if space_kind(actions) == "Box" else (),
    )


def _mask_assumption(kind: _Kind) -> tuple[str, ...]:
    if not kind.pairs:
        return ()
    return ("it is given no mask: what a shield does not permit the gate refuses",)


# ---------------------------------------------------------------- what the settings say


def _policy_kind(path: Path, data: Mapping[str, Any]) -> tuple[_Kind, str]:
    """How the policy's class keeps its network, and the name of the class."""
    value = decode_value(path, data.get("policy_class"))
    name = value.text if isinstance(value, Name) else "of its own"
    if name not in KINDS:
        known = ", ".join(dict.fromkeys(k.algorithms for k in KINDS.values()))
        helps = f"what can be read: {known} with `MlpPolicy` or `MultiInputPolicy`", EXPORT
        raise bad_policy_error(path, f"its policy class is `{name[:80]}`", *helps)
    return KINDS[name], name.rpartition(".")[2]


def _policy_options(path: Path, data: Mapping[str, Any]) -> dict[str, Any]:
    """The `policy_kwargs`; raises X014 for an unsupported option that changes the answer."""
    options = decode_value(path, data.get("policy_kwargs"))
    if not isinstance(options, dict):
        raise bad_policy_error(path, "its `policy_kwargs` are no dict")
    if more := sorted(set(options) - IGNORED):
        why = f"its `policy_kwargs` have `{more[0][:40]}`, which is not read here"
        raise bad_policy_error(path, why, EXPORT)
    return options


def _activation_layers(path: Path, kind: _Kind, options: Mapping[str, Any]) -> list[Layer]:
    chosen = options.get("activation_fn")
    if chosen is None:
        return [kind.activation]
    text = chosen.text if isinstance(chosen, Name) else str(chosen)
    module, _, name = text.rpartition(".")
    layers: dict[str, list[Layer]] = {"Tanh": [Tanh()], "ReLU": [Relu()], "Identity": []}
    if module.startswith("torch.nn.modules.") and name in layers | ACTIVATIONS:
        return layers[name] if name in layers else [Activation(name)]
    known = ", ".join(sorted([*layers, *ACTIVATIONS]))
    raise bad_policy_error(path, f"its activation is `{text[:60]}`", f"{known} are read", EXPORT)


def _number_option(path: Path, options: Mapping[str, Any], name: str, default: float) -> float:
    value = options.get(name, default)
    if not isinstance(value, (int, float)) or not abs(value) < NUMBERS_MAX:
        raise bad_policy_error(path, f"its `{name}` is no number")
    return float(value)


# ---------------------------------------------------------------- the network


def _layers(path: Path, kind: _Kind, options: Mapping[str, Any], weights: Tensors) -> list[Layer]:
    """The layers from the prepared observation to the last linear layer."""
    activation = _activation_layers(path, kind, options)
    made: list[Layer] = [*_lstm_layers(path, kind, weights)]
    for prefix in kind.hidden:
        epsilon = _number_option(path, options, "batch_norm_eps", NORM_EPSILON)
        made += _hidden_layers(path, prefix, weights, activation, epsilon)
    if not kind.last:
        if activation and made and made[-1] is activation[0]:
            made.pop()  # nothing follows the last of them
    elif f"{kind.last}.0.weight" in weights:  # of gSDE
        limit = np.float32(_number_option(path, options, "clip_mean", MEAN_LIMIT))
        last = _linear_layer(path, f"{kind.last}.0", weights)
        ends = np.full(last.bias.size, limit)
        made += [last, Clipped(-ends, ends)]
    else:
        made.append(_linear_layer(path, kind.last, weights))
    if not made:
        raise bad_policy_error(path, f"it has no layer `{kind.hidden[-1]}0`")
    return made


def _hidden_layers(
    path: Path, prefix: str, weights: Tensors, activation: list[Layer], epsilon: float
) -> Iterator[Layer]:
    """Yields the layers of a `Sequential`: linear with activations, and normalising layers."""
    numbers = {
        int(number)
        for key in weights
        if key.startswith(prefix)
        if (number := key[len(prefix) :].partition(".")[0]).isdecimal() and len(number) < 6
    }
    expected = 0
    for place in sorted(numbers):
        name = f"{prefix}{place}"
        normal = f"{name}.ra_mean" in weights
        if place != expected:
            why = f"its layers `{prefix}...` are no linear ones with activations"
            raise bad_policy_error(path, why, EXPORT)
        yield from (
            _batch_renorm_layers(path, name, weights, epsilon)
            if normal
            else (_linear_layer(path, name, weights),)
        )
        if not normal:
            yield from activation
        expected += 1 if normal else 2


def _linear_layer(path: Path, name: str, weights: Tensors) -> Affine:
    weight, bias = weights.get(f"{name}.weight"), weights.get(f"{name}.bias")
    if weight is None:
        raise bad_policy_error(path, f"it has no layer `{name}`")
    no_biases = not any(key.endswith(".bias") for key in weights)
    if bias is None and weight.ndim == 2 and no_biases:  # as ARS may say
        bias = np.zeros(len(weight), np.float32)
    if weight.ndim != 2 or bias is None or bias.shape != weight.shape[:1] or not weight.size:
        raise bad_policy_error(path, f"its layer `{name}` is no matrix and a number for each row")
    return Affine(weight, bias)


def _batch_renorm_layers(
    path: Path, name: str, weights: Tensors, epsilon: float
) -> Iterator[Layer]:
    """Yields the layers that do what a `BatchRenorm` does in use, not in training."""
    parts = _named_tensors(
        path, weights, [f"{name}.{k}" for k in ("ra_mean", "ra_var", "scale", "bias")]
    )
    if any(x.ndim != 1 or x.shape != parts[0].shape for x in parts):
        raise bad_policy_error(path, f"its layer `{name}` normalises without a number for each")
    mean, variance, scale, bias = parts
    yield Elementwise("-", mean)
    yield Elementwise("/", np.sqrt(variance + np.float32(epsilon)))
    yield Elementwise("*", scale)
    yield Elementwise("+", bias)


def _named_tensors(path: Path, weights: Tensors, names: Sequence[str]) -> list[Floats]:
    """The tensors with these names; raises X014 if a tensor is missing."""
    if missing := [name for name in names if name not in weights]:
        raise bad_policy_error(path, f"it has no numbers `{missing[0]}`", EXPORT)
    return [weights[name] for name in names]


def _lstm_layers(path: Path, kind: _Kind, weights: Tensors) -> Iterator[Layer]:
    """Yields the layers of an LSTM, if the policy has one."""
    count = 0
    while kind.memory and f"{kind.memory}weight_ih_l{count}" in weights:
        parts = ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
        names = [f"{kind.memory}{part_name}_l{count}" for part_name in parts]
        into, back, *biases = _named_tensors(path, weights, names)
        count += 1
        size = back.size and back.shape[-1]
        fits = into.ndim == back.ndim == 2 and len(into) == len(back) == 4 * size > 0
        if not fits or any(b.shape != (4 * size,) for b in biases):
            raise bad_policy_error(
                path, f"its LSTM `{kind.memory}` has matrices of other sizes", EXPORT
            )
        yield Lstm(np.hstack([into, back]), biases[0] + biases[1])
    others = [k for k in weights if kind.memory and k.startswith(kind.memory)]
    if len(others) != 4 * count or (kind.memory and not count):
        raise bad_policy_error(
            path, f"its LSTM `{kind.memory}` has other numbers than read here", EXPORT
        )


# ---------------------------------------------------------------- the action


def _choice_layers(
    path: Path, kind: _Kind, actions: Made, last: Layer
) -> tuple[list[Layer], tuple[int, ...]]:
    """The last layer with those that choose, and the sizes of the choices, () for a Box."""
    name = space_kind(actions)
    if name == "Box":
        if kind.values:
            raise bad_policy_error(
                path, "it chooses one of several actions, but its action space is a Box"
            )
        return [last], ()
    if kind.squashed and kind is not _ARS:
        raise bad_policy_error(path, f"its action space is a {name}, which it cannot answer")
    if name == "MultiBinary":
        count = bit_count(path, actions)
        if not kind.pairs and isinstance(last, Affine):  # a bit is whether its number is above 0
            weight, bias = (np.stack([0.0 * x, x], axis=1) for x in (last.weight, last.bias))
            last = Affine(weight.reshape(-1, weight.shape[-1]), bias.reshape(-1))
        return [last], (2,) * count
    sizes = choice_counts(path, actions)
    if kind.hidden != _QRDQN.hidden or not isinstance(last, Affine):
        return [last], sizes
    each, rest = divmod(last.bias.size, sizes[0])
    if rest:
        raise bad_policy_error(path, f"it has {last.bias.size} quantiles for {sizes[0]} actions")
    if last.bias.size * sizes[0] > NUMBERS_MAX:
        raise bad_policy_error(
            path, f"it has {last.bias.size} quantiles, more than are read", EXPORT
        )
    together = np.tile(np.eye(sizes[0], dtype=np.float32), each)
    each_of = np.full(sizes[0], each, np.float32)
    zeros = np.zeros(sizes[0], np.float32)
    return [last, Affine(together, zeros), Elementwise("/", each_of)], sizes


def _action_layers(path: Path, actions: Made, *, squashed: bool) -> list[Layer]:
    """The layers that bring the last numbers into the bounds of a Box, as `predict` does."""
    low, high = (bound.astype(np.float32) for bound in box_bounds(path, actions))
    if not squashed:
        return [Clipped(low, high)]
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise bad_policy_error(path, "its actions have no bounds, which it scales its answer to")
    half = np.float32(0.5) * (high - low)  # exact: a power of two
    scaled: list[Layer] = [Elementwise("+", np.ones_like(low)), Elementwise("*", half)]
    return [Tanh(), *scaled, Elementwise("+", low), Clipped(low, high)]


def _answer_text(choices: tuple[int, ...], *, squashed: bool) -> str:
    if choices:
        each = f", of {len(choices)} groups" if len(choices) > 1 else ""
        return f"the index of the largest number{each} (deterministic)"
    return "tanh, scaled to the action space" if squashed else "clipped to the action space"
