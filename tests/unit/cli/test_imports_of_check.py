"""`soter check` imports nothing that no check needs: its start is what an editor waits for.

Purpose: programs that between them reach every part of a check are checked in one process that
listens to calls; a module that was imported, and of which no function ran, is named, or stands
below with the input on which it does.
"""

from __future__ import annotations

import ast
import json
import sys
from pathlib import Path

import processes

ROOT = Path(__file__).resolve().parents[3]
LISTENER = """
import sys
ran = set()
def listen(frame, event, argument):
    if event == "call":
        ran.add((frame.f_code.co_filename, frame.f_code.co_name))
sys.setprofile(listen)
import contextlib, io, json
from soter.cli.main import main
with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    assert main(["check", sys.argv[1]]) == 0
    modules = {n: m.__file__ for n, m in sys.modules.items() if n.split(".")[0] == "soter"}
    assert main(["check", sys.argv[2]]) == 0
    for program in sys.argv[3:]:
        main(["check", program])
sys.setprofile(None)
print(json.dumps([modules, sorted(ran)]))
"""
CART = "examples/wall/cart.soter"
PROGRAMS = (
    "examples/wall/stop.soter",
    "examples/generality/altitude.soter",
    "examples/testing/slow_planner.soter",
    "examples/drone/city.soter",
    "examples/drone/adversaries.soter",
    "examples/drone/corridor.soter",
    *(
        f"tests/static_error/{name}.soter"
        for name in (
            "C001_late_by_nothing",
            "N001_drawn_in_a_step",
            "N001_unknown_type",
            "D004_nan",
            "E009_faults_unknown",
            "E015_several_messages",
            "E020_nobody_stands_in",
            "L001_preprocessor",
            "M005_without_a_system",
            "M013_invariant_of_a_node",
            "M027_candidates_beyond_the_set",
            "S005_unit_behind_the_set",
            "S010_until_in_a_loop",
            "S015_name_of_a_property",
            "T003_wrong_arguments_are_checked_too",
            "W010_set_of_what_nobody_reads",
            "W034_ageless_scan",
        )
    ),
)
TIMED = """soter 1;
topic out : float in [0.0, 1.0] = 0.0;
node Half period 10ms {
  publishes out;
  wcet 1ms;
  step { publish out = 0.5; }
}
system Timed { node Half; }
"""
ON_OTHER_INPUT = {
    "soter.api.computed_ttf": "a method of Program for another command",
    "soter.api.measured_times": "`--times`",
    "soter.api.output_files": "a method of Program for another command",
    "soter.diagnostics.current_phase": "a check that takes seconds",
    "soter.version": "VERSION in a document; its functions say what is missing",
}


def functions(path: str) -> set[str]:
    """The names of the functions of a file; none where it has but data."""
    tree = ast.parse(Path(path).read_text(encoding="utf-8"))
    return {n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}


def test_check_imports_no_module_that_no_check_uses(tmp_path: Path) -> None:
    timed = tmp_path / "timed.soter"
    timed.write_text(TIMED, encoding="utf-8")
    done = processes.run(
        [sys.executable, "-c", LISTENER, CART, str(timed), *PROGRAMS],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    modules, ran = json.loads(done.stdout)
    names: dict[str, set[str]] = {}
    for path, name in ran:
        names.setdefault(path, set()).add(name)
    unused = {
        module
        for module, path in modules.items()
        if not path.endswith("__init__.py")
        and functions(path)
        and not functions(path) & names.get(path, set())
    }
    assert unused == set(ON_OTHER_INPUT)
