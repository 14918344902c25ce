"""Train the network of learned.soter in random worlds, by the cross-entropy method.

    python examples/exploration/learned_train.py [--seed 1] [-o examples/exploration/learned.json]

Purpose: weights that know many cells after a minute. Candidates fly behind the module, so nothing
breaks while they learn; nor does anything tell them of walls: alone what they learn collides.
Equal seeds give equal weights on one machine; elsewhere the last digits may differ.
Non-goals: a good explorer; the worlds of `bench/exploration/worlds.py`, which are others.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import soter

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
PROGRAM, WEIGHTS = HERE / "learned.soter", HERE / "learned.json"
NEURONS, SIGHTS = 6, 7  # as in learned.soter
ROUNDS, CANDIDATES, BEST, WORLDS = 12, 32, 6, 4
NOISE = 0.3
"""Added to the spread of the first round, and less and less to that of those after it."""
FIRST_WORLD = 1_000_000
"""Seeds from here on; nobody is measured in these worlds."""
DIGITS = 4


class Pupil:
    """The network as Python: weights (NEURONS, SIGHTS + 1), the last column that of the output."""

    def __init__(self, weights: Array) -> None:
        self.hidden, self.output = weights[:, :-1], weights[:, -1]

    def step(self, inputs: Any) -> int:  # noqa: ANN401 - soter's record
        """The direction with the greatest score, the first of several."""
        seen = np.asarray(inputs.view.ways)
        return int(np.argmax(np.tanh(seen @ self.hidden.T) @ self.output))


@cache
def loaded() -> soter.Program:
    """The program, once a process."""
    return soter.load(str(PROGRAM))


def known_share(weights: Array, seed: int) -> float:
    """Of the map, after one flight."""
    program = loaded()
    program.bind("Pupil", Pupil(weights))
    run = program.simulate("School", seed=seed, trace=False, sha256=False)
    if run.extern_failures:
        raise RuntimeError(str(run.extern_failures))
    cells: int = program.constant("grid.CELLS")
    return float(run.final["topics"]["e.mapper.known"].sum()) / cells


def train(seed: int, rounds: int, workers: int) -> Array:
    """The mean of the last round, (NEURONS, SIGHTS + 1)."""
    rng = np.random.default_rng(seed)
    mean, spread = np.zeros((NEURONS, SIGHTS + 1)), np.ones((NEURONS, SIGHTS + 1))
    with ProcessPoolExecutor(workers) as pool:
        for number in range(rounds):
            drawn = mean + spread * rng.standard_normal((CANDIDATES, *mean.shape))
            first = FIRST_WORLD + (seed * rounds + number) * WORLDS
            flights = list(product(drawn, range(first, first + WORLDS)))
            shares = list(pool.map(known_share, *zip(*flights, strict=True), chunksize=4))
            scores = np.reshape(shares, (CANDIDATES, WORLDS)).mean(axis=1)
            best = drawn[np.argsort(scores)[-BEST:]]
            mean = best.mean(axis=0)
            spread = best.std(axis=0) + NOISE * (1.0 - (number + 1) / rounds)
            told = f"known {100 * scores.mean():.1f} %, the best {100 * scores.max():.1f} %"
            print(f"round {number + 1:2} of {rounds}: {told}", flush=True)
    return np.round(mean, DIGITS)


def write(weights: Array, comment: str, path: Path) -> None:
    """The table that learned.soter reads; a row of weights a line."""
    rows = ",\n  ".join(json.dumps(row) for row in weights[:, :-1].tolist())
    lines = [
        f' "$comment": {json.dumps(comment)}',
        f' "hidden": [\n  {rows}]',
        f' "output": {json.dumps(weights[:, -1].tolist())}',
    ]
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def main() -> None:
    """Fly, learn, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("-o", "--output", type=Path, default=WEIGHTS)
    asked = parser.parse_args()
    weights = train(asked.seed, asked.rounds, asked.workers)
    told = (
        f"Weights of Learned (learned.soter), written by learned_train.py --seed {asked.seed} "
        f"--rounds {asked.rounds}: {CANDIDATES} candidates a round in {WORLDS} worlds."
    )
    write(weights, told, asked.output)
    print(f"wrote {asked.output}")


if __name__ == "__main__":
    main()
