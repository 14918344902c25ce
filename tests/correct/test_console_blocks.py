"""What pages show below a command is what the command prints (tests/console.py says how).

`pytest tests/correct/test_console_blocks.py --update-golden [--all]` writes it into the pages.
"""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

import pytest

from console import LEFT_OUT, ROOT, differs, folder_for, printed, renewed, sessions, shown

if TYPE_CHECKING:
    from pathlib import Path

PAGES = [
    p
    for p in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    if sessions(p.read_text(encoding="utf-8"))
]
TIMES = "\N{MULTIPLICATION SIGN}"
FIRST_HOUR = ROOT / "docs" / "first-hour.md"


def _checked(path: Path, folder: Path, *, long: bool, update: bool) -> None:
    page = path.read_text(encoding="utf-8")
    environment = folder_for(page, folder)
    wrong, outputs = [], {}
    for s in sessions(page):
        if s.long and not long:
            continue
        outputs[s.start] = [printed(command, folder, environment) for command, _ in s.said]
        for (command, expected), output in zip(s.said, outputs[s.start], strict=True):
            problem = differs(output, expected)
            if problem:
                wrong.append(f"{path.name}: $ {command}\n{problem}")
    if update:
        path.write_text(renewed(page, outputs), encoding="utf-8")
        return
    assert wrong == [], "\n\n".join(wrong)


def _is_long(path: Path) -> bool:
    return any(s.long for s in sessions(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", PAGES, ids=lambda p: p.name)
@pytest.mark.pages
@pytest.mark.whole
def test_a_page_shows_what_its_commands_print(
    path: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    update = bool(request.config.getoption("--update-golden"))
    _checked(path, tmp_path, long=False, update=update)


@pytest.mark.long
@pytest.mark.parametrize("path", [p for p in PAGES if _is_long(p)], ids=lambda p: p.name)
@pytest.mark.pages
def test_a_page_shows_what_its_long_commands_print(
    path: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    update = bool(request.config.getoption("--update-golden"))
    _checked(path, tmp_path, long=True, update=update)


def test_pages_share_what_is_compiled_and_nothing_that_was_proved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("console.CACHE", tmp_path / "cache")
    for entry in ("proof-1-2", "cart-3"):
        (tmp_path / "cache" / entry).mkdir(parents=True)
    environment = folder_for("", tmp_path / "page")
    assert environment["SOTER_CACHE"] == str(tmp_path / "cache")
    assert [p.name for p in (tmp_path / "cache").iterdir()] == ["cart-3"]


def test_every_command_of_the_readme_is_shown_with_its_output_in_the_first_hour() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    asked = {" ".join(shlex.split(x, comments=True)) for x in readme if x.startswith("soter ")}
    page = FIRST_HOUR.read_text(encoding="utf-8")
    told = {" ".join(shlex.split(c, comments=True)): e for s in sessions(page) for c, e in s.said}
    assert asked - set(told) == set()
    assert all(told.values())


def test_what_is_left_out_may_be_anything_and_nothing_else_may() -> None:
    output = "one  two\nthree 3.5 s\nfour\nfive"
    for fits in (
        output,
        "one two\n…\nfive",
        "…\nthree … s\n…",
        "one two\nthree 3.5 s\n…\nfour\nfive",
        "…",
    ):
        assert differs(output, fits) == "", fits
    for wrong in ("one two\nfive", "…\nthree … min\n…", "", "two\n…", "…\nfour", "one\n…\nfive"):
        assert differs(output, wrong), wrong


def test_a_page_is_renewed_only_where_it_no_longer_fits() -> None:
    page = "# A\n```console\n$ one\nold\n$ two\nkept …\n```\nb\n```console long\n$ three\n```\n"
    first, second = sessions(page)
    assert (first.long, second.long) == (False, True)
    assert first.said == (("one", "old"), ("two", "kept …"))
    outputs = {first.start: ["new\n(exit code 3)", "kept as it was"]}
    assert renewed(page, outputs) == page.replace("old", "new\n(exit code 3)")
    assert differs(f"9 ms (1,200 {TIMES} real time)", f"5.1 ms (80 {TIMES} real time)") == ""
    assert differs("P2a  proved  559 ms  SC keeps C", "P2a  proved  22.1 s  SC keeps C") == ""
    assert differs("P2a  proved  559 ms  SC keeps C", "P2a  assumed  559 ms  SC keeps C")
    assert differs("P1c  proved  0 ms  a b", f"P1c  proved  1.5 s  a\n{' ' * 24}b") == ""
    assert differs("ACCEPTED  p  3.5 s", "ACCEPTED  p  21.3 s") == ""
    assert differs("violated at 2.635 s", "violated at 2.63 s")
    assert len(shown("\n".join("x" * 40)).splitlines()) < 20


def test_a_page_shows_rows_of_a_table_whole() -> None:
    for row in range(1, 5):
        lines = ["a name  words"] + ["", " " * 20 + "that go on"] * row
        output = "\n".join(x or f"row {k}" for k, x in enumerate(lines * 7))
        assert differs(output, shown(output)) == ""
        assert LEFT_OUT in shown(output)
