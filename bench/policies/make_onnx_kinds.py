"""Policies as ONNX files, exported as people do it, and what they answered before that.

Purpose: `ONNX_KINDS`: networks of torch (both exporters), some of them with memory, and of
scikit-learn (skl2onnx). Used by `make_kinds.py`, in an environment without Soter.
Non-goals: comparing (`policy_kinds.py`).
"""

# mypy: ignore-errors
# ruff: noqa: ANN401, D102, PLC0415 - libraries without types
from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import nn

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

warnings.simplefilter("ignore")
SIZE, OUT = 4, 2


class Remembers(nn.Module):
    """A cell with memory between linear layers: LSTM or GRU, the state goes in and out."""

    def __init__(self, cell: type[nn.Module], layers: int = 1) -> None:
        super().__init__()
        self.cell, self.last = cell(SIZE, 16, layers), nn.Linear(16, OUT)

    def forward(self, obs: torch.Tensor, *state: torch.Tensor) -> tuple[torch.Tensor, ...]:
        given = tuple(state) if isinstance(self.cell, nn.LSTM) else state[0]
        seen, kept = self.cell(obs.unsqueeze(0), given)
        return (self.last(seen.squeeze(0)), *(kept if isinstance(kept, tuple) else (kept,)))


class Chosen(nn.Module):
    """The index of the largest."""

    def __init__(self) -> None:
        super().__init__()
        self.net = nn.Sequential(nn.Linear(SIZE, 32), nn.ReLU(), nn.Linear(32, 5))

    def forward(self, obs: torch.Tensor) -> torch.Tensor:
        return self.net(obs).argmax(dim=1)


class Parts(nn.Module):
    """Two observations by name."""

    def __init__(self) -> None:
        super().__init__()
        self.net = nn.Sequential(nn.Linear(SIZE, 32), nn.Tanh(), nn.Linear(32, OUT))

    def forward(self, pose: torch.Tensor, goal: torch.Tensor) -> torch.Tensor:
        return self.net(torch.cat([pose, goal], dim=1))


def network(activation: nn.Module, *between: nn.Module) -> nn.Module:
    return nn.Sequential(nn.Linear(SIZE, 32), *between, activation, nn.Linear(32, OUT), nn.Tanh())


def exported(
    folder: Path,
    model: nn.Module,
    given: tuple[Any, ...],
    ins: list[str],
    outs: list[str],
    **more: Any,
) -> None:
    torch.manual_seed(3)
    for weight in model.parameters():
        nn.init.normal_(weight, std=0.4)
    model.eval()
    torch.onnx.export(
        model, given, str(folder / "policy.onnx"), input_names=ins, output_names=outs, **more
    )


def plain(model: Callable[[], nn.Module], *, dynamo: bool) -> Callable[[Path, Any, Any], Any]:
    """What takes one observation and keeps nothing."""

    def make(folder: Path, seen: Any, _starts: Any) -> Any:
        asked = model()
        exported(folder, asked, (torch.zeros(1, SIZE),), ["obs"], ["action"], dynamo=dynamo)
        with torch.no_grad():
            return asked(torch.tensor(seen)).numpy().reshape(len(seen), -1)

    return make


def by_name(folder: Path, seen: Any, _starts: Any) -> Any:
    asked = Parts()
    given = (torch.zeros(1, 3), torch.zeros(1, 1))
    exported(folder, asked, given, ["pose", "goal"], ["action"], dynamo=False)
    with torch.no_grad():
        return asked(torch.tensor(seen[:, :3]), torch.tensor(seen[:, 3:])).numpy()


def remembers(
    cell: type[nn.Module], layers: int, ins: list[str], outs: list[str]
) -> Callable[[Path, Any, Any], Any]:
    """What is given a state and answers the next one."""

    def make(folder: Path, seen: Any, starts: Any) -> Any:
        asked = Remembers(cell, layers)
        zeros = tuple(torch.zeros(layers, 1, 16) for _ in ins)
        given = (torch.zeros(1, SIZE), *zeros)
        exported(folder, asked, given, ["obs", *ins], ["action", *outs], dynamo=False)
        state, rows = zeros, []
        with torch.no_grad():
            for one, start in zip(seen, starts, strict=True):
                state = zeros if start else state
                action, *state = asked(torch.tensor(one[None]), *state)
                rows.append(action.numpy()[0])
        return np.array(rows)

    return make


def learnt(kind: str) -> Callable[[Path, Any, Any], Any]:
    """Of scikit-learn."""

    def make(folder: Path, seen: Any, _starts: Any) -> Any:
        from skl2onnx import to_onnx
        from sklearn.neural_network import MLPClassifier, MLPRegressor

        wanted = np.stack([np.sin(seen[:, 0]), seen[:, 1] * seen[:, 2]], axis=1)
        rows = slice(0, 500)
        if kind == "regressor":
            model = MLPRegressor(
                hidden_layer_sizes=(16, 16), activation="tanh", max_iter=30, random_state=1
            )
            model.fit(seen[rows], wanted[rows])
            options = None
        else:
            model = MLPClassifier(hidden_layer_sizes=(16,), max_iter=30, random_state=1)
            model.fit(seen[rows], (3.0 * (wanted[rows, 0] + 1.0) / 2.0).astype(int))
            options = {id(model): {"zipmap": False}}
        made = to_onnx(model, seen[:1], options=options)
        (folder / "policy.onnx").write_bytes(made.SerializeToString())
        return model.predict(seen).reshape(len(seen), -1)

    return make


LSTM, GRU = nn.LSTM, nn.GRU
ONNX_KINDS: dict[str, Callable[[Path, Any, Any], Any]] = {
    "ONNX torch, traced": plain(lambda: network(nn.Tanh()), dynamo=False),
    "ONNX torch, dynamo": plain(lambda: network(nn.ReLU()), dynamo=True),
    "ONNX layer norm, gelu": plain(lambda: network(nn.GELU(), nn.LayerNorm(32)), dynamo=False),
    "ONNX ArgMax": plain(Chosen, dynamo=False),
    "ONNX of two by name": by_name,
    "ONNX LSTM h_in, h_out": remembers(LSTM, 1, ["h_in", "c_in"], ["h_out", "c_out"]),
    "ONNX LSTM h0, hn, 2 layers": remembers(LSTM, 2, ["h0", "c0"], ["hn", "cn"]),
    "ONNX GRU state_in_0": remembers(GRU, 1, ["state_in_0"], ["state_out_0"]),
    "ONNX LSTM named otherwise": remembers(LSTM, 1, ["old_a", "old_b"], ["x", "y"]),
    "ONNX scikit-learn regressor": learnt("regressor"),
    "ONNX scikit-learn classifier": learnt("classifier"),
}
NAMED = {"ONNX LSTM named otherwise": ":old_a=x,old_b=y"}
"""What the program says after the file."""


def write_onnx(folder: Path, name: str, count: int) -> dict[str, Any]:
    from make_kinds import slug, starts_of  # it is being run

    own = folder / slug(name)
    own.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(7)
    seen = rng.uniform(-3.0, 3.0, (count, SIZE)).astype(np.float32)
    starts = starts_of(count, rng)
    acted = np.asarray(ONNX_KINDS[name](own, seen, starts), np.float64)
    np.savez(own / "answers.npz", starts=starts, acted=acted, scale=np.abs(acted).max(1))
    parts = {"goal": seen[:, 3:], "pose": seen[:, :3]} if "by name" in name else {"seen": seen}
    np.savez(own / "seen.npz", **parts)
    whole = "ArgMax" in name or "classifier" in name
    file = f"onnx:{slug(name)}/policy.onnx{NAMED.get(name, '')}"
    return {"name": name, "from": file, "whole": whole}
