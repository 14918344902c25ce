"""`--report`, which every command has that makes a page, and what `--help` says of folders."""

from __future__ import annotations

import csv
import json
import re
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.api import load
from soter.cli.main import COMMANDS, command_module, command_parser
from soter.diagnostics.command_records import options_of

if TYPE_CHECKING:
    from collections.abc import Callable

    Soter = Callable[..., Any]

ROOT = Path(__file__).resolve().parents[3]
NO_MANUAL = {"benchmarks.md", "decisions.md", "newcomers.md"}
"""Pages that tell what was measured, chosen and tried."""
PAGES = ("run", "test", "replay", "verify", "recheck", "campaign", "monitor", "advise")


@pytest.mark.parametrize("name", PAGES)
def test_every_command_that_makes_a_page_takes_report(name: str) -> None:
    options = command_parser(name)._option_string_actions
    assert "--report" in options
    assert ("--html" in options) is (name in ("test", "replay")), "as they called it first"
    if name not in ("test", "advise"):  # several pages; a page in any case
        assert options["--report"].nargs == "?"


def test_every_option_stands_on_a_page_beside_its_command() -> None:
    """In a section that names the command: who reads of one finds the other."""
    pages = [p for p in sorted((ROOT / "docs").glob("*.md")) if p.name not in NO_MANUAL]
    sections = [s for p in pages for s in re.split(r"(?m)^#+ ", p.read_text("utf-8"))]
    missing = []
    for command in COMMANDS.keys() - {"help"}:
        own = "\n".join(s for s in sections if re.search(rf"soter {command}\b|`{command}`", s))
        for known in options_of(command_module(command).Options).values():
            flags = [f for f in known.flags.split() if f.startswith("-")]
            if flags and not any(re.search(rf"(?<![\w-]){f}(?![\w-])", own) for f in flags):
                missing.append(f"{command} {flags[0]}")
    assert missing == []


@pytest.mark.parametrize("name", ["--report", "--html"])
def test_a_replayed_trace_has_a_page_without_a_path(soter: Soter, here: Path, name: str) -> None:
    program = (ROOT / "examples" / "testing" / "late_sc.soter").read_text("utf-8")
    (here / "late_sc.soter").write_text(program)
    assert soter("test", "late_sc.soter", "--test", "Late", name).exit == 3
    assert (here / ".soter" / "late_sc-Late.html").is_file()
    done = soter("replay", ".soter/late_sc-Late.trace.json", "--json", name)
    assert done.exit == 0
    assert done.document["html"] == ".soter/late_sc-Late-replay.html"
    assert (here / ".soter" / "late_sc-Late-replay.html").is_file()


# ---------------------------------------------------------------- monitor


def text_of(path: Path) -> str:
    """The words of a page, code in backticks as in a terminal."""
    page = re.sub(r"</?code>", "`", path.read_text("utf-8"))
    return unescape(re.sub(r"<[^>]*>", " ", page))


@pytest.mark.parametrize(("wind", "code"), [("[-0.2, 0.2]", 0), ("[-0.1, 0.1]", 3)])
def test_a_page_of_the_monitor_says_what_the_terminal_says(
    soter: Soter, here: Path, wind: str, code: int
) -> None:
    pytest.importorskip("mcap", reason="the extra `logs` is not installed")
    soter("run", "cart.soter", "--until", "1s", "--log", "flight.mcap")
    text = (here / "cart.soter").read_text().replace("[-0.2, 0.2]", wind)
    (here / "cart.soter").write_text(text)
    done = soter("monitor", "cart.soter", "flight.mcap", "--report")
    assert done.exit == code
    page = here / ".soter" / "cart-monitor.html"
    assert "report  .soter/cart-monitor.html" in done.out
    words = text_of(page)
    assert "cart.soter: flight.mcap" in words
    assert ("The model is false" in words) is (code == 3)
    assert ("the model explains every step" in words) is (code == 0)
    sha256 = load(here / "cart.soter").sha256
    assert sha256 is not None
    assert sha256 in words
    assert "An alarm is a step that none explains" in words
    row = next(line for line in done.out.splitlines() if line.startswith("SafeCart"))
    assert row.split() == words[words.index("SafeCart") :].split()[: len(row.split())]
    again = soter("monitor", "cart.soter", "flight.mcap", "--report", "m.html", "--json")
    assert again.document["report"] == "m.html"
    assert (here / "m.html").read_bytes() == page.read_bytes()


def test_a_page_of_a_log_of_somebody_else_has_its_assumptions(soter: Soter, here: Path) -> None:
    with (here / "a.csv").open("w", newline="") as file:
        rows = [[k / 50, 0.0005 * k * k, 0.05 * k] for k in range(200)]
        csv.writer(file).writerows([["t", "x", "v"], *rows])
    fields = {"motion": {"fields": {"x": "x", "v": "v"}}}
    mapping = {"system": "Protected", "time": {"from": "t"}, "topics": fields}
    (here / "map.json").write_text(json.dumps(mapping))
    done = soter("monitor", "cart.soter", "a.csv", "--map", "map.json", "--report", "--json")
    assert done.exit == (3 if done.document["log"]["modules"]["SafeCart"]["outside"] else 0)
    words = text_of(here / done.document["report"])
    for text in done.document["log"]["assumptions"]:
        assert text in words
    judged = done.document["log"]["modules"]["SafeCart"]
    assert f"{judged['steps']:,} steps of the DM" in words
    assert judged["changes"]
    for change in judged["changes"]:  # a row of a table each
        assert f"{change['time_s']:.3f} s {change['to']} {change['reason']}" in " ".join(
            re.sub(r"φ safe", "φ_safe", " ".join(words.split())).split()
        )
    if judged["outside"]:
        assert f"SafeCart: {judged['outside']:,} of" in words


def test_a_page_that_cannot_be_written_is_d006_and_one_of_no_judgement_u001(
    soter: Soter, here: Path
) -> None:
    (here / "file").write_text("")
    short = ("monitor", "cart.soter", "--until", "0.2s", "--json", "--report")
    assert soter(*short, "file/m.html").codes == ["D006"]
    assert soter(*short, "m.html", "--emit", "watch.soter").codes == ["U001"] * 2
    assert not (here / "watch.soter").exists()


# ---------------------------------------------------------------- recheck


@pytest.fixture
def certificate(soter: Soter, here: Path) -> Path:
    """A small certificate: of the tank, of which nothing claims that AC gets control back."""
    pytest.importorskip("flint", reason="the extra `prove` is not installed")
    page = (ROOT / "docs" / "prove-your-module.md").read_text("utf-8")
    tank = re.search(r"^```soter prove=tank.soter\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    assert tank is not None
    safer = "safer level > 0.4 && level < 1.6;"
    verify = f"{safer} verify {{ grid level in [0.2, 1.8] / 20; }}"
    (here / "tank.soter").write_text(tank[1].replace(safer, verify))
    soter("verify", "tank.soter", "--cert", "proof", "--no-refute")
    return here / "proof"


def test_a_page_of_the_rechecker_has_all_that_it_says(
    soter: Soter, here: Path, certificate: Path
) -> None:
    done = soter("recheck", "proof", "--report", "--json")
    words = text_of(here / ".soter" / "proof-recheck.html")
    assert done.document["report"] == ".soter/proof-recheck.html"
    assert "ACCEPTED IN PART" in words
    for text in (*done.document["assumptions"], done.document["program_sha256"]):
        assert text in words
    assert all(said["text"] in words for said in done.document["not_covered"])
    told = soter("recheck", "proof").out
    line = next(line for line in told.splitlines() if "not claimed: " in line)
    assert line.partition("not claimed: ")[2] in words, "as on the terminal"
    safe = re.search(r"(?m)^ +safe (.*?);", (here / "tank.soter").read_text("utf-8"))
    assert safe is not None
    assert words.index(f"`{safe[1]}`") < words.index("What was checked")
    (certificate / "SEAL").write_text("0" * 64 + "\n")
    refused = soter("recheck", "proof", "--report", "r.html", "--json")
    assert refused.exit == 3
    words = text_of(here / "r.html")
    assert "REJECTED" in words
    assert refused.document["reason"] in words


@pytest.mark.whole
def test_no_page_is_written_into_a_certificate(soter: Soter, here: Path, certificate: Path) -> None:
    for path in ("proof/r.html", "./proof/sets/../r.html"):
        assert soter("recheck", "proof", "--report", path, "--json").codes == ["U001"]
    assert not (here / "proof" / "r.html").exists()
    help_ = soter("recheck", "--help").out
    assert {p.name for p in certificate.iterdir()} <= set(re.findall(r"[\w.]+", help_))


# ---------------------------------------------------------------- folders


def named_in(help_: str) -> set[str]:
    return set(re.findall(r"[\w.-]+", help_))


@pytest.mark.parametrize("name", ["campaign", "assure", "run"])
def test_help_names_what_lies_in_the_folder_of_a_campaign(
    soter: Soter, here: Path, name: str
) -> None:
    arms = ("--arms", "swept", "--report")
    soter("campaign", "cart.soter", "--flights", "2", "--until", "1s", "-o", "flown", *arms)
    there = {re.sub("^arm-.*", "arm-NAME", p.name) for p in (here / "flown").iterdir()}
    assert {"campaign.json", "flights.csv", "report.html", "arm-NAME"} <= there
    assert there <= named_in(soter(name, "--help").out)


def test_help_names_what_a_test_leaves(soter: Soter, here: Path) -> None:
    program = (ROOT / "examples" / "testing" / "late_sc.soter").read_text("utf-8")
    (here / "late_sc.soter").write_text(program)
    soter("test", "late_sc.soter", "--test", "Late", "--report")
    names = {p.name.replace("late_sc-Late", "FILE-TEST") for p in (here / ".soter").iterdir()}
    names = {re.sub(r"plotly-\w+\.js", "plotly-....js", n) for n in names}
    assert names
    assert names <= named_in(soter("test", "--help").out)


def test_help_names_what_assure_and_run_write(soter: Soter, here: Path) -> None:
    from soter.api.assurance.safety_case import FILES

    assert set(FILES) <= named_in(soter("assure", "--help").out)
    pytest.importorskip("mcap", reason="the extra `logs` is not installed")
    soter("run", "cart.soter", "--until", "0.1s", "--log", "--report")
    names = {
        p.name.replace("cart-Protected-1", "FILE-SYSTEM-SEED") for p in (here / ".soter").iterdir()
    }
    names = {re.sub(r"plotly-\w+\.js", "plotly-....js", n) for n in names}
    assert names <= named_in(soter("run", "--help").out)
