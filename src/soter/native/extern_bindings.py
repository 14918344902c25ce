"""Finds the code or object that each extern of a system is bound to.

Purpose: `bind` takes the bindings of the program (`from "python:..."`) and of the user (`--bind
X=...`, `.bind("X", f)`); bindings to C reach the generated program. Mistakes are diagnostics: U001,
U005, X002, X003, X014. `file_hashes` gives the SHA-256 of the files that a binding names, and of
the files that these need. Runs and logs record it, as the hash of the program does not cover them:
other weights are another controller.
Non-goals: the callables of a run (`simulate/externs/`); hashes of modules that Python imports, and
of objects bound from Python, whose files are unknown.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from soter.addons import load_module
from soter.core.steps import lower
from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError, mistake
from soter.diagnostics.similar_names import nearest_or_all
from soter.language.load.named_files import FORMS, ReadError, binding_of, read_bytes
from soter.native.cache import included_files

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from typing import TypeGuard

    from soter.core.core import CoreSystem
    from soter.diagnostics.diagnostic import Span
    from soter.language.load.named_files import BindingText
    from soter.language.model.system import Component, System
    from soter.language.model.typed import FunSymbol
    from soter.language.model.types import Type

    Shapes = Sequence[tuple[str, Type]]


class FilePolicy:
    """A policy from a file, with a method `step`; `assumed`: facts that its files do not state."""

    assumed: tuple[str, ...]


class PolicyFiles(Protocol):
    """The functions of the add-on for learned policies that a binding to a policy needs."""

    def sha256_of_files(self, binding: BindingText) -> dict[str, str]:
        """The SHA-256 of each file of a binding, and of files named in them; raises X003, X014."""

    def action_bounds(self, binding: BindingText) -> list[tuple[float, float]]:
        """The range of each number that a policy in a zip can answer; raises X003, X014, D007."""

    def load_policy(
        self, binding: BindingText, reads: Shapes, answers: Shapes, span: Span | None
    ) -> FilePolicy:
        """Loads the policy of a binding; raises X003, X014, D007 at `span`, the node's place."""


def policy_files() -> PolicyFiles:
    """The add-on for learned policies; raises `SoterError` D007 if it is not installed."""
    return cast("PolicyFiles", load_module("soter.policy.policy_extern"))


def file_hashes(bound: object) -> dict[str, str]:
    """The SHA-256 of each file of a binding, by file name; {} for an object. Raises X003, X014."""
    binding = binding_of(bound) if isinstance(bound, str) else None
    if binding is None:
        return {}
    if binding.kind == "c":
        texts = included_files(binding.file)
        return {str(p): _sha256(t.encode("utf-8", "surrogateescape")) for p, t in texts.items()}
    if not binding.is_policy:
        return {binding.file: _sha256(read_bytes(Path(binding.file)))}
    return policy_files().sha256_of_files(binding)


def _sha256(raw: bytes) -> str:
    return hashlib.sha256(raw).hexdigest()


@dataclass(eq=False)
class Extern:
    """An extern of a system: a node, a plant, or a function that its code calls.

    `bound` is None, a text `python:file.py:name` or `c:file.c:name`, or any object.
    """

    name: str
    kind: str
    span: Span
    component: Component | None = None
    fun: FunSymbol | None = None
    bound: object = None


@dataclass(eq=False)
class Bindings:
    """The externs of a system with their bindings, and the lowered system that calls their C."""

    system: System
    core: CoreSystem
    externs: list[Extern] = field(default_factory=list)

    def binding_texts(self) -> dict[str, str]:
        """Maps the name of each extern to its binding in words."""
        return {x.name: binding_text(x.bound) for x in self.externs}

    def file_hashes(self) -> dict[str, dict[str, str]]:
        """Maps each extern to the SHA-256 of each file of its binding; raises X003, X014."""
        return {x.name: file_hashes(x.bound) for x in self.externs}


def checked_text(name: str, text: str) -> str:
    """Gives a binding's text after a check of form and files; raises `SoterError` U001, X003."""
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
    """Raises `SoterError` U001, X002 or X003 for an object that no extern can be bound to."""
    if isinstance(target, str):
        checked_text(name, target)
    elif not isinstance(target, type) and not callable(getattr(target, "step", target)):
        raise SoterError((not_callable_error(name, target),))


def require_extern(systems: Sequence[System], name: str) -> None:
    """Raises `SoterError` U005 unless some system of a program has an extern of that name."""
    quick = [(s, list(_extern_components(s))) for s in systems]
    if not systems or any(_is_named(externs, name) for _, externs in quick):
        return
    externs = [x for s in systems for x in _all_externs(s, lower(s))]
    if not _is_named(externs, name):
        coded = [d for s in systems if (d := _own_code_error(s, name)) is not None]
        unknown = _unknown_extern_error("no system of this program", externs, name)
        raise SoterError((coded[0] if coded else unknown,))


def bind(system: System, bound: Mapping[str, object]) -> Bindings:
    """Binds every extern of the system; `bound` overrides the bindings in the program.

    A name may be the full name (`d.M.Learned`), its last part, or the name of the declaration; the
    most exact wins, and a name may stand for several instances. Bindings to C are also written to
    the system's components. Raises SoterError U005 for names that fit nothing bindable.
    """
    core = lower(system)
    externs = list(_all_externs(system, core))
    problems = [
        _no_extern_error(system, externs, name) for name in bound if not _is_named(externs, name)
    ]
    if problems:
        raise SoterError(tuple(problems))
    _assign_targets(externs, bound)
    _enter_c_bindings(core, externs)
    return Bindings(system, core, externs)


def require_readable_c(bindings: Bindings) -> None:
    """Reads all C files of bindings before longer work begins; raises X003 if one is unreadable."""
    read_externs([x for x in bindings.externs if is_in_c(x.bound)], lambda x: file_hashes(x.bound))


def read_externs(externs: Iterable[Extern], read: Callable[[Extern], object]) -> None:
    """Calls `read` for each extern, then raises one `SoterError` with the errors of all calls."""
    problems: list[Diagnostic] = []
    for extern in externs:
        declared = Label(extern.span, "declared here")
        try:
            read(extern)
        except ReadError as error:
            why = f"cannot read the code of `{extern.name}`, `{extern.bound}`: {error}"
            problems.append(Diagnostic("X003", why, declared))
        except SoterError as error:
            problems += [replace(d, primary=declared) for d in error.diagnostics]
    if problems:
        raise SoterError(tuple(problems))


def bindings_with_objects(bindings: Bindings, targets: Mapping[str, object]) -> Bindings:
    """A copy of bindings, in which `targets` replace the bound objects of these names."""
    externs = [replace(x) for x in bindings.externs]
    _assign_targets(externs, targets)
    return Bindings(bindings.system, bindings.core, externs)


def bindings_of_derived(bindings: Bindings, derived: System) -> Bindings:
    """The same bindings for a derived system, such as a system in which a module is forced.

    The derived system is lowered again, because the AC of a forced module has no shield.
    """
    core = lower(derived)
    _enter_c_bindings(core, bindings.externs)
    return Bindings(derived, core, bindings.externs)


def _assign_targets(externs: list[Extern], targets: Mapping[str, object]) -> None:
    for exactness in (2, 1, 0):
        for name, target in targets.items():
            for extern in externs:
                if exactness in _match_levels(extern, name):
                    extern.bound = checked_text(name, target) if isinstance(target, str) else target


def require_bindable(systems: Sequence[System], targets: Mapping[str, object]) -> None:
    """Raises the `SoterError` of `bind` for each name that no system of a program can bind."""
    problems: list[Diagnostic] = []
    for name, target in targets.items():
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
    """The levels of exactness, 0 the least, at which a name fits an extern; () if it does not."""
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


def _no_extern_error(system: System, externs: list[Extern], name: str) -> Diagnostic:
    nowhere = _unknown_extern_error(f"system `{system.name}`", externs, name)
    return _own_code_error(system, name) or nowhere


def _own_code_error(system: System, name: str) -> Diagnostic | None:
    """The error U005 for the name of a component with own code; None if none has the name."""
    for x in system.components:
        symbol = x.node or x.plant
        if symbol is not None and name in (x.name, x.name.rpartition(".")[2], symbol.name):
            return Diagnostic(
                "U005",
                f"`{name}` has code of its own: only an extern can be bound",
                Label(symbol.span, "declared here"),
                helps=("declare it as `extern`, or `replace` it by an extern in a system",),
            )
    return None


def _unknown_extern_error(where: str, externs: list[Extern], name: str) -> Diagnostic:
    names = list(dict.fromkeys(x.name for x in externs))
    known = nearest_or_all(name, [*names, *(n.rpartition(".")[2] for n in names)])
    has = "has an" if where.startswith("no ") else "has no"
    help_ = known or "there are no externs at all"
    return Diagnostic("U005", f"{where} {has} extern `{name}`", helps=(help_,))


def not_callable_error(name: str, bound: object) -> Diagnostic:
    """The error X002 for a bound object that is not callable and has no method `step`."""
    bound_text = f"a `{type(bound).__name__}`, which cannot be called and has no `step`"
    help_ = "bind a function, a class or an object with `step`, or `python:file.py:name`"
    return Diagnostic("X002", f"extern `{name}` is bound to {bound_text}", helps=(help_,))


def binding_text(bound: object) -> str:
    """The binding of an extern in words, such as `c:file.c:name`, or "nothing"."""
    if bound is None:
        return "nothing"
    if isinstance(bound, str):
        return bound
    module = getattr(bound, "__module__", type(bound).__module__)
    name = getattr(bound, "__qualname__", type(bound).__qualname__)
    return f"{module}.{name}"


# ---------------------------------------------------------------- bindings to C


def is_in_c(bound: object) -> TypeGuard[str]:
    """Whether an extern is bound to C."""
    return isinstance(bound, str) and bound.startswith("c:")


def _enter_c_bindings(core: CoreSystem, externs: list[Extern]) -> None:
    """Enters bindings to C in components and in the lowered system, for the code generator."""
    for extern in externs:
        text = extern.bound if isinstance(extern.bound, str) else None
        if extern.component is not None:
            extern.component.binding = text
    sources = {x.name: x.bound for x in externs if x.fun is not None}
    core.functions = tuple(
        [
            replace(f, source=bound if is_in_c(bound := sources[f.source_name]) else None)
            if f.source_name in sources
            else f
            for f in core.functions
        ]
    )
