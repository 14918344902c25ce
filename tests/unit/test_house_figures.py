"""The figures of the house: circles of imports, sizes, complexity, calls that nobody can read.

`python tests/unit/test_house_figures.py` lists the functions whose complexity by radon is over
`SIMPLE`, with the sizes of the core and of each add-on, and fails where one is over `WORST`.
"""

from __future__ import annotations

import ast
import configparser
import sys
from collections import Counter
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from radon.complexity import cc_visit_ast
from radon.visitors import Class

from soter.addons import ADD_ONS, add_on_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from radon.visitors import Function

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / "src"
SOURCES = sorted(p for p in (SRC / "soter").rglob("*.py") if "templates" not in p.parts)
CODE = ("src/soter", "tests", "bench", "docs/site", "examples")
"""Folders of code: Python and C."""

MODULES_IN_A_ROOM = 16
"""More files have to be judged: ROOMS."""
LINES_OF_A_FILE = 500
"""An alarm: the rule is one subject a file (test_house_rules.py)."""
LINES_OF_A_FUNCTION = 70
POSITIONAL = 7
"""Arguments without names that one call may have."""
SIMPLE, WORST = 15, 25
"""Complexity of a function that is read at once, and what none may have: ways through it."""


@cache
def tree_of(path: Path) -> ast.Module:
    """A source, parsed when somebody asks: each worker reads this file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def trees() -> dict[Path, ast.Module]:
    """Every source by its path below `src`."""
    return {p.relative_to(SRC): tree_of(p) for p in SOURCES}


def name_of(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(path: Path) -> str:
    return ".".join(path.parent.parts)


@cache
def imports() -> dict[str, set[str]]:
    """Every file by name -> the files it imports, for annotations too."""
    names = {name_of(p) for p in trees()}
    graph: dict[str, set[str]] = {}
    for path, tree in trees().items():
        modules = graph.setdefault(name_of(path), set())
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                modules |= {a.name for a in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                wholes = {f"{node.module}.{a.name}" for a in node.names}
                modules |= wholes & names or {node.module}
                modules |= {node.module} if wholes - names else set()
        modules &= names - {name_of(path)}
    return graph


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Files each of which reaches all others of its circle."""

    def reached(start: str) -> set[str]:
        seen, todo = set[str](), [start]
        while todo:
            new = graph[todo.pop()] - seen
            seen |= new
            todo += new
        return seen

    reach = {name: reached(name) for name in graph}
    components = {frozenset(m for m in reach[n] if n in reach[m]) for n in graph if n in reach[n]}
    return [set(c) for c in components]


def files() -> Iterator[Path]:
    """All Python and C of the repository, below its root; not what `soter new` copies."""
    for folder in CODE:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in {".py", ".c", ".h"} and "templates" not in path.parts:
                yield path.relative_to(ROOT)


def long_files() -> Iterator[str]:
    for path in files():
        lines = len((ROOT / path).read_text(encoding="utf-8").splitlines())
        if lines > LINES_OF_A_FILE:
            yield f"{path}: {lines}"


def long_functions() -> Iterator[str]:
    """Of Python; those of C are in test_c_figures.py."""
    for path in files():
        if path.suffix != ".py":
            continue
        known = trees().get(path.relative_to("src")) if path.parts[0] == "src" else None
        for node in ast.walk(known or ast.parse((ROOT / path).read_text(encoding="utf-8"))):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if lines > LINES_OF_A_FUNCTION:
                    yield f"{path} {node.name}: {lines}"


def long_calls() -> Iterator[str]:
    for path, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and len(node.args) > POSITIONAL:
                name = ast.unparse(node.func)
                if "lib." not in name:  # C knows no names of arguments
                    yield f"{path}:{node.lineno} {name}: {len(node.args)}"


def test_circles_are_seen() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a", "e"}, "e": {"d"}}
    assert sorted(map(sorted, circles(graph))) == [["b", "c"], ["d", "e"]]
    assert "soter.language.model.system" in imports()["soter.language.elaborate.derived_systems"]


def test_files_do_not_import_each_other_in_circles() -> None:
    assert circles(imports()) == []


def test_the_contract_of_add_ons_has_all_of_their_table() -> None:
    contracts = configparser.ConfigParser()
    contracts.read(ROOT / ".importlinter")
    contract = contracts["importlinter:contract:add_ons"]
    parts = [part for a in ADD_ONS.values() for part in a.parts]
    assert contract["protected_modules"].split() == contract["allowed_importers"].split() == parts
    assert all((SRC / p.replace(".", "/")).is_dir() or p in imports() for p in parts)


def test_an_add_on_imports_the_core_and_what_it_says_it_needs() -> None:
    used: dict[str, set[str]] = {name: set() for name in ADD_ONS}
    for module, others in imports().items():
        if name := add_on_of(module):
            used[name] |= {o for m in others if (o := add_on_of(m)) not in {None, name}}
    assert used == {name: set(a.needs) for name, a in ADD_ONS.items()}


ROOMS = {
    "src/soter/cli": (18, "a file a command, found by its name"),
    "src/soter/targets": (18, "a file a target, found by its name, and what targets share"),
    "src/soter/runtime/posix": (
        25,
        "three programs over two channels; all of it ships as one folder",
    ),
    "src/soter/codegen": (18, "one tree of C; a file a kind of function that is generated"),
    "src/soter/verify/engine": (
        23,
        "one engine over one set of headers; a reader enters by soter_reach.h",
    ),
    "src/soter/explore/engine/c": (
        35,
        "a file a strategy, a header a thing shared; no circles in it",
    ),
    "tests/generators": (74, "each makes one kind of input; nobody reads two of them at once"),
    "tests/correct": (107, "a file a promise of the pages, found by its name"),
    "bench/ros": (19, "two versions of ROS and DDS share nodes and tables: kills.py, bad_input.py"),
    "tests/unit": (17, "what concerns the whole house, each named after what it holds"),
    "tests/unit/semantics": (18, "a file a room of src or a question to it, found by its name"),
    "tests/unit/report": (21, "as above"),
    "tests/unit/simulate": (18, "as above"),
    "tests/unit/language": (21, "as above"),
    "tests/unit/verify/claims": (18, "a file a claim or a choice, found by its name"),
    "tests/unit/certificate": (65, "as above; and what single functions promise, by kind"),
    "src/soter/verify/tubes": (
        18,
        "one subject each, along the proof",
    ),
    "tests/unit/verify/tubes": (30, "as above, what enumerates small systems, maps, fits, plans"),
    "tests/unit/cli": (41, "as above: a file a command"),
    "tests/unit/monitor": (19, "as above: a file a format, and what a log may lie about"),
    "tests/unit/explore": (36, "as above; the engine's strategies are asked one by one"),
}
"""Rooms with more files than anybody can keep in mind: how many they may have, and why.

A room that grows beyond is judged anew, here: is it one thing that is entered by one door, or is it
two? A number is no reason, and one that fell is written down, so that it stays there.
"""


def crowded() -> dict[str, int]:
    """Rooms with more than MODULES_IN_A_ROOM files -> how many they have."""
    sizes = Counter(str(p.parent) for p in files() if p.name != "__init__.py")
    return {room: n for room, n in sizes.items() if n > MODULES_IN_A_ROOM}


def test_a_crowded_room_was_judged_as_it_is() -> None:
    assert crowded() == {room: n for room, (n, _) in ROOMS.items()}


def test_a_call_names_its_arguments_where_they_are_many() -> None:
    assert list(long_calls()) == []


REASONS = {
    "src/soter/language/model/typed.py": "the checked tree, records only",
    "src/soter/language/model/system.py": "the flat system, records only",
    "src/soter/language/syntax/tree.py": "the tree, records only",
    "src/soter/language/syntax/parsing/token_cursor.py": "a cursor and its recovery",
    "src/soter/runtime/soter.h": "one header is what a user of the kernel includes",
    "src/soter/verify/engine/soter_form.h": "arithmetic, inlined; cut by kinds already",
    "src/soter/verify/engine/soter_reach_linear.c": "one solution formula, and its matrices",
    "src/soter/explore/engine/c/soter_explore_internal.h": "what the engine's files share",
    "src/soter/explore/engine/c/soter_explore_bfs.c": "one search; threads keep its one state",
    "src/soter/explore/engine/c/soter_explore_independent_groups.c": "one table, and who fills it",
    "src/soter/explore/engine/c/soter_explore_step.c": "what a move does, rule by rule",
    "src/soter/explore/engine/c/soter_explore_store.c": "one table; its functions are inlined",
    "bench/made_again_sections.py": "a row a section of the pages",
    "bench/verify/soundness.py": "adversaries over one simulation, a claim each",
    "tests/generators/random_programs.py": "one grammar, at random",
    "tests/generators/random_expressions.py": "the same, of expressions",
    "tests/generators/brute_force.py": "the enumerator, read beside docs/testing.md",
    **dict.fromkeys(
        (
            "tests/correct/test_faults_agree.py",
            "tests/correct/test_real_logs.py",
            "tests/unit/cli/test_cli_apart.py",
            "tests/unit/cli/test_cli_test.py",
            "tests/unit/gym/test_protected.py",
            "tests/unit/verify/induction/test_induction.py",
            "tests/unit/certificate/test_local_chains.py",
        ),
        "tests of one thing, one after the other: nobody has to read them whole",
    ),
}
"""Files that are longer, and why."""

LONG = {
    "tests/generators/induction_planners.py planner": "the text of a program with a few holes",
    "bench/adversary/topics_apart.py drawn": "the text of a program with a few holes",
    "bench/hostile/bad_input_samples.py formats": "a list of inputs",
    "examples/drone/demo.py main": "what it shows, in order",
    "examples/drone/figures.py figure_12c": "one picture",
}
"""Functions of Python that are longer, and why."""


BUDGET = ROOT / "tests" / "unit" / "house_budget.toml"
SPARE = 0.02
"""Of a figure: what fell by more is written down, so that it stays there."""
WRITTEN = {".py", ".c", ".h", ".hpp", ".js", ".css", ".html", ".j2", ".in", ".soter", ".toml"}


def sizes() -> dict[str, dict[str, int]]:
    """Of each room: statements and lines of Python, and lines of all that is written by hand."""
    found: dict[str, dict[str, int]] = {}
    for path in sorted((SRC / "soter").rglob("*")):
        parts = path.relative_to(SRC / "soter").parts
        if path.suffix not in WRITTEN or "__pycache__" in parts:
            continue
        room = found.setdefault(
            parts[0] if len(parts) > 1 else "soter", {"statements": 0, "lines": 0, "all": 0}
        )
        text = path.read_text(encoding="utf-8")
        room["all"] += len(text.splitlines())
        if path.suffix == ".py" and (tree := trees().get(path.relative_to(SRC))):
            room["lines"] += len(text.splitlines())
            room["statements"] += sum(isinstance(n, ast.stmt) for n in ast.walk(tree))
    return found


def functions_in(blocks: Iterable[Class | Function]) -> Iterator[Function]:
    """The functions of a file as radon sees them, those of classes and of functions among them."""
    for block in blocks:
        if isinstance(block, Class):
            yield from functions_in([*block.methods, *block.inner_classes])
        else:
            yield block
            yield from functions_in(block.closures)


@cache
def complex_functions() -> list[tuple[int, str]]:
    """Each function over `SIMPLE`: its complexity and where it is, the worst first."""
    found = {
        (f.complexity, f"{path}:{f.lineno} {f.name}")
        for path, tree in trees().items()
        for f in functions_in(cc_visit_ast(tree))
        if f.complexity > SIMPLE
    }
    return sorted(found, reverse=True)


def sums() -> dict[str, dict[str, int]]:
    """Figures of many rooms, as the budget has them: the core, each add-on, complex functions."""
    parts = ("core_rooms", *(f"add_on_{name}" for name in ADD_ONS))
    sums: dict[str, dict[str, int]] = {p: {"statements": 0, "lines": 0} for p in parts}
    for path, tree in trees().items():
        add_on = add_on_of(name_of(path))
        of = sums[f"add_on_{add_on}" if add_on else "core_rooms"]
        of["statements"] += sum(isinstance(n, ast.stmt) for n in ast.walk(tree))
        of["lines"] += len((SRC / path).read_text(encoding="utf-8").splitlines())
    return {**sums, "complexity": {"functions_over": len(complex_functions())}}


def over_or_under(budget: dict[str, dict[str, int]], rooms: dict[str, dict[str, int]]) -> list[str]:
    """Figures that are above the budget, or so far below that the budget says nothing."""
    told = []
    for room, figures in rooms.items():
        for what, n in figures.items():
            most = budget.get(room, {}).get(what, 0)
            if not most * (1 - SPARE) - 10 <= n <= most:
                told.append(f"{room}: {what} {n:,}, budget {most:,}")
    return told + [f"{room}: is no room" for room in sorted(set(budget) - set(rooms))]


def test_every_room_keeps_to_its_budget() -> None:
    toml = import_module("tomllib" if find_spec("tomllib") else "tomli")
    budget = toml.loads(BUDGET.read_text(encoding="utf-8"))
    assert over_or_under(budget, sizes() | sums()) == []


def test_a_function_of_many_ways_is_found() -> None:
    ways = "\n".join(f"  if x == {k}: return {k}" for k in range(SIMPLE))
    tree = ast.parse(f"class A:\n def f(self, x):\n{ways}")
    assert {f.complexity for f in functions_in(cc_visit_ast(tree))} == {SIMPLE + 1}


def test_a_budget_that_is_passed_or_far_too_large_is_told() -> None:
    room = {"core": {"statements": 1_000}}
    assert over_or_under({"core": {"statements": 1_000}}, room) == []
    assert over_or_under({"core": {"statements": 999}}, room) == [
        "core: statements 1,000, budget 999"
    ]
    assert over_or_under({"core": {"statements": 1_100}}, room) != []
    assert over_or_under({"core": {"statements": 1_000}, "attic": {}}, room) == [
        "attic: is no room"
    ]


def test_a_file_is_short_or_says_why_not() -> None:
    assert {x.partition(":")[0] for x in long_files()} == set(REASONS)


def test_a_function_fits_on_a_page_or_says_why_not() -> None:
    assert {x.partition(":")[0] for x in long_functions()} == set(LONG)


def main() -> int:
    """Print what is over a figure; 1 where a function is over `WORST`."""
    for ways, place in complex_functions():
        print(f"{ways:3} {place}")
    for name, figures in sums().items():
        print(name, ", ".join(f"{n:,} {what}" for what, n in figures.items()))
    worst = [place for ways, place in complex_functions() if ways > WORST]
    print(f"{len(worst)} functions over {WORST}")
    return int(bool(worst))


if __name__ == "__main__":
    sys.exit(main())
