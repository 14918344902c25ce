"""The page of benchmarks is made of data: what its table shows is cut out of outputs by rules."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import processes
from tables import all_rows

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "docs" / "site")]
import line_picture  # noqa: E402 - needs the path
from bench import row_age, run_all  # noqa: E402
from bench.benchmark_rows import BENCHMARKS  # noqa: E402
from bench.headlines import headlines, targets  # noqa: E402
from bench.made_again_sections import PAGES  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.benchmark_rows import Benchmark

FIRST, SECOND = BENCHMARKS[:2]
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
    paths = [page, data, *outputs.glob("*.txt")]
    return {path.name: path.read_text(encoding="utf-8") for path in paths}


@pytest.mark.usefixtures("_elsewhere")
def test_page_data_and_files_are_what_the_command_writes() -> None:
    there = contents(run_all.ROOT / "docs/benchmarks.md", run_all.ROOT / "docs/benchmarks",
                     run_all.ROOT / "bench/results.json")  # fmt: skip
    commands = {b.name: f"python {b.arguments}" for b in BENCHMARKS}
    assert {name: r.command for name, r in KEPT.items()} == commands, "what `make bench` makes"
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


@all_rows("b", [b for b in BENCHMARKS if b.name in KEPT])
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


# ---------------------------------------------------------------- how old a row is

DOCS = run_all.ROOT / "docs"
CITING = sorted(
    p.name for p in DOCS.glob("*.md") if run_all.CITED.search(p.read_text(encoding="utf-8"))
)


@all_rows("page", CITING)
def test_a_page_cites_rows_by_their_date_and_none_that_is_too_old(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    dated = {run_all.citation(name, r) for name, r in KEPT.items()}
    assert {m[0] for m in run_all.CITED.finditer(text)} - dated == set()
    if not row_age.whole_history():
        pytest.skip("ages of rows are counted in a clone with its whole history only")
    assert row_age.too_old(text) == []


def cited_by(text: str) -> list[str]:
    found: list[str] = run_all.CITED.findall(text)
    return found


def undated() -> Iterator[str]:
    """Figures that pages have of a row that they do not cite, with its date."""
    for m in PAGES:
        name = m.command.removeprefix("@")
        text = (DOCS / m.page).read_text(encoding="utf-8")
        if name in KEPT and run_all.file_of(name).name not in cited_by(text):
            yield f"{m.page}: {name}"
    for path in DOCS.glob("*.md"):
        text = path.read_text(encoding="utf-8")
        links = re.findall(r"\]\(benchmarks/[\w-]+\.txt\)", text)
        if path != run_all.PAGE and len(links) != len(cited_by(text)):
            yield f"{path.name}: a link to a row without its date and commit"
    page = (DOCS / "tool-qualification.md").read_text(encoding="utf-8")
    for row in page.split("## What was tried")[1].split("## ")[0].splitlines()[5:]:
        said = re.split(r"(?<!\\)\|", row)[3] if row.startswith("| ") else ""
        kept = "".join((DOCS / "benchmarks" / f).read_text("utf-8") for f in cited_by(said))
        quotes = re.findall(r"`([^`]+)`", said)
        yield from (f"not in its row: {q}" for q in quotes if q.replace("\\|", "|") not in kept)


def test_figures_of_rows_stand_beside_the_date_and_commit_of_their_row() -> None:
    assert list(undated()) == []


@pytest.mark.parametrize(
    ("command", "among", "not_among"),
    [
        ("bench/verify/schedulability.py", {"src/soter/timing"}, {"src/soter/verify"}),
        ("bench/drone/laps.py", {"src/soter/simulate", "examples/drone"}, {"src/soter/monitor"}),
        ("-m soter campaign x.soter", {"src/soter/campaign"}, {"src/soter/gym"}),
        ("bench/recheck/beside_verify.py", {"src/soter/certificate"}, {"src/soter/gym"}),
        ("bench/c_code/c_coverage.py", {"src/soter/runtime", "src/soter/codegen"}, set()),
        ("bench/verify/soundness.py", {"bench/verify/random_problems.py"}, {"src/soter/cli"}),
        ("bench/house/mutation_sample.py", {"src"}, set()),
    ],
)
def test_what_a_row_is_about_is_derived(command: str, among: set[str], not_among: set[str]) -> None:
    about = row_age.about(command)
    assert among <= about
    assert not not_among & about


def test_only_commits_of_its_rooms_make_a_row_older(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over a history of four commits; an archive and a shallow clone have none that counts."""

    def git(*words: str) -> str:
        who = ("-c", "user.name=a", "-c", "user.email=a@b")
        done = processes.run(
            ["git", *who, *words], cwd=tmp_path, check=True, capture_output=True, text=True
        )
        return str(done.stdout).strip()

    monkeypatch.setattr(row_age, "ROOT", tmp_path)
    monkeypatch.setattr(row_age, "about", lambda _: frozenset({"src/soter/timing", "bench/a.py"}))
    assert not row_age.whole_history()
    git("init", "-q")
    made = []
    for path in ("src/soter/timing/a.py", "src/soter/verify/a.py", "bench/a.py", "docs/a.md"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(path)
        git("add", ".")
        git("commit", "-qm", path)
        made.append(git("rev-parse", "--short=8", "HEAD"))
    row_age.age.cache_clear()
    assert [row_age.age("python x", commit) for commit in made] == [1, 1, 0, 0]
    row = run_all.Result("python x", "2026-01-02", made[0], "", "```\n2 of 3\n```")
    monkeypatch.setattr(row_age, "results", lambda: {FIRST.name: row})
    cited = run_all.citation(FIRST.name, row)
    assert row_age.too_old(cited) == []
    monkeypatch.setattr(row_age, "MOST", 0)
    monkeypatch.setattr(row_age, "rooms", lambda _: ["timing"])
    assert row_age.too_old(cited) == [f"{run_all.file_of(FIRST.name).name}: 1 commits of timing"]
    why = "**Not made again.** It needs a peer. **Still holds:** nothing of it changed."
    said = replace(row, text=f"{row.text}\n\n{why}")
    monkeypatch.setattr(row_age, "results", lambda: {FIRST.name: said})
    assert row_age.too_old(cited) == []
    part = f"**Made again in part.** `--n 3`, after {made[2]}: `0 of 3`."
    in_part = replace(row, text=f"{row.text}\n\n{part}")
    assert row_age.latest(in_part) == made[2]
    assert (
        row_age.latest(replace(in_part, commit=made[3], text=part.replace(made[2], made[0])))
        == made[3]
    )
    monkeypatch.setattr(row_age, "results", lambda: {FIRST.name: in_part})
    assert row_age.too_old(cited) == [], "none of its commits since"
    git("checkout", "-q", "--orphan", "other")
    git("commit", "-qm", "another history")
    row_age.age.cache_clear()
    for unknown in (made[0], "0" * 8):
        with pytest.raises(ValueError, match="does not stand on it"):
            row_age.age("python x", unknown)


# ---------------------------------------------------------------- a line a change


def test_the_picture_of_the_lines_comes_out_again() -> None:
    lines = line_picture.read_lines()
    assert line_picture.PICTURE.read_text(encoding="utf-8") == line_picture.drawn(lines)
    other = json.loads(json.dumps(lines[-1]))
    other["outputs"]["wall/cart.soter"]["c"] = "0" * 16
    assert line_picture.changed_outputs([lines[-1], other]) == [0, 1]
