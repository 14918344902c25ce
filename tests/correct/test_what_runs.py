"""What each command executes is what docs/what-runs.md says: the test reads the page's table.

Each command line runs under an audit hook (`bench/hostile/audited_command.py`), on a program whose
AC is in Python and on one whose AC and a plant call C; both leave a file where they are loaded.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import processes
from soter.cli.main import COMMANDS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from _pytest.mark import ParameterSet

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "what-runs.md"
AUDITED = ROOT / "bench" / "hostile" / "audited_command.py"
SHUTTLE = (ROOT / "examples" / "wall" / "shuttle.soter").read_text(encoding="utf-8")
FAST = SHUTTLE[SHUTTLE.index("node Fast") : SHUTTLE.index("// Safe: back")]
IN_PYTHON = """extern node Fast period 10ms from "python:ac.py:step" {
  subscribes position, goal;
  publishes speed;
}
"""
IN_C = 'extern fun hurry(x: float): float from "c:hurry.c:hurry";\n' + FAST.replace(
    "goal > position ? FASTEST : -FASTEST", "clamp(hurry(goal - position), -FASTEST, FASTEST)"
)
ODOMETER = """topic odo: float = 0.0;
plant Odo period 10ms { drives odo = x; state x: float = 0.0; next x = hurry(x); }
"""
TESTED = """
node Other period 10ms { publishes speed; step { publish speed = 0.5; } }
test T { system Track; replace Guard.Fast by Other; horizon 20ms; never speed > 0.4; }
"""
REFUTED = "ttf abs(position) > 9.9999; safer abs(position) < 9.99;"
PYTHON = "open(__file__ + '.ran', 'w')\ndef step(i):\n    return {'speed': 1.0}\n"
C = """#include <stdio.h>
__attribute__((constructor)) static void ran(void) {
  FILE *const file = fopen("FOLDER/hurry.c.ran", "w");
  if (file != NULL) { fclose(file); }
}
double hurry(double x) { return x > 0.0 ? 1.0 : -1.0; }
"""
MARKS = ("ac.py.ran", "hurry.c.ran")
SHORT = "--until 100ms"
LINES = {
    "run": (f"run {{0}}.soter {SHORT}",),
    "run --engine interp": (f"run {{0}}.soter {SHORT} --engine interp",),
    "run --real-time": (f"run {{0}}.soter {SHORT} --real-time --misses 1000",),
    "verify": ("verify {0}.soter", "verify {0}_refuted.soter"),
    "recheck": ("recheck {0}_cert",),
    "monitor": ("monitor {0}.soter {0}.mcap", "monitor {0}.soter {0}.mcap --estimates"),
    "monitor --seed": (f"monitor {{0}}.soter {SHORT}", f"monitor {{0}}.soter {SHORT} --seed 1..2"),
    "identify": ("identify {0}.mcap --program {0}.soter --episode 20ms --estimates",),
    "campaign": (f"campaign {{0}}.soter --flights 2 {SHORT} -o out",),
    "campaign --arms paper": (f"campaign {{0}}.soter --flights 2 {SHORT} -o out --arms paper",),
    "test": ("test python.soter",),
    "replay": ("replay .soter/made.trace.json",),
    "assure": ("assure {0}.soter --flights 1 --cert {0}_cert --campaign c_flown -o out_{0}",),
    "measure": (f"measure {{0}}.soter --samples 5 {SHORT}",),
    "build": ("build {0}.soter -o out_{0}", "build {0}.soter --target posix -o posix_{0}"),
    "policy": ("policy ppo.zip",),
    "explain": ("explain P2a",),
    "new": ("new robot_x",),
    "completion": ("completion bash",),
    "cache": ("cache",),
    "help": ("help run",),
    "lsp": ("lsp",),
}
"""Command -> lines; those that are not here are given the program alone. {0}: each program."""
MADE = {
    "{0}.mcap": f"run {{0}}.soter {SHORT} --log {{0}}.mcap",
    "{0}_cert": "verify {0}.soter --cert {0}_cert",
    "c_flown": f"campaign c.soter --flights 2 {SHORT} -o c_flown",
    ".soter/made.trace.json": "test python.soter",
}
"""What a line reads that another command writes."""


REFUSED = ("campaign python.soter", "assure python.soter")
"""A campaign flies what is compiled; the other one is told that the flights are not its own."""


def rows() -> Iterator[tuple[str, tuple[str, str, str]]]:
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if match := re.fullmatch(r"\| `soter ([^`]+)` \| (\w+) \| (\w+) \| ([^|]+) \|", line):
            yield match[1], (match[2], match[3], match[4].strip())


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    text = SHUTTLE.replace("/ 400", "/ 80").replace("within 0.02", "within OFF")
    text = text.replace("soter 1;", "soter 1;\nparam OFF: float = 0.02 in [0.0, 1.0];")
    in_c = text.replace(FAST, IN_C).replace("// Safe: back", ODOMETER + "// Safe: back")
    for name, program in (
        ("python", text.replace(FAST, IN_PYTHON) + TESTED),
        ("c", in_c.replace("c: Shuttle;", "c: Shuttle;\n  o: Odo;")),
    ):
        (tmp_path / f"{name}.soter").write_text(program)
        refuted = program.replace("< WALL;\n", f"< WALL; {REFUTED}\n", 1)
        (tmp_path / f"{name}_refuted.soter").write_text(refuted)
    (tmp_path / "ac.py").write_text(PYTHON)
    (tmp_path / "hurry.c").write_text(C.replace("FOLDER", str(tmp_path)))
    policy = ROOT / "tests" / "unit" / "policy" / "files" / "ppo.zip"
    (tmp_path / "ppo.zip").write_bytes(policy.read_bytes())
    return tmp_path


def audited(folder: Path, line: str) -> list[list[str]]:
    """What a command line was seen to do."""
    notes = folder / "notes"
    words = [sys.executable, str(AUDITED), str(notes), *line.split()]
    done = processes.run(words, stdin=processes.DEVNULL, capture_output=True)
    fine = (0, 1, 2, 3, 4) if line.startswith(REFUSED) else (0, 3, 4)
    assert done.returncode in fine, (line, done.stdout, done.stderr)
    told = notes.read_text().splitlines() if notes.exists() else []
    notes.unlink(missing_ok=True)
    return [json.loads(x) for x in told]


def started(event: list[str]) -> str:
    """Which program a process runs, in the words of the page; a shell leads a compiler's group."""
    words = event[1:]
    if words[0] == "/bin/sh" and "sh" in words[1:4]:
        words = words[words.index("sh") + 1 :]
    name = Path(words[0]).name
    if name in ("cc", "gcc", "clang"):
        return "compiler"
    if Path(words[0]).resolve() == Path(sys.executable).resolve():
        return "Python"
    return "the program that was built" if "--record" in words else name


def prepared(folder: Path, line: str, name: str) -> None:
    """Make what the line reads; nothing that is executed for that counts."""
    for made, how in MADE.items():
        if made.format(name) in line.split() and not (folder / made.format(name)).exists():
            audited(folder, how.format(name))
            for trace in folder.glob(".soter/*.trace.json"):
                trace.rename(folder / ".soter" / "made.trace.json")
    for mark in MARKS:
        (folder / mark).unlink(missing_ok=True)


def seen(folder: Path, command: str) -> tuple[str, str, set[str]]:
    """The row of a command, as it was observed."""
    programs, ran = set[str](), set[str]()
    for line in LINES.get(command, (f"{command} {{0}}.soter",)):
        for name in ("python", "c") if "{0}" in line else ("python",):
            words = line.format(name)
            prepared(folder, words, name)
            programs |= {started(e) for e in audited(folder, words) if e[0] == "starts"}
            ran |= {mark for mark in MARKS if (folder / mark).exists()}
    first, second = ("yes" if mark in ran else "no" for mark in MARKS)
    return first, second, programs


def test_the_page_has_every_command() -> None:
    assert {command.split()[0] for command, _ in rows()} == set(COMMANDS)


def _marked(command: str, row: tuple[str, str, str]) -> ParameterSet:
    """`check` reads a program as every command does; those that compile or prove are dear."""
    marks = () if command in ("check", "policy") else (pytest.mark.long,)
    return pytest.param(command, row, id=command, marks=marks)


@pytest.mark.parametrize(("command", "row"), [_marked(*r) for r in rows()])
def test_a_command_executes_what_the_page_says(
    folder: Path, command: str, row: tuple[str, str, str]
) -> None:
    """A compiler need not run where the cache has what it would make."""
    python, c, programs = seen(folder, command)
    told = set(row[2].split(", ")) - {"none"}
    assert (python, c) == row[:2]
    assert programs <= told <= programs | {"compiler"}
