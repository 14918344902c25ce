"""Runs beyond a kink of SC are followed together: "A set on the way" of proof-flight.md.

What naive builds of it get wrong is played by a schedule each; the naive texts are asked, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate.report import RejectedError
from soter.certificate.terms.linear_enclosures import exact
from soter.certificate.tubes.check_rest import recheck_rest, tube_of_entry
from soter.certificate.tubes.collecting_tube import CollectingTube
from soter.certificate.tubes.rest_problem import read_rest_problem
from soter.verify.problem.problem import Interval
from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.kinks import Kink, kinks_of
from soter.verify.tubes.rest_claims import RestClaims
from unit.certificate.tubes.rest_entries import flat_of
from unit.certificate.tubes.test_forged_rest import HELD, held
from unit.verify.tubes.test_columns import check_of

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.tubes.tube_chains import StateSet

CART = """soter 1;
topic x: float in [-9.0, 9.0] max_age 1ms;
topic u: float in [-1.0, 1.0] = 0.0;
node Ac period 100ms { publishes u; step { publish u = 0.0; } }
node Sc period 100ms { subscribes x; publishes u;
  step { publish u = clamp(1000.0 * (1.5 - x), -1.0, 1.0); } }
rta M { ac Ac; sc Sc; period 100ms; safe x < 1.02; rest x > 0.88 within 3s;
  verify { TIMES } }
plant Cart period 1ms { reads u; drives x = x; state x: float = 0.0; der x = u;
  measured x within 0.0; }
system S default { c: Cart; module M; until 3s; }
"""
LATE = CART.replace("TIMES", "response sc 40ms;")
KINK = Kink(0, 0.9, 5.0)
WAYS = 0.5, 1.0
"""What is claimed of x once it rests: it is not asked here."""


def rechecked(
    text: str, seen: list[float] | None = None, ways: tuple[float, float] = WAYS
) -> str | None:
    """Why the re-checker does not see x settle; `seen` takes its highest value at each hold."""
    tube = CollectingTube(
        read_rest_problem(flat_of(text), "M"), {0: ways}, 0, (exact(0.9), exact(5.0))
    )
    hold = tube.chain.follow_hold

    def spied(body: StateSet, pieces: int) -> tuple[StateSet, list[Any]]:
        if seen is not None:
            seen.append(float(body.box[0][1]))
        return hold(body, pieces)

    tube.chain.follow_hold = spied  # type: ignore[method-assign]
    return tube.why_not_settled([(exact(0.65), exact(0.8))], 0, 0)


def test_a_late_command_meets_runs_that_are_collected_on_neither_side_of_its_window() -> None:
    """x < 0.8 at 400 ms, and SC moves it by 1 a second; outputs act at 500 ms and at 640 ms.

    At 500 ms x is just below 0.9, so it is not collected, and rises until 640 ms, to 1.04. At the
    end of the window of that output, at 540 ms, it is at 0.94, and went on from there.
    """
    times = check_of(LATE).times
    assert (times.jitter, times.period) == (40_000_000, 100_000_000)
    box = ([0.65], [0.8])

    def rests(text: str, safe: str) -> bool:
        check = check_of(LATE.replace("x < 1.02", safe))
        check.kink = KINK
        offline = check.offline_text({0: Interval(*WAYS)})
        assert offline.count("KINK_LOW + moves") == 1
        source = offline.replace("KINK_LOW + moves", text)
        since = "[{ lo: -1.0, hi: 1.0 }], IN_FLIGHT).rests"
        asked = f"fun asked(b: Region): bool {{ return settles(boxed(b), {since}; }}"
        return Caller(f"{source}\n{asked}").returns_true("asked", box)

    assert not rests("KINK_LOW + moves", "x < 1.02")
    assert rests("KINK_LOW + moves", "x < 1.3")
    assert rests("KINK_LOW", "x < 1.02")  # cut as if nothing moved in the window

    for safe, settled in (("x < 1.02", False), ("x < 1.3", True)):
        assert (rechecked(LATE.replace("x < 1.02", safe)) is None) == settled


def test_what_goes_on_may_have_been_beyond_when_the_window_of_an_output_began() -> None:
    """It fell until the output acted, for 80 ms after the earliest instant that is known of it."""
    seen: list[float] = []
    rechecked(LATE.replace("x < 1.02", "x < 1.3"), seen)
    assert 0.98 <= max(seen) < 0.9801


def test_the_outputs_before_and_behind_a_kink_are_added() -> None:
    """From 0.65 SC needs 14 outputs to 2.0, from 0.9 no more than 12."""
    far = (
        LATE.replace("x < 1.02", "x < 5.0").replace("x > 0.88", "x > 2.0").replace("1.5 -", "4.5 -")
    )
    for within, settled in (("1290ms", False), ("3s", True)):
        text = far.replace("within 3s", f"within {within}")
        assert (rechecked(text, ways=(1.9, 4.0)) is None) == settled


def test_nothing_is_collected_where_rest_is_shown() -> None:
    """SC goes on to the left for ever: what is met at output 0 did not come back there."""
    check = check_of(CART.replace("TIMES", "").replace("1000.0 * (1.5 - x)", "0.001 * x - 8.0"))
    check.kink = Kink(0, -3.0, 1.0)
    text = check.offline_text({})
    anywhere, box = ([-9.0], [9.0]), ([-2.0], [0.9])
    assert not Caller(text).result("keeps", box, anywhere, box)[0]
    naive = text.replace("!wanted.asked && (", "(").replace("n - began > 0, wanted", "true, wanted")
    box = ([-2.0], [1.02])
    assert not Caller(text).result("keeps", box, anywhere, box)[0]
    assert Caller(naive).result("keeps", box, anywhere, box)[0]


def test_a_certificate_may_collect_at_any_numbers_in_a_state_that_is_followed() -> None:
    flat, made = held(HELD.replace("v: float = 0.0", "v: float = 0.9"))
    right = {"state": "p.v", "at": [(-0.6).hex(), (0.6).hex()]}
    made["rest"]["collects"] = right
    _, report = recheck_rest(flat, made)
    assert "start" in report.confirmed
    assert isinstance(tube_of_entry(flat, made), CollectingTube)
    for wrong in (
        right | {"state": "p.w"},
        right | {"at": right["at"][::-1]},
        right | {"at": ["0.5", "0.6"]},
        right | {"sure": True},
        {"state": "p.v"},
    ):
        made["rest"]["collects"] = wrong
        with pytest.raises(RejectedError):
            recheck_rest(flat, made)


def test_the_kinks_are_those_of_clamps_that_read_one_state() -> None:
    plain = "publish u = clamp(1000.0 * (1.5 - x), -1.0, 1.0);"
    law = "let w = clamp(0.5 * (0.9 - x), -0.2, 0.2); publish u = clamp(w + 0.1 * x, -1.0, 1.0);"
    assert plain in LATE
    check = check_of(LATE.replace(plain, law))
    first, *_ = kinks_of(check.law)
    assert (first.state, first.low, first.high) == pytest.approx((0, 0.5, 1.3))


def test_a_module_that_needs_no_kink_has_nothing_of_it_in_its_check(tmp_path: Path) -> None:
    check = check_of(LATE)
    assert "heap" not in check.text_in_flight({})
    assert "n - began" not in check.text_in_flight({})
    claims = RestClaims(kink=KINK)
    claims.write(tmp_path / "claims")
    assert RestClaims.read(tmp_path / "claims") == claims
