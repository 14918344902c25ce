"""A cart between two walls, and what can be seen of its proofs by simulation alone.

Purpose: one program text with its figures as parameters; adversarial runs of it in NumPy, written
from the text and sharing nothing with prover or re-checker, that look for states which break a
claim of a certificate.
Non-goals: proving; other programs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

TEXT = """soter 1;
const A: float = {a};
type Motion = {{ x: float, v: float }};
topic motion: Motion max_age {age}ms;
topic accel: float in [-A, A] = 0.0;
plant Cart period 10ms {{
  reads accel;
  drives motion = {{ x: x, v: v }};
  state x: float in [-{start}, {start}];
  state v: float = 0.0;
  disturbance wind: float in [-{wind}, {wind}];
  der x = v;
  der v = accel + wind{pull};
  measured motion.x within {e_x}, motion.v within {e_v};
}}
node Fast period 50ms {{
  subscribes motion;
  publishes accel;
  step {{ publish accel = motion.v > 0.0 ? A : -A; }}
}}
node Careful period {delta}ms {{
  subscribes motion;
  publishes accel;
  step {{ publish accel = clamp(-{k_x} * motion.x - {k_v} * motion.v, -A, A); }}
}}
fun Stop(x: float, v: float, tau: float): float {{
  let w = max(v, 0.0) + 3.0 * tau;
  return x + max(v, 0.0) * tau + 1.5 * tau * tau + w * w / {brake};
}}
fun Fits(m: Motion, tau: float): bool {{
  return Stop(m.x, m.v, tau) < {room} && Stop(-m.x, -m.v, tau) < {room} && abs(m.v) < {room};
}}
rta SafeCart {{
  ac Fast;
  sc Careful;
  period {period}ms;
  safe abs(motion.x) < {wall};
  ttf !Fits(motion, {tau});
  safer Fits(motion, {tau_safer});
  verify {{
    grid motion.x in [-2.0, 2.0] / {cells_x}, motion.v in [-2.5, 2.5] / {cells_v};
    late sc {late}ms, dm 1ms;
  }}
}}
system Track default {{ c: Cart; module SafeCart; until 10s; }}
"""


@dataclass(frozen=True)
class Cart:
    """Every figure of the text; times in whole ms."""

    a: float = 3.0
    age: int = 20
    start: float = 0.1
    wind: float = 0.1
    e_x: float = 0.01
    e_v: float = 0.02
    delta: int = 50
    period: int = 50
    k_x: float = 2.0
    k_v: float = 2.5
    brake: float = 4.0
    room: float = 1.3
    wall: float = 2.0
    tau: float = 0.15
    tau_safer: float = 0.25
    late: int = 2
    drag: float = 0.0
    cells_x: int = 36
    cells_v: int = 24

    def text(self) -> str:
        """The program."""
        pull = f" - {self.drag} * v * abs(v)" if self.drag else ""
        return TEXT.format(pull=pull, **vars(self))

    def moved(self, x: Floats, v: Floats, rate: Floats, h: float) -> tuple[Floats, Floats]:
        """The states `h` later (or before) where command and wind are `rate`."""
        if self.drag:
            half = v + h / 2 * (rate - self.drag * v * np.abs(v))
            rate = rate - self.drag * half * np.abs(half)
        return x + h * v + rate * h * h / 2, v + h * rate

    @property
    def read_age(self) -> int:
        """How old a read of SC may be, in ms: up to `late` after its release; the plant has 10."""
        starts = (k * self.delta + late for k in range(10) for late in range(self.late + 1))
        return max(s % 10 for s in starts)

    @property
    def horizon(self) -> int:
        """H* in ms, SC waiting for the DM: both start at 0, so the gap is delta - gcd."""
        common = int(np.gcd(self.period, self.delta))
        return self.age + self.period + max(1, self.delta - common + self.late)


@dataclass(frozen=True, eq=False)
class Tables:
    """The sets of a certificate as arrays; `edges` for each axis."""

    edges: tuple[Floats, Floats]
    core: NDArray[Any]
    free: NDArray[Any]
    home: NDArray[Any]
    rank: NDArray[Any]
    rank_holds: NDArray[Any]

    def at(self, table: NDArray[Any], x: Floats, v: Floats) -> NDArray[Any]:
        """Entries of the cells that hold the states; 0 outside the grid."""
        i = np.searchsorted(self.edges[0], x, side="right") - 1
        j = np.searchsorted(self.edges[1], v, side="right") - 1
        inside = (i >= 0) & (i < table.shape[0]) & (j >= 0) & (j < table.shape[1])
        entries = table[np.clip(i, 0, table.shape[0] - 1), np.clip(j, 0, table.shape[1] - 1)]
        return np.where(inside, entries, 0)

    def sample(
        self, cells: NDArray[Any], count: int, draw: np.random.Generator
    ) -> tuple[Floats, Floats]:
        """States in the cells (rows of indices): anywhere, or a hair inside an edge."""
        chosen = cells[draw.integers(len(cells), size=count)]
        states = []
        for axis in (0, 1):
            low = self.edges[axis][chosen[:, axis]]
            high = self.edges[axis][chosen[:, axis] + 1]
            part = np.choose(draw.integers(3, size=count), [1e-9, draw.random(count), 1 - 1e-9])
            states.append(low + (high - low) * part)
        return states[0], states[1]


class Attack:
    """Looks for a state that breaks a claim about a cart."""

    def __init__(self, cart: Cart, tables: Tables, seed: int) -> None:
        self.cart, self.tables = cart, tables
        self.draw = np.random.default_rng(seed)

    # ------------------------------------------------------------ runs

    def _extreme(self, count: int, size: float) -> Floats:
        """At the bounds most of the time."""
        kind = self.draw.integers(5, size=count)
        any_ = self.draw.uniform(-size, size, count)
        return np.choose(kind, [-size, size, -size, size, any_])

    def _law(self, x: Floats, v: Floats) -> Floats:
        c = self.cart
        y_x = x + self._extreme(len(x), c.e_x)
        y_v = v + self._extreme(len(v), c.e_v)
        return np.clip(-c.k_x * y_x - c.k_v * y_v, -c.a, c.a)

    def sc_run(
        self, x: Floats, v: Floats, holds: NDArray[Any], watch: str
    ) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """SC from each state for so many holds: the end, and whether something bad was met.

        `watch`: "safe" (the wall), "safer" (an estimate on which it is false), "" (nothing).
        """
        c, count = self.cart, len(x)
        d, j = c.read_age, c.late
        most = int(holds.max())
        length = most * c.delta + j + 1
        xs, vs = np.empty((length + d + 1, count)), np.empty((length + d + 1, count))
        before = self._extreme(count, c.a) + self._extreme(count, c.wind)
        xs[d], vs[d] = x, v
        for s in range(d):
            xs[d - s - 1], vs[d - s - 1] = c.moved(xs[d - s], vs[d - s], before, -1e-3)
        acts = np.arange(most + 1)[:, None] * c.delta + self.draw.choice(
            [-j, 0, j], (most + 1, count)
        )
        acts[0] = 0
        old = self.draw.choice([0, d], (most + 1, count))
        wind = self._extreme(count, c.wind)
        command = np.zeros(count)
        bad = np.zeros(count, dtype=bool)
        end = acts[holds, np.arange(count)]
        every = np.arange(count)
        for t in range(length):
            due, columns = np.nonzero(acts == t)
            for k in np.unique(due):
                of = columns[due == k]
                sampled = t - old[k, of] + d
                command[of] = self._law(xs[sampled, of], vs[sampled, of])
            running = t <= end
            bad |= running & self._bad(xs[t + d], vs[t + d], watch)
            if t % 10 == 0:
                swap = self.draw.random(count) < 0.1
                wind = np.where(swap, self._extreme(count, c.wind), wind)
            xs[t + d + 1], vs[t + d + 1] = c.moved(xs[t + d], vs[t + d], command + wind, 1e-3)
        return xs[end + d, every], vs[end + d, every], bad

    def _bad(self, x: Floats, v: Floats, watch: str) -> NDArray[np.bool_]:
        if watch == "safe":
            return ~(np.abs(x) < self.cart.wall) | (np.abs(v) > 2.5)
        if watch == "safer":
            c = self.cart
            y_x, y_v = x + self._extreme(len(x), c.e_x), v + self._extreme(len(v), c.e_v)
            return ~self.fits(y_x, y_v, c.tau_safer)
        return np.zeros(len(x), dtype=bool)

    def fits(self, x: Floats, v: Floats, tau: float) -> NDArray[np.bool_]:
        """`Fits` of the text."""
        c = self.cart

        def stop(at: Floats, speed: Floats) -> Floats:
            w = np.maximum(speed, 0.0) + 3.0 * tau
            return at + np.maximum(speed, 0.0) * tau + 1.5 * tau * tau + w * w / c.brake

        return (stop(x, v) < c.room) & (stop(-x, -v) < c.room) & (np.abs(v) < c.room)

    # ------------------------------------------------------------ claims

    def broken(self, suspects: dict[str, NDArray[Any]], count: int = 3000) -> str:
        """The name of a claim that some run breaks; empty where none was found.

        `suspects`: cells to look at first, by table.
        """
        tests = (
            ("K", self._core),
            ("R", self._free),
            ("ttf", self._ttf),
            ("safer", self._safer),
            ("Q", self._home),
            ("W", self._rank),
            ("start", self._start),
        )
        for name, test in tests:
            if test(suspects.get(name), count).any():
                return name
        return ""

    def _cells(
        self, table: NDArray[Any], suspects: NDArray[Any] | None, count: int
    ) -> tuple[Floats, Floats] | None:
        """States in members of a table, half of them in suspect cells."""
        members = np.argwhere(table > 0)
        if len(members) == 0:
            return None
        x, v = self.tables.sample(members, count, self.draw)
        if suspects is not None and len(suspects):
            x2, v2 = self.tables.sample(suspects, count, self.draw)
            x, v = np.concatenate([x, x2]), np.concatenate([v, v2])
        return x, v

    def _core(self, suspects: NDArray[Any] | None, count: int) -> NDArray[np.bool_]:
        t = self.tables
        states = self._cells(t.core, suspects, count)
        if states is None:
            return np.ones(1, dtype=bool)
        holds = t.at(t.core, *states)
        x, v, bad = self.sc_run(*states, holds, "safe")
        left: NDArray[np.bool_] = bad | (t.at(t.core, x, v) == 0)
        return left

    def _free(self, suspects: NDArray[Any] | None, count: int) -> NDArray[np.bool_]:
        t = self.tables
        states = self._cells(t.free, suspects, count)
        if states is None:
            return np.zeros(1, dtype=bool)
        return self._driven(*states, self.cart.horizon)

    def _driven(self, x: Floats, v: Floats, time: int) -> NDArray[np.bool_]:
        """Whether bang-bang commands with one switch drive a state out of K in time."""
        c, t = self.cart, self.tables
        first = self._extreme(len(x), c.a) + self._extreme(len(x), c.wind)
        second = self._extreme(len(x), c.a) + self._extreme(len(x), c.wind)
        switch = self.draw.integers(time + 1, size=len(x))
        left: NDArray[np.bool_] = t.at(t.core, x, v) == 0
        for ms in range(time):
            x, v = c.moved(x, v, np.where(ms < switch, first, second), 1e-3)
            left |= t.at(t.core, x, v) == 0
        return left

    def _estimates(
        self, suspects: NDArray[Any] | None, count: int
    ) -> tuple[NDArray[np.bool_], Floats, Floats]:
        """Whether a safe true state is outside R, and an estimate of it."""
        t, c = self.tables, self.cart
        everywhere = np.argwhere(np.ones_like(t.free, dtype=bool))
        x, v = t.sample(everywhere, 4 * count, self.draw)
        if suspects is not None and len(suspects):
            x2, v2 = t.sample(suspects, count, self.draw)
            x, v = np.concatenate([x, x2]), np.concatenate([v, v2])
        outside = (t.at(t.free, x, v) == 0) & (np.abs(x) < c.wall)
        y_x, y_v = x + self._extreme(len(x), c.e_x), v + self._extreme(len(v), c.e_v)
        return outside, y_x, y_v

    def _ttf(self, suspects: NDArray[Any] | None, count: int) -> NDArray[np.bool_]:
        outside, x, v = self._estimates(suspects, count)
        return outside & self.fits(x, v, self.cart.tau)

    def _safer(self, suspects: NDArray[Any] | None, count: int) -> NDArray[np.bool_]:
        outside, x, v = self._estimates(suspects, count)
        return outside & self.fits(x, v, self.cart.tau_safer)

    def _home(self, suspects: NDArray[Any] | None, count: int) -> NDArray[np.bool_]:
        t = self.tables
        states = self._cells(t.home, suspects, count)
        if states is None:
            return np.ones(1, dtype=bool)
        x, v, bad = self.sc_run(*states, t.at(t.home, *states), "safer")
        left: NDArray[np.bool_] = bad | (t.at(t.home, x, v) == 0)
        return left

    def _rank(self, suspects: NDArray[Any] | None, count: int) -> NDArray[np.bool_]:
        t = self.tables
        if ((t.core > 0) & (t.home == 0) & (t.rank == 0)).any():
            return np.ones(1, dtype=bool)
        order = np.where(t.home > 0, 1, np.where(t.rank > 0, t.rank.astype(int) + 1, 0))
        states = self._cells((order > 1) * 1, suspects, count)
        if states is None:
            return np.zeros(1, dtype=bool)
        at = t.at(order, *states)
        holds = np.maximum(t.at(t.rank_holds, *states), 1).astype(int)
        x, v, _ = self.sc_run(*states, holds, "")
        after = t.at(order, x, v)
        wrong: NDArray[np.bool_] = (at > 1) & ((after == 0) | (after >= at))
        return wrong

    def _start(self, _: NDArray[Any] | None, count: int) -> NDArray[np.bool_]:
        c = self.cart
        x = self._extreme(count, c.start)
        return self._driven(x, np.zeros(count), c.late)
