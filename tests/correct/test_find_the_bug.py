"""What docs/find-the-bug.md says happens, happens."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

import processes

pytestmark = pytest.mark.pages
ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "find-the-bug.md").read_text(encoding="utf-8")
SPACES = re.compile(r"[ ─]+")


def _block(name: str) -> str:
    blocks = re.findall(rf"^```soter find={name}\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 1, name
    return str(blocks[0])


EXTERN = _block("hoist.soter") + "\n" + _block("question")
HOIST = EXTERN.replace("  horizon", "  replace Learned by Anything;\n  horizon") + _block(
    "anything"
)
LATE = "  late SafeHoist.Back by 20ms;\n"


def _soter(folder: Path, *arguments: str) -> processes.Done:
    command = [sys.executable, "-m", "soter.cli.main", *arguments]
    return processes.run(command, cwd=folder, capture_output=True, text=True, check=False)


def _plain(text: str) -> str:
    """One space for many, so that a page may cut what is to the right of a column."""
    return "\n".join(SPACES.sub(" ", line).strip() for line in text.splitlines())


def _said(section: int) -> list[list[str]]:
    """The lines of output of every session (`$ soter ...`) in a section."""
    text = re.split(r"^## \d+\. ", PAGE, flags=re.MULTILINE)[section]
    sessions = re.findall(r"^```\n\$ (.*?)^```", text, re.MULTILINE | re.DOTALL)
    return [[x for x in s.splitlines()[1:] if x.strip() and x != "..."] for s in sessions]


def _shows(output: str, lines: list[str]) -> None:
    """Every line of the page is in the output, in this order."""
    assert lines
    there = _plain(output)
    for line in lines:
        wanted = _plain(line)
        assert wanted in there, f"{wanted!r} is not, or not there, in\n{output}"
        there = there[there.index(wanted) + len(wanted) :]


def _test(folder: Path, text: str, *options: str) -> processes.Done:
    (folder / "hoist.soter").write_text(text, encoding="utf-8")
    return _soter(folder, "test", "hoist.soter", *options)


def test_an_extern_left_in_is_refused(tmp_path: Path) -> None:
    done = _test(tmp_path, EXTERN)
    assert done.returncode == 1
    _shows(done.stderr, _said(1)[0])


def test_with_anything_in_its_place_it_is_exhausted_and_clean(tmp_path: Path) -> None:
    done = _test(tmp_path, HOIST)
    assert done.returncode == 0, done.stderr
    _shows(done.stdout, _said(2)[0])


def test_a_bold_look_ahead_is_violated_by_the_trace_of_the_page(tmp_path: Path) -> None:
    done = _test(tmp_path, HOIST.replace("NEAR: int = 3", "NEAR: int = 6"), "--html")
    assert done.returncode == 3, done.stderr
    _shows(done.stdout, _said(3)[0])
    assert (tmp_path / ".soter" / "hoist-AnyController.html").is_file()
    trace = Path(".soter") / "hoist-AnyController.trace.json"
    again = _soter(tmp_path, "replay", str(trace), "--mcap", "run.mcap")
    assert again.returncode == 0, again.stderr
    assert (tmp_path / "run.mcap").is_file()
    _shows(again.stdout, _said(3)[1])


@pytest.mark.parametrize(
    ("near", "late", "code"), [(4, "", 3), (3, LATE, 3), (2, LATE, 3), (1, LATE, 0)]
)
def test_the_arithmetic_of_the_page(tmp_path: Path, near: int, late: str, code: int) -> None:
    text = HOIST.replace("NEAR: int = 3", f"NEAR: int = {near}")
    done = _test(tmp_path, text.replace("  horizon", f"{late}  horizon"))
    assert done.returncode == code, done.stdout


def test_a_late_safe_controller_is_violated_by_the_trace_of_the_page(tmp_path: Path) -> None:
    done = _test(tmp_path, HOIST.replace("  horizon", f"{LATE}  horizon"))
    assert done.returncode == 3, done.stderr
    _shows(done.stdout, _said(4)[0])


def test_the_cart_in_the_wind_reaches_a_bound(tmp_path: Path) -> None:
    file = ROOT / "examples" / "wall" / "cart_test.soter"
    done = _soter(tmp_path, "test", str(file), "--test", "InTheWind")
    assert done.returncode == 4, done.stderr
    _shows(done.stdout, _said(5)[0])


@pytest.mark.long
def test_the_sled_gets_far_by_plans_and_not_by_chance(tmp_path: Path) -> None:
    (tmp_path / "sled.soter").write_text(_block("sled.soter"), encoding="utf-8")
    chance, plans = _said(5)[1:]
    done = _soter(tmp_path, "test", "sled.soter", "--strategy", "random", "--runs", "2000")
    assert done.returncode == 4, done.stderr
    _shows(done.stdout, chance)
    done = _soter(tmp_path, "test", "sled.soter", "--strategy", "falsify", "--minimise", "1")
    assert done.returncode == 3, done.stderr
    _shows(done.stdout, [line.removesuffix("...") for line in plans])


@pytest.mark.parametrize("strategy", ["random", "falsify"])
def test_samples_find_the_bug_and_never_say_clean(tmp_path: Path, strategy: str) -> None:
    options = ("--strategy", strategy, "--runs", "500")
    assert _test(tmp_path, HOIST, *options).returncode == 4
    bold = HOIST.replace("NEAR: int = 3", "NEAR: int = 6")
    assert _test(tmp_path, bold, *options).returncode == 3


@pytest.mark.parametrize(
    "options",
    [
        ("--reduction", "none"),
        *(
            pytest.param(options, marks=pytest.mark.long)  # test_explorer_agrees.py has them
            for options in (
                ("--reduction", "sleep"),
                ("--reduction", "ample"),
                ("--storage", "fingerprint"),
                ("--threads", "2"),
            )
        ),
    ],
)
def test_every_option_of_the_page_gives_the_same_answer(
    tmp_path: Path, options: tuple[str, ...]
) -> None:
    assert _test(tmp_path, HOIST, *options).returncode == 0
    bold = HOIST.replace("NEAR: int = 3", "NEAR: int = 6")
    assert _test(tmp_path, bold, *options).returncode == 3


def test_the_corridors_have_as_many_configurations_as_the_page_says(tmp_path: Path) -> None:
    file = ROOT / "examples" / "testing" / "two_modules.soter"
    done = _soter(tmp_path, "test", str(file), "--reduction", "none")
    assert done.returncode == 0, done.stderr
    _shows(done.stdout, _said(6)[0])
