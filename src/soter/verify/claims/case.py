"""One combination of parameter values under way, what fails of its claims, and methods of proof.

Purpose: `Case` and `Failure`, which every claim reads and enters into; `GroupProof`, what is asked
of the proof of one group; `Method`, what is asked of a way to prove groups.
Non-goals: the claims (`claims.py`); which methods there are (`verify/proof_methods.py`).

The callers ask the groups in turn, claim by claim, in the order of docs/verification.md, section 3:
C, K, R(H), then the inclusions of `ttf` and `safer` or their levels, the start, the way back. What
a group cannot show it enters as a failure. Whatever else is asked has an answer for groups to which
it does not apply.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from soter.diagnostics.current_phase import phase, share_done
from soter.verify.claims.results import NO_CORE, REGIONS_SHOWN, CaseSets, GroupResult

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from soter.certificate.folder import Certificate
    from soter.core.layout import Bools, Floats
    from soter.verify.claims.product_sets import FailsafeClaim, SetFactor
    from soter.verify.claims.results import ModuleResult, Region
    from soter.verify.deploy.level_table import LevelTable
    from soter.verify.enclose.compiled_enclosures import CompiledEnclosures
    from soter.verify.problem.problem import Group, Problem


class GroupProof(GroupResult):
    """The proof of one group under one combination of parameter values.

    Those of the claims in the middle are asked only where it is `fresh` and every group has a K.
    """

    fresh: bool
    """Still to be computed; otherwise it is that of an earlier attempt."""
    return_ns = 0
    """The longest time from K to Q, where P2b was shown."""

    # ------------------------------------------------------------ claims

    @abstractmethod
    def take(self, case: Case, part: SetFactor) -> None:
        """C_g. A group that is not fresh and finds another one than before is fresh again."""

    @abstractmethod
    def core(self, case: Case) -> bool:
        """K; False where there is none."""

    @abstractmethod
    def free_phase(self, case: Case) -> None:
        """R(H)."""

    @abstractmethod
    def inclusion(self, case: Case, predicate: str) -> None:
        """`ttf` or `safer`: an estimate from which AC may have control comes from R(H)."""

    def entered(self, case: Case) -> str:
        """Why `enters` of an estimate does not show that the state lies in R(H); "": it does."""
        del case
        return f"its {self.group.representation} is not looked at"

    @abstractmethod
    def levels(self, case: Case) -> None:
        """S_0 ... S_(m-2) of estimates, where predicates are computed."""

    def without_levels(self) -> GroupProof | None:
        """Another one with its C, K and R(H) and nothing more; None where there is none."""
        return None

    @abstractmethod
    def admit(self, case: Case, table: LevelTable) -> None:
        """What the DM holds of the levels of all cases; a failure where that is nothing."""

    def withheld(self, case: Case) -> bool:
        """Whether its levels are there, but were not proved."""
        del case
        return False

    @abstractmethod
    def start(self, case: Case, until_ns: int) -> None:
        """The initial states lie in R(`until_ns`). Asked of groups that are not fresh, too."""

    @abstractmethod
    def held(self, case: Case) -> SetFactor | None:
        """States whose every estimate the DM gives back by its table; None: it has none."""

    @abstractmethod
    def recover(self, case: Case, target: SetFactor) -> None:
        """Q, inside a target, and the way there. Asked of groups that are not fresh, too."""

    # ------------------------------------------------------------ after a failure

    @property
    def stuck(self) -> float:
        """Share of K from which no way back was found."""
        return 0.0

    @property
    def core_cells(self) -> int:
        """Cells of K, where it has cells."""
        return 0

    def give_up(self, case: Case) -> None:
        """Leave those states out of K."""

    def regions(self, cells: Bools, parameters: Sequence[tuple[str, int]]) -> list[Region]:
        """Where cells of a failure lie, a set of the grid's shape."""
        del cells, parameters
        return []

    # ------------------------------------------------------------ what the proof covers

    @property
    def covers_scheme(self) -> bool:
        """Whether the simulator's steps are solutions of its model."""
        return False

    @property
    def together(self) -> tuple[int, ...]:
        """Controls that are taken to begin to act at one instant."""
        return ()

    # ------------------------------------------------------------ how much it says

    @abstractmethod
    def shares(self, case: Case) -> dict[str, float]:
        """Shares of its ranges that `core`, `free`, `lets_ac`, `gives_back` are, where known."""

    @abstractmethod
    def drawn(self, chance: np.random.Generator, count: int) -> Floats:
        """States of K, (count, axes)."""

    @property
    def estimates(self) -> Mapping[int, tuple[float, float]]:
        """State -> the range that states of C have, where that is less than all."""
        return {}

    @property
    def core_share(self) -> float | None:
        """Share of C_g that K is, where it is measured."""
        return None

    @property
    def free_share(self) -> float | None:
        """Share of all that R(H) is, where it is measured."""
        return None

    @property
    def both(self) -> tuple[float, bool] | None:
        """Share of K on which `safer` may be true and `ttf` false, and whether that is anything."""
        return None

    def excludes(self, predicate: str) -> bool:
        """Whether no estimate of a state of K can let AC have control."""
        del predicate
        return False

    def lets_share(self, case: Case, predicate: str) -> float | None:
        """Share of K that lets AC have control, where its own sets tell that."""
        del case, predicate
        return None

    def waits_at_start(self, case: Case) -> bool:
        """Whether no estimate of an initial state can give control to AC."""
        del case
        return False

    @property
    def deepest(self) -> Mapping[int, float]:
        """State -> a value deep inside C_g, where one is known."""
        return {}


class Method(ABC):
    """A way to prove groups; one object, without state."""

    kind: str
    """What a `verify` block writes, and `Group.representation` is."""
    how: Mapping[str, str]
    """Claim -> how it is shown, in words."""
    hint = ""
    """What else helps where `safe` is no product over the groups."""

    @abstractmethod
    def opened(self, case: Case, group: Group) -> GroupProof:
        """Its proof of a group; UnboundedError where the dynamics have no enclosure."""

    @abstractmethod
    def parts(
        self, case: Case, proofs: Sequence[GroupProof], predicate: str
    ) -> Sequence[SetFactor] | None:
        """A part for each of its groups on which `safe` or `safer` holds; None where it finds none.

        The others are where it holds at all: the product is looked at later.
        """

    def hinted(
        self, case: Case, proofs: Sequence[GroupProof], parts: Sequence[SetFactor]
    ) -> Sequence[SetFactor] | None:
        """The parts inside what `core e;` says; None where that holds nowhere."""
        del case, proofs
        return parts

    @abstractmethod
    def said(self, done: Sequence[Case], claim: str) -> tuple[str, dict[str, int]]:
        """Of P2a, `ttf` or `safer` that was proved: on what, in words, and counted."""

    @abstractmethod
    def table(self, problem: Problem, group: Group, pairs: Sequence[object]) -> LevelTable:
        """What the DM holds of a group, from its pair in every case."""

    @abstractmethod
    def packed(self, pair: object) -> dict[str, NDArray[np.generic]]:
        """A pair as arrays to be kept, by name; their shapes are the method's."""

    @abstractmethod
    def unpacked(self, group: Group, arrays: Mapping[str, NDArray[np.generic]]) -> object:
        """The pair again, from arrays of the shapes that `packed` gives.

        KeyError or ValueError where these are other arrays.
        """

    def certified(
        self, certificate: Certificate, group: Group, entry: Mapping[str, Any]
    ) -> object | None:
        """The pair that a certificate has in the entry of a group; None where it has none.

        RejectedError where its files are not of the size that they should be.
        """
        del certificate, group, entry
        return None


@dataclass
class Failure:
    """Where a claim could not be shown: cells of one group, or nowhere in particular."""

    claim: str
    text: str
    proof: GroupProof | None = None
    """Of the group that fails."""
    cells: Bools | None = None
    hint: str = ""
    where: Region | None = None
    """Where that is."""
    stuck: bool = False
    """P2b: the cells are those of K from which no way back was found."""
    cut: bool = False
    """It was not looked at to the end, as something else fails."""


@dataclass(eq=False)
class Case:
    """One combination of parameter values under way."""

    problem: Problem
    parameter: tuple[int, ...]
    forms: CompiledEnclosures
    proofs: list[GroupProof] = field(default_factory=list)
    """In the order of `verify/proof_methods.py`."""
    failures: list[Failure] = field(default_factory=list)
    spent: dict[str, float] = field(default_factory=dict)
    """Seconds per claim."""
    counts: dict[str, int] = field(default_factory=dict)
    vain: float = 0.0
    """`GridGroup.core`: the share of C that may be followed for nothing; 0: all of it."""
    holds: int = 0
    """`GridGroup.core`: how many holds a cell of C may take on average; 0: any number."""
    lawful: FailsafeClaim | None = None
    """What its fail-safe law keeps; None: not looked at."""
    first: Case | None = None
    """The attempt on the declared grid, where this one is on a finer one."""

    @property
    def sets(self) -> CaseSets:
        """What was found of all groups."""
        return CaseSets(self.parameter, self.proofs)

    @property
    def fresh(self) -> list[GroupProof]:
        """The groups whose sets are still to be computed."""
        return [p for p in self.proofs if p.fresh]

    def failed(self, claim: str) -> list[Failure]:
        """What stands against a claim."""
        return [f for f in self.failures if f.claim == claim]

    def fail(
        self, claim: str, text: str, proof: GroupProof | None = None, hint: str = ""
    ) -> Failure:
        """Enter a failure; where it is may be added to it."""
        made = Failure(claim, text, proof, hint=hint)
        self.failures.append(made)
        return made

    def again(self, proof: GroupProof) -> None:
        """A group keeps nothing of an earlier attempt."""
        proof.fresh = True
        self.failures = [f for f in self.failures if f.proof is not proof]

    def count(self, name: str, value: int) -> None:
        """Keep the largest of what is counted."""
        self.counts[name] = max(self.counts.get(name, 0), value)


SPENT = "its budget is used up"
"""In what is said of a claim that had more work to do than its method may: nothing was shown."""
STAGE = {"P2a": "safe", "P3": "tubes", "ttf": "ttf", "safer": "safer", "P2b": "way"}
"""Where a claim begins, for who is told of it (`STAGES` of verify_module.py)."""


class ClaimTimer:
    """Adds the seconds of a `with` block to a claim, and tells that it begins."""

    def __init__(self, case: Case, claim: str) -> None:
        self.case, self.claim = case, claim
        self.began = 0.0

    def __enter__(self) -> None:
        phase(f"{self.case.problem.name}: {self.claim}")
        if self.claim in STAGE:
            share_done(0.0, STAGE[self.claim])
        self.began = time.perf_counter()

    def __exit__(self, kind: object, error: BaseException | None, _: object) -> None:
        if isinstance(error, KeyboardInterrupt):
            vars(error)["__notes__"] = self._so_far()
        spent = time.perf_counter() - self.began
        self.case.spent[self.claim] = self.case.spent.get(self.claim, 0.0) + spent

    def _so_far(self) -> list[str]:
        failed = {f.claim: f"not shown: {f.text}" for f in reversed(self.case.failures)}
        said = [f"{c} {failed.get(c, 'shown')}" for c in self.case.spent]
        values = zip(self.case.problem.parameters, self.case.parameter, strict=True)
        at = "".join(f" with {p.name} = {value}" for p, value in values)
        until = ", ".join(said) or "no claim settled"
        return [f"{self.case.problem.name}{at}: {until}; ended in {self.claim}"]


def settled(*results: ModuleResult) -> list[str]:
    """Lines for whoever ends the command before it is done: verdicts, and what is open of them."""
    lines = []
    for result in results:
        held = ", ".join(f"{name} {f.verdict}" for name, f in result.findings.items())
        lines.append(f"{result.name}: {held}")
        told = {NO_CORE}
        for name, f in result.findings.items():
            if not f.holds and f.text not in told:
                told.add(f.text)
                lines.append(f"  {name}  {f.text}")
                lines += [f"    where  {region}" for region in f.regions[:REGIONS_SHOWN]]
                lines += [f"    why    {cause.text}" for cause in f.causes]
    return lines


@contextmanager
def settled_before(told: Callable[[], list[str]]) -> Iterator[None]:
    """Whoever ends the command in this block is told so: notes of the interruption."""
    try:
        yield
    except KeyboardInterrupt as stopped:
        vars(stopped)["__notes__"] = told()
        raise
