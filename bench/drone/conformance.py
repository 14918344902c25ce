"""Whether the vehicle that flies behaves like the plant of the proof.

Purpose: for every 5 ms of seeded laps and of flights with hostile ACs, and for every tube axis, the
smallest bound on |d| with which `Tube` of motion_primitive.soter explains what the 13-state vehicle
did, from true states. One beyond the declared D is a failure (exit 1).
Non-goals: estimates (`soter monitor`), whether the proof holds (`soter verify`).

On an axis the state is (p, v, a, j, s); a, j, s are the shaping filter's and must follow it
exactly, and v' = a + d, p' = v. With alpha = v(h) - v(0) - int a, beta = p(h) - p(0) - h v(0) -
iint a and gamma = 2 beta - h alpha, some |d(.)| <= D explains the step if and only if
D >= (|gamma| + sqrt(gamma^2 + h^2 alpha^2)) / h^2: the extreme d has one switch.
"""

# ruff: noqa: ANN401 - traces are numpy records

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from soter.language.front_end import check_file, system_of
from soter.report.tables import table
from soter.simulate.run import NativeProgram

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
LAPS, CORRIDORS = "motion_primitive.soter", "corridor.soter"
HOSTILE = (
    "Twitching",
    "Jerking",
    "Pushing",
    "Ramming",
    "Failing",
    "Shaken",
    "Reversing",
    "Rhythmic",
)
HOSTILE_THERE = ("Twitching", "Jerking", "Pushing", "Ramming", "Failing", "Rhythmic")
LONGEST_NS = 60 * 10**9
"""Of a flight: every instant of it is kept."""
FIRST_SEED = 20_000
STEP_S = 0.005
QUANTILES = (0.5, 0.99, 0.9999)
FILTER_TOLERANCE = 1e-9
"""m/s^2: what rounding may do to the filter's states over one step."""


def vectors(record: Any) -> Any:
    """A Vec3 field of a trace as (N, 3)."""
    return np.stack([record[n] for n in "xyz"], axis=1)


def lagged(a: Any, j: Any, s: Any, u: Any, band: float, fast: float) -> tuple[Any, ...]:
    """The filter after one step, and the single and double integral of a over it."""
    c = band**2 / (band - fast) ** 2 * (s - u)
    free = a - u - c
    slope = j + fast * c + band * free
    t = STEP_S
    slow, quick = np.exp(-band * t), np.exp(-fast * t)
    later = slow * (free + t * slope)
    after = u + quick * c + later
    drop = slow * slope - fast * quick * c - band * later
    # int over [0, t] of e^(-k x) and of x e^(-k x), and once more
    one = {k: (1 - np.exp(-k * t)) / k for k in (band, fast)}
    two = {k: (t - one[k]) / k for k in (band, fast)}
    ramp = (one[band] - t * slow) / band
    ramps = (two[band] - ramp) / band
    single = u * t + c * one[fast] + free * one[band] + slope * ramp
    double = u * t**2 / 2 + c * two[fast] + free * two[band] + slope * ramps
    return after, drop, u + quick * (s - u), single, double


def needed(run: Any, constants: dict[str, Any]) -> tuple[Any, float]:
    """Per step and axis the least bound on |d| (N, 3), how far the filter strays at most.

    The axes are those of the tube that is flown; of the world where there is none.
    """
    trace, topics = run.trace, run.trace["topics"]
    band, fast = constants["iris.BAND"], constants["iris.FAST"]
    names = {n.rsplit(".", 1)[-1]: n for n in topics.dtype.names}
    frame = np.broadcast_to(np.eye(3), (len(trace), 3, 3))
    if "tubeState" in names:
        tubes = np.array([[t[1], t[2], t[3]] for t in constants["city.TUBES"]])
        frame = tubes[topics[names["tubeState"]]["leg"].astype(int)]

    def turned(v: Any, at: Any) -> Any:
        return np.einsum("nij,nj->ni", at, v)

    p, v = vectors(trace["d"]["p"]), vectors(trace["d"]["v"])
    ref = topics[names["reference"]]
    u = vectors(topics[names["control"]])[1:-1]
    # what `reference` holds after instant k is the filter's state at instant k + 1
    at = frame[1:-1]
    a, j, s = (turned(vectors(ref[n])[:-2], at) for n in "ajs")
    after, drop, stage, single, double = lagged(a, j, s, u, band, fast)
    told = [turned(vectors(ref[n])[1:-1], at) for n in "ajs"]
    stray = max(
        float(np.abs(x - y).max() / scale)
        for x, y, scale in zip((after, drop, stage), told, (1, band, 1), strict=True)
    )
    p0, v0, p1, v1 = (turned(x, at) for x in (p[1:-1], v[1:-1], p[2:], v[2:]))
    h = STEP_S
    alpha = v1 - v0 - single
    beta = p1 - p0 - h * v0 - double
    skew = 2 * beta - h * alpha
    return (np.abs(skew) + np.sqrt(skew**2 + (h * alpha) ** 2)) / h**2, stray


def fly(task: tuple[str, str, range]) -> tuple[int, Any, float, Any]:
    """Every seed of one chunk: steps, largest per axis, strayed, quantile sample."""
    file, name, seeds = task
    checked = check_file(str(DRONE / file))
    assert checked.program is not None
    prefix = "" if file in (LAPS, CORRIDORS) else "drone."
    known = {n.removeprefix(prefix): c.value for n, c in checked.program.consts.items()}
    system = system_of(checked, name)
    program = NativeProgram(system)
    assert system.until_ns is not None
    steps, worst, strayed, sample = 0, np.zeros(3), 0.0, []
    for seed in seeds:
        run = program.run(min(system.until_ns, LONGEST_NS), seed, keep_trace=True)
        d, stray = needed(run, known)
        steps += len(d)
        worst = np.maximum(worst, d.max(axis=0))
        strayed = max(strayed, stray)
        sample.append(d.max(axis=1)[:: max(1, len(d) // 2000)])
    return steps, worst, strayed, np.concatenate(sample)


def declared(file: str) -> float:
    """D of a program, wind and residual, in m/s^2."""
    program = check_file(str(DRONE / file)).program
    assert program is not None
    value = program.consts["D"].value
    assert isinstance(value, float)
    return value


@dataclass(frozen=True)
class Arm:
    """So many flights of a system; `program` declares D."""

    file: str
    name: str
    program: str
    count: int


def arms(laps: int, hostile: int) -> list[Arm]:
    """Laps and corridors, each with its own AC and with those that mean harm."""
    candidates = [Arm(LAPS, "Protected", LAPS, laps)]
    candidates += [Arm("adversaries.soter", name, LAPS, hostile) for name in HOSTILE]
    candidates.append(Arm(CORRIDORS, "Protected", CORRIDORS, hostile))
    candidates += [Arm("corridor_adversaries.soter", n, CORRIDORS, hostile) for n in HOSTILE_THERE]
    return [arm for arm in candidates if arm.count]


def campaign(laps: int, hostile: int, jobs: int | None) -> int:
    """Fly, print, and say how many kinds of flight exceed D or stray from the filter."""
    wanted = arms(laps, hostile)
    tasks = [
        (arm.file, arm.name, range(a, min(a + 10, FIRST_SEED + arm.count)))
        for arm in wanted
        for a in range(FIRST_SEED, FIRST_SEED + arm.count, 10)
    ]
    with multiprocessing.Pool(jobs) as pool:
        done = pool.map(fly, tasks, chunksize=1)
    rows, failures = [], 0
    bounds = {program: declared(program) for program in (LAPS, CORRIDORS)}
    for arm in wanted:
        mine = [x for x, task in zip(done, tasks, strict=True) if task[:2] == (arm.file, arm.name)]
        worst = np.max([x[1] for x in mine], axis=0)
        stray = max(x[2] for x in mine)
        sample = np.quantile(np.concatenate([x[3] for x in mine]), QUANTILES)
        bound = bounds[arm.program]
        wrong = bool(worst.max() > bound or stray > FILTER_TOLERANCE)
        failures += wrong
        rows.append(
            (
                "laps" if arm.program == LAPS else "corridors",
                arm.name,
                str(arm.count),
                f"{sum(x[0] for x in mine):,}",
                *(f"{x:.3f}" for x in sample),
                *(f"{x:.3f}" for x in worst),
                f"{worst.max() / bound:.0%}",
                "EXCEEDED" if wrong else "ok",
            )
        )
    quantiles = (f"{100 * q:g} %" for q in QUANTILES)
    axes = ("along, x", "side, y", "up, z")
    print(table(("", "flights", "runs", "steps", *quantiles, *axes, "of D", ""), rows))
    print("\nthe least bound on |d| that explains a step, m/s^2; declared:", end=" ")
    print(f"D = {bounds[LAPS]:.3f} for laps, {bounds[CORRIDORS]:.3f} for corridors")
    return failures


def main() -> int:
    """Read the command line, fly; exit code 1 where a bound is exceeded."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--laps", type=int, default=1000, help="protected laps (1000)")
    parser.add_argument("--hostile", type=int, default=100, help="flights per hostile AC (100)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes (all cores)")
    chosen = parser.parse_args()
    return 1 if campaign(chosen.laps, chosen.hostile, chosen.jobs) else 0


if __name__ == "__main__":
    sys.exit(main())
