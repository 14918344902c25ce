"""The interface of a method of proof by sets: a group of states, and the claims about it.

Purpose: the states of a module fall into groups. A `Group` holds the sets of one group that stand
in a certificate; its `GroupCheck` shows the claims about them for one combination of parameter
values, as `case_check.py` asks for them. `grid/` and `polytope/` implement both.
Non-goals: which methods there are (`proof_methods.py`), which claims are made (`case_check.py`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import wraps
from typing import TYPE_CHECKING, Any, ClassVar, ParamSpec

from soter.certificate.report import NotRecheckedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray
    from typing_extensions import Self

    from soter.certificate.cell_sets import Axes, Cells
    from soter.certificate.folder import Certificate
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.report import RecheckedModule
    from soter.language.model import typed

    Entry = dict[str, Any]
    """A part of a manifest."""
    Extents = tuple[tuple[float, float], ...]
    Task = tuple[Callable[[], str], float]
    """A function that shows a part of a claim, and gives "", or what went wrong; and what that is
    likely to cost, in holds of one cell, for the progress alone."""

P = ParamSpec("P")
LOOK = 0.05
"""The cost of looking at a cell, where following it for one hold costs 1."""


class Group(ABC):
    """One group of states and its sets; RejectedError, NotRecheckedError where these are wrong."""

    kind: ClassVar[str]
    """The name of such a group in a manifest."""
    required: ClassVar[tuple[str, ...]]
    optional: ClassVar[tuple[str, ...]]
    states: tuple[int, ...]

    @classmethod
    @abstractmethod
    def read(cls, certificate: Certificate, facts: Facts, entry: Entry, axes: Axes) -> Self:
        """The group of an entry; `axes` span the ranges of its states."""

    @property
    def cells(self) -> list[NDArray[np.uint8]]:
        """The tables of K, shaped as the grid; none where K is no set of cells."""
        return []

    @abstractmethod
    def cells_asked(self, *, errors: bool) -> Axes:
        """The cells on which `safe` is asked; with `errors` those for `safer`, of all estimates."""

    @abstractmethod
    def check(self, model: CaseModel, lawful: Cells | None) -> GroupCheck:
        """The check of its claims; `lawful`: what `cells_kept_by_law` gives, None without a law."""

    @abstractmethod
    def compare(
        self, certificate: Certificate, facts: Facts, same: Sequence[Any], entry: Entry
    ) -> None:
        """Compare the DM's table (`entry`) with this group's sets; RejectedError where it differs.

        `same`: this group in all cases.
        """

    def cells_kept_by_law(self, law: Sequence[Group]) -> Cells:
        """K_fs, which the fail-safe law keeps, on this group's cells; `law`: the law's groups."""
        del law
        raise NotRecheckedError(f"a fail-safe law on {self.kind}s is not rechecked")

    @abstractmethod
    def add_size_to(self, report: RecheckedModule) -> None:
        """Add to a report how large K is."""

    @property
    @abstractmethod
    def why_no_entry(self) -> str:
        """Why `where_entered_outside` cannot be asked of this group; "": it can."""

    def where_entered_outside(self, model: CaseModel, expr: typed.TypedExpr) -> str:
        """Where `expr` may hold of an estimate of a state outside R(H); "": nowhere."""
        raise NotImplementedError

    @abstractmethod
    def why_ac_never(self, drawn: Iterator[NDArray[np.float64]]) -> tuple[str, str]:
        """(why the DM's table never gives or leaves AC control, why that was not looked at), or "".

        `drawn`: points of this group's K, one number a state; none where none is known.
        """

    @abstractmethod
    def random_points(self, facts: Facts, chance: np.random.Generator) -> Iterator[Any]:
        """Random points of its K, one number a state, without end; none where none is known."""


class GroupCheck(ABC):
    """The claims about a group, in the order in which they are asked, each where it is claimed.

    RejectedError, NotRecheckedError where one does not hold. What takes long is left to tasks,
    which may run in other processes.
    """

    @property
    def shows_rates_defined(self) -> bool:
        """Whether its tasks show what makes rates defined, where that is about its states."""
        return False

    @abstractmethod
    def prepare(self, claims: set[str]) -> None:
        """Make ready what these claims need, and look at a few cells for what is not understood.

        Nothing is shown by it.
        """

    @abstractmethod
    def note_safe_cells(self, cells: Cells) -> None:
        """Note that `safe` is certain on these of `Group.cells_asked`: SC must stay in them."""

    @abstractmethod
    def stays_in_topic_set(self, topic: int, cells: Cells, checks: Sequence[GroupCheck]) -> bool:
        """Whether what plants publish, of all states that SC keeps, is surely in the declared set.

        It is so on these `cells` of `Group.cells_asked`. `checks`: those of all groups.
        """

    @abstractmethod
    def show_core(self) -> Iterable[Task]:
        """Tasks for P2a: from each state of K SC keeps `safe`, and leads back to K."""

    @abstractmethod
    def show_free(self, horizon_ns: int) -> Iterable[Task]:
        """Tasks for R(H): no command leads from it out of K within H."""

    @abstractmethod
    def show_predicate(self, name: str, expr: typed.TypedExpr, *, admits: bool) -> Iterable[Task]:
        """Tasks for P3 of a predicate: where it may be `admits` on an estimate, R has the state."""

    @abstractmethod
    def show_levels(self, between_ns: int) -> Iterable[Task]:
        """Tasks for the sets S of computed predicates: `ttf` outside S_0, `safer` in S_(m-2)."""

    @property
    @abstractmethod
    def holds_to_return(self) -> int:
        """The number of holds of SC that suffices to come to Q."""

    @abstractmethod
    def show_return(self, calm: Cells | None) -> Iterable[Task]:
        """Tasks for P2b: Q is kept where `safer` holds, and SC leads there from all of K.

        `calm`: those of `cells_asked` on which `safer` is certain; None: what the DM holds says so.
        """

    @abstractmethod
    def show_start(self, until_ns: int) -> Iterable[Task]:
        """Tasks for `start`: declared initial states stay in K until then, whatever acts."""


def whole(show: Callable[P, None]) -> Callable[P, list[Task]]:
    """A decorator: what `show` shows at once, or raises, becomes a claim of one task."""

    @wraps(show)
    def claim(*given: P.args, **named: P.kwargs) -> list[Task]:
        def answer() -> str:
            show(*given, **named)
            return ""

        return [(answer, LOOK)]

    return claim
