"""States that a proof can leave out.

Purpose: `states_to_leave_out` finds, of the states that nothing bounds (such as how far along a
road), those that no rate of another state, no SC, no predicate and no declared set reads. For each
of the other states it names a reader.
Non-goals: whether a proof without them holds (whoever still reads a left out state gets any
number).
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.tree_walk import children, nodes
from soter.language.model.types import IntType
from soter.verify.enclose.compiled_enclosures import generate_enclosures
from soter.verify.enclose.enclosure_emitter import EnclosureError

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from soter.core.core import CoreSystem
    from soter.verify.problem.problem import Leaf, Quantities
    from soter.verify.problem.verification_system import VerificationSystem

    Variables = Collection[typed.Variable]


BOUNDED = frozenset({"sin", "cos", "tanh", "atan"})
TOTAL = BOUNDED | {"clamp"}
LARGEST_OF = frozenset({"abs", "min", "max", "saturate", "norm"})
SIMPLE = (
    *(typed.TypedUnary, typed.TypedBinary, typed.Vector, typed.Conditional),
    *(typed.TypedField, typed.Aggregate),
)
MOVING = "derivative"


def states_to_leave_out(
    at: VerificationSystem, core: CoreSystem, quantities: Quantities, boundless: Collection[int]
) -> tuple[frozenset[int], dict[str, str]]:
    """The states of `boundless` that can be left out; for each other one, by name, who reads it.

    A state that is left out needs a solution that lasts as long as a run, so its rate may grow no
    faster than the states that are left out (Gronwall).
    """
    try:
        readers = {s: _functions_that_read(at, core, quantities, s) for s in boundless}
    except EnclosureError:
        return frozenset(), {}
    rates = {f"{MOVING}_{s}": s for s in boundless}
    found, states, read = set(boundless), quantities.states, {}
    while wanted := [s for s in found if any(rates.get(r) not in found for r in readers[s])]:
        for s in wanted:
            those = (r for r in readers[s] if rates.get(r) not in found)
            read[states[s].name] = reader_in_words([*those], quantities)
        found -= {*wanted}
    leaves = [states[s] for s in found]
    ends = [leaf.name for leaf in leaves if not _has_unlimited_solution(at, leaf, leaves)]
    if ends:
        return frozenset(), read | dict.fromkeys(ends, "its own rate, by which it may end")
    return frozenset(found), read


def reader_in_words(readers: Collection[str], quantities: Quantities) -> str:
    """The name, in words, of one of these functions of a proof, which read the same state."""
    reader = min(readers, key=lambda r: (r.startswith("constraint"), r))
    name, _, number = reader.rpartition("_")
    if name == MOVING:
        return f"the rate of `{quantities.states[int(number)].name}`"
    text = name if number.isdigit() else reader
    return {"law": "SC", "constraint": "what plants publish, which has to fit"}.get(
        text, f"`{text}`"
    )


def _functions_that_read(
    at: VerificationSystem, core: CoreSystem, quantities: Quantities, state: int
) -> frozenset[str]:
    """The names of a proof's functions that read a state; each state's rate is such a function."""
    without = replace(
        quantities, states=tuple(x for s, x in enumerate(quantities.states) if s != state)
    )
    unit = generate_enclosures(at.system, core, at.module, without, apart=True)
    numbers = [s for s in range(len(quantities.states)) if s != state]
    names = {f"{MOVING}_{k}": f"{MOVING}_{s}" for k, s in enumerate(numbers)}
    together = {MOVING, "drives"}  # other functions of the proof read the same
    return frozenset(names.get(name, name) for name in unit.boundless - together)


def _has_unlimited_solution(at: VerificationSystem, leaf: Leaf, others: Collection[Leaf]) -> bool:
    """Whether an unbounded state has a solution for all time, with any values of what it reads."""
    plant = at.system.components[leaf.owner].plant
    assert plant is not None
    named = {x.member for x in others if x.owner == leaf.owner}
    variables = [v for v in plant.states if v.name in named]
    lets = dict(plant.lets)
    rate = next((e for v, e in plant.der.items() if v.name == leaf.member), None)
    return rate is None or (
        _is_finite(rate, lets) and _degree_of_growth(rate, variables, lets) <= 1
    )


def _is_finite(e: typed.TypedExpr, lets: Mapping[typed.Variable, typed.TypedExpr]) -> bool:
    """Whether an expression is certainly finite if all values that it reads are finite."""
    if isinstance(e, typed.VarRead):
        return e.variable not in lets or _is_finite(lets[e.variable], lets)
    if isinstance(e, typed.TopicRead) or not _reads_anything(e):
        return True
    parts = _subexpressions(e)
    divides = isinstance(e, (typed.TypedBinary, typed.Vector)) and e.op in ("/", "%")
    if isinstance(e.type, IntType) or (divides and _reads_anything(parts[1])):
        return False
    return _is_finite_if_parts_are(e) and all(_is_finite(part, lets) for part in parts)


def _is_finite_if_parts_are(e: typed.TypedExpr) -> bool:
    if isinstance(e, typed.Index):
        return not _reads_anything(e.index)
    if isinstance(e, typed.TypedCall):
        return e.fun.prelude and e.fun.name in TOTAL
    if isinstance(e, typed.Builtin):
        return e.name in LARGEST_OF
    return isinstance(e, SIMPLE)


def _reads_anything(e: typed.TypedExpr) -> bool:
    return any(isinstance(n, (typed.VarRead, typed.TopicRead)) for n in nodes([e]))


def _degree_of_growth(
    e: typed.TypedExpr, grown: Variables, lets: Mapping[typed.Variable, typed.TypedExpr]
) -> float:
    """The highest power of these variables by which `e` may grow; inf if no power is known."""
    if isinstance(e, typed.VarRead):
        return (
            _degree_of_growth(lets[e.variable], grown, lets)
            if e.variable in lets
            else e.variable in grown
        )
    if not _reads_anything(e):
        return 0
    of_parts = [_degree_of_growth(part, grown, lets) for part in _subexpressions(e)]
    if not any(of_parts):
        return 0
    if isinstance(e, (typed.TypedBinary, typed.Vector)) and e.op in ("*", "/"):
        left, right = of_parts
        return left + right if e.op == "*" else left if not right else inf
    if isinstance(e, typed.TypedCall) and e.fun.prelude:
        return {**dict.fromkeys(BOUNDED, 0), "clamp": max(of_parts)}.get(e.fun.name, inf)
    if isinstance(e, typed.Conditional):
        return max(of_parts[1:])
    return max(of_parts) if _grows_as_its_parts_do(e) else inf


def _grows_as_its_parts_do(e: typed.TypedExpr) -> bool:
    if isinstance(e, (typed.TypedBinary, typed.Vector)):
        return e.op in ("+", "-")
    if isinstance(e, typed.Builtin):
        return e.name in LARGEST_OF
    return isinstance(e, (typed.TypedUnary, typed.TypedField, typed.Index, typed.Aggregate))


def _subexpressions(e: typed.TypedExpr) -> list[typed.TypedExpr]:
    return [x for x in children(e) if isinstance(x, typed.TypedExpr)]
