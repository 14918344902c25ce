"""What a test changed of its program stands with its verdict, wherever that is told."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest

from soter.cli.main import main
from soter.explore.command import TraceHeader, explore_test
from soter.explore.search_options import SearchOptions
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from pathlib import Path

    from soter.explore.results import TestResult

PROGRAM = """soter 1;
param LIMIT: int = 5 in [0, 1000];
param GAIN: float = 0.5 in [0.0, 2.0];
input topic wish: int in [0, 1000] = 0;
input topic go: bool = false;
topic u: int in [0, 1000] = 0;
node Hasty period 10ms { subscribes wish; publishes u; step { publish u = min(wish, LIMIT); } }
node Calm period 10ms { publishes u; step { publish u = 0; } }
rta M { ac Hasty; sc Calm; period 20ms; safe wish <= 1000; ttf !go; safer go; }
system S { module M; until 1s; force M ac; }
test T { system S; horizon 30ms; set LIMIT = 7; WISH input go in { true, false } every 20ms;
  never u > BOUND; }
"""
TWO = "input wish in { 3, 500 } every 10ms;"


def source(wish: str = TWO, bound: int = 7) -> str:
    return PROGRAM.replace("WISH", wish).replace("BOUND", str(bound))


def found(text: str) -> TestResult:
    system = system_of_test(check_file("small.soter", text), "T")
    return explore_test(system, SearchOptions(minimise=0), TraceHeader("small.soter", {}))


def test_values_that_are_picked_of_a_wider_set_are_a_bound() -> None:
    result = found(source())
    assert (result.verdict, result.bound) == ("bound", "picked")
    assert "picked" in result.why
    narrow = source().replace("wish: int in [0, 1000]", "wish: int in [0, 1]")
    assert found(narrow.replace("{ 3, 500 }", "{ 1, 0 }")).verdict == "exhausted"
    assert found(narrow.replace("{ 3, 500 }", "{ 1 }")).bound == "picked"
    assert found(narrow.replace(TWO, "input wish every 10ms;")).verdict == "exhausted"


EXPECTED = (
    "said of these values of parameters: LIMIT = 7 (by itself 5), GAIN = 0.5",
    "M is forced to AC: nothing is said of it where its DM decides",
    (
        "wish takes one of 3, 500, picked of [0, 1,000], every 10 ms and keeps it until then: "
        "no other value and no other time was tried"
    ),
    (
        "go takes one of true, false, which is its whole set, every 20 ms and keeps it until then: "
        "no other value and no other time was tried"
    ),
)


@pytest.mark.parametrize("bound", [7, 2])
def test_what_the_test_changed_stands_in_every_format(
    bound: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.soter").write_text(source(bound=bound))
    code = main(["test", "small.soter", "--junit", "out.xml", "--html"])
    text = " ".join(capsys.readouterr().out.split())
    main(["test", "small.soter", "--json"])
    told = json.loads(capsys.readouterr().out)["tests"][0]["assumptions"]
    junit = " ".join((tmp_path / "out.xml").read_text().split())
    for line in EXPECTED:
        assert line in told
        assert line in text
        assert line in junit
    assert code == (4 if bound == 7 else 3)
    if bound == 2:
        trace = json.loads((tmp_path / ".soter/small-T.trace.json").read_text())
        page = re.sub(r"<[^>]+>|\s+", "", (tmp_path / ".soter/small-T.html").read_text())
        for line in EXPECTED:
            assert line in trace["assumptions"]
            assert re.sub(r"\s+", "", line) in page.replace("&nbsp;", "")


def test_a_parameter_of_the_command_line_stands_there_as_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.soter").write_text(source())
    main(["test", "small.soter", "--set", "GAIN=1.5", "--json"])
    told = json.loads(capsys.readouterr().out)["tests"][0]["assumptions"]
    assert any("GAIN = 1.5 (by itself 0.5)" in line for line in told)


def test_what_is_set_or_picked_isnever_left_out_of_a_long_list() -> None:
    many = "".join(f"param P{i}: int = 1 in [0, 9];\n" for i in range(14))
    text = (
        source()
        .replace("param LIMIT", many + "param LIMIT")
        .replace("set LIMIT", "set P13 = 4; set LIMIT")
    )
    text = text.replace("{ 3, 500 }", "{ " + ", ".join(map(str, range(20))) + " }")
    told = "\n".join(found(text).assumptions)
    assert "P13 = 4 (by itself 1)" in told
    assert "LIMIT = 7 (by itself 5)" in told
    assert "17, 18, 19, picked of" in told


NESTED = """soter 1;
topic u: int in [0, 9] = 0;
node A period 10ms { publishes u; step { publish u = 1; } }
node B period 10ms { publishes u; step { publish u = 2; } }
system Robot { node A; }
system Pair { r: Robot; k: Robot; replace r.A by B; }
system S { p: Pair; never p.r.u == 1; }
test T { system S; horizon 30ms; }
"""


def test_what_a_system_inside_replaces_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.soter").write_text(NESTED)
    assert main(["test", "small.soter", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["tests"][0]["assumptions"]
    assert "p.r.A is replaced by B: said of whatever does only what B may do" in told
