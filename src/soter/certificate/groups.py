"""What is asked of a method of proof: of a group of states, and of its claims.

Purpose: `Group`: one group with its sets as a certificate has them; `GroupCheck`: its claims under
one combination of parameter values.
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
    """What shows a part of a claim: "", or what went wrong. And what that is likely to cost, in
    holds of one cell: for the progress alone."""

P = ParamSpec("P")
LOOK = 0.05
"""What looking at a cell costs, beside following it for one hold."""


class Group(ABC):
    """One group of states; RejectedError, NotRecheckedError where its sets cannot be."""

    kind: ClassVar[str]
    """What a manifest calls such a group."""
    required: ClassVar[tuple[str, ...]]
    optional: ClassVar[tuple[str, ...]]
    states: tuple[int, ...]

    @classmethod
    @abstractmethod
    def read(cls, certificate: Certificate, facts: Facts, entry: Entry, axes: Axes) -> Self:
        """The group of an entry; `axes` span the ranges of its states."""

    @property
    def cells(self) -> list[NDArray[np.uint8]]:
        """Tables of K, where it is a set of cells, shaped as the grid."""
        return []

    @abstractmethod
    def part(self, *, errors: bool) -> Axes:
        """The cells on which `safe` is asked; with `errors` those for `safer`, of all estimates."""

    @abstractmethod
    def check(self, model: CaseModel, lawful: Cells | None) -> GroupCheck:
        """What shows its claims; `lawful`: what `kept_by` gave."""

    @abstractmethod
    def compare(
        self, certificate: Certificate, facts: Facts, same: Sequence[Any], entry: Entry
    ) -> None:
        """RejectedError where what the DM holds (`entry`) lets AC keep or get control otherwise.

        `same`: this group in all cases.
        """

    def kept_by(self, law: Sequence[Group]) -> Cells:
        """K_fs on the cells of this group; `law`: the groups of the law."""
        del law
        raise NotRecheckedError(f"a fail-safe law on {self.kind}s is not rechecked")

    @abstractmethod
    def tell(self, report: RecheckedModule) -> None:
        """Add to a report how large K is."""

    @property
    @abstractmethod
    def unentered(self) -> str:
        """Why hand-overs into its R(H) are not looked at; "": they are."""

    def entered(self, model: CaseModel, expr: typed.TypedExpr) -> str:
        """Where `expr` may hold of an estimate of a state outside R(H); "": nowhere."""
        raise NotImplementedError

    @abstractmethod
    def never(self, drawn: Iterator[NDArray[np.float64]]) -> tuple[str, str]:
        """Why AC has, or keeps, no control by what the DM holds; why that was not looked at; or "".

        `drawn`: numbers, one a state, in K as for this group; none where none is known.
        """

    @abstractmethod
    def drawn(self, facts: Facts, chance: np.random.Generator) -> Iterator[Any]:
        """Numbers, its part of states of K, without end; none where none is known."""


class GroupCheck(ABC):
    """The claims about a group, in the order in which they are asked, each where it is claimed.

    RejectedError, NotRecheckedError where one does not hold. What takes long is left to tasks,
    which may run in other processes.
    """

    @property
    def sees_rates(self) -> bool:
        """Whether its tasks show that rates are defined, as far as they hang on its states."""
        return False

    @abstractmethod
    def tried(self, claims: set[str]) -> None:
        """Make ready what these claims need, and look at a few cells: for what is not understood.

        Nothing is shown by it.
        """

    @abstractmethod
    def safe(self, cells: Cells) -> None:
        """`safe` is certain on those cells of `Group.part`: SC has to keep K there."""

    @abstractmethod
    def published(self, topic: int, cells: Cells, checks: Sequence[GroupCheck]) -> bool:
        """Whether all that is published of states that SC keeps is surely in the declared set.

        It is so of those cells of `Group.part`. `checks`: of all groups.
        """

    @abstractmethod
    def core(self) -> Iterable[Task]:
        """K: SC keeps `safe` from it, and leads back to it."""

    @abstractmethod
    def free(self, horizon_ns: int) -> Iterable[Task]:
        """R(H): nothing leads out of K within H."""

    @abstractmethod
    def admits(self, name: str, expr: typed.TypedExpr, *, admits: bool) -> Iterable[Task]:
        """Where a predicate may be `admits` on an estimate, the state is in R(H)."""

    @abstractmethod
    def levels(self, between_ns: int) -> Iterable[Task]:
        """Computed predicates: ttf is not S_0, safer is S_(m-2)."""

    @property
    @abstractmethod
    def holds(self) -> int:
        """For how many holds of SC it may take to come back."""

    @abstractmethod
    def home(self, calm: Cells | None) -> Iterable[Task]:
        """P2b: Q is kept where `safer` holds, and SC leads there from all of K.

        `calm`: the cells of `part` for it; None: what the DM holds says so.
        """

    @abstractmethod
    def start(self, until_ns: int) -> Iterable[Task]:
        """The declared initial states stay in K until then, whatever acts."""


def whole(show: Callable[P, None]) -> Callable[P, list[Task]]:
    """A claim that one task shows as a whole, or raises."""

    @wraps(show)
    def claim(*given: P.args, **named: P.kwargs) -> list[Task]:
        def answer() -> str:
            show(*given, **named)
            return ""

        return [(answer, LOOK)]

    return claim
