"""Values that nobody tells apart: one of each violates what all of them together violate.

Judged by the brute-force enumerator, over random programs of which a stand-in publishes every value
that its contract permits, then one of each that somebody can tell apart (docs/testing.md).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest

from generators.brute_force import TooLargeError
from generators.explorer_agreement import enumerated
from generators.reader_programs import readers
from long_tests import examples, seeds
from soter.language.elaborate import distinguishable_values
from soter.language.elaborate.passes import stand_ins
from soter.language.model import typed
from soter.language.model.tree_walk import children
from soter.language.model.types import RecordType
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Iterator

    from generators.brute_force import Found
    from soter.language.elaborate.passes.stand_ins import _TriedValues
    from soter.language.model.system import Module, Scope, StandIn

CHUNKS = 4
PROGRAMS = examples(200)
MOST = 5_000


def _step_of_few(
    published: dict[typed.TopicSymbol, _TriedValues], by: StandIn
) -> Iterator[typed.TypedStmt]:
    """The step of a stand-in, refused where it tries every value."""
    if any(v.read is None for v in published.values()):
        raise stand_ins.EndlessError("every value is tried elsewhere")
    yield from STEP(published, by)


STEP = stand_ins._statements_of_step


def both(seed: int, monkeypatch: pytest.MonkeyPatch) -> tuple[Found, Found] | None:
    """What every value does, and one of each that is told apart; None: it is too large."""
    program = readers(seed)
    try:
        every = enumerated(seed, program.text(stated=True), MOST).found
    except TooLargeError:
        return None
    with monkeypatch.context() as patched:
        patched.setattr(stand_ins, "_statements_of_step", _step_of_few)
        few = enumerated(seed, program.text(stated=False), MOST).found
    return every, few


def differs(seed: int, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether something else is violated, or by a longer execution."""
    found = both(seed, monkeypatch)
    return found is not None and found[0].shortest_to() != found[1].shortest_to()


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_one_of_each_violates_what_all_of_them_violate(
    chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared = fewer = violated = 0
    for seed in seeds(chunk, PROGRAMS, CHUNKS):
        found = both(seed, monkeypatch)
        if found is None:
            continue
        every, few = found
        assert every.shortest_to() == few.shortest_to(), readers(seed).text(stated=True)
        compared += 1
        fewer += few.transitions < every.transitions
        violated += bool(every.least)
    assert compared > PROGRAMS // CHUNKS * 0.8
    assert compared * 0.4 < fewer
    assert compared * 0.2 < violated < compared * 0.9


Patch = Callable[[pytest.MonkeyPatch], None]


def _overlooks(is_one: Callable[[object], bool]) -> Patch:
    """What stands below some nodes of the code is not looked at."""
    whole = children

    def fewer(node: object) -> list[object]:
        return [] if is_one(node) else whole(node)

    return lambda m: m.setattr(distinguishable_values, "children", fewer)


def _arithmetic(node: object) -> bool:
    return isinstance(node, typed.TypedBinary) and node.op in {"+", "-", "*", "%"}


def _assignment(node: object) -> bool:
    return isinstance(node, typed.TypedAssign)


def _between_topics(node: object) -> bool:
    return isinstance(node, typed.TypedBinary) and isinstance(node.right, typed.TypedField)


def _forgets(op: str) -> Patch:
    """Comparisons by one operator count as none, unless nothing else is left."""
    whole = distinguishable_values.representative_numbers

    def fewer(asked: set[tuple[str, float]], *about: Any) -> list[float]:
        return whole({(o, c) for o, c in asked if o != op} or asked, *about)

    return lambda m: m.setattr(stand_ins, "representative_numbers", fewer)


def _not_between(m: pytest.MonkeyPatch) -> None:
    m.setattr(distinguishable_values, "_number_between", lambda *ends: ends[0])


def _not_turned(m: pytest.MonkeyPatch) -> None:
    m.setattr(
        distinguishable_values,
        "_TURNED",
        {o: o for o in distinguishable_values._TURNED},
    )


def _no_modules(m: pytest.MonkeyPatch) -> None:
    def heard(readers: distinguishable_values.Readers, module: Module) -> None:
        readers.heard |= set(module.reads)

    m.setattr(distinguishable_values.Readers, "_add_reads_of_module", heard)


def _no_contracts(m: pytest.MonkeyPatch) -> None:
    m.setattr(distinguishable_values.Readers, "_add_reads_of_contracts", lambda *_: None)


def _first_field(m: pytest.MonkeyPatch) -> None:
    place = distinguishable_values.Readers._place_that_is_read

    def first(readers: distinguishable_values.Readers, e: object, scope: Scope) -> object:
        found = place(readers, e, scope)
        record = isinstance(e, typed.TopicRead) and isinstance(e.type, RecordType)
        return (found[0], (0,)) if found is not None and record else found

    m.setattr(distinguishable_values.Readers, "_place_that_is_read", first)


MISTAKES: dict[str, Patch] = {
    "a calculation counts for nothing": _overlooks(_arithmetic),
    "what is put into the state counts for nothing": _overlooks(_assignment),
    "a comparison with a field counts for nothing": _overlooks(_between_topics),
    "an index counts for nothing": _overlooks(lambda n: isinstance(n, typed.Index)),
    "an argument counts for nothing": _overlooks(lambda n: isinstance(n, typed.TypedCall)),
    "an argument of the prelude counts for nothing": _overlooks(
        lambda n: isinstance(n, typed.Builtin)
    ),
    **{f"{op} is forgotten": _forgets(op) for op in ("<", "<=", ">", ">=", "==", "!=")},
    "nothing between two constants": _not_between,
    "a constant on the left is taken for one on the right": _not_turned,
    "conditions of modules count for nothing": _no_modules,
    "contracts count for nothing": _no_contracts,
    "a record counts as its first field": _first_field,
}
TELLING = (37, 177, 135, 236, 155, 26, 2, 109, 2, 206, 76, 56, 2, 45, 104, 76, 301)
"""A program that each of them gets wrong."""


@all_rows(("mistake", "seed"), [*zip(MISTAKES, TELLING, strict=True)])
def test_a_mistake_in_what_is_told_apart_is_seen(
    mistake: str, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not differs(seed, monkeypatch)
    MISTAKES[mistake](monkeypatch)
    assert differs(seed, monkeypatch)
