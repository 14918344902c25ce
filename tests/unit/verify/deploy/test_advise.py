"""`soter advise`: the sweep says what a Delta costs, and agrees with `soter verify`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

import soter
from json_documents import problems_of
from soter.cli.main import main
from soter.verify import verify_module as verifying

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.period_advice import Advice


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory, open_text: str) -> Advice:
    path = tmp_path_factory.mktemp("swept") / "open.soter"
    path.write_text(open_text, encoding="utf-8")
    (advice,) = soter.load(path).advise(factors=(0.4, 4, 40), levels=(2, 3))
    return advice


def test_a_longer_period_leaves_ac_less(swept: Advice) -> None:
    periods = [r.delta_ns for r in swept.rows]
    assert periods == [20_000_000, 200_000_000, 2_000_000_000]
    assert [r.allowed for r in swept.rows] == sorted((r.allowed for r in swept.rows), reverse=True)
    assert swept.rows[0].allowed > swept.rows[1].allowed > 0.0
    assert all(r.core == swept.rows[0].core for r in swept.rows), "K is SC's alone"
    assert all(r.levels[3] <= r.levels[2] == r.allowed for r in swept.rows)


def test_a_period_too_long_does_not_verify(swept: Advice) -> None:
    last = swept.rows[-1]
    assert not last.verifies(3)
    assert last.levels[3] == 0.0
    assert swept.best_ns is None or swept.best_ns < last.delta_ns


@pytest.mark.long
def test_what_it_says_of_the_declared_period_is_what_verify_says(
    open_cart: Path, swept: Advice, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(verifying, "REFINEMENTS_MAX", 0)
    text = open_cart.read_text(encoding="utf-8").replace("period 50ms", "period 200ms")
    open_cart.write_text(text, encoding="utf-8")
    row = swept.rows[1]
    (module,) = soter.load(open_cart).verify(refute=False).modules
    assert (module.findings["P2b"].verdict == "proved") == row.returns[3]
    assert (module.findings["start"].verdict == "proved") == row.starts
    assert module.problem.times.h_star == row.h_star_ns
    assert module.core_share == pytest.approx(row.core)


@pytest.fixture(scope="module")
def one_period(tmp_path_factory: pytest.TempPathFactory, open_text: str) -> Advice:
    """SC steps with the DM; at half the period it may act later than half of its own."""
    text = open_text.replace("Careful period 10ms", "Careful period 50ms")
    text = text.replace("acts within 1ms", "acts within 12ms")
    assert text.count("50ms") > open_text.count("50ms")
    assert "12ms" in text
    path = tmp_path_factory.mktemp("one") / "one.soter"
    path.write_text(text.replace("max_age 20ms", "max_age 80ms"), encoding="utf-8")
    (advice,) = soter.load(path).advise(factors=(0.1, 0.5, 1, 2), levels=(2,))
    return advice


def test_a_longer_period_is_tried_with_the_period_of_sc_kept_and_changed(
    one_period: Advice,
) -> None:
    pairs = [(r.delta_ns / 1e6, r.sc_ns / 1e6) for r in one_period.rows]
    assert pairs == [(5, 5), (25, 25), (50, 50), (100, 50), (100, 100)]
    before, kept, changed = one_period.rows[2:]
    assert kept.core == before.core > changed.core, "a slower SC keeps less"
    assert "5 ms, 25 ms, 50 ms, 100 ms; SC's period kept at 50 ms and changed" in one_period.summary
    assert one_period.page().summary == one_period.summary


def test_times_that_the_theorem_does_not_cover_are_a_row_that_says_why(
    one_period: Advice,
) -> None:
    first, *rest = one_period.rows
    assert first.why.startswith("P1a: AC steps every 10 ms")
    assert not first.verifies(2)
    assert all(r.core > 0.0 for r in rest)
    assert [x for x, _ in one_period.page().lines[0].points] == [25.0, 50.0, 100.0]


def test_a_period_that_sc_needs_for_itself_is_a_row_that_says_why(
    open_text: str, tmp_path: Path
) -> None:
    path = tmp_path / "slow.soter"
    text = open_text.replace("Careful period 10ms", "Careful period 50ms")
    text = text.replace("late dm 1ms, sc 1ms", "late dm 1ms, sc 30ms")
    path.write_text(text.replace("max_age 20ms", "max_age 80ms"), encoding="utf-8")
    (advice,) = soter.load(path).advise(factors=(0.5, 1), levels=(2,))
    assert any(r.why.startswith("R015: SC may take ") for r in advice.rows), advice.rows


def test_the_command_prints_draws_and_documents(
    open_cart: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "deep" / "advice.html"
    arguments = ["advise", str(open_cart), "--factors", "40", "--levels", "2", "-o", str(page)]
    assert main([*arguments, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    assert len(document["modules"]["SafeCart"]["rows"]) == 1
    assert "2 s; SC's period kept at 10 ms" in document["modules"]["SafeCart"]["summary"]
    assert "<svg" in page.read_text(encoding="utf-8")
    assert main(arguments) == 0
    assert "no period" in capsys.readouterr().out


@pytest.mark.parametrize("wrong", [["--levels", "1"], ["--levels", "x"], ["--factors", "0"]])
def test_wrong_numbers_are_usage(open_cart: Path, wrong: list[str]) -> None:
    assert main(["advise", str(open_cart), *wrong]) == 2
