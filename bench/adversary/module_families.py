"""Families of random modules for the adversary.

Purpose: `module(seed, family)`: plants from one to three states, laws from the stiffest to those
that only just damp, times with every bound used up now and then.
Non-goals: being provable; what is not is left out.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from bench.adversary.random_modules import BEND, DRAG, Module, PathNode, Times

if TYPE_CHECKING:
    from collections.abc import Callable

    Rng = np.random.Generator


def _round(x: float) -> float:
    return float(f"{float(x):.3g}")


def _between(rng: Rng, low: float, high: float) -> float:
    return _round(float(np.exp(rng.uniform(np.log(low), np.log(high)))))


def _split(rng: Rng, budget: int) -> tuple[int, int, int, int, int]:
    """J_dm, R_dm, J_sc, R_sc, L with max(J_sc, J_dm + R_dm) + R_sc + L <= budget."""
    if rng.random() < 0.3:
        budget = int(budget * rng.random())
    hand_over = int(budget * rng.choice([0.0, 0.3, 0.6, 0.8, 1.0]))
    rest = budget - hand_over
    late_dm = int(rng.integers(0, hand_over + 1))
    late_sc = int(rng.integers(0, hand_over + 1)) if rng.random() < 0.7 else 0
    response_sc = int(rng.integers(0, rest + 1))
    acts = (
        rest - response_sc if rng.random() < 0.5 else int(rng.integers(0, rest - response_sc + 1))
    )
    return late_dm, hand_over - late_dm, late_sc, response_sc, acts


def times(rng: Rng, periods: tuple[int, ...] = (10, 20, 25, 40, 50), use: float = 1.0) -> Times:
    """Random times of a flow; `use`: how much of half a period lateness may take."""
    sc = int(rng.choice(periods))
    dm = sc * int(rng.choice([1, 1, 2, 3, 5]))
    if rng.random() < 0.3:  # delta does not divide Delta
        dm = int(sc * rng.choice([1.5, 2.5, 1.2, 3.2]))
        dm = max(dm, sc)
    sensor = int(rng.choice([1, 2, 5, 5, 10, sc]))
    late_dm, response_dm, late_sc, response_sc, acts = _split(rng, int(use * sc) // 2)
    phase = int(rng.integers(0, sc)) if rng.random() < 0.35 else 0
    oldest = sensor
    if rng.random() < 0.6:  # what the periods make of it, no more
        common = int(np.gcd(sensor, sc))
        waits = max(late_sc, late_dm + response_dm)
        oldest = min(sensor, sensor - common + phase % common + waits)
    spare = int(rng.choice([0, 0, 0, 5, 20]))
    if late_dm + response_dm > dm:
        response_dm = dm - late_dm
    return Times(
        dm,
        sc,
        sensor,
        max(1, oldest + spare),
        phase,
        late_dm,
        late_sc,
        response_dm,
        response_sc,
        acts,
    )


def _look(when: Times) -> float:
    """About how many seconds the sets have to look ahead."""
    return 1e-3 * (2 * when.dm + when.sc + 2 * when.max_age + when.jitter)


def _module(
    seed: int,
    family: str,
    rng: Rng,
    a: list[list[float]],
    b: list[list[float]],
    gain: list[list[list[float]]],
    control: list[float],
    wind: list[float],
    box: list[float],
    when: Times,
    **more: object,
) -> Module:
    weak = 1.0 if rng.random() < 0.7 else 0.8
    noise = rng.choice([0.0, 0.0, 0.002, 0.008])
    new_module = Module(
        seed,
        family,
        tuple(tuple(r) for r in a),
        tuple(tuple(r) for r in b),
        tuple(tuple(tuple(_round(v) for v in row) for row in law) for law in gain),
        tuple(_round(weak * c) for c in control),
        tuple(control),
        tuple(wind),
        tuple(_round(noise * v) for v in box),
        tuple(box),
        when,
        levels=int(rng.choice([2, 3, 3])),
        **more,  # type: ignore[arg-type]
    )
    sign = rng.choice([-1.0, 0.0, 0.0, 1.0], size=new_module.m)
    first = tuple(float(s) * c for s, c in zip(sign, control, strict=True))
    return replace(new_module, first=first)


def integrator(seed: int, rng: Rng) -> Module:
    """X'' = u + w."""
    control = _between(rng, 1.0, 8.0)
    speed = _between(rng, 0.6, 6.0)
    law = [speed * speed, 2.0 * rng.uniform(0.5, 1.6) * speed]
    laws = [[law]]
    if rng.random() < 0.25:
        laws.append([[law[0] * rng.uniform(0.6, 1.0), law[1] * rng.uniform(0.9, 1.4)]])
    wind = _round(control * rng.choice([0.0, 0.05, 0.15]))
    box = [1.5, _round(np.sqrt(3.0 * control) * 1.05)]
    return _module(
        seed,
        "integrator",
        rng,
        [[0.0, 1.0], [0.0, 0.0]],
        [[0.0], [1.0]],
        laws,
        [control],
        [0.0, wind],
        box,
        times(rng, use=rng.choice([0.2, 0.5, 1.0])),
        cells=(60, 60),
    )


def tank(seed: int, rng: Rng) -> Module:
    """X' = u + w."""
    when = times(rng)
    control = _round(min(4.0, rng.uniform(0.05, 0.35) / _look(when)))
    wind = _round(control * rng.choice([0.0, 0.3, 0.7]))
    stiff = 1e3 / when.sc
    return _module(
        seed,
        "tank",
        rng,
        [[0.0]],
        [[1.0]],
        [[[stiff * _between(rng, 0.02, 1.2)]]],
        [control],
        [wind],
        [1.0],
        when,
        cells=(int(rng.choice([200, 400])),),
    )


def lag(seed: int, rng: Rng) -> Module:
    """A speed that follows its command."""
    rate = _between(rng, 2.0, 20.0)
    when = times(rng, use=rng.choice([0.3, 1.0]))
    control = _round(min(2.0, rng.uniform(0.05, 0.35) / (_look(when) + 0.5 / rate)))
    wind = _round(0.3 * control * rng.uniform(0.1, 1.0))
    return _module(
        seed,
        "lag",
        rng,
        [[0.0, 1.0], [0.0, -rate]],
        [[0.0], [rate]],
        [[[_between(rng, 0.3, 4.0), rng.uniform(-0.2, 0.6)]]],
        [control],
        [wind, 0.0],
        [1.0, _round(1.1 * control)],
        when,
        cells=(70, 50),
    )


def mode(seed: int, rng: Rng) -> Module:
    """A mode that is not damped, or hardly; SC damps it, perhaps only just."""
    when = times(rng, periods=(10, 20, 20, 40, 50))
    omega = min(40.0, _round(rng.uniform(0.05, 0.7) * 1e3 / when.sc))
    damping = float(rng.choice([0.0, 0.0, 0.0, 0.003, 0.01]))
    control = _round(rng.uniform(0.03, 0.25) / _look(when))
    stiff = control * rng.uniform(0.3, 2.0)
    # by what the mode turns until the middle of the hold the law turns back; and something wrong
    back = omega * 1e-3 * (0.5 * when.sc + when.max_age + when.acts)
    back += rng.uniform(-1.4, 1.4)
    law = [-stiff * np.sin(back), stiff * np.cos(back)]
    wind = _round(control * rng.choice([0.0, 0.0, 0.02, 0.1]))
    return _module(
        seed,
        "mode",
        rng,
        [[0.0, omega], [-omega, _round(-2.0 * damping * omega)]],
        [[0.0], [1.0]],
        [[law]],
        [control],
        [0.0, wind],
        [1.0, 1.0],
        when,
        cells=(60, 60),
    )


def drag(seed: int, rng: Rng) -> Module:
    """A mass with quadratic drag."""
    control = _between(rng, 1.0, 6.0)
    speed = _between(rng, 1.0, 4.0)
    return _module(
        seed,
        "drag",
        rng,
        [[0.0, 1.0], [0.0, 0.0]],
        [[0.0], [1.0]],
        [[[speed * speed, 2.0 * speed * rng.uniform(0.7, 1.4)]]],
        [control],
        [0.0, _round(0.1 * rng.random() * control)],
        [1.5, _round(np.sqrt(3.0 * control))],
        times(rng, periods=(20, 40, 50), use=rng.choice([0.3, 1.0])),
        cells=(28, 28),
        terms=((DRAG, 1, 1, -_between(rng, 0.05, 0.3)),),
    )


def swing(seed: int, rng: Rng) -> Module:
    """A pendulum, hanging, with a motor that is too weak to hold it."""
    stiff = _between(rng, 1.0, 9.0)
    control = _between(rng, 1.0, 4.0)
    return _module(
        seed,
        "swing",
        rng,
        [[0.0, 1.0], [0.0, -_between(rng, 0.1, 0.8)]],
        [[0.0], [1.0]],
        [[[0.0, _between(rng, 0.5, 4.0)]]],
        [control],
        [0.0, _round(0.1 * rng.random() * control)],
        [1.0, _round(1.2 * np.sqrt(stiff))],
        times(rng, periods=(20, 40, 50), use=rng.choice([0.3, 1.0])),
        cells=(28, 28),
        terms=((BEND, 0, 1, -stiff),),
    )


def pole(seed: int, rng: Rng) -> Module:
    """A pole that stands up: it falls by itself, and the farther it leans the faster."""
    bend = _between(rng, 0.5, 6.0)
    control = _round(bend + _between(rng, 1.0, 8.0))
    stiff = bend * rng.uniform(1.0, 3.0) + 2.0
    return _module(
        seed,
        "pole",
        rng,
        [[0.0, 1.0], [0.0, 0.0]],
        [[0.0], [1.0]],
        [[[stiff, 2.0 * np.sqrt(stiff) * rng.uniform(0.5, 1.2)]]],
        [control],
        [0.0, _round(0.1 * rng.uniform(0.1, 1.0) * control)],
        [0.8, _round(1.1 * np.sqrt(1.6 * control))],
        times(rng, periods=(10, 20, 40), use=rng.choice([0.3, 1.0])),
        terms=((BEND, 0, 1, bend), (DRAG, 1, 1, -_between(rng, 0.05, 0.5))),
    )


def chain(seed: int, rng: Rng) -> Module:
    """Position, speed, lagged acceleration."""
    rate = _between(rng, 8.0, 25.0)
    control = _between(rng, 1.0, 4.0)
    speed = _between(rng, 0.5, 1.4)
    return _module(
        seed,
        "chain",
        rng,
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -rate]],
        [[0.0], [0.0], [rate]],
        [[[speed**2, 2.2 * speed, 0.1]]],
        [control],
        [0.0, _round(0.03 * control * rng.random()), 0.0],
        [3.0, _round(np.sqrt(6.0 * control)), _round(1.05 * control)],
        times(rng, periods=(10, 20), use=rng.choice([0.2, 0.6])),
        cells=(40, 40, 16),
    )


def two(seed: int, rng: Rng) -> Module:
    """Two controls and a coupling: x0' = -k x0 + u0 + w, x1' = c x0 + u1."""
    when = times(rng)
    control = [_round(min(3.0, rng.uniform(0.05, 0.3) / _look(when))) for _ in range(2)]
    stiff = 1e3 / when.sc
    return _module(
        seed,
        "two",
        rng,
        [[-_between(rng, 0.05, 1.0), 0.0], [_round(0.4 * control[1] * rng.uniform(-1, 1)), 0.0]],
        [[1.0, 0.0], [0.0, 1.0]],
        [[[stiff * rng.uniform(0.02, 0.6), 0.0], [0.0, stiff * rng.uniform(0.02, 0.6)]]],
        control,
        [_round(0.2 * control[0]), 0.0],
        [1.0, 1.0],
        when,
        cells=(60, 60),
    )


def _map(seed: int, family: str, rng: Rng, *parts: object, **more: object) -> Module:
    when = Times(int(rng.choice([1, 2, 3])), 1, 1, 1)
    map_module = _module(seed, family, rng, *parts, when, is_map=True, **more)  # type: ignore[arg-type,call-arg]
    return replace(map_module, tick_us=1_000_000, times=replace(when, max_age=0))


def map1(seed: int, rng: Rng) -> Module:
    """x+ = g x + u + w."""
    grow = _round(rng.uniform(0.7, 1.08))
    control = _between(rng, 0.05, 0.15)
    wind = _round(0.3 * rng.uniform(0.1, 1.0) * control)
    gain = grow * rng.uniform(0.5, 1.3)
    return _map(
        seed, "map1", rng, [[grow]], [[1.0]], [[[gain]]], [control], [wind], [1.0], cells=(400,)
    )


def map2(seed: int, rng: Rng) -> Module:
    """A position and a speed in steps."""
    keep = _round(rng.uniform(0.6, 1.0))
    control = _between(rng, 0.01, 0.05)
    wind = _round(0.2 * rng.uniform(0.1, 1.0) * control)
    return _map(
        seed,
        "map2",
        rng,
        [[1.0, 0.5], [0.0, keep]],
        [[0.0], [1.0]],
        [[[rng.uniform(0.05, 0.3), keep - rng.uniform(0.2, 0.6)]]],
        [control],
        [0.0, wind],
        [1.0, _round(0.9 * np.sqrt(4.0 * control))],
        cells=(80, 80),
    )


def behind(seed: int, rng: Rng) -> Module:
    """An integrator, tank, lag or mode behind one to three nodes."""
    inner = (integrator, tank, lag, tank)[int(rng.integers(0, 4))](seed, rng)
    t = inner.times
    nodes: list[PathNode] = []
    slow, spoken = t.sensor, 0  # each node starts only after the one before has spoken (R017)
    for k in range(int(rng.choice([1, 1, 2, 3]))):
        period = max(2, slow * int(rng.choice([1, 2, 2, 4])))
        room = max(1, (period - spoken - 1) // (3 if k == 0 else 2))
        late = int(rng.integers(0, room // 2 + 1)) if rng.random() < 0.6 else 0
        response = int(rng.integers(0, room // 2 + 1)) if rng.random() < 0.6 else 0
        phase = spoken + (int(rng.integers(0, 3)) if rng.random() < 0.3 else 0)
        if phase >= period or late + response > period:
            break
        nodes.append(PathNode(period, phase, late, response))
        spoken, slow = phase + late + response + 1, period
    if not nodes:  # no room for what was drawn: a node that is on time
        nodes.append(PathNode(slow))
    last = nodes[-1]
    age = last.period + last.late + last.response
    when = replace(t, max_age=age)
    if rng.random() < 0.3:
        when = replace(when, dropout=int(rng.integers(1, 3)) * t.sensor)
    return replace(inner, family=f"behind {inner.family}", times=when, nodes=tuple(nodes))


def silent(seed: int, rng: Rng) -> Module:
    """A sensor that may fall silent for a declared time."""
    inner = (integrator, tank, lag)[int(rng.integers(0, 3))](seed, rng)
    quiet = inner.times.sensor * int(rng.integers(1, 4))
    return replace(
        inner, family=f"silent {inner.family}", times=replace(inner.times, dropout=quiet)
    )


def driven(seed: int, rng: Rng) -> Module:
    """An actuator node between module and plant, and perhaps an estimator before the module."""
    inner = (integrator, tank, lag, two, behind)[int(rng.integers(0, 5))](seed, rng)
    period = max(1, inner.times.sc // int(rng.choice([2, 4, 5, 8])))
    late = int(rng.integers(0, max(1, period // 3)))
    response = int(rng.integers(0, max(1, period // 3)))
    phase = int(rng.integers(0, period)) if rng.random() < 0.6 else 0
    when = inner.times
    if rng.random() < 0.7:  # leave half a period of SC for the way
        when = replace(when, late_dm=0, response_dm=when.response_dm // 3, late_sc=0, acts=0)
    nodes = [PathNode(period, phase, late, response)]
    if rng.random() < 0.35:
        after = max(1, period // 2)
        nodes.append(PathNode(after, int(rng.integers(0, after)), 0, int(rng.integers(0, 2))))
        nodes[-1] = replace(nodes[-1], response=min(nodes[-1].response, after - 1))
    return replace(inner, family=f"driven {inner.family}", times=when, drivers=tuple(nodes))


def pair(seed: int, rng: Rng) -> Module:
    """Two that do not feel each other, each on a grid of its own: x_i' = -k x_i + u_i + w_i."""
    inner = two(seed, rng)
    decay = (inner.a[0], (0.0, _round(-rng.uniform(0.05, 0.5))))
    wind = (inner.wind[0], _round(0.2 * inner.control[1]))
    return replace(inner, family="pair", a=decay, wind=wind, cells=(300, 300), apart=True)


def coupled(seed: int, rng: Rng) -> Module:
    """Two that feel each other a little, each on a grid of its own: directions of an orbit."""
    inner = pair(seed, rng)
    way = [_round(0.2 * c * rng.uniform(-1.0, 1.0)) for c in inner.control]
    a = ((inner.a[0][0], way[0]), (way[1], inner.a[1][1]))
    return replace(inner, family="coupled", a=a)


def sensing(seed: int, rng: Rng) -> Module:
    """A node between module and plant, in SC's instant, that looks at the sensor, too."""
    inner = (integrator, tank, lag)[int(rng.integers(0, 3))](seed, rng)
    t = inner.times
    period = int(rng.choice([p for p in range(1, t.sc + 1) if t.sc % p == 0]))
    nodes = (PathNode(period, t.sc_phase % period),)
    return replace(inner, family=f"sensing {inner.family}", drivers=nodes, in_step=True)


def shielded(seed: int, rng: Rng) -> Module:
    """A module whose commands are judged."""
    kinds = (integrator, tank, lag, mode, drag, swing, pair, behind, silent)
    inner = kinds[int(rng.integers(0, len(kinds)))](seed, rng)
    return of_commands(inner, rng)


def of_commands(inner: Module, rng: Rng) -> Module:
    """The same with a shield."""
    shield = int(rng.choice([3, 4, 5]))
    return replace(inner, family=f"shielded {inner.family}", shield=shield, nodes=inner.nodes)


FAMILIES: dict[str, Callable[[int, Rng], Module]] = {
    "integrator": integrator,
    "tank": tank,
    "lag": lag,
    "mode": mode,
    "drag": drag,
    "swing": swing,
    "chain": chain,
    "two": two,
    "map1": map1,
    "map2": map2,
    "behind": behind,
    "silent": silent,
    "driven": driven,
    "pair": pair,
    "coupled": coupled,
    "sensing": sensing,
    "shielded": shielded,
}
SHARES = {
    "integrator": 3,
    "tank": 3,
    "lag": 3,
    "mode": 5,
    "two": 2,
    "behind": 4,
    "silent": 2,
    "driven": 3,
}
"""How often a family comes; the others once."""


def module(seed: int, family: str = "") -> Module:
    """Module number `seed`, of a family of its own choosing where none is named."""
    rng = np.random.default_rng([9, seed])
    names = [n for n in FAMILIES for _ in range(SHARES.get(n, 1))]
    name = family or names[int(rng.integers(0, len(names)))]
    return FAMILIES[name](seed, rng)


def retimed(module: Module, rng: Rng) -> Module:
    """The same plant and law with other times."""
    if module.is_map:
        return replace(module, times=replace(module.times, dm=int(rng.integers(1, 5))))
    if module.nodes:
        # the sensor's period and the way stay; the module steps otherwise
        drawn = times(rng, (module.times.sc,))
        kept = {n: getattr(module.times, n) for n in ("sensor", "max_age", "dropout")}
        return replace(module, times=replace(drawn, **kept))
    drawn = times(rng, (module.times.sc,), use=float(rng.choice([0.2, 0.5, 1.0])))
    return replace(module, times=replace(drawn, dropout=module.times.dropout))
