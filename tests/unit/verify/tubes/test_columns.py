"""Which columns of a tube are kept, and how many."""

from __future__ import annotations

import random
import re
from typing import TYPE_CHECKING

import pytest

from soter.language.front_end import check_file, system_to_prove
from soter.language.model import tree_walk
from soter.verify.deploy.missing_predicates import rest_claims
from soter.verify.problem.extract import extract
from soter.verify.tubes import leading_back
from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.rest_claims import show_rest_claims
from soter.verify.tubes.tube_check import TubeCheck
from soter.verify.tubes.tube_precision import MOST, PLAIN, PRECISIONS

if TYPE_CHECKING:
    from pathlib import Path

HOVER = """soter 1;
type Pose = { x: float, v: float, pitch: float, turn: float };
topic pose: Pose in { x in [-8.0, 8.0], v in [-6.0, 6.0], pitch in [-1.2, 1.2],
    turn in [-9.0, 9.0] } max_age 100us;
topic torque: float in [-60.0, 60.0] = 0.0;
node Ac period 40ms { publishes torque; step { publish torque = 0.0; } }
node Sc period 40ms phase 20ms { subscribes pose; publishes torque;
  step {
    let aim = 0.2 * (pose.v + 0.1 * pose.x);
    publish torque = clamp(80.0 * (aim - pose.pitch) - 18.0 * pose.turn, -59.0, 59.0);
  } }
rta M { ac Ac; sc Sc; period 40ms; safe abs(pose.x) < 7.0;
  rest abs(pose.x) < 6.0 && abs(pose.v) < 0.85 && abs(pose.pitch) < 0.11 && abs(pose.turn) < 0.75
      within 3s;
  verify { late dm 50us, sc 50us; response dm 15ms, sc 50us; acts within 200us to 300us; } }
plant Body period 1ms { reads torque;
  drives pose = { x: x, v: v, pitch: pitch, turn: turn };
  state x: float; state v: float; state pitch: float; state turn: float;
  disturbance gust: float in [-0.08, 0.08] hold 1s;
  der x = v; der v = gust - 9.81 * pitch; der pitch = turn; der turn = torque;
  measured pose.x within 0.01, pose.v within 0.01, pose.pitch within 0.003,
      pose.turn within 0.005; }
system S default { b: Body; module M; until 3s; }
"""


def check_of(text: str) -> TubeCheck:
    flat = system_to_prove(check_file("hover.soter", text), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    return TubeCheck(problem)


def kept_in_flight(check: TubeCheck) -> int:
    found = re.search(r"const KEEP: int = (\d+);", check.text_in_flight({}))
    assert found is not None
    return int(found[1])


def test_units_of_a_state_do_not_matter_for_what_is_kept() -> None:
    generated = check_of(HOVER).offline_text({})
    symbols = int(generated.split("const SYMBOLS: int = ")[1].split(";")[0])
    caller = Caller(generated)
    rng = random.Random(7)  # noqa: S311 - drawn forms

    def form(row: list[float], unit: float) -> tuple[object, ...]:
        wide = unit * sum(map(abs, row))
        return 0.0, 0.0, -wide, wide, tuple(unit * a for a in row)

    for state in range(4):
        rows = [[rng.uniform(-1.0, 1.0) for _ in range(symbols)] for _ in range(4)]
        u = (form(rows[0], 0.0),)
        before, after = (
            caller.result("reduced", tuple(form(r, units[i]) for i, r in enumerate(rows)), u)[0]
            for units in ([1.0] * 4, [1024.0 if i == state else 1.0 for i in range(4)])
        )
        for i in range(4):
            unit = 1024.0 if i == state else 1.0
            assert after[i][4] == tuple(unit * a for a in before[i][4]), (state, i)


@pytest.mark.long
def test_as_many_columns_fly_as_rest_is_shown_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOTER_CACHE", str(tmp_path))
    check = check_of(HOVER)
    assert kept_in_flight(check) == PRECISIONS[0].keep
    for again in (check, check_of(HOVER)):  # computed, then from the cache
        claims = rest_claims(again)
        assert (claims.kept, claims.start) == ("", "")
        assert claims.precision == again.precision == MOST
        assert kept_in_flight(again) == PRECISIONS[MOST].keep


@pytest.mark.long
@pytest.mark.parametrize("why", ["they do not fit into a step", "they do not show it either"])
def test_few_columns_stay_where_more_are_no_help(monkeypatch: pytest.MonkeyPatch, why: str) -> None:
    check = check_of(HOVER if "fit" in why else HOVER.replace("max_age 100us", "max_age 80ms"))
    monkeypatch.setattr(leading_back, "SPLITS", 0)
    if "fit" in why:
        most = Caller(check.offline_text({})).operations("follows")
        monkeypatch.setattr(tree_walk, "MAX_OPERATIONS", int(1.05 * most))
    assert "does not certainly lead back" in show_rest_claims(check).kept
    assert check.precision == PLAIN


@pytest.mark.long
def test_a_start_that_is_not_shown_leaves_rest_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """As one that a map does not call free: what shows rest flies all the same."""
    still = "state x: float; state v: float;"
    assert still in HOVER
    check = check_of(HOVER.replace(still, "state x: float = 6.95; state v: float = 3.0;"))
    monkeypatch.setattr(leading_back, "SPLITS", 0)
    claims = show_rest_claims(check)
    assert claims.kept == ""
    assert "from b.x in [6.95, 6.95]" in claims.start
    assert check.precision == MOST
