"""`replace M by contract;`: what stands there, what is said of it, who holds M to it."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

from soter.api.exploring import with_skew_and_horizon
from soter.api.program import load
from soter.cli.main import main
from soter.diagnostics.diagnostic import SoterError
from soter.explore import assumptions, command
from soter.explore.engine.search import Search
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from pathlib import Path

    from soter.explore.results import TestResult

MODULE = """soter 1;
topic w: int in [0, 3];
topic u: int in [0, 3];
topic v: bool;
topic seen: int in [0, 3];
node Wind period 10ms { publishes w; step { publish w = choose [0, 3]; } }
node Fast period 10ms { subscribes w; publishes u, v; step { publish u = %s; publish v = u2(w); } }
node Slow period 10ms { publishes u, v; step { publish u = 0; publish v = false; } }
node Eye period 10ms { subscribes u, v; publishes seen; step { publish seen = v ? u : 0; } }
rta M { ac Fast; sc Slow; period 10ms; safe u < 4; ttf w > 2; safer w < 2; %s }
fun u2(n: int): bool { return n > 0; }
system S { node Wind; node Eye; module M; }
"""
TESTS = """
test AsItIs { system S; horizon 40ms; always true; }
test Replaced { system S; replace M by contract; horizon 40ms; always %s; }
"""


def explored(text: str, name: str) -> TestResult:
    checked = check_file("p.soter", text)
    system = system_of_test(checked, name)
    told = command.TraceHeader("p.soter", {}, assumptions.replacements_in_test(checked.tests[name]))
    return command.explore_test(system, SearchOptions(minimise=0.0), told)


def verdict(text: str, name: str) -> str:
    return explored(text, name).verdict


@pytest.mark.parametrize(
    ("asked", "clean"),
    [
        ("u < 3", True),  # what the contract says
        ("u != 2", False),  # it permits 0, 1 and 2
        ("u != 1", False),
        ("!v || u == 0", False),  # one output without the other: v stays, u changes
        ("v || u == 0", False),
        ("seen < 3", True),
    ],
)
def test_all_that_the_contract_permits_is_published_and_nothing_else(
    asked: str, clean: bool
) -> None:
    text = MODULE % ("min(w, 2)", "guarantees small: u < 3;") + TESTS % asked
    assert verdict(text, "AsItIs") == "exhausted"
    assert verdict(text, "Replaced") == ("exhausted" if clean else "violated")


def test_a_contract_that_misses_a_value_is_reported_where_the_module_runs() -> None:
    text = MODULE % ("min(w, 2)", "guarantees small: u < 2;") + TESTS % "u < 2"
    test_result = explored(text, "AsItIs")
    assert test_result.verdict == "violated"
    assert test_result.broken is not None
    assert "small of M: u < 2 in M.Fast" in test_result.broken.text
    assert verdict(text, "Replaced") == "exhausted"


def test_an_assumption_that_does_not_hold_is_reported_as_one() -> None:
    text = MODULE % ("min(w, 2)", "assumes calm: w < 3;") + TESTS % "true"
    test_result = explored(text, "AsItIs")
    assert test_result.broken is not None
    assert test_result.broken.text.startswith("assumes calm of M: w < 3 in M.")


def test_guarantees_that_read_others_are_asked_with_what_they_read() -> None:
    text = MODULE % ("min(w, 2)", "guarantees led: u <= w;") + TESTS % "u <= w || seen < 9"
    assert verdict(text, "AsItIs") == "exhausted"
    assert verdict(text, "Replaced") == "exhausted"
    # not always true: w may change afterwards
    assert verdict(text.replace("u <= w || seen < 9", "u <= w"), "Replaced") == "violated"
    # of what was read as it was published it is: w < 1 leaves u = 0
    still = text.replace("publish w = choose [0, 3]", "publish w = 0")
    assert verdict(still.replace("u <= w || seen < 9", "u == 0"), "Replaced") == "exhausted"


def test_the_report_says_who_is_asked_to_keep_the_contract() -> None:
    text = MODULE % ("min(w, 2)", "guarantees small: u < 3;") + TESTS % "u < 3"
    told = list(assumptions.contract_notes(system_of_test(check_file("p.soter", text), "Replaced")))
    assert len(told) == 1
    assert told[0] == (
        "M is replaced by its contract (small: u < 3): whether it keeps it is asked by `AsItIs`, "
        "where it runs as it is, as far as horizon, inputs, skew, faults, order and replacements "
        "there go"
    )
    alone = text.replace("system S; horizon", "system S; replace Fast by Slow2; horizon")
    alone = alone.replace(
        "rta M", "node Slow2 period 10ms { publishes u, v; step { publish u = 0; } }\nrta M"
    )
    told = list(
        assumptions.contract_notes(system_of_test(check_file("p.soter", alone), "Replaced"))
    )
    assert len(told) == 1
    assert told[0].endswith(
        "no test of this program runs it as it is (`AsItIs` but for a controller): "
        "that it keeps it is assumed"
    )


def test_a_clause_that_cannot_be_asked_permits_more_and_is_named() -> None:
    clause = "guarantees led: mode(M) == Mode.AC || u == 0; guarantees small: u < 3;"
    text = MODULE % ("min(w, 2)", clause) + TESTS % "u < 3"
    system = system_of_test(check_file("p.soter", text), "Replaced")
    [told] = assumptions.contract_notes(system)
    assert "(small: u < 3; not asked for, so that more is permitted: led: mode(M) ==" in told
    with Search(system, SearchOptions()) as search:
        assert search.run().status == "exhausted"


def test_a_module_may_be_replaced_by_a_node_and_a_node_by_its_contract() -> None:
    text = MODULE % ("min(w, 2)", "") + TESTS % "u == 0"
    by_node = text.replace("M by contract", "M by Slow")
    assert verdict(by_node, "Replaced") == "exhausted"
    test_result = explored(by_node, "Replaced")
    assert any(
        a.startswith("M is replaced by Slow: said of whatever") for a in test_result.assumptions
    )
    text = text.replace("replace M by contract", "replace Eye by contract")
    text = text.replace("publishes seen; step", "publishes seen; guarantees seen < 3; step")
    assert verdict(text.replace("always u == 0", "always seen < 3"), "Replaced") == "exhausted"
    assert verdict(text.replace("always u == 0", "always seen < 2"), "Replaced") == "violated"


def test_a_controller_may_be_replaced_by_its_contract() -> None:
    text = MODULE % ("min(w, 2)", "") + TESTS % "u < 3"
    text = text.replace("M by contract", "Fast by contract")
    assert verdict(text, "Replaced") == "violated"
    text = text.replace(
        "publishes u, v; step { publish u = m",
        "publishes u, v; guarantees u < 3; step { publish u = m",
    )
    assert verdict(text, "Replaced") == "exhausted"


def test_the_deployed_order_is_told_and_excludes_a_skew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = MODULE % ("min(w, 2)", "") + TESTS % "true"
    text = text.replace("system S; horizon", "system S; order deployed; horizon")
    (tmp_path / "p.soter").write_text(text, encoding="utf-8")
    assert main(["test", "--json", "--test", "AsItIs", "p.soter"]) == 0
    document = json.loads(capsys.readouterr().out)
    said = document["tests"][0]["assumptions"]
    assert any("within an instant in the deployed order, inputs first" in s for s in said)
    system = system_of_test(check_file("p.soter", text), "AsItIs")
    with pytest.raises(SoterError) as problem:
        with_skew_and_horizon(system, 1_000_000, None)
    assert problem.value.diagnostics[0].code == "E017"


LIAR = """soter 1;
param MAX: int = 3;
topic go: int in [0, 3];
topic seen: int in [0, 9];
node Liar period 10ms { publishes go; guarantees go <= 1; step { publish go = MAX; } }
node Honest period 10ms { publishes go; guarantees go <= 2; step { publish go = 1; } }
node Count period 10ms { subscribes go; publishes seen; step { publish seen = go; } }
system S { watch: Liar; node Count; }
system Other { watch: %s; node Count; }
test CountAlone { system S; horizon 20ms; replace watch by contract; never seen > 1; }
test WatchAlone { system %s; horizon 20ms; %s never go > 3; }
"""


@pytest.mark.parametrize(
    ("other", "system", "sets", "said"),
    [
        ("Honest", "Other", "", "as it is: that"),
        ("Liar", "Other", "", "as it is (`WatchAlone` in another system): that"),
        ("Liar", "S", "set MAX = 1;", "as it is (`WatchAlone` with other parameters): that"),
    ],
)
def test_only_a_test_of_the_same_node_in_the_same_system_asks_for_its_contract(
    other: str, system: str, sets: str, said: str
) -> None:
    text = LIAR % (other, system, sets)
    [told] = assumptions.contract_notes(system_of_test(check_file("p.soter", text), "CountAlone"))
    assert told.endswith(f"no test of this program runs it {said} it keeps it is assumed")


def test_the_summary_names_a_test_that_was_asked_for_a_contract_and_is_not_clean(
    tmp_path: Path,
) -> None:
    path = tmp_path / "p.soter"
    path.write_text(LIAR % ("Honest", "S", ""))
    report = load(path).explore()
    assert [t.verdict for t in report.tests] == ["exhausted", "violated"]
    assert report.tests[0].contracts == {"watch": ["WatchAlone"]}
    assert report.unclean_contracts_note(report.tests[0]).startswith(
        "but `WatchAlone`, asked for a contract"
    )
    path.write_text((LIAR % ("Honest", "S", "")).replace("= MAX; }", "= 1; }"))
    report = load(path).explore()
    assert not report.unclean_contracts_note(report.tests[0])


def test_a_clause_that_cannot_be_judged_is_not_said_to_be_a_fault_of_the_node(
    tmp_path: Path,
) -> None:
    text = LIAR % ("Honest", "S", "")
    text = text.replace("guarantees go <= 1", "guarantees 6 / go > 2").replace("= MAX;", "= 1;")
    path = tmp_path / "p.soter"
    path.write_text(text)
    [test_result] = load(path).explore("CountAlone").tests
    assert test_result.broken is not None
    assert test_result.broken.text == "what the contract of watch permits can be judged"
