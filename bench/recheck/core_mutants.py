"""Mutants of what has to be read to believe ACCEPTED, and which tests kill them.

    .venv/bin/python bench/recheck/core_mutants.py [--count 200] [--seed 1] [--keep FOLDER]

Purpose: mutants of the files that docs/recheck.md lists (steps 1 to 9), drawn by seed: comparisons,
signs, `min` and `max`, ends of balls, 0 and 1, `and`, `or`, `not`, `any` and `all`, conditions that
always or never hold, refusals left out, verdicts that are always the same. Each is imported in a
process of its own in place of the file. It is killed where something else is said of a right
certificate (what is claimed, times, assumptions), where a forged one is accepted that is rejected,
or where one of the quick tests of its folder fails. Certificates are made once, without a
mutant. What changes no verdict stands in `core_mutants_harmless.txt`, each with its reason, and is
counted apart. What is done is written to `--keep`. Exit code 1 where fewer than 95 % are killed.
Non-goals: mutants of the whole tool; long tests.
"""

from __future__ import annotations

import argparse
import ast
import functools
import importlib
import importlib.machinery
import json
import os
import random
import re
import resource
import signal
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(p) for p in (ROOT, ROOT / "tests") if str(p) not in sys.path]

from bench.pieces import Pieces  # noqa: E402 - needs the path

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import TypeGuard

    Change = tuple[int, str, Callable[[], None]]
    """Of a tree: in which line, in words, and what makes it."""

ROOM = ROOT / "src" / "soter" / "certificate"
TESTS = ROOT / "tests" / "unit" / "certificate"
HARMLESS = Path(__file__).with_name("core_mutants_harmless.txt")
CPU_S, CLOCK_S = 180, 1800
"""For the tests of a mutant; longer is a kill, counted apart."""
TARGET = 0.95
FIRST = ("numpy", "flint", "z3", "pytest", "hypothesis.strategies", "soter.language.front_end",
         "soter.cli.main")  # fmt: skip
"""Imported before any mutant: they know nothing of the room."""
RIGHT = ("written", "computed", "flying", "shielded", "composed")
"""Programs of `forged_programs.py` whose certificates a mutant has to accept as they are."""
KINDS = ("sets", "times", "inputs", "program of another", "overlooked", "sets of another",
         "claims", "exchanged", "facts", "verdicts")  # fmt: skip
FORGED = 15
"""Forgeries: those that are rejected have to be rejected by a mutant, too."""
OF_TIMES = (
    "times_by_enumeration",
    "what_is_let_through",
    "problem_by_definition",
    "times",
    "ways",
    "nodes_that_take_time",
    "one_instant",
    "refused_times",
)
OF_CELLS = (
    "cells_by_enumeration",
    "certain_cells",
    "recheck_walks",
)
TESTED_BY = {
    "reading/derived_times.py": OF_TIMES,
    "reading/module_times.py": OF_TIMES,
    "cell_sets.py": OF_CELLS,
    "cell_predicates.py": OF_CELLS,
    "reading/folder.py": (
        "format_by_definition",
        "program_of_a_certificate",
        "hostile_certificates",
        "certificates",
    ),
    "terms": (
        "reading_by_evaluation",
        "operators_of_terms",
        "lines_over_functions",
        "terms_by_points",
        "truths_of_terms",
        "operations",
        "recheck_enclosures",
        "beyond_doubles",
    ),
    "grid": (
        "claims_on_grids",
        "walks_by_cells",
        "forms_by_corners",
        "flows_by_solutions",
        "groups_on_grids",
        "windows_and_shields",
        "ranks",
        "recheck_walks",
        "local_chains",
        "deployed_tables",
    ),
    "reading": (
        "reading_by_evaluation",
        "operators_of_terms",
        "problem_by_definition",
        "refused_times",
        "linear_flows_by_formula",
        "what_is_let_through",
        "recheck_enclosures",
        "ways",
        "local_chains",
        "what_plants_publish",
    ),
    ".": (
        "entries_of_a_manifest",
        "what_a_case_asks",
        "what_is_let_through",
        "problem_by_definition",
        "recheck_progress",
        "claims_without_tables",
        "certificates",
        "ways",
    ),
}
"""By file, or else by folder, the files of quick tests that judge mutants, in this order."""
OF_ALL = ("at_the_bounds", "terms_at_the_bounds", "single_refusals", "single_facts")
"""Files of tests of single functions, in seconds: they come first."""
OTHERS: dict[type[ast.AST], tuple[type[ast.AST], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt), ast.LtE: (ast.Lt, ast.GtE), ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,), ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.And: (ast.Or,),
    ast.Or: (ast.And,),
}  # fmt: skip
PAIRS = ("min max", "any all", "lower upper", "below above", "larger smaller", "floor ceil")
NAMES = {a: b for p in PAIRS for a, b in (p.split(), p.split()[::-1])}
REFUSALS = ("RejectedError", "NotRecheckedError", "DiffersError", "NotCertainError")


@dataclass(frozen=True)
class Mutant:
    """The change of that number of a file."""

    file: str
    number: int
    line: int
    what: str


def core() -> list[str]:
    """The files of the reading list, below `certificate/`."""
    text = (ROOT / "docs" / "recheck.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| \d+ \|.*$", text, re.MULTILINE)
    return [name for row in rows for name in re.findall(r"`([\w/]+\.py)`", row)]


def within(tree: ast.AST) -> Iterator[ast.AST]:
    """A tree without annotations, imports for types, messages of refusals and texts."""
    yield tree
    for name, value in ast.iter_fields(tree):
        for child in value if isinstance(value, list) else [value]:
            left_out = name in ("annotation", "returns", "decorator_list", "exc")
            typing = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
            text = isinstance(child, ast.JoinedStr)
            if isinstance(child, ast.AST) and not (left_out or typing or text):
                yield from within(child)


def changes(tree: ast.AST) -> Iterator[Change]:
    """Every change that makes a mutant, always in the same order."""
    for node in within(tree):
        line = getattr(node, "lineno", 0)
        for field, new, words in _fields(node):
            yield line, words, functools.partial(setattr, node, field, new)
        for body in filter(_a_list, (getattr(node, f, None) for f in ("body", "orelse"))):
            for k, inner in enumerate(body):
                if isinstance(inner, ast.Raise) and _refuses(inner):
                    change = functools.partial(body.__setitem__, k, ast.Pass())
                    yield inner.lineno, "refusal left out", change


def _fields(node: ast.AST) -> Iterator[tuple[str, Any, str]]:
    """Fields of a node with another value, and that in words."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for new in OTHERS.get(type(node.ops[0]), ()):
            yield "ops", [new()], f"comparison {new.__name__}"
    elif isinstance(node, (ast.BinOp, ast.BoolOp)):
        for new in OTHERS.get(type(node.op), ()):
            yield "op", new(), f"operator {new.__name__}"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield "operand", ast.UnaryOp(ast.Not(), node.operand), "not left out"
    elif isinstance(node, ast.Name) and node.id in NAMES:
        yield "id", NAMES[node.id], f"name {NAMES[node.id]}"
    elif isinstance(node, ast.Attribute) and node.attr in NAMES:
        yield "attr", NAMES[node.attr], f"name {NAMES[node.attr]}"
    elif (
        isinstance(node, ast.Constant) and type(node.value) in (int, bool) and node.value in (0, 1)
    ):
        other: object = not node.value if isinstance(node.value, bool) else int(not node.value)
        yield "value", other, f"constant {other}"
    elif isinstance(node, (ast.If, ast.IfExp)):
        for value in (True, False):
            yield "test", ast.Constant(value), f"condition {value}"
    elif isinstance(node, ast.FunctionDef) and getattr(node.returns, "id", "") == "bool":
        for value in (True, False):
            yield "body", [ast.Return(ast.Constant(value))], f"verdict {value}"


def _a_list(body: object) -> TypeGuard[list[ast.stmt]]:
    return isinstance(body, list)


def _refuses(node: ast.Raise) -> bool:
    return getattr(getattr(node.exc, "func", node.exc), "id", "") in REFUSALS


def mutants(file: str) -> list[Mutant]:
    """Every mutant of a file of the room."""
    text = (ROOM / file).read_text(encoding="utf-8")
    lines = text.splitlines()
    found: list[Mutant] = []
    seen: Counter[str] = Counter()
    for k, (at, words, _) in enumerate(changes(ast.parse(text))):
        what = f"{words}: {lines[at - 1].strip()}"
        seen[what] += 1
        again = f" ({seen[what]})" if seen[what] > 1 else ""
        found.append(Mutant(file, k, at, what + again))
    return found


class Mutated(importlib.machinery.SourceFileLoader):
    """Loads a module of the room, from a mutant where one is set."""

    mutant: Mutant | None = None

    def get_code(self, fullname: str) -> Any:  # noqa: ANN401 - code
        """Of the file, or of its mutant."""
        m = type(self).mutant
        if m is None or Path(self.path) != ROOM / m.file:
            return super().get_code(fullname)
        tree = ast.parse(Path(self.path).read_text(encoding="utf-8"))
        list(changes(tree))[m.number][2]()
        return compile(ast.fix_missing_locations(tree), self.path, "exec")


def of_room(path: str) -> importlib.machinery.FileFinder:
    """What finds the modules of the room, as an entry of `sys.path_hooks`."""
    if not Path(path).is_relative_to(ROOM):
        raise ImportError
    return importlib.machinery.FileFinder(path, (Mutated, importlib.machinery.SOURCE_SUFFIXES))


# ---------------------------------------------------------------- certificates, made once


def made(folder: Path) -> int:
    """Certificates of `verify`, and forgeries of them that are rejected, with what is said; 0."""
    forgeries = importlib.import_module("bench.recheck.forgeries")
    bases = {n: forgeries.base_of(n) for n in RIGHT}
    for name, base in bases.items():
        base.write(folder / name)
    for k in range(FORGED):
        kind, family = KINDS[k % len(KINDS)], ("grid", "composed")[k % 5 == 0]
        forgeries.forge(bases, family, kind, k, folder / f"forged{k:02d}")
    said = {p.name: _said(p) for p in sorted(folder.iterdir())}
    said = {n: o for n, o in said.items() if n in RIGHT or o[0] == "rejected"}
    assert all(said[n][0] == "accepted" for n in RIGHT), said
    (folder / "said").write_text(json.dumps(said))
    return 0


def _said(folder: Path) -> list[Any]:
    """The verdict, and of what is accepted all claims, times and assumptions."""
    recheck = importlib.import_module("soter.certificate.rechecker").recheck
    report = recheck(folder, workers=1)
    if not report.accepted:
        return [report.verdict]
    modules = [[m.name, m.confirmed, m.claims, m.times, m.parameters] for m in report.modules]
    return [report.verdict, report.assumptions, json.loads(json.dumps(modules))]


def _differ(folder: Path) -> str:
    """The first certificate of which something else is said than without a mutant, and what."""
    for name, wanted in json.loads((folder / "said").read_text()).items():
        said = _said(folder / name)
        if said != wanted:
            return f"{name}: {said[0]}"
    return ""


# ---------------------------------------------------------------- judging


def judges(file: str) -> list[str]:
    """The files of tests that judge the mutants of a file."""
    tests = TESTED_BY.get(file) or TESTED_BY[str(Path(file).parent)]
    return [str(TESTS / f"test_{n}.py") for n in (*OF_ALL, *tests)]


def in_child(work: Callable[[], int], mutant: Mutant | None = None) -> tuple[int, str]:
    """Exit code and what is printed of a process that loads the room with a mutant."""
    with tempfile.NamedTemporaryFile() as out:
        child = os.fork()
        if child == 0:
            _here(work, mutant, out.name)
        status = os.waitpid(child, 0)[1]
        return os.waitstatus_to_exitcode(status), Path(out.name).read_text(errors="replace")


def _here(work: Callable[[], int], mutant: Mutant | None, out: str) -> None:
    code = 70
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
        signal.alarm(CLOCK_S)
        file = os.open(out, os.O_WRONLY)
        os.dup2(file, 1)
        os.dup2(file, 2)
        os.chdir(ROOT)
        Mutated.mutant = mutant
        sys.path_hooks.insert(0, of_room)
        code = work()
        sys.stdout.flush()
    except Exception as error:  # noqa: BLE001 - whatever a mutant raises
        print(f"raised {type(error).__name__}: {error}", flush=True)
    finally:
        os._exit(code)


def of_certificates(folder: Path) -> int:
    """Whether something else is said of the certificates, printed and as an exit code."""
    difference = _differ(folder)
    print(difference)
    return 1 if difference else 0


def of_tests(tests: list[str]) -> int:
    """The exit code of quick tests."""
    options = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--tb=no", "--assert=plain"]
    return int(importlib.import_module("pytest").main([*options, *tests]))


def verdict(mutant: Mutant, folder: Path) -> str:
    """By what it is killed: a certificate, a test, the clock; or "survived"."""
    code, text = in_child(lambda: of_certificates(folder), mutant)
    tests = judges(mutant.file)
    if code == 0:
        code, text = in_child(lambda: of_tests(tests), mutant)
        failed = re.findall(r"^(?:FAILED|ERROR) (\S*\.py)(\S*)", text, re.MULTILINE)
        if failed and in_child(lambda: of_tests([failed[0][0]]))[0] != 0:
            return "not judged: the test fails without it"
        text = "".join(failed[0]) if failed else text
    if code == 0:
        return "survived"
    return "too long" if code < 0 else text.strip().splitlines()[-1] if text.strip() else "no word"


def harmless() -> dict[str, str]:
    """Mutants that change no verdict, as they are printed, each with the reason."""
    lines = HARMLESS.read_text(encoding="utf-8").splitlines()
    pairs = [x.rsplit(" :: ", 1) for x in lines if x and not x.startswith("#")]
    return {key.strip(): reason.strip() for key, reason in pairs}


def main() -> int:
    """Judge, and print the table and what survived."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="a folder: what is done, and certificates")
    given = parser.parse_args()
    sys.dont_write_bytecode, sys.pycache_prefix = False, str(ROOT / "build" / "bytecode")
    for name in FIRST:
        importlib.import_module(name)
    every = [m for file in core() for m in mutants(file)]
    of = len(every)
    random.Random(given.seed).shuffle(every)  # noqa: S311 - no secret
    told: dict[Mutant, str] = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder: Path = given.keep or Path(temporary)
        (folder / "certificates").mkdir(parents=True, exist_ok=True)
        pieces = Pieces(folder / "done", "core")
        if not (folder / "certificates" / "said").exists():
            code, text = in_child(lambda: made(folder / "certificates"))
            assert code == 0, text
        for m in every[: given.count]:
            said = functools.partial(verdict, m, folder / "certificates")
            told[m] = pieces.piece(f"{m.file}:{m.line} {m.number} {m.what}", said)
    return _tell(told, harmless(), of)


def _tell(told: dict[Mutant, str], known: dict[str, str], of: int) -> int:
    lived = [m for m, said in told.items() if said.startswith("survived")]
    apart = [m for m in lived if f"{m.file} {m.what}" in known]
    print(f"{'kind':<12}{'mutants':>9}{'killed':>8}{'harmless':>10}{'survived':>10}")
    for kind, n in sorted(Counter(m.what.split()[0] for m in told).items()):
        own = [m for m in lived if m.what.startswith(kind)]
        same = sum(m in apart for m in own)
        print(f"{kind:<12}{n:>9}{n - len(own):>8}{same:>10}{len(own) - same:>10}")
    for m in lived:
        if m not in apart:
            print(f"  {m.file} {m.what}")
    long = sum(said.startswith("too long") for said in told.values())
    print(f"{len(told)} of {of:,} mutants, {len(apart)} harmless; {long} ended by the clock")
    judged, killed = len(told) - len(apart), len(told) - len(lived)
    print(f"{killed} of {judged} killed: {killed / judged:.1%}, target: {TARGET:.0%}")
    return 0 if killed >= TARGET * judged else 1


if __name__ == "__main__":
    sys.exit(main())
