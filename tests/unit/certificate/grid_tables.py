"""A line of four cells, tables on it, and a check of them without a model of its own."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.cell_sets import Cells, Grid
from soter.certificate.extras.left_out_states import GridBeyondEnds
from soter.certificate.grid.grid_group import (
    GridCheck,
)
from soter.certificate.grid.group_claims import (
    GroupTables,
)
from soter.certificate.report import RejectedError

if TYPE_CHECKING:
    from collections.abc import Callable


def grid_beyond(
    edges: tuple[tuple[float, ...], ...],
    unbounded: tuple[bool, ...] = (),
    wraps: tuple[bool, ...] = (),
) -> GridBeyondEnds:
    """A grid some axes of which have no ends or wrap around: those of which that is said."""
    no = (False,) * len(edges)
    return GridBeyondEnds(edges, unbounded or no, wraps or no)


LINE = Grid(((0.0, 1.0, 2.0, 3.0, 4.0),))
Flags = list[int]


def bools(*flags: int) -> Any:
    return np.array(flags, dtype=np.bool_)


def tables(core: Flags, **more: Any) -> GroupTables:
    return GroupTables((0,), LINE, np.array(core, dtype=np.uint8), **more)


def check_of(group: GroupTables, *, kept: bool = False, **facts: Any) -> Any:
    check: Any = object.__new__(GridCheck)
    state = SimpleNamespace(low=1.0, high=2.0, name="x")
    known = {"states": [state], "levels": 3, "symbol": SimpleNamespace(shield=None)} | facts
    check.model = SimpleNamespace(facts=SimpleNamespace(**known))
    check.tables, check.grid, check.kept = group, group.grid, kept
    check.kernel = Cells(group.grid, group.core > 0)
    check.allowed = np.ones(group.grid.shape, dtype=np.bool_)
    check.lawful = None
    check.chains, check.chain_checks = None, []
    return check


def fails(made: Callable[[], Any]) -> str:
    """What is said where it is rejected, else nothing."""
    try:
        list(made())
    except RejectedError as error:
        return str(error)
    return ""
