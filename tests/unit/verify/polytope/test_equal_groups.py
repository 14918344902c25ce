"""Polytope groups with the same numbers, bit for bit: proved once, and the same is said of each."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.language.front_end import check_file, system_of
from soter.verify import verify_module as verifying
from soter.verify.enclose.compiled_enclosures import library_of
from soter.verify.polytope import proofs
from soter.verify.polytope.claims import PARTS, PolytopeProof
from soter.verify.polytope.linear_group import LinearGroup
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.verify.claims.case import Case

pytest.importorskip("highspy")

PLANE = """soter 1;
type Place = { x: float, y: float };
topic place: Place max_age 20ms;
topic push_x: float in [-1.0, 1.0];
topic push_y: float in [-1.0, 1.0];
plant Puck period 10ms {
  reads push_x, push_y;
  drives place = { x: x, y: y };
  state x: float in [-1.0, 1.0];
  state y: float in [-1.0, 1.0];
  disturbance wind_x: float in [-0.1, 0.1];
  disturbance wind_y: float in [-0.1, 0.1];
  der x = push_x + wind_x;
  der y = push_y + wind_y;
  measured place.x within 0.05, place.y within 0.05;
}
node Fast period 10ms {
  publishes push_x, push_y;
  step { publish push_x = 1.0; publish push_y = -1.0; }
}
node Back period 10ms {
  subscribes place;
  publishes push_x, push_y;
  step {
    publish push_x = clamp(-0.1 * place.x, -1.0, 1.0);
    publish push_y = clamp(-0.1 * place.y, -1.0, 1.0);
  }
}
rta Keep {
  ac Fast;
  sc Back;
  period 50ms;
  safe abs(place.x) < 9.0 && abs(place.y) < 9.0;
  verify {
    polytope place.x in [-10.0, 10.0];
    polytope place.y in [-10.0, 10.0];
    late sc 2ms; acts within 1ms;
  }
}
system Protected { p: Puck; module Keep; until 10s; }
"""


def case_of(*changes: tuple[str, str]) -> Case:
    text = PLANE
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    checked = check_file("plane.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    problem = extract(flat, flat.modules[0])
    library, _ = library_of(problem)
    (case,) = verifying._all_cases(problem, library)
    return case


def groups(case: Case) -> list[PolytopeProof]:
    return [p for p in case.proofs if isinstance(p, PolytopeProof)]


def numbers(proof: PolytopeProof) -> list[bytes]:
    """Every set and multiplier of a group."""
    sets = proof.found.sets
    assert sets is not None
    assert sets.kept is not None
    every = [sets.core, sets.free, sets.kept, *sets.allowed, *sets.carried]
    arrays = [getattr(p, name) for p in every for name in PARTS]
    arrays += [sets.rate, sets.kept_rate, np.array(sets.periods), np.array(proof.return_ns)]
    for name in sorted(proof.found.multipliers):
        arrays += proof.found.multipliers[name]
    return [a.tobytes() for a in arrays]


def test_a_group_with_the_numbers_of_another_has_its_sets_and_multipliers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[str] = []

    def counted(name: str) -> Callable[..., Any]:
        made = getattr(proofs, name)

        def count(*given: Any) -> Any:
            calls.append(name)
            return made(*given)

        return count

    for name in ("find_core", "find_levels", "find_return", "prove_core", "prove_return"):
        monkeypatch.setattr(proofs, name, counted(name))
    case = case_of()
    assert not case.failures
    x, y = groups(case)
    assert y.equal is x
    assert len(calls) == len(set(calls)) == 5, "each once for both"
    monkeypatch.setattr(LinearGroup, "equals", lambda *_: False)
    alone = groups(case_of())
    assert len(calls) == 5 + 2 * 5
    assert [numbers(p) for p in alone] == [numbers(x), numbers(y)]
    assert sorted(y.found.multipliers) == ["K", "Q", "R", "S", "start"]


def test_the_way_back_to_another_target_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    predicates = """ttf abs(place.x) > 6.0 || abs(place.y) > 6.0;
  safer abs(place.x) < 5.0 && abs(place.y) < 4.0;
  verify {"""
    case = case_of(("verify {", predicates))
    assert not case.failures
    x, y = groups(case)
    assert y.equal is x
    monkeypatch.setattr(LinearGroup, "equals", lambda *_: False)
    alone = groups(case_of(("verify {", predicates)))
    assert [numbers(p) for p in alone] == [numbers(x), numbers(y)]
    assert numbers(x) != numbers(y)


@pytest.mark.parametrize(
    "change",
    [
        ("disturbance wind_y: float in [-0.1, 0.1]", "disturbance wind_y: float in [-0.1, 0.11]"),
        ("place.y within 0.05", "place.y within 0.06"),
        ("-0.1 * place.y", "-0.11 * place.y"),
        ("polytope place.y in [-10.0, 10.0]", "polytope place.y in [-10.0, 10.5]"),
        ("der y = push_y + wind_y", "der y = push_y + wind_y + 0.01"),
    ],
)
def test_a_group_with_another_number_is_proved_itself(change: tuple[str, str]) -> None:
    x, y = groups(case_of(change))
    assert y.equal is None
    assert numbers(x) != numbers(y)


def test_where_a_group_starts_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LinearGroup, "equals", lambda *_: True)
    case = case_of(("state y: float in [-1.0, 1.0]", "state y: float in [-1.0, 9.5]"))
    x, y = groups(case)
    assert y.equal is x
    assert [(f.claim, f.proof) for f in case.failures] == [("start", y)]


def test_what_is_not_shown_of_one_is_not_said_of_the_other() -> None:
    wind = "disturbance wind_{}: float in [-{}, {}]"
    stronger = [(wind.format(a, 0.1, 0.1), wind.format(a, 3.0, 3.0)) for a in "xy"]
    case = case_of(*stronger)
    assert {f.proof for f in case.failures if f.claim == "P2a"} == set(groups(case))


def test_every_number_counts() -> None:
    x, _ = groups(case_of())
    assert x.found.model is not None
    group = x.found.model.group
    assert group.equals(replace(group))
    for field in fields(group):
        value = np.asarray(getattr(group, field.name))
        others: list[Any] = [value + 1 if value.size else np.zeros((1, *value.shape[1:]))]
        for other in (*others, value[None]):
            change: dict[str, Any] = {field.name: other}
            assert not group.equals(replace(group, **change)), field.name
