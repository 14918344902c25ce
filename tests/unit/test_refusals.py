"""Each refusal of the re-checker, and of times in proofs, has a test that says why it is there.

`refusals.toml` has, by the file below `src/soter`, the text of each refusal (`{}`: what the program
fills in) and the test that reaches it, or after `no test:` why none can. The last test runs the
tests that are named, and compares with what they reach.
"""

from __future__ import annotations

import ast
import os
import re
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest
from bench.house.reached_refusals import NOTES, read

import processes
from unit.test_house_figures import ROOT, SRC, trees

TABLE = Path(__file__).with_name("refusals.toml")
REFUSING = {
    "DiffersError": 0,
    "NotACertificateError": 0,
    "NotRecheckedError": 0,
    "RejectedError": 0,
    "block_tasks": 0,
    "diagnostics.error": 1,
}
"""Whoever is called with a refusal's text, and which argument that is."""
ASKED = "block_tasks"
"""It says why a claim does not hold, should the claim not hold of some cells."""
ROOMS = ("certificate", "verify/problem/time_checks.py")
NO_TEST = "no test: "
UNTESTED = 8
"""So many refusals have no test here, at most (one has it in another process): fallen figures
are written down."""


class Refusal(NamedTuple):
    """The lines of its call; of a claim also how each text begins that says it does not hold."""

    lines: range
    claim: re.Pattern[str] | None


def known() -> dict[str, dict[str, str]]:
    """The table: by file and text the tests of each refusal."""
    toml = import_module("tomllib" if find_spec("tomllib") else "tomli")
    table: dict[str, dict[str, str]] = toml.loads(TABLE.read_text(encoding="utf-8"))
    return table


def text_of(call: ast.Call, tree: ast.Module) -> ast.expr:
    """The text that a call is given; of a name in a claim what was assigned to it last before."""
    who = ast.unparse(call.func)
    text = call.args[REFUSING[who]]
    if who != ASKED or not isinstance(text, ast.Name):
        return text
    assigned = [n for n in ast.walk(tree) if isinstance(n, ast.Assign)]
    named = {n.lineno: n.value for n in assigned if ast.unparse(n.targets[0]) == text.id}
    before = [line for line in named if line < call.lineno]
    return named[max(before or named)]


def refusals_in(tree: ast.Module) -> dict[str, list[Refusal]]:
    """The refusals of a file by their texts; those with the same text are one entry."""
    found: dict[str, list[Refusal]] = {}
    calls = [n for n in ast.walk(tree) if isinstance(n, ast.Call)]
    for call in (c for c in calls if ast.unparse(c.func) in REFUSING):
        text = text_of(call, tree)
        parts = text.values if isinstance(text, ast.JoinedStr) else [text]
        words = [p.value if isinstance(p, ast.Constant) else None for p in parts]
        name = "".join("{}" if w is None else str(w) for w in words)
        name = ast.unparse(text) if name == "{}" else name
        pattern = "".join(".*" if w is None else re.escape(str(w)) for w in words)
        claim = re.compile(pattern) if ast.unparse(call.func) == ASKED else None
        lines = range(call.lineno, (call.end_lineno or call.lineno) + 1)
        found.setdefault(name, []).append(Refusal(lines, claim))
    return found


def refusals() -> dict[str, dict[str, list[Refusal]]]:
    """All of them by file, of the files that have some."""
    by_file = {
        path.relative_to("soter").as_posix(): refusals_in(tree)
        for path, tree in trees().items()
        if path.relative_to("soter").as_posix().startswith(ROOMS)
    }
    return {file: of for file, of in by_file.items() if of}


def not_reached(table: dict[str, dict[str, str]], notes: Path) -> list[str]:
    """The refusals in a table that its tests, which are run, do not reach.

    `notes`: a file to be written.
    """
    notes.touch()
    tests = sorted({f"tests/{t}" for of in table.values() for v in of.values() for t in v.split()})
    run = [sys.executable, "-m", "pytest", "-p", "bench.house.reached_refusals", "-q", "-n0"]
    env = os.environ | {NOTES: str(notes)}
    done = processes.run([*run, *tests], cwd=ROOT, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    noted, missed, by_file = read(notes), [], refusals()
    for file, of in table.items():
        for name, value in of.items():
            seen = [n for t in value.split() for n in noted.get(f"tests/{t}", ())]
            lines = {line for at, line, _ in seen if Path(at) == SRC / "soter" / file}
            for refusal in by_file[file][name]:
                if claim := refusal.claim:
                    reached = any(claim.match(text) for _, _, text in seen)
                else:
                    reached = not lines.isdisjoint(refusal.lines)
                if not reached:
                    missed.append(f"{file}: {name}: not reached by {value}")
    return missed


def test_every_refusal_is_in_the_table_and_no_other() -> None:
    table, found = known(), refusals()
    assert {file: set(of) for file, of in table.items()} == {f: set(of) for f, of in found.items()}
    values = [value for of in table.values() for value in of.values()]
    assert sum(v.startswith(NO_TEST) for v in values) == UNTESTED


def test_each_test_in_the_table_is_there() -> None:
    """Also in a run without the long tests: somebody renames one."""
    values = [value for of in known().values() for value in of.values()]
    named = {t for v in values if not v.startswith(NO_TEST) for t in v.split()}
    parts = [(t, *t.split("::")) for t in sorted(named)]
    texts = {file: (ROOT / "tests" / file).read_text(encoding="utf-8") for _, file, _ in parts}
    assert [t for t, file, name in parts if f"\ndef {name}(" not in texts[file]] == []


def test_a_refusal_that_its_test_does_not_reach_is_told(tmp_path: Path) -> None:
    file, name = "certificate/reading/folder.py", "the manifest lists no files"
    right = known()[file][name]
    wrong = "unit/certificate/test_single_refusals.py::test_another_format_is_named"
    assert not_reached({file: {name: right}}, tmp_path / "right") == []
    told = f"{file}: {name}: not reached by {wrong}"
    assert not_reached({file: {name: wrong}}, tmp_path / "wrong") == [told]


@pytest.mark.long
@pytest.mark.parametrize("room", sorted({file.rpartition("/")[0] for file in known()}))
def test_each_refusal_is_reached_by_the_test_that_it_has(room: str, tmp_path: Path) -> None:
    of_room = {f: of for f, of in known().items() if f.rpartition("/")[0] == room}
    tested = {
        f: {n: v for n, v in of.items() if not v.startswith(NO_TEST)} for f, of in of_room.items()
    }
    assert not_reached(tested, tmp_path / "notes") == []
