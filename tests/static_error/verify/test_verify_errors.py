"""Programs of this folder check, but do not determine a verification problem, each in one way.

The first line says which code: `// expect: R001`. The rendered text is a golden. The pages of these
codes have a wrong program too, and one that is mended.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from generators.file_listing import files_below, files_in
from soter.diagnostics.codes import all_codes
from soter.diagnostics.diagnostic import SoterError
from soter.diagnostics.render import render_all
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.front_end import check_file, system_of
from soter.verify.chosen_modules import refuse_forced_modules
from soter.verify.problem.extract import extract
from tables import all_rows
from unit.diagnostics.page_examples import mended, wrong

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Diagnostic

FOLDER = Path(__file__).parent
PROGRAMS = [p.name for p in files_in(FOLDER, "*.soter")]
CODES = [code for code in all_codes() if code[0] == "R"]


def problems(name: str, text: str | None = None) -> tuple[Diagnostic, ...]:
    """What extraction says about the modules of the default system."""
    checked = check_file(name, text)
    assert checked.ok, render_all(checked.diagnostics.items)
    flat = system_of(checked, None)
    diagnostics: tuple[Diagnostic, ...] = ()
    for module in flat.modules:
        try:
            refuse_forced_modules([(flat, module)])
            for seen in systems_by_view(flat, module):
                extract(*seen)
        except SoterError as error:
            diagnostics += tuple(error.diagnostics)
    return diagnostics


@all_rows("name", PROGRAMS)
def test_a_program_without_a_problem_gets_the_expected_diagnostic(
    name: str, golden: Callable[[str, str], None]
) -> None:
    diagnostics = problems(name)
    expected = (FOLDER / name).read_text("utf-8").split("\n", 1)[0].removeprefix("// expect: ")
    assert [d.code for d in diagnostics] == expected.split()
    assert diagnostics[0].code == name.split("_", 1)[0]
    golden(f"static_error/verify/{Path(name).stem}.txt", render_all(diagnostics) + "\n")


@all_rows("code", CODES)
def test_pages_of_these_codes_say_the_truth(code: str) -> None:
    assert {d.code for d in problems("page.soter", wrong(code))} == {code}
    assert problems("page.soter", mended(code)) == ()


def test_every_code_that_extraction_reports_has_a_page_and_a_program() -> None:
    room = Path(__file__).parents[3] / "src" / "soter" / "verify"
    used = {
        c
        for f in (
            *files_below(room, "*.py"),
            room.parent / "language" / "elaborate" / "views_for_proofs.py",
        )
        for c in re.findall(r'"(R\d{3})"', f.read_text("utf-8"))
    }
    assert used == set(CODES)
    assert used == {name.split("_")[0] for name in PROGRAMS}
