"""Whether the compiled decision module of a case is the switching logic, tried now.

Purpose: `compiled_as_proved`: the check of `soter verify`, row DM, once more; where `ttf` and
`safer` are computed with the tables of the certificate, which the re-checker has confirmed.
Non-goals: the check (`verify/deploy/dm_check.py`); what it does not try supports nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import SoterError
from soter.language.elaborate.derived_systems import faultless
from soter.language.elaborate.views import systems_by_view
from soter.language.model import typed
from soter.language.model.tree_walk import nodes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.certificate.format.folder import Certificate
    from soter.language.model.system import Module, System
    from soter.verify.problem.problem import Problem
    from soter.verify.tables.grid_tables import GroupTable

UNTRIED = (typed.AgeRead, typed.ModeRead)
"""What the check gives no values to."""


def compiled_as_proved(
    flat: System, module: Module, entries: Sequence[dict[str, Any]], certificate: Certificate
) -> tuple[str, str, bool]:
    """What was tried, why that is not enough ("": it is), and whether the C differs.

    `flat`: as it is declared; `entries`: what the certificate has of the module, a view each.
    """
    from soter.verify.deploy.dm_check import check_problem  # noqa: PLC0415 - compiles
    from soter.verify.problem.extract import extract  # noqa: PLC0415 - needs NumPy

    symbol = module.symbol
    read = nodes([e for e in (symbol.ttf, symbol.safer) if e is not None])
    if any(isinstance(n, UNTRIED) for n in read):
        return "", "not tried: `ttf` or `safer` reads an age, or a mode", False
    said = ""
    try:
        for system, seen in systems_by_view(faultless(flat), module):
            problem = extract(system, seen)
            tables = _tables(problem, entries, certificate) if problem.computed else []
            if problem.computed and not tables:
                return "", "not tried: its tables are not those of grids", False
            check = check_problem(problem, tables)
            if check.failures:
                return "", check.text, True
            said = check.text
    except (SoterError, NotImplementedError) as error:
        return "", f"not tried: {error}", False
    return said, "", False


def _tables(
    problem: Problem, entries: Sequence[dict[str, Any]], certificate: Certificate
) -> list[GroupTable]:
    """The tables of the DM that the certificate has, which the re-checker compared with its sets.

    None where one of them is no table of cells, or there is no such view.
    """
    import numpy as np  # noqa: PLC0415 - only then

    from soter.verify.tables.grid_tables import PER_BYTE, GroupTable  # noqa: PLC0415 - needs NumPy

    entry = next((e for e in entries if e.get("view", "") == problem.view), None)
    if entry is None:
        return []
    numbers = {s.name: i for i, s in enumerate(problem.quantities.states)}
    tables = []
    for each in entry["tables"]:
        if each.keys() != {"axes", "levels"}:
            return []
        edges = [certificate.edges(a["edges"]) for a in each["axes"]]
        shape = tuple(len(e) - 1 for e in edges)
        packed = np.frombuffer(certificate.plain(each["levels"]), dtype=np.uint8)
        four = (packed[:, None] >> (2 * np.arange(PER_BYTE, dtype=np.uint8))) & 3
        cells = four.ravel()[: int(np.prod(shape))].reshape(shape)
        states = tuple(numbers[a["state"]] for a in each["axes"])
        tables.append(GroupTable(states, tuple(edges), np.ascontiguousarray(cells)))
    return tables
