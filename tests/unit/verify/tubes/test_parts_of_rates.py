"""Parts of a rate mean the rate: what cancels, or is 0 in the middle of a disturbance, is not lost.

Non-goals: whether a step of such parts holds every run (`test_steps.py`).
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, NamedTuple

import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import in_order
from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.problem import TubeProblem, TubeTimes
from soter.verify.tubes.tube_check import TubeCheck

if TYPE_CHECKING:
    from collections.abc import Callable

MODULE = """soter 1;
type Pose = { s0: float, s1: float };
topic pose: Pose max_age 20ms;
topic acc: float ACC max_age 20ms;
topic order: float in [-2.0, 2.0] = 0.0;
plant Body period 10ms {
  reads order;
  drives pose = { s0: s0, s1: s1 };DRIVES
  state s0: float = 0.0; state s1: float = 0.0;
  disturbance w: float in [LOW, 1.0];
  der s0 = order;
  der s1 = RATE;
}
node Ac period 50ms { subscribes pose; publishes order; step { publish order = 1.0; } }
node Sc period 50ms { subscribes pose; publishes order; step { publish order = LAW; } }
rta M { ac Ac; sc Sc; period 50ms; safe abs(pose.s0) < 50.0 && abs(pose.s1) < 50.0;
  rest abs(pose.s0) < 40.0 within 2s; }
system S default { b: Body; module M; until 1s; }
"""


def check_of(
    rate: str, low: float = -1.0, drives: str = "", acc: str = "", law: str = "0.0"
) -> TubeCheck:
    text = MODULE.replace("RATE", rate).replace("LOW", str(low)).replace("ACC", acc)
    text = text.replace("LAW", law)
    text = text.replace("DRIVES", f" drives acc = {drives};" if drives else "")
    flat = system_to_prove(check_file("parts.soter", text), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    return TubeCheck(problem)


def good(check: TubeCheck, *estimate: float) -> bool:
    """Whether an estimate is, where s0 stays in [10, 39] at rest, and s1 in [-1, 1]."""
    ways = dict(zip(check.states, (Interval(10.0, 39.0), Interval(-1.0, 1.0)), strict=True))
    return Caller(check.text_in_flight(ways)).returns_true("good", list(estimate))


def test_a_limit_whose_ends_come_out_the_wrong_way_round_is_its_last_end() -> None:
    check = check_of("min(max(s1 + w, 2.0 + w), 1.0 + w)")
    assert check._still[1] is check.make.constant(1.0)
    text = check.text_in_flight(dict.fromkeys(check.states, Interval(-1.0, 1.0)))
    caller = Caller(text)
    for ends in ((-3.0, -2.0), (-3.0, 3.0), (1.2, 1.8), (3.0, 4.0)):
        form = caller.result("f_clamp", caller.result("f_range", *ends), 2.0, 1.0)
        assert form[2:4] == (1.0, 1.0)


@pytest.mark.parametrize("low", [-1.0, -0.5])
@pytest.mark.parametrize(
    "rate", ["(w + sqrt(s0)) - sqrt(s0) - s1", "w * sqrt(s0) - sqrt(s0) * w - s1"]
)
def test_a_root_that_cancels_in_the_parts_is_asked_of_c(rate: str, low: float) -> None:
    check = check_of(rate, low)
    assert not good(check, -5.0, 0.0)
    assert good(check, 30.0, 0.0)


@pytest.mark.parametrize("rate", ["w * atan2(s1, s0)", "w * wrap_angle(s1)"])
def test_a_jump_beside_a_disturbance_is_refused_wherever_its_middle_is(rate: str) -> None:
    for low in (-1.0, 0.0):
        with pytest.raises(SoterError, match="its rate jumps"):
            check_of(rate, low)


def test_a_slope_without_end_beside_a_disturbance_is_asked_of_c() -> None:
    """From 0 on s1' = sqrt(s1) has the solutions 0 and t^2 / 4."""
    for rate, is_steep in (("w * sqrt(max(s1, 0.0)) - s1", True), ("w * sin(s1) - s1", False)):
        asked = in_order([check_of(rate)._safe])
        assert any(e.op == "inverse" for e in asked) == is_steep


@pytest.mark.parametrize("drives", ["s1 * w", "s1 * order"])
def test_a_set_of_what_a_disturbance_or_a_command_moves_at_once_is_refused(drives: str) -> None:
    with pytest.raises(SoterError, match="has a set, and is no float, or hangs on"):
        check_of("w - s1", drives=drives, acc="in [-5.0, 5.0]")


@pytest.mark.parametrize(
    "rate",
    [
        "asin(0.45 * order)", "sqrt(2.0 + order)", "order / (1.0 + order * order)",
        "order / (abs(order) + 0.3)", "1.0 / max(order, 0.1)", "pow(order, 5.0)",
        "pow(3.0 + order, -2.0)", "exp(order) * w",
    ],
)  # fmt: skip
def test_functions_of_commands_are_followed_up_to_the_ends_of_their_sets(rate: str) -> None:
    assert good(check_of(f"0.01 * {rate} - s1"), 30.0, 0.0)


@pytest.mark.parametrize("rate", ["order / (3.0 + w)", "1.0 / order"])
def test_a_divisor_that_may_be_zero_as_far_as_is_seen_is_refused(rate: str) -> None:
    with pytest.raises(SoterError, match="a divisor be 0"):
        check_of(f"{rate} - s1")


def test_what_a_machine_may_round_to_zero_is_not_known_to_be_above_it() -> None:
    make = check_of("w - s1").make
    x, zero = make.input("x", 0), make.constant(0.0)
    assert make.compare(">", make.add(make.mul(x, x), make.constant(0.1)), zero) is make.true
    for small in (make.function_node("exp", x), make.mul(x, x), make.function_node("abs", x)):
        assert make.compare(">", small, zero).op == "positive"


def test_what_faults_is_said() -> None:
    check = check_of("0.01 * log(1.0 + order) - s1")
    ways = dict.fromkeys(check.states, Interval(10.0, 39.0))
    caller = Caller(check.text_in_flight(ways))
    assert caller.result("good", [30.0, 0.0]) is None
    assert caller.fault == "a logarithm of what may not be above 0"


class At(NamedTuple):
    """States, the command and the disturbance of an instant."""

    s0: float
    s1: float
    u: float
    w: float


BRANCHES: dict[str, Callable[[At], float]] = {
    "s0 > 0.3 ? -1.0 - 0.5 * s1 : 0.0": lambda a: -1.0 - 0.5 * a.s1 if a.s0 > 0.3 else 0.0,
    "s1 > 0.0 || order > 0.0 ? order + w : 0.0": (
        lambda a: a.u + a.w if a.s1 > 0.0 or a.u > 0.0 else 0.0
    ),
    "(s1 - s0 > 0.1 && w > -0.5 ? 1.0 : -0.4 * s1) + (s1 >= 0.2 ? w : 2.0 * order)": (
        lambda a: (
            (1.0 if a.s1 - a.s0 > 0.1 and a.w > -0.5 else -0.4 * a.s1)
            + (a.w if a.s1 >= 0.2 else 2.0 * a.u)
        )
    ),
    "s0 * s0 <= s1 ? (s1 > 0.5 ? -s1 : order) : -0.2 * order * w": (
        lambda a: (-a.s1 if a.s1 > 0.5 else a.u) if a.s0 * a.s0 <= a.s1 else -0.2 * a.u * a.w
    ),
}
"""Rates of s1 that change where a state passes, where a command or a disturbance does, or both."""
STEPS = 400
MS = 1_000_000


@pytest.mark.parametrize("rate", BRANCHES)
def test_steps_over_a_branch_hold_every_run(rate: str) -> None:
    """Euler's steps take the branch of where they begin, or of beside it: each is off by a jump at
    most, where the run crosses one, and by its bend.
    """
    check = check_of(rate)
    caller = Caller(check.text_in_flight(dict.fromkeys(check.states, Interval(-1.0, 1.0))))
    rng = random.Random(rate)  # noqa: S311 - drawn examples
    crossed = 0
    symbols, moves = (check._whole_number_constants()[name] for name in ("SYMBOLS", "MOVES"))
    for _ in range(40):
        middle = [rng.uniform(-0.7, 0.7) for _ in range(2)]
        wide = rng.choice((0.0, 0.02, 0.2))
        box = [[m - wide for m in middle], [m + wide for m in middle]]
        held, off = rng.uniform(-1.0, 1.0), rng.choice((0.0, 0.5))
        h = rng.choice((0.02, 0.1, 0.3))
        forms = [
            (m, 0.0, m - wide, m + wide, (*[0.0] * k, wide, *[0.0] * (symbols - 1 - k)))
            for k, m in enumerate(middle)
        ]
        command = [(held, 0.0, held, held, (0.0,) * symbols)]
        step = caller.result("flow", forms, command, [1.0, off], h, moves)
        if step is None or not step[4]:
            continue
        end, way, met, *_ = step
        for _ in range(12):
            x = [rng.choice((a, b, rng.uniform(a, b))) for a, b in zip(*box, strict=True)]
            u, w, seen = held, 0.0, set()
            for k in range(STEPS):
                if not k % rng.choice((1, 40)):
                    u, w = held + rng.choice((-off, off)), rng.choice((-1.0, 1.0))
                r1 = BRANCHES[rate](At(x[0], x[1], u, w))
                seen.add(round(r1, 1))
                slack = 8.0 * h / STEPS
                for i, (f, r) in enumerate(zip(way, (u, r1), strict=True)):
                    assert f[2] - slack <= x[i] <= f[3] + slack
                    assert met[i][0] - slack <= r <= met[i][1] + slack
                x = [x[0] + h / STEPS * u, x[1] + h / STEPS * r1]
            crossed += len(seen) > 1
            assert all(f[2] - slack <= x[i] <= f[3] + slack for i, f in enumerate(end))
    assert crossed > 60


@pytest.mark.parametrize("condition", ["s1 > 0.0", "s1 >= 0.0", "!(s1 < 0.0)", "!(0.0 >= s1)"])
def test_a_branch_is_decided_beside_where_it_changes_and_not_there(condition: str) -> None:
    check = check_of(f"{condition} ? 1.0 : -1.0")
    caller = Caller(check.text_in_flight(dict.fromkeys(check.states, Interval(-1.0, 1.0))))
    for low, high, said in (
        (0.0, 0.0, (False, False)),
        (0.0, 1.0, (False, False)),
        (-1.0, 0.0, (False, False)),
        (5e-324, 1.0, (True, False)),
        (-1.0, -5e-324, (False, True)),
    ):
        at = [(0.0, 0.0), (low, high)]
        assert tuple(caller.result("branches", at, [(0.0, 0.0)])) == said
        assert caller.result("speeds", at, [(0.0, 0.0)])[1] == (
            -1.0 if not said[0] else 1.0,
            1.0 if not said[1] else -1.0,
        )


@pytest.mark.parametrize("command", [-2.0, 0.5, 2.0])
@pytest.mark.parametrize("delay", [20, 61, 130])
def test_what_a_bend_of_one_sign_adds_to_a_read_is_in_the_answer(
    command: float, delay: int
) -> None:
    """s1' = s0 and s0' = a command that has not changed: s1 was s1 + t s0 + t^2 / 2 of it."""
    check = check_of("s0", law="clamp(-0.1 * pose.s1, -2.0, 2.0)")
    check.times = TubeTimes(0, 0, 0, delay * MS, 5 * MS, 50 * MS, 9)
    caller = Caller(check.text_in_flight(dict.fromkeys(check.states, Interval(-1.0, 1.0))))
    sizes = check._whole_number_constants()
    none = (0.0,) * sizes["SYMBOLS"]
    s0, s1 = 0.3, -0.2
    states = [(s, 0.0, s, s, none) for s in (s0, s1)]
    acted = [(command, 0.0, command, command, none)] * sizes["ACTED"]
    past = [[(command, command), (-10.0, 10.0)]] * sizes["DEPTH"]
    (answer,), _, found = caller.result("answered", states, acted, past, 1)
    assert found
    c, r, low, high, g = answer
    room = r + sum(map(abs, g))
    for k in range(101):
        t = -delay * 1e-3 + k * (delay * 1e-3 + 10e-3) / 100
        read = s1 + t * s0 + t * t / 2 * command
        assert max(low, c - room) <= -0.1 * read <= min(high, c + room)
