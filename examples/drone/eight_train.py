"""Fit the network that flies the figure eight to what the autopilot did there.

    python examples/drone/eight_train.py [--seed 1] [-o examples/drone/eight.json]

Purpose: imitation, as people do it who have data and no model: `Teacher` of eight.soter flies slow
loops in the project's own simulator, a 10-16-3 network is fitted to its commands with Adam in
NumPy. The weights are a table of the program, so the network itself runs in Soter.
Non-goals: a network that is right where nobody flew. It has seen the slow loops of `Taught`, and
little of what happens far from it: that is what goes wrong in the paper's Figure 5.
Equal seeds give equal weights on one machine; elsewhere the last digits may differ.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from flights import array

import soter

if TYPE_CHECKING:
    from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
PROGRAM, WEIGHTS = HERE / "eight.soter", HERE / "eight.json"
LESSONS = 6
"""Flights, each at a pace of its own."""
NEURONS, BATCH, ROUNDS, RATE = 16, 256, 6000, 3e-3
DIGITS = 6
STEP_NS = 10_000_000

Weights = dict[str, "NDArray[np.float64]"]


def lessons(program: soter.Program, seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What the teacher saw, (n, 10), and what it asked for, (n, 3)."""
    seen, asked = [], []
    for lesson in range(LESSONS):
        run = program.simulate("Taught", seed=LESSONS * seed + lesson)
        trace = run.require_trace()
        rows = trace[trace["header"]["ct"] % STEP_NS == 0]
        topics = rows["topics"][rows["topics"]["loop"]["active"] == 1]
        loop, at = topics["loop"], topics["iris.localPosition"]
        errors = [array(loop["p"]) - array(at["p"]), array(loop["v"]) - array(at["v"])]
        seen.append(np.concatenate([*errors, array(loop["a"]), np.ones((len(at), 1))], axis=1))
        asked.append(array(topics["drone.control"]))
    return np.concatenate(seen), np.concatenate(asked)


def answer(w: Weights, seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the network asks for, (n, 3), before it is bounded; `seen` is (n, 10)."""
    asked: NDArray[np.float64] = np.tanh(seen @ w["hidden"].T) @ w["output"].T + w["bias"]
    return asked


def gradient(w: Weights, seen: NDArray[np.float64], asked: NDArray[np.float64]) -> Weights:
    """Of the mean square error over a batch, (n, 10) and (n, 3)."""
    h = np.tanh(seen @ w["hidden"].T)
    miss = 2.0 * (h @ w["output"].T + w["bias"] - asked) / len(seen)
    back = (miss @ w["output"]) * (1.0 - h * h)
    return {"hidden": back.T @ seen, "output": miss.T @ h, "bias": miss.sum(axis=0)}


def fit(seen: NDArray[np.float64], asked: NDArray[np.float64], seed: int) -> Weights:
    """Adam from random weights; `seen` (n, 10), `asked` (n, 3)."""
    rng = np.random.default_rng(seed)
    w: Weights = {
        "hidden": rng.normal(0.0, 0.5, (NEURONS, seen.shape[1])),
        "output": rng.normal(0.0, 0.5, (asked.shape[1], NEURONS)),
        "bias": np.zeros(asked.shape[1]),
    }
    first = {k: np.zeros_like(v) for k, v in w.items()}
    second = {k: np.zeros_like(v) for k, v in w.items()}
    for t in range(1, ROUNDS + 1):
        chosen = rng.integers(len(seen), size=BATCH)
        slope = gradient(w, seen[chosen], asked[chosen])
        rate = RATE * (1.0 - 0.9 * t / ROUNDS)
        for k in w:
            first[k] = 0.9 * first[k] + 0.1 * slope[k]
            second[k] = 0.999 * second[k] + 0.001 * slope[k] ** 2
            step = first[k] / (1.0 - 0.9**t) / (np.sqrt(second[k] / (1.0 - 0.999**t)) + 1e-8)
            w[k] = w[k] - rate * step
    return {k: np.round(v, DIGITS) for k, v in w.items()}


def write(w: Weights, comment: str, path: Path) -> None:
    """The table that eight.soter reads; a row of weights a line."""
    lines = [f' "$comment": {json.dumps(comment)}']
    for name, values in w.items():
        rows = [json.dumps(row) for row in values.tolist()]
        text = ", ".join(rows) if values.ndim == 1 else ",\n  ".join(rows)
        lines.append(f' "{name}": [{text}]' if values.ndim == 1 else f' "{name}": [\n  {text}]')
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def main() -> None:
    """Fly the lessons, fit, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=WEIGHTS)
    arguments = parser.parse_args()
    seen, asked = lessons(soter.load(str(PROGRAM)), arguments.seed)
    w = fit(seen, asked, arguments.seed)
    miss = float(np.sqrt(np.mean((answer(w, seen) - asked) ** 2)))
    print(f"{len(seen)} commands of the teacher, imitated to {miss:.3f} m/s^2 (root mean square)")
    told = (
        f"Weights of Learned (eight.soter), written by eight_train.py --seed {arguments.seed}: "
        f"{len(seen)} commands of Teacher in {LESSONS} flights."
    )
    write(w, told, arguments.output)
    print(f"wrote {arguments.output}")


if __name__ == "__main__":
    main()
