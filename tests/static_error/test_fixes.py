"""Every help that is an edit is applied to its program, which then is rid of the error.

What the others say in code is read: it must be Soter, with `...` for what the user knows.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from generators.found import files_in
from soter.diagnostics.diagnostic import Severity
from soter.diagnostics.fix import applied
from soter.program.build import Checked, check_file

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Diagnostic
    from soter.diagnostics.fix import Fix

FOLDER = Path(__file__).parent
PROGRAMS = [p.name for p in files_in(FOLDER, "*.soter")]

#: What an error hid, and its fix shows: the next step is the user's.
SHOWN_BY_A_FIX = {
    "N001_instance_that_cannot_be_made.soter": {"M013", "T002"},
    "T014_duration_argument.soter": {"T002"},
}


@pytest.fixture(autouse=True)
def _in_this_folder() -> Iterator[None]:
    before = Path.cwd()
    os.chdir(FOLDER)
    yield
    os.chdir(before)


def after(name: str, fix: Fix) -> Checked | None:
    """The program checked with a fix; None where the fix is of another file."""
    texts = {source.name: text for source, text in applied(fix).items()}
    return check_file(name, texts[name]) if set(texts) == {name} else None


def same(one: Diagnostic, other: Diagnostic) -> bool:
    return (one.code, one.message) == (other.code, other.message)


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_help_that_is_an_edit_removes_the_error_and_brings_no_other(name: str) -> None:
    found = check_file(name).diagnostics.items
    for d in found:
        for fix in d.fixes:
            assert fix.title in d.helps
            assert fix.edits
            mended = after(name, fix)
            if mended is None:
                continue
            left = mended.diagnostics.items
            assert not any(same(d, x) for x in left), (fix, [x.message for x in left])
            told = {(x.code, x.message) for x in found}
            errors = [x for x in left if x.severity is Severity.ERROR]
            new = [x for x in errors if (x.code, x.message) not in told]
            assert {x.code for x in new} <= SHOWN_BY_A_FIX.get(name, set()), (fix, new)
