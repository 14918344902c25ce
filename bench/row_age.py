"""How old each row of docs/benchmarks.md is, in commits of what it is about.

    .venv/bin/python bench/row_age.py     a line a row, the oldest first

Purpose: what a row is about is derived from its command: the rooms of src/soter from which its
program imports, and what of bench/, tests/ and examples/ it imports or names. `api` and `cli` are
doors: in their place stands what the methods and commands import whose names the program has. What
loads the kernel is about `runtime`, too. The age of a row is the number of commits, merges aside,
that changed any of these since the one that it names, or since that of a shorter run in its note
(`PART`). Pages may not cite a row older than `MOST`.
Non-goals: whether its figures would come out (bench/made_again.py); rooms behind those that it
enters, which are nearly all of src for every row.
"""

from __future__ import annotations

import ast
import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from bench.run_all import CITED, results  # noqa: E402 - needs the path
from bench.run_all import file_of as output_of  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bench.run_all import Result

SRC = ROOT / "src"
SOTER, EXAMPLES = SRC / "soter", ROOT / "examples"
PROGRAM = SOTER / "api" / "program.py"
KERNEL = "soter.native.shared_library"
MOST = 150
"""Commits of what it is about after which a row is too old to be cited: some two issues' work."""
LONGEST_NAME = 80
STILL = re.compile(r"^\*\*Not made again\.\*\* .+ \*\*Still holds:\*\* .+", re.MULTILINE)
"""A note of a row whose peer cannot be had: what is missing, and why its figures hold."""
PART = re.compile(r"^\*\*Made again in part\.\*\* `[^`]+`, after ([0-9a-f]{8}): .+", re.MULTILINE)
"""A note of a row that takes hours: arguments of a shorter run, its commit, what came out."""


@cache
def tree(path: Path) -> ast.Module:
    """A file of Python."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def file_of(module: str) -> Path | None:
    """The file of a module of src, bench, tests or an example."""
    for base in (SRC, ROOT, ROOT / "tests", *sorted(EXAMPLES.iterdir())):
        path = base.joinpath(*module.split("."))
        for file in (path.with_suffix(".py"), path / "__init__.py"):
            if file.is_file():
                return file
    return None


@cache
def facts(inside: ast.AST) -> tuple[frozenset[str], frozenset[str]]:
    """Modules that a piece of code imports, unless for annotations alone; its attributes, texts.

    An attribute has its dot.
    """
    modules, words, todo = set[str](), set[str](), [inside]
    while todo:
        node = todo.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        todo += ast.iter_child_nodes(node)
        if isinstance(node, ast.Import):
            modules |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            wholes = {f"{node.module}.{a.name}" for a in node.names}
            modules |= {w for w in wholes if file_of(w)} or {node.module}
        elif isinstance(node, ast.Attribute):
            words.add(f".{node.attr}")
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            words.add(node.value)
    return frozenset(modules | {w for w in words if w.startswith("soter.")}), frozenset(words)


@cache
def doors() -> dict[str, ast.AST]:
    """Methods of `Program` as `.name`, commands as `name`."""
    methods = {f".{n.name}": n for n in ast.walk(tree(PROGRAM)) if isinstance(n, ast.FunctionDef)}
    cli = (path for room in ("cli", "cli/tool") for path in (SOTER / room).glob("[a-z]*.py"))
    return {**methods, **{path.stem: tree(path) for path in cli}}


@cache
def loads_kernel(module: str) -> bool:
    """Whether a module of src imports what loads the kernel; a package, whether a file of it."""
    path = file_of(module) if module.startswith("soter.") else None
    if path is None:
        return False
    files = path.parent.glob("*.py") if path.name == "__init__.py" else [path]
    told = f"from {KERNEL} import"
    return module == KERNEL or any(told in f.read_text(encoding="utf-8") for f in files)


def behind(asked: Iterable[str]) -> set[str]:
    """Modules that are imported behind doors of these names, and behind those that they open."""
    todo, seen, found = list(asked), set[str](), set[str]()
    while todo:
        name = todo.pop()
        file = file_of(name) if name.startswith("soter.api.") else None
        piece = tree(file) if file and file != PROGRAM else doors().get(name)
        if name in seen or piece is None:
            continue
        seen.add(name)
        modules, words = facts(piece)
        found |= modules
        todo += [*modules, *(w for w in words if w.startswith("."))]
    return found


@cache
def about(command: str) -> frozenset[str]:
    """Paths below the root of what the figures of a command (without `python`) are about.

    A program that names no room is about all of src.
    """
    given = shlex.split(command)
    todo = [ROOT / x for x in given if x.endswith(".py")]
    files, said, modules = set[Path](), set(given), set[str]()
    while todo:
        files.add(path := todo.pop())
        imports, words = facts(tree(path))
        said |= words
        for module in imports:
            file = file_of(module)
            if module.split(".")[0] == "soter":
                modules.add(module)
            elif file and file not in files and file.name != "__init__.py":
                todo.append(file)
    modules |= behind([*modules, *said])
    found = {m.split(".")[1] for m in modules if m.startswith("soter.")} - {"api", "cli"}
    found |= {"runtime"} if any(map(loads_kernel, modules)) else set()
    named = [f"src/soter/{r}" for r in found if (SOTER / r).is_dir()] or ["src"]
    parts = {part for s in said if len(s) < LONGEST_NAME for part in s.split("/")}
    return frozenset(
        named
        + [f"examples/{e.name}" for e in EXAMPLES.iterdir() if e.name in parts]
        + [str(f.relative_to(ROOT)) for f in files]
    )


def git(*arguments: str) -> str | None:
    """What git prints; None where it fails."""
    done = subprocess.run(
        ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return done.stdout.strip() if done.returncode == 0 else None


def whole_history() -> bool:
    """Whether commits can be counted here: not in an archive, nor in a shallow clone."""
    return git("rev-parse", "--is-shallow-repository") == "false"


@cache
def age(command: str, commit: str) -> int:
    """Commits since that one which changed what the command's figures are about.

    Raises ValueError where HEAD does not stand on it.
    """
    if git("merge-base", "--is-ancestor", commit, "HEAD") is None:
        raise ValueError(f"{commit}: HEAD does not stand on it")
    paths = sorted(about(command.removeprefix("python ")))
    words = ("rev-list", "--count", "--no-merges", f"{commit}..HEAD", "--", *paths)
    return int(git(*words) or "0")


def latest(r: Result) -> str:
    """The commit after which a row was made again last, whole or in part."""
    commits: list[str] = [r.commit, *PART.findall(r.text)]
    return min(commits, key=lambda c: age(r.command, c))


def too_old(text: str) -> list[str]:
    """What a page cites by a link with a date, and may not: each row with its age."""
    asked = set(CITED.findall(text))
    kept = {output_of(name).name: r for name, r in results().items()}
    ages = {file: age(r.command, latest(r)) for file, r in kept.items() if file in asked}
    return [
        f"{file}: {old} commits of {', '.join(rooms(kept[file].command))}"
        for file, old in sorted(ages.items())
        if old > MOST and not STILL.search(kept[file].text)
    ]


def rooms(command: str) -> list[str]:
    """The names of the rooms of src that a command is about."""
    paths = about(command.removeprefix("python "))
    return sorted(p.removeprefix("src/soter/") for p in paths if p.startswith("src/"))


def main() -> int:
    """A line a row, the oldest first; 1 where one is too old and does not say why it holds."""
    if not whole_history():
        print("commits can be counted in a clone with its whole history only")
        return 4
    kept = results()
    ages = {name: age(r.command, latest(r)) for name, r in kept.items()}
    for name, old in sorted(ages.items(), key=lambda x: -x[1]):
        print(f"{old:5}  {name}: {', '.join(rooms(kept[name].command))}")
    parts = [name for name, r in kept.items() if PART.search(r.text)]
    late = [name for name, old in ages.items() if old > MOST and not STILL.search(kept[name].text)]
    print(f"made again in part, by a shorter run: {len(parts)}: {'; '.join(parts)}")
    print(f"{len(late)} of {len(ages)} rows are older than {MOST} commits of what they are about")
    return 1 if late else 0


if __name__ == "__main__":
    sys.exit(main())
