"""Finds the code that answers each extern of a system.

Purpose: `bind` makes, of the bindings in the program (`from "python:..."`) and of the user's
(`--bind X=...`, `.bind("X", f)`), the callables of a run on one engine; bindings to C reach the
generated program. Every mistake is a diagnostic: X001 to X008, U001, U005. `file_hashes` gives the
SHA-256 of the files that a binding names, and of those that they need: runs and logs tell it, since
other weights are another controller, and the program's hash does not cover them.
Non-goals: loading Python (`python_extern.py`), calling C (`c_extern.py`), running; hashes of what
Python imports, and of objects that are bound from Python: nobody can name their files.
"""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from soter.core.steps import lower
from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError, mistake
from soter.diagnostics.similar_names import nearest_or_all
from soter.language.load.named_files import FORMS, ReadError, binding_of, read_bytes
from soter.native.cache import included
from soter.simulate.externs.python_extern import (
    PythonExtern,
    clipping,
    instantiate,
    load_python,
    node_answers,
    policy_files,
)
from soter.simulate.interrupt import StopRequest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from typing import TypeGuard

    from soter.core.core import CoreSystem
    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Component, System
    from soter.language.model.typed import FunSymbol


def file_hashes(bound: object) -> dict[str, str]:
    """The SHA-256 of each file by name; empty if no text binds it; `SoterError` X003, X014."""
    binding = binding_of(bound) if isinstance(bound, str) else None
    if binding is None:
        return {}
    if binding.kind == "c":
        texts = included(binding.file)
        return {str(p): _sha256(t.encode("utf-8", "surrogateescape")) for p, t in texts.items()}
    if not binding.is_policy:
        return {binding.file: _sha256(read_bytes(Path(binding.file)))}
    return policy_files().sha256_of_files(binding)


def _sha256(raw: bytes) -> str:
    return hashlib.sha256(raw).hexdigest()


POLICY_MEMORY = 2 * 2**30
"""How many bytes the process of a policy may take beyond those it begins with."""


@dataclass(eq=False)
class Extern:
    """An extern of a system: a node, a plant, or a function that its code calls.

    `bound`: nothing (None), a text `python:file.py:name` or `c:file.c:name`, or any object.
    """

    name: str
    kind: str
    span: Span
    component: Component | None = None
    fun: FunSymbol | None = None
    bound: object = None


@dataclass(eq=False)
class Bindings:
    """The externs of a system, and Core with the C functions as they are bound."""

    system: System
    core: CoreSystem
    externs: list[Extern] = field(default_factory=list)

    def texts(self) -> dict[str, str]:
        """Words for what each extern is bound to, for people and logs."""
        return {x.name: _binding_text(x.bound) for x in self.externs}

    def files(self) -> dict[str, dict[str, str]]:
        """SHA-256 of the files that answer each extern, by name; SoterError X003, X014."""
        return {x.name: file_hashes(x.bound) for x in self.externs}


def check_text(name: str, text: str) -> str:
    """A binding that is given as text, after a check of its file; `SoterError` U001."""
    binding = binding_of(text)
    if binding is None:
        raise mistake(
            "U001",
            f"`{name}` cannot be bound to `{text}`",
            f"write {', '.join(f'NAME={form}' for form in FORMS.values())}",
        )
    for file in binding.files:
        if not Path(file).is_file():
            raise mistake("X003", f"there is no file `{file}` to bind `{name}` to")
    return text


def check_target(name: str, target: object) -> None:
    """`SoterError` U001, X002, X003 for an object that can answer no extern at all."""
    if isinstance(target, str):
        check_text(name, target)
    elif not isinstance(target, type) and not callable(getattr(target, "step", target)):
        raise SoterError((_not_callable(name, target),))


def require_named(systems: Sequence[System], name: str) -> None:
    """`SoterError` U005 where none of a program's systems has an extern of that name."""
    quick = [(s, list(_extern_components(s))) for s in systems]
    if not systems or any(_is_named(externs, name) for _, externs in quick):
        return
    externs = [x for s in systems for x in _all_externs(s, lower(s))]
    if not _is_named(externs, name):
        own = [d for s in systems if (d := _own_code(s, name)) is not None]
        raise SoterError(
            (own[0] if own else _unknown_extern("no system of this program", externs, name),)
        )


def bind(system: System, given: Mapping[str, object]) -> Bindings:
    """Binds every extern of the system; `given` overrides the program.

    A name is a full one (`d.M.Learned`), the last part of it, or that of the declaration; the
    most exact wins, and one name may stand for several instances. Bindings to C are entered in
    the system's components. SoterError U005 for names of nothing that could be bound.
    """
    core = lower(system)
    externs = list(_all_externs(system, core))
    problems = [_no_extern(system, externs, name) for name in given if not _is_named(externs, name)]
    if problems:
        raise SoterError(tuple(problems))
    _assign(externs, given)
    _enter_c(core, externs)
    return Bindings(system, core, externs)


def require_files(bindings: Bindings, *, linked: bool = False) -> None:
    """Reads the files that answer externs before work that errors would waste; X003, X014.

    Policies are loaded as they are for a run, so that numbers which do not fit a node are told,
    too; no Python of a person is executed. X001 and X008 for what no engine runs. `linked`: only
    the C that is compiled into a program.
    """
    if not linked:
        require_runnable(bindings, "interp")
    problems: list[Diagnostic] = []
    for extern in bindings.externs:
        bound, declared = extern.bound, Label(extern.span, "declared here")
        binding = binding_of(bound) if isinstance(bound, str) else None
        try:
            if not linked and binding is not None and binding.is_policy:
                apart = hasattr(os, "fork")
                loaded = _python_callable(bindings.system, extern, StopRequest(), apart=apart)
                close({extern.name: loaded})
            elif not linked or _is_c(bound):
                file_hashes(bound)
        except ReadError as error:
            why = f"cannot read the code of `{extern.name}`, `{bound}`: {error}"
            problems.append(Diagnostic("X003", why, declared))
        except SoterError as error:
            problems += [replace(d, primary=declared) for d in error.diagnostics]
    if problems:
        raise SoterError(tuple(problems))


def bind_again(bindings: Bindings, given: Mapping[str, object]) -> Bindings:
    """The same system with other Python objects under the same names and texts."""
    externs = [replace(x) for x in bindings.externs]
    _assign(externs, given)
    return Bindings(bindings.system, bindings.core, externs)


def _assign(externs: list[Extern], given: Mapping[str, object]) -> None:
    for exactness in (2, 1, 0):
        for name, target in given.items():
            for extern in externs:
                if exactness in _match_levels(extern, name):
                    extern.bound = check_text(name, target) if isinstance(target, str) else target


def bind_somewhere(systems: Sequence[System], given: Mapping[str, object]) -> None:
    """SoterError U005 for a name that no system of a program has an extern for."""
    problems: list[Diagnostic] = []
    for name, target in given.items():
        problem_lists = [_problems_of_binding(system, name, target) for system in systems]
        if all(problem_lists):
            problems += problem_lists[0] if problem_lists else ()
    if problems:
        raise SoterError(tuple(problems))


def _problems_of_binding(system: System, name: str, target: object) -> tuple[Diagnostic, ...]:
    try:
        bind(system, {name: target})
    except SoterError as error:
        return error.diagnostics
    return ()


def require_runnable(bindings: Bindings, engine: str) -> None:
    """SoterError where an extern cannot be run on this engine: X001, X007, X008."""
    problems = [p for x in bindings.externs if (p := _why_not_runnable(x, engine)) is not None]
    if problems:
        raise SoterError(tuple(problems))


def callables(
    bindings: Bindings, engine: str, stop: StopRequest, *, apart: bool = False
) -> dict[str, object]:
    """The callables for one run; SoterError where an extern cannot be run on this engine.

    `apart`: nodes in Python get processes of their own.
    """
    problems: list[Diagnostic] = []
    callable_by_name: dict[str, object] = {}
    for extern in bindings.externs:
        problem = _why_not_runnable(extern, engine)
        if problem is not None:
            problems.append(problem)
        elif not _is_c(extern.bound):
            try:
                callable_by_name[extern.name] = _python_callable(
                    bindings.system, extern, stop, apart=apart
                )
            except SoterError as error:
                problems += error.diagnostics
    if problems:
        raise SoterError(tuple(problems))
    if engine == "interp":
        callable_by_name.update(_c_callables(bindings))
    return callable_by_name


# ---------------------------------------------------------------- the externs of a system


def _extern_components(system: System) -> Iterable[Extern]:
    for x in system.components:
        if x.extern:
            declared = x.node or x.plant
            assert declared is not None
            kind = "plant" if x.plant else "node"
            yield Extern(x.name, kind, declared.span, component=x, bound=x.binding)


def _all_externs(system: System, core: CoreSystem) -> Iterable[Extern]:
    yield from _extern_components(system)
    for f in core.functions:
        if f.result is None:
            symbol = system.program.funs[f.source_name]
            yield Extern(symbol.name, "function", symbol.span, fun=symbol, bound=symbol.source)


def _match_levels(extern: Extern, name: str) -> tuple[int, ...]:
    """The ways in which a name fits an extern, as exactness, 0 the least; empty: it does not."""
    levels = []
    if name == extern.name:
        levels.append(0)  # the last one entered wins
    if name == extern.name.rpartition(".")[2]:
        levels.append(1)
    if name in _declared_names(extern):
        levels.append(2)
    return tuple(levels)


def _declared_names(extern: Extern) -> tuple[str, ...]:
    x = extern.component
    symbol = extern.fun or (x.node or x.plant if x else None)
    return (symbol.name, symbol.name.rpartition(".")[2]) if symbol else ()


def _is_named(externs: list[Extern], name: str) -> bool:
    return any(_match_levels(x, name) for x in externs)


def _no_extern(system: System, externs: list[Extern], name: str) -> Diagnostic:
    nowhere = _unknown_extern(f"system `{system.name}`", externs, name)
    return _own_code(system, name) or nowhere


def _own_code(system: System, name: str) -> Diagnostic | None:
    """The error for a name that stands for something that is no extern; None: it is unknown."""
    for x in system.components:
        own = x.node or x.plant
        if own is not None and name in (x.name, x.name.rpartition(".")[2], own.name):
            return Diagnostic(
                "U005",
                f"`{name}` has code of its own: only an extern can be bound",
                Label(own.span, "declared here"),
                helps=("declare it as `extern`, or `replace` it by an extern in a system",),
            )
    return None


def _unknown_extern(where: str, externs: list[Extern], name: str) -> Diagnostic:
    names = list(dict.fromkeys(x.name for x in externs))
    known = nearest_or_all(name, [*names, *(n.rpartition(".")[2] for n in names)])
    has = "has an" if where.startswith("no ") else "has no"
    help_ = known or "there are no externs at all"
    return Diagnostic("U005", f"{where} {has} extern `{name}`", helps=(help_,))


# ---------------------------------------------------------------- bindings to C


def _is_c(bound: object) -> TypeGuard[str]:
    return isinstance(bound, str) and bound.startswith("c:")


def _enter_c(core: CoreSystem, externs: list[Extern]) -> None:
    """Tells the code generator which externs are C, and which no longer are."""
    for extern in externs:
        text = extern.bound if isinstance(extern.bound, str) else None
        if extern.component is not None:
            extern.component.binding = text
    sources = {x.name: x.bound for x in externs if x.fun is not None}
    core.functions = tuple(
        [
            replace(f, source=bound if _is_c(bound := sources[f.source_name]) else None)
            if f.source_name in sources
            else f
            for f in core.functions
        ]
    )


def _c_callables(bindings: Bindings) -> dict[str, object]:
    from soter.simulate.externs.c_extern import c_externs  # noqa: PLC0415 - compiles: only if needed

    nodes = [x.component for x in bindings.externs if x.component and _is_c(x.bound)]
    funs = {x.fun: str(x.bound) for x in bindings.externs if x.fun and _is_c(x.bound)}
    return dict(c_externs(bindings.system, bindings.core, nodes, funs))


# ---------------------------------------------------------------- Python


def close(bound: Mapping[str, object]) -> None:
    """Ends the processes that the callables of a run have."""
    for extern in bound.values():
        end = getattr(extern, "close", None) if not isinstance(extern, PythonExtern) else None
        if callable(end):
            end()


def assumptions(bound: Mapping[str, object]) -> list[str]:
    """The assumptions that the files of policies leave open, a sentence for each callable."""
    told = [(name, getattr(extern, "assumed", ())) for name, extern in bound.items()]
    return [f"{name} assumes, as its file does not say: {'; '.join(x)}" for name, x in told if x]


def _python_callable(system: System, extern: Extern, stop: StopRequest, *, apart: bool) -> object:
    node = extern.component.node if extern.component is not None else None
    if not apart or node is None:
        shapes = () if node is None else node.answers
        return PythonExtern(extern.name, _bound_target(system, extern), stop, shapes)
    from soter.simulate.externs.extern_process import ProcessExtern  # noqa: PLC0415 - POSIX only

    load = partial(_bound_target, system, extern)
    binding = binding_of(extern.bound) if isinstance(extern.bound, str) else None
    if binding is not None and binding.is_policy:
        load = partial(_load_bounded, load)
    return ProcessExtern(extern.name, load, node.answers, extern.span, stop)


def _load_bounded(load: Callable[[], object]) -> object:
    """Loads a policy with a memory limit of `POLICY_MEMORY` more, as a graph may ask for any."""
    with suppress(ImportError, OSError, ValueError):  # elsewhere nobody says what a process has
        from resource import RLIMIT_AS, getrlimit, setrlimit  # noqa: PLC0415 - POSIX only

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * os.sysconf("SC_PAGE_SIZE") + POLICY_MEMORY
        setrlimit(RLIMIT_AS, (most, getrlimit(RLIMIT_AS)[1]))
    return load()


def _bound_target(system: System, extern: Extern) -> object:
    target = _find_target(system, extern)
    x = extern.component
    return target if x is None or x.node is None else clipping(target, node_answers(system, x))


def _find_target(system: System, extern: Extern) -> object:
    bound = extern.bound
    if isinstance(bound, str):
        return _load_object(system, extern, bound)
    if isinstance(bound, type):
        return instantiate(bound, _binding_text(bound), None)
    if not callable(getattr(bound, "step", bound)):
        raise SoterError((_not_callable(extern.name, bound),))
    return bound


def _load_object(system: System, extern: Extern, text: str) -> object:
    """The object that a text names: one of a Python file, or the policy in another file."""
    binding, x = binding_of(text), extern.component
    if binding is None or not binding.is_policy or x is None or x.node is None:
        return load_python(text, extern.span)
    topics = [(s.topic, system.topics[x.scope.topics[s.topic]].type) for s in x.node.subscribes]
    reads = [(topic.name.rpartition(".")[2], t) for topic, t in topics]
    return policy_files().load_policy(binding, reads, x.node.answers, extern.span)


def _not_callable(name: str, bound: object) -> Diagnostic:
    what = f"a `{type(bound).__name__}`, which cannot be called and has no `step`"
    help_ = "bind a function, a class or an object with `step`, or `python:file.py:name`"
    return Diagnostic("X002", f"extern `{name}` is bound to {what}", helps=(help_,))


def _why_not_runnable(extern: Extern, engine: str) -> Diagnostic | None:
    """The error that this extern cannot run on this engine; None: it can."""
    declared = Label(extern.span, "declared here")
    short = extern.name.rpartition(".")[2]
    if extern.bound is None:
        return Diagnostic(
            "X001",
            f"extern {extern.kind} `{extern.name}` is not bound to anything",
            declared,
            helps=(
                f"bind it: --bind {short}=python:file.py:name",
                'or write `from "python:file.py:name"` in the program',
            ),
        )
    binding = binding_of(extern.bound) if isinstance(extern.bound, str) else None
    if extern.kind != "node" and binding is not None and binding.is_policy:
        return Diagnostic(
            "X008",
            f"extern {extern.kind} `{extern.name}` is bound to a policy, which only answers nodes",
            declared,
            helps=(f"bind it to Python: --bind {short}=python:file.py:name",),
        )
    if extern.kind == "plant" and _is_c(extern.bound):
        return Diagnostic(
            "X008",
            f"extern plant `{extern.name}` is bound to C, which is not possible yet",
            declared,
            helps=(f"bind it to Python: --bind {short}=python:file.py:name",),
        )
    if extern.kind == "function" and engine == "native" and not _is_c(extern.bound):
        return Diagnostic(
            "X007",
            f"extern function `{extern.name}` is bound to Python: compiled code cannot call it",
            declared,
            notes=("only the reference interpreter calls Python in the middle of a step",),
            helps=("use --engine interp", f"or bind it to C: --bind {short}=c:file.c:name"),
        )
    return None


def _binding_text(bound: object) -> str:
    if bound is None:
        return "nothing"
    if isinstance(bound, str):
        return bound
    module = getattr(bound, "__module__", type(bound).__module__)
    name = getattr(bound, "__qualname__", type(bound).__qualname__)
    return f"{module}.{name}"
