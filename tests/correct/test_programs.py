"""The programs of this folder: every construct once, without a word from the checker.

Each is also run for a few instants, every system of it, on both engines, which must agree.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from generators.file_listing import files_in
from soter.diagnostics.render import render_all
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram, run_interpreted
from tables import all_rows

FOLDER = Path(__file__).parent
PROGRAMS = [p.name for p in files_in(FOLDER, "*.soter")]
NOT_RUN = {"externs.soter"}  # nothing is bound; `test_bindings.py` runs externs
INSTANTS_NS = 300_000_000


@all_rows("name", PROGRAMS)
def test_a_correct_program_gets_no_diagnostics(name: str) -> None:
    checked = check_file(str(FOLDER / name))
    assert render_all(checked.diagnostics.items) == ""
    assert checked.ok


@pytest.mark.parametrize("name", [n for n in PROGRAMS if n not in NOT_RUN])
def test_a_correct_program_runs_alike_on_both_engines(name: str) -> None:
    checked = check_file(str(FOLDER / name))
    for system_name in checked.systems:
        system = system_of(checked, system_name)
        native = NativeProgram(system, "-O0").run(INSTANTS_NS, 5, hash_trace=True)
        interpreted = run_interpreted(system, INSTANTS_NS, 5)
        assert native.instants > 1, system_name
        assert native.trace_sha256 == interpreted.trace_sha256, system_name
        assert [str(v) for v in native.violation_list] == [
            str(v) for v in interpreted.violation_list
        ]


def test_the_folder_has_programs() -> None:
    assert len(PROGRAMS) >= 15
