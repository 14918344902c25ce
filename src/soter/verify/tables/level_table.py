"""What a DM holds of one group.

Purpose: what is asked of a table of levels, however it is read.
Non-goals: tables of cells (`tables.py`), half-spaces (`polytope_tables.py`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from soter.language.model.typed import FunSymbol, TypedExpr
    from soter.verify.problem.problem import Group, Problem
    from soter.verify.tables.typed_tree_builder import Writer


@dataclass(frozen=True, eq=False)
class EstimateSamples:
    """Estimates on which the compiled DM is tried.

    `points` (n, states); `surely` (n,): the level that each has; `least` (n,): the level that it
    must be given at least. `whole`: one for every cell that there is.
    """

    points: NDArray[np.float64]
    surely: NDArray[np.uint8]
    least: NDArray[np.uint8]
    whole: bool


class LevelTable(ABC):
    """Levels of estimates of a group: 0 (`ttf`), 1 (in S_0), 2 (in S_(m-2)).

    `states`: those that the DM sees, which the function takes in this order.
    """

    states: tuple[int, ...]
    two_levels = False
    """Whether there is no level 1."""

    @property
    @abstractmethod
    def ends(self) -> tuple[tuple[float, ...], ...]:
        """Per state the numbers between which inputs are told apart."""

    @abstractmethod
    def share(self, group: Group) -> float:
        """Share of the volume of its group's ranges that S_0 is, of estimates."""

    @property
    @abstractmethod
    def full(self) -> tuple[float, ...] | None:
        """A point of S_(m-2), well inside; None where there is none."""

    @property
    @abstractmethod
    def samples(self) -> EstimateSamples | None:
        """What to try the compiled function on; None where there is nothing to tell apart."""

    @abstractmethod
    def function(self, w: Writer, name: str) -> FunSymbol:
        """`fun level(x0: float, ...): int`: the level of an estimate."""

    def more(self, w: Writer, problem: Problem) -> list[TypedExpr]:
        """What it is read with beside an estimate."""
        del w, problem
        return []

    @abstractmethod
    def entry(self, names: Sequence[str], stem: str, files: dict[str, bytes]) -> dict[str, object]:
        """The table in a certificate; `names` of all states."""
