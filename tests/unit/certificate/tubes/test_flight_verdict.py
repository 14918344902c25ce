"""What a tube in Arb says of single estimates."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from flint import arb

from soter.certificate.tubes.rest_problem import read_rest_problem
from soter.certificate.tubes.tube_chains import ModuleTube
from soter.language.front_end import check_file, system_to_prove

if TYPE_CHECKING:
    from soter.language.model.system import System

FOLLOW = Path(__file__).parents[4] / "examples" / "evidence" / "follow.soter"
WAYS = {"r.v": (-0.31, 0.31)}


def flat(text: str) -> System:
    checked = check_file("module.soter", text)
    assert checked.program is not None, checked.diagnostics.items
    return system_to_prove(checked, next(iter(checked.systems)), {}, exact=False)


def follower(text: str) -> ModuleTube:
    system = flat(text)
    problem = read_rest_problem(system, system.modules[0].name)
    names = [s.name for s in problem.facts.states]
    return ModuleTube(problem, {names.index(n): ends for n, ends in WAYS.items()})


def test_estimates_are_good_where_a_brake_is_early_enough() -> None:
    """From 36 m/s a train needs 18 m, and what it comes to until it brakes; 19 m are too few."""
    train = follower(FOLLOW.read_text(encoding="utf-8"))
    assert train.estimate_fields == ["sight.gap", "sight.way", "sight.v"]
    good = [(60.0, 0.0, 10.0), (23.2, 0.0, 36.0), (60.0, 376.0, 36.0), (9.0, 390.0, 0.0)]
    bad = [(22.0, 0.0, 36.0), (60.0, 379.0, 36.0), (-0.1, 0.0, 0.0), (60.0, 0.0, 39.95)]
    for estimates, expected in ((good, True), (bad, False)):
        for e in estimates:
            assert (
                train.why_not_good(dict(zip(train.estimate_fields, e, strict=True))) is None
            ) == expected, e
    assert (
        train.why_not_good({"sight.gap": float("nan"), "sight.way": 0.0, "sight.v": 0.0})
        is not None
    )
    assert train.why_starts_not_good() is None


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("gas: 0.0, brake: 1.0 }; }", "gas: 1.0, brake: 0.0 }; }"),
        ("within 5s", "within 100ms"),
        ("sight.gap by CREEP down", "sight.gap by 5.0 down"),
    ],
)
def test_no_estimate_is_good_where_sc_does_not_end_at_rest(old: str, new: str) -> None:
    text = FOLLOW.read_text(encoding="utf-8")
    assert text.count(old) == 1
    train = follower(text.replace(old, new))
    assert (
        train.why_not_good(dict(zip(train.estimate_fields, (4.0, 0.0, 5.0), strict=True)))
        is not None
    )


@pytest.mark.parametrize(
    ("verify", "alpha"),
    [("", 100), ("acts within 9ms;", 100), ("acts within 4ms to 9ms; late dm 3ms;", 101)],
)
def test_an_output_of_sc_acts_no_earlier_than_it_takes_at_least(verify: str, alpha: int) -> None:
    """Delta - J_dm + L_min is the larger part of alpha here."""
    text = FOLLOW.read_text(encoding="utf-8")
    text = text.replace("within 5s;\n", f"within 5s;\n  verify {{ {verify} }}\n")
    system = flat(text)
    assert read_rest_problem(system, system.modules[0].name).times.alpha == alpha * 1_000_000


def test_boxes_stay_if_each_does_where_one_around_them_does_not() -> None:
    """C is what is on one side or the other; the box around both has what is between."""
    text = FOLLOW.read_text(encoding="utf-8")
    safe = "safe sight.gap > 0.0 && sight.way < END;"
    assert text.count(safe) == 1
    train = follower(text.replace(safe, "safe abs(sight.gap) > 1.0 && sight.way < END;"))

    def box(low: float, high: float) -> list[tuple[arb, arb]]:
        return [(arb(low), arb(high)), (arb(0), arb(1)), (arb(0), arb(1))]

    left, right, between = box(-3.0, -2.0), box(2.0, 3.0), box(0.5, 2.0)
    assert train.are_within_c([right, box(3.0, 4.0)])
    assert train.are_within_c([left, right])
    assert not train.are_within_c([left, between])
    assert not train.are_within_c([between])
