"""Random problems, and adversaries against every set that is claimed about them.

    .venv/bin/python bench/verify/soundness.py [--problems 200] [--steps 10000000]

Purpose: for each problem of `random_problems.py` the engine's claims (K with witnesses, R(H), S_0
and the other levels) are attacked by simulations of their own: exact steps or RK4 of 1 ms in NumPy,
reads, releases and commands late, early and old by exactly what is declared, errors and
disturbances at their bounds. An *escape* is a state inside a claimed set from which a simulation
does what the claim excludes:
- K: an SC-run leaves C, or is outside K after the N periods of its cell's witness;
- R(H): some control leaves K within H;
- S_0: a state that such an estimate allows is not in R(H);
- closed loop: AC for as long as the DM (ttf := not S_0) lets it, SC after it: C is left;
- closed form: a cell of K holds a state that no law could save.
Beside that, how much is claimed (a tool that claims nothing is never wrong), and how much of what
is not claimed the adversary can be seen to win.
`--blind` shows that the adversaries are no paper tigers: the engine is told of no wind, no errors,
no delay, no jitter or half the horizon, and each time escapes must be seen.
Non-goals: the certificate's own check (`soter recheck`).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable  # noqa: TC003 - a table is declared with it
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.verify.random_problems import RandomProblem, problem  # noqa: E402 - needs the path

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]
    Bools = npt.NDArray[np.bool_]
    Ints = npt.NDArray[np.int64]

RUNS = 256
NAMES = ("K leaves C", "K misses its witness", "R(H)", "S_0", "loop", "form")


@dataclass(frozen=True)
class Claims:
    """What the engine claims, as arrays over the cells; `horizon` in ticks."""

    edges: tuple[Array, ...]
    witness: npt.NDArray[np.uint8]
    free: Bools
    levels: tuple[Bools, ...]
    horizon: int


@dataclass
class Findings:
    """Of one problem."""

    number: int
    family: str
    core_share: float = 0.0
    free_share: float = 0.0
    trust_share: float = 0.0
    steps: int = 0
    escapes: dict[str, int] = field(default_factory=dict)
    outside_lost: float | None = None
    """Share of runs from C without K that the adversary was seen to win."""
    note: str = ""


# ---------------------------------------------------------------- cells


class Cells:
    """Looks states up in sets of closed cells."""

    def __init__(self, edges: tuple[Array, ...]) -> None:
        self.edges = edges

    def index(self, x: Array) -> tuple[Ints, ...]:
        """A cell of each state (n, runs); states outside get the nearest one."""
        return tuple(
            np.clip(np.searchsorted(e, v, side="right") - 1, 0, len(e) - 2)
            for e, v in zip(self.edges, x, strict=True)
        )

    def find(self, cells: npt.NDArray[np.uint8], x: Array) -> npt.NDArray[np.uint8]:
        """The entry of a cell that holds each state, 0 outside.

        Cells are closed: at a border (within rounding) the largest entry around it.
        """
        entries = np.zeros(x.shape[1], dtype=np.uint8)
        inside = np.ones(x.shape[1], dtype=bool)
        for e, v in zip(self.edges, x, strict=True):
            inside &= (v >= e[0] - 1e-9) & (v <= e[-1] + 1e-9)
        for side in np.ndindex(*(2,) * len(self.edges)):
            nudge = 1e-9 * (2.0 * np.array(side) - 1.0)
            entries = np.maximum(entries, cells[self.index(x + nudge[:, None])])
        return np.where(inside, entries, 0).astype(np.uint8)

    def has(self, cells: Bools, x: Array) -> Bools:
        """Whether states lie in some cell of a set."""
        return np.asarray(self.find(cells.view(np.uint8), x), dtype=np.bool_)

    def draw(self, cells: Bools, runs: int, rng: np.random.Generator) -> Array | None:
        """States in cells of a set, half of them in cells at its border, many at corners."""
        chosen = np.argwhere(cells)
        if len(chosen) == 0:
            return None
        border = np.argwhere(cells & ~_eroded(cells))
        first = chosen[rng.integers(0, len(chosen), runs)]
        if len(border):
            first[: runs // 2] = border[rng.integers(0, len(border), runs // 2)]
        share = rng.random((runs, len(self.edges)))
        at_end = rng.random(share.shape) < 0.5
        share = np.where(at_end, np.round(share), share)
        columns = [
            e[first[:, i]] + share[:, i] * (e[first[:, i] + 1] - e[first[:, i]])
            for i, e in enumerate(self.edges)
        ]
        return np.array(columns)


def _eroded(cells: Bools) -> Bools:
    """Cells whose neighbours along every axis are in the set too."""
    out: Bools = cells.copy()
    for axis in range(cells.ndim):
        for step in (1, -1):
            moved = np.roll(cells, step, axis)
            edge: list[slice | int] = [slice(None)] * cells.ndim
            edge[axis] = 0 if step == 1 else -1
            moved[tuple(edge)] = False
            out = np.asarray(out & moved, dtype=np.bool_)
    return out


# ---------------------------------------------------------------- adversaries


class Adversary:
    """Disturbances, errors and controls, each run with a manner of its own."""

    def __init__(self, p: RandomProblem, runs: int, rng: np.random.Generator) -> None:
        self.p, self.runs, self.rng = p, runs, rng
        self.most_wind, self.most_error = np.array([p.wind]).T, np.array([p.error]).T
        self.kind = rng.integers(0, 4, runs)
        self.w = _sides(rng, (p.n, runs)) * self.most_wind
        self.e = _sides(rng, (p.n, runs)) * self.most_error
        self.push = _sides(rng, (runs,))
        self.hold = 2 ** rng.integers(0, 8, runs)

    def wind(self, x: Array, t: int) -> Array:
        """Constant, outward, switching, or random; (n, runs)."""
        outward = np.where(x >= 0.0, 1.0, -1.0) * self.most_wind
        turned = np.where((t // self.hold) % 2 == 0, 1.0, -1.0) * self.w
        chance = self.rng.uniform(-1.0, 1.0, x.shape) * self.most_wind
        return np.choose(self.kind[None, :] % 4, [self.w, outward, turned, chance])

    def error(self, x: Array) -> Array:
        """Constant, inward (the state looks better than it is), switching, or random."""
        inward = np.where(x >= 0.0, -1.0, 1.0) * self.most_error
        chance = _sides(self.rng, x.shape) * self.most_error
        late = np.where(self.rng.random(self.runs) < 0.5, 1.0, -1.0) * self.e
        return np.choose((self.kind[None, :] + 1) % 4, [self.e, inward, chance, late])

    def control(self, x: Array, t: int) -> Array:
        """Pushing one way, outward, switching, or random, within U; (runs,)."""
        ahead = x[0] + (x[1] if self.p.n > 1 else 0.0)
        outward = np.where(ahead >= 0.0, 1.0, -1.0)
        turned = np.where((t // self.hold) % 2 == 0, 1.0, -1.0) * self.push
        chance = self.rng.uniform(-1.0, 1.0, self.runs)
        chosen = np.choose(self.kind % 4, [self.push, outward, turned, chance])
        return self.p.control[0] * chosen

    def ticks(self, most: int) -> Ints:
        """A delay of 0 to `most` ticks a run, mostly at the ends."""
        if most == 0:
            return np.zeros(self.runs, dtype=np.int64)
        any_ = self.rng.integers(0, most + 1, self.runs)
        ends = np.where(self.rng.random(self.runs) < 0.5, 0, most)
        return np.where(self.rng.random(self.runs) < 0.7, ends, any_)


def _sides(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    return np.where(rng.random(shape) < 0.5, -1.0, 1.0)


class Past:
    """The last states of every run."""

    def __init__(self, states: int, runs: int, length: int) -> None:
        self.kept = np.zeros((length + 1, states, runs))
        self.runs = np.arange(runs)

    def put(self, t: int, x: Array) -> None:
        """Keep the states of tick t."""
        self.kept[t % len(self.kept)] = x

    def at(self, t: int, age: Ints) -> Array:
        """States `age` ticks before t, an age a run; (n, runs)."""
        states: Array = self.kept[(t - age) % len(self.kept), :, self.runs].T
        return states


# ---------------------------------------------------------------- the claims, attacked


def attack_core(
    p: RandomProblem, claims: Claims, x0: Array, ticks: int, seed: int
) -> tuple[int, int, int]:
    """SC-runs from x0: (runs that leave C, that are outside K when the witness says, steps)."""
    rng = np.random.default_rng(seed)
    runs = x0.shape[1]
    cells, foe = Cells(claims.edges), Adversary(p, runs, rng)
    past = Past(p.n, runs, p.d)
    before = p.control[0] * np.where(rng.random(runs) < 0.7, foe.push, rng.uniform(-1.0, 1.0, runs))
    x = x0
    for age in range(1, p.d + 1):  # what led here: any command of U
        x = p.move(x, before, foe.w, -1)
        past.put(-age, x)
    x, u = x0, before
    past.put(0, x0)
    holds = np.maximum(cells.find(claims.witness, x0), 1).astype(np.int64)
    number = np.zeros(runs, dtype=np.int64)
    due = np.zeros(runs, dtype=np.int64)
    began = np.zeros(runs, dtype=np.int64)
    left, missed = np.zeros(runs, dtype=bool), np.zeros(runs, dtype=bool)
    for t in range(ticks):
        acting = due == t
        if acting.any():
            back = acting & (number == holds)  # the witness: in K now, and a new chain may start
            if back.any():
                witness = cells.find(claims.witness, x)
                missed |= back & (witness == 0)
                holds = np.where(back, np.maximum(witness, 1), holds)
                number = np.where(back, 0, number)
                began = np.where(back, t, began)
            y = past.at(t, foe.ticks(p.d)) + foe.error(x)
            u = np.where(acting, p.law(y), u)
            number = np.where(acting, number + 1, number)
            jitter = foe.ticks(2 * p.j) - p.j
            due = np.where(acting, np.maximum(began + number * p.times.sc + jitter, t + 1), due)
        x = p.move(x, u, foe.wind(x, t))
        past.put(t + 1, x)
        left |= ~p.safe(x)
    return int(left.sum()), int(missed.sum()), runs * ticks


def attack_free(p: RandomProblem, claims: Claims, x0: Array, seed: int) -> tuple[int, int]:
    """Any control for H from x0: (runs outside K at some instant, steps)."""
    rng = np.random.default_rng(seed)
    cells, foe = Cells(claims.edges), Adversary(p, x0.shape[1], rng)
    core = claims.witness != 0
    x = x0
    out = ~cells.has(core, x)
    for t in range(claims.horizon):
        x = p.move(x, foe.control(x, t), foe.wind(x, t))
        out |= ~cells.has(core, x)
    return int(out.sum()), x0.shape[1] * claims.horizon


def attack_loop(  # noqa: PLR0915 - one tick of a whole loop, from top to bottom
    p: RandomProblem, claims: Claims, estimate: Array, ticks: int, seed: int
) -> tuple[int, int, int]:
    """The whole closed loop: (runs that leave C, starts outside R(H), steps).

    It starts with a verdict for AC on a sample of a state with this estimate, and the next DM step
    as late as can be. SC waits for the verdict of every DM step that was released by its own
    release (docs/proof.md); its publication is gated when it is made.
    """
    rng = np.random.default_rng(seed)
    runs, of = estimate.shape[1], p.times
    cells, foe = Cells(claims.edges), Adversary(p, runs, rng)
    trust, give_back = claims.levels[0], claims.levels[-1]
    x0 = estimate - foe.error(estimate)
    surprised = ~cells.has(claims.free, x0)
    past = Past(p.n, runs, of.max_age)
    past.put(0, x0)
    for age in range(1, of.max_age + 1):
        past.put(-age, x0)
    x, mode, sc_acts = x0, np.ones(runs, dtype=bool), np.zeros(runs, dtype=bool)
    first = of.max_age + of.dm
    never = np.int64(2**40)
    verdict_at = np.full(runs, never)
    verdict = np.ones(runs, dtype=bool)
    dm_start, dm_out = np.full(runs, never), np.zeros(runs, dtype=np.int64)
    sc_start, publish_at, act_at = (np.full(runs, never) for _ in range(3))
    wanted, coming, u_sc = np.zeros(runs), np.zeros(runs), np.zeros(runs)
    left = np.zeros(runs, dtype=bool)
    for t in range(ticks):
        dm_due = t >= first and (t - first) % of.dm == 0
        if dm_due:
            dm_start = t + foe.ticks(of.late_dm)
            dm_out = dm_start + foe.ticks(of.response_dm)
        if (t - first) % of.sc == 0:
            sc_start = np.maximum(t + foe.ticks(of.late_sc), dm_out)
        now = dm_start == t
        if now.any():
            seen = past.at(t, foe.ticks(of.max_age)) + foe.error(x)
            fine = np.where(mode, cells.has(trust, seen), cells.has(give_back, seen))
            verdict = np.where(now, fine, verdict)
            verdict_at = np.where(now, dm_out, verdict_at)
        if (verdict_at == t).any():
            came = verdict_at == t
            mode = np.where(came, verdict, mode)
            sc_acts &= ~mode
        now = sc_start == t
        if now.any():
            wanted = np.where(now, p.law(past.at(t, foe.ticks(of.max_age)) + foe.error(x)), wanted)
            publish_at = np.where(now, t + foe.ticks(of.response_sc), publish_at)
        now = publish_at == t
        if now.any():
            passed = now & ~mode
            coming = np.where(passed, wanted, coming)
            act_at = np.where(passed, t + foe.ticks(of.acts), act_at)
        now = (act_at == t) & ~mode
        u_sc = np.where(now, coming, u_sc)
        sc_acts |= now
        u = np.where(sc_acts & ~mode, u_sc, foe.control(x, t))
        x = p.move(x, u, foe.wind(x, t))
        past.put(t + 1, x)
        left |= ~p.safe(x)
    return int(left.sum()), int(surprised.sum()), runs * ticks


def lost_by_form(p: RandomProblem, claims: Claims) -> int:
    """Cells of K with a corner that no law could save (closed form)."""
    corners = np.argwhere(claims.witness != 0)
    loss_mask = np.zeros(len(corners), dtype=bool)
    for side in np.ndindex(*(2,) * p.n):
        x = np.array([e[corners[:, i] + side[i]] for i, e in enumerate(claims.edges)])
        if x.size:
            loss_mask |= p.surely_lost(x)
    return int(loss_mask.sum())


# ---------------------------------------------------------------- one problem


def claims_of(p: RandomProblem) -> tuple[Claims | None, str]:
    """What `soter verify` claims about the problem, and a note where it claims nothing.

    K, R(H) and the levels, by the very functions that `soter verify` calls; P2b, which takes most
    of its time, is left out.
    """
    from soter.diagnostics.diagnostic import SoterError  # noqa: PLC0415 - slow
    from soter.language.front_end import check_file, system_of  # noqa: PLC0415
    from soter.verify.claims import claims  # noqa: PLC0415
    from soter.verify.enclose.compiled_enclosures import library_of  # noqa: PLC0415
    from soter.verify.grid.group_model import UnboundedError  # noqa: PLC0415
    from soter.verify.problem.extract import extract  # noqa: PLC0415

    try:
        system = system_of(check_file(f"random{p.seed}.soter", p.text), "S")
        problem = extract(system, system.modules[0])
        library, _ = library_of(problem)
        case = claims.open_case(problem, library, problem.groups, (), None)
        if not (claims.compute_constraint(case) and claims.compute_core(case)):
            return None, "; ".join(f.text for f in case.failures)
        claims.compute_free_states(case)
        claims.compute_levels(case)
    except SoterError as error:
        return None, "; ".join(d.message for d in error.diagnostics)
    except UnboundedError as error:
        return None, str(error)
    (group,) = case.sets.groups
    if group.free is None:
        return None, "no R(H)"
    times = problem.times
    horizon_ns = times.horizon if times.horizon is not None else _h_star(p)
    tick_ns = 10**9 if p.is_map else 10**6
    edges = tuple(np.array(e) for e in group.edges)
    free = np.asarray(group.free, dtype=bool)
    levels = tuple(np.asarray(level, dtype=bool) for level in group.levels)
    if not levels:  # a DM of our own from R(H)
        trust = shrunk(free, edges, np.array(p.error))
        levels = (trust, shrunk(trust, edges, 0.02 * np.array(p.box)))
    core = np.asarray(group.core).reshape(free.shape)
    return Claims(edges, core, free, levels, horizon_ns // tick_ns), ""


def shrunk(cells: Bools, edges: tuple[Array, ...], by: Array) -> Bools:
    """Cells all of whose points may be off by `by` and still lie in the set."""
    out = cells
    for axis, (e, far) in enumerate(zip(edges, by, strict=True)):
        n = len(e) - 1
        first = np.searchsorted(e, e[:-1] - far - 1e-12, side="left") - 1
        last = np.searchsorted(e, e[1:] + far + 1e-12, side="right") - 1
        before = np.moveaxis(out, axis, 0)
        rows = [
            np.zeros(before.shape[1:], dtype=bool)
            if far > 0.0 and (first[i] < 0 or last[i] >= n)
            else before[max(first[i], 0) : min(last[i], n - 1) + 1].all(axis=0)
            for i in range(n)
        ]
        out = np.moveaxis(np.array(rows), 0, axis)
    return out


def _h_star(p: RandomProblem) -> int:
    """H* in ns, from docs/verification.md, with phases 0."""
    t = p.times
    if p.is_map:
        return t.dm * 10**9
    gap = t.sc - int(np.gcd(t.dm, t.sc))
    waits = max(t.late_dm + t.response_dm, gap + t.late_sc)
    return (t.max_age + t.dm + waits + t.response_sc + t.acts) * 10**6


def examine(p: RandomProblem, claims: Claims | None, steps: int, note: str = "") -> Findings:
    """Attack every claim with about `steps` simulated steps in all."""
    f = Findings(p.seed, p.family, note=note)
    if claims is None:
        return f
    core = claims.witness != 0
    cells = Cells(claims.edges)
    rng = np.random.default_rng(p.seed)
    f.core_share, f.free_share = float(core.mean()), float(claims.free.mean())
    f.trust_share = float(claims.levels[0].mean()) if claims.levels else 0.0
    f.escapes = dict.fromkeys(NAMES, 0)
    f.escapes["form"] = lost_by_form(p, claims)
    long = 200 if p.is_map else 2000
    attacks: list[tuple[Bools, Callable[[Array, int], tuple[int, ...]], tuple[str, ...]]] = [
        (
            core,
            lambda x, seed: attack_core(p, claims, x, long, seed),
            ("K leaves C", "K misses its witness"),
        ),
        (claims.free, lambda x, seed: attack_free(p, claims, x, seed), ("R(H)",)),
    ]
    if claims.levels:
        attacks.append(
            (
                claims.levels[0],
                lambda x, seed: attack_loop(p, claims, x, long, seed),
                ("loop", "S_0"),
            )
        )
    for number, (source, run, names) in enumerate(attacks):
        spent, round_ = 0, 0
        while spent < steps / len(attacks):
            x0 = cells.draw(source, RUNS, rng)
            if x0 is None:
                break
            *bad, done = run(x0, 1000 * round_ + number)
            spent += done
            round_ += 1
            for name, count in zip(names, bad, strict=True):
                f.escapes[name] += count
        f.steps += spent
    outside = cells.draw(~core, RUNS, rng)
    if outside is not None:
        lost, _, done = attack_core(p, claims, outside, long, 7)
        f.steps += done
        f.outside_lost = lost / RUNS
    return f


def main() -> int:
    """Run, print, write; 1 if anything escaped."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--problems", type=int, default=200)
    parser.add_argument("--steps", type=float, default=1e7)
    parser.add_argument(
        "--blind", action="store_true", help="hide things from the engine: there must be escapes"
    )
    arguments = parser.parse_args()
    if arguments.blind:
        return blinded(arguments.problems)
    findings = []
    for k in range(arguments.problems):
        p = problem(k)
        began = time.perf_counter()
        claims, note = claims_of(p)
        engine_s = time.perf_counter() - began
        f = examine(p, claims, int(arguments.steps / arguments.problems), note)
        findings.append(f)
        bad = sum(f.escapes.values())
        if bad or f.note or arguments.problems <= 16:
            print(
                f"{k:4} {p.family:10} K {f.core_share:.3f} R {f.free_share:.3f} "
                f"S0 {f.trust_share:.3f} lost outside {f.outside_lost} engine {engine_s:.1f} s "
                f"{f.escapes if bad else ''} {f.note}",
                flush=True,
            )
        if len(findings) % 10 == 0:
            print(f"{len(findings)} of {arguments.problems}", file=sys.stderr, flush=True)
    return told(findings)


def timed(p: RandomProblem, **ticks: int) -> RandomProblem:
    """The same with other times."""
    return replace(p, times=replace(p.times, **ticks))


HIDDEN: dict[str, Callable[[RandomProblem], RandomProblem]] = {
    "nothing": lambda p: p,
    "wind": lambda p: replace(p, wind=(0.0,) * p.n),
    "errors": lambda p: replace(p, error=(0.0,) * p.n),
    "delay": lambda p: timed(
        p, max_age=min(p.times.max_age, p.times.sensor), response_sc=0, acts=0
    ),
    "jitter": lambda p: timed(p, late_dm=0, late_sc=0, response_dm=0, response_sc=0, acts=0),
    "half of H*": lambda p: replace(p, horizon=max(_h_star(p) // 2, 10**9 if p.is_map else 1)),
}

WORSE: dict[str, Callable[[RandomProblem], RandomProblem]] = {
    "delay": lambda p: p if p.is_map else timed(p, max_age=200),
    "jitter": lambda p: p if p.is_map else timed(p, late_sc=p.times.sc // 2 - 2),
}
"""What is hidden is first made large: a cell hides a few milliseconds."""


def blinded(count: int) -> int:
    """Attack what is claimed by an engine that is not told everything; 1 if all is well."""
    print(f"{'hidden from the engine':24} {'problems with escapes':>22} {'escapes':>9}  which")
    wrong = 0
    for name, hide in HIDDEN.items():
        kinds: dict[str, int] = {}
        problems = 0
        for k in range(count):
            p = WORSE.get(name, HIDDEN["nothing"])(problem(k))
            claims, note = claims_of(hide(p))
            f = examine(p, claims, 500_000, note)
            problems += any(f.escapes.values())
            for kind, n in f.escapes.items():
                kinds[kind] = kinds.get(kind, 0) + n
        escapes = sum(kinds.values())
        seen = ", ".join(f"{kind} {count}" for kind, count in kinds.items() if count)
        print(f"{name:24} {problems:22} {escapes:9}  {seen}", flush=True)
        wrong += (escapes > 0) == (name == "nothing")
    return 1 if wrong else 0


def told(findings: list[Findings]) -> int:
    """A row a family, then of all; 1 if anything escaped."""
    print(
        f"{'family':10} {'problems':>8} {'K > 1 %':>8} {'mean K':>7} {'mean R':>7} {'escapes':>8}"
    )
    for family in dict.fromkeys(f.family for f in findings):
        own = [f for f in findings if f.family == family]
        core = float(np.mean([f.core_share for f in own]))
        free = float(np.mean([f.free_share for f in own]))
        some = sum(f.core_share > 0.01 for f in own)
        bad = sum(sum(f.escapes.values()) for f in own)
        print(f"{family:10} {len(own):8} {some:8} {core:7.3f} {free:7.3f} {bad:8}")
    shares = np.array([(f.core_share, f.free_share, f.trust_share) for f in findings])
    core, free, trust = (shares > 0.01).sum(axis=0)
    print(
        f"{len(findings)} problems, {core} with a K of more than 1 % of the "
        f"grid, {free} with such an R(H), {trust} with such an S_0"
    )
    escapes = sum(sum(f.escapes.values()) for f in findings)
    print(f"{sum(f.steps for f in findings):,} adversarial steps; escapes: {escapes} (target 0)")
    outside = [f.outside_lost for f in findings if f.outside_lost is not None]
    print(
        f"of runs that start in C outside K the adversary was seen to win "
        f"{float(np.mean(outside)) if outside else 0.0:.0%}: "
        f"the rest is an upper bound of what K lacks"
    )
    return 1 if escapes else 0


if __name__ == "__main__":
    sys.exit(main())
