"""What of a test says nothing is told, and nothing else is."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from generators.vacuous_tests import OTHERS, RELATED, TAUTOLOGIES, TELLING, TIMED, VACUOUS, program
from long_tests import some
from soter.cli.main import main
from soter.explore import constant_truth, vacuous_tests
from soter.explore.assumptions import replacements_in_test
from soter.explore.command import TraceHeader, explore_test
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from pathlib import Path

    from soter.explore.results import TestResult
    from soter.explore.vacuous_tests import VacuousPart

STATIC = (*TAUTOLOGIES, *RELATED)


def told(text: str) -> tuple[VacuousPart, ...]:
    """What is told without a search."""
    checked = check_file("small.soter", text)
    assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items]
    system = system_of_test(checked, "T")
    assert system.test is not None
    met = [(True, True)] * (len(system.properties) + len(system.test.timed))
    return vacuous_tests.find_vacuous_parts(system, met, ended=False)


def found(text: str) -> TestResult:
    checked = check_file("small.soter", text)
    about = TraceHeader("small.soter", {}, replacements_in_test(checked.tests["T"]))
    return explore_test(system_of_test(checked, "T"), SearchOptions(minimise=0), about)


@pytest.mark.whole
def test_a_property_that_no_value_violates_is_told_without_a_search() -> None:
    missed = [item for item in STATIC if not any(v.cannot_fail for v in told(VACUOUS[item]))]
    assert missed == []


@pytest.mark.whole
def test_what_could_fail_is_not_told() -> None:
    assert {name: told(text) for name, text in TELLING.items() if told(text)} == {}


def test_without_a_solver_floats_that_are_compared_with_each_other_are_left_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(constant_truth, "solver_proves", lambda *_: False)
    assert [item for item in STATIC if not told(VACUOUS[item])] == list(RELATED)


@pytest.mark.parametrize("name", some([*OTHERS, *TIMED, *STATIC], 8))
def test_what_says_nothing_is_told(name: str) -> None:
    result = found(VACUOUS[name])
    assert result.verdict != "violated"
    assert result.vacuous or result.bound in {"unjudged", "undriven"}


@pytest.mark.parametrize("name", some(list(reversed(TELLING)), 6))
def test_what_says_something_is_not_told(name: str) -> None:
    result = found(TELLING[name])
    assert result.vacuous == ()
    assert result.bound != "unjudged"


@pytest.mark.parametrize(
    ("items", "said"),
    [
        ("always x == x; never x > 9;", "; none of its properties can fail\n"),
        ("always x == x; always x < 9;", "; 1 of its properties cannot fail\n"),
    ],
)
def test_the_headline_says_how_many_cannot_fail(
    items: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.soter").write_text(program(items))
    assert main(["test", "small.soter"]) == 0
    assert said in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("always !(x > 8) || light == Light.Red", "`x > 8` held in no execution"),
        ("eventually x < 3 within 20ms", "holds at the start already"),
        ("x > 8 leadsto y within 10ms", "`x > 8` held in no execution in time"),
    ],
)
def test_what_is_never_asked_for_is_seen_by_the_search(name: str, why: str) -> None:
    assert told(VACUOUS[name]) == ()
    assert why in found(VACUOUS[name]).vacuous[0].why


def test_what_is_awaited_where_it_holds_already_cannot_fail() -> None:
    assert [v.cannot_fail for v in told(program("y && x > 2 leadsto y within 10ms;"))] == [True]
    assert told(program("x > 2 leadsto x > 3 within 10ms;")) == ()


def test_a_search_that_did_not_end_does_not_say_never() -> None:
    text = VACUOUS["always !(x > 8) || light == Light.Red"]
    checked = check_file("small.soter", text)
    system = system_of_test(checked, "T")
    for options in (SearchOptions(max_states=5), SearchOptions(strategy="random", runs=3)):
        assert explore_test(system, options, TraceHeader("small.soter", {})).vacuous == ()


def test_every_format_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.soter").write_text(program("always x >= 0; always x < 3;"))
    assert main(["test", "small.soter", "--junit", "out.xml", "--html"]) == 3
    text = capsys.readouterr().out
    main(["test", "small.soter", "--json"])
    test = json.loads(capsys.readouterr().out)["tests"][0]
    why = "cannot fail: it holds for every value of what it reads"
    line = f"always x >= 0 {why}"
    assert test["vacuous"] == [{"what": "property", "name": "always x >= 0", "why": why}]
    assert text.count(line) == 1
    assert line in test["assumptions"]
    assert line in (tmp_path / "out.xml").read_text().replace("&gt;", ">")
    assert line in json.loads((tmp_path / ".soter/small-T.trace.json").read_text())["assumptions"]
    assert "cannot fail: it holds" in (tmp_path / ".soter/small-T.html").read_text()
