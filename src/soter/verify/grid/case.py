"""A case of a verification: the state of the proof under one combination of parameter values.

Purpose: each claim reads a `Case`, and enters a `Failure` where the claim is not shown. A case has
one proof for each group of states (`grid/claims.py`). `certificate_axes_entry` writes the axes of a
group into the entry of a certificate. `ClaimTimer` counts the seconds of a claim.
`verdicts_in_words` lists the verdicts reached so far for a user who interrupts the command.
Non-goals: the claims (`claims.py`).

Claims are asked of all groups in the order of docs/verification.md, section 3: C, K, R(H), then the
inclusions of `ttf` and `safer` or their levels, the start, the way back. Symbols: head of
`verify/grid/sets.py`.
"""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.current_phase import phase, share_done
from soter.verify.claims.results import NO_CORE, REGIONS_SHOWN, CaseSets

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from soter.core.layout import Bools
    from soter.verify.claims.product_sets import FailsafeClaim
    from soter.verify.claims.results import ModuleResult, Region
    from soter.verify.enclose.compiled_enclosures import CompiledEnclosures
    from soter.verify.problem.problem import Group, Problem


@dataclass
class Failure:
    """A claim that could not be shown; `proof` and `cells` say where it fails, if this is known."""

    claim: str
    text: str
    proof: Any | None = None
    """The proof of the group that fails (a `GridProof`); None: several groups do."""
    cells: Bools | None = None
    hint: str = ""
    where: Region | None = None
    """A box of states where the claim fails; None: none is known."""
    stuck: bool = False
    """Whether `cells` are cells of K from which no way back was found (P2b)."""
    cut: bool = False
    """Whether the claim was not examined to the end because another claim fails."""


@dataclass(eq=False)
class Case:
    """The proofs and failures for one combination of parameter values, while they are made."""

    problem: Problem
    parameter: tuple[int, ...]
    """The value of each parameter."""
    forms: CompiledEnclosures
    proofs: list[Any] = field(default_factory=list)
    """The proofs of all groups, each a `GridProof`, which knows this class."""
    failures: list[Failure] = field(default_factory=list)
    spent: dict[str, float] = field(default_factory=dict)
    """The seconds that each claim took."""
    counts: dict[str, int] = field(default_factory=dict)
    """Figures by name: `recover_ns`, the time T of P2b in ns; numbers of rounds, periods, cells."""
    vain: float = 0.0
    """The share of cells that may be followed in vain; see `GridGroup.compute_core`."""
    holds: int = 0
    """How many periods of SC may be computed for a cell; see `GridGroup.compute_core`."""
    lawful: FailsafeClaim | None = None
    """The part of C that the fail-safe law keeps; None: the law was not examined."""
    first: Case | None = None
    """The earlier attempt on the declared grid; None: this case is itself on that grid."""

    @property
    def sets(self) -> CaseSets:
        """The sets of all groups, in the form that results hold."""
        return CaseSets(self.parameter, self.proofs)

    @property
    def fresh_proofs(self) -> list[Any]:
        """The proofs of the groups whose sets are still to be computed."""
        return [p for p in self.proofs if p.fresh]

    def failures_of(self, claim: str) -> list[Failure]:
        """The failures entered for one claim."""
        return [f for f in self.failures if f.claim == claim]

    def fail(self, claim: str, text: str, proof: object | None = None, hint: str = "") -> Failure:
        """Enters a failure of a claim and returns it, so that the caller can add cells to it."""
        made = Failure(claim, text, proof, hint=hint)
        self.failures.append(made)
        return made

    def make_fresh(self, proof: Any) -> None:  # noqa: ANN401 - one of `proofs`
        """Removes a group's failures and marks the group's proof to be computed anew."""
        proof.fresh = True
        self.failures = [f for f in self.failures if f.proof is not proof]

    def raise_count(self, name: str, value: int) -> None:
        """Replaces the count called `name` by `value` if `value` is larger."""
        self.counts[name] = max(self.counts.get(name, 0), value)


STAGE = {"P2a": "safe", "P3": "tubes", "ttf": "ttf", "safer": "safer", "P2b": "way"}
"""The stage of the progress display that begins with each claim (`STAGES`, verify_module.py)."""


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
            vars(error)["__notes__"] = self._claims_so_far()
        spent = time.perf_counter() - self.began
        self.case.spent[self.claim] = self.case.spent.get(self.claim, 0.0) + spent

    def _claims_so_far(self) -> list[str]:
        failed = {f.claim: f"not shown: {f.text}" for f in reversed(self.case.failures)}
        claims = [f"{c} {failed.get(c, 'shown')}" for c in self.case.spent]
        values = zip(self.case.problem.parameters, self.case.parameter, strict=True)
        at = "".join(f" with {p.name} = {value}" for p, value in values)
        until = ", ".join(claims) or "no claim settled"
        return [f"{self.case.problem.name}{at}: {until}; ended in {self.claim}"]


def verdicts_in_words(*results: ModuleResult) -> list[str]:
    """Lines with the verdicts and the open claims, for a user who interrupts the command."""
    lines = []
    for result in results:
        held = ", ".join(f"{name} {f.verdict}" for name, f in result.findings.items())
        lines.append(f"{result.name}: {held}")
        texts = {NO_CORE}
        for name, f in result.findings.items():
            if not f.holds and f.text not in texts:
                texts.add(f.text)
                lines.append(f"  {name}  {f.text}")
                lines += [f"    where  {region}" for region in f.regions[:REGIONS_SHOWN]]
                lines += [f"    why    {cause.text}" for cause in f.causes]
    return lines


@contextmanager
def notes_on_interruption(notes: Callable[[], list[str]]) -> Iterator[None]:
    """A `with` block that adds the lines of `notes` to the exception if the user interrupts it."""
    try:
        yield
    except KeyboardInterrupt as stopped:
        vars(stopped)["__notes__"] = notes()
        raise


def certificate_axes_entry(
    problem: Problem, group: Group, stem: str, files: dict[str, bytes]
) -> dict[str, Any]:
    """Adds a group's breakpoints to `files`; gives the group's kind and axes for a certificate."""
    entry: dict[str, Any] = {"kind": "grid", "axes": []}
    for k, axis in enumerate(group.axes):
        name = f"{stem}_axis{k}.bin"
        files[name] = np.array(axis.edges, dtype="<f8").tobytes()
        entry["axes"].append({"state": problem.quantities.states[axis.state].name, "edges": name})
    return entry
