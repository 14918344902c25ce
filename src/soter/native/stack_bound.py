"""Computes the most stack that a package's trusted part needs, from the compiler's figures.

Purpose: it takes the size of frames (`-fstack-usage`) and the calls (gcc: `-fcallgraph-info=su`;
clang: its assembly), and finds the costliest path of calls from the functions that a loop calls.
Non-goals: stacks of interrupts, of the caller, of the C library and of externs; it only names them.

A call through a pointer may reach any function in the program's tables. There is no bound if a
frame depends on data, if calls run in a circle, or if the compiler gives no figures.
"""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import passing_phase
from soter.diagnostics.diagnostic import SoterError
from soter.native.cache import cached_folder, digest
from soter.native.compiler import STRICT, TIMEOUT_S, Compiler, find_compiler, run_compiler

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

OPTIMISE = "-O2"
"""The optimisation of a package's Makefile, unless the user sets another."""
INDIRECT = "__indirect_call"
RETURNS_HERE = 16
"""Bytes that a call itself may take, which the figures of clang leave out."""
RED_ZONE = 128
"""Bytes below its frame that the last function of a path may use (x86-64); in no figure."""
FOUND = "stack.json"
SILENT = "this compiler tells no stack usage (gcc does, and clang for x86-64 and aarch64 of Linux)"
QUIET = frozenset(
    {"soter_check_failed", "__assert_fail", "__assert_rtn", "abort", "__stack_chk_fail"}
)
"""Functions that do not return; their stack is not counted, and they are not named."""
ROLES = "step|failsafe|effect|exchange|happens|overrun|decide|violated|publish|init|order|self_test"
TABLE = re.compile(rf"\.({ROLES}) = (\w+)")
NODE = re.compile(r'^node: \{ title: "([^"]+)" label: "([^"]*)"')
EDGE = re.compile(r'^edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
BYTES = re.compile(r"\\n(\d+) bytes \((\w+(?:,\w+)*)\)")
LABEL = re.compile(r"^([A-Za-z_][\w.$]*):")
CALL = re.compile(r"^\s+(callq?|bl|blr|jmpq?|b|br)\s+(\S+)")
READABLE = re.compile(r"^Target: (x86_64|aarch64)-\S*linux", re.MULTILINE)
"""The targets of clang whose assembly this module can read; others get no bound."""
TAIL = frozenset({"jmp", "jmpq", "b", "br"})


@dataclass
class StackGraph:
    """The frame sizes and calls of functions: `file:name`, or `name` for a global function."""

    frames: dict[str, int] = field(default_factory=dict)
    calls: dict[str, set[str]] = field(default_factory=dict)
    unbounded: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class StackBound:
    """The most stack in `bytes`, or None and `why`; `way`: the costliest path, outermost first.

    `not_counted`: called functions whose own stack has to be added.
    """

    bytes: int | None
    compiler: str = ""
    way: tuple[str, ...] = ()
    not_counted: tuple[str, ...] = ()
    why: str = ""


def stack_bound(
    files: Mapping[str, str],
    entries: str,
    left_out: Iterable[str] = (),
    cross: Compiler | None = None,
) -> StackBound:
    """The bound on the stack of C files (name -> text), from functions with prefix `entries`.

    `left_out`: functions in the tables that do not belong to the trusted part, such as steps of
    plants. `cross`: a compiler for another processor, with its flags.
    """
    try:
        compiler = cross or find_compiler()
    except SoterError as error:
        return StackBound(None, why=error.diagnostics[0].message)
    flags = (*STRICT, *(cross.flags if cross is not None else (OPTIMISE,)))
    below = 0 if cross is not None else RED_ZONE
    left = sorted(left_out)
    rules = Path(__file__).read_text(encoding="utf-8")  # the bound depends on this file, too
    texts = [x for pair in files.items() for x in pair]
    content = digest([compiler.identity, rules, entries, str(below), *left, *flags, *texts])

    def measure(work: Path) -> None:
        with passing_phase("compiling the package: how much stack it needs"):
            stack = _measure_stack(work, list(compiler.command), flags, files, entries, left, below)
        (work / FOUND).write_text(json.dumps(vars(stack)), encoding="utf-8")

    stored = json.loads(
        (cached_folder("stack", content, (FOUND,), measure) / FOUND).read_text(encoding="utf-8")
    )
    way, rest = tuple(stored["way"]), tuple(stored["not_counted"])
    return StackBound(stored["bytes"], stored["compiler"], way, rest, stored["why"])


def _measure_stack(
    work: Path,
    command: list[str],
    flags: Sequence[str],
    files: Mapping[str, str],
    entries: str,
    left_out: Sequence[str],
    below: int,
) -> StackBound:
    for name, text in files.items():
        (work / name).write_text(text, encoding="utf-8")
    sources = [name for name in files if name.endswith(".c")]
    version = run_compiler([*command, "--version"], work, TIMEOUT_S).text
    first_line = (version.splitlines() or [""])[0]
    graph: StackGraph | None = None

    def compiles(*words: str) -> bool:
        return run_compiler([*command, *flags, *words, *sources], work, TIMEOUT_S).code == 0

    if compiles("-fcallgraph-info=su", "-c"):
        graph = _read_gcc_graph(work)
    elif READABLE.search(version) is None:
        pass
    elif compiles("-fstack-usage", "-S"):
        graph = _read_clang_graph(work)
    for path in work.iterdir():
        path.unlink()
    if graph is None or not graph.frames:
        return StackBound(None, first_line, why=SILENT)
    pointed = {name for text in files.values() for _, name in TABLE.findall(text)}
    return _bound_stack(graph, first_line, entries, pointed - {"NULL", *left_out}, below)


# ---------------------------------------------------------------- what compilers say


def _read_gcc_graph(work: Path) -> StackGraph:
    """Reads the graph in gcc's `.ci` files, whose frames include the return address."""
    graph = StackGraph()
    for path in sorted(work.glob("*.ci")):
        for line in path.read_text(encoding="utf-8").splitlines():
            edge = EDGE.match(line)
            if edge is not None:
                graph.calls.setdefault(edge[1], set()).add(edge[2])
            node = NODE.match(line)
            size = BYTES.search(node[2]) if node is not None else None
            if node is None or size is None:
                continue
            graph.frames[node[1]] = int(size[1])
            if "dynamic" in size[2] and "bounded" not in size[2]:
                graph.unbounded.append(node[1])
    return graph


def _read_clang_graph(work: Path) -> StackGraph:
    """Reads the graph in clang's `.su` files (frames) and `.s` files (calls)."""
    graph = StackGraph()
    for path in sorted(work.glob("*.su")):
        file_name = path.with_suffix(".c").name
        assembly = path.with_suffix(".s").read_text(encoding="utf-8")
        open_ = set(re.findall(r"^\s+\.globl\s+(\S+)", assembly, re.MULTILINE))
        here: dict[str, str] = {}
        for line in path.read_text(encoding="utf-8").splitlines():
            place, size, kind = line.rsplit("\t", 2)
            name = place.rpartition(":")[2]
            here[name] = name if name in open_ else f"{file_name}:{name}"
            graph.frames[here[name]] = int(size) + RETURNS_HERE
            if "dynamic" in kind:
                graph.unbounded.append(here[name])
        for name, called in _calls_in_assembly(assembly, set(here)):
            graph.calls.setdefault(here[name], set()).add(here.get(called, called))
    return graph


def _calls_in_assembly(assembly: str, functions: set[str]) -> Iterable[tuple[str, str]]:
    """Yields (caller, called); ignores register jumps in functions with jump tables (`switch`)."""
    parts: dict[str, list[str]] = {}
    now = ""
    for line in assembly.splitlines():
        label = LABEL.match(line)
        if label is not None and label[1] in functions:
            now = label[1]
        elif now:
            parts.setdefault(now, []).append(line)
    for name, lines in parts.items():
        tables = any("LJTI" in line for line in lines)
        for line in lines:
            call = CALL.match(line)
            if call is None:
                continue
            target = call[2].removesuffix("@PLT")
            through = target.startswith(("*", "%")) or call[1] in {"blr", "br"}
            if through and not (tables and call[1] in TAIL):
                yield name, INDIRECT
            elif not through and not target.startswith(".L"):
                yield name, target


# ---------------------------------------------------------------- the costliest path


class _EndlessError(Exception):
    """Reports that the stack has no bound: calls form a circle, or a frame depends on data."""


def _bound_stack(
    graph: StackGraph, compiler: str, entries: str, pointed: set[str], below: int
) -> StackBound:
    by_name: dict[str, list[str]] = {}
    for title in graph.frames:
        by_name.setdefault(_plain_name(title), []).append(title)
    graph.calls[INDIRECT] = {t for name in pointed for t in by_name.get(name, [])}
    known: dict[str, tuple[int, tuple[str, ...]]] = {}
    outside: set[str] = set()

    def costliest_path(title: str, above: tuple[str, ...]) -> tuple[int, tuple[str, ...]]:
        if title in above:
            circle = " -> ".join((*above[above.index(title) :], title))
            raise _EndlessError(f"calls run in a circle: {circle}")
        if title in known:
            return known[title]
        if title != INDIRECT and title not in graph.frames:
            outside.update({title} - QUIET)
            return 0, ()
        if title in graph.unbounded:
            raise _EndlessError(f"the frame of `{_plain_name(title)}` depends on data")
        below = [costliest_path(t, (*above, title)) for t in sorted(graph.calls.get(title, ()))]
        most, way = max(below, default=(0, ()), key=lambda x: x[0])
        here = () if title == INDIRECT else (_plain_name(title),)
        known[title] = most + graph.frames.get(title, 0), (*here, *way)
        return known[title]

    starts = [t for t in graph.frames if ":" not in t and t.startswith(entries)]
    if not starts:
        return StackBound(None, compiler, why="no function of the interface was found")
    try:
        size, way = max((costliest_path(t, ()) for t in sorted(starts)), key=lambda x: x[0])
    except _EndlessError as error:
        return StackBound(None, compiler, why=str(error))
    return StackBound(size + below, compiler, way, tuple(sorted(outside)))


def _plain_name(title: str) -> str:
    """The function name in a title such as `file.c:name.isra.0`."""
    return title.rpartition(":")[2].partition(".")[0]
