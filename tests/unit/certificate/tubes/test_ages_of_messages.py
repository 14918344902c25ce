"""The re-checker's holds: whatever a message's age is, states and commands lie in what is carried.

Non-goals: which claims follow (`test_rest_certificate.py`); the prover's tube (`test_answers.py`).
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import ZERO, exact
from soter.certificate.tubes.rest_problem import read_rest_problem
from soter.certificate.tubes.tube_chains import ModuleTube, StateSet
from unit.certificate.tubes.rest_entries import flat_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

ROBOT = """soter 1;
type Pose = { x: float, v: float };
type Seen = { led: float };
topic pose: Pose in { x in [-5.0, 5.0], v in [-5.0, 5.0] } max_age AGE;
topic seen: Seen in { led in [-5.0, 5.0] } max_age AGE;
topic push: { a: float, b: float } in { a in [-2.0, 2.0], b in [-2.0, 2.0] } = { a: 0.0, b: 0.0 };
node Ac period 50ms { publishes push; step { publish push = { a: 1.0, b: 1.0 }; } }
node Sc period 50ms { subscribes pose, seen; publishes push; step {
  publish push = { a: clamp(-2.0 * (pose.x + 0.5 * pose.v) + 2.0 * seen.led, -2.0, 2.0),
    b: clamp(-1.5 * pose.x + 1.0 * pose.v, -2.0, 2.0) }; } }
rta Robot { ac Ac; sc Sc; period 50ms; safe abs(pose.x) < 4.0;
  rest abs(pose.x) < 2.0 && abs(pose.v) < 2.0 && abs(seen.led) < 2.0 within 2s;
  verify { JITTER } }
plant Body period 10ms {
  reads push; drives pose = { x: x, v: v }; drives seen = { led: led };
  state x: float = 0.0; state v: float = 0.0; state led: float = 0.0;
  disturbance w: float in [-0.001, 0.001];
  der x = v;
  der v = push.b - 0.5 * sin(x) + w;
  der led = 2.0 * (x - led) + push.a * (1.0 + 0.3 * v);
  measured pose.x within 0.0001, pose.v within 0.0002, seen.led within 0.0001;
}
system S default { p: Body; module Robot; until 1s; }
"""
ERRORS = {0: 0.0001, 1: 0.0002, 2: 0.0001}


def rate(x: Sequence[float], u: Sequence[float], w: float) -> list[float]:
    """The derivative of (x, v, led)."""
    return [
        x[1],
        u[1] - 0.5 * math.sin(x[0]) + w,
        2.0 * (x[0] - x[2]) + u[0] * (1.0 + 0.3 * x[1]),
    ]


def answer(y: Sequence[float]) -> list[float]:
    """What SC answers to (x, v, led)."""
    limit = [-2.0 * (y[0] + 0.5 * y[1]) + 2.0 * y[2], -1.5 * y[0] + 1.0 * y[1]]
    return [max(-2.0, min(2.0, u)) for u in limit]


@dataclass
class Run:
    """A run from states at 0, whose past and future are followed as they are asked for."""

    rng: random.Random
    states: dict[int, list[float]]
    """By time in steps."""
    commands: Callable[[int], list[float]]

    def at(self, k: int, step: float) -> list[float]:
        """The states at an instant; each step has a disturbance of its own."""
        towards = 1 if k >= 0 else -1
        while k not in self.states:
            last = (max if towards > 0 else min)(self.states)
            w = self.rng.choice((-0.001, 0.001))
            u = self.commands(last if towards > 0 else last - 1)
            h, x = towards * step, self.states[last]
            a = rate(x, u, w)
            b = rate([p + h / 2 * q for p, q in zip(x, a, strict=True)], u, w)
            self.states[last + towards] = [p + h * q for p, q in zip(x, b, strict=True)]
        return self.states[k]


@pytest.mark.parametrize(("age", "jitter"), [(20, 0), (60, 0), (110, 0), (30, 20), (70, 20)])
def test_holds_carry_states_and_commands_of_every_run(age: int, jitter: int) -> None:
    """In each direction of states and the last command a run is within what rows say of both."""
    late = f"acts within 0ms to {jitter}ms;" if jitter else ""
    flat = flat_of(ROBOT.replace("AGE", f"{age}ms").replace("JITTER", late))
    problem = read_rest_problem(flat, "Robot")
    problem.facts.times["d_ns"] = age * 1_000_000
    chain, times = ModuleTube(problem, {}).chain, problem.times
    step_ns = 500_000
    j, d, period = (t // step_ns for t in (times.jitter, times.delay, times.period))
    assert j == jitter * 1_000_000 // step_ns
    rng = random.Random(f"{age} {jitter}")  # noqa: S311 - drawn examples
    for _ in range(6):
        size = rng.choice((1e-5, 0.01))
        middle = [rng.uniform(-0.7, 0.7) for _ in range(3)]
        held = [rng.uniform(-1.0, 1.0) for _ in range(2)]
        body = StateSet.from_box([(exact(m - size), exact(m + size)) for m in middle])
        if known := rng.random() < 0.7:  # what acted before is one command
            body.memory = [[exact(u), *[ZERO] * 3] for u in held * chain.depth]
            body.ranges = [(exact(u), exact(u)) for u in held * chain.depth]
        bodies = []
        for _ in range(4):
            body, _ = chain.follow_hold(body, 2)
            bodies.append(body)
        for _ in range(40):
            start = [m + rng.choice((-size, size)) for m in middle]
            follow(rng, start, held if known else None, bodies, (j, d, period, step_ns * 1e-9))


def follow(
    rng: random.Random, start: list[float], held: list[float] | None, bodies: Any, times: Any
) -> None:
    """One run, held against the bodies at the ends of its holds; `held`: what acted before."""
    j, d, period, step = times
    early = rng.randint(0, j)
    shift = 0 if held is None else j  # a tube of what acted before begins so long before output 0
    holds = range(len(bodies) + 1)
    acts = [[k * period + shift - early + rng.randint(0, j) for _ in range(2)] for k in holds]
    acts[0] = acts[0] if held else [0, 0]
    given: list[list[float]] = []

    def commands(t: int) -> list[float]:
        found = []
        for i in range(2):
            last = [k for k in range(len(given)) if acts[k][i] <= t]
            before = rng.choice((-2.0, 2.0)) if held is None else held[i]
            found.append(given[last[-1]][i] if last else before)
        return found

    run = Run(rng, {0: start}, commands)
    for k, body in enumerate(bodies):
        begin = min(acts[k])
        oldest = max(acts[k]) - d
        ages = [rng.choice((0, d, rng.randint(0, d))) for _ in range(2)]
        pose, seen = (run.at(max(begin - a, oldest), step) for a in ages)
        read = [pose[0], pose[1], seen[2]]
        errors = [rng.choice((-e, e)) for e in ERRORS.values()]
        given.append(answer([y + e for y, e in zip(read, errors, strict=True)]))
        x = run.at((k + 1) * period + shift - j, step)
        inside_in_every_direction(rng, body, x, given[-1])


def inside_in_every_direction(
    rng: random.Random, body: Any, x: Sequence[float], u: Sequence[float]
) -> None:
    for (low, high), value in zip(body.box, x, strict=True):
        assert low - 1e-7 <= value <= high + 1e-7
    known = [*body.rows, *body.memory[: len(u)]] if body.memory else body.rows
    point = [*x, *u][: len(known)]
    for _ in range(20):
        by = [rng.choice((-1.0, 0.0, 1.0, rng.uniform(-1.0, 1.0))) for _ in known]
        row = [
            sum(b * float(r[c].mid()) for b, r in zip(by, known, strict=True))
            for c in range(len(known[0]))
        ]
        off = abs(sum(b * p for b, p in zip(by, point, strict=True)) - row[0])
        assert off <= sum(map(abs, row[1:])) + 1e-7


FED = """soter 1;
topic seen: { v: float, y: float, z: float } max_age 50ms;
topic push: { a: float, b: float } in { a in [-1.0, 1.0], b in [-2.0, 2.0] } = { a: 0.0, b: 0.0 };
plant P period 10ms { reads push; drives seen = { v: v, y: y, z: z };
  state v: float = 0.0; state y: float = 0.0; state z: float = 0.0;
  der v = push.a; der y = v + 0.05 * push.a; der z = push.b; }
node Ac period 50ms { publishes push; step { publish push = { a: 1.0, b: 2.0 }; } }
node Sc period 50ms { subscribes seen; publishes push; step {
  publish push = { a: clamp(-4.0 * seen.v, -1.0, 1.0), b: clamp(seen.y, -2.0, 2.0) }; } }
rta M { ac Ac; sc Sc; period 50ms;
  safe abs(seen.y) < 50.0 && abs(seen.v) < 20.0 && abs(seen.z) < 9.0;
  rest abs(seen.v) < 0.2 && abs(seen.y) < 0.2 && abs(seen.z) < 0.2 within 12s; }
system S default { p: P; module M; until 1s; }
"""


@pytest.mark.parametrize("age", [60, 75, 100, 140, 200])
@pytest.mark.parametrize("earlier", [-1.0, 0.0])
def test_a_command_before_the_last_moves_what_it_feeds_at_once(age: int, earlier: float) -> None:
    """y' = v + 0.05 a and v' = a: at mid span the two cancel, so nothing of a is seen there."""
    problem = read_rest_problem(flat_of(FED), "M")
    problem.facts.times["d_ns"] = age * 1_000_000
    chain = ModuleTube(problem, {}).chain
    body = StateSet.from_box([(exact(x), exact(x)) for x in (-0.5, 0.0, 0.0)])
    acted = [1.0, 0.0] + [earlier, 0.0] * (chain.depth - 1)
    body.memory = [[exact(u), ZERO, ZERO, ZERO] for u in acted]
    body.ranges = [(exact(u), exact(u)) for u in acted]
    after, _ = chain.follow_hold(body, 1)
    (low, high), was, last = after.ranges[1], min(age, 50) * 1e-3, age * 1e-3
    turned = -0.5 - was  # v when the last command began
    y = -(-0.5 * was - was * was / 2 + 0.05 * was)
    rest = last - was
    y -= turned * rest - earlier * rest * rest / 2 + 0.05 * earlier * rest
    assert low <= y <= high


def test_a_state_that_two_topics_show_sc_is_not_one_number() -> None:
    """Each has an age and an error of its own: what SC makes of both does not cancel."""
    twice = FED.replace("drives seen", "drives again = { v: v }; drives seen")
    twice = twice.replace("topic push", "topic again: { v: float } max_age 50ms;\ntopic push")
    twice = twice.replace("subscribes seen", "subscribes seen, again")
    twice = twice.replace("abs(seen.v) < 20.0", "abs(again.v) < 20.0")
    twice = twice.replace("-4.0 * seen.v", "-4.0 * (seen.v - again.v)")
    with pytest.raises(NotRecheckedError, match=r"sees `p\.v` twice"):
        read_rest_problem(flat_of(twice), "M")
