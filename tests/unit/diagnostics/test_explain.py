"""The pages of `soter explain`: they can be found, and their examples say the truth."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

from generators.file_listing import files_below
from soter.diagnostics.codes import Code, all_codes, explain, similar_codes, title
from soter.diagnostics.diagnostic import Diagnostics, Source
from soter.language.syntax.parsing.parser import parse
from tables import all_rows
from unit.diagnostics.page_examples import IN_WORDS, mended, wrong

ROOT = Path(__file__).parents[3]
SYNTAX_CODES = [code for code in all_codes() if code[0] in "LS"]


def codes_of(text: str) -> list[str]:
    diagnostics = Diagnostics()
    parse(Source("page.soter", text), diagnostics)
    return [d.code for d in diagnostics.items]


@all_rows("code", all_codes())
def test_every_page_has_the_same_shape(code: str) -> None:
    page = explain(code)
    assert page is not None
    assert re.match(rf"# {re.escape(code)}: \S.*\n\n\S", page)
    assert title(code)
    assert page.endswith("\n")
    assert not re.search(r"[ \t]+$", page, re.MULTILINE)
    assert page.count("```") <= 2, "a page has one example"


def test_the_type_of_codes_is_closed_by_the_pages() -> None:
    assert sorted(get_args(Code)) == sorted(all_codes())


@all_rows("code", SYNTAX_CODES)
def test_wrong_example_of_a_syntax_page_gives_its_code(code: str) -> None:
    assert code in codes_of(wrong(code))


@all_rows("code", SYNTAX_CODES)
def test_mended_example_of_a_syntax_page_parses(code: str) -> None:
    assert code in IN_WORDS or codes_of(mended(code)) == []


def test_every_code_of_lexer_and_parser_has_a_page() -> None:
    sources = files_below(ROOT / "src" / "soter" / "language" / "syntax", "*.py")
    used = {c for f in sources for c in re.findall(r'"([LS]\d{3})"', f.read_text("utf-8"))}
    assert used == set(SYNTAX_CODES)


def test_pages_are_found_in_any_letter_case() -> None:
    assert explain("s004") == explain(" S004 ") == explain("S004")
    assert title("s004") == "`;` is missing"


def test_unknown_code_has_no_page_but_suggestions() -> None:
    assert explain("S0004") is None
    assert title("nonsense") is None
    assert "S004" in similar_codes("S0004")
    assert similar_codes("\x00" * 1000) == []


def test_codes_come_in_order() -> None:
    codes = SYNTAX_CODES
    assert codes == sorted(codes)
    assert codes[0] == "L001"
