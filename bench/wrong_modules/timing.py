"""Wrong modules because of time: lateness, waiting, phases, horizons.

Purpose: `TIMING`, each with a simulation of its own, as lateness does not show in a run in virtual
time. `Loop` has plant, sensor, DM, SC and AC on a clock of 1 ms, one thread in which SC waits for
every DM that is due, the gate, and latencies; it is written from the definitions, nothing here
comes from `soter`.
Non-goals: ages along paths (`paths.txt`); the worst lateness by search: a handful of patterns and
starts is tried.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from bench.wrong_modules.base import LINE, MAP, RING, Shown, Wrong

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bench.rows import Edit

State = tuple[float, ...]
Pattern = "Callable[[int], int]"


@dataclass(frozen=True)
class Loop:
    """Times are whole milliseconds. `late` and its like give those of release k."""

    move: Callable[[State, float], State]
    """The plant over 1 ms under a command."""
    safe: Callable[[State], bool]
    law: Callable[[State], float]
    ttf: Callable[[State], bool]
    safer: Callable[[State], bool]
    push: Callable[[State, int], float]
    """AC, which sees everything; it publishes at every instant, and acts at once."""
    start: State
    first: float = 0.0
    """The command before anything was published."""
    dm: int = 50
    sc: int = 50
    phase_sc: int = 0
    sensor: int = 10
    late_dm: Callable[[int], int] = field(default=lambda _: 0)
    response_dm: Callable[[int], int] = field(default=lambda _: 0)
    late_sc: Callable[[int], int] = field(default=lambda _: 0)
    response_sc: Callable[[int], int] = field(default=lambda _: 0)
    acts: Callable[[int], int] = field(default=lambda _: 0)
    max_age: int = 20
    until: int = 10_000

    def run(self) -> float | None:
        """When it leaves C, in s."""
        return _Running(self).run()


class _Running:
    """One run: what is due when."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.x = loop.start
        self.u = loop.first
        self.seen = loop.start
        self.stamp = 0
        self.ac = False
        self.busy = 0
        """Until then the thread of the DM is not free."""
        self.decisions: dict[int, list[int]] = {}
        self.verdicts: list[tuple[int, bool]] = []
        self.steps: dict[int, list[int]] = {}
        self.outputs: list[tuple[int, float, int]] = []
        self.effects: list[tuple[int, float]] = []
        self.waiting: list[tuple[int, int]] = []

    def run(self) -> float | None:
        loop = self.loop
        for t in range(loop.until):
            if t % loop.sensor == 0:
                self.seen, self.stamp = self.x, t
            self._decide(t)
            self._control(t)
            self.x = loop.move(self.x, self.u)
            if not loop.safe(self.x):
                return (t + 1) / 1000.0
        return None

    def _decide(self, t: int) -> None:
        loop = self.loop
        if t % loop.dm == 0:
            k = t // loop.dm
            begins = max(t + loop.late_dm(k), self.busy)
            self.busy = begins + loop.response_dm(k)
            self.decisions.setdefault(begins, []).append(k)
        for k in self.decisions.pop(t, ()):
            fresh = t - self.stamp <= loop.max_age
            fine = not loop.ttf(self.seen) if self._latest() else loop.safer(self.seen)
            self.verdicts.append((t + loop.response_dm(k), fine and fresh))
        while self.verdicts and self.verdicts[0][0] <= t:
            self.ac = self.verdicts.pop(0)[1]

    def _latest(self) -> bool:
        return self.verdicts[-1][1] if self.verdicts else self.ac

    def _control(self, t: int) -> None:
        loop = self.loop
        if t >= loop.phase_sc and (t - loop.phase_sc) % loop.sc == 0:
            k = (t - loop.phase_sc) // loop.sc
            self.waiting.append((max(t + loop.late_sc(k), self.busy), k))
        for begins, k in [w for w in self.waiting if w[0] <= t]:
            self.waiting.remove((begins, k))
            self.outputs.append((t + loop.response_sc(k), loop.law(self.seen), k))
        for at, u, k in [o for o in self.outputs if o[0] <= t]:
            self.outputs.remove((at, u, k))
            if not self.ac:
                self.effects.append((t + loop.acts(k), u))
        if self.ac:
            self.effects = []
            self.u = loop.push(self.x, t)
        while self.effects and self.effects[0][0] <= t:
            self.u = self.effects.pop(0)[1]


PATTERNS: tuple[Callable[[int], Callable[[int], int]], ...] = (
    lambda most: lambda _: most,
    lambda most: lambda k: most if k % 2 == 0 else 0,
    lambda most: lambda k: most if k % 2 == 1 else 0,
    lambda most: lambda k: most if (k * 2654435761 >> 7) % 3 == 0 else 0,
)
"""Always late, every other time, now and then."""


def variants(
    loop: Loop, late_dm: int, response_dm: int, late_sc: int, response_sc: int, acts: int
) -> Iterator[Loop]:
    """The loop with its times at their bounds, in a few patterns."""
    for make in PATTERNS:
        yield replace(
            loop,
            late_dm=make(late_dm),
            response_dm=make(response_dm),
            late_sc=make(late_sc),
            response_sc=make(response_sc),
            acts=make(acts),
        )


def line(x: State, u: float) -> State:
    """X' = u."""
    return (x[0] + 0.001 * u,)


def mode(omega: float) -> Callable[[State, float], State]:
    """y1' = omega y2, y2' = -omega y1 + u: exactly."""
    c, s = math.cos(0.001 * omega), math.sin(0.001 * omega)
    b1, b2 = (1.0 - c) / omega, s / omega

    def move(y: State, u: float) -> State:
        return (c * y[0] + s * y[1] + b1 * u, -s * y[0] + c * y[1] + b2 * u)

    return move


@dataclass(frozen=True)
class Times:
    """Of a module on LINE, in ms; `far` and `near` are the thresholds of `ttf` and `safer`."""

    far: float
    near: float = 0.3
    dm: int = 50
    sc: int = 50
    phase: int = 0
    late_dm: int = 0
    late_sc: int = 0
    response_dm: int = 0
    response_sc: int = 0
    acts: int = 0
    sensor: int = 10
    max_age: int = 20
    horizon: int | None = None
    wall: float = 1.0
    start: float | None = None
    """Where it starts; None: anywhere where `safer` may hold."""
    first: float = 0.0
    gain: float = 2.0

    @property
    def edits(self) -> tuple[Edit, ...]:
        """LINE with these."""
        horizon = "" if self.horizon is None else f"\n    horizon {self.horizon}ms;"
        begin = 0.0 if self.start is None else self.start
        edits = (
            ("float max_age 20ms", f"float max_age {self.max_age}ms"),
            (
                "= 0.0;\n\nplant Line period 10ms",
                f"= {self.first};\n\nplant Line period {self.sensor}ms",
            ),
            ("state x: float = 0.0;", f"state x: float = {begin};"),
            ("node Careful period 50ms", f"node Careful period {self.sc}ms phase {self.phase}ms"),
            ("clamp(-4.0 * pos", f"clamp(-{self.gain} * pos"),
            (
                "  period 50ms;\n  safe abs(pos) < 1.0;",
                f"  period {self.dm}ms;\n  safe abs(pos) < {self.wall};",
            ),
            ("ttf abs(pos) > 0.7", f"ttf abs(pos) > {self.far}"),
            ("safer abs(pos) < 0.5", f"safer abs(pos) < {self.near}"),
            ("[-1.0, 1.0] / 80", f"[{-self.wall}, {self.wall}] / {int(100 * self.wall)}"),
            ("late dm 0ms, sc 0ms", f"late dm {self.late_dm}ms, sc {self.late_sc}ms"),
            (
                "response dm 0ms, sc 0ms",
                f"response dm {self.response_dm}ms, sc {self.response_sc}ms",
            ),
            ("acts within 0ms;", f"acts within {self.acts}ms;{horizon}"),
            ("always abs(p.truth.x) < 1.0", f"always abs(p.truth.x) < {self.wall}"),
        )
        return tuple((a, b) for a, b in edits if a != b)

    def leaves(self) -> float | None:
        """When the loop leaves C, from the first start that does."""
        for begin in self._starts():
            loop = Loop(
                line,
                lambda x: abs(x[0]) < self.wall,
                lambda x: min(1.0, max(-1.0, -self.gain * x[0])),
                lambda x: abs(x[0]) > self.far,
                lambda x: abs(x[0]) < self.near,
                lambda _x, _t: 1.0,
                (begin,),
                self.first,
                self.dm,
                self.sc,
                self.phase,
                self.sensor,
                max_age=self.max_age,
                until=5_000,
            )
            exit_time = _first(
                loop, self.late_dm, self.response_dm, self.late_sc, self.response_sc, self.acts
            )
            if exit_time is not None:
                return exit_time
        return None

    def _starts(self) -> Iterator[float]:
        if self.start is not None:
            yield self.start
            return
        for i in range(80):
            yield self.near - 0.01 - 0.007 * i


def _first(loop: Loop, *times: int) -> float | None:
    for variant in variants(loop, *times):
        exit_time = variant.run()
        if exit_time is not None:
            return exit_time
    return None


def timed(why: str, rows: str, usual: Times | None = None) -> list[Wrong]:
    """Entries about LINE: a row has a name, what is not usual of its times, and codes.

    A line that is indented belongs to the one before.
    """
    entries = []
    for row in re.sub(r"\n +", " ", rows.strip()).splitlines():
        name, told, *codes = row.split(" | ")
        pairs = [pair.split() for pair in told.split(", ")]
        given: dict[str, Any] = {k: float(v) if "." in v else int(v) for k, v in pairs}
        times = replace(usual or Times(0.0), **given)
        shown = Shown(loop=times.leaves)
        entries.append(Wrong("timing", name, LINE, times.edits, why, shown, codes=tuple(codes)))
    return entries


untimed = partial(Wrong, "timing")
AHEAD = timed(
    "`ttf` looks ahead a little less than it takes from the read to SC's first command",
    """
SC starts 20 ms late | far 0.96, late_sc 20
SC takes 25 ms | far 0.955, response_sc 25
the DM starts 40 ms late | far 0.94, late_dm 40
the DM takes 40 ms | far 0.94, response_dm 40
the DM starts late and takes long | far 0.94, late_dm 20, response_dm 20
commands act 25 ms later | far 0.955, acts 25
SC has a phase of 30 ms | far 0.95, phase 30
SC has a phase of one ms less than its period | far 0.93, phase 49
periods of 100 and 70 ms: SC's next release is up to 60 ms away | far 0.87, dm 100, sc 70
periods of 100 and 30 ms | far 0.91, dm 100, sc 30
periods of 90 and 60 ms, a phase of 20 | far 0.89, dm 90, sc 60, phase 20
periods of 100 and 100 ms, a phase of 60 | far 0.87, dm 100, sc 100, phase 60
periods of 70 and 50 ms, a phase of 10 | far 0.92, dm 70, phase 10
periods of 60 and 40 ms, a late DM | far 0.925, dm 60, sc 40, late_dm 45
the DM starts 40 ms late, both every 100 ms | far 0.89, dm 100, sc 100, late_dm 40
the DM takes 45 ms, both every 100 ms | far 0.885, dm 100, sc 100, response_dm 45
the DM is late and SC takes its time, both every 200 ms | far 0.73, dm 200, sc 200, late_dm 70,
    response_sc 25
a DM every 300 ms | far 0.73, dm 300
a little of everything | far 0.89, dm 100, phase 20, late_dm 10, late_sc 5, response_dm 15,
    response_sc 5, acts 10
a sensor every 40 ms | far 0.95, sensor 40, max_age 40
""",
)
NEAR = timed(
    "one period later AC is through it",
    "`safer` gives control back too near to the wall | far 0.99, near 0.97",
)
HORIZONS = timed(
    "the horizon is shorter than H*: AC acts for longer than the sets look ahead",
    """
a horizon of 40 ms | far 0.958, horizon 40
a horizon of nothing | far 0.99, horizon 0 | C001
a horizon of a millisecond | far 0.99, horizon 1
a horizon without SC's response | far 0.955, response_sc 25, horizon 70
a horizon without the DM's lateness | far 0.94, late_dm 40, horizon 70
a horizon without the phase | far 0.95, phase 30, horizon 70
a horizon of 1 ms less | far 0.98, horizon 69
""",
)
OVERLOAD = timed(
    "a DM that takes longer than its period is never done in time: decisions pile up",
    """
the DM takes 400 ms, every 50 ms | far 0.5, response_dm 400
the DM takes 100 ms, every 50 ms | far 0.82, response_dm 100
the DM takes 150 ms, every 50 ms | far 0.74, response_dm 150
the DM starts 30 ms late and takes 120 | far 0.79, late_dm 30, response_dm 120
""",
)
UNTIMED = (
    untimed(
        "SC is slower than the DM",
        LINE,
        (
            ("node Careful period 50ms", "node Careful period 500ms"),
            ("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.9"),
        ),
        "P1a: SC comes half a second after the decision",
    ),
    untimed(
        "SC takes longer than its period",
        LINE,
        (("response dm 0ms, sc 0ms", "response dm 0ms, sc 200ms"),),
        "SC is never done before its next release",
    ),
    untimed(
        "a map: the DM is later than a step of the plant",
        MAP,
        (("verify { grid", "verify { late dm 60ms, sc 0ms; grid"),),
        "its verdict belongs to the step before: AC has a step more",
    ),
    untimed(
        "a map: commands act after the next step",
        MAP,
        (("verify { grid", "verify { acts within 70ms; grid"),),
        "SC's command acts a step later than the sets say",
    ),
)
STARTS = timed(
    "SC waits for the DM, so its first command acts later than its own times say; until then the "
    "output's default acts",
    """
start: the DM is 300 ms late | dm 400, late_dm 300, start 1.75
start: the DM takes 300 ms | dm 400, response_dm 300, start 1.75
start: the DM is 150 ms late and takes 150 ms | dm 400, late_dm 150, response_dm 150, start 1.75
start: the DM is late, SC has a phase | dm 400, phase 40, late_dm 300, start 1.75
start: the DM is late, SC responds late, too | dm 400, late_dm 250, response_sc 20, start 1.75
start: the DM is late, commands act late | dm 400, late_dm 250, acts 20, start 1.75
start: both every 400 ms, the DM 350 ms late | far 0.5, near 0.3, dm 400, sc 400, late_dm 350, start
    1.7
start: both every 800 ms, the DM 300 ms late | far 0.7, near 0.4, dm 800, sc 800, late_dm 300, start
    1.75, gain 1.0
start: both every 800 ms, the DM takes 300 ms | far 0.7, near 0.4, dm 800, sc 800, response_dm 300,
    start 1.75, gain 1.0
start: both every 800 ms, the DM late, SC slow | far 0.7, near 0.4, dm 800, sc 800, late_dm 200,
    response_sc 100, start 1.75, gain 1.0
start: SC itself is late | dm 100, sc 100, late_sc 45, acts 5, start 1.96
""",
    Times(0.9, 0.7, wall=2.0, first=1.0),
)
"""Near the border at the start, with a default that pushes out."""


def ring(name: str, late: int = 0, response: int = 0, dm: int = 100) -> Wrong:
    """A mode of 30 rad/s, undamped, that SC only just damps."""

    def leaves() -> float | None:
        def push(y: tuple[float, ...], _t: int) -> float:
            return 1.0 if y[1] >= 0.0 else -1.0

        loop = Loop(
            mode(30.0),
            lambda y: abs(y[0]) < 0.67 and abs(y[1]) < 0.67,
            lambda y: min(1.0, max(-1.0, -1.375 * y[0] - 3.756 * y[1])),
            lambda y: y[0] * y[0] + y[1] * y[1] > 0.0015,
            lambda y: y[0] * y[0] + y[1] * y[1] < 0.0008,
            push,
            (0.0, 0.0),
            dm=dm,
            sensor=1,
            max_age=1,
            until=60_000,
        )
        return _first(loop, late, response, 0, 0, 0)

    edits: list[Edit] = []
    if late:
        edits.append(("late dm 0ms", f"late dm {late}ms"))
    if response:
        edits.append(("response dm 0ms", f"response dm {response}ms"))
    if dm != 100:
        edits.append(("period 100ms", f"period {dm}ms"))
    why = "every SC step that waits for the DM acts late: the phase is wrong and the mode grows"
    return Wrong("timing", name, RING, tuple(edits), why, Shown(loop=leaves))


RINGS = (
    ring("a mode of 30 rad/s, the DM 40 ms late", late=40),
    ring("a mode of 30 rad/s, the DM takes 40 ms", response=40),
    ring("a mode of 30 rad/s, the DM late and slow", late=20, response=20),
    ring("a mode of 30 rad/s, the DM 30 ms late", late=30),
    ring("a mode of 30 rad/s, the DM 25 ms late", late=25),
    ring("a mode of 30 rad/s, the DM 15 ms late and as slow", late=15, response=15),
    ring("a mode of 30 rad/s, the DM takes 24 ms", response=24),
)

TIMING = (*AHEAD, *NEAR, *HORIZONS, *OVERLOAD, *UNTIMED, *STARTS, *RINGS)
