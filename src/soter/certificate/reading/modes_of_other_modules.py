"""Modes of other modules, as the re-checker reads them.

Purpose: who decides them is no part of a certificate: a step of SC is read once for each
combination of them, a predicate with each of them open.
Non-goals: what a module waits for (P2b is not claimed of one that waits); sharing code with
`verify/problem/modes_of_other_modules.py`, which reads topics in their place.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

from soter.certificate.reading.symbolic_values import whole
from soter.certificate.terms.arb_balls import ONE, ZERO
from soter.certificate.terms.terms import NotRecheckedError
from soter.language.model import typed
from soter.language.model.tree_walk import nodes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.report import Said
    from soter.certificate.terms.terms import Terms

    Key = typed.ModuleSymbol | str

MODES_MAX = 4
"""So many modules may SC look at: its step is read for every combination."""


def modes_in(code: Sequence[object]) -> list[Key]:
    """Modules whose mode is read."""
    modules = [
        n.module for n in nodes([x for x in code if x is not None]) if isinstance(n, typed.ModeRead)
    ]
    return list(dict.fromkeys(modules))


def every_mode(code: Sequence[object]) -> Iterator[dict[Key, int]]:
    """Every combination of the modes that a step reads; one empty one where it reads none.

    NotRecheckedError where there are too many.
    """
    keys = modes_in(code)
    if len(keys) > MODES_MAX:
        raise NotRecheckedError(f"SC looks at the modes of more than {MODES_MAX} modules")
    for values in product((0, 1), repeat=len(keys)):
        yield dict(zip(keys, values, strict=True))


def any_mode(terms: Terms, code: Sequence[object]) -> dict[Key, Any]:
    """A new input for every mode that is read: 0 or 1, and nothing more is known of it."""
    return {key: whole(terms.input("box", "mode", ZERO, ONE)) for key in modes_in(code)}


def only_modes_of_others(facts: Facts) -> None:
    """`NotRecheckedError` where the module's own mode is read, an unknown one, or one in `safe`.

    Asked where the module flies: symbols of a view, or of an abstraction, are others.
    """
    flying, module = facts.flying, facts.flying_module
    sc = flying.components[module.sc]
    assert sc.node is not None
    symbol = facts.symbol
    other = [e for e in symbol.predicates if e is not symbol.ttf and e is not symbol.safer]
    if modes_in(other):
        raise NotRecheckedError("`mode` in another predicate than `ttf` and `safer`")
    asked = [(sc.scope, key) for key in modes_in(sc.node.step)]
    asked += [(module.scope, key) for key in modes_in([symbol.ttf, symbol.safer])]
    for scope, key in asked:
        if scope.modules.get(key, module.index) == module.index:
            raise NotRecheckedError("the module's own mode, or that of an unknown one")


def assumed(facts: Facts) -> Said:
    """Of the modules whose modes SC, `ttf` or `safer` read; and of those that `safer` reads."""
    flying, module = facts.flying, facts.flying_module
    sc = flying.components[module.sc]
    assert sc.node is not None
    waited = {module.scope.modules[k] for k in modes_in([facts.symbol.safer])}
    read = {sc.scope.modules[k] for k in modes_in(sc.node.step)}
    read |= {module.scope.modules[k] for k in modes_in([facts.symbol.ttf])}
    for name in (flying.modules[i].name for i in sorted(read | waited)):
        yield f"mode {name}", f"mode({name}): SC or AC, anew at every step that reads it"
    for name in (flying.modules[i].name for i in sorted(waited)):
        text = f"nothing is confirmed of P2b: `safer` waits until {name} is in AC"
        yield f"waits {name}", text
