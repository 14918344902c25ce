"""Warns if a file that an extern is bound to lacks the code that the binding names.

Purpose: `binding_warnings` gives warnings (W007) for `soter check` by reading the files' text:
nothing is run or compiled. `action_warnings` warns (W037) of policies whose answers may leave the
sets of their topics.
Non-goals: refusing; `callables.py` does that when a program runs.
"""

from __future__ import annotations

import ast
import re
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, cast

from soter.diagnostics.diagnostic import Diagnostic, Label, Severity, SoterError
from soter.language.load.named_files import binding_of, read_bytes
from soter.language.model.types import IntType, leaves

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from soter.diagnostics.diagnostic import Span
    from soter.language.load.named_files import BindingText
    from soter.language.model.system import Component, System
    from soter.language.model.typed import NodeSymbol, TypedProgram

STEP_FAULT = (
    "an answer beyond the set is a step fault: nothing is published, in a module SC takes over"
)
COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)


def binding_warnings(program: TypedProgram, bound: Mapping[str, object]) -> tuple[Diagnostic, ...]:
    """The warnings W007 for externs without code; targets in `bound` replace declared bindings."""
    warnings: list[Diagnostic] = []
    others = {name.rpartition(".")[2] for name in bound}
    for name, source, span in _declared_sources(program):
        if name.rpartition(".")[2] not in others:
            warnings += _missing_code_warning(name, source, Label(span, "declared here"))
    for name, target in bound.items():
        if isinstance(target, str):
            warnings += _missing_code_warning(name, target, None)
    return tuple(warnings)


def action_warnings(
    systems: Iterable[System], bound: Mapping[str, object]
) -> tuple[Diagnostic, ...]:
    """W037 for policies whose actions may leave a topic's set; W007 for unreadable policies."""
    found: dict[Diagnostic, None] = {}
    for system in systems:
        for x in system.components:
            if not x.extern or x.node is None:
                continue
            names = (x.name, x.name.rpartition(".")[2], x.node.name)
            text = next((bound[n] for n in names if n in bound), x.binding)
            binding = binding_of(text) if isinstance(text, str) else None
            if binding is not None and binding.kind == "sb3" and not _why_code_is_missing(binding):
                found |= dict.fromkeys(_wide_action_warning(system, x, x.node, binding))
    return tuple(found)


def _wide_action_warning(
    system: System, component: Component, node: NodeSymbol, binding: BindingText
) -> Iterator[Diagnostic]:
    from soter.native.extern_bindings import policy_files  # noqa: PLC0415 - only then
    from soter.simulate.externs.python_extern import node_answers  # noqa: PLC0415 - needs NumPy

    try:
        actions = iter(policy_files().action_bounds(binding))
    except SoterError as error:
        where, helps = Label(node.span, "declared here"), error.diagnostics[0].helps
        why = f"extern `{node.name}` has no code: {error.diagnostics[0].message}"
        yield Diagnostic("W007", why, where, helps=helps, severity=Severity.WARNING)
        return
    for answer in node_answers(system, component):
        sets = zip(leaves(answer.type), answer.bounds, strict=True)
        for ((_, t), bound), (low, high) in zip(sets, actions, strict=False):
            least, most = (t.low, t.high) if isinstance(t, IntType) else (-inf, inf)
            if bound is not None:
                least, most = bound.low, bound.high
            if low < least or high > most:
                yield Diagnostic(
                    "W037",
                    f"`{node.name}` may answer all of [{low}, {high}], the action space of "
                    f"`{binding.file}`, and `{answer.name}` takes [{least}, {most}]",
                    Label(node.span, "declared here"),
                    notes=(STEP_FAULT,),
                    helps=("widen the set, or clamp or scale in a node behind this one",),
                    severity=Severity.WARNING,
                )
                return


def _declared_sources(program: TypedProgram) -> Iterator[tuple[str, str, Span]]:
    for table in (program.nodes, program.plants, program.funs):
        for symbol in cast("Mapping[str, NodeSymbol]", table).values():  # plants, funs: as nodes
            if symbol.extern and symbol.source is not None:
                yield symbol.name, symbol.source, symbol.span


def _missing_code_warning(name: str, source: str, where: Label | None) -> Iterator[Diagnostic]:
    binding = binding_of(source)
    if binding is None:
        return
    reason = _why_code_is_missing(binding)
    if reason:
        yield Diagnostic(
            "W007",
            f"extern `{name}` has no code: {reason}",
            where,
            helps=("`soter run` refuses it: write the code, or bind another with --bind",),
            severity=Severity.WARNING,
        )


def _why_code_is_missing(binding: BindingText) -> str:
    """The reason why a binding surely has no code; "" if the code may exist."""
    path, wanted = Path(binding.file), binding.name
    if binding.is_policy:
        absent = [file for file in binding.files if not Path(file).is_file()]
        return f"there is no file `{absent[0]}`" if absent else ""
    try:
        text = read_bytes(path).decode("utf-8")
    except (OSError, UnicodeDecodeError):
        return f"there is no file `{path}`" if not path.is_file() else f"`{path}` cannot be read"
    if binding.kind == "c":
        found = re.search(rf"\b{re.escape(wanted)}\s*\(", COMMENT.sub(" ", text)) is not None
        # a macro or an included file may make any name
        return "" if found or "##" in text or '.c"' in text else _undefined_text(path, wanted)
    try:
        tree = ast.parse(text)
    except (SyntaxError, ValueError):
        return f"`{path}` is not valid Python"
    names = set(_defined_names(tree.body))
    return (
        "" if wanted.partition(".")[0] in names or "*" in names else _undefined_text(path, wanted)
    )


def _undefined_text(path: Path, wanted: str) -> str:
    return f"`{path}` does not define `{wanted}`"


def _defined_names(body: Iterable[ast.stmt]) -> Iterator[str]:
    """Yields the names that the statements may define; `*` stands for any name."""
    for statement in body:
        if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            yield statement.name
        elif isinstance(statement, (ast.Import, ast.ImportFrom)):
            yield from (a.asname or a.name.partition(".")[0] for a in statement.names)
        elif isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call):
            yield from _names_by_call(statement.value)
        else:
            for node in ast.walk(statement):
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                    yield node.id
                elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                    yield node.name
                elif isinstance(node, (ast.Import, ast.ImportFrom)):
                    yield from (a.asname or a.name.partition(".")[0] for a in node.names)


def _names_by_call(call: ast.Call) -> Iterator[str]:
    """Yields `*` (any name) if a call such as `globals().update(...)` may define names."""
    if any(isinstance(n, ast.Name) and n.id in ("globals", "exec") for n in ast.walk(call)):
        yield "*"
