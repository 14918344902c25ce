"""`--format sarif|junit|github`: what continuous integration reads of check, verify and test."""

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
