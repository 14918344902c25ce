"""The claims of polytope groups, beside those of grids (`claims.py`, `levels.py`, `recovery.py`).

Purpose: for every polytope group of a case C, K, R(H), levels or inclusions, the start and the
return; each proved with multipliers, and entered as a failure where it is not.
Non-goals: finding sets (`polytopes.py`), reading matrices (`polytope_extract.py`), verdicts.

C_g is a box on which `safe` surely holds (the product with the other groups is checked by
`claims.py`). A predicate is compared with R(H) on boxes: for a linear function the worst point of a
box is one of its corners, so that a box inside all half-spaces lies in R(H); others are halved.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from soter.reach import polytopes
from soter.reach.estimates import seen
from soter.reach.polytope_balls import centred, exact, up_product, up_sum
from soter.reach.polytope_extract import NotLinearError, linear_group
from soter.reach.polytope_sets import Polytope, Program
from soter.reach.polytopes import NotProvedError, Windows
from soter.reach.products import candidates
from soter.reach.results import Region

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from soter.reach.claims import Case
    from soter.reach.polytopes import PolytopeSets
    from soter.reach.results import PolytopePart

    Floats = NDArray[np.float64]
    Box = dict[int, tuple[float, float]]

BISECTIONS = 50
BOXES_MAX = 60_000
"""So many boxes may be looked at to compare a predicate with R(H)."""
SMALLEST = 2.0**-14
"""A box that is still undecided at this share of the group's ranges is where the claim fails."""
CLOSE = 2.0**-40
"""Relative distance from which on the rounding of a product decides nothing."""
SAMPLES, SAMPLES_OF_PREDICATES = 100_000, 4_000
WEAK = "a stronger SC; smaller errors, delays or disturbances; wider ranges"
MAY = {"ttf": 1, "safer": 2}
"""The bit that says: an estimate may let AC have control."""


def _parts(case: Case) -> list[PolytopePart]:
    """Parts still to be computed that have a K."""
    return [p for p in case.sets.polytopes if p.fresh and p.sets is not None]


def _why_not(todo: Callable[[], object]) -> str:
    """Why a proof fails; "" where it does not."""
    try:
        with np.errstate(all="ignore"):
            todo()
    except NotProvedError as error:
        return str(error)
    except (AssertionError, ValueError, OverflowError, ZeroDivisionError):
        return "its numbers are beyond what can be bounded"
    return ""


def _proved(
    case: Case, part: PolytopePart, claims: Sequence[str], name: str, prove: Callable[..., None]
) -> bool:
    """Prove a part of the claims about a group's sets, and keep the multipliers."""
    record = polytopes.claims_of()
    why = _why_not(lambda: prove(part.sets, record))
    part.multipliers[name] = record.record
    for claim in claims if why else ():
        hint = "start further inside, or closer to rest" if claim == "start" else WEAK
        case.fail(claim, f"not shown of the polytope: {why}", hint=hint, part=part)
    return not why


# ---------------------------------------------------------------- C


def constrain(case: Case) -> Box | None:
    """C_g of every polytope group as ranges of its states; None where there is none."""
    parts = case.sets.polytopes
    if any(p.fresh for p in parts):
        ends = {a.state: (a.edges[0], a.edges[-1]) for p in parts for a in p.group.axes}
        found = _box(case, "safe", ends)
        if found is None:
            return None
        for p in parts:
            p.limits = [found[a.state] for a in p.group.axes]
    return {a.state: r for p in parts for a, r in zip(p.group.axes, p.limits, strict=True)}


def _box(case: Case, predicate: str, ends: Box) -> Box | None:
    """Ranges inside `ends` over which a predicate surely holds, all else at some point."""
    forms, n = case.forms, len(case.problem.states)
    for point in candidates(case.problem):
        base = forms.whole.copy()
        base[:n, 0] = base[:n, 1] = point
        outside = any(not low <= point[s] <= high for s, (low, high) in ends.items())
        if outside or not forms.true(predicate, base):
            continue

        def fine(ranges: Box, base: Floats = base) -> bool:
            box = base.copy()
            for s, r in ranges.items():
                box[s] = r
            return forms.true(predicate, box)

        found: Box = {}
        for s, (low, high) in ends.items():
            p = float(point[s])
            found[s] = (
                _furthest(p, low, lambda x, s=s, p=p: fine({s: (x, p)})),  # type: ignore[misc]
                _furthest(p, high, lambda x, s=s, p=p: fine({s: (p, x)})),  # type: ignore[misc]
            )

        def part(share: float, found: Box = found, point: Floats = point) -> Box:
            return {
                s: (point[s] + share * (a - point[s]), point[s] + share * (b - point[s]))
                for s, (a, b) in found.items()
            }

        if fine(found):
            return found
        share = _furthest(0.0, 1.0, lambda x: fine(part(x)))
        if share > 0.0:
            return part(share)
    return None


def _furthest(start: float, end: float, fine: Callable[[float], bool]) -> float:
    """As far from `start` towards `end` as a test holds (it holds at `start`)."""
    if fine(end):
        return end
    good, bad = start, end
    for _ in range(BISECTIONS):
        middle = good / 2 + bad / 2
        good, bad = (middle, bad) if fine(middle) else (good, middle)
    return good


# ---------------------------------------------------------------- K and R(H)


def core(case: Case) -> bool:
    """K and R(H) of every polytope group; False where one has no K."""
    problem, whole = case.problem, True
    times = problem.times
    windows = Windows(times.horizon_ns, times.decision, max(problem.levels, 2))
    for part in case.sets.polytopes:
        if not part.fresh:
            continue
        try:
            part.model = linear_group(problem, case.forms, part.group, part.limits)
        except NotLinearError as error:
            case.fail("P2a", f"no polytope: {error}", hint=error.hint, part=part)
            whole = False
            continue
        _find_core(part, windows)
        if part.sets is None or inner_point(part.sets.core) is None:
            text = "K is empty: no polytope was found that SC keeps"
            case.fail("P2a", text, hint=WEAK, part=part)
            part.sets, whole = None, False
        elif not _proved(case, part, ("P2a",), "K", polytopes.prove_core):
            whole = False
    return whole


def _find_core(part: PolytopePart, windows: Windows) -> None:
    def find() -> None:
        assert part.model is not None
        part.sets = polytopes.find_core(part.model.group, windows)

    _why_not(find)


def inner_point(p: Polytope) -> Floats | None:
    """A point that surely lies in a polytope: the middle of extreme ones; None without any."""
    program = Program(p)
    if program.empty:
        return None
    eye = np.eye(len(p.low))
    rows = np.concatenate([eye, -eye, p.rows])
    found = np.mean([program.greatest(row)[1] for row in rows], axis=0)
    return found if surely_inside(p, found) else None


def surely_inside(p: Polytope, x: Floats) -> bool:
    """Whether a point lies in a polytope; in rationals where floats could err."""
    if not np.isfinite(x).all():
        return False
    rows, limits = p.faces
    excess, size = rows @ x - limits, np.abs(rows) @ np.abs(x) + np.abs(limits)
    close = np.abs(excess) <= CLOSE * size + 2.0**-1000
    if (excess[~close] > 0).any():
        return False
    point = [Fraction(v) for v in x]
    return all(
        sum(Fraction(a) * v for a, v in zip(row, point, strict=True)) <= Fraction(limit)
        for row, limit in zip(rows[close], limits[close], strict=True)
    )


def free_phase(case: Case) -> None:
    """R(H)."""
    for part in _parts(case):
        assert part.sets is not None
        if inner_point(part.sets.free) is None:
            hint = "wider ranges, where a state may touch their ends; a shorter horizon"
            _both(case, part, "R(H) is empty: AC could leave K from every state", hint)
        else:
            _proved(case, part, ("ttf", "safer"), "R", polytopes.prove_free)


# ---------------------------------------------------------------- `ttf` and `safer`


def levels(case: Case) -> None:
    """S_0 ... S_(m-2); without a proof there are none."""
    problem = case.problem
    shown = seen(problem)
    for part in _parts(case):
        assert part.sets is not None
        states = [a.state for a in part.group.axes]
        names = [problem.quantities.states[s].name for s in states if s not in shown]
        topics = {problem.topic_leaf_of_state[s][0] for s in states if s in shown}
        several = problem.times.age_dm > 0 and len(topics) > 1
        if names or several:
            text = f"the DM sees no topic with {', '.join(names)}"
            text = text if names else "the DM sees this group in topics of different ages"
            hint = "one topic that shows all of the group's states, or write `ttf` and `safer`"
            _both(case, part, text, hint)
            continue
        why = _why_not(lambda part=part: polytopes.find_levels(part.sets))  # type: ignore[misc]
        empty = [j for j, s in enumerate(part.sets.allowed) if inner_point(s) is None]
        if why or empty:
            hint = "fewer levels, a smaller period, smaller errors, a stronger SC"
            _both(case, part, why or f"S_{empty[0]} is empty: AC would never get control", hint)
        elif _proved(case, part, ("ttf", "safer"), "S", polytopes.prove_levels):
            continue
        part.sets.allowed, part.sets.carried = [], []


def _both(case: Case, part: PolytopePart, text: str, hint: str) -> None:
    for claim in ("ttf", "safer"):
        case.fail(claim, text, hint=hint, part=part)


def inclusion(case: Case, predicate: str) -> None:
    """Where `ttf` may be false, or `safer` true, on an estimate of a state of C: in R(H)."""
    for part in _parts(case):
        wrong = _outside(case, part, predicate)
        if wrong is None:
            continue
        says = "may be false" if predicate == "ttf" else "may be true"
        case.fail(
            predicate,
            f"`{predicate}` {says} where it was not shown that AC stays in K for H",
            hint=f"a `{predicate}` that is more careful there, or none: then it is computed; "
            "a polytope ends where SC is clamped, a `grid` need not",
            part=part,
        )
        case.failures[-1].where = wrong


def _outside(case: Case, part: PolytopePart, predicate: str) -> Region | None:
    """A box of C where a predicate may let AC have control and R(H) was not shown, if any."""
    assert part.sets is not None
    forms, names = case.forms, case.problem.quantities.states
    own = [a.state for a in part.group.axes]
    rows, limits = part.sets.free.faces
    sizes, balls = np.abs(rows), exact(rows)
    first = np.array(part.limits, dtype=np.float64)
    width = np.maximum(first[:, 1] - first[:, 0], 1e-300)
    todo = [(first, 0)]
    looked = 0
    while todo:
        box, depth = todo.pop()
        looked += 1
        whole = forms.whole.copy()
        whole[own] = box
        if not forms.truth(predicate, whole) & MAY[predicate]:
            continue
        centre, radius = centred(box[:, 0], box[:, 1])
        flat = (balls @ exact(centre[:, None])).upper()[:, 0]
        excess = up_sum(flat, up_product(sizes, radius)) - limits
        if (excess <= 0).all():
            continue
        shares = (box[:, 1] - box[:, 0]) / width
        if looked > BOXES_MAX or shares.max() < SMALLEST:
            ends = zip(own, box, strict=True)
            return Region(tuple((names[s].name, float(a), float(b)) for s, (a, b) in ends))
        weight = sizes[int(np.argmax(excess))] * radius if depth % 2 else shares
        weight = np.where(shares >= SMALLEST, weight, -1.0)
        k = int(np.argmax(weight))
        middle = box[k, 0] / 2 + box[k, 1] / 2
        for end in (1, 0):
            half = box.copy()
            half[k, end] = middle
            todo.append((half, depth + 1))
    part.boxes[predicate] = looked
    return None


# ---------------------------------------------------------------- start and return


def start(case: Case, until_ns: int) -> None:
    """The initial states lie in R(h_0)."""
    for part in case.sets.polytopes:
        if part.sets is None:
            continue
        ends = [case.problem.initial[a.state] for a in part.group.axes]
        low, high = np.array([(i.low, i.high) for i in ends]).T
        box = Polytope(low, high, np.zeros((0, len(low))), np.zeros(0))

        def prove(sets: PolytopeSets, record: object, box: Polytope = box) -> None:
            polytopes.prove_start(sets, record, box, until_ns)  # type: ignore[arg-type]

        _proved(case, part, ("start",), "start", prove)


def targets(case: Case) -> Box | None:
    """Per polytope group a box of states all of whose estimates satisfy `safer`; None: none."""
    parts = case.sets.polytopes
    ends: Box = {}
    for p in parts:
        if p.sets is None:
            return None
        program = Program(p.sets.core)
        eye = np.eye(len(p.limits))
        for a, row, (low, high) in zip(p.group.axes, eye, p.limits, strict=True):
            least, most = -program.greatest(-row)[0], program.greatest(row)[0]
            ends[a.state] = (max(low, least), min(high, most))
    found = _box(case, "safer", ends) if parts else {}
    if found is None:
        return None
    for p in parts:
        assert p.sets is not None
        low, high = np.array([found[a.state] for a in p.group.axes]).T
        p.sets.target = Polytope(low, high, np.zeros((0, len(low))), np.zeros(0))
    return found


def recover(case: Case) -> int:
    """P2b of the polytope groups: the longest time in ns until all of them are in their Q."""
    times = case.problem.times
    for part in _parts(case):
        assert part.sets is not None
        if part.sets.target is None and not part.sets.allowed:
            hint = "what helps `safer`"
            case.fail("P2b", "there is no `safer` to return to", hint=hint, part=part)
            continue
        why = _why_not(lambda part=part: polytopes.find_return(part.sets))  # type: ignore[misc]
        if why or part.sets.kept is None:
            text = "no polytope was found that SC keeps inside `safer` and returns to"
            case.fail("P2b", text, hint="let SC come to rest where `safer` holds", part=part)
        elif _proved(case, part, ("P2b",), "Q", polytopes.prove_return):
            part.return_ns = part.sets.periods * times.delta_sc + times.jitter_sc
    return max((p.return_ns for p in case.sets.polytopes), default=0)


# ---------------------------------------------------------------- for people


def add_shares(case: Case) -> None:
    """Shares of the groups' ranges, sampled."""
    for part in case.sets.polytopes:
        if part.sets is None or part.shares:
            continue
        chance = np.random.default_rng(0)
        low, high = np.array([(a.edges[0], a.edges[-1]) for a in part.group.axes]).T
        points = chance.uniform(low, high, (SAMPLES, len(low)))
        inside = part.sets.core.contains(points)
        part.shares = {
            "core": float(inside.mean()),
            "free": float(part.sets.free.contains(points).mean()),
        }
        if part.deployed is not None:
            for name, s in zip(("lets_ac", "gives_back"), part.deployed, strict=True):
                part.shares[name] = float(s.contains(points).mean())
        elif not case.problem.computed:
            few = points[:SAMPLES_OF_PREDICATES]
            part.shares["lets_ac"] = _sampled(case, part, "ttf", few)
            part.shares["gives_back"] = _sampled(case, part, "safer", few)


def _sampled(case: Case, part: PolytopePart, predicate: str, points: Floats) -> float:
    """Share of points on whose estimates a predicate may let AC have control."""
    own = [a.state for a in part.group.axes]
    box = case.forms.whole.copy()
    count = 0
    for point in points:
        box[own, 0] = box[own, 1] = point
        count += bool(case.forms.truth(predicate, box) & MAY[predicate])
    return count / len(points)
