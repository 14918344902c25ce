"""Execution times on the command line: `soter check` of programs with `wcet`, `soter measure`."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from unit.cli.conftest import Soter

PAGE = Path(__file__).parents[3] / "docs" / "timing.md"
(EXAMPLE,) = re.findall(r"^```soter\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
(PRINTED,) = re.findall(
    r"^```\n(thread .*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL
)


def write(text: str) -> None:
    Path("timed.soter").write_text(text, encoding="utf-8")


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(EXAMPLE)


def test_the_page_shows_what_check_prints(soter: Soter) -> None:
    done = soter("check", "timed.soter")
    assert done.exit == 0
    assert done.out.endswith("\n" + PRINTED)


def test_the_document_has_the_same_figures(soter: Soter) -> None:
    (timing,) = soter("check", "timed.soter", "--json").document["timings"]
    assert timing["verdict"] == "fits"
    assert timing["busy_ns"] == 2 * 100_000 + 10 * 300_000 + 10 * 200_000 + 4_000_000
    assert timing["hyperperiod_ns"] == 100_000_000
    sc = next(r for r in timing["thread"] if r["name"] == "SafeCart.Careful")
    assert (sc["start_ns"], sc["response_ns"], sc["slack_ns"]) == (150_000, 450_000, 9_550_000)
    (switch,) = timing["switches"]
    assert switch["verdict"] == "holds"
    assert switch["slack_ns"] == switch["horizon_ns"] - switch["needed_ns"] == 48_550_000
    assert switch["largest"] == "the period of the DM"
    assert timing["elsewhere"] == []


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("wcet 4ms", "wcet 21ms", "R034"),
        ("late dm 1ms, sc 1ms;", "", "R033"),
        ("horizon 120ms", "horizon 71ms", "P1c"),
    ],
)
def test_what_does_not_hold_is_an_error(soter: Soter, old: str, new: str, code: str) -> None:
    assert old in EXAMPLE
    write(EXAMPLE.replace(old, new))
    done = soter("check", "timed.soter", "--json")
    assert done.exit == 1
    assert code in done.codes
    assert soter("check", "timed.soter").exit == 1


def test_where_the_proof_counts_with_other_times_nothing_is_said_to_hold(soter: Soter) -> None:
    write(EXAMPLE.replace("late dm 1ms, sc 1ms;", ""))
    done = soter("check", "timed.soter")
    assert done.out.startswith("late  ")
    assert "P1c undecided: the proof counts with other times (R033)" in done.out
    assert "P1c holds" not in done.out
    (timing,) = soter("check", "timed.soter", "--json").document["timings"]
    assert timing["switches"][0]["verdict"] == "undecided"
    assert "P1c P2a P2b P3 assumed" in done.out
    write(EXAMPLE)
    right = soter("check", "timed.soter").out
    assert right.startswith("ok  ")
    assert "P1c holds" in right
    assert "SafeCart: P2a P2b P3 assumed, not checked" in right  # and not P1c, which was


def test_check_says_no_more_of_p1c_than_verify(soter: Soter) -> None:
    """The thread is quicker than the proof counts with: `verify` cannot know it."""
    write(EXAMPLE.replace("horizon 120ms", "horizon 71450us"))
    proved = soter("verify", "timed.soter", "--no-refute", "--json").document
    (module,) = proved["modules"].values()
    assert module["properties"]["P1c"]["verdict"] == "undecided"
    done = soter("check", "timed.soter")
    assert done.exit == 0
    assert "P1c undecided: the times of its `verify` block need 74 ms, and" in done.out


WORLD = """soter 1;
import "timed.soter" as t;
system World deploys t.Track {
  external topic t.motion every 5ms delayed 1ms measured t.motion.x within 0.0,
      t.motion.v within 0.0;
  external topic t.accel;
  module t.SafeCart;
  node t.Show;
}
"""


def test_the_thread_of_a_deployed_system_is_judged_where_its_plants_are(soter: Soter) -> None:
    """R002, that there is no plant, is no answer: in the world there is none."""
    (there,) = soter("check", "timed.soter", "--json").document["timings"]
    Path("world.soter").write_text(WORLD)
    done = soter("check", "world.soter", "--json")
    here = next(t for t in done.document["timings"] if t["system"] == "World")
    assert here["switches"][0]["slack_ns"] == there["switches"][0]["slack_ns"]
    assert here["switches"][0]["verdict"] == "holds"
    shown = soter("check", "world.soter").out
    assert "R002" not in shown
    assert "`soter build --cert` carries" in shown


def test_a_horizon_that_is_just_enough_is_enough(soter: Soter) -> None:
    write(EXAMPLE.replace("horizon 120ms", "horizon 71450us"))
    (timing,) = soter("check", "timed.soter", "--json").document["timings"]
    assert timing["switches"][0]["slack_ns"] == 0
    write(EXAMPLE.replace("horizon 120ms", "horizon 71449999ns"))
    assert soter("check", "timed.soter", "--json").codes == ["P1c"]


def test_a_miss_comes_with_its_schedule(soter: Soter) -> None:
    write(EXAMPLE.replace("wcet 4ms", "wcet 21ms"))
    document = soter("check", "timed.soter", "--json").document
    (timing,) = document["timings"]
    assert timing["verdict"] == "misses"
    assert timing["schedule"][-1] == (
        "SafeCart.Careful: release 1 at 10 ms, starts at 21.65 ms, ends at 21.95 ms"
    )
    (problem,) = [d for d in document["diagnostics"] if d["code"] == "R034"]
    assert set(timing["schedule"]) <= set(problem["notes"])


def test_without_a_wcet_of_everybody_nothing_is_claimed(soter: Soter) -> None:
    write(EXAMPLE.replace("  wcet 300us;\n", ""))
    done = soter("check", "timed.soter")
    assert done.exit == 0
    assert "is undecided" in done.out
    assert "no `wcet` is said of SafeCart.Careful" in done.out


def test_programs_without_execution_times_say_nothing_of_threads(soter: Soter) -> None:
    write(re.sub(r" *(wcet|jitter) [0-9a-z]+;[^\n]*\n", "", EXAMPLE))
    assert soter("check", "timed.soter", "--json").document["timings"] == []
    assert "thread" not in soter("check", "timed.soter").out


@pytest.mark.parametrize("number", ["0", "-5"])
def test_a_count_below_one_is_refused(soter: Soter, number: str) -> None:
    write(EXAMPLE)
    refused = soter("measure", "timed.soter", f"--samples={number}")
    assert refused.exit == 2
    assert "it has to be 1 at least" in refused.err


@pytest.mark.whole
def test_measured_times_are_printed_written_and_taken_by_check(soter: Soter) -> None:
    write(re.sub(r" *(wcet|jitter) [0-9a-z]+;[^\n]*\n", "", EXAMPLE))
    done = soter("measure", "timed.soter", "--samples", "40")
    assert done.exit == 0
    assert "no bound" in done.out
    assert re.search(r"wcet \d+us; +// rta SafeCart: 2 x the longest", done.out)
    assert re.search(r"wcet \d+us; +// node Show: 2 x the longest", done.out)
    told = soter("measure", "timed.soter", "--samples", "40", "-o", "t.json", "--json").document
    assert told["times"] == "t.json"
    given = json.loads(Path("t.json").read_text())
    assert given["steps"] == told["steps"]
    (timing,) = soter("check", "timed.soter", "--times", "t.json", "--json").document["timings"]
    assert [r["name"] for r in timing["thread"]] == [s["name"] for s in given["steps"]]


def test_a_margin_below_one_is_a_usage_error(soter: Soter) -> None:
    assert soter("measure", "timed.soter", "--margin", "0.5").exit == 2
    assert soter("measure", "timed.soter", "--margin", "much").exit == 2


def test_counts_are_no_times_without_a_factor(soter: Soter) -> None:
    for alone in (("--board", "mps2-an500"), ("--instruction", "20ns")):
        done = soter("measure", "timed.soter", *alone, "--json")
        assert (done.exit, done.codes) == (2, ["U001"])
