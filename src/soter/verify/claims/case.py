"""A case of a verification under way, and what the proofs of its groups of states have to offer.

Purpose: a `Case` is one combination of parameter values; each claim reads it, and enters a
`Failure` where it is not shown. Its `proofs` are one for each group, made by a `Method` (grid,
polytope): `GroupProof` and `Method` say what a method of proof implements, as claims ask it with
the case in hand. `axes_entry` and `matrix_entry` write what the certificate entries of all methods
share. `ClaimTimer` counts the seconds of a claim; `settled` says, for whoever ends the command
before it is done, which verdicts there are.
Non-goals: the claims (`claims.py`); which methods there are (`verify/proof_methods.py`).

Claims are asked of all groups in the order of docs/verification.md, section 3: C, K, R(H), then
the inclusions of `ttf` and `safer` or their levels, the start, the way back. Questions that do not
apply to a group have a default answer. Symbols: head of `verify/grid/sets.py`.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.current_phase import phase, share_done
from soter.verify.claims.results import NO_CORE, REGIONS_SHOWN, CaseSets, GroupResult

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from soter.certificate.folder import Certificate
    from soter.core.layout import Bools, Floats
    from soter.verify.claims.product_sets import FailsafeClaim, SetFactor
    from soter.verify.claims.results import ModuleResult, Region
    from soter.verify.deploy.level_tables import LevelTable
    from soter.verify.enclose.compiled_enclosures import CompiledEnclosures
    from soter.verify.problem.problem import Group, Problem


@dataclass
class Failure:
    """A claim that could not be shown, and where: on cells of one group, or no one knows where."""

    claim: str
    text: str
    proof: GroupProof | None = None
    """The proof of the group that fails; None: several are concerned."""
    cells: Bools | None = None
    hint: str = ""
    where: Region | None = None
    """A box of states where it fails, if it is known."""
    stuck: bool = False
    """Whether these are cells of K from which no way back was found (P2b)."""
    cut: bool = False
    """Whether the claim was not examined to the end, as another one fails."""


@dataclass(eq=False)
class Case:
    """One combination of parameter values under way."""

    problem: Problem
    parameter: tuple[int, ...]
    """The value of each parameter."""
    forms: CompiledEnclosures
    proofs: list[GroupProof] = field(default_factory=list)
    """The proofs of all groups, in the order of `verify/proof_methods.py`."""
    failures: list[Failure] = field(default_factory=list)
    spent: dict[str, float] = field(default_factory=dict)
    """The seconds that each claim took."""
    counts: dict[str, int] = field(default_factory=dict)
    """Figures by name: `recover_ns`, the time T of P2b in ns; numbers of rounds, periods, cells."""
    vain: float = 0.0
    """The share of cells that may be followed in vain; see `GridGroup.core`."""
    holds: int = 0
    """How many periods of SC may be computed for a cell; see `GridGroup.core`."""
    lawful: FailsafeClaim | None = None
    """What the fail-safe law keeps; None: it was not looked at."""
    first: Case | None = None
    """The attempt on the declared grid, where this one is on a finer grid; else None."""

    @property
    def sets(self) -> CaseSets:
        """The sets of all groups, as results have them."""
        return CaseSets(self.parameter, self.proofs)

    @property
    def fresh(self) -> list[GroupProof]:
        """The groups whose sets are still to be computed."""
        return [p for p in self.proofs if p.fresh]

    def failed(self, claim: str) -> list[Failure]:
        """The failures of a claim."""
        return [f for f in self.failures if f.claim == claim]

    def fail(
        self, claim: str, text: str, proof: GroupProof | None = None, hint: str = ""
    ) -> Failure:
        """Enters a failure and returns it, so that cells may be added."""
        made = Failure(claim, text, proof, hint=hint)
        self.failures.append(made)
        return made

    def again(self, proof: GroupProof) -> None:
        """Makes a group's proof fresh: it keeps nothing of an earlier attempt."""
        proof.fresh = True
        self.failures = [f for f in self.failures if f.proof is not proof]

    def count(self, name: str, value: int) -> None:
        """Sets a count to the larger of its value and this one."""
        self.counts[name] = max(self.counts.get(name, 0), value)


SPENT = "its budget is used up"
"""Stands in the text of a claim whose method reached its limit of work: nothing was shown."""
STAGE = {"P2a": "safe", "P3": "tubes", "ttf": "ttf", "safer": "safer", "P2b": "way"}
"""The stage of progress that begins with a claim (`STAGES` of verify_module.py)."""


class ClaimTimer:
    """A `with` block that counts its seconds for a claim and reports progress at its beginning."""

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
    """A `with` block in which an interruption carries the lines of `told` as its notes."""
    try:
        yield
    except KeyboardInterrupt as stopped:
        vars(stopped)["__notes__"] = told()
        raise


class GroupProof(GroupResult):
    """The proof of one group under one combination of parameter values.

    Claims between K and the start are asked only if it is `fresh` and every group has a K.
    """

    fresh: bool
    """Whether its sets are still to be computed; else they are those of an earlier attempt."""
    return_ns = 0
    """The longest time from K to Q in ns, where P2b was shown."""

    # ------------------------------------------------------------ claims

    @abstractmethod
    def take_constraint(self, case: Case, part: SetFactor) -> None:
        """Takes C_g, the group's part of C; if it differs from before, the proof is fresh again."""

    @abstractmethod
    def core(self, case: Case) -> bool:
        """Computes K, the core; enters a failure of P2a and returns False where it is empty."""

    @abstractmethod
    def free_phase(self, case: Case) -> None:
        """Computes R(H), the states from which no command of U leads out of K within H."""

    @abstractmethod
    def inclusion(self, case: Case, predicate: str) -> None:
        """Checks that `ttf` or `safer` lets AC have control only at estimates of R(H)."""

    def why_not_entered(self, case: Case) -> str:
        """Why a state whose estimate satisfies `enters` may be outside R(H); "": it may not."""
        del case
        return f"its {self.group.representation} is not looked at"

    @abstractmethod
    def levels(self, case: Case) -> None:
        """Computes S_0 ... S_(m-2), the sets of estimates by which a computed DM decides."""

    def without_levels(self) -> GroupProof | None:
        """A copy with C, K and R(H) and nothing else; None where the method has none."""
        return None

    @abstractmethod
    def take_table(self, case: Case, table: LevelTable) -> None:
        """Takes the DM's table, which all cases share; enters a failure where it holds nothing."""

    def has_unproved_levels(self, case: Case) -> bool:
        """Whether it has levels that were not proved."""
        del case
        return False

    @abstractmethod
    def start(self, case: Case, until_ns: int) -> None:
        """Checks that the initial states lie in R(`until_ns`); also asked if it is not fresh."""

    @abstractmethod
    def states_given_back(self, case: Case) -> SetFactor | None:
        """The states at which the DM's table gives AC control on any estimate; None: no table."""

    @abstractmethod
    def recover(self, case: Case, target: SetFactor) -> None:
        """Computes Q inside a target, and the way there; also asked if it is not fresh."""

    # ------------------------------------------------------------ after a failure

    @property
    def stuck(self) -> float:
        """The share of K from which no way back was found."""
        return 0.0

    @property
    def core_cells(self) -> int:
        """How many cells K has; 0 where it has no cells."""
        return 0

    def give_up(self, case: Case) -> None:
        """Removes the states from K from which no way back was found."""

    def regions(self, cells: Bools, parameters: Sequence[tuple[str, int]]) -> list[Region]:
        """Boxes that hold the cells of a failure, a set of the grid's shape."""
        del cells, parameters
        return []

    # ------------------------------------------------------------ what the proof covers

    @property
    def covers_scheme(self) -> bool:
        """Whether the simulator's steps are solutions of its model."""
        return False

    @property
    def simultaneous_controls(self) -> tuple[int, ...]:
        """The controls that the proof assumes to begin to act at one instant."""
        return ()

    # ------------------------------------------------------------ how much it says

    @abstractmethod
    def shares(self, case: Case) -> dict[str, float]:
        """The share of its ranges that each known set has, by name (as `ModuleResult.shares`)."""

    @abstractmethod
    def random_states(self, chance: np.random.Generator, count: int) -> Floats:
        """Random states of K, of shape (count, axes)."""

    @property
    def estimates(self) -> Mapping[int, tuple[float, float]]:
        """The range within C of each state for which it is smaller than the declared one."""
        return {}

    @property
    def core_share(self) -> float | None:
        """The share of C_g that K has; None where it is not measured."""
        return None

    @property
    def free_share(self) -> float | None:
        """The share of the group's ranges that R(H) has; None where it is not measured."""
        return None

    @property
    def overlap_of_predicates(self) -> tuple[float, bool] | None:
        """The share of K where `safer` may be true and `ttf` false; whether any state is so."""
        return None

    def excludes(self, predicate: str) -> bool:
        """Whether no estimate of a state of K can let AC have control."""
        del predicate
        return False

    def lets_share(self, case: Case, predicate: str) -> float | None:
        """The share of K where a predicate lets AC have control; None where no set tells it."""
        del case, predicate
        return None

    def waits_at_start(self, case: Case) -> bool:
        """Whether no estimate of an initial state can give control to AC."""
        del case
        return False

    @property
    def deepest(self) -> Mapping[int, float]:
        """A point deep inside C_g, by state; empty where none is known."""
        return {}


class Method(ABC):
    """A way to prove groups; there is one object of each, without state."""

    kind: str
    """The word of a `verify` block for it, as in `Group.representation`."""
    how: Mapping[str, str]
    """How each claim is shown, in words."""
    hint = ""
    """Further advice where `safe` is no product over the groups."""

    @abstractmethod
    def new_proof(self, case: Case, group: Group) -> GroupProof:
        """A new proof of a group; `UnboundedError` where the dynamics have no enclosure."""

    @abstractmethod
    def parts(
        self, case: Case, proofs: Sequence[GroupProof], predicate: str
    ) -> Sequence[SetFactor] | None:
        """For each of its groups a set on which a predicate holds; None where it finds none.

        The states of other groups are taken where it holds: the product is checked later.
        """

    def cut_to_hint(
        self, case: Case, proofs: Sequence[GroupProof], parts: Sequence[SetFactor]
    ) -> Sequence[SetFactor] | None:
        """The parts cut to where the program's `core e;` holds; None where that is nowhere."""
        del case, proofs
        return parts

    @abstractmethod
    def proved_in_words(self, done: Sequence[Case], claim: str) -> tuple[str, dict[str, int]]:
        """The text of a proved P2a, `ttf` or `safer`: on how much it was shown; and the counts."""

    @abstractmethod
    def table(self, problem: Problem, group: Group, pairs: Sequence[object]) -> LevelTable:
        """The DM's table of a group, made from its `pair` in every case."""

    @abstractmethod
    def pack(self, pair: object) -> dict[str, NDArray[np.generic]]:
        """A `pair` as arrays to store, by name; their shapes are the method's own."""

    @abstractmethod
    def unpack(self, group: Group, arrays: Mapping[str, NDArray[np.generic]]) -> object:
        """The `pair` again, from arrays of the shapes that `packed` gives.

        `KeyError` or `ValueError` where these are other arrays.
        """

    def pair_in_certificate(
        self, certificate: Certificate, group: Group, entry: Mapping[str, Any]
    ) -> object | None:
        """The `pair` in a certificate's entry of a group; None where it has none.

        `RejectedError` where its files do not have the size that they should.
        """
        del certificate, group, entry
        return None


def matrix_entry(path: str, values: NDArray[Any], files: dict[str, bytes]) -> dict[str, object]:
    """An entry that names a file of doubles and their shape; the file is added to `files`."""
    files[path] = np.ascontiguousarray(values, dtype="<f8").tobytes()
    return {"file": path, "shape": list(values.shape)}


def axes_entry(
    problem: Problem, group: Group, stem: str, files: dict[str, bytes]
) -> dict[str, Any]:
    """An entry with a group's kind and axes; the breakpoints are added to `files`."""
    entry: dict[str, Any] = {"kind": group.representation, "axes": []}
    for k, axis in enumerate(group.axes):
        name = f"{stem}_axis{k}.bin"
        files[name] = np.array(axis.edges, dtype="<f8").tobytes()
        entry["axes"].append({"state": problem.quantities.states[axis.state].name, "edges": name})
    return entry
