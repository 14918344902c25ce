"""Extern nodes and functions in a system: what they get, and that nothing they do gets out."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.language.evaluate.arithmetic import FaultKind
from soter.semantics.configuration import AC, SC
from soter.semantics.externs import ExternResetError, UnboundExternError

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.semantics.interpreter import Interpreter

    Build = Callable[..., Interpreter]

MS = 1_000_000
DM, SAFE, LEARNED = 0, 1, 2
WHERE, U = 0, 1  # in order of first mention: by the DM, then by SC

MODULE = """
type Vec = { a: float, b: float };
type Job = enum { IDLE, BUSY };
input topic where: Vec; input topic job: Job; input topic laser: float[3];
topic u: Vec in [-1.0, 1.0];
extern node Learned period 10ms { subscribes where, job, laser; publishes u; }
node Careful period 10ms { subscribes where; publishes u; step { publish u = where; } }
rta M { ac Learned; sc Careful; period 10ms; clean 2;
        safe true; ttf where.a > 5.0; safer where.a < 1.0; }
system S { module M; until 1s; }
"""


def run(build: Build, learned: object, until_ms: int = 30) -> tuple[Any, Any]:
    it = build(MODULE, externs={"M.Learned": learned})
    return it.run(until_ms * MS)


def test_an_extern_node_gets_its_topics_by_short_name(build: Build) -> None:
    seen: list[SimpleNamespace] = []

    def learned(inputs: SimpleNamespace) -> list[float]:
        seen.append(inputs)
        return [0.5, -0.5]

    c, _ = run(build, learned)
    assert len(seen) == 4
    assert vars(seen[0]).keys() == {"where", "job", "laser"}
    assert (seen[0].where.a, seen[0].job) == (0.0, "IDLE")
    assert isinstance(seen[0].laser, np.ndarray)
    assert seen[0].laser.shape == (3,)
    assert c.Topics[U] == (0.5, -0.5)


@pytest.mark.parametrize(
    "answer",
    [
        {"u": {"a": 0.25, "b": 0.5}},
        {"u": SimpleNamespace(a=0.25, b=0.5)},
        {"a": 0.25, "b": 0.5},
        SimpleNamespace(a=0.25, b=0.5),
        (0.25, 0.5),
        np.array([0.25, 0.5], dtype=np.float32),
    ],
)
def test_answers_may_take_any_of_the_shapes(build: Build, answer: object) -> None:
    c, record = run(build, lambda _: answer)
    assert c.Topics[U] == (0.25, 0.5)
    assert record.modules[0].gate_faults == 0


def raising(error: type[Exception]) -> Callable[[object], object]:
    def step(_: object) -> object:
        raise error

    return step


@pytest.mark.parametrize(
    ("learned", "kind"),
    [
        (raising(ValueError), FaultKind.EXTERN),
        (raising(RecursionError), FaultKind.EXTERN),
        (lambda: (0.0, 0.0), FaultKind.EXTERN),
        (lambda _: (0.0,), FaultKind.EXTERN),
        (lambda _: "go", FaultKind.EXTERN),
        (lambda _: {"v": 0.0}, FaultKind.EXTERN),
        (lambda _: np.zeros((2, 2)), FaultKind.EXTERN),
        (lambda _: (0.0, math.nan), FaultKind.NONFINITE),
        (lambda _: (0.0, math.inf), FaultKind.NONFINITE),
        (lambda _: (0.0, 1.5), FaultKind.RANGE),
    ],
)
def test_nonsense_of_an_extern_ac_is_a_gate_fault(
    build: Build, learned: object, kind: FaultKind
) -> None:
    c, record = run(build, learned)
    assert record.components[LEARNED].last_fault == kind
    assert record.modules[0].gate_faults == 4
    assert c.L[DM] == SC
    assert c.clean_needed == (2,)
    assert record.violations == 0


def test_silence_is_no_fault_but_earns_nothing(build: Build) -> None:
    c, record = run(build, lambda _: None)
    assert record.components[LEARNED].faults == 0
    assert c.L[DM] == AC
    assert c.stamps[U] < 0, "nothing was ever published: SC never acted, AC is silent"


def test_an_object_with_a_step_is_reset_at_every_start(build: Build) -> None:
    class Policy:
        def __init__(self) -> None:
            self.seeds: list[int] = []
            self.steps = 0

        def reset(self, seed: int) -> None:
            self.seeds.append(seed)
            self.steps = 0

        def step(self, _: SimpleNamespace) -> tuple[float, float]:
            self.steps += 1
            return 0.01 * self.steps, 0.0

    policy = Policy()
    it = build(MODULE, seed=42, externs={"M.Learned": policy})
    first, _ = it.run(30 * MS)
    second, _ = it.run(30 * MS)
    assert first == second
    assert first.Topics[U] == (0.04, 0.0)
    assert policy.seeds == [42, 42]


def test_a_reset_that_raises_is_named(build: Build) -> None:
    class Policy:
        def reset(self, _: int) -> None:
            msg = "no weights"
            raise OSError(msg)

        def step(self, _: SimpleNamespace) -> tuple[float, float]:
            return 0.0, 0.0

    with pytest.raises(ExternResetError, match=r"`M\.Learned` .* OSError: no weights"):
        run(build, Policy())


def test_what_is_not_bound_is_named_before_the_run(build: Build) -> None:
    with pytest.raises(UnboundExternError) as caught:
        build(MODULE)
    assert caught.value.names == ("M.Learned",)
    with pytest.raises(TypeError, match="not callable"):
        build(MODULE, externs={"M.Learned": 3})


FUNCTION = """
topic y: float;
extern fun Ask(a: float): float;
extern fun NeverAsked(a: float): float;
node N period 10ms { publishes y; failsafe y = -1.0; step { publish y = Ask(2.0); } }
system S { node N; until 1s; }
"""


def test_an_extern_function_is_bound_by_name(build: Build) -> None:
    c, record = build(FUNCTION, externs={"Ask": lambda a: a + 1}).run(0)
    assert (c.Topics[0], record.violations) == (3.0, 0)


def test_a_broken_extern_function_is_a_fault_of_its_trusted_caller(build: Build) -> None:
    c, record = build(FUNCTION, externs={"Ask": lambda _: "three"}).run(0)
    assert (c.Topics[0], c.latched[0]) == (-1.0, True)
    assert record.components[0].last_fault == FaultKind.EXTERN
    assert record.violations == 1


def test_only_functions_that_are_called_need_a_binding(build: Build) -> None:
    with pytest.raises(UnboundExternError) as caught:
        build(FUNCTION)
    assert caught.value.names == ("Ask",)


def test_a_fault_says_what_the_extern_said(build: Build) -> None:
    def learned(_: object) -> object:
        msg = "no weights"
        raise FileNotFoundError(msg)

    it = build(MODULE, externs={"M.Learned": learned})
    c = it.initial()
    outcomes = []
    c = it.instant(c)
    from soter.semantics.rules import discrete_time_progress_step

    c = discrete_time_progress_step(it.machine, c)
    while c.FN:
        c, event = it.fire(c, c.FN[0])
        outcomes.append(event)
    fault = outcomes[-1].fault  # type: ignore[union-attr]
    assert fault is not None
    assert fault.detail == "`M.Learned`: FileNotFoundError: no weights"


# ---------------------------------------------------------------- on takeover

TAKEN = MODULE.replace(
    "publishes u; }", "publishes u; var taken: int; on takeover { taken = taken + 1; } }", 1
)


def taken(c: Any) -> int:
    """How often the extern AC took over."""
    count: int = c.L[LEARNED][0]
    return count


def test_on_takeover_of_an_extern_runs_once_each_time_control_comes(build: Build) -> None:
    it = build(TAKEN, externs={"M.Learned": lambda _: {"u": (0.0, 0.0)}})
    far, near = [(WHERE, (9.0, 0.0))], [(WHERE, (0.0, 0.0))]
    seen, c = [], it.initial()
    for inputs in ([], [], far, near, []):
        c = it.instant(c, choose_input=lambda _, i=inputs: i)  # type: ignore[misc]
        seen.append((c.OE[LEARNED], taken(c)))
    assert seen == [(True, 1), (True, 1), (False, 1), (True, 2), (True, 2)]


@pytest.mark.parametrize("nonsense", [3, {"u": (2.0, 0.0)}])
def test_on_takeover_of_an_extern_is_undone_by_a_fault_and_comes_with_control(
    build: Build, nonsense: object
) -> None:
    answers = iter([nonsense])
    good = {"u": (0.0, 0.0)}
    it = build(TAKEN, externs={"M.Learned": lambda _: next(answers, good)})
    seen, c = [], it.initial()
    for _ in range(5):  # the second is the DM's, then two clean steps are owed
        c = it.instant(c)
        seen.append((c.OE[LEARNED], taken(c)))
    assert seen == [(True, 0), (False, 0), (False, 0), (True, 1), (True, 1)]


def test_a_lost_value_is_a_fault_before_on_takeover_but_after_the_answer(build: Build) -> None:
    text = TAKEN.replace("input topic where", "input topic beat: int; input topic where").replace(
        "where, job, laser;", "where, job, laser, beat queue 1 fault;"
    )
    asked = []

    def learned(inputs: Any) -> object:
        asked.append(tuple(inputs.beat))
        return {"u": (0.0, 0.0)}

    it = build(text, externs={"M.Learned": learned})
    c = it.initial()
    beat = it.system.topic("beat").index
    c = it.instant(c, choose_input=lambda _: [(beat, 1), (beat, 2)])
    assert asked == [(1,)]
    assert (c.gate_fault, taken(c)) == ((True,), 0)
