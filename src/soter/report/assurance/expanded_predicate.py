"""A predicate of a module as people read it who do not read the program, as plain data.

Purpose: `ExpandedPredicate`, from the expansion to the page and the machine-readable case.
Non-goals: expanding it (`api/assurance/predicate_expansion.py`).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

MEANINGS = {
    "safe": "What is to hold: the safety property of the module",
    "ttf": "Where it is true the RTA switch takes control from the complex function",
    "safer": "Where it is true the RTA switch may give control back to the complex function",
}


@dataclass(frozen=True)
class Definition:
    """A name of an expansion with its expression or value; `unit` where one is declared."""

    name: str
    text: str
    unit: str = ""


@dataclass(frozen=True)
class ExpandedPredicate:
    """`safe`, `ttf` or `safer` of a module, with its functions inlined.

    `written`: as the program says it, "" where it is computed. `where`: parts of `expanded` that
    have a name, each after those that it reads. `read`: what it reads of topics. `functions`: the
    text of what stays a call, as a loop, an assignment or an extern is no expression.
    """

    module: str
    name: str
    written: str
    expanded: str = ""
    where: tuple[Definition, ...] = ()
    constants: tuple[Definition, ...] = ()
    read: tuple[Definition, ...] = ()
    functions: tuple[Definition, ...] = ()

    def to_json(self) -> dict[str, object]:
        """As in docs/json.md."""
        return asdict(self)
