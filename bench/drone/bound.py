"""What every AC can make the drone miss of its reference: derived, not searched.

Purpose: the proofs of laps and of corridors count on |lift n - (a_ref + g)| <= RESIDUAL on each
axis, n the vehicle's z and lift its thrust over its mass. To first order in the tilt error that
is b b' f + (1 - b b') z, b along a_ref + g: f is what the lift lags behind a_ref, z what the
attitude loop does, both linear in the set-points. Here their largest values over every sequence
of set-points within the gate are bounded, in Arb balls, together with b (docs/drone.md). What is
left of RESIDUAL is for the rest: higher orders, the spin about n, rotors that slow down more
slowly than they speed up. Exit code 1 where nothing is left, or where a flight is beyond a bound.
Non-goals: a bound on the rest, which is measured here and searched in `rhythms.py`.
"""

# ruff: noqa: ANN401 - traces are numpy records

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from flint import arb, arb_mat

from soter.certificate.terms.linear_enclosures import exact, upper
from soter.language.front_end import check_file, system_of
from soter.report.tables import table
from soter.simulate.run import NativeProgram

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from soter.language.model.system import System

    Floats = npt.NDArray[np.float64]

Seen: TypeAlias = dict[str, tuple[float, float]]
"""By quantity the most that was seen, and what is derived of it."""
DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
PLACES = {"laps": "motion_primitive.soter", "corridors": "corridor.soter"}
A, J, S, TILT, RATE, TURNED, LIFT = range(7)
"""The linear loop on an axis, all as accelerations: the filter's a, a' and s; what the tilt gives,
its first and second derivative; and what the lift gives."""
STATES = 7
STEPS = 700
"""Of impulse responses; what comes after them is bounded by their last block."""
PARTS = 32
"""Instants within a step at which bounds are taken; in between they are Lipschitz."""
SLABS = 32
SLOPES = tuple(k / 200.0 for k in range(-16, 17))
DIGITS = 1e4
"""What is printed are multiples of 1 / DIGITS m/s^2."""
OUTWARD = 1.0 + 1e-12
"""Far more than a hundred roundings of doubles."""


@dataclass(frozen=True)
class Loop:
    """One axis of shaping filter, attitude loop and rotors, as iris.soter has them."""

    constants: dict[str, Any]

    def value(self, name: str) -> arb:
        """A constant of iris.soter, a ball."""
        return exact(float(self.constants[f"iris.{name}"]))

    def reached(self, t: arb) -> tuple[arb, arb, arb, arb]:
        """How far a rotor's thrust comes within t, of what it is told; its two integrals, slope.

        The mean of rotors that speed up and that slow down: one goes up where another goes down.
        """
        bounds = [arb(0)] * 4
        for lag in (self.value("LAG_UP"), self.value("LAG_DOWN")):
            whole, gone = 1 - (-self.value("REACH") / lag).exp(), (-t / lag).exp()
            parts = (
                1 - gone,
                t - lag * (1 - gone),
                t * t / 2 - lag * t + lag * lag * (1 - gone),
                gone / lag,
            )
            bounds = [x + y / whole / 2 for x, y in zip(bounds, parts, strict=True)]
        return bounds[0], bounds[1], bounds[2], bounds[3]

    def filtered(self, x: Sequence[arb], u: arb, t: arb) -> list[arb]:
        """a, a' and s after t with u held (docs/drone.md, "Behind the gate")."""
        band, fast = self.value("BAND"), self.value("FAST")
        c = band * band / ((band - fast) * (band - fast)) * (x[S] - u)
        free = x[A] - u - c
        slope = x[J] + fast * c + band * free
        slow, quick = (-band * t).exp(), (-fast * t).exp()
        later = slow * (free + t * slope)
        return [
            u + quick * c + later,
            slow * slope - fast * quick * c - band * later,
            u + quick * (x[S] - u),
        ]

    def asked(self, x: Sequence[arb]) -> arb:
        """The second derivative that the attitude loop asks of the tilt."""
        band, rate = self.value("BAND"), self.value("RATE_GAIN")
        snap = band * band * (x[S] - x[A]) - 2 * band * x[J]
        return snap + rate * (x[J] - x[RATE]) + rate * self.value("TILT_GAIN") * (x[A] - x[TILT])

    def after(self, x: Sequence[arb], u: arb, t: arb) -> list[arb]:
        """The states t after a step of the loop, t within its period."""
        share, once, twice, _ = self.reached(t)
        gap = self.asked(x) - x[TURNED]
        return [
            *self.filtered(x, u, t),
            x[TILT] + t * x[RATE] + t * t / 2 * x[TURNED] + twice * gap,
            x[RATE] + t * x[TURNED] + once * gap,
            x[TURNED] + share * gap,
            x[LIFT] + share * (x[A] - x[LIFT]),
        ]

    def missed(self, x: Sequence[arb], u: arb, t: arb) -> list[arb]:
        """a, z and f at t within a step."""
        later = self.after(x, u, t)
        return [later[A], later[TILT] - later[A], later[LIFT] - later[A]]

    def missing(self, x: Sequence[arb], u: arb, t: arb) -> list[arb]:
        """The derivatives of z and f at t within a step, and a', a''."""
        later, band = self.after(x, u, t), self.value("BAND")
        slope = self.reached(t)[3]
        snap = band * band * (later[S] - later[A]) - 2 * band * later[J]
        lift = slope * (x[A] - x[LIFT]) - later[J]
        return [later[RATE] - later[J], lift, later[J], snap, later[S]]

    def matrix(self, of: Callable[[Sequence[arb], arb, arb], list[arb]], t: arb) -> arb_mat:
        """A linear map of (x, u), by its columns, u the last."""
        units = [[arb(int(i == k)) for i in range(STATES + 1)] for k in range(STATES + 1)]
        columns = [of(e[:STATES], e[STATES], t) for e in units]
        return arb_mat([list(row) for row in zip(*columns, strict=True)])

    @cached_property
    def pulses(self) -> arb_mat:
        """(STATES + 1, STEPS): the states k steps after u was 1 for one, and u itself."""
        step = self.matrix(self.after, self.value("STEP"))
        x = [arb(0)] * STATES
        samples = []
        for k in range(STEPS):
            samples.append([*x, arb(int(k == 0))])
            column = step * arb_mat([[v] for v in samples[-1]])
            x = [column[i, 0] for i in range(STATES)]
        return arb_mat([list(row) for row in zip(*samples, strict=True)])

    @cached_property
    def beyond(self) -> arb:
        """What STEPS and more add to a sum of |x_i| over a pulse, at most, for any state i."""
        step = self.matrix(self.after, self.value("STEP"))
        own = arb_mat([[step[i, k] for k in range(STATES)] for i in range(STATES)])
        power = own
        for _ in range(STEPS - 1):
            power = power * own
        share = norm(power)
        if not share < exact(0.5):
            message = "the loop's responses do not die out"
            raise ValueError(message)
        sizes = [
            max((abs(self.pulses[i, k]).upper() for i in range(STATES)), key=float)
            for k in range(STEPS)
        ]
        # x_0 is nothing, u is 1 then: `power` turns x_k into x_(k + STEPS) from k = 1 on
        first = norm(step * arb_mat([[self.pulses[i, STEPS - 1]] for i in range(STATES + 1)]))
        return (first + sum(sizes, arb(0)) * share) / (1 - share)

    def responses(self, of: Callable[..., list[arb]], t: arb) -> tuple[list[list[arb]], list[arb]]:
        """The pulse responses of some outputs at t within a step, and what lies beyond them."""
        rows = self.matrix(of, t)
        responses = rows * self.pulses
        tails = [
            self.beyond * sum((abs(rows[i, k]) for k in range(STATES)), arb(0))
            for i in range(rows.nrows())
        ]
        return [[responses[i, k] for k in range(STEPS)] for i in range(rows.nrows())], tails


def norm(m: arb_mat) -> arb:
    """The largest sum of a row's magnitudes."""
    rows = [sum((abs(m[i, k]) for k in range(m.ncols())), arb(0)) for i in range(m.nrows())]
    return max((r.upper() for r in rows), key=float)


def total(row: Sequence[arb], tail: arb) -> float:
    """A double no smaller than the sum of magnitudes: the most that |u| <= 1 can reach."""
    return upper(sum((abs(x) for x in row), arb(0)) + tail)


@dataclass(frozen=True)
class Reach:
    """What an axis reaches with |u| <= 1, whatever the set-points; (SLABS,) by slabs of |a|."""

    tilt: Floats
    lift: Floats
    apart: Floats
    """|z|, |f| and |f - z|."""
    jerk: float
    snap: float
    stage: float
    """|a'|, |a''| and |s|."""


def rates(loop: Loop) -> list[float]:
    """|z'|, |f'|, |a'|, |a''| and |s| at most, at any time."""
    step = loop.value("STEP")
    maxima: list[float] = []
    for part in range(PARTS):
        t = step * (exact(part + 0.5) / PARTS + arb(0, 0.5) / PARTS)
        rows, tails = loop.responses(loop.missing, t)
        now = [total(r, e) for r, e in zip(rows, tails, strict=True)]
        maxima = [max(x, y) for x, y in zip(maxima or now, now, strict=True)]
    return maxima


def reach_of(loop: Loop) -> Reach:
    """By the sum of a response's magnitudes, and by those of z + m a, f + m a and f - z + m a."""
    speed = rates(loop)
    edges = np.linspace(0.0, 1.0, SLABS + 1)
    bounds = np.zeros((3, SLABS))
    step, slack = loop.value("STEP"), upper(loop.value("STEP")) / (2 * PARTS) * OUTWARD
    moving = (speed[0], speed[1], speed[0] + speed[1])  # of z, f and f - z
    for part in range(PARTS):
        rows, tails = loop.responses(loop.missed, step * exact(part + 0.5) / PARTS)
        a, tilt, lift = rows
        outputs = (tilt, lift, [y - x for x, y in zip(tilt, lift, strict=True)])
        ends = (tails[1], tails[2], tails[1] + tails[2])
        for i, (row, end) in enumerate(zip(outputs, ends, strict=True)):
            best = np.full((2, SLABS), np.inf)
            for m in SLOPES:
                slope = exact(m)
                both = [x + slope * y for x, y in zip(row, a, strict=True)]
                most = total(both, end + abs(slope) * tails[0])
                most += slack * (moving[i] + abs(m) * speed[2])
                # where a is in a slab on the high side, and where it is in one on the low side
                best[0] = np.minimum(best[0], most - np.minimum(m * edges[:-1], m * edges[1:]))
                best[1] = np.minimum(best[1], most + np.maximum(m * edges[:-1], m * edges[1:]))
            bounds[i] = np.maximum(bounds[i], best.max(axis=0))
    bounds = bounds * OUTWARD + 1e-15
    return Reach(bounds[0], bounds[1], bounds[2], speed[2], speed[3], speed[4])


def linear_part(reach: Reach, bound: Floats, gravity: float) -> Floats:
    """|b b' f + (1 - b b') z| by world axis, (3,), over all a with |a_i| <= bound_i: by cells."""
    if bound[2] >= gravity:
        message = "set-points up to free fall: b has no bound"
        raise ValueError(message)
    edges = np.linspace(0.0, 1.0, SLABS + 1)
    i, j, k, up = (x.ravel() for x in np.meshgrid(*[np.arange(SLABS)] * 3, [1.0, -1.0]))
    cells = np.stack([i, j, k])
    low, high = edges[cells] * bound[:, None], edges[cells + 1] * bound[:, None]
    vertical = np.sort(np.stack([gravity + up * low[2], gravity + up * high[2]]), axis=0)
    low[2], high[2] = vertical
    size_low = np.sqrt((low**2).sum(axis=0)) / OUTWARD
    size_high = np.sqrt((high**2).sum(axis=0)) * OUTWARD
    least, most = low / size_high / OUTWARD, np.minimum(high / size_low * OUTWARD, 1.0)
    tilt, lift, apart = (x[cells] * bound[:, None] for x in (reach.tilt, reach.lift, reach.apart))
    limits = np.zeros(3)
    for axis in range(3):
        ends = (least[axis] ** 2, most[axis] ** 2)
        total_here = np.maximum(*(w * lift[axis] + (1 - w) * tilt[axis] for w in ends))
        for other in {0, 1, 2} - {axis}:
            total_here = total_here + most[axis] * most[other] * apart[other]
        limits[axis] = total_here.max() * OUTWARD
    return limits


@dataclass(frozen=True)
class Bound:
    """A place: the set-points' bounds by world axis, (3,), and what is derived of them."""

    place: str
    constants: dict[str, Any]
    asked: Floats
    """The same by the axes of the topic that carries them, (3,)."""
    bound: Floats
    frames: Floats
    """(N, 3, 3): the axes on which RESIDUAL is counted on, as rows."""
    reach: Reach

    @cached_property
    def linear(self) -> Floats:
        """|linear part| by world axis, (3,) in m/s^2."""
        return linear_part(self.reach, self.bound, float(self.constants["iris.GRAVITY"]))

    @property
    def counted(self) -> Floats:
        """The same by the axes that RESIDUAL is about, (3,)."""
        return np.asarray((np.abs(self.frames) @ self.linear).max(axis=0)) * OUTWARD

    @property
    def left(self) -> Floats:
        """What is left of RESIDUAL for the rest, (3,)."""
        return np.asarray(self.residual - self.counted)

    @cached_property
    def stepped(self) -> Floats:
        """A step of the linear loop in doubles, (STATES, STATES + 1), the set-point's last."""
        loop = Loop(self.constants)
        step = loop.matrix(loop.after, loop.value("STEP"))
        return np.array([[float(step[i, k]) for k in range(STATES + 1)] for i in range(STATES)])

    @property
    def residual(self) -> float:
        """RESIDUAL of the proof, m/s^2."""
        return float(self.constants["RESIDUAL"])


@cache
def derived(place: str, folder: Path = DRONE) -> Bound:
    """The bounds of laps or of corridors, all constants out of the program."""
    checked = check_file(str(folder / PLACES[place]))
    program = checked.program
    assert program is not None
    known = {n: c.value for n, c in program.consts.items()}
    asked = gate(system_of(checked, "Protected"))
    reach = reach_of(Loop(known))
    if place == "corridors":
        return Bound(place, known, asked, asked, np.eye(3)[None], reach)
    frames = np.array([[t[1], t[2], t[3]] for t in known["city.TUBES"]])
    turned = np.einsum("nij,i->nj", np.abs(frames), asked).max(axis=0) * OUTWARD
    return Bound(place, known, asked, turned, frames, reach)


def gate(system: System) -> Floats:
    """The most that a set-point may have on each of its axes, (3,): the set of the gated topic."""
    (control,) = (t for t in system.topics if t.name.rsplit(".", 1)[-1] == "control")
    return np.array([max(-b.low, b.high) if b else np.inf for b in control.bounds])


FLIGHTS = {
    "laps": ("adversaries.soter", ("Shaken", "Reversing", "Rhythmic", "Jerking")),
    "corridors": ("corridor_adversaries.soter", ("Rhythmic", "Jerking", "Twitching")),
}
FIRST_SEED = 40_000


def vectors(record: Any) -> Floats:
    """A Vec3 field of a trace as (N, 3)."""
    return np.stack([record[n] for n in "xyz"], axis=1)


def thrusts(bound: Bound, trace: Any) -> Floats:
    """Thrust over mass, (N, 3) in the world."""
    q, spin = trace["d"]["q"], trace["d"]["spin"]
    speeds = sum(spin[n] ** 2 for n in spin.dtype.names)
    lift = bound.constants["iris.THRUST"] / bound.constants["iris.MASS"] * speeds
    w, x, y, z = (q[n] for n in "wxyz")
    n = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    return np.asarray(lift[:, None] * n)


def followed(bound: Bound, filtered: Floats) -> Floats:
    """All states of the linear loop, (N, 7, 3), given those of the filter, (N, 3, 3)."""
    step = bound.stepped[:, :STATES]
    states = np.zeros((len(filtered), STATES, 3))
    states[:, :TILT] = filtered
    for k in range(len(filtered) - 1):
        states[k + 1, TILT:] = step[TILT:] @ states[k]
    return states


def seen(bound: Bound, run: Any) -> Seen:
    """By quantity the most that a flight shows, and what is derived of it; m, s."""
    trace, topics = run.trace, run.trace["topics"]
    names = {n.rsplit(".", 1)[-1]: n for n in topics.dtype.names}
    ref = topics[names["reference"]]
    # what `reference` holds after instant k is the filter's state at instant k + 1
    filtered = np.stack([vectors(ref[n])[:-1] for n in "ajs"], axis=1)
    filtered = np.concatenate([np.zeros((1, 3, 3)), filtered])
    x = followed(bound, filtered)
    a = x[:, A]
    tilt, lift = x[:, TILT] - a, x[:, LIFT] - a
    t = a + np.array([0.0, 0.0, bound.constants["iris.GRAVITY"]])
    b = t / np.linalg.norm(t, axis=1)[:, None]
    linear = tilt + b * ((lift - tilt) * b).sum(axis=1)[:, None]
    frame = np.broadcast_to(bound.frames[0], (len(trace), 3, 3))
    if "tubeState" in names:
        frame = bound.frames[topics[names["tubeState"]]["leg"].astype(int)]
    rest = np.einsum("nij,nj->ni", frame, thrusts(bound, trace) - t - linear)
    band = bound.constants["iris.BAND"]
    snap = band**2 * (x[:, S] - a) - 2 * band * x[:, J]
    own, reach = bound.bound, bound.reach
    quantities: dict[str, tuple[Floats, Floats]] = {
        "a_ref": (a, own),
        "a_ref'": (x[:, J], reach.jerk * own),
        "a_ref''": (snap, reach.snap * own),
        "s": (x[:, S], reach.stage * own),
        "z, of the attitude loop": (tilt, reach.tilt.max() * own),
        "f, of the lift": (lift, reach.lift.max() * own),
        "linear part": (linear, bound.linear),
        "rest": (rest, bound.left),
    }
    most = {n: np.abs(value).max(axis=0) for n, (value, _) in quantities.items()}
    return {
        f"{n} {'xyz'[i]}": (float(most[n][i]), float(limit[i]))
        for n, (_, limit) in quantities.items()
        for i in range(3)
    }


def flown(bound: Bound, seeds: range, seconds: int, file: Path, name: str) -> Seen:
    """The same over flights of a system of hostile ACs."""
    program = NativeProgram(system_of(check_file(str(file)), name))
    extremes: Seen = {}
    for seed in seeds:
        run = program.run(seconds * 10**9, seed, keep_trace=True)
        for n, (most, limit) in seen(bound, run).items():
            extremes[n] = (max(most, extremes.get(n, (0.0, 0.0))[0]), limit)
    return extremes


def told(bounds: Sequence[Bound]) -> str:
    """The table of what is derived: a bound rounded up, and what is left of RESIDUAL down."""
    rows = []
    for b in bounds:
        for i, most in enumerate(b.counted):
            up = np.ceil(most * DIGITS) / DIGITS
            left = np.floor(b.left[i] * DIGITS) / DIGITS
            rows.append((b.place, "xyz"[i], f"{up:.4f}", f"{b.residual:.4f}", f"{left:.4f}"))
    return table(("", "axis", "linear part", "RESIDUAL", "left for the rest"), rows)


def main() -> int:
    """Derive, print, fly; exit code 1 where nothing is left or a flight is beyond a bound."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--flights", type=int, default=20, help="of each hostile AC (20)")
    parser.add_argument("--seconds", type=int, default=60, help="of a flight (60)")
    chosen = parser.parse_args()
    bounds = [derived(place) for place in PLACES]
    print(told(bounds))
    print("\nm/s^2, for every sequence of set-points within the gate\n")
    seeds = range(FIRST_SEED, FIRST_SEED + chosen.flights)
    rows: list[tuple[str, ...]] = []
    beyond = 0
    for b in bounds:
        file, systems = FLIGHTS[b.place]
        each = [flown(b, seeds, chosen.seconds, DRONE / file, name) for name in systems]
        for n, (_, limit) in each[0].items():
            most = max(x[n][0] for x in each)
            beyond += most > limit
            word = "BEYOND" if most > limit else "ok"
            rows.append((b.place, n, f"{most:.4f}", f"{limit:.4f}", f"{most / limit:.1%}", word))
    print(table(("", "in hostile flights", "seen", "bound", "", ""), rows))
    return int(beyond > 0 or any((b.left <= 0).any() for b in bounds))


if __name__ == "__main__":
    sys.exit(main())
