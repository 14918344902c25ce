"""What a proof takes for granted, who guarantees it, and what it is about, as values.

Purpose: `Assumption`, and those that every proof says alike; `remaining`: what is left of a
problem's assumptions once a proof has shown some of them and added others. Nothing is ever taken
out of a list, and nothing by its wording. `VerificationScope` and `ScopeGuarantee`, of which
reports are made.
Non-goals: which assumptions there are (`assumptions.py`, `induction/problem.py`); finding out what
a verification is about (`verify/scope.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable

    from soter.language.model.typed import ModuleSymbol
    from soter.language.model.types import Value


@dataclass(frozen=True)
class Assumption:
    """`key`: what it is about, the same for the same thing in every proof; `text`: in words."""

    key: str
    text: str


SCHEME = Assumption(
    "scheme",
    "the plant is the only solution of its differential equation (where the right-hand side jumps: "
    "with any rate between those on both sides); not the simulator's scheme",
)
"""Of a proof that is about the differential equation alone."""
EVERY_SOLUTION = Assumption(
    SCHEME.key,
    "the plant is any absolutely continuous solution of its differential equation, with any rate "
    "between those on both sides where its right-hand side jumps; not the simulator's scheme",
)
"""Of such a proof that does not rest on solutions being unique, as where SC comes to rest."""
FRESH = Assumption("fresh", "P2b: what the DM reads is fresh, and no gate fault keeps AC out")


def of_latch(module: ModuleSymbol) -> list[Assumption]:
    """That the operator acknowledges, where only then the DM gives control back."""
    return [
        Assumption(
            f"acknowledged {topic.name}",
            f"P2b: the operator acknowledges: a press of {topic.name} is in force when `safer` "
            "holds; without one SC keeps control",
        )
        for topic in module.acknowledgements
    ]


def remaining(
    before: Iterable[Assumption], *, added: Iterable[Assumption], shown: Collection[str]
) -> tuple[Assumption, ...]:
    """The assumptions of a problem but for those whose keys were `shown`, and the `added` ones.

    KeyError where one was shown that nobody had made, or whose key several have: then it is not
    known which of them was meant.
    """
    before = tuple(dict.fromkeys(before))
    keys = [a.key for a in before]
    unclear = [key for key in shown if keys.count(key) != 1]
    if unclear:
        raise KeyError(", ".join(sorted(unclear)))
    return tuple(dict.fromkeys((*(a for a in before if a.key not in shown), *added)))


def texts(assumptions: Iterable[Assumption]) -> list[str]:
    """In words, each once."""
    return list(dict.fromkeys(a.text for a in assumptions))


@dataclass(frozen=True)
class ScopeGuarantee:
    """What a module takes for granted of somebody else, and why it may.

    `how`: "enforced" (the language lets no other value arrive), "declared" (a range of the world,
    printed as an assumption), "guaranteed" (a part of the `safe` of the module `by`, if that is
    proved), "published" (the proof of the module `by` is about the plant that drives it, if that is
    proved) or "assumed".
    """

    module: str
    what: str
    by: str
    how: str


@dataclass(frozen=True)
class VerificationScope:
    """`also`: modules of other systems that pose the same problem; `rest`: what is not covered."""

    also: tuple[str, ...] = ()
    rest: tuple[str, ...] = ()
    params: tuple[tuple[str, Value], ...] = ()
    """Every parameter of the program with the value that this is about."""
    guarantees: tuple[ScopeGuarantee, ...] = ()
