"""Angles that need not come back at rest, checked again: no certificate says it of another state.

Purpose: `wraps` of an entry, each condition of "An angle that turns" broken in turn.
Non-goals: what the prover finds (`verify/tubes/test_turning_angles.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from soter.api.program import load
from soter.certificate.rechecker import recheck
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.tubes.check_rest import recheck_rest, tube_of_entry
from tables import all_rows
from unit.certificate.tubes.rest_entries import entry, flat_of
from unit.certificate.tubes.test_forged_rest import changed
from unit.verify.tubes.test_turning_angles import AHEAD, BOAT, BODY, COUNTED, ROLLS, SEAM

if TYPE_CHECKING:
    from pathlib import Path

BOX, WAYS = (-0.401, 0.401), (-0.45, 0.45)


def boat(text: str = BOAT, wraps: Any = ("b.h",)) -> tuple[Any, dict[str, Any]]:
    flat = flat_of(text)
    made = entry(flat, {"b.x": BOX}, {"b.x": WAYS})
    made["rest"]["wraps"] = list(wraps)
    return flat, made


def rolls(rate: str, low: float = -1.001, high: float = 1.001) -> tuple[Any, dict[str, Any]]:
    flat = flat_of(rate if "\n" in rate else ROLLS.replace("RATE", rate))
    made = entry(flat, {"p.x": (low, high)}, {"p.x": (low - 0.01, high + 0.01)})
    made["rest"]["wraps"] = ["p.h"]
    return flat, made


def test_an_angle_that_turns_is_confirmed_and_its_assumption_said() -> None:
    still = changed(ROLLS, ("RATE", "-x"), SEAM[1])
    rates = "-x + 0.1 * cos(h)", "-x * (1.3 + cos(h))", still
    for made in (boat(), *map(rolls, rates)):
        _, report = recheck_rest(*made)
        assert report.confirmed == ["P1a", "P1b", "P2a", "start"]
        (said,) = (a.text for a in report.assumptions if a.key.startswith("turns "))
        assert "within 16,384 rad of 0" in said


def test_what_is_proved_is_accepted(tmp_path: Path) -> None:
    (tmp_path / "boat.soter").write_text(ROLLS.replace("RATE", "-x * (1.3 + cos(h))"))
    load(tmp_path / "boat.soter").verify(refute=False, cert=tmp_path / "cert")
    assert "P2a" in recheck(tmp_path / "cert").modules[0].confirmed


@all_rows("name", [n for n in COUNTED if n != "in many sums"])
def test_an_angle_whose_turns_are_counted_is_rejected(name: str) -> None:
    with pytest.raises((RejectedError, NotRecheckedError)):
        recheck_rest(*boat(changed(BOAT, COUNTED[name])))


@all_rows("wraps", [[], ["b.x"], ["b.h", "b.x"], ["b.z"], "b.h", [7], None])
def test_what_is_no_angle_is_rejected(wraps: Any) -> None:
    flat, made = boat()
    made["rest"]["wraps"] = wraps
    with pytest.raises(RejectedError):
        recheck_rest(flat, made)


def test_an_angle_is_named_or_has_to_come_back() -> None:
    flat, made = boat()
    del made["rest"]["wraps"]
    with pytest.raises(RejectedError, match="`box` is not of the states"):
        recheck_rest(flat, made)


@pytest.mark.parametrize(
    ("rate", "why"),
    [
        ("-x * (0.3 + cos(h))", "does not certainly lead back"),
        (changed(ROLLS, *SEAM), "does not certainly lead back"),
        ("-x + 0.01 * wrap_angle(h)", "jumps"),
    ],
)
def test_rest_is_not_confirmed_where_some_heading_leads_away(rate: str, why: str) -> None:
    with pytest.raises(NotRecheckedError, match=why):
        recheck_rest(*rolls(rate))


def test_an_sc_that_pushes_away_at_some_headings_is_not_confirmed() -> None:
    law = "ahead: u * cos(fix.h) * (cos(fix.h) > -0.7 ? 1.0 : -1.0)"
    with pytest.raises(NotRecheckedError, match="does not certainly lead back"):
        recheck_rest(*boat(changed(BOAT, (AHEAD, law))))


@all_rows(("middle", "body", "safe"), [(2.55, BODY, False), (2.0, BODY, True)])
def test_an_estimate_is_good_only_if_rest_is_safe_at_all_headings(
    middle: float, body: str, safe: bool
) -> None:
    near = ("p.x) < 1.0", f"p.x - {middle}) < 0.1"), ("0.1 * cos(p.h)", body)
    text = changed(ROLLS, *near, ("RATE", f"{middle} - x"), ("x: float = 0.0", "x: float = 0.1"))
    flat = flat_of(text)
    ends = {"p.x": (middle - 0.101, middle + 0.101)}
    made = entry(flat, ends, ends)
    made["rest"]["wraps"] = ["p.h"]
    why = tube_of_entry(flat, made).why_not_good({"p.x": middle, "p.h": 0.0})
    assert (why is None) == safe


def test_an_estimate_many_turns_on_is_as_good_as_one_near_0() -> None:
    tube = tube_of_entry(*boat())
    for h, good in ((0.4, True), (16_000.0, True), (2e4, False)):
        assert (tube.why_not_good({"fix.x": 0.1, "fix.h": h}) is None) == good
