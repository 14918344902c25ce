"""The page of benchmarks is made of data: what its table shows is cut out of outputs by rules."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tables import all_rows

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from bench import run_all
from bench.headlines import headlines, targets

if TYPE_CHECKING:
    from bench.run_all import Benchmark

FIRST, SECOND = run_all.BENCHMARKS[:2]
KEPT = run_all.results()
RULED = """
arm        runs  violations    wall
─────────  ────  ──────────  ──────
Twitching   100           0  16.7 h
Jerking     100           0  12.1 h
alone       100         601   9.3 h
569 s; one in ten measured
"""


@pytest.fixture
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PAGE", "OUTPUTS", "RESULTS"):
        monkeypatch.setattr(run_all, name, tmp_path / getattr(run_all, name).name)


def contents(page: Path, outputs: Path, data: Path) -> dict[str, str]:
    paths = [page, data, *outputs.iterdir()]
    return {path.name: path.read_text(encoding="utf-8") for path in paths}


@pytest.mark.usefixtures("_elsewhere")
def test_page_data_and_files_are_what_the_command_writes() -> None:
    there = contents(run_all.ROOT / "docs/benchmarks.md", run_all.ROOT / "docs/benchmarks",
                     run_all.ROOT / "bench/results.json")  # fmt: skip
    assert set(KEPT) <= {b.name for b in run_all.BENCHMARKS}
    run_all.write(KEPT)
    assert contents(run_all.PAGE, run_all.OUTPUTS, run_all.RESULTS) == there
    assert run_all.results() == KEPT


@pytest.mark.usefixtures("_elsewhere")
def test_a_note_beside_an_output_stays_and_the_row_says_when_where_and_by_what() -> None:
    made = run_all.Result("python a.py", "2026-01-02", "0" * 8, "a machine", "```\n2 of 3\n```")
    run_all.write({FIRST.name: made, SECOND.name: made})
    path = run_all.file_of(FIRST.name)
    path.write_text(path.read_text(encoding="utf-8") + "\nOne was late.\n", encoding="utf-8")
    run_all.write(run_all.results())
    assert run_all.results()[FIRST.name].text == "```\n2 of 3\n```\n\nOne was late."
    assert "on a machine\n" in path.read_text(encoding="utf-8")
    row = next(x for x in run_all.PAGE.read_text(encoding="utf-8").splitlines() if "2 of 3" in x)
    assert row.endswith("| 2 of 3 | 2026-01-02, 00000000 | a machine | `python a.py` |")
    run_all.write({FIRST.name: made})
    assert list(run_all.OUTPUTS.iterdir()) == [path], "no file is left without a row"


@all_rows("b", [b for b in run_all.BENCHMARKS if b.name in KEPT])
def test_every_word_and_figure_of_a_headline_stands_in_the_output(b: Benchmark) -> None:
    output = run_all.printed(KEPT[b.name].text)
    said = headlines(output, b.last, b.heads)
    words = " ".join(re.sub(r"^\d+ rows:", "", x) for x in [*said, *targets(output)]).split()
    assert [w for w in words if w.strip(",;:") not in output] == []
    assert said or not (b.last or b.heads), "a rule that finds nothing"
    assert KEPT[b.name].text.count("```") % 2 == 0


@pytest.mark.parametrize(
    ("output", "last", "heads", "said"),
    [
        ("a b 3\n\n4 of 5 found\n", "", "", ["4 of 5 found"]),
        ("hits 0 (target 0)\nslack  2\n", "", "", ["hits 0 (target 0)"]),
        ("name   n\ncart   3\n", "", "", []),
        (RULED, "", "", ["569 s; one in ten measured"]),
        (RULED, "", "violations", ["Twitching; Jerking: violations 0", "alone: violations 601"]),
        (RULED, "^alone|ten", "runs|wall", ["alone: runs 100, wall 9.3 h", RULED.split("\n")[-2]]),
        (RULED.replace("Twi", "Tw i"), "^Tw", "", ["Tw itching 100 0 16.7 h"]),
        ("| a | of |\n|---|---|\n" + "| x | 0 |\n" * 9, "", "of", ["9 rows: of 0"]),
        ("        tried safe only  hits\nall        401        3     0\n", "all", "hits|safe only",
         ["all: safe only 3, hits 0"]),
        ("figure  measured  target\n──────  ────────  ──────  ──\nshare   96.6 %    >= 90   ok\n",
         "", "", ["share: 96.6 %"]),
    ],
)  # fmt: skip
def test_headlines_are_cut_out_by_a_rule(
    output: str, last: str, heads: str, said: list[str]
) -> None:
    assert headlines(output, last, heads) == said


def test_targets_are_those_of_an_output() -> None:
    table = "what  measured  target\n────  ────────  ──────  ──\na     3         <= 4    ok\n"
    text = "x 1 (target: 0), y 2 (target <= 1.2): ok\n3 s, target: 0 false, 0 hangs\n"
    assert targets(table) == ["<= 4"]
    assert targets(text) == ["0", "<= 1.2", "0 false, 0 hangs"]
    assert targets("every target is met\n") == []
