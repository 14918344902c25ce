"""Which contracts stand in the place of modules and nodes, and which tests hold them to it.

Purpose: assumptions are output: who was replaced by its contract, what that says, where it runs.
Non-goals: verdicts of those tests: each is a test of its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.explore.allowed_steps import plan_of
from soter.language.check.field import listed
from soter.language.model import typed

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.language.model.system import StandIn, System


NO_HARM = "that others of what its contract permits do no harm is assumed"


def replaced_in(test: typed.TestSymbol) -> tuple[tuple[str, str], ...]:
    """What stands for what in a test: path of the instance, name of the replacement.

    What is replaced by its contract is told apart (`told`).
    """
    said = [*_replaces(test.system), *((p, by) for p, by, _ in test.replaces)]
    replacements = {p: by.name for p, by in said if not isinstance(by, typed.ByContract)}
    return tuple(replacements.items())


def _replaces(
    system: typed.SystemSymbol, prefix: str = ""
) -> Iterator[tuple[str, typed.NodeSymbol | typed.PlantSymbol | typed.ByContract]]:
    """Of a system and of the systems inside it, these first: who is around them speaks last."""
    for name, instance in system.by_name.items():
        if isinstance(instance.what, typed.SystemSymbol):
            yield from _replaces(instance.what, f"{prefix}{name}.")
    yield from ((prefix + path, by) for path, by, _ in system.replaces)


def told(system: System) -> Iterator[str]:
    """A sentence for each module and node that is replaced by its contract."""
    stand_ins: dict[str, list[StandIn]] = {}
    for c in system.components:
        if c.stands_for is not None:
            stand_ins.setdefault(c.stands_for.of, []).append(c.stands_for)
    for of, group in stand_ins.items():
        yield from _said_of(system, of, group)


def _said_of(system: System, of: str, group: list[StandIn]) -> Iterator[str]:
    said = _each(t for s in group for t in s.clauses)
    said = said or "no clause, any value of the sets of its topics"
    left = _each(t for s in group for t in s.left)
    more = f"; not asked for, so that more is permitted: {left}" if left else ""
    yield f"{of} is replaced by its contract ({said}{more}): {_held_to_it(system, of)}"
    asked = [name for name, how in _asked_of(system, of) if not how]
    held = f"that it publishes no other is asked by {listed(asked)}" if asked else NO_HARM
    for text in dict.fromkeys(t for s in group for t in s.tried):
        yield f"what stands for {of} was tried with {text} alone: {held}"


def _each(texts: Iterable[str]) -> str:
    return "; ".join(dict.fromkeys(texts))


def _held_to_it(system: System, of: str) -> str:
    tests_by_condition: dict[str, list[str]] = {}
    for name, how in _asked_of(system, of):
        tests_by_condition.setdefault(how, []).append(name)
    if "" in tests_by_condition:
        return (
            f"whether it keeps it is asked by {listed(tests_by_condition[''])}, "
            "where it runs as it is, as far "
            "as horizon, inputs, skew, faults, order and replacements there go"
        )
    but = ", ".join(f"{listed(names)} {how}" for how, names in tests_by_condition.items())
    but = f" ({but})" if but else ""
    return f"no test of this program runs it as it is{but}: that it keeps it is assumed"


def tests_by_contract(system: System) -> dict[str, list[str]]:
    """What is replaced by its contract -> the tests in which it runs as it is."""
    names = {c.stands_for.of for c in system.components if c.stands_for is not None}
    return {of: [n for n, how in _asked_of(system, of) if not how] for of in sorted(names)}


def _asked_of(system: System, of: str) -> Iterator[tuple[str, str]]:
    """Tests of the program that have it, and how; none of a test that is made up on the way."""
    tests = system.program.tests
    here = tests.get(plan_of(system).name)
    for name, test in tests.items():
        how = None if here is None else _asked(test, here, of)
        if how is not None:
            yield name, how


def _asked(test: typed.TestSymbol, here: typed.TestSymbol, of: str) -> str | None:
    """How a test differs from one in which what `here` replaces runs as it is; "": it is one.

    None where it is not in it, or replaced in it, too.
    """
    what = at(test, of)
    replaced = None if what is None or what is not at(here, of) else _replaced(test, what, of)
    if test is here or replaced is None or of in replaced:
        return None
    if test.system is not here.system:
        return "in another system"
    if _parameters(test) != _parameters(here):
        return "with other parameters"
    return "but for a controller" if replaced else ""


def _parameters(test: typed.TestSymbol) -> set[tuple[str, typed.ParamSymbol, str]]:
    return {(s.path, s.param, repr(s.value)) for s in test.sets}


def at(test: typed.TestSymbol, of: str) -> typed.ModuleSymbol | typed.NodeSymbol | None:
    """The module or node of that name in the system of a test, before anything is replaced."""
    what: object = test.system
    for name in of.split("."):
        if isinstance(what, typed.ModuleSymbol):
            names = {n.name.rpartition(".")[2]: n for n in what.own}
            what = names.get(name)
            continue
        instance = what.by_name.get(name) if isinstance(what, typed.SystemSymbol) else None
        what = None if instance is None else instance.what
    return what if isinstance(what, (typed.ModuleSymbol, typed.NodeSymbol)) else None


def _replaced(
    test: typed.TestSymbol, what: typed.ModuleSymbol | typed.NodeSymbol, of: str
) -> set[str]:
    """What of it a test replaces, itself as `of`; what the system replaces is the same in all."""
    inside = what.own if isinstance(what, typed.ModuleSymbol) else ()
    for m in what.below if isinstance(what, typed.ModuleSymbol) else ():
        inside = (*inside, *m.own)
    paths: set[str] = set()
    for path, _, _ in test.replaces:
        if path in {of, what.name} or of.startswith(f"{path}."):
            paths.add(of)
        elif any(path in {n.name, n.name.rpartition(".")[2]} for n in inside) or path.startswith(
            f"{of}."
        ):
            paths.add(path)
    return paths
