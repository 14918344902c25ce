"""What a plant cannot publish is nothing that a proof keeps: there the plant stops."""

from __future__ import annotations

import random
from fractions import Fraction
from typing import TYPE_CHECKING

import pytest

from soter.language.front_end import check_file
from soter.verify.chosen_modules import modules_of, problems_of
from soter.verify.problem.problem import assumption_texts
from soter.verify.verify_module import verify_module
from unit.verify.diagnosis.tank_modules import TANK, changed

if TYPE_CHECKING:
    from soter.verify.claims.results import ModuleResult

COARSE = ("[0.2, 1.8] / 320", "[0.2, 1.8] / 80")
SET = "topic level: float max_age"
COMPUTED = changed(
    COARSE,
    ("  ttf level < 0.25 || level > 1.75;\n", ""),
    ("  safer level > 0.4 && level < 1.6;\n", ""),
)
DRIVES = "  drives level = h;\n"


def proved_of(text: str) -> ModuleResult:
    """Verified, without runs and without a measured cause."""
    (problem,) = problems_of(modules_of(check_file("tank.soter", text), None, None, {}))
    return verify_module(problem, refute=False, explain=False)


def ends_of(module_result: ModuleResult) -> tuple[float, float]:
    """Of K, along its one axis; (1, 0) where there is none."""
    (proof,) = module_result.cases[0].proofs
    kept = proof.found.core > 0
    edges = proof.engine.edges[0]
    if not kept.any():
        return 1.0, 0.0
    return float(edges[kept.argmax()]), float(edges[len(kept) - kept[::-1].argmax()])


def dialled(value: str, bounds: str, *more: tuple[str, str]) -> str:
    """A tank with a dial that nobody reads."""
    dial = f"{DRIVES}  drives dial = {value};\n"
    declared = f"topic dial: float in {bounds};\ntopic pump"
    return changed((DRIVES, dial), ("topic pump", declared), *more, text=COMPUTED)


@pytest.mark.parametrize(
    ("low", "high"), [(0.0, 2.0), (0.19, 1.81), (0.5, 2.0), (0.0, 1.5), (0.25, 1.75), (0.97, 1.02)]
)
def test_every_estimate_of_k_can_be_published(low: float, high: float) -> None:
    declared = f"topic level: float in [{low!r}, {high!r}] = 1.0 max_age"
    module_result = proved_of(changed((SET, declared), text=COMPUTED))
    least, most = ends_of(module_result)
    if least < most:
        assert Fraction(least) - Fraction(0.01) >= Fraction(low)
        assert Fraction(most) + Fraction(0.01) <= Fraction(high)
    narrow = low > 0.19 or high < 1.81
    assert any("`level` takes only [" in n for n in module_result.notes) == narrow
    assert (module_result.verdict == "proved") == (high - low > 0.1)
    if not narrow:  # K is all of the grid that an error of 0.01 leaves in the set
        assert ends_of(proved_of(COMPUTED)) == (least, most)


@pytest.mark.parametrize(
    ("value", "bounds", "level"),
    [
        ("10.0 * h", "[-50.0, 50.0]", (0.0, 5.0)),
        ("10.0 * h", "[0.0, 15.0]", (0.0, 1.5)),
        ("1.0 / (h - 0.5)", "[0.0, 1000.0]", (0.5, 9.0)),  # at 0.5 it faults
        ("10.0 * h + 100.0 * leak", "[0.0, 15.0]", (0.0, 1.3)),
        ("h * h", "[0.0, 2.25]", (0.0, 1.5)),
    ],
)
def test_what_nobody_reads_is_published_all_the_same(
    value: str, bounds: str, level: tuple[float, float]
) -> None:
    module_result = proved_of(dialled(value, bounds))
    least, most = ends_of(module_result)
    assert module_result.verdict == "proved"
    assert level[0] <= least < most <= level[1]
    assert not any(
        "what plants publish lies" in a for a in assumption_texts(module_result.assumptions)
    )


@pytest.mark.parametrize(
    ("value", "bounds", "level"),
    [
        ("sqrt(h - 0.5)", "[0.0, 1000.0]", (0.5, 9.0)),
        ("1.0 / (h - 1.9)", "[-1000.0, 0.0]", (0.0, 1.9)),
    ],
)
def test_what_has_no_ends_in_the_ranges_is_no_crash(
    value: str, bounds: str, level: tuple[float, float]
) -> None:
    module_result = proved_of(dialled(value, bounds))
    least, most = ends_of(module_result)
    assert level[0] <= least < most <= level[1]


def test_of_a_clock_on_a_dial_nothing_is_proved() -> None:
    module_result = proved_of(dialled("time", "[0.0, 1000.0]"))
    assert module_result.verdict == "undecided"
    assert "`dial` takes only [0, 1000]" in module_result.findings["P2a"].hint


def test_a_list_on_a_dial_is_an_assumption() -> None:
    lists = "fun one(h: float): float[<=2] { var o: float[<=2] = []; push o, h; return o; }\n"
    dial = f"{DRIVES}  drives dial = one(h);\n"
    declared = f"{lists}topic dial: float[<=2] in [0.0, 1.5];\ntopic pump"
    module_result = proved_of(changed((DRIVES, dial), ("topic pump", declared), text=COMPUTED))
    assert module_result.verdict == "proved"
    assert any("what plants publish lies" in a for a in assumption_texts(module_result.assumptions))


def test_an_error_of_what_nobody_reads_counts() -> None:
    measured = ("  measured level within 0.01;", "  measured level within 0.01;\n")
    wrong = (measured[0], f"{measured[1]}  measured dial within 2.0;")
    assert ends_of(proved_of(dialled("10.0 * h", "[0.0, 15.0]", wrong)))[1] <= 1.3


def test_a_user_who_lets_ac_go_further_than_a_plant_can_publish_is_told() -> None:
    dial = f"{DRIVES}  drives dial = 10.0 * h;\n"
    declared = "topic dial: float in [0.0, 15.0];\ntopic pump"
    module_result = proved_of(changed((DRIVES, dial), ("topic pump", declared)))
    assert module_result.verdict == "undecided"
    assert "`dial` takes only [0, 15]" in module_result.findings["ttf"].hint


def test_without_a_set_nothing_is_asked() -> None:
    module_result = proved_of(TANK)
    assert module_result.verdict == "proved"
    assert all("scheme" in note for note in module_result.notes)


@pytest.mark.parametrize("seed", range(3))
def test_random_dials_against_the_middle_of_every_cell(seed: int) -> None:
    """No state of K publishes beyond its set; computed here in rationals, state by state."""
    rng = random.Random(seed)  # noqa: S311
    a, b = rng.choice((-3.0, 0.5, 7.0)), rng.uniform(-1.0, 1.0)
    low = rng.uniform(-8.0, -1.0)
    high = rng.uniform(1.0, 9.0)
    module_result = proved_of(dialled(f"{a!r} * h + {b!r}", f"[{low!r}, {high!r}]"))
    least, most = ends_of(module_result)
    for k in range(201):
        if least > most:
            break
        h = least + (most - least) * k / 200
        assert low - 1e-12 <= a * h + b <= high + 1e-12


def test_what_is_no_finite_number_is_not_published_and_that_is_said() -> None:
    huge = changed(
        (DRIVES, f"{DRIVES}  drives dial = exp(h * 1000.0);\n"),
        ("topic pump", "topic dial: float;\ntopic pump"),
        text=COMPUTED,
    )
    module_result = proved_of(huge)
    assert any("`dial` takes only finite numbers" in note for note in module_result.notes)
    assert ends_of(module_result)[1] < 0.8


def test_a_list_that_a_plant_writes_down_is_an_assumption() -> None:
    listed = changed(
        (DRIVES, f"{DRIVES}  drives dial = [h, h];\n"),
        ("topic pump", "topic dial: float[<=3] in [-5.0, 5.0];\ntopic pump"),
        text=COMPUTED,
    )
    module_result = proved_of(listed)
    assert any("lies in the declared sets: dial" in a.text for a in module_result.assumptions)
    assert not any("finite" in note for note in module_result.notes)
