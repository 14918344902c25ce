"""The proof method "polytope": claims about one linear group, proved by half-spaces.

Purpose: `PolytopeProof` proves, for one group of a case, C, K, R(H), levels or inclusions, the
start and the return with multipliers, and enters a failure where one is not proved; `Polytopes` is
the method that opens such proofs. Symbols: head of `verify/grid/sets.py`.
Non-goals: finding sets (`proofs.py`), reading matrices (`extract_group.py`), comparing predicates
with sets (`regions.py`), verdicts.

C_g, the group's part of C, is a box on which `safe` surely holds; the product with the other groups
is checked by `verify/claims/claims.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from soter.diagnostics.current_phase import share_done
from soter.verify.claims.case import SPENT, GroupProof, Method
from soter.verify.claims.product_sets import BoxPart
from soter.verify.claims.results import PolytopePart
from soter.verify.polytope import proofs
from soter.verify.polytope.extract_group import NotLinearError, linear_group
from soter.verify.polytope.half_spaces import (
    LinearProgram,
    Polytope,
    SpentError,
    box_polytope,
    inner_point,
)
from soter.verify.polytope.matrices import BeyondError
from soter.verify.polytope.proofs import NotProvedError, Windows
from soter.verify.polytope.regions import (
    box_outside_free,
    box_where_true,
    figures,
    random_points,
    shares,
)
from soter.verify.polytope.tables import Facets, entry, polytope_of
from soter.verify.problem.inputs import topics_seen_by_dm
from soter.verify.problem.problem_times import look_ahead_advice

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from soter.certificate.folder import Certificate
    from soter.core.layout import Floats
    from soter.report.proof_page import RegionFigure
    from soter.verify.claims.case import Case
    from soter.verify.claims.product_sets import SetFactor
    from soter.verify.deploy.level_tables import LevelTable
    from soter.verify.polytope.proofs import PolytopeSets
    from soter.verify.problem.problem import Group, Problem

    Pair = tuple[Polytope, Polytope]
    Arrays = Mapping[str, NDArray[np.generic]]

WEAK = "a stronger SC; smaller errors, delays or disturbances; wider ranges"
SLOW = "an SC that damps more, or a shorter period of it; a shorter horizon; fewer states; a `grid`"
DRAWN = 2000
"""How many states of K are drawn to see how many of them let AC have control."""
PARTS = ("low", "high", "rows", "bounds")


def why_not(todo: Callable[[], object], group: Group | None = None) -> str:
    """Why a proof fails, with a `group` also the state that fails most; "" where it does not."""
    try:
        with np.errstate(all="ignore"):
            todo()
    except NotProvedError as error:
        return str(error) + (
            "" if group is None or error.row is None else binding(group, error.row)
        )
    except BeyondError:
        return "its numbers are beyond what can be bounded"
    except SpentError as error:
        return f"{SPENT}: {error}"
    return ""


def binding(group: Group, row: Floats) -> str:
    """The state that a half-space `row` (n,) bounds most, relative to its range, and which end."""
    weights = row * np.array([a.edges[-1] - a.edges[0] for a in group.axes])
    worst = int(np.argmax(np.abs(weights)))
    return f", most in {group.axes[worst].name} at its {'upper' if row[worst] > 0 else 'lower'} end"


@dataclass(frozen=True)
class Target(BoxPart):
    """A polytope with a box around it."""

    polytope: Polytope

    @classmethod
    def of(cls, group: Group, polytope: Polytope) -> Target:
        """The target of a polytope over a group's states."""
        ends = zip(group.axes, polytope.low.tolist(), polytope.high.tolist(), strict=True)
        return cls({a.state: (low, high) for a, low, high in ends}, polytope)


@dataclass(eq=False)
class PolytopeProof(GroupProof):
    """The proof of a group whose sets are polytopes."""

    group: Group
    found: PolytopePart
    fresh: bool = True
    mark = "p"
    equal: PolytopeProof | None = None
    """An earlier group of the case with the same numbers: its proofs hold for this one, too."""
    shown: set[str] = field(default_factory=set)
    """The names of the parts of the proof that were shown."""

    @property
    def return_ns(self) -> int:  # type: ignore[override]
        """The longest time from K to Q in ns."""
        return self.found.return_ns

    def _proved(
        self, case: Case, claims: Sequence[str], name: str, prove: Callable[..., None]
    ) -> bool:
        """Proves the part `name` and keeps its multipliers; else enters failures of `claims`."""
        if self.equal is not None and self._sets_of_equal(name) is not None:
            self.found.multipliers[name] = self.equal.found.multipliers[name]
            self.shown.add(name)
            return True
        sets = self.found.sets
        record = proofs.Claims(work=None if sets is None else sets.work)
        why = why_not(lambda: prove(self.found.sets, record), self.group)
        self.found.multipliers[name] = record.record
        for claim in claims if why else ():
            hint = "start further inside, or closer to rest" if claim == "start" else WEAK
            hint = SLOW if SPENT in why else hint
            case.fail(claim, f"not shown of the polytope: {why}", self, hint)
        self.shown |= set() if why else {name}
        return not why

    def _sets_of_equal(self, name: str) -> PolytopeSets | None:
        """The sets of the equal group, if part `name` was shown of exactly these sets; else None.

        `start` and Q depend on the initial states and the target of each group itself.
        """
        if self.equal is None or name == "start" or name not in self.equal.shown:
            return None
        own, its = self.found.sets, self.equal.found.sets
        assert own is not None
        assert its is not None
        return its if name != "Q" or _same(own.target, its.target) else None

    def _both(self, case: Case, text: str, hint: str) -> None:
        for claim in ("ttf", "safer"):
            case.fail(claim, text, self, hint)

    # ------------------------------------------------------------ claims

    def take_constraint(self, case: Case, part: SetFactor) -> None:
        """Takes C_g, as ranges of the group's states."""
        del case
        assert isinstance(part, BoxPart)
        if self.fresh:
            self.found.limits = [part.box[a.state] for a in self.group.axes]

    def core(self, case: Case) -> bool:
        """Finds K and R(H), and proves K; enters a failure of P2a and returns False if not."""
        problem, part = case.problem, self.found
        times = problem.times
        windows = Windows(times.horizon_ns, times.decision, max(problem.levels, 2))
        try:
            part.model = linear_group(problem, case.forms, self.group, part.limits)
        except NotLinearError as error:
            case.fail("P2a", f"no polytope: {error}", self, error.hint)
            return False
        linear = part.model.group
        part.limits = list(zip(linear.low.tolist(), linear.high.tolist(), strict=True))

        def find() -> None:
            told = partial(share_done, 0.0, "core")  # nobody knows how much is left
            part.sets = proofs.find_core(linear, windows, proofs.work_of(linear, told))

        self.shown.clear()
        self.equal = _with_same_numbers(case, self)
        its = None if self.equal is None else self.equal.found.sets
        if its is not None:
            part.sets = proofs.PolytopeSets(linear, windows, its.rate, its.core, its.free, [], [])
        elif SPENT in (why := why_not(find)):
            case.fail("P2a", f"no polytope was found that SC keeps: {why}", self, SLOW)
            return False
        if part.sets is None or inner_point(part.sets.core) is None:
            case.fail("P2a", "K is empty: no polytope was found that SC keeps", self, WEAK)
            part.sets = None
            return False
        return self._proved(case, ("P2a",), "K", proofs.prove_core)

    def free_phase(self, case: Case) -> None:
        """Proves R(H)."""
        if self.found.sets is None:
            return
        if inner_point(self.found.sets.free) is None:
            hint = "wider ranges, where a state may touch their ends; a shorter horizon"
            self._both(case, "R(H) is empty: AC could leave K from every state", hint)
        else:
            self._proved(case, ("ttf", "safer"), "R", proofs.prove_free)

    def levels(self, case: Case) -> None:
        """Finds and proves S_0 ... S_(m-2); what is not proved is not used."""
        sets = self.found.sets
        self.shown.discard("S")
        if sets is None:
            return
        if text := self._unseen(case.problem):
            hint = "one topic that shows all of the group's states, or write `ttf` and `safer`"
            self._both(case, text, hint)
            return
        its = self._sets_of_equal("S")
        why = "" if its is not None else why_not(lambda: proofs.find_levels(sets))
        if its is not None:
            sets.allowed, sets.carried = list(its.allowed), list(its.carried)
        empty = [j for j, s in enumerate(sets.allowed) if inner_point(s) is None]
        if why or empty:
            hint = SLOW if SPENT in why else case.problem.stronger
            self._both(case, why or f"S_{empty[0]} is empty: AC would never get control", hint)
        elif self._proved(case, ("ttf", "safer"), "S", proofs.prove_levels):
            return
        sets.allowed, sets.carried = [], []

    def _unseen(self, problem: Problem) -> str:
        """Why the DM has no estimate of the group's states; "": it has."""
        shown = topics_seen_by_dm(problem)
        states = [a.state for a in self.group.axes]
        names = [problem.quantities.states[s].name for s in states if s not in shown]
        if names:
            return f"the DM sees no topic with {', '.join(names)}"
        topics = {problem.topic_leaf_of_state[s][0] for s in states}
        several = problem.times.age_dm > 0 and len(topics) > 1
        return "the DM sees this group in topics of different ages" if several else ""

    def has_unproved_levels(self, case: Case) -> bool:
        """Whether some claim up to its levels failed, so that no DM may use these."""
        claims = ("P2a", "ttf", "safer")
        return any(f.proof is self and f.claim in claims for f in case.failures)

    def take_table(self, case: Case, table: LevelTable) -> None:
        """Takes the half-spaces of the DM; enters failures where they hold nothing."""
        assert isinstance(table, Facets)
        self.found.deployed = table.certain
        hint = "fewer values of the parameters: the DM has one set of half-spaces for all of them"
        for claim, p in zip(("ttf", "safer"), table.certain, strict=True):
            if inner_point(p) is None:
                text = "no estimate is in the sets of every case: AC would never get control"
                case.fail(claim, text, self, hint)

    def inclusion(self, case: Case, predicate: str) -> None:
        """Enters a failure where a predicate lets AC have control at a state of C outside R(H)."""
        if self.found.sets is None:
            return
        wrong = box_outside_free(case.forms, case.problem, self.found, predicate)
        if wrong is None:
            return
        says = "may be false" if predicate == "ttf" else "may be true"
        text = f"`{predicate}` {says} where it was not shown that AC stays in K for H"
        hint = (
            f"{look_ahead_advice(case.problem.times, predicate)}, or none: then it is computed; "
            "a polytope ends where SC is clamped, a `grid` need not"
        )
        case.fail(predicate, text, self, hint).where = wrong

    def start(self, case: Case, until_ns: int) -> None:
        """Proves that the initial states lie in R(h_0)."""
        if self.found.sets is None:
            return
        ends = [case.problem.initial[a.state] for a in self.group.axes]
        low, high = np.array([(i.low, i.high) for i in ends]).T
        box = box_polytope(low, high)

        def prove(sets: PolytopeSets, record: proofs.Claims) -> None:
            proofs.prove_start(sets, record, box, until_ns)

        self._proved(case, ("start",), "start", prove)

    def states_given_back(self, case: Case) -> Target | None:
        """The states at which the DM's half-spaces give AC control on any estimate."""
        del case
        deployed, sets = self.found.deployed, self.found.sets
        if deployed is None or sets is None:
            return None
        return Target.of(self.group, deployed[1].shrunk(sets.group.error))

    def waits_at_start(self, case: Case) -> bool:
        """Whether the DM's half-spaces give AC no control at the initial state, if it is one."""
        initial = [case.problem.initial[a.state] for a in self.group.axes]
        if self.found.deployed is None or any(i.low < i.high for i in initial):
            return False
        return not self.found.deployed[1].contains(np.array([[i.low for i in initial]])).any()

    def recover(self, case: Case, target: SetFactor) -> None:
        """Finds and proves Q, and after how many periods every run from K is in it."""
        assert isinstance(target, Target)
        sets = self.found.sets
        if sets is None:
            return
        sets.target = target.polytope
        if not self.fresh:
            return
        self.shown.discard("Q")
        its = self._sets_of_equal("Q")
        why = "" if its is not None else why_not(lambda: proofs.find_return(sets))
        if its is not None:
            sets.kept, sets.kept_rate, sets.periods = its.kept, its.kept_rate, its.periods
        if why or sets.kept is None:
            text = "no polytope was found that SC keeps inside `safer` and returns to"
            text = f"{text}: {why}" if SPENT in why else text
            hint = SLOW if SPENT in why else "let SC come to rest where `safer` holds"
            case.fail("P2b", text, self, hint)
        elif self._proved(case, ("P2b",), "Q", proofs.prove_return):
            times = case.problem.times
            self.found.return_ns = sets.periods * times.delta_sc + times.jitter_sc

    # ------------------------------------------------------------ how much it says

    @property
    def covers_scheme(self) -> bool:
        """Whether the simulator's steps are solutions of the group's model."""
        return self.found.model is not None and self.found.model.covers_scheme

    def shares(self, case: Case) -> dict[str, float]:
        """The shares of its ranges that its sets have, by random samples."""
        if not self.found.shares:
            self.found.shares = shares(case.forms, case.problem, self.found)
        return self.found.shares

    def random_states(self, chance: np.random.Generator, count: int) -> Floats:
        """Random states of K, (count, n): uniform if possible, else mixtures of extreme ones."""
        assert self.found.sets is not None
        return random_points(self.found.sets.core, chance, count)

    @property
    def estimates(self) -> Mapping[int, tuple[float, float]]:
        """The ranges of C_g, by state."""
        return {a.state: r for a, r in zip(self.group.axes, self.found.limits, strict=True)}

    def lets_share(self, case: Case, predicate: str) -> float | None:
        """The share of states drawn from K where a computed predicate lets AC have control."""
        part = self.found
        if not case.problem.computed or part.deployed is None or part.sets is None:
            return None
        drawn = random_points(part.sets.core, np.random.default_rng(0), DRAWN)
        return float(part.deployed[0 if predicate == "ttf" else 1].contains(drawn).mean())

    @property
    def deepest(self) -> Mapping[int, float]:
        """The middle of C_g, by state."""
        return {state: (low + high) / 2 for state, (low, high) in self.estimates.items()}

    # ------------------------------------------------------------ results

    @property
    def pair(self) -> Pair | None:
        """S_0 and S_(m-2), for the table; None: it has none."""
        sets = self.found.sets
        return (sets.allowed[0], sets.safer) if sets is not None and sets.allowed else None

    def entry(self, problem: Problem, stem: str, files: dict[str, bytes]) -> dict[str, object]:
        """The group's entry in a certificate: half-spaces and multipliers."""
        return entry(problem, self.found, stem, files)

    def figures(self, note: str) -> list[RegionFigure]:
        """The figure of its regions, if it has a K."""
        return figures(self.found, note)


def _with_same_numbers(case: Case, proof: PolytopeProof) -> PolytopeProof | None:
    """The first earlier group of a case with the same numbers, bit for bit; None: there is none."""
    own = proof.found.model
    assert own is not None
    for p in case.proofs[: case.proofs.index(proof)]:
        model = p.found.model if isinstance(p, PolytopeProof) else None
        if model is not None and model.group.equals(own.group):
            return cast("PolytopeProof", p)
    return None


def _same(a: Polytope | None, b: Polytope | None) -> bool:
    """Whether two polytopes have the same numbers."""
    if a is None or b is None:
        return a is b
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in PARTS)


class Polytopes(Method):
    """The method that proves claims on half-spaces by multipliers."""

    kind = "polytope"
    how = dict.fromkeys(
        ("P2a", "P2b", "ttf", "safer", "start"), "half-spaces, with multipliers for every claim"
    )
    hint = ", or give a `polytope` narrower ranges"

    def new_proof(self, case: Case, group: Group) -> PolytopeProof:
        """A new proof of a group, of which nothing is computed yet."""
        del case
        return PolytopeProof(group, PolytopePart(group))

    def parts(
        self, case: Case, proofs: Sequence[GroupProof], predicate: str
    ) -> Sequence[BoxPart] | None:
        """For each group ranges over which a predicate surely holds; None: none were found."""
        own = [p for p in proofs if isinstance(p, PolytopeProof)]
        if predicate == case.problem.returning:
            return _targets(case, own)
        if not any(p.fresh for p in own):
            return [BoxPart(p.estimates) for p in own]
        ends = {a.state: (a.edges[0], a.edges[-1]) for p in own for a in p.group.axes}
        box = box_where_true(case.forms, case.problem, predicate, ends)
        if box is None:
            return None
        return [BoxPart({a.state: box[a.state] for a in p.group.axes}) for p in own]

    def proved_in_words(self, done: Sequence[Case], claim: str) -> tuple[str, dict[str, int]]:
        """The text of a finding that was proved, with its counts of half-spaces or boxes."""
        every = [p.found for c in done for p in c.proofs if isinstance(p, PolytopeProof)]
        if claim == "P2a":
            faces = sum(len(part.sets.core.faces[1]) for part in every if part.sets is not None)
            return f"{faces:,} half-spaces, kept in every period of SC" if faces else "", {}
        boxes = sum(part.boxes.get(claim, 0) for part in every)
        return f"on {boxes:,} boxes" if boxes else "", {"boxes": boxes}

    def table(self, problem: Problem, group: Group, pairs: Sequence[object]) -> Facets:
        """The DM's half-spaces of a group: those of all cases together."""
        del problem
        return Facets.of([a.state for a in group.axes], cast("Sequence[Pair]", pairs))

    def pack(self, pair: object) -> dict[str, NDArray[np.generic]]:
        """Both sets as arrays to store: `low` and `high` (n,), `rows` (N, n), `bounds` (N,)."""
        both = enumerate(cast("Pair", pair))
        return {f"{k}_{name}": getattr(p, name) for k, p in both for name in PARTS}

    def unpack(self, group: Group, arrays: Arrays) -> Pair:
        """The sets that `packed` stored: `low` and `high` (n,), `rows` (N, n), `bounds` (N,)."""
        del group
        outer, inner = (
            Polytope(*(np.asarray(arrays[f"{k}_{name}"], np.float64) for name in PARTS))
            for k in range(2)
        )
        return outer, inner

    def pair_in_certificate(
        self, certificate: Certificate, group: Group, entry: Mapping[str, Any]
    ) -> Pair | None:
        """The two sets that a certificate has of a group; None: it has none."""
        del group
        levels = entry.get("S", [])
        if not levels:
            return None
        return polytope_of(certificate, levels[0]), polytope_of(certificate, levels[-1])


def _targets(case: Case, own: Sequence[PolytopeProof]) -> list[Target] | None:
    """For each group a box of states all of whose estimates satisfy `safer`; None: none found."""
    ends: dict[int, tuple[float, float]] = {}
    for p in own:
        if p.found.sets is None:
            return None
        program = LinearProgram(p.found.sets.core)
        eye = np.eye(len(p.found.limits))
        for a, row, (low, high) in zip(p.group.axes, eye, p.found.limits, strict=True):
            least, most = -program.greatest(-row)[0], program.greatest(row)[0]
            ends[a.state] = (max(low, least), min(high, most))
    ranges = box_where_true(case.forms, case.problem, case.problem.returning, ends)
    if ranges is None:
        return None
    targets = []
    for p in own:
        low, high = np.array([ranges[a.state] for a in p.group.axes]).T
        targets.append(Target.of(p.group, box_polytope(low, high)))
    return targets
