"""Cells, blocks and boxes, each against a list of all cells or points."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.cell_sets import (
    Cells,
    Grid,
    block_index,
    cell_count,
    cells_uncovered,
    cells_unshown,
    cut_block,
    halves_of_block,
    holds_in_parts,
    smallest_block,
)
from soter.certificate.extras.left_out_states import WIDER, has_no_ends, intervals_beyond
from soter.certificate.reading.case_model import FARTHEST
from soter.certificate.terms.linear_enclosures import exact
from tables import all_rows
from unit.certificate.grid_tables import grid_beyond

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    Block = tuple[tuple[int, int], ...]

EDGES = (0.0, 1.0, 3.0, 6.0)
PLANE = Grid((EDGES, (-1.0, 0.0, 0.5)))
SHAPES: list[tuple[int, ...]] = [(1,), (5,), (3, 2), (1, 4), (2, 3, 2)]


def plain(shape: tuple[int, ...], *unbounded: bool) -> Grid:
    edges = tuple(tuple(float(k) for k in range(n + 1)) for n in shape)
    return grid_beyond(edges, unbounded) if unbounded else Grid(edges)


def blocks_of(shape: tuple[int, ...]) -> Iterator[Block]:
    axes = [[(a, b) for a in range(n) for b in range(a + 1, n + 1)] for n in shape]
    return itertools.product(*axes)


def cells_in(block: Block) -> set[tuple[int, ...]]:
    return set(itertools.product(*(range(a, b) for a, b in block)))


# ---------------------------------------------------------------- grids


def test_the_cells_of_a_box_are_those_with_points_of_it_inside() -> None:
    values = [-0.5, 0.0, 0.25, 1.0, 2.0, 3.0, 4.5, 6.0, 6.5]
    grid = Grid((EDGES,))
    for low, high in itertools.product(values, repeat=2):
        found = grid.cells_around((low, high))
        if low < 0 or high > 6:
            assert found is None
        elif low < high:
            inner = [i for i in range(3) if low < EDGES[i + 1] and high > EDGES[i]]
            assert found == ((inner[0], inner[-1] + 1),)
        elif low == high:
            assert found is not None
            ((first, last),) = found
            assert last == first + 1
            assert EDGES[first] <= low <= EDGES[last]


def test_boxes_stand_one_after_the_other() -> None:
    members = np.array([[True, False], [True, True], [False, True]])
    cells = Cells(PLANE, members)
    boxes = [
        (0.0, 1.0, -1.0, 0.0),
        (1.0, 3.0, -1.0, 0.5),
        (0.5, 2.0, -0.5, 0.25),
        (3.0, 6.0, 0.0, 0.5),
    ]
    inside = [True, True, False, True]
    assert PLANE.cells_around(boxes[1]) == ((1, 2), (0, 2))
    for count in range(4):
        for chosen in itertools.permutations(range(4), count):
            flat = [x for k in chosen for x in boxes[k]]
            assert cells.contains_all(flat) is all(inside[k] for k in chosen)
            for at, k in enumerate(chosen):
                assert cells.contains(flat, 4 * at) is inside[k]
                assert PLANE.cells_around(flat, 4 * at) == PLANE.cells_around(boxes[k])
    assert cells.contains((0.0, 6.0, -1.0, 0.6)) is False
    assert cells.contains((0.0, 7.0, -1.0, 0.0)) is False


def test_beyond_an_axis_without_ends_as_far_as_it_is_wide() -> None:
    grid = grid_beyond((EDGES,), (True,))
    for low, high, block in (
        (-6.0, -6.0, (0, 1)), (-6.0, 0.5, (0, 1)), (-6.1, 0.5, None), (12.0, 12.0, (2, 3)),
        (2.0, 12.0, (1, 3)), (2.0, 12.1, None), (-1.0, 7.0, (0, 3)), (3.0, 2.0, None),
    ):  # fmt: skip
        assert grid.cells_around((low, high)) == (None if block is None else (block,))
    shifted = grid_beyond(((2.0, 3.0, 4.0),), (True,))
    for low, fine in ((0.0, True), (-0.5, False)):
        assert (shifted.cells_around((low, 3.0)) is not None) is fine
    for high, fine in ((6.0, True), (6.5, False)):
        assert (shifted.cells_around((3.0, high)) is not None) is fine


def test_which_axes_have_no_ends_and_how_many_cells() -> None:
    assert [has_no_ends(PLANE, k) for k in (0, 1)] == [False, False]
    mixed = grid_beyond(PLANE.edges, (False, True))
    assert [has_no_ends(mixed, k) for k in (0, 1)] == [False, True]
    assert PLANE.shape == (3, 2)
    assert PLANE.all_cells == ((0, 3), (0, 2))
    box = PLANE.box_of(((1, 3), (0, 1)))
    assert [(float(a), float(b)) for a, b in box] == [(1.0, 6.0), (-1.0, 0.0)]
    assert PLANE.block_in_words(((1, 3), (0, 1))) == "[1, 6] x [-1, 0]"


def test_runs_beyond_an_end_are_followed_while_they_stay_in_the_last_cell() -> None:
    """The last cell is 3 wide, the first one 1."""
    grid = grid_beyond((EDGES, EDGES), (True, False))

    def follows(start: tuple[float, float], *boxes: tuple[float, float]) -> bool:
        flat = [x for box in boxes for x in (*box, -50.0, 50.0)]
        return grid.holds_beyond_ends([(exact(a), exact(b)) for a, b in (start, (0.0, 6.0))], flat)

    for low in (3.0, 4.0):
        for least in (low, low - 3.0, low - 3.25):
            for most in (low, 9.0, 20.0):
                fine = least >= low - 3.0
                assert follows((low, 6.0), (least, most)) is fine
                assert follows((low, 6.0), (low, low), (least, most)) is fine
                assert follows((low, 6.0), (least, most), (low, low)) is fine
                assert follows((low, 5.5), (least, most)) is True
    for high in (0.5, 1.0):
        for most in (high, high + 1.0, high + 1.25):
            for least in (high, -3.0, -20.0):
                fine = most <= high + 1.0
                assert follows((0.0, high), (least, most)) is fine
                assert follows((0.0, high), (high, high), (least, most)) is fine
                assert follows((0.0, high), (least, most), (high, high)) is fine
                assert follows((0.25, high), (least, most)) is True
    assert follows((0.0, 6.0)) is True
    assert follows((0.0, 6.0), (-3.0, 7.0)) is True
    assert follows((0.0, 6.0), (-3.1, 7.0)) is False
    assert follows((0.0, 6.0), (-3.0, 7.1)) is False
    hair = exact(2.0**-60)  # of what is no double nothing is rounded
    plane = [exact(0.0), exact(6.0)]
    for start, box, fine in (
        ((exact(4.0) + hair, exact(6.0)), [1.0, 6.0], False),
        ((exact(4.0) - hair, exact(6.0)), [1.0, 6.0], True),
        ((exact(0.0), exact(1.0) - hair), [0.0, 2.0], False),
        ((exact(0.0), exact(1.0) + hair), [0.0, 2.0], True),
        ((exact(0.0) + hair, exact(6.0) - hair), [-9.0, 9.0], True),
    ):
        assert grid.holds_beyond_ends([start, tuple(plane)], [*box, -50.0, 50.0]) is fine  # type: ignore[list-item]
    second = grid_beyond((EDGES, EDGES), (False, True))
    start = [(exact(0.0), exact(6.0)), (exact(3.0), exact(6.0))]  # type: ignore[assignment]
    assert second.holds_beyond_ends(start, [-50.0, 50.0, 0.0, 6.0]) is True  # type: ignore[arg-type]
    assert second.holds_beyond_ends(start, [-50.0, 50.0, -0.5, 6.0]) is False  # type: ignore[arg-type]


@pytest.mark.parametrize("edges", [(2.0, 3.0, 5.0), (-5.0, -1.0, 0.0), (0.0, 1.0)])
def test_what_lies_beyond_is_covered_without_gaps(edges: tuple[float, ...]) -> None:
    grid = grid_beyond((edges, EDGES), (True, False))
    width = edges[-1] - edges[0]
    up = intervals_beyond(edges, low=False, high=True)
    down = intervals_beyond(edges, low=True, high=False)
    assert intervals_beyond(edges, low=False, high=False) == []
    assert len(intervals_beyond(edges, low=True, high=True)) == len(up) + len(down)
    for intervals in (up, [(-b, -a) for a, b in down]):
        end = edges[-1] if intervals is up else -edges[0]
        assert intervals[0][0] == end
        assert not intervals[-1][1] < FARTHEST
        assert len(intervals) == math.ceil((1000 - math.log2(width)) / math.log2(WIDER)) + 1
        for k, (low, high) in enumerate(intervals):
            assert low < high
            most = min(end + width * float(WIDER) ** min(k, 125), 2.0**1000)
            assert float(high) == pytest.approx(most)
        for (_, before), (after, _) in itertools.pairwise(intervals):
            assert before is after or str(before) == str(after)
    shape = grid.shape
    for block in blocks_of(shape):
        for reads in itertools.product((True, False), repeat=2):
            boxes = grid.boxes_covering(block, reads)
            more = (len(down) if block[0][0] == 0 else 0) + (
                len(up) if block[0][1] == shape[0] else 0
            )
            assert len(boxes) == 1 + (more if reads[0] else 0)
            assert boxes[0] == grid.box_of(block)
            assert all(box[1] == boxes[0][1] for box in boxes)
    ended = Grid(grid.edges)
    assert ended.boxes_covering(ended.all_cells, (True, True)) == [ended.box_of(ended.all_cells)]


# ---------------------------------------------------------------- sets


@pytest.mark.parametrize("shape", SHAPES)
def test_sets_are_counted_and_blocks_cut(shape: tuple[int, ...]) -> None:
    draw = np.random.default_rng(len(shape))
    for share in (0.0, 0.6, 1.0):
        members = draw.random(shape) < share
        cells = Cells(plain(shape), members)
        assert cells.size == members.sum()
        for block in blocks_of(shape):
            inside = [bool(members[c]) for c in cells_in(block)]
            assert cell_count(block) == len(inside)
            assert cells.members_in(block) == sum(inside)
            assert cells.contains([float(x) for ends in block for x in ends]) is all(inside)
            assert (members[block_index(block)].sum()) == sum(inside)
    for block in blocks_of(shape):
        lengths = [b - a for a, b in block]
        if cell_count(block) > 1:
            one, other = halves_of_block(block)
            assert cells_in(one) | cells_in(other) == cells_in(block)
            assert cell_count(one) + cell_count(other) == cell_count(block)
            (axis,) = [k for k in range(len(block)) if one[k] != block[k]]
            assert lengths[axis] == max(lengths)
            assert 0 <= cell_count(other) - cell_count(one) <= cell_count(block) // lengths[axis]
        for count in (1, 2, 3, 100):
            cut = cut_block(block, count)
            assert len(cut) == min(count, cell_count(block))
            assert set().union(*map(cells_in, cut)) == cells_in(block)
            assert sum(map(cell_count, cut)) == cell_count(block)
    with pytest.raises(AssertionError):
        Cells(plain(shape), np.ones((*shape, 1), dtype=np.bool_))


def test_the_largest_part_is_cut_first() -> None:
    cut = cut_block(((0, 9),), 4)
    assert sorted(map(cell_count, cut)) == [2, 2, 2, 3]


def test_a_block_around_what_is_wanted() -> None:
    block = ((2, 5), (1, 5))
    for chosen in itertools.combinations(itertools.product(range(3), range(4)), 2):
        wanted = np.zeros((3, 4), dtype=np.bool_)
        for cell in chosen:
            wanted[cell] = True
        (a, b), (c, d) = zip(*chosen, strict=True)
        assert smallest_block(wanted, block) == (
            (2 + min(a, b), 3 + max(a, b)),
            (1 + min(c, d), 2 + max(c, d)),
        )
    index = block_index(((3, 5), (1, 2)), (2, 1))
    assert index == (slice(1, 3), slice(0, 1))
    assert block_index(block) == (slice(2, 5), slice(1, 5))


@all_rows("largest", [1, 3, 100])
@all_rows("seed", range(4))
def test_what_no_attempt_showed_is_left(largest: int, seed: int) -> None:
    """Attempts are made on blocks without cells around them that are not wanted, ever smaller."""
    draw = np.random.default_rng(seed)
    shape, block = (7, 6), ((1, 7), (0, 5))
    todo = draw.random(shape) < 0.5
    shown_from = draw.integers(0, 4, shape)  # 0: never, else in blocks of so many cells at most
    limits = {0: 0, 1: 1, 2: 4, 3: 1000}
    asked: list[int] = []
    done = np.zeros(shape, dtype=np.bool_)

    def attempt(at: Block, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        assert (wanted == (todo & ~done)[block_index(at)]).all()
        assert smallest_block(wanted, at) == at
        asked.append(cell_count(at))
        shown = np.zeros_like(wanted)
        for cell in cells_in(at):
            if todo[cell] and cell_count(at) <= limits[int(shown_from[cell])]:
                shown[tuple(c - low for c, (low, _) in zip(cell, at, strict=True))] = True
                done[cell] = True
        return shown

    left = list(cells_unshown(todo, block, attempt, largest))
    assert all(cell_count(cell) == 1 for cell in left)
    wanted = {c for c in cells_in(block) if todo[c] and shown_from[c] == 0}
    assert {tuple(a for a, _ in cell) for cell in left} == wanted
    assert len(left) == len(wanted)
    assert max(asked) <= largest
    if largest == 100:
        assert asked[0] > 4
        assert all(n <= asked[0] // 4 for n in asked[1:])


def test_a_block_is_covered_where_all_of_it_is_wanted() -> None:
    todo = np.array([[True, True, False], [True, True, True]])
    asked: list[Block] = []

    def attempt(at: Block) -> bool:
        assert todo[block_index(at)].all()
        asked.append(at)
        return cell_count(at) <= 2 and (1, 2) not in cells_in(at)

    assert list(cells_uncovered(todo, ((0, 2), (0, 3)), attempt, 100)) == [((1, 2), (2, 3))]
    assert list(cells_uncovered(np.zeros_like(todo), ((0, 2), (0, 3)), attempt, 100)) == []
    assert list(cells_uncovered(todo, ((0, 2), (0, 1)), lambda _: True, 100)) == []
    four = np.ones((2, 2), dtype=np.bool_)
    tried: list[int] = []
    four_cells = ((0, 2), (0, 2))
    walk = cells_uncovered(four, four_cells, lambda at: not tried.append(cell_count(at)), 4)  # type: ignore[func-returns-value]
    assert not list(walk)
    assert tried == [4]


@pytest.mark.parametrize("splits", [0, 1, 2, 5])
def test_parts_of_a_box_are_all_of_it(splits: int) -> None:
    """Cut along one axis after the other, and not where it works at once."""
    box = [(exact(0.0), exact(8.0)), (exact(0.0), exact(4.0))]
    seen: list[tuple[float, ...]] = []
    done: list[tuple[float, ...]] = []

    def attempt(part: Any) -> bool:
        ends = tuple(float(x) for pair in part for x in pair)
        seen.append(ends)
        if ends[1] - ends[0] <= 4.0 and ends[3] - ends[2] <= 2.0:
            done.append(ends)
            return True
        return False

    assert holds_in_parts(box, attempt, splits) is (splits >= 2)
    area = sum((b - a) * (d - c) for a, b, c, d in done)
    assert splits < 2 or area == 32.0
    assert len(set(seen)) == len(seen)
    assert len(seen) == (7 if splits >= 2 else splits + 1)
    fails: list[Any] = []
    assert not holds_in_parts(box, lambda part: bool(fails.append(part)), splits)  # type: ignore[func-returns-value]
    assert len(fails) == splits + 1  # the first half of the first half ...
    last = fails[-1]
    assert math.isclose(float(last[0][1] * last[1][1]), 32.0 / 2**splits)
