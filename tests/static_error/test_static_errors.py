"""Every program of this folder is wrong in one way, and is told so in one way.

The first line of a program says which codes, in order: `// expect: P1a`. Nothing else may be
reported: an error that brings others along is a mistake of ours. The rendered text is a golden.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from generators.file_listing import files_in
from soter.diagnostics.diagnostic import Severity
from soter.diagnostics.render import render_all
from soter.language.front_end import CheckResult, check_file
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

FOLDER = Path(__file__).parent
PROGRAMS = [p.name for p in files_in(FOLDER, "*.soter")]


def expected(name: str) -> list[str]:
    first = (FOLDER / name).read_text(encoding="utf-8").split("\n", 1)[0]
    assert first.startswith("// expect: ")
    return first.removeprefix("// expect: ").split()


def check(name: str) -> CheckResult:
    checked = check_file(name)
    for d in checked.diagnostics.items:
        for label in (*([d.primary] if d.primary else []), *d.secondary):
            text = label.span.source.text
            assert 0 <= label.span.start <= label.span.end <= len(text)
    return checked


first_check = cache(check)


@pytest.mark.whole
@all_rows("name", PROGRAMS)
def test_a_wrong_program_gets_the_expected_diagnostics(
    name: str, golden: Callable[[str, str], None]
) -> None:
    checked = first_check(name)
    diagnostics = checked.diagnostics.items
    assert [d.code for d in diagnostics] == expected(name)
    assert diagnostics[0].code == name.split("_", 1)[0]
    errors = [d for d in diagnostics if d.severity is Severity.ERROR]
    assert checked.diagnostics.has_errors == bool(errors)
    assert checked.ok == (not errors)
    assert all((d.severity is Severity.WARNING) == d.code.startswith("W") for d in diagnostics)
    golden(f"static_error/{Path(name).stem}.txt", render_all(diagnostics) + "\n")


@all_rows("name", PROGRAMS)
def test_a_message_is_written_like_the_others(name: str) -> None:
    for d in first_check(name).diagnostics.items:
        texts = [d.message, *d.notes, *d.helps, *(x.text for x in d.secondary)]
        texts += [d.primary.text] if d.primary else []
        for text in texts:
            assert not text.endswith(".") or text.endswith("..."), text
            assert text[:1] not in {" ", "'", '"'}, text
            assert "\n" not in text
            assert text.count("`") % 2 == 0, text
        first = d.message.split()[0]
        assert first.startswith("`") or first[:2].isupper() or not first[0].isupper(), d.message


def test_diagnostics_do_not_depend_on_the_run() -> None:
    for name in PROGRAMS:
        again = render_all(check(name).diagnostics.items)
        assert again == render_all(first_check(name).diagnostics.items)
