"""Figures of the pages are made again by a command, and a figure without one is refused.

The comparison is tried on outputs in which one figure is another one; the tables, blocks and
sentences of docs/ have to be in bench/made_again_sections.py.
"""

from __future__ import annotations

import math
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tables import all_rows

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench import made_again  # noqa: E402 - needs the path
from bench.benchmark_rows import BENCHMARKS  # noqa: E402
from bench.made_again_compare import compared, numbers_in, sampled, stood  # noqa: E402
from bench.made_again_sections import EXCEPT, NOT_SEEN, PAGES, SMALL  # noqa: E402
from bench.run_all import BLOCK, CITED, Result, printed, results  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

DOCS = ROOT / "docs"
NOT_ASKED = {"benchmarks.md", "decisions.md"}
"""The first is asked row by row; the second is a diary."""
NUMBERS_OF_A_BLOCK = 4
"""A block without a language that has fewer numbers is a drawing or a formula."""
SCRIPT = re.compile(r"(?:bench|examples)/\w+/\w+\.py")
DAGGER = "†"


def tables(text: str) -> Iterator[str]:
    """The first row with words of every table that has a figure outside of code."""
    rows: list[str] = []
    for line in [
        *re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL).splitlines(),
        "",
    ]:
        if line.startswith("|"):
            rows.append(line)
            continue
        if any(numbers_in(row) for row in rows[2:]):
            yield rows[0] if re.search(r"\w", rows[0]) else rows[2]
        rows = []


def blocks(text: str) -> Iterator[str]:
    """Every block without a language that has many numbers."""
    for found in BLOCK.finditer(text):
        if not found[1] and len(numbers_in(found[2])) >= NUMBERS_OF_A_BLOCK:
            yield "```" + found[2].lstrip("\n").split("\n")[0]


def sentences(text: str) -> Iterator[str]:
    """Every paragraph that has figures and a mark of them, or names a benchmark."""
    text = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^(\||#|    ).*$", "", CITED.sub("", text), flags=re.MULTILINE)
    for paragraph in re.split(r"\n\s*\n|\n(?=- |\d+\. )", text):
        if (SCRIPT.search(paragraph) or DAGGER in paragraph) and numbers_in(paragraph):
            yield paragraph


def without_a_maker(page: str, text: str) -> Iterator[str]:
    """What of a page no section makes and no exception names.

    A paragraph that names a benchmark is known where a section of its page is of that benchmark.
    """
    made = [m.where for m in PAGES if m.page == page]
    scripts = " ".join(s.command for s in made_again.sections(small=False) if s.page == page)
    excepted = [where for name, where in EXCEPT if name == page]
    for start in (*tables(text), *blocks(text)):
        if not any(start.startswith(x) for x in (*made, *excepted)) and "*" not in made:
            yield start
    for paragraph in sentences(text):
        known = any(re.search(w, paragraph) for w in made if w[0] not in "|`*")
        known |= any(x in scripts for x in SCRIPT.findall(paragraph))
        if not known and not any(x in paragraph for x in excepted) and "*" not in made:
            yield paragraph.strip()


PAGES_ASKED = sorted(p.name for p in DOCS.glob("*.md") if p.name not in NOT_ASKED)


@all_rows("page", PAGES_ASKED)
def test_a_figure_of_a_page_has_a_command_that_makes_it_or_a_reason(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    assert list(without_a_maker(page, text)) == []


def test_a_figure_without_a_maker_is_seen() -> None:
    """One that is added to a page: a table, a block, a sentence, and one with a mark of a test."""
    page = "fleet.md"
    text = (DOCS / page).read_text(encoding="utf-8")
    added = (
        "| robots | collisions |\n|---|---|\n| 4 | 0 |\n",
        "```\n$ soter run x.soter\n4 robots, 0 collisions, 12.5 s, 3\n```\n",
        "`bench/fleet/other.py` counted 14 collisions.\n",
        "The gap is 29 mm †.\n",
    )
    for more in added:
        assert len(list(without_a_maker(page, f"{text}\n{more}"))) == 1, more
    assert not list(without_a_maker(page, f"{text}\n| word | meaning |\n|---|---|\n| a | `3` |\n"))


def test_every_section_and_exception_is_of_something_that_there_is() -> None:
    assert {*SMALL, *(s.title for s in made_again.sections(small=True))} >= NOT_SEEN
    assert set(SMALL) == {b.name for b in BENCHMARKS}
    for m in PAGES:
        page = (DOCS / m.page).read_text(encoding="utf-8")
        assert list(made_again.said(m, page)), (m.page, m.where)
        assert m.command[1:] in SMALL or not m.command.startswith("@"), m.command
    for (name, where), why in EXCEPT.items():
        page = (DOCS / name).read_text(encoding="utf-8")
        start = where.removeprefix("```")
        assert start in page, (name, where)
        for path in re.findall(r"tests/[\w/.]+\w", why):
            assert (ROOT / path).exists(), why
    scripts = [x.split()[0] for x in commands() if x.split()[0].endswith(".py")]
    assert [x for x in scripts if not (ROOT / x).exists()] == []


def commands() -> Iterator[str]:
    for small in (False, True):
        yield from (s.command for s in made_again.sections(small=small))


# ---------------------------------------------------------------- comparing

KEPT = """
arm        flights  violations  AC share  wall  digest
─────────  ───────  ──────────  ────────  ────  ────────────
Protected    1,000           0    96.6 %  12 s  9904839878dc
Alone        1,000         601   100.0 %   9 s  ca950ab9b019
the whole took 3.25 s; verdict proved
"""


def test_an_output_with_other_times_is_the_same() -> None:
    again = KEPT.replace("12 s", "31 s").replace("9 s", "8.5 s").replace("3.25 s", "999 s")
    told = compared(KEPT, f"a new line\n{again}")
    assert told.differ == []
    assert told.figures == 6


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("601", "602"),
        ("96.6", "96.7"),
        (" 0 ", " 1 "),
        ("proved", "undecided"),
        ("9904839878dc", "9904839878dd"),
        ("Alone        1,000         601   100.0 %   9 s  ca950ab9b019\n", ""),
    ],
)
def test_a_figure_or_a_word_that_is_another_one_differs(old: str, new: str) -> None:
    assert len(compared(KEPT, KEPT.replace(old, new)).differ) == 1
    assert compared(KEPT, KEPT.replace(old, new, 1)).figures == 6


def test_a_row_that_the_page_leaves_out_differs() -> None:
    row = next(x for x in KEPT.splitlines() if x.startswith("Alone"))
    without = KEPT.replace(f"{row}\n", "")
    assert compared(without, KEPT).differ == [], "an excerpt"
    assert len(compared(without, KEPT, whole=True).differ) == 1
    assert compared(KEPT, f"a new line\n{KEPT}", whole=True).differ == []
    assert len(compared(KEPT, f"{KEPT}{row}\n", whole=True).differ) == 1, "the same row twice"
    name = "The drone's laps"
    (section,) = (s for s in made_again.sections(small=False) if s.made is None and s.name == name)
    output = made_again.Output(f"{printed(results()[name].text)}crashes 3\n", 0, 0.0, "")
    assert len(made_again.verdict(section, output).differ) == 1


def test_times_of_the_simulated_world_are_figures_where_the_section_says_so() -> None:
    lap = "arm   lap\n────  ───────\nours  10.68 s\n"
    assert compared(lap, lap.replace("10.68", "10.70")).differ == []
    assert len(compared(lap, lap.replace("10.68", "10.70"), times="").differ) == 1
    row = "arm  flights   wall\nours     100  409 s\n"
    assert compared(row, row.replace("409", "12"), times="wall").differ == []
    assert len(compared(row, row.replace("100", "200"), times="wall").differ) == 1


def test_whether_a_time_met_its_target_is_no_figure() -> None:
    lap = "speed  12,848 x real time  >= 5,000  ok\nhits  0  <= 0  ok\n"
    slower = lap.replace("12,848", "4,848").replace("5,000  ok", "5,000  MISSED")
    assert compared(lap, slower).differ == []
    assert compared(lap, slower, times="").differ == []
    assert len(compared(lap, lap.replace("<= 0  ok", "<= 0  MISSED")).differ) == 1
    head = "module  verdict    wall  <= 30 s  all\n──────  ───────  ─────  ───────  ───\n"
    row = f"{head}cart    proved   8.7 s  yes      yes\n"
    assert compared(row, row.replace("8.7 s  yes    ", "9.7 s  if idle")).differ == []
    assert len(compared(row, row.replace("yes\n", "NO\n")).differ) == 1, "no column of times"
    load = "load of the machine at the end (1, 5, 15 minutes): 4.2, 4.8, 4.8; 2 cores"
    assert compared(load, load.replace("4.8", "0.1")).differ == []


def test_a_page_may_show_some_of_the_lines_that_say_the_same() -> None:
    made = "K of 7 cells\nK of 8 cells\nK of 9 cells\n"
    assert compared("K of 7 cells\nK of 9 cells\n", made).differ == []
    assert len(compared("K of 9 cells\nK of 7 cells\n", made).differ) == 1
    assert len(compared("K of 7 cells\nK of 6 cells\n", made).differ) == 1
    assert len(compared("K of 8 cells\nK of 7 cells\nK of 9 cells\n", made).differ) == 2


def test_how_many_were_over_a_bound_is_a_figure() -> None:
    """The heading `over it` counts; `over 60 s` is one of times."""
    head = "what died              n  max ms   bound  over it  over 60 s\n"
    row = f"{head}trusted part: the law 20    66.7    69.0        0          2\n"
    late = row.replace(" 0 ", " 1 ")
    assert len(compared(row, late).differ) == len(sampled(row, late, 1).differ) == 1
    assert compared(row, row.replace("66.7", "70.1").replace(" 2\n", " 3\n")).differ == []


def test_a_speed_beside_real_time_is_of_the_clock() -> None:
    assert (
        compared(
            "246 s, 230 steps a second, 2 x real", "9 s, 7 steps a second, 4 x real", ""
        ).differ
        == []
    )


@pytest.mark.parametrize("ended", ["stopped", "time", "bound: time, 86 ms covered"])
def test_how_far_a_search_came_that_the_clock_ended_is_no_figure(ended: str) -> None:
    row = f"both, 20 ticks  {ended}  91,633  873,269,688  175.01 s  50 ms  20 MB\n"
    assert compared(row, row.replace("91,633", "5,633").replace("86", "7")).differ == []
    assert len(compared(row, row.replace(ended, "exhausted")).differ) == 1
    whole = row.replace(ended, "exhausted")
    assert len(compared(whole, whole.replace("91,633", "5,633")).differ) == 1
    moved = "robot 1 stopped in the junction  0  4\n"
    assert len(compared(moved, moved.replace("4", "5")).differ) == 1


def test_a_markdown_table_has_columns_of_times_too() -> None:
    rows = "| arm | flights | took |\n|---|---|---|\n| ours | 100 | 7.5 |\n"
    assert compared(rows, rows.replace("7.5", "9.1")).differ == []
    assert len(compared(rows, rows.replace("100", "99")).differ) == 1


def test_a_smaller_run_is_held_to_zeros_and_shares() -> None:
    some = KEPT.replace("1,000", "20").replace("601", "11").replace("96.6", "93.0")
    some = some.replace("9904839878dc", "00ff00ff00ff").replace("ca950ab9b019", "11ff00ff00ff")
    assert sampled(KEPT, some, 20).differ == []
    assert sampled(KEPT, some, 20).figures == 3
    kept, made = KEPT, some
    assert len(sampled(kept, made.replace(" 0 ", " 8 "), 20).differ) == 1
    assert len(sampled(kept, made.replace("93.0", "50.0"), 20).differ) == 1
    assert sampled(kept, made.replace("93.0", "50.0"), 2).differ == [], "two flights may say that"
    assert len(sampled(kept, made.replace("100.0", "93.0"), 20).differ) == 1


def test_clauses_of_a_sentence_are_held_against_a_smaller_run_each() -> None:
    page = "300 programs, 12 violated (fault 7, timed 5); 0 differ (target: none); 20 % of #\n"
    some = "6 programs, 2 violated (timed 2); 0 differ (target: none); 50 % of #\n"
    assert sampled(page, some, 6).differ == []
    assert sampled(page, some, 6).figures == 2
    assert len(sampled(page, some.replace("0 differ", "1 differ"), 6).differ) == 1


def test_a_part_of_the_rows_is_held_to_all_of_their_figures() -> None:
    part = "\n".join(x for x in KEPT.splitlines() if not x.startswith("Alone"))
    assert compared(KEPT, part, part=True).differ == []
    assert 0 < compared(KEPT, part, part=True).figures < compared(KEPT, KEPT).figures
    assert len(compared(KEPT, part.replace("96.6", "96.7"), part=True).differ) == 1
    assert len(compared(KEPT, part.replace("9904839878dc", "00ff00ff00ff"), part=True).differ) == 1


def test_rows_of_a_page_stand_in_a_line_of_the_output() -> None:
    output = "Fenced 1,000 0 9.148 2.383 0.813\nBare 200 195"
    rows = ["| the module, of 10 m | 1,000 | 0 | 9.15 |", "| without | 200 | **195** |"]
    given = frozenset({"10"})
    assert stood(rows, output, given, spread=False).differ == []
    assert stood(rows, output, given, spread=False).figures == 5
    assert len(stood(rows, output, frozenset(), spread=False).differ) == 1
    assert len(stood([rows[0].replace("9.15", "9.17")], output, given, spread=False).differ) == 1
    mixed = ["| one | 200 | 9.15 |"]
    assert len(stood(mixed, output, given, spread=False).differ) == 1, "of two lines"
    assert stood(mixed, output, given, spread=True).differ == []


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        ("100 sent, 1,234.5 m, `7` and [8](a9.md) of 3", ["100", "1,234.5", "8", "3"]),
        ("hash 9904839878dc, x2, 1e-06, 96.6 %", ["1e-06", "96.6"]),
    ],
)
def test_numbers_of_a_page(text: str, numbers: list[str]) -> None:
    assert numbers_in(text) == numbers


# ---------------------------------------------------------------- the command


def test_the_command_says_what_differs_and_goes_on_where_it_was_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Over three commands: one prints what is kept, one another figure, one breaks."""
    texts = {"right": "4 robots, 0 hits", "wrong": "4 robots, 2 hits", "broken": ""}
    ran: list[str] = []

    def run(command: str, _limit_s: float, _reads: str = "") -> made_again.Output:
        ran.append(command)
        text = texts[command]
        return made_again.Output(text or "no such module", 0 if text else 2, 1.0, "code")

    text = "```\n4 robots, 0 hits\n```"
    kept = {n: Result(n, "2026-01-01", "0" * 8, "", text) for n in texts}
    found = [made_again.Section("benchmarks.md", n, n, 0, None, "", None) for n in texts]
    monkeypatch.setattr(made_again, "OUT", tmp_path)
    monkeypatch.setattr(made_again, "run", run)
    monkeypatch.setattr(made_again, "made_of", lambda _: "code")
    monkeypatch.setattr(made_again, "results", lambda: kept)
    monkeypatch.setattr(made_again, "sections", lambda **_: found)

    def said(*arguments: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["made_again.py", *arguments])
        return made_again.main(), capsys.readouterr().out

    assert said("--only", "right")[0] == 0
    code, output = said("--resume")
    assert ran == ["right", "wrong", "broken"], "what was made is taken"
    assert code == 3
    assert "'4 robots, 0 hits': page says 0, made 2" in output
    assert "NOT MADE: exit 2: no such module" in output
    assert "3 sections, 4 figures compared: 1 as the page says, 1 differ, 1 not made" in output
    assert said("--only", "broken")[0] == 4, "nothing differs, and nothing was made"
    code, output = said("--only", "right", "--seconds", "0")
    assert (code, ran[-1]) == (4, "broken"), "no time, nothing begun"
    texts["right --n 3"], texts["wrong --n 3"] = "3 robots, 0 hits", "3 robots, 2 hits"
    code, output = said("--with", "--n 3", "--flights", "3", "--only", "right", "wrong")
    assert code == 3, "of a shorter run zeros count"
    assert "2 sections, 2 figures compared: 1 as the page says, 1 differ" in output


@pytest.mark.parametrize("limit", [made_again.LONGEST, math.inf, 1e9, 1e300, 60.0])
def test_a_command_without_a_limit_is_run(limit: float, tmp_path: Path) -> None:
    """Also where poll(2) could not wait so long: it counts milliseconds in 31 bits."""
    script = tmp_path / "says.py"
    script.write_text("print('4 robots')")
    output = made_again.run(str(script), limit)
    assert (output.code, output.text) == (0, "4 robots\n")


def test_a_command_that_takes_too_long_is_ended_with_what_it_started(tmp_path: Path) -> None:
    script = tmp_path / "sleeps.py"
    script.write_text(
        "import os, time\n"
        "print('begun', flush=True)\n"
        "child = os.fork()\n"
        "if child:\n"
        f"    open({str(tmp_path / 'child')!r}, 'w').write(str(child))\n"
        "time.sleep(600)\n"
    )
    output = made_again.run(str(script), 3.0)
    assert output.code is None
    pid = (tmp_path / "child").read_text()
    stat = Path(f"/proc/{pid}/stat")
    assert not stat.exists() or stat.read_text().split()[2] == "Z"


def test_pages_agree_with_what_is_kept_of_the_benchmarks() -> None:
    """Tables that were taken from docs/benchmarks.md: nothing is run."""
    verdicts = [made_again.verdict(s, output) for s, output in made_again.kept_outputs()]
    assert [(v.section, v.differ) for v in verdicts if v.differ] == []
    assert [v.section for v in verdicts if not v.figures] == []


def is_long_test(s: made_again.Section) -> bool:
    """Whether its smaller run is one: that of another page where it has one of its own."""
    if s.made is not None:
        return bool(s.made.small) and s.title not in NOT_SEEN
    return not s.machine and not SMALL[s.name].apart and s.name not in NOT_SEEN


SOME = [s for s in made_again.sections(small=True) if is_long_test(s)]


@pytest.mark.long
@pytest.mark.parametrize("section", SOME, ids=lambda s: s.title)
def test_a_smaller_run_of_a_section_comes_out(section: made_again.Section) -> None:
    reads = section.made.reads if section.made is not None else ""
    told = made_again.verdict(section, made_again.run(section.command, 3600.0, reads))
    assert (told.differ, told.not_made) == ([], "")
