"""The tables of what is said of mistakes: whole, installed, and read only where there is one."""

from __future__ import annotations

from pathlib import Path

import pytest

from generators.file_listing import files_below
from soter.language.front_end import check_file
from soter.language.syntax import foreign_phrases, words

ROOT = Path(__file__).resolve().parents[4]
SOTER = ROOT / "src" / "soter"
CACHES = (
    words.word_table, words._meanings, foreign_phrases.forms, words.places
)  # fmt: skip


@pytest.mark.parametrize("file", ["wall/cart.soter", "testing/two_modules.soter"])
def test_a_right_program_reads_no_table(file: str) -> None:
    for cache in CACHES:
        cache.cache_clear()
    assert not check_file(str(ROOT / "examples" / file)).diagnostics.items
    assert words.word_table.cache_info().misses == 0


def test_a_wrong_program_reads_tables(tmp_path: Path) -> None:
    for cache in CACHES:
        cache.cache_clear()
    wrong = tmp_path / "wrong.soter"
    wrong.write_text("soter 1;\nconst float A = 3.0;\n", encoding="utf-8")
    assert check_file(str(wrong)).diagnostics.items
    assert words.word_table.cache_info().misses > 0


def test_every_phrase_has_its_groups_and_says_something() -> None:
    for form in foreign_phrases.forms():
        groups = form.pattern.groupindex
        assert form.by or form.write is not None or form.advise, form.message
        for gap in foreign_phrases._GAP.finditer(f"{form.message} {form.write or ''}"):
            assert set(gap[1].split(",")) <= set(groups), (form.message, gap[0])


def test_what_the_phrases_name_is_there_and_nothing_else_is() -> None:
    forms = foreign_phrases.forms()
    changes = {gap[2] for f in forms for gap in foreign_phrases._GAP.finditer(f.write or "")}
    assert changes - {None} == set(foreign_phrases.CHANGES)
    assert {f.by for f in forms} - {""} == set(foreign_phrases.WRITERS)


def test_all_that_lies_beside_the_code_is_installed() -> None:
    toml = words.toml_of((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    patterns = toml["tool"]["setuptools"]["package-data"]["soter"]
    installed = {p for pattern in patterns for p in SOTER.glob(pattern)}
    beside = {p for p in files_below(SOTER, "*") if p.is_file() and p.suffix != ".py"}
    assert not {str(p) for p in beside - installed if "__pycache__" not in p.parts}
