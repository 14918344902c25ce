"""Whether the tests lost power: the same mutants of Python in two checkouts, and who kills them.

    .venv/bin/python bench/house/mutation_sample.py --before ../older_checkout [--count 300]
        [--seed 1] [--keep FILE]

Purpose: mutants at lines that stand once in either checkout, in whichever file (a comparison, an
operation, a truth or a whole number is another), drawn by seed; each in a copy of this tree, and
of the other where it lives in this one, judged by tests of CI: of those that name the mutated
module, else of its room, the `FILES_MAX` with the fewest bytes. Killed: one of them fails, or they
take longer than `CPU_S`. What is done is written to `--keep`, and not done again.
Non-goals: mutants that only longer tests or tests of other rooms see; C.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from bench.pieces import Pieces  # noqa: E402 - needs the path

if TYPE_CHECKING:
    from collections.abc import Iterator

CPU_S = 180
"""A mutant's tests may use as many seconds of a processor: a busy machine kills none."""
WALL_S = 1800.0
"""And may wait as long: a mutant that waits for ever is killed, too."""
FILES_MAX = 6
"""As many files of tests judge a mutant."""
KNOWS_REST = "test-rest:"
"""What the Makefile has where quick tests are a part of those that CI runs."""
REST = ("--rest", "-m", "not long")
"""Options of the other part of those."""
PARTS = ("src", "tests", "bench", "examples", "docs", "pyproject.toml", "README.md", "Makefile")
OTHER = {
    "<": "<=",
    "<=": "<",
    ">": ">=",
    ">=": ">",
    "==": "!=",
    "!=": "==",
    "is not": "is",
    "+": "-",
    "-": "+",
    "*": "+",
    "//": "*",
    "and": "or",
    "or": "and",
    "True": "False",
    "False": "True",
}
"""A token between or instead of operands, and what stands there in the mutant."""


@dataclass(frozen=True)
class Mutant:
    """In the file of this name below `src/soter` the text at `start` of a line, another."""

    file: str
    line: str
    start: int
    old: str
    new: str


def mutants(path: Path, name: str) -> Iterator[Mutant]:
    """Every mutant of a file."""
    text = path.read_text(encoding="utf-8")
    lines = text.split("\n")
    for node in ast.walk(ast.parse(text)):
        pairs: list[tuple[ast.expr, ast.expr]] = []
        if isinstance(node, ast.Compare):
            pairs = list(zip([node.left, *node.comparators], node.comparators, strict=False))
        elif isinstance(node, ast.BinOp):
            pairs = [(node.left, node.right)]
        elif isinstance(node, ast.BoolOp):
            pairs = list(zip(node.values, node.values[1:], strict=False))
        for left, right in pairs:
            if left.end_lineno != right.lineno:
                continue
            line = lines[right.lineno - 1]
            at = len(line.encode()[: left.end_col_offset or 0].decode())
            between = line[at : len(line.encode()[: right.col_offset].decode())]
            token = between.strip("() ")
            if token in OTHER:
                yield Mutant(name, line, at + between.index(token), token, OTHER[token])
        if isinstance(node, ast.Constant) and node.lineno == node.end_lineno:
            line = lines[node.lineno - 1]
            at = len(line.encode()[: node.col_offset].decode())
            old = str(node.value)
            if line.startswith(old, at) and isinstance(node.value, int):
                new = OTHER.get(old) or str(node.value + 1)
                yield Mutant(name, line, at, old, new)


def lines_once(tree: Path) -> dict[str, str]:
    """The lines that stand once below `src/soter` of a tree, and the name of the file of each."""
    room = tree / "src" / "soter"
    files: dict[str, list[str]] = {}
    for path in sorted(room.rglob("*.py")):
        for line in path.read_text(encoding="utf-8").split("\n"):
            files.setdefault(line, []).append(str(path.relative_to(room)))
    return {line: names[0] for line, names in files.items() if len(names) == 1}


def common(before: Path) -> list[tuple[Mutant, Mutant]]:
    """The mutants at lines which both trees have once: in the other tree, and in this one."""
    here, there = lines_once(ROOT), lines_once(before)
    return [
        (replace(mutant, file=there[mutant.line]), mutant)
        for name in sorted(set(here.values()))
        for mutant in mutants(ROOT / "src" / "soter" / name, name)
        if mutant.line in here and mutant.line in there
    ]


def judges(tree: Path, mutant: Mutant) -> tuple[str, ...]:
    """The files of tests that name the module; where none does, those of its room."""
    module = "soter." + mutant.file.removesuffix(".py").replace("/", ".")
    named = [
        p for p in (tree / "tests").rglob("test_*.py") if module in p.read_text(encoding="utf-8")
    ]
    room = tree / "tests" / "unit" / mutant.file
    while not named and room != tree / "tests" / "unit":
        room = room.parent
        named = sorted(room.glob("test_*.py"))
    named.sort(key=lambda p: (p.stat().st_size, p))
    return tuple(str(p.relative_to(tree)) for p in named[:FILES_MAX])


def passes(tree: Path, tests: tuple[str, ...]) -> bool:
    """Whether tests of a tree pass; not, where they take longer than `CPU_S`."""
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
    try:
        done = subprocess.run(
            [*command, *tests],
            cwd=tree,
            env={**os.environ, "PYTHONPATH": str(tree / "src")},
            capture_output=True,
            timeout=WALL_S,
            check=False,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S)),
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode in (0, 5)


passes_unchanged = cache(passes)


def verdict(tree: Path, mutant: Mutant) -> str:
    """What the tests of a tree say of a mutant: killed, survived, or not judged.

    Not judged is what no test names, and what tests would judge that fail without it.
    """
    tests = judges(tree, mutant)
    if not tests:
        return "not judged"
    path = tree / "src" / "soter" / mutant.file
    text = path.read_text(encoding="utf-8")
    rest = mutant.line[mutant.start + len(mutant.old) :]
    path.write_text(text.replace(mutant.line, mutant.line[: mutant.start] + mutant.new + rest))
    parts = [tests, (*REST, *tests)] if KNOWS_REST in (tree / "Makefile").read_text() else [tests]
    try:
        failing = next((part for part in parts if not passes(tree, part)), None)
    finally:
        path.write_text(text, encoding="utf-8")
    if failing is None:
        return "survived"
    return "killed" if passes_unchanged(tree, failing) else "not judged"


def main() -> int:
    """Judge; 1 where a mutant lives that was killed before."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, required=True)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    drawn = random.Random(given.seed).sample(common(given.before), given.count)  # noqa: S311
    pieces = Pieces(given.keep, str(given.seed))
    tally: dict[tuple[str, str], int] = {}
    with tempfile.TemporaryDirectory() as work:
        trees = {"before": Path(work) / "before", "now": Path(work) / "now"}
        for name, source in (("before", given.before), ("now", ROOT)):
            trees[name].mkdir()
            for part in PARTS:
                copy: Any = shutil.copytree if (source / part).is_dir() else shutil.copy
                copy(source / part, trees[name] / part)
        for old, new in drawn:
            said = {"before": "not asked"}
            for name, mutant in (("now", new), ("before", old)):
                if said.get("now") != "killed":
                    judge = partial(verdict, trees[name], mutant)
                    said[name] = pieces.piece(f"{name} {mutant}", judge)
            both = (said["before"], said["now"])
            tally[both] = tally.get(both, 0) + 1
            if both == ("killed", "survived"):
                print(f"killed before, lives now: {new.file}: {new.line.strip()}", flush=True)
    for (was, now), n in sorted(tally.items()):
        print(f"{n:5}  before {was}, now {now}")
    lost = tally.get(("killed", "survived"), 0)
    judged = sum(n for both, n in tally.items() if "not judged" not in both)
    print(
        f"{judged} of {given.count} mutants judged; killed before, living now: {lost} (target: 0)"
    )
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
