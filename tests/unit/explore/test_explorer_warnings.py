"""The explorer's C compiles without a warning, under the flags of what ships."""

from __future__ import annotations

from typing import TYPE_CHECKING

import processes
from soter.explore.engine.explorer_library import FLAGS, c_sources
from soter.native.compiler import STRICT, WARNINGS, find_compiler
from soter.native.shared_library import RUNTIME, include_flags
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path


@all_rows("file", [f for f in c_sources() if f.suffix == ".c"], ids=lambda f: f.stem)
def test_a_file_of_the_explorer_has_no_warning(file: Path) -> None:
    include = (f"-I{RUNTIME}", *include_flags(*c_sources()))
    command = [
        *find_compiler().command,
        *STRICT,
        *WARNINGS,
        *FLAGS,
        *include,
        "-fsyntax-only",
        str(file),
    ]
    done = processes.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
