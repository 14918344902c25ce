"""Loads the code of each extern of a run as a callable, for one engine.

Purpose: `load_callables` loads what the externs of a system are bound to, in this process or in
processes of their own. Every mistake is a diagnostic: X001 to X008.
Non-goals: finding bindings (`native/extern_bindings.py`), loading Python (`python_extern.py`),
calling C (`c_extern.py`), running.
"""

from __future__ import annotations

import os
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError
from soter.language.load.named_files import binding_of
from soter.native.extern_bindings import (
    binding_text,
    file_hashes,
    is_in_c,
    not_callable_error,
    policy_files,
    read_externs,
)
from soter.simulate.externs.python_extern import (
    PythonExtern,
    clip_target,
    load_python,
    make_instance,
    node_answers,
)
from soter.simulate.interrupt import StopRequest

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.language.model.system import System
    from soter.native.extern_bindings import Bindings, Extern

POLICY_MEMORY = 2 * 2**30
"""How many bytes the process of a policy may take beyond those it begins with."""


def load_callables(
    bindings: Bindings, engine: str, stop: StopRequest, *, apart: bool = False
) -> dict[str, object]:
    """Loads a run's callables, by extern name; SoterError if an extern cannot run on the engine.

    `apart`: each Python node runs in its separate process.
    """
    problems: list[Diagnostic] = []
    callable_by_name: dict[str, object] = {}
    for extern in bindings.externs:
        problem = _why_not_runnable(extern, engine)
        if problem is not None:
            problems.append(problem)
        elif not is_in_c(extern.bound):
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


def require_runnable(bindings: Bindings, engine: str) -> None:
    """Raises SoterError X001, X007, X008 if an extern cannot run on this engine."""
    problems = [p for x in bindings.externs if (p := _why_not_runnable(x, engine)) is not None]
    if problems:
        raise SoterError(tuple(problems))


def _why_not_runnable(extern: Extern, engine: str) -> Diagnostic | None:
    """The error if an extern cannot run on this engine; None if it can."""
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
    if extern.kind == "plant" and is_in_c(extern.bound):
        return Diagnostic(
            "X008",
            f"extern plant `{extern.name}` is bound to C, which is not possible yet",
            declared,
            helps=(f"bind it to Python: --bind {short}=python:file.py:name",),
        )
    if extern.kind == "function" and engine == "native" and not is_in_c(extern.bound):
        return Diagnostic(
            "X007",
            f"extern function `{extern.name}` is bound to Python: compiled code cannot call it",
            declared,
            notes=("only the reference interpreter calls Python in the middle of a step",),
            helps=("use --engine interp", f"or bind it to C: --bind {short}=c:file.c:name"),
        )
    return None


def require_files(bindings: Bindings) -> None:
    """Reads the files of externs early, before long computations; raises SoterError X003, X014.

    Policies are loaded as for a run, so that mismatches with a node are reported; Python files of
    users are not executed. Raises X001 and X008 for externs that no engine can run.
    """
    require_runnable(bindings, "interp")

    def read(extern: Extern) -> None:
        binding = binding_of(extern.bound) if isinstance(extern.bound, str) else None
        if binding is not None and binding.is_policy:
            apart = hasattr(os, "fork")
            loaded = _python_callable(bindings.system, extern, StopRequest(), apart=apart)
            close_externs({extern.name: loaded})
        else:
            file_hashes(extern.bound)

    read_externs(bindings.externs, read)


def close_externs(bound: Mapping[str, object]) -> None:
    """Ends the processes of a run's callables."""
    for extern in bound.values():
        end = getattr(extern, "close", None) if not isinstance(extern, PythonExtern) else None
        if callable(end):
            end()


def policy_assumptions(bound: Mapping[str, object]) -> list[str]:
    """A sentence for each policy on the assumptions that its file leaves open."""
    pairs = [(name, getattr(extern, "assumed", ())) for name, extern in bound.items()]
    return [f"{name} assumes, as its file does not say: {'; '.join(x)}" for name, x in pairs if x]


def _c_callables(bindings: Bindings) -> dict[str, object]:
    from soter.simulate.externs.c_extern import c_externs  # noqa: PLC0415 - compiles: only if needed

    nodes = [x.component for x in bindings.externs if x.component and is_in_c(x.bound)]
    funs = {x.fun: str(x.bound) for x in bindings.externs if x.fun and is_in_c(x.bound)}
    return dict(c_externs(bindings.system, bindings.core, nodes, funs))


def _python_callable(system: System, extern: Extern, stop: StopRequest, *, apart: bool) -> object:
    node = extern.component.node if extern.component is not None else None
    if not apart or node is None:
        shapes = () if node is None else node.answers
        return PythonExtern(extern.name, _bound_target(system, extern), stop, shapes)
    from soter.simulate.externs.extern_process import ProcessExtern  # noqa: PLC0415 - POSIX only

    load = partial(_bound_target, system, extern)
    binding = binding_of(extern.bound) if isinstance(extern.bound, str) else None
    if binding is not None and binding.is_policy:
        load = partial(_load_within_memory, load)
    return ProcessExtern(extern.name, load, node.answers, extern.span, stop)


def _load_within_memory(load: Callable[[], object]) -> object:
    """Loads a policy with at most `POLICY_MEMORY` more memory; its graph may want any amount."""
    with suppress(ImportError, OSError, ValueError):  # other systems have no /proc
        from resource import RLIMIT_AS, getrlimit, setrlimit  # noqa: PLC0415 - POSIX only

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        most = pages * os.sysconf("SC_PAGE_SIZE") + POLICY_MEMORY
        setrlimit(RLIMIT_AS, (most, getrlimit(RLIMIT_AS)[1]))
    return load()


def _bound_target(system: System, extern: Extern) -> object:
    target = _find_target(system, extern)
    x = extern.component
    return target if x is None or x.node is None else clip_target(target, node_answers(system, x))


def _find_target(system: System, extern: Extern) -> object:
    bound = extern.bound
    if isinstance(bound, str):
        return _load_object(system, extern, bound)
    if isinstance(bound, type):
        return make_instance(bound, binding_text(bound), None)
    if not callable(getattr(bound, "step", bound)):
        raise SoterError((not_callable_error(extern.name, bound),))
    return bound


def _load_object(system: System, extern: Extern, text: str) -> object:
    """Loads the object that a binding names: from a Python file or from a policy file."""
    binding, x = binding_of(text), extern.component
    if binding is None or not binding.is_policy or x is None or x.node is None:
        return load_python(text, extern.span)
    topics = [(s.topic, system.topics[x.scope.topics[s.topic]].type) for s in x.node.subscribes]
    reads = [(topic.name.rpartition(".")[2], t) for topic, t in topics]
    return policy_files().load_policy(binding, reads, x.node.answers, extern.span)
