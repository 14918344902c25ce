"""What a certificate says that an SC keeps: forged ranges, and what is not shown again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.tubes.check_rest import recheck_rest
from soter.certificate.tubes.rest_problem import read_rest_problem
from unit.certificate.tubes.rest_entries import entry, flat_of
from unit.verify.tubes.test_variables_of_sc import FLOAT, INTEGRAL, KEPT, PHASE, WRONG, keeping

if TYPE_CHECKING:
    from collections.abc import Callable

BOX, WAYS = {"p.v": (-0.31, 0.31)}, {"p.v": (-0.4, 0.4)}
Keeps = dict[str, list[str]]


def ends(low: float, high: float) -> list[str]:
    return [low.hex(), high.hex()]


def certified(text: str, keeps: Keeps) -> tuple[Any, dict[str, Any]]:
    """A module's entry, by hand, with what SC keeps."""
    flat = flat_of(text)
    made = entry(flat, BOX, WAYS, keeps)
    return flat, made


RANGES = {
    "an integral": {"i": ends(-0.2, 0.2)},
    "a filter": {"i": ends(-2.1, 2.1)},
    "what is read at a takeover": {"i": ends(-2.0, 2.0)},
    "numbers of a record": {
        "r.a": ends(-0.05, 0.05), "r.b[0]": ends(0.0, 0.1), "r.b[1]": ends(-0.05, 0.05),
    },
    "a branch that leaves it": {"i": ends(-0.2, 0.2)},
}  # fmt: skip


@pytest.mark.parametrize("name", KEPT)
def test_ranges_that_no_step_leaves_are_shown_again(name: str) -> None:
    flat, made = certified(keeping(*KEPT[name]).replace(*PHASE), RANGES.get(name, {}))
    _, report = recheck_rest(flat, made)
    assert {"P2a", "start"} <= set(report.confirmed)


FORGED = {
    "too narrow": {"i": ends(-0.1, 0.1)},
    "at its first value alone": {"i": ends(0.0, 0.0)},
    "shifted": {"i": ends(-0.1, 0.2)},
}


@pytest.mark.parametrize("name", FORGED)
def test_a_range_that_a_step_leaves_is_not_confirmed(name: str) -> None:
    flat, made = certified(keeping(FLOAT, INTEGRAL, "i"), FORGED[name])
    with pytest.raises(NotRecheckedError, match="keep a number outside of its range"):
        recheck_rest(flat, made)


def test_a_range_that_a_takeover_leaves_is_not_confirmed() -> None:
    code = f"let before = i; {INTEGRAL}"
    for value, why in (("0.15 * seen", "outside of its range"), ("0.3", "SC faults")):
        text = keeping(f"{FLOAT} on takeover {{ i = {value}; }}", code, "before")
        with pytest.raises(NotRecheckedError, match=why):
            recheck_rest(*certified(text, {"i": ends(-0.2, 0.2)}))


def renamed(keeps: Keeps) -> None:
    keeps["j"] = keeps.pop("i")


def left_out(keeps: Keeps) -> None:
    del keeps["i"]


def one_more(keeps: Keeps) -> None:
    keeps["j"] = keeps["i"]


def begins_outside(keeps: Keeps) -> None:
    keeps["i"] = ends(0.1, 0.2)


def endless(keeps: Keeps) -> None:
    keeps["i"] = ["-inf", "inf"]


@pytest.mark.parametrize("change", [renamed, left_out, one_more, begins_outside, endless])
def test_ranges_that_are_not_of_the_program_are_rejected(change: Callable[[Keeps], None]) -> None:
    flat, made = certified(keeping(FLOAT, INTEGRAL, "i"), {"i": ends(-0.2, 0.2)})
    change(made["rest"]["keeps"])
    with pytest.raises(RejectedError):
        recheck_rest(flat, made)


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_of_what_sc_keeps_is_not_confirmed(name: str) -> None:
    declared, code, added = WRONG[name]
    keeps = {"i": ends(-3.0, 3.0)} if "float" in declared else {}
    with pytest.raises(NotRecheckedError):
        recheck_rest(*certified(keeping(declared, code, added), keeps))


def test_a_kept_float_without_a_range_is_not_read() -> None:
    with pytest.raises(RejectedError):
        read_rest_problem(flat_of(keeping(FLOAT, INTEGRAL, "i")), "Held")


def test_a_takeover_that_may_fault_is_not_confirmed_of_an_sc_that_keeps_nothing() -> None:
    _, report = recheck_rest(*certified(keeping("", "", "0.0"), {}))
    assert "P2a" in report.confirmed
    faulting = keeping("on takeover { assert seen < 0.1; }", "", "0.0")
    with pytest.raises(NotRecheckedError, match="SC may fault"):
        recheck_rest(*certified(faulting, {}))
