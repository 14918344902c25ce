"""Puts the statistics of observations that a VecNormalize saved in front of a policy.

Purpose: `policy_with_statistics` reads a `vecnormalize.pkl` that `env.save` wrote: the one that is
named, or else one beside the policy's file, and says when it took a file that nobody named.
Non-goals: the network behind them (`sb3_file.py`); rewards.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.language.load.named_files import NO_STATISTICS
from soter.policy.network import Policy, Standardised, numbers_text
from soter.policy.pickle_data import Made, PickleError, read_array, read_pickle
from soter.policy.policy_errors import bad_policy_error, read_policy_bytes
from soter.policy.sb3_zip import flag

if TYPE_CHECKING:
    from soter.policy.network import Doubles


OWN = ("{0}_vecnormalize.pkl", "{0}_vec_normalize.pkl", "{0}/vecnormalize.pkl")
"""Names of the file with the statistics of one policy, `{0}.zip`; the last is RL Zoo's."""
OF_FOLDER = ("vecnormalize.pkl", "vec_normalize.pkl")
CHECKPOINT = re.compile(r"(.+)_(\d+_steps)")
"""What `CheckpointCallback` calls a policy; its statistics are `NAME_vecnormalize_N_steps.pkl`."""


def statistics_file_beside(path: Path) -> Path | None:
    """The statistics file beside a policy, or None; raises X014 if it could be two files."""
    names = [name.format(path.stem) for name in OWN]
    if saved := CHECKPOINT.fullmatch(path.stem):
        names.append(f"{saved[1]}_vecnormalize_{saved[2]}.pkl")
    for group in (names, OF_FOLDER):
        files = [at for name in group if (at := path.parent / name).is_file()]
        if len(files) > 1:
            why = f"`{files[0].name}` and `{files[1].name}` lie beside it"
            raise bad_policy_error(path, why, *_naming_helps(path, files[0]))
        if files:
            return files[0]
    return None


def _naming_helps(path: Path, statistics: Path) -> tuple[str, ...]:
    """Help lines about how to name the right statistics file."""
    named = statistics.name if statistics.parent == path.parent else statistics
    return (
        f'name them: "sb3:{path.name}:{named}", or `--statistics` of `soter policy`',
        f'or say that there are none: "sb3:{path.name}:{NO_STATISTICS}"',
    )


def policy_with_statistics(policy: Policy, named: Path | None) -> Policy:
    """The policy with its statistics as the first layer, or with an assumption if it has none.

    Raises SoterError X003, X014.
    """
    path = Path(policy.path)
    facts = dict(policy.facts)
    if named is not None and named.name == NO_STATISTICS:
        facts["normalised"] = "not, as was said"
        return replace(policy, facts=facts)
    found = None if named is not None else statistics_file_beside(path)
    statistics = named or found
    if statistics is None:
        assumed = "observations are not normalised: no file of a VecNormalize is named or beside it"
        return replace(policy, assumed=(*policy.assumed, assumed))
    try:
        made = _policy_with_layer(policy, statistics, facts)
    except (PickleError, RecursionError) as error:
        raise bad_policy_error(statistics, str(error)) from error
    if found is None:
        return made
    assumed = f"observations are normalised by `{found.relative_to(path.parent)}`, found beside it"
    return replace(made, assumed=(*made.assumed, assumed), beside=found)


def _policy_with_layer(policy: Policy, statistics: Path, facts: dict[str, str]) -> Policy:
    """The policy with its statistics as first layer, or as a layer for each frame."""
    state = _vecnormalize_state(statistics)
    if not flag(statistics, state, "norm_obs"):
        facts["normalised"] = f"`{statistics.name}` says that observations are not (norm_obs)"
        return replace(policy, facts=facts)
    layer = _statistics_layer(statistics, state, policy.keys)
    size, inputs = layer.mean.size, policy.network.inputs
    facts["normalised"] = f"by `{statistics.name}`, clipped to {layer.limit.min():g}"
    if size == inputs:
        layers = (layer, *policy.network.layers)
        return replace(policy, network=replace(policy.network, layers=layers), facts=facts)
    if size and inputs % size == 0 and not policy.keys:
        facts["normalised"] += f", each of {inputs // size} frames before they are stacked"
        return replace(policy, facts=facts, per_frame=layer)
    why = f"it is of {numbers_text(size)}, the policy takes {inputs}"
    raise bad_policy_error(statistics, why, *_naming_helps(Path(policy.path), statistics)[1:])


def _vecnormalize_state(path: Path) -> dict[str, Any]:
    made = read_pickle(read_policy_bytes(path))
    known = isinstance(made, Made) and made.name.partition(".")[0] == "stable_baselines3"
    state = made.state if known and made.name.endswith(".VecNormalize") else None
    if not isinstance(state, dict):
        raise bad_policy_error(path, "it is no VecNormalize that `env.save` wrote")
    return state


def _statistics_layer(
    path: Path, state: dict[str, Any], keys: tuple[tuple[str, int], ...]
) -> Standardised:
    """The layer that scales observations as VecNormalize does; `keys`: their names and sizes."""
    epsilon, limit = state.get("epsilon"), state.get("clip_obs")
    if not (isinstance(epsilon, (int, float)) and isinstance(limit, (int, float)) and limit > 0):
        raise bad_policy_error(path, "its `epsilon` and `clip_obs` are no positive numbers")
    saved = state.get("obs_rms")
    by_name = {"": saved} if isinstance(saved, Made) else saved
    if not isinstance(by_name, dict) or (isinstance(saved, Made) and keys):
        raise bad_policy_error(path, "it has no mean and variance of what the policy observes")
    counts = dict(keys) if keys else {"": -1}
    if unknown := sorted(set(by_name) - set(counts)):
        raise bad_policy_error(
            path, f"it is of `{unknown[0][:40]}`, which the policy does not observe"
        )
    blocks = [
        _scaling(path, by_name.get(key), count, epsilon, limit) for key, count in counts.items()
    ]
    return Standardised(*(np.concatenate(column) for column in zip(*blocks, strict=True)))


def _scaling(
    path: Path, moments: object, count: int, epsilon: float, limit: float
) -> tuple[Doubles, Doubles, Doubles]:
    """The mean, deviation and limit of an observation, (n,) each; no change without `moments`."""
    if moments is None:
        return np.zeros(count), np.ones(count), np.full(count, np.inf)
    if not isinstance(moments, Made) or not isinstance(moments.state, dict):
        raise bad_policy_error(path, "its statistics have no mean and variance")
    mean, variance = (read_array(moments.state.get(k)) for k in ("mean", "var"))
    if mean.shape != variance.shape or {mean.dtype, variance.dtype} != {np.dtype(np.float64)}:
        raise bad_policy_error(path, "its mean and variance are no lists of float64 of one length")
    if count not in (-1, mean.size):
        raise bad_policy_error(
            path, f"it is of {numbers_text(mean.size)}, the policy takes {count}"
        )
    mean, shifted = mean.reshape(-1), variance.reshape(-1) + epsilon
    if not (np.isfinite(mean).all() and np.isfinite(shifted).all() and (shifted > 0.0).all()):
        raise bad_policy_error(
            path, "its mean and variance are not finite, or a variance is negative"
        )
    return mean, np.sqrt(shifted), np.full(mean.size, float(limit))
