"""States that a proof leaves out, as nothing that is asked depends on them: how far along a road.

Purpose: `left_out`, of states that nothing bounds those that no rate of another one, no SC, no
predicate and no declared set reads.
Non-goals: whether a proof without them holds: what reads one all the same gets any number there.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.tree_walk import children, nodes
from soter.language.model.types import IntType
from soter.verify.enclose.c_emitter import EnclosureError
from soter.verify.enclose.compiled_enclosures import hint_of
from soter.verify.enclose.enclosure_code import generate_enclosures

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from soter.core.core import CoreSystem
    from soter.verify.problem.quantities import Leaf, Quantities
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


def left_out(
    at: VerificationSystem, core: CoreSystem, quantities: Quantities, boundless: Collection[int]
) -> tuple[frozenset[int], dict[str, str]]:
    """Of these states those without which the problem is the same one; of others who reads them.

    They have to have a solution for as long as there is a run: their rates grow no faster than they
    themselves do (Gronwall).
    """
    try:
        readers = {s: _readers(at, core, quantities, s) for s in boundless}
    except EnclosureError:
        return frozenset(), {}
    rates = {f"{MOVING}_{s}": s for s in boundless}
    found, states, read = set(boundless), quantities.states, {}
    while wanted := [s for s in found if any(rates.get(r) not in found for r in readers[s])]:
        for s in wanted:
            those = (r for r in readers[s] if rates.get(r) not in found)
            read[states[s].name] = in_words([*those], quantities)
        found -= {*wanted}
    leaves = [states[s] for s in found]
    ends = [leaf.name for leaf in leaves if not _goes_on(at, leaf, leaves)]
    if ends:
        return frozenset(), read | dict.fromkeys(ends, "its own rate, by which it may end")
    return frozenset(found), read


def in_words(readers: Collection[str], quantities: Quantities) -> str:
    """One of some functions of a proof."""
    reader = min(readers, key=lambda r: (r.startswith("constraint"), r))
    name, _, number = reader.rpartition("_")
    if name == MOVING:
        return f"the rate of `{quantities.states[int(number)].name}`"
    what = name if number.isdigit() else reader
    return {"law": "SC", "constraint": "what plants publish, which has to fit"}.get(
        what, f"`{what}`"
    )


def _readers(
    at: VerificationSystem, core: CoreSystem, quantities: Quantities, state: int
) -> frozenset[str]:
    """The functions of a proof that read a state; of rates each alone, by number."""
    hint, functions = hint_of(at.system, at.module)
    without = replace(
        quantities, states=tuple(x for s, x in enumerate(quantities.states) if s != state)
    )
    unit = generate_enclosures(
        at.system, core, at.module, without, core_hint=hint, hint_functions=functions, apart=True
    )
    numbers = [s for s in range(len(quantities.states)) if s != state]
    names = {f"{MOVING}_{k}": f"{MOVING}_{s}" for k, s in enumerate(numbers)}
    together = {MOVING, "drives"}  # what they say is in others
    return frozenset(names.get(name, name) for name in unit.boundless - together)


def _goes_on(at: VerificationSystem, leaf: Leaf, others: Collection[Leaf]) -> bool:
    """Whether a state without bounds does not end, whatever else it is moved by."""
    plant = at.system.components[leaf.owner].plant
    assert plant is not None
    named = {x.member for x in others if x.owner == leaf.owner}
    variables = [v for v in plant.states if v.name in named]
    lets = dict(plant.lets)
    rate = next((e for v, e in plant.der.items() if v.name == leaf.member), None)
    return rate is None or (_is_total(rate, lets) and _degree(rate, variables, lets) <= 1)


def _is_total(e: typed.TypedExpr, lets: Mapping[typed.Variable, typed.TypedExpr]) -> bool:
    """Whether an expression has a finite value whatever it reads, as far as that is seen."""
    if isinstance(e, typed.VarRead):
        return e.variable not in lets or _is_total(lets[e.variable], lets)
    if isinstance(e, typed.TopicRead) or not _reads(e):
        return True
    parts = _parts(e)
    divides = isinstance(e, (typed.TypedBinary, typed.Vector)) and e.op in ("/", "%")
    if isinstance(e.type, IntType) or (divides and _reads(parts[1])):
        return False
    known = (
        isinstance(e, SIMPLE)
        or (isinstance(e, typed.Index) and not _reads(e.index))
        or (isinstance(e, typed.TypedCall) and e.fun.prelude and e.fun.name in TOTAL)
        or (isinstance(e, typed.Builtin) and e.name in LARGEST_OF)
    )
    return known and all(_is_total(part, lets) for part in parts)


def _reads(e: typed.TypedExpr) -> bool:
    return any(isinstance(n, (typed.VarRead, typed.TopicRead)) for n in nodes([e]))


def _degree(
    e: typed.TypedExpr, of: Variables, lets: Mapping[typed.Variable, typed.TypedExpr]
) -> float:
    """A power of these variables beyond which an expression does not grow; inf: none is known."""
    if isinstance(e, typed.VarRead):
        return _degree(lets[e.variable], of, lets) if e.variable in lets else e.variable in of
    if not _reads(e):
        return 0
    of_parts = [_degree(part, of, lets) for part in _parts(e)]
    if not any(of_parts):
        return 0
    if isinstance(e, (typed.TypedBinary, typed.Vector)) and e.op in ("*", "/"):
        left, right = of_parts
        return left + right if e.op == "*" else left if not right else inf
    if isinstance(e, typed.TypedCall) and e.fun.prelude:
        return 0 if e.fun.name in BOUNDED else max(of_parts) if e.fun.name == "clamp" else inf
    if isinstance(e, typed.Conditional):
        return max(of_parts[1:])
    grows_as_its_parts = (
        isinstance(e, (typed.TypedUnary, typed.TypedField, typed.Index, typed.Aggregate))
        or (isinstance(e, (typed.TypedBinary, typed.Vector)) and e.op in ("+", "-"))
        or (isinstance(e, typed.Builtin) and e.name in LARGEST_OF)
    )
    return max(of_parts) if grows_as_its_parts else inf


def _parts(e: typed.TypedExpr) -> list[typed.TypedExpr]:
    return [x for x in children(e) if isinstance(x, typed.TypedExpr)]
