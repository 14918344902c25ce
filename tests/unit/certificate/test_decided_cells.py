"""Cells on which arrays decide a proposition: never otherwise than at points, or than Arb does."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from soter.certificate.batches import decided_cells
from soter.certificate.batches.ball_arrays import FAR, BallArray, no_underflow
from soter.certificate.batches.cell_arrays import boxes_of, contained, followed_beyond
from soter.certificate.batches.chain_walks import ArrayChain, Walk, _Attempt, unkept, unled
from soter.certificate.batches.decided_cells import FAILS, HOLDS, NEITHER, ArrayDecision
from soter.certificate.batches.part_walks import Try, unled_in_parts
from soter.certificate.inclusions import predicates
from soter.certificate.inclusions.cell_sets import Cells, Grid
from soter.certificate.inclusions.predicates import AdmitCheck, Decision, admitted
from soter.certificate.terms.arb_balls import above, below, exact
from soter.certificate.terms.terms import Linear, Proposition, Terms, both, either, negation
from unit.certificate.small_proofs import even_edges

EXTENTS = ((-2.0, 2.0), (-3.0, 3.0))
GRID = Grid((even_edges(-2.0, 2.0, 16), even_edges(-3.0, 3.0, 12)))
OPEN = Grid(GRID.edges, (True, False))
ERROR = 0.05


def _stops(terms: Terms, x: Linear, v: Linear, e: Linear) -> Proposition:
    """|x| + v^2/6 + e < 1.5 and |v| <= 2."""
    far = terms.function("abs", x)
    square = terms.multiply(v, v)
    room = terms.combine(
        [(exact(1.0), far), (exact(1.0) / 6, square), (exact(1.0), e)], exact(-1.5)
    )
    slow = terms.combine([(exact(1.0), terms.function("abs", v))], exact(-2.0))
    return both(terms.below(room), terms.below(slow, strict=False))


def _beside(terms: Terms, x: Linear, v: Linear, e: Linear) -> Proposition:
    """x + e > 1, or not v < x v, or min(x, v) <= -1.25."""
    gap = terms.combine([(exact(-1.0), x), (exact(-1.0), e)], exact(1.0))
    product = terms.subtract(v, terms.multiply(x, v))
    least = terms.combine([(exact(1.0), terms.minimum(x, v))], exact(1.25))
    return either(
        terms.below(gap), either(negation(terms.below(product)), terms.below(least, strict=False))
    )


def _edges(terms: Terms, x: Linear, v: Linear, e: Linear) -> Proposition:
    """x <= 0.5, which is an edge, or v >= -1.5, another one."""
    del e
    right = terms.combine([(exact(1.0), x)], exact(-0.5))
    low = terms.combine([(exact(-1.0), v)], exact(-1.5))
    return either(terms.below(right, strict=False), terms.below(low, strict=False))


def _root(terms: Terms, x: Linear, v: Linear, e: Linear) -> Proposition:
    """sqrt(x + 3) sin(v) < 1 + e."""
    root = terms.function("sqrt", terms.combine([(exact(1.0), x)], exact(3.0)))
    wave = terms.multiply(root, terms.function("sin", v))
    return terms.below(terms.combine([(exact(1.0), wave), (exact(-1.0), e)], exact(-1.0)))


def _near(terms: Terms, x: Linear, v: Linear, e: Linear) -> Proposition:
    """|x| + |v| + e < 4: so it is on outer cells, and not beyond them."""
    sizes = [(exact(1.0), terms.function("abs", z)) for z in (x, v)]
    return terms.below(terms.combine([*sizes, (exact(1.0), e)], exact(-4.0)))


PROPOSITIONS = {"near": _near, "stops": _stops, "beside": _beside, "edges": _edges, "root": _root}


def decision_of(name: str, ends: Any = EXTENTS) -> Decision:
    """A proposition over x, v and an error e."""
    terms = Terms()
    x, v = (terms.input("state", n, *map(exact, e)) for n, e in zip("xv", ends, strict=True))
    e = terms.input("box", "e", exact(-ERROR), exact(ERROR))
    truth = PROPOSITIONS[name](terms, x, v, e)
    model: Any = SimpleNamespace(extents=EXTENTS)
    return Decision(model, (0, 1), terms, [next(iter(s.terms)) for s in (x, v)], truth)


def every(grid: Grid) -> Cells:
    return Cells(grid, np.ones(grid.shape, dtype=np.bool_))


def point(decision: Decision, *numbers: float) -> int:
    """What Arb knows of a point of x, v and, where it is read, e."""
    count = 2 + len(decision.ranges)
    return decision.of([(exact(z), exact(z)) for z in numbers[:count]])


@pytest.mark.parametrize("name", sorted(PROPOSITIONS))
def test_what_arrays_decide_is_so_at_points_and_all_that_arb_decides(name: str) -> None:
    decision, draw = decision_of(name), np.random.default_rng(1)
    known = decision.decided(every(GRID), GRID.whole, 8)
    assert {HOLDS, FAILS} <= set(known.reshape(-1))
    for cell in np.ndindex(GRID.shape):
        block = tuple((i, i + 1) for i in cell)
        low, high = (
            np.array([e[i + k] for e, i in zip(GRID.edges, cell, strict=True)]) for k in (0, 1)
        )
        states = draw.uniform(low, high, (20, 2)).tolist()
        states += [[a, b] for a in (low[0], high[0]) for b in (low[1], high[1])]
        errors = draw.choice([-ERROR, 0.0, ERROR], len(states))
        bits = {point(decision, *s, e) for s, e in zip(states, errors, strict=True)}
        if known[cell] == HOLDS:
            assert FAILS not in bits, cell
        elif known[cell] == FAILS:
            assert not decision.holds_in(GRID, block, 4), cell
        if decision.of_cell(GRID, block) == FAILS:
            assert known[cell] == FAILS


@pytest.mark.parametrize("name", sorted(PROPOSITIONS))
def test_only_cells_that_are_asked_for_are_decided(name: str) -> None:
    decision = decision_of(name)
    draw = np.random.default_rng(2)
    whole = decision.decided(every(GRID), GRID.whole, 8)
    todo = Cells(GRID, draw.random(GRID.shape) < 0.7)
    block = ((2, 13), (1, 12))
    known = decision.decided(todo, block, 8)
    inside = np.zeros(GRID.shape, dtype=np.bool_)
    inside[2:13, 1:12] = True
    assert (known[~(inside & todo.members)] == NEITHER).all()
    assert np.array_equal(known[inside & todo.members], whole[inside & todo.members])


@pytest.mark.parametrize(
    ("name", "certain"), [("near", False), ("stops", False), ("beside", True), ("edges", True)]
)
def test_outer_cells_of_an_axis_without_ends_hold_all_that_lies_beyond(
    name: str, *, certain: bool
) -> None:
    """|x| < 4 fails far beyond the outer cells, which end at 2; x <= 0.5 holds far to the left."""
    decision = decision_of(name, ((-np.inf, np.inf), EXTENTS[1]))
    known, inner = (decision.decided(every(g), g.whole, 8) for g in (OPEN, GRID))
    assert np.array_equal(known[1:-1], inner[1:-1])
    assert not (known[[0, -1]] == HOLDS)[inner[[0, -1]] != HOLDS].any()
    for cell in np.ndindex(OPEN.shape):
        block = tuple((i, i + 1) for i in cell)
        if known[cell] == HOLDS:
            assert decision.holds_in(OPEN, block, 4)
    for outer in (known[0], known[-1]):
        assert (outer == HOLDS).any() == certain


def test_a_proposition_that_does_not_read_a_state_knows_nothing_beyond_it() -> None:
    decision = decision_of("root", EXTENTS)
    assert decision.reads == (True, True)
    terms = Terms()
    v = terms.input("state", "v", exact(-3.0), exact(3.0))
    x = terms.input("state", "x", exact(-np.inf), exact(np.inf))
    atoms = [next(iter(s.terms)) for s in (x, v)]
    model: Any = SimpleNamespace(extents=EXTENTS)
    slow = terms.below(terms.combine([(exact(1.0), v)], exact(-1.0)))
    decision = Decision(model, (0, 1), terms, atoms, slow)
    assert decision.reads == (False, True)
    assert len(OPEN.whole_boxes(((0, 1), (0, 1)), decision.reads)) == 1
    assert len(OPEN.whole_boxes(((0, 1), (0, 1)), (True, True))) > 1
    known = decision.decided(every(OPEN), OPEN.whole, 8)
    assert (known[:, :7] == HOLDS).all()
    assert (known[:, 8:] == FAILS).all()


def test_what_underflows_is_left_to_arb(monkeypatch: pytest.MonkeyPatch) -> None:
    def raises(*_: object) -> None:
        raise FloatingPointError

    monkeypatch.setattr(decided_cells, "_bits_of", raises)
    assert (decision_of("stops").decided(every(GRID), GRID.whole, 8) == NEITHER).all()


def test_of_few_cells_no_arrays_are_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(predicates, "decided", None)
    block = ((0, 7), (0, 9))
    assert (decision_of("stops").decided(every(GRID), block, 8) == NEITHER).all()


def test_runs_from_beyond_are_followed_as_one_by_one() -> None:
    draw = np.random.default_rng(6)
    edges = np.array(OPEN.edges[0])
    low = draw.choice(edges[:-1], 300)
    start = [(low, low + 0.25), (np.full(300, -1.0), np.full(300, 1.0))]
    boxes = []
    for _ in range(2):
        moved = low + draw.choice([-0.26, -0.25, -0.1, 0.0, 0.2, 0.25, 0.26], 300)
        boxes += [moved, moved + 0.25, np.full(300, -1.0), np.full(300, 1.0)]
    answers = np.broadcast_to(followed_beyond(OPEN, start, boxes), 300)
    seen = set()
    for k, answer in enumerate(answers):
        own = [(exact(a[k]), exact(b[k])) for a, b in start]
        one = OPEN.followed_beyond(own, [float(x[k]) for x in boxes])
        assert one or not answer
        seen.add((bool(answer), one))
    assert {(True, True), (False, False)} <= seen
    assert np.all(followed_beyond(OPEN, start, []))
    assert np.all(followed_beyond(GRID, start, boxes))


def test_the_inverse_of_what_is_far_is_small_and_does_not_underflow() -> None:
    sizes = np.array([2.0**1000, -(2.0**1000), 2.0 * FAR, 1.5 * FAR, 2.0, 0.0])
    radii = np.array([2.0**990, 0.0, 1.5 * FAR, 0.0, 0.5, 0.0])
    with no_underflow():
        image = BallArray(sizes, radii).inverse()
    low, high = image.lower(), image.upper()
    for k, (size, radius) in enumerate(zip(sizes, radii, strict=True)):
        for end in (size - radius, size, size + radius):
            if end:
                assert not exact(1.0) / exact(end) < exact(low[k])
                assert not exact(1.0) / exact(end) > exact(high[k])
    assert np.abs(high[:2]).max() <= 1.001 / FAR
    assert np.isinf(image.radius[[2, 5]]).all()  # type: ignore[index]


class Shift:
    """A step that moves a state of one axis by a distance, for one form or many."""

    def __init__(self, distance: float) -> None:
        self.distance = BallArray.of(distance)

    def of_many(self, form: Any) -> Any:
        low, high, middle, *rest = form
        low, high, middle = (x + self.distance for x in (low, high, middle))
        boxes = [form[0].min(low).lower(), form[1].max(high).upper()]
        return ((low, high, middle, *rest), boxes), np.ones(1, dtype=np.bool_)


def test_a_cell_of_which_a_part_fails_is_not_certain_though_all_others_hold() -> None:
    """Right of the middle of a cell it fails, and no part of the cell is left undecided."""

    def truth(form: Any) -> Any:
        low, high = form[0].centre, form[1].centre
        bits = np.where(high <= 0.5, HOLDS, np.where(low >= 0.5, FAILS, NEITHER))
        return (bits.astype(np.uint8),), np.ones(1, dtype=np.bool_)

    grid = Grid(((0.0, 1.0, 1.5),))
    decision = ArrayDecision(truth, [], (True,))
    known = decided_cells.decided(decision, every(grid), grid.whole, 3)
    assert list(known) == [FAILS, FAILS]
    half = Grid(((0.0, 0.5, 1.0),))
    assert list(decided_cells.decided(decision, every(half), half.whole, 3)) == [HOLDS, FAILS]


def test_cells_on_which_ac_may_be_let_wrongly_are_told() -> None:
    check = AdmitCheck.__new__(AdmitCheck)
    check.decision = decision_of("edges")
    free = np.zeros(GRID.shape, dtype=np.bool_)
    free[12, 0] = True
    check.group = SimpleNamespace(grid=GRID)  # type: ignore[assignment]
    told = {tuple(low for low, _ in block) for block in admitted(check, free, GRID.whole)}
    holds = {
        cell
        for cell in np.ndindex(GRID.shape)
        if GRID.edges[0][cell[0] + 1] <= 0.5 or GRID.edges[1][cell[1]] >= -1.5
    }
    assert told == set(np.ndindex(GRID.shape)) - holds - {(12, 0)}


@pytest.mark.parametrize("distance", [-0.07, -0.05, 0.05, 0.07])
@pytest.mark.parametrize("late", [False, True])
def test_cells_at_an_end_that_is_none_are_shown_where_runs_from_beyond_are_followed(
    distance: float, *, late: bool
) -> None:
    """Outer cells are 0.0625 wide: from them a run that moves farther inwards is not followed."""
    grid = Grid((even_edges(-2.0, 2.0, 64),), (True,))
    cells, step = every(grid), Shift(distance)
    still = Shift(0.0)
    first, last = (still, step) if late else (step, None)
    chain = ArrayChain(1, first, first, last, (first, first))
    walk = Walk(
        chain,
        cells,
        np.ones(grid.shape, dtype=np.uint8),
        np.ones(grid.shape, dtype=np.int64),
        lambda box: np.zeros(len(box[0]), dtype=np.int64),
    )
    missed = {0} if distance > 0.0625 else {63} if distance < -0.0625 else set()
    left, _ = unled(walk, cells.members, grid.whole, 1)
    assert set(np.flatnonzero(left)) == missed
    parts = unled_in_parts(walk, cells.members, [Try((chain,), 0, 0)])
    assert set(np.flatnonzero(parts)) == missed
    there_and_back = ArrayChain(1, first, Shift(-distance), last, (first, first))
    walk = Walk(there_and_back, cells, walk.holds + np.uint8(1), walk.order, walk.highest)
    if not late:
        assert set(np.flatnonzero(unled(walk, cells.members, grid.whole, 1)[0])) == missed
        once_more = unled_in_parts(walk, cells.members, [Try((there_and_back,), 0, 0)])
        assert set(np.flatnonzero(once_more)) == missed
        assert set(np.flatnonzero(unkept(step, 1, cells, cells, grid.whole, 1))) == missed


@pytest.mark.parametrize("at", [0, 63])
def test_of_a_block_without_cells_that_are_asked_for_nothing_is_left(at: int) -> None:
    grid = Grid((even_edges(-2.0, 2.0, 64),))
    step = Shift(0.0)
    walk = Walk(
        ArrayChain(1, step, step, None, (step, step)),
        every(grid),
        np.ones(grid.shape, dtype=np.uint8),
        np.ones(grid.shape, dtype=np.int64),
        lambda box: np.zeros(len(box[0]), dtype=np.int64),
    )
    todo = np.zeros(grid.shape, dtype=np.bool_)
    todo[at] = True
    left, _ = unled(walk, todo, ((1, 63),), 16)
    assert not left.any()


def test_a_box_far_beyond_an_end_that_is_none_lies_in_no_cell() -> None:
    grid = Grid((even_edges(-2.0, 2.0, 16),), (True,))
    ends = np.array([-6.5, -6.0, -2.5, 0.0, 5.9, 6.1, np.nan])
    box = [ends, ends + 0.05]
    answers = contained(every(grid), box)
    assert list(answers) == [
        every(grid).contains([float(x) for x in b]) for b in zip(*box, strict=True)
    ]
    assert set(answers) == {True, False}


class Undefined(Shift):
    """A step that is defined for no form."""

    def of_many(self, form: Any) -> Any:
        image, _ = super().of_many(form)
        return image, np.zeros(1, dtype=np.bool_)


@pytest.mark.parametrize("defined", [True, False])
def test_where_a_step_is_not_defined_nothing_is_shown_of_cells_seen_to_be_within(
    *, defined: bool
) -> None:
    grid = Grid((even_edges(-2.0, 2.0, 16),))
    step = (Shift if defined else Undefined)(0.0)
    walk = Walk(
        ArrayChain(1, step, step, None, (step, step)),
        every(grid),
        np.full(grid.shape, 3, dtype=np.uint8),
        np.ones(grid.shape, dtype=np.int64),
        lambda box: np.zeros(len(box[0]), dtype=np.int64),
    )
    left = np.ones(grid.shape, dtype=np.bool_)
    seen = np.full(grid.shape, 9, dtype=np.uint16)
    _Attempt(walk, [((k, k + 1),) for k in range(16)], left, seen).make()
    assert left.any() != defined


@pytest.mark.parametrize("seed", range(20))
def test_what_lies_beyond_many_blocks_is_what_lies_beyond_each(seed: int) -> None:
    draw = np.random.default_rng(seed)
    axes = int(draw.integers(1, 3))
    edges = tuple(even_edges(-1.0, 2.0 + k, 4) for k in range(axes))
    grid = Grid(edges, tuple(map(bool, draw.random(axes) < 0.6)))
    reads = tuple(map(bool, draw.random(axes) < 0.8))
    ends = np.sort(draw.integers(0, 5, (12, axes, 2)), axis=2)
    ends[..., 1] = np.maximum(ends[..., 1], ends[..., 0] + 1).clip(max=4)
    ends[..., 0] = np.minimum(ends[..., 0], ends[..., 1] - 1)
    blocks = [tuple((int(a), int(b)) for a, b in block) for block in ends]
    decision = ArrayDecision(lambda _: pytest.fail("asked"), (), reads)
    found: dict[int, list[tuple[float, ...]]] = {}
    for index, boxes in decided_cells._beyond(decision, grid, blocks, boxes_of(grid, blocks)):
        for k, box in zip(
            index, zip(*(x for pair in boxes for x in pair), strict=True), strict=True
        ):
            found.setdefault(int(k), []).append(tuple(map(float, box)))
    for k, block in enumerate(blocks):
        whole = grid.whole_boxes(block, reads)[1:]
        wanted = [tuple(x for a, b in box for x in (below(a), above(b))) for box in whole]
        assert sorted(found.get(k, [])) == sorted(wanted)


@pytest.mark.parametrize("at_once", [1, 5, 4096])
def test_blocks_are_decided_in_parts_as_all_at_once(
    monkeypatch: pytest.MonkeyPatch, at_once: int
) -> None:
    """x <= 3 holds of no cell at the upper end of an axis without ends."""
    monkeypatch.setattr(decided_cells, "AT_ONCE", at_once)
    grid = Grid((even_edges(-1.0, 1.0, 8), even_edges(0.0, 1.0, 2)), (True, False))

    def truth(form: Any) -> Any:
        high = form[1].upper()
        return (np.where(high <= 3.0, HOLDS, FAILS).astype(np.uint8),), True

    decision = ArrayDecision(truth, (), (True, True))
    blocks = [((i, i + 1), (j, j + 1)) for j in range(2) for i in range(8)]
    bits = decided_cells._bits_of(decision, grid, blocks)
    assert list(bits) == [HOLDS] * 7 + [HOLDS | FAILS] + [HOLDS] * 7 + [HOLDS | FAILS]


def test_nothing_is_kept_by_a_step_that_underflows() -> None:
    class Underflows(Shift):
        def of_many(self, form: Any) -> Any:
            raise FloatingPointError(form)

    grid = Grid((even_edges(-2.0, 2.0, 16),))
    cells = every(grid)
    step = Underflows(0.0)
    assert unkept(step, 1, cells, cells, grid.whole, 1).all()
    assert unkept(Shift(0.0), 1, cells, cells, grid.whole, 1).sum() == 2  # at the ends, by rounding


class Bare(Shift):
    """The same without the boxes on the way."""

    def of_many(self, form: Any) -> Any:
        (after, _), sure = super().of_many(form)
        return (after, []), sure


class Last(Shift):
    """A last step with boxes at so many distances."""

    def __init__(self, *distances: float) -> None:
        super().__init__(0.0)
        self.distances = distances

    def of_many(self, form: Any) -> Any:
        boxes = [end for d in self.distances for end in (form[0].lower() + d, form[1].upper() + d)]
        return (form, boxes), np.ones(1, dtype=np.bool_)


CELL, FIRST = 0.25, 4
"""Not at the end of the grid: boxes are rounded outwards."""


def left_of_walk(
    blocks: list[tuple[int, int]],
    *,
    holds: list[int],
    seen: list[int] | None = None,
    within: range = range(16),
    last: Last | None = None,
    highest: float = np.inf,
) -> list[int]:
    """Cells that blocks of 16 cells from -2 on leave, each hold of which moves them one cell up.

    Shown is what ends below `highest`. `holds`, `seen`: of the cells from `FIRST` on.
    """
    grid = Grid((even_edges(-2.0, 2.0, 16),))
    members = np.isin(np.arange(16), within)
    step, bare = Shift(CELL), Bare(CELL)
    walk = Walk(
        ArrayChain(1, step, step, last, (bare, bare)),
        Cells(grid, members),
        np.array([1] * FIRST + holds + [1] * (16 - FIRST - len(holds)), dtype=np.uint8),
        np.ones(16, dtype=np.int64),
        lambda box: np.where(box[1] < highest, 0, 5),
    )
    left = np.zeros(16, dtype=np.bool_)
    for first, end in blocks:
        left[first:end] = True
    seen_until = np.zeros(16, dtype=np.uint16)
    seen_until[FIRST : FIRST + len(seen or [])] = seen or []
    _Attempt(walk, [(b,) for b in blocks], left, seen_until).make()
    return [int(k) for k in np.flatnonzero(left)]


def test_a_cell_is_shown_after_its_own_number_of_holds() -> None:
    """Two cells in a block: after one hold both end low enough, after two they do not."""
    assert left_of_walk([(4, 6)], holds=[1, 2], highest=-0.1) == [5]
    assert left_of_walk([(4, 6)], holds=[1, 2], highest=0.1) == []
    assert left_of_walk([(4, 6)], holds=[2, 2], highest=-0.1) == [4, 5]


def test_a_block_was_seen_within_as_long_as_all_of_its_cells_were() -> None:
    outside = range(3, 6)
    assert left_of_walk([(4, 6)], holds=[1, 1], seen=[9, 9], within=outside) == []
    assert left_of_walk([(4, 6)], holds=[1, 1], seen=[9, 0], within=outside) == [4, 5]
    assert left_of_walk([(4, 6)], holds=[1, 1], seen=[0, 9], within=outside) == [4, 5]


def test_a_block_that_was_seen_within_says_nothing_of_another() -> None:
    """The first was; the second leaves on the way."""
    blocks, within = [(4, 6), (8, 10)], range(3, 10)
    assert left_of_walk(blocks, holds=[1], seen=[9, 9], within=within) == [8, 9]
    assert left_of_walk(blocks, holds=[1], seen=[9] * 6, within=within) == []


def test_every_box_in_which_a_state_may_be_at_last_counts() -> None:
    for distances, shown in (((0.0, 0.0), True), ((1.0, 0.0), False), ((0.0, 1.0), False)):
        left = left_of_walk([(4, 6)], holds=[1, 1], last=Last(*distances), highest=-0.1)
        assert left == ([] if shown else [4, 5])


def test_every_box_of_the_last_step_lies_within() -> None:
    for distances, shown in (((0.0, 0.0), True), ((1.0, 0.0), False), ((0.0, 1.0), False)):
        left = left_of_walk([(4, 6)], holds=[1, 1], last=Last(*distances), within=range(3, 9))
        assert left == ([] if shown else [4, 5])
