"""Worlds in which a filter of ours and a filter of somebody else fly, and who asks for too much.

Purpose: one world, one seed, one adversary for both sides: the same disturbances, errors of sensors
and wishes. It needs NumPy alone, as peers fly it in their own Python (peer_filters.py). `exact` has
neither errors nor disturbances, as filters assume that say nothing of them. The adversary knows the
true state. What violates is judged on the truth, between the ticks as well.
Non-goals: filters; delays, which only our side declares.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

Filter = Callable[[Any, Any], Any]
"""State as the sensors say it, and wish: what acts."""

RUSH, RESTLESS, HOVER = range(3)
"""Towards the border always; full for random times; as near to the border as it can be."""
PARTS = 4  # of a tick, after each of which the property is judged


class World:
    """A plant that a filter steers. Subclasses say what moves, what is wished, what must not be."""

    tick: ClassVar[float]
    states: ClassVar[int]
    errors: ClassVar[tuple[float, ...]]
    bound: ClassVar[tuple[float, ...]]
    """What may be commanded, a number each."""
    unit: ClassVar[str] = "m"
    """Of what `beyond` says."""

    def __init__(self, exact: bool) -> None:
        """`exact`: the sensors do not err and nothing disturbs."""
        self.exact = exact

    def reset(self, seed: int) -> None:
        """Flight number `seed`."""
        self.random = np.random.default_rng(seed)
        self.errs = np.random.default_rng([seed, 1])
        self.kind = seed % 3
        self.truth = self.start()
        self.time = 0.0
        self.until = 0.0
        self.held = np.zeros(len(self.bound))
        self.push = np.zeros(8)
        self.deepest = 0.0

    def step(self, action: Any) -> None:  # noqa: ANN401
        """A tick under one command."""
        command = np.clip(np.asarray(action, dtype=float), -np.array(self.bound), self.bound)
        if self.exact:
            self.push = np.zeros(8)
        elif self.errs.random() < self.tick / 0.5:
            self.push = self.errs.choice([-1.0, 1.0], 8)
        for _ in range(PARTS):
            self.move(command, self.tick / PARTS)
            self.deepest = max(self.deepest, self.beyond())
        self.time += self.tick

    def seen(self) -> Any:  # noqa: ANN401
        """What the sensors say."""
        if self.exact:
            return self.truth.copy()
        return self.truth + np.array(self.errors) * self.errs.uniform(-1.0, 1.0, self.states)

    def wish(self) -> Any:  # noqa: ANN401
        """What the adversary asks for now."""
        if self.kind == RUSH:
            return self.rush()
        if self.kind == HOVER:
            return self.hover()
        if self.time >= self.until:
            self.until = self.time + self.random.uniform(0.2, 3.0)
            to = self.rush()
            beside = self.random.uniform(-1.0, 1.0, len(self.bound)) * np.array(self.bound)
            self.held = to if self.random.random() < 0.6 else beside
        return self.held

    def done(self) -> bool:
        """Whether it is where it should get: there the flight ends."""
        return False

    def start(self) -> Any:  # noqa: ANN401
        """Where it begins."""
        raise NotImplementedError

    def move(self, command: Any, time: float) -> None:  # noqa: ANN401
        """So long under that command."""
        raise NotImplementedError

    def beyond(self) -> float:
        """How far beyond what may be; 0 where it is not."""
        raise NotImplementedError

    def rush(self) -> Any:  # noqa: ANN401
        """Towards the border, with all it has."""
        raise NotImplementedError

    def hover(self) -> Any:  # noqa: ANN401
        """As near to the border as it can be."""
        raise NotImplementedError


class Docking(World):
    """A craft before a dock at x = 0 (examples/migration/docking.soter)."""

    tick, states, errors, bound = 0.02, 2, (0.02, 0.02), (1.0,)

    def done(self) -> bool:
        """Docked, as run-time-assurance's own test has it: within 0.1 m, slower than 0.1 m/s."""
        return bool(max(abs(self.truth)) < 0.1)

    def start(self) -> Any:  # noqa: ANN401
        """Where it begins."""
        return np.array([-6.0, 0.0])

    def move(self, command: Any, time: float) -> None:  # noqa: ANN401
        """So long under that command."""
        rate = command[0] + 0.05 * self.push[0]
        x, v = self.truth
        self.truth = np.array([x + v * time + 0.5 * rate * time * time, v + rate * time])

    def beyond(self) -> float:
        """How far beyond what may be; 0 where it is not."""
        return max(0.0, float(self.truth[0]))

    def rush(self) -> Any:  # noqa: ANN401
        """Towards the border, with all it has."""
        return np.array([1.0])

    def hover(self) -> Any:  # noqa: ANN401
        """As near to the border as it can be."""
        x, v = self.truth
        return np.clip([2.0 * (-0.02 - x) - 2.0 * v], -1.0, 1.0)


class Cart(World):
    """A cart between walls at 10 m either way (examples/wall/cart.soter)."""

    tick, states, errors, bound = 0.005, 2, (0.02, 0.05), (3.0,)

    def start(self) -> Any:  # noqa: ANN401
        """Where it begins."""
        self.side = self.random.choice([-1.0, 1.0])
        return np.array([0.0, 0.0])

    def move(self, command: Any, time: float) -> None:  # noqa: ANN401
        """So long under that command."""
        rate = command[0] + 0.2 * self.push[0]
        x, v = self.truth
        self.truth = np.array([x + v * time + 0.5 * rate * time * time, v + rate * time])

    def beyond(self) -> float:
        """How far beyond what may be; 0 where it is not."""
        return max(0.0, float(abs(self.truth[0]) - 10.0))

    def rush(self) -> Any:  # noqa: ANN401
        """Towards the border, with all it has."""
        return np.array([3.0 * self.side])

    def hover(self) -> Any:  # noqa: ANN401
        """As near to the border as it can be."""
        x, v = self.truth
        return np.clip([4.0 * (self.side * 9.98 - x) - 4.0 * v], -3.0, 3.0)


class Rover(World):
    """A rover, and who is nearest: walks up to it, stands, and goes again (stop_zone.soter)."""

    tick, states, errors, bound = 0.05, 2, (0.05, 0.02), (1.0,)
    unit = "m/s"  # at the touch
    lag, walk, rest = 0.25, 1.0, 0.15

    def start(self) -> Any:  # noqa: ANN401
        """Where it begins."""
        self.stays = 0.0
        return np.array([self.random.uniform(3.0, 6.0), 0.0])

    def move(self, command: Any, time: float) -> None:  # noqa: ANN401
        """So long under that command."""
        gap, v = self.truth
        if (
            gap <= 0.0 or self.stays > 4.0
        ):  # stands before it, or has touched it: somebody else comes
            gap, self.stays = self.random.uniform(3.0, 6.0), 0.0
        self.stays += time if gap < 1.0 else 0.0
        comes = self.walk if not self.exact and self.push[1] > 0.0 else 0.0
        fast = (command[0] - v) / self.lag + (0.0 if self.exact else 0.1 * self.push[0])
        self.truth = np.array([gap - (v + comes) * time, v + fast * time])

    def beyond(self) -> float:
        """How far beyond what may be; 0 where it is not."""
        gap, v = self.truth
        return float(abs(v)) if gap <= 0.0 and abs(v) >= self.rest else 0.0

    def rush(self) -> Any:  # noqa: ANN401
        """Towards the border, with all it has."""
        return np.array([1.0])

    def hover(self) -> Any:  # noqa: ANN401
        """As near to the border as it can be."""
        return np.clip([2.0 * (self.truth[0] - 0.1)], -1.0, 1.0)


class Copter(World):
    """A multicopter in a box about home (examples/migration/geofence.soter)."""

    tick, states, bound = 0.05, 6, (5.0, 5.0, 2.0)
    errors = (0.2, 0.2, 0.2, 0.1, 0.1, 0.1)
    lag, ends = 0.8, (50.0, 40.0, 30.0)

    def start(self) -> Any:  # noqa: ANN401
        """Where it begins."""
        self.heading = self.random.uniform(0.0, 2.0 * math.pi)
        return np.array([0.0, 0.0, 15.0, 0.0, 0.0, 0.0])

    def move(self, command: Any, time: float) -> None:  # noqa: ANN401
        """So long under that command."""
        gust = np.array([0.3, 0.3, 0.2]) * self.push[:3]
        p, v = self.truth[:3], self.truth[3:]
        self.truth = np.concatenate([p + v * time, v + ((command - v) / self.lag + gust) * time])

    def beyond(self) -> float:
        """How far beyond what may be; 0 where it is not."""
        x, y, z = self.truth[:3]
        over = np.array([abs(x), abs(y), z]) - np.array(self.ends)
        return max(0.0, float(max(over)))

    def rush(self) -> Any:  # noqa: ANN401
        """Towards the border, with all it has."""
        if self.random.random() < 0.002:
            self.heading = self.random.uniform(0.0, 2.0 * math.pi)
        way = np.array([math.cos(self.heading), math.sin(self.heading)])
        return np.array([*(5.0 * way / max(abs(way))), 0.0 if self.random.random() < 0.5 else 2.0])

    def hover(self) -> Any:  # noqa: ANN401
        """As near to the border as it can be."""
        x, y, z = self.truth[:3]
        to = np.array([math.copysign(49.8, math.cos(self.heading)) - x, -y, 29.8 - z])
        return np.clip(to, -np.array(self.bound), self.bound)


LEAST = 1e-6
"""A violation goes further than this: less is rounding."""
WORLDS = {one.__name__: one for one in (Docking, Cart, Rover, Copter)}


def fly(world: World, begin: Callable[[], Filter], flights: int, seconds: float) -> list[float]:
    """Flights behind a filter: how many violate, by how much at most, the wish's share, and done."""
    violated, deepest, asked, ticks, done = 0, 0.0, 0, 0, 0
    for seed in range(flights):
        world.reset(seed)
        answer = begin()
        while world.time < seconds - 1e-9 and not world.done():
            wish = world.wish()
            command = answer(world.seen(), wish)
            asked += bool(np.allclose(command, wish, rtol=0.0, atol=1e-6))
            ticks += 1
            world.step(command)
        violated += world.deepest > LEAST
        deepest = max(deepest, world.deepest)
        done += world.done()
    return [violated, deepest, asked / ticks, done]
