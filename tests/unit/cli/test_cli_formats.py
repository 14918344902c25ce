"""`--format sarif|junit|github`: what CI reads of check, verify, test and monitor."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

    Soter = Callable[..., Any]

ROOT = Path(__file__).resolve().parents[3]
BAD = "soter 1;\n\nconst A: int = true;\ntopic t: float in [1.0, 0.0];\nconst U: int = 1;\n"
TESTED = (ROOT / "examples" / "testing" / "late_sc.soter").read_text()


def sarif_of(text: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The run and its results, after the schema's required fields were looked at."""
    document = json.loads(text)
    assert document["version"] == "2.1.0"
    assert document["$schema"].endswith("sarif-schema-2.1.0.json")
    (run,) = document["runs"]
    driver = run["tool"]["driver"]
    assert driver["name"] == "soter"
    for rule in driver["rules"]:
        assert rule["id"]
        assert all(rule[k]["text"] for k in ("shortDescription", "help") if k in rule)
    for invocation in run["invocations"]:
        assert isinstance(invocation["executionSuccessful"], bool)
    for result in run["results"]:
        assert result["message"]["text"]
        assert result["level"] in ("none", "note", "warning", "error")
        assert driver["rules"][result["ruleIndex"]]["id"] == result["ruleId"]
        for location in result.get("locations", []):
            region = location["physicalLocation"]["region"]
            assert 1 <= region["startLine"] <= region["endLine"]
            assert region["startColumn"] >= 1
            assert location["physicalLocation"]["artifactLocation"]["uri"]
    return run, run["results"]


def places(results: list[dict[str, Any]]) -> list[tuple[str, str, int]]:
    locations = []
    for r in results:
        at = r["locations"][0]["physicalLocation"]
        locations.append((r["ruleId"], at["artifactLocation"]["uri"], at["region"]["startLine"]))
    return locations


def test_check_as_sarif(soter: Soter, here: Path) -> None:
    (here / "my bad.soter").write_text(BAD)
    done = soter("check", "my bad.soter", "cart.soter", "--format", "sarif")
    assert done.exit == 1
    run, results = sarif_of(done.out)
    named = {(rule, line) for rule, uri, line in places(results) if uri == "my%20bad.soter"}
    assert len(named) == len(results) >= 2
    assert {line for _, line in named} >= {3, 4}
    assert run["invocations"][0]["exitCode"] == 1
    assert sarif_of(soter("check", "cart.soter", "--format=sarif").out)[1] == []


def test_check_as_commands_of_github(soter: Soter, here: Path) -> None:
    (here / "bad.soter").write_text(BAD)
    done = soter("check", "bad.soter", "--format", "github")
    assert done.exit == 1
    line = next(x for x in done.out.splitlines() if ",line=3," in x)
    command = (
        r"::error title=soter%3A [A-Z]\d+,file=bad\.soter,line=3,endLine=3,col=\d+,endColumn=\d+::"
    )
    assert re.match(command, line)
    assert "%0A" in done.out, "one line a command"
    assert "error[" in done.err, "the log stays readable"
    fine = soter("check", "cart.soter", "--format", "github")
    assert (fine.exit, "::" in fine.out) == (0, False)


def test_properties_of_github_are_escaped(soter: Soter, here: Path) -> None:
    (here / "a,b:c%.soter").write_text(BAD)
    assert "file=a%2Cb%3Ac%25.soter," in soter("check", "a,b:c%.soter", "--format", "github").out


def cases(text: str) -> list[ET.Element]:
    """The cases of JUnit's XML, after the figures were compared with what is there."""
    root = ET.fromstring(text)  # noqa: S314 - it is ours
    assert root.tag == "testsuites"
    for of in (root, *root.findall("testsuite")):
        test_cases = list(of.iter("testcase"))
        assert int(of.attrib["tests"]) == len(test_cases)
        for tag, figure in (("failure", "failures"), ("error", "errors")):
            assert int(of.attrib[figure]) == sum(c.find(tag) is not None for c in test_cases)
    assert all(c.attrib["classname"] and c.attrib["name"] for c in root.iter("testcase"))
    return list(root.iter("testcase"))


def test_check_as_junit(soter: Soter, here: Path) -> None:
    (here / "bad.soter").write_text(BAD)
    done = soter("check", "bad.soter", "cart.soter", "--format", "junit")
    assert done.exit == 1
    test_cases = cases(done.out)
    failed = [c for c in test_cases if c.find("failure") is not None]
    assert {c.attrib["classname"] for c in failed} == {"bad.soter"}
    assert [c.attrib["classname"] for c in test_cases if c not in failed] == ["cart.soter"]


@pytest.mark.long
def test_verify_in_all_formats(soter: Soter, here: Path) -> None:
    text = (here / "cart.soter").read_text()
    for old, new in (
        ("/ 400", "/ 50"),
        ("/ 320", "/ 40"),
        ("ttf Room(motion, 0.12)", "ttf Room(motion, 0.0)"),
    ):
        assert old in text
        text = text.replace(old, new)
    (here / "coarse.soter").write_text(text)
    line = text[: text.index("rta SafeCart")].count("\n") + 1
    run = ("verify", "coarse.soter", "--no-refute", "--format")
    done = soter(*run, "sarif")
    assert done.exit == 4
    _, results = sarif_of(done.out)
    assert results
    assert {p[1:] for p in places(results)} == {("coarse.soter", line)}
    assert all("undecided" in r["message"]["text"] for r in results)
    test_cases = cases(soter(*run, "junit").out)
    assert len(test_cases) == 11, "one case a property"
    assert {c.attrib["name"] for c in test_cases if c.find("error") is not None} == {
        f"SafeCart: {r['ruleId']}" for r in results
    }
    assert not any(c.find("failure") is not None for c in test_cases), "undecided is no failure"
    said = soter(*run, "github").out
    assert said.count("::error title=soter%3A ") == len(results)
    assert "UNDECIDED" in said, "people still read it"


def test_test_in_all_formats(soter: Soter, here: Path) -> None:
    (here / "late.soter").write_text(TESTED)
    line = TESTED[: TESTED.index("\ntest ") + 1].count("\n") + 1
    name = re.findall(r"^test (\w+)", TESTED, re.MULTILINE)[0]
    run = ("test", "late.soter", "--test", name, "--format")
    done = soter(*run, "sarif")
    assert done.exit == 3
    _, (result,) = sarif_of(done.out)
    assert places([result]) == [("test", "late.soter", line)]
    assert "soter replay " in result["message"]["text"]
    (case,) = cases(soter(*run, "junit").out)
    assert case.find("failure") is not None
    assert f"file=late.soter,line={line}," in soter(*run, "github").out


def test_what_ends_a_command_is_told_in_its_format(soter: Soter) -> None:
    done = soter("test", "nothing.soter", "--format", "sarif")
    _, (result,) = sarif_of(done.out)
    assert (done.exit, result["ruleId"], "locations" in result) == (1, "D001", False)
    (case,) = cases(soter("verify", "nothing.soter", "--format", "junit").out)
    assert case.find("failure") is not None
    assert "::error title=soter%3A D001::" in soter("check", "nothing.soter", "--format=github").out


@pytest.mark.parametrize(
    "arguments",
    [
        ("check", "cart.soter", "--format", "yaml"),
        ("check", "cart.soter", "--format"),
        ("check", "cart.soter", "--format", "sarif", "--json"),
        ("run", "cart.soter", "--format", "sarif"),
    ],
)
def test_a_wrong_format_is_a_wrong_command_line(soter: Soter, arguments: tuple[str, ...]) -> None:
    assert soter(*arguments).exit == 2


@pytest.fixture
def monitored(soter: Soter, here: Path) -> Callable[[str], Any]:
    """`monitored(format)`: half of the wind is declared of what blew in the log, so no run fits."""
    pytest.importorskip("mcap", reason="the extra `logs` is not installed")
    soter("run", "cart.soter", "--until", "1s", "--log", "flight.mcap")
    text = (here / "cart.soter").read_text()
    assert text.count("[-0.2, 0.2]") == 1
    (here / "half.soter").write_text(text.replace("[-0.2, 0.2]", "[-0.1, 0.1]"))
    return lambda wanted: soter("monitor", "half.soter", "flight.mcap", "--format", wanted)


def line_of(path: Path, text: str) -> int:
    return path.read_text().split(text)[0].count("\n") + 1


def test_monitor_as_sarif(monitored: Callable[[str], Any], soter: Soter, here: Path) -> None:
    done = monitored("sarif")
    run, (result,) = sarif_of(done.out)
    assert (done.exit, run["automationDetails"]["id"]) == (3, "soter/monitor/")
    at = ("monitor", "half.soter", line_of(here / "half.soter", "rta SafeCart"))
    assert (places([result]), result["level"]) == ([at], "error")
    assert "SafeCart: the model is false: alarms in " in result["message"]["text"]
    fits = soter("monitor", "cart.soter", "flight.mcap", "--format", "sarif")
    assert (fits.exit, sarif_of(fits.out)[1]) == (0, [])


def test_monitor_as_junit(monitored: Callable[[str], Any], soter: Soter) -> None:
    (case,) = cases(monitored("junit").out)
    assert (case.attrib["classname"], case.attrib["name"]) == ("half.soter", "SafeCart")
    failure = case.find("failure")
    assert failure is not None
    assert "c.v: " in (failure.text or ""), "the states that no disturbance reaches"
    (case,) = cases(soter("monitor", "cart.soter", "flight.mcap", "--format", "junit").out)
    assert case.find("failure") is None
    assert "explains each of 200 steps" in (case.findtext("system-out") or "")


def test_monitor_as_commands_of_github(monitored: Callable[[str], Any], here: Path) -> None:
    done = monitored("github")
    line = line_of(here / "half.soter", "rta SafeCart")
    assert f"::error title=soter%3A monitor,file=half.soter,line={line}," in done.out
    assert "The model is false" in done.out.replace("\n", " "), "people still read it"


LOG_MAP = {
    "time": {"from": "t"},
    "topics": {"motion": {"fields": {"x": "x", "v": "v"}, "between": "linear"}},
}


@pytest.mark.parametrize(("reach", "code"), [(3.0, 0), (30.0, 3)])
def test_monitor_of_a_log_of_somebody_else_in_all_formats(
    soter: Soter, here: Path, reach: float, code: int
) -> None:
    (here / "map.json").write_text(json.dumps(LOG_MAP))
    rows = [f"{k / 10},{k * reach / 30},{reach / 3}" for k in range(30)]
    (here / "log.csv").write_text("\n".join(("t,x,v", *rows)))
    run = ("monitor", "cart.soter", "log.csv", "--map", "map.json", "--format")
    done = soter(*run, "sarif")
    results = sarif_of(done.out)[1]
    assert (done.exit, len(results)) == (code, code // 3)
    (case,) = cases(soter(*run, "junit").out)
    told = case.find("failure" if code else "system-out")
    assert told is not None
    words = " reads lay outside `safe`"
    assert words in (told.text or "")
    assert "assumed: only reads are judged" in (told.text or ""), "no verdict without it"
    said = soter(*run, "github").out
    at = f"file=cart.soter,line={line_of(here / 'cart.soter', 'rta SafeCart')},"
    assert (at in said, f"{words}, the first at " in said) == (code == 3, code == 3)
