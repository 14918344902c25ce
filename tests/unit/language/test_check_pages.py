"""Every code has a page, a test that reaches it, and examples that say the truth."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from generators.file_listing import files_below, files_in
from soter.diagnostics.codes import all_codes
from soter.diagnostics.diagnostic import Severity
from soter.diagnostics.render import render_all
from soter.language.front_end import CheckResult, check_file
from tables import all_rows
from unit.diagnostics.page_examples import mended, wrong

if TYPE_CHECKING:
    import pytest

ROOT = Path(__file__).parents[3]
CODE = re.compile(r'"([A-Z][0-9]{3}|P1[abc]|P2[ab]|P3)"')
SOURCES = files_below(ROOT / "src" / "soter", "*.py")
STATIC_ERRORS = {p.name.split("_")[0] for p in files_in(ROOT / "tests" / "static_error", "*.soter")}

OF_THE_SYNTAX = {c for c in all_codes() if c[0] in "LS"}
"""Tested beside the parser: tests/unit/syntax, tests/unit/diagnostics."""

OF_THE_VERIFIER = {c for c in all_codes() if c[0] == "R"}
"""Tested where problems are extracted: tests/static_error/verify."""

NOT_STATIC = {
    # code: why no text alone reaches it
    "C006": "a campaign of a system without properties",
    "C007": "flights of a campaign that are copies",
    "D006": "the operating system refuses to write",
    "D007": "a package is not installed",
    "D008": "a folder holds what is not ours",
    "D009": "a folder that is no certificate",
    "D010": "a file that is no trace",
    "D011": "a trace of another version of the program",
    "D015": "the mapping of a log",
    "D016": "a log that somebody else wrote",
    "D017": "a log that has not what a module reads",
    "D018": "the workers of a cluster cannot fly",
    "D019": "a deployed system, when it is built",
    "D020": "a certificate of something else",
    "D021": "a file of hazards and requirements",
    "D022": "a model monitor of another model",
    "D023": "a log that a certificate is not about",
    "I001": "a defect of soter",
    "U001": "a value on the command line",
    "U002": "the name of a system on the command line",
    "U003": "the grammar of the command line",
    "U004": "the name of a parameter on the command line",
    "U005": "the name of an extern on the command line",
    "U007": "a code that is explained",
    "U008": "the name of a module on the command line",
    "U009": "no safe controller was found",
    "U010": "the name of a test on the command line",
    "U011": "a file on the command line",
    "U012": "what a policy in another process publishes",
    "W007": "the files of externs, when `soter check` looks at them",
    "W037": "the file of a policy, when `soter check` looks at it",
    "X001": "an extern without code when a system is run",
    "X002": "the code an extern is bound to, when a system is run",
    "X003": "the file an extern is bound to, when a system is run",
    "X004": "the C compiler's words",
    "X005": "no C compiler on the machine",
    "X006": "the cache folder",
    "X007": "what an engine cannot do",
    "X008": "what an engine cannot do yet",
    "X011": "a run with externs that ends without a verdict",
    "X012": "what an extern does to the processor",
    "X013": "the folder of channels, and what wrote into it",
    "X014": "the file of a policy",
    "X015": "the memory of a board",
    "X016": "what an image computes",
    "X017": "the file of a board",
    "P1c": "an assumption of the report of `soter check`",
    "P2a": "an assumption of the report of `soter check`",
    "P2b": "an assumption of the report of `soter check`",
    "P3": "an assumption of the report of `soter check`",
}


def used_codes() -> set[str]:
    return {c for path in SOURCES for c in CODE.findall(path.read_text(encoding="utf-8"))}


ELSEWHERE = OF_THE_SYNTAX | OF_THE_VERIFIER
OF_THE_CHECKER = sorted(c for c in all_codes() if c not in ELSEWHERE and c not in NOT_STATIC)


def check(text: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> CheckResult:
    monkeypatch.chdir(folder)
    (folder / "pair.json").write_text("[1.0, 2.0]")
    (folder / "page.soter").write_text(text)
    return check_file("page.soter")


def test_every_code_has_a_page() -> None:
    assert used_codes() - set(all_codes()) == set()


def test_every_page_is_about_a_code_that_exists() -> None:
    assert set(all_codes()) - used_codes() == set()


def test_every_code_is_reached_by_a_program_or_excused() -> None:
    assert used_codes() - ELSEWHERE - STATIC_ERRORS == set(NOT_STATIC)


@all_rows("code", OF_THE_CHECKER)
def test_the_wrong_example_gives_the_code(
    code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    diagnostics = check(wrong(code), tmp_path, monkeypatch).diagnostics.items
    assert {d.code for d in diagnostics} == {code}, render_all(diagnostics)
    assert diagnostics[0].severity is (Severity.WARNING if code[0] == "W" else Severity.ERROR)


@all_rows("code", OF_THE_CHECKER)
def test_the_mended_example_is_clean(
    code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = mended(code)
    assert not text or render_all(check(text, tmp_path, monkeypatch).diagnostics.items) == ""
