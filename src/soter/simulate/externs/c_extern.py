"""Calls externs that are bound to C from the reference interpreter.

Purpose: `c:file.c:name` means the same on both engines: the C is compiled as for the native
engine, and `c_externs` makes its functions callables like those of Python.
Non-goals: the native engine, which links them in; functions of records, arrays and lists, and
nodes with locals of their own, which only the native engine runs (X008).
"""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.codegen.externs import answer_fields
from soter.codegen.unit import generate
from soter.core.layout import align_of, decode_from, encode_into, lay_out, scalar, size_of
from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError
from soter.language.model.types import BoolType, EnumType, FloatType, IntType
from soter.language.model.values import from_python, to_python
from soter.native.c_interface import interface, open_library
from soter.native.cache import digest, included_files
from soter.native.kept_state import library_copy, why_it_keeps_state
from soter.native.shared_library import library
from soter.simulate.externs.python_answers import PlainError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import SimpleNamespace

    from soter.core.core import CoreSystem
    from soter.language.model.system import Component, System
    from soter.language.model.typed import FunSymbol
    from soter.language.model.types import Type


class CFaultError(PlainError):
    """Raised if the C function of an extern returns a failure."""


class CExtern:
    """A linked C function that can serve as the step of an extern."""

    linked = True

    def __init__(self, step: Callable[..., object]) -> None:
        self.step = step


def c_externs(
    system: System, core: CoreSystem, nodes: Sequence[Component], funs: dict[FunSymbol, str]
) -> dict[str, CExtern]:
    """Maps the full name of each node and function that is bound to C to its callable."""
    _require_callable_from_python(nodes, list(funs))
    if not nodes and not funs:
        return {}
    unit = generate(system, core)
    shared = library(unit)
    with library_copy(shared) if why_it_keeps_state(unit) else nullcontext(shared) as copy:
        path = str(copy)
        open_library(interface(), copy, linked_symbols(system, core))  # reports missing functions
        extern_by_name = {
            component.name: CExtern(_node_callable(system, component, path)) for component in nodes
        }
        extern_by_name.update(
            {
                fun.name: CExtern(_function_callable(fun, source, path))
                for fun, source in funs.items()
            }
        )
    return extern_by_name


def linked_symbols(system: System, core: CoreSystem | None) -> dict[str, str]:
    """Maps each C function of a binding to the C file that should define it."""
    return {name: file for file, name in _c_bindings(system, core)}


def linked_c_hash(system: System, core: CoreSystem) -> str:
    """A hash of all C files of bindings and their includes, "" without such files; raises X003."""
    text_by_path = included_files(*(file for file, _ in _c_bindings(system, core)))
    return digest(x for p, t in text_by_path.items() for x in (str(p), t)) if text_by_path else ""


def _c_bindings(system: System, core: CoreSystem | None) -> list[tuple[str, str]]:
    """Pairs of file and C function, one for each binding to C."""
    texts = [x.binding for x in system.components if x.extern]
    texts += [f.source for f in core.functions] if core is not None else []
    parts = [t.split(":") for t in texts if t is not None and t.startswith("c:")]
    return [(file, name) for _, file, name in parts]


def _require_callable_from_python(nodes: Sequence[Component], funs: list[FunSymbol]) -> None:
    problems = []
    for x in nodes:
        if x.node is not None and x.node.locals:
            why = "it keeps locals of its own in the state"
            problems.append(_native_only_error(f"extern node `{x.name}`", why, x.node.span))
    for f in funs:
        if any(_c_type(t) is None for t in (f.result, *(p.type for p in f.parameters))):
            why = "only numbers, bools and enums can be handed over"
            problems.append(_native_only_error(f"extern function `{f.name}`", why, f.span))
    if problems:
        raise SoterError(tuple(problems))


def _native_only_error(subject: str, why: str, span: Any) -> Diagnostic:  # noqa: ANN401 - a span
    return Diagnostic(
        "X008",
        f"the interpreter cannot call the C of {subject}",
        Label(span, "declared here"),
        notes=(why,),
        helps=("use --engine native",),
    )


# ---------------------------------------------------------------- nodes


def _node_callable(
    system: System, component: Component, path: str
) -> Callable[[SimpleNamespace], object]:
    """A callable that runs `int step(const in *, out *)` with the structs of the C header."""
    node = component.node
    assert node is not None
    assert component.binding is not None
    ffi, call = _find_symbol(path, component.binding, "int", ["const void *", "void *"])
    reads = [
        (
            subscribed.topic.name.rpartition(".")[2],
            system.topics[component.scope.topics[subscribed.topic]].type,
        )
        for subscribed in node.subscribes
    ]
    places, in_size = _struct_layout([t for _, t in reads])
    answer = lay_out(answer_fields(component))
    offsets = {member.name: (member.offset, member.type) for member in answer.members}
    outputs = [t.name.rpartition(".")[2] for t in node.publishes]

    def step(inputs: SimpleNamespace) -> dict[str, object]:
        encoded = bytearray(max(in_size, 1))
        for (name, t), at in zip(reads, places, strict=True):
            encode_into(encoded, at, t, from_python(t, getattr(inputs, name)))
        answer_bytes = bytearray(max(answer.size, 1))
        status = call(ffi.from_buffer(bytes(encoded)), ffi.from_buffer(answer_bytes))
        if status != 0:
            raise CFaultError(f"it returned {status}")
        return {
            output: _decode_member(answer_bytes, *offsets[output])
            for output in outputs
            if answer_bytes[offsets[f"has_{output}"][0]]
        }

    return step


def _decode_member(buffer: bytearray, offset: int, t: Type) -> object:
    return to_python(t, decode_from(buffer, offset, t))


def _struct_layout(types: list[Type]) -> tuple[list[int], int]:
    """The offsets of a struct's members as a C compiler places them, and the struct's size."""
    at, align, places = 0, 1, []
    for t in types:
        alignment = align_of(t)
        at = -(-at // alignment) * alignment
        places.append(at)
        at += size_of(t)
        align = max(align, alignment)
    return places, -(-at // align) * align


# ---------------------------------------------------------------- functions


def _function_callable(fun: FunSymbol, source: str, path: str) -> Callable[..., object]:
    types = [p.type for p in fun.parameters]
    result = _c_type(fun.result)
    assert result is not None
    _, call = _find_symbol(path, source, result, [str(_c_type(t)) for t in types])

    def step(*arguments: object) -> object:
        values = [from_python(t, a) for t, a in zip(types, arguments, strict=True)]
        return to_python(fun.result, call(*values))

    return step


def _c_type(t: Type) -> str | None:
    """The C type of a scalar in the generated prototype; None for any other type."""
    if isinstance(t, FloatType):
        return "double"
    if isinstance(t, BoolType):
        return "_Bool"
    if isinstance(t, IntType):
        return "int64_t"
    stored = scalar(t)
    return stored.c_type if isinstance(t, EnumType) and stored is not None else None


def _find_symbol(
    path: str, source: str, result: str, parameters: list[str]
) -> tuple[Any, Callable[..., Any]]:
    """The FFI object, and the library function that a binding names."""
    name = source.rsplit(":", 1)[1]
    ffi = interface(f"{result} {name}({', '.join(parameters) or 'void'});")
    return ffi, getattr(open_library(ffi, Path(path)), name)
