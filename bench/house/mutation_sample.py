"""Whether the tests lost power: the same mutants of Python in two checkouts, and who kills them.

    .venv/bin/python bench/house/mutation_sample.py --before ../older_checkout [--count 300]
        [--seed 1] [--keep FOLDER] [--jobs 2]

Purpose: mutants at lines that stand once in either checkout, in whichever file (a comparison, an
operation, a truth or a whole number is another), drawn by seed. The quick tests of a tree run once
with `reached_statements`; a mutant is judged by those that reach its statement, as many as take
`JUDGED_S`: in a copy of this tree, and of the other where it lives in this one; then by the test
that killed it there, whether quick here or not. Killed: one of them fails that passes without it,
or they take longer than `CPU_S`. What is done is kept in `--keep`, and not done again.
Non-goals: mutants that only longer tests or other processes see; C.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import accumulate
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))

from bench.house import reached_statements  # noqa: E402 - needs the path
from bench.pieces import Pieces  # noqa: E402 - needs the path

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

JUDGED_S = 60.0
"""As many seconds of a processor may the tests take that judge a mutant, without it."""
CPU_S = 240
"""And with it: a busy machine kills none."""
WALL_S = 1800.0
"""And may wait as long: a mutant that waits for ever is killed, too."""
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


def copy_of(source: Path, tree: Path) -> None:
    """Copies what tests need of a checkout; its packages and their metadata stay where they are."""
    tree.mkdir(parents=True)
    if (source / ".venv").is_dir():
        (tree / ".venv").symlink_to(source / ".venv")
    for part in PARTS:
        if (source / part).is_dir():
            shutil.copytree(source / part, tree / part)
        else:
            shutil.copy(source / part, tree / part)


def pytest_of(tree: Path) -> tuple[str, ...]:
    """The command of the copy's own Python: tests ask for the metadata of its distribution."""
    own = tree / ".venv" / "bin" / "python"
    python = str(own) if own.exists() else sys.executable
    return python, "-m", "pytest", "-q", "-p", "no:cacheprovider"


class Tests:
    """The quick tests of a tree, and which of them reach which line: found by one run of all."""

    def __init__(self, tree: Path, folder: Path) -> None:
        self.tree = tree
        folder.mkdir(parents=True, exist_ok=True)
        if not any(folder.iterdir()):
            env = {"REACHED": str(folder.resolve()), "PYTHONPATH": f"{tree / 'src'}:{HERE}"}
            command = [*pytest_of(tree), "-n", str(os.cpu_count()), "-p", "reached_statements"]
            subprocess.run(command, cwd=tree, env=os.environ | env, check=False)
        self.offsets, tests = reached_statements.read(folder)
        self.seconds = {name: seconds for name, (seconds, _) in tests.items()}
        self.of_line: dict[int, list[str]] = {}
        for name in sorted(tests, key=lambda t: self.seconds[t]):
            for line in tests[name][1]:
                self.of_line.setdefault(line, []).append(name)

    def of(self, mutant: Mutant) -> list[str]:
        """The tests that reach a mutant, those of its room first, then the quickest.

        Of what runs as a module is imported: the tests that reach anything of its file.
        """
        text = (self.tree / "src" / "soter" / mutant.file).read_text(encoding="utf-8")
        number = text.split("\n").index(mutant.line) + 1
        offset = self.offsets[mutant.file]
        every = reached_statements.statements(ast.parse(text))
        around = [s.lineno for s in every if s.lineno <= number <= (s.end_lineno or 0)]
        lines = [max(around)] if around else range(1, len(text.split("\n")))
        reach = {name: None for line in lines for name in self.of_line.get(offset + line, ())}
        room = f"tests/unit/{mutant.file.split('/')[0]}/"
        return sorted(reach, key=lambda name: (not name.startswith(room), self.seconds[name]))

    def within(self, names: list[str]) -> list[str]:
        """The first of some tests, as many as take `JUDGED_S` seconds."""
        sums = accumulate(self.seconds[name] for name in names)
        return [name for name, s in zip(names, sums, strict=True) if s <= JUDGED_S]


def failing(tree: Path, tests: Sequence[str]) -> str | None:
    """The first of some tests that fails, "" if they take too long, None if all pass."""
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as named:
        named.write("\n".join(tests))
        named.flush()
        try:
            done = subprocess.run(
                [*pytest_of(tree), "-x", "-n", "0", f"@{named.name}"],
                cwd=tree,
                env={**os.environ, "PYTHONPATH": str(tree / "src")},
                capture_output=True,
                text=True,
                timeout=WALL_S,
                check=False,
                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S)),
            )
        except subprocess.TimeoutExpired:
            return ""
    if done.returncode in (0, 5):
        return None
    said = re.search(r"^(?:FAILED|ERROR) (.*)$", done.stdout, re.MULTILINE)
    line = said.group(1) if said else ""
    return max((t for t in tests if line.startswith(t)), key=len, default=line.split(" - ")[0])


failing_unchanged = cache(failing)


def verdict(tree: Path, mutant: Mutant, names: list[str]) -> str:
    """What some tests of a tree say of a mutant: who killed it, survived, or not reached."""
    if not names:
        return "not reached"
    path = tree / "src" / "soter" / mutant.file
    text = path.read_text(encoding="utf-8")
    rest = mutant.line[mutant.start + len(mutant.old) :]
    path.write_text(text.replace(mutant.line, mutant.line[: mutant.start] + mutant.new + rest))
    try:
        killer = failing(tree, names)
    finally:
        path.write_text(text, encoding="utf-8")
    if killer is None:
        return f"survived {len(names)} tests"
    if failing_unchanged(tree, (killer,) if killer else tuple(names)) is not None:
        return f"not judged: {killer or names[0]} fails without it"
    return f"killed by {killer or 'time'}"


def main() -> int:
    """Judge; 1 where a mutant lives that was killed before."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, required=True)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    given = parser.parse_args()
    drawn = random.Random(given.seed).sample(common(given.before), given.count)  # noqa: S311
    with tempfile.TemporaryDirectory() as work:
        keep = given.keep or Path(work)
        pieces = Pieces(keep / "verdicts.jsonl", str(given.seed))
        copies = SimpleQueue[Path]()
        for k in range(given.jobs):
            copies.put(Path(work) / str(k))
        sources = {"now": ROOT, "before": given.before.resolve()}
        for name, source in sources.items():
            for k in range(given.jobs):
                copy_of(source, Path(work) / str(k) / name)
        tests = {name: Tests(Path(work) / "0" / name, keep / name) for name in sources}

        def judge(name: str, mutant: Mutant, killer: str = "") -> str:
            asked = tests[name]
            names = [killer] if killer else asked.within(asked.of(mutant))
            copy = copies.get()
            try:
                return verdict(copy / name, mutant, names)
            finally:
                copies.put(copy)

        def both(old: Mutant, new: Mutant) -> tuple[str, str]:
            now = pieces.piece(f"now {new}", partial(judge, "now", new))
            if now.startswith("killed"):
                return "not asked", now
            was = pieces.piece(f"before {old}", partial(judge, "before", old))
            if was.startswith("killed by tests/"):  # all lines of that test, quick ones or not
                killer = was.removeprefix("killed by ").partition("[")[0]
                now = pieces.piece(f"again {new}", partial(judge, "now", new, killer))
            return was, now

        with ThreadPoolExecutor(given.jobs) as pool:
            said = list(pool.map(both, *zip(*drawn, strict=True)))
    for (_, new), (was, now) in zip(drawn, said, strict=True):
        if was.startswith("killed") and not now.startswith("killed"):
            print(f"{was}, {now}: {new.file}: {new.line.strip()} | {new.old} -> {new.new}")
    tally = Counter((was.split()[0], now.split()[0]) for was, now in said)
    for (was, now), n in sorted(tally.items()):
        print(f"{n:5}  before {was}, now {now}")
    lost = sum(n for (was, now), n in tally.items() if (was, now) == ("killed", "survived"))
    print(f"{given.count} mutants; killed before, living now: {lost} (target: 0)")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
