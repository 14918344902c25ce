"""The rhythm of set-points that the drone follows worst: a search against D of the proofs.

Purpose: the proofs of laps and of corridors rest on the vehicle's following a_ref to within D. An
AC may ask for anything, so this looks for the reversals of full set-points that are followed
worst: at random, in even and in growing spells (resonances, chirps), alone and on all axes at
once, then bred from the worst, generation after generation; for every axis by |d|, and by the rest
that `bound.py` does not derive, beside what it leaves for it. The vehicle is the generated C
of `drone_vehicle.soter`. Exit code 1 where D is exceeded; a rest beyond what is left says that the
two worst cases together explain more than D, not that a flight does.
Non-goals: a proof; flights as they are flown (`conformance.py`).
"""

from __future__ import annotations

import argparse
import ctypes as ct
import multiprocessing
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from soter.codegen.unit import generate
from soter.language.front_end import check_file, system_of
from soter.native.cache import cached_folder, digest
from soter.native.compiler import STRICT, compile_with, find_compiler
from soter.native.shared_library import CHECK_FAILED, KERNEL, RUNTIME, c_texts
from soter.report.tables import table

if TYPE_CHECKING:
    import numpy.typing as npt

    Floats = npt.NDArray[np.float64]

HERE = Path(__file__).resolve().parent
if str(HERE.parents[1]) not in sys.path:
    sys.path.insert(0, str(HERE.parents[1]))

from bench.drone.bound import Bound, derived  # noqa: E402 - needs the path

VEHICLE, LOOP, BUILT = HERE / "drone_vehicle.soter", HERE / "drone_rhythms.c", "rhythms.so"
PLACES = ("laps", "corridors")
SPELLS, AXES, LEGS = 8, 3, 3
COLUMNS = AXES * (1 + SPELLS)
STEPS = 500
"""Of a rhythm's 2.5 s: the nose turns by degrees, over several reversals."""
LONGEST_S = 2.5
POPULATION, PARENTS, GENERATIONS = 8_000, 200, 16
CHANGED, SHARED = 0.35, 0.3
"""Probabilities: that a spell of a parent is changed, that a rhythm's axes change together."""


@dataclass(frozen=True)
class Place:
    """Where the vehicle is flown, and what its six figures are bounded by in m/s^2."""

    name: str
    library: Path
    asked: tuple[float, ...]
    """The bounds of the set-point, by axis."""
    linear: Floats
    """(7, 8): a step of the linear loop."""
    wind: float
    bounds: tuple[float, ...]
    """D without wind, three times; what is left for the rest, by axis."""


@dataclass(frozen=True)
class Worst:
    """A rhythm, (COLUMNS + LEGS,); |d| without wind by axis, then the rest, (6,) in m/s^2."""

    rhythm: Floats
    missed: Floats


def compiled(name: str) -> Path:
    """A system of drone_vehicle.soter with the loop around its steps."""
    unit = generate(system_of(check_file(str(VEHICLE)), name.capitalize()))
    compiler = find_compiler()
    flags = (*STRICT, "-O3", "-march=native", "-fPIC", "-shared", f"-D{name.upper()}")
    sources = [str(LOOP), *(str(RUNTIME / k) for k in KERNEL), str(CHECK_FAILED)]
    content = digest([unit.source, unit.header, compiler.identity, *flags, *c_texts(*sources)])

    def make(work: Path) -> None:
        (work / "drone_vehicle.c").write_text(unit.source, encoding="utf-8")
        (work / "drone_vehicle.h").write_text(unit.header, encoding="utf-8")
        command = [*compiler.command, *flags, f"-I{work}", f"-I{RUNTIME}", *sources]
        compile_with([*command, "-o", str(work / BUILT), "-lm"], work, "no rhythms")

    return cached_folder("rhythms", content, (BUILT,), make) / BUILT


def place(name: str) -> Place:
    """Laps or corridors, every constant out of the program."""
    bound: Bound = derived(name)
    known = bound.constants
    return Place(
        name,
        compiled(name),
        tuple(float(u) for u in bound.asked),
        bound.stepped,
        float(known["D"]) - bound.residual,
        (bound.residual,) * AXES + tuple(float(x) for x in bound.left),
    )


def flown(where: Place, rhythms: Floats) -> Floats:
    """|d| without wind by axis, then the rest, (N, 6), of rhythms (N, COLUMNS + LEGS)."""
    rhythms = np.ascontiguousarray(rhythms)
    worst = np.zeros((len(rhythms), 2 * AXES))
    pointer = np.ctypeslib.ndpointer(np.float64, flags="C")
    run = ct.CDLL(str(where.library)).drone_rhythms
    run.argtypes = [ct.c_long, pointer, pointer, pointer, ct.c_long, pointer]
    linear = np.ascontiguousarray(where.linear)
    refused = run(len(rhythms), rhythms, np.array(where.asked), linear, STEPS, worst)
    assert not refused, "a step of the program refused its values"
    return worst


def drawn(rng: np.random.Generator, count: int) -> Floats:
    """Rhythms to begin with: spells at random, even ones, and ones that grow or shrink."""
    rhythms = np.zeros((count, COLUMNS + LEGS))
    axes = rhythms[:, :COLUMNS].reshape(count, AXES, 1 + SPELLS)
    axes[:, :, 0] = rng.choice([-1.0, 1.0], (count, AXES))
    spells = rng.exponential(0.25, (count, AXES, SPELLS))
    first = rng.uniform(0.02, 0.8, (count, AXES, 1))
    growing = first * rng.uniform(0.6, 1.7, (count, AXES, 1)) ** np.arange(SPELLS)
    kind = rng.integers(0, 3, count)
    spells[kind == 1] = np.broadcast_to(first, spells.shape)[kind == 1]
    spells[kind == 2] = growing[kind == 2]
    spells[kind > 0, :, 0] = rng.uniform(0.0, 0.7, (count, AXES))[kind > 0]
    together = rng.random(count) < SHARED
    spells[together] = spells[together, :1]
    axes[:, :, 1:] = spells
    leg = rng.integers(0, LEGS, count)
    rhythms[:, COLUMNS] = leg
    rhythms[:, COLUMNS + 1] = np.minimum(leg + rng.integers(0, 2, count), LEGS - 1)
    rhythms[:, COLUMNS + 2] = rng.uniform(0.0, LONGEST_S, count)
    return rhythms


def bred(rng: np.random.Generator, parents: Floats, count: int, spread_s: float) -> Floats:
    """The parents, and rhythms that take each axis from one of two and change some spells."""
    pick = rng.integers(0, len(parents), (2, count - len(parents)))
    children = parents[pick[0]]
    other = parents[pick[1]]
    axes = children[:, :COLUMNS].reshape(-1, AXES, 1 + SPELLS)
    swapped = rng.random(axes.shape[:2]) < SHARED
    axes[swapped] = other[:, :COLUMNS].reshape(axes.shape)[swapped]
    change = rng.normal(0.0, spread_s, axes[:, :, 1:].shape)
    axes[:, :, 1:] += np.where(rng.random(change.shape) < CHANGED, change, 0.0)
    axes[:, :, 1:] = np.abs(axes[:, :, 1:])
    children[:, :COLUMNS] = axes.reshape(-1, COLUMNS)
    children[:, -1] = np.clip(
        children[:, -1] + rng.normal(0.0, spread_s, len(children)), 0.0, LONGEST_S
    )
    return np.concatenate([parents, children])


def search(task: tuple[Place, int, int, int]) -> Worst:
    """One island: (place, which of the six figures, sequences, seed)."""
    where, aim, count, seed = task
    rng = np.random.default_rng(seed)
    size = max(min(POPULATION, count // GENERATIONS), 2 * PARENTS)
    rows = drawn(rng, size)
    worst = Worst(rows[0], np.zeros(2 * AXES))
    for generation in range(max(count // size, 1)):
        missed = flown(where, rows)
        order = np.argsort(-missed[:, aim])[:PARENTS]
        if missed[order[0], aim] > worst.missed[aim]:
            worst = Worst(rows[order[0]], missed[order[0]])
        rows = bred(rng, rows[order], size, 0.2 * 0.75**generation + 0.004)
    return worst


def tasks(sequences: int) -> list[tuple[Place, int, int, int]]:
    """Islands that together fly so many sequences: for each place and aim equally many."""
    aims = [(p, aim) for p in map(place, PLACES) for aim in range(2 * AXES)]
    islands = max(1, round(sequences / len(aims) / (POPULATION * GENERATIONS)))
    each = sequences // (len(aims) * islands)
    return [(p, aim, each, 100 * i + aim) for p, aim in aims for i in range(islands)]


def spelled(axis: Floats) -> str:
    """An axis of a rhythm, (1 + SPELLS,), in words: the first side, and the spells that end."""
    ends = np.cumsum(axis[1:]) < LONGEST_S
    return ("-" if axis[0] < 0 else "+") + " ".join(f"{s:.2f}" for s in axis[1:][ends])


def rows_of(done: list[tuple[Place, int, Worst]]) -> tuple[list[tuple[str, ...]], int]:
    """A row for each place and aim, and how many are beyond D."""
    groups: dict[tuple[str, int], list[tuple[Place, Worst]]] = {}
    for where, aim, worst in done:
        groups.setdefault((where.name, aim), []).append((where, worst))
    rows: list[tuple[str, ...]] = []
    exceeded = 0
    for (name, aim), entries in groups.items():
        where, worst = max(entries, key=lambda x: float(x[1].missed[aim]))
        whole = aim < AXES
        wind = where.wind if whole else 0.0
        most, bound = wind + float(worst.missed[aim]), wind + where.bounds[aim]
        exceeded += whole and most > bound
        axes = worst.rhythm[:COLUMNS].reshape(AXES, 1 + SPELLS)
        rows.append(
            (
                name,
                ("|d| " if whole else "rest ") + "xyz"[aim % AXES],
                f"{most:.3f}",
                f"{bound:.3f}",
                f"{most / bound:.1%}",
                "ok" if most <= bound else "EXCEEDED" if whole else "not left",
                ", ".join(spelled(a) for a in axes),
            )
        )
    return rows, exceeded


def main() -> int:
    """Search for every figure of every place; exit code 1 where D is exceeded."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sequences", type=int, default=10_000_000, help="in all (10,000,000)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    chosen = parser.parse_args()
    began = time.perf_counter()
    wanted = tasks(chosen.sequences)
    with multiprocessing.Pool(chosen.jobs) as pool:
        worst_cases = pool.map(search, wanted, chunksize=1)
    done = [(t[0], t[1], w) for t, w in zip(wanted, worst_cases, strict=True)]
    rows, exceeded = rows_of(done)
    heads = ("", "", "found", "bound", "", "", "sides and spells in s: along or x, side or y, up")
    print(table(heads, rows))
    count = sum(t[2] for t in wanted)
    print(f"\nm/s^2, |d| with wind; {count:,} sequences of {LONGEST_S} s", end=" ")
    print(f"in {time.perf_counter() - began:,.0f} s; a search, no proof")
    return exceeded != 0


if __name__ == "__main__":
    sys.exit(main())
