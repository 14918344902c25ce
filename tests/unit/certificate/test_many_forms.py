"""Steps of many forms at once: they enclose runs, and are as narrow as those of one form."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.batches import chain_walks, part_walks
from soter.certificate.batches.ball_arrays import BallArray, no_underflow
from soter.certificate.batches.cell_arrays import boxes_of, contained
from soter.certificate.batches.form_arrays import box_of, of_boxes
from soter.certificate.batches.local_flows import LocalFlows
from soter.certificate.batches.part_walks import SAMPLE, Try, unled_in_parts
from soter.certificate.inclusions import group_claims
from soter.certificate.inclusions.cell_sets import Cells, Grid, block_index, parts
from soter.certificate.inclusions.group_claims import (
    ChainCheck,
    FreeCheck,
    GroupTables,
    free,
    ranked,
    witnessed,
)
from soter.certificate.inclusions.inward_flow import ClippedStep
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.terms.arb_balls import exact
from soter.certificate.terms.compile_terms import form_of_box
from unit.certificate import small_proofs, test_local_chains
from unit.certificate.test_local_chains import THINGS, TIMES, Runs, group_of, inside, sure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from bench.recheck.corruptions import Sealed
    from flint import arb

    from soter.certificate.batches.ball_arrays import Floats

WIDER = 1.001


def of_one(boxes: Sequence[Floats], k: int) -> list[float]:
    """The boxes of the kth of some forms."""
    return [float(x[k] if len(x) > 1 else x[0]) for x in boxes]


def widths(box: Sequence[float]) -> Floats:
    both: Floats = np.array(box[1::2]) - np.array(box[::2])
    return both


def alike(boxes: Sequence[float], others: Sequence[float]) -> bool:
    """Neither is narrower or wider than it may be where it is computed once more."""
    one, other = widths(boxes), widths(others)
    return bool(np.all(np.abs(one - other) <= (WIDER - 1.0) * other + 1e-9))


@pytest.mark.parametrize("times", TIMES)
@pytest.mark.parametrize("name", sorted(THINGS))
def test_chains_of_many_forms_enclose_runs(
    tmp_path: Path, name: str, times: tuple[int, int, int]
) -> None:
    thing = THINGS[name]
    model = test_local_chains.model_of(tmp_path, thing, *times)
    group = group_of(model)
    chain = ChainCheck(model, group).chain(1)
    arrays = sure(chain.arrays)
    draw = np.random.default_rng(1)
    blocks = [tuple((int(i), int(i) + 1) for i in draw.integers(6, 34, 2)) for _ in range(3)]
    many, holds = of_boxes(boxes_of(group.grid, blocks)), 5
    forms = [form_of_box(group.grid.box(b), symbols=True) for b in blocks]
    ends = [[float(x) for interval in group.grid.box(b) for x in interval] for b in blocks]
    runs = [Runs(thing, model, e, seed) for seed, e in enumerate(ends)]
    states = [r.chain(holds) for r in runs]
    before = 0
    for k in range(holds):
        with no_underflow():
            (many, boxes), defined = (arrays.later if k else arrays.first).of_many(many)
        assert np.all(defined)
        after = (k + 1) * runs[0].delta - runs[0].j
        for j, (run, _) in enumerate(states):
            own = of_one(boxes, j)
            for tick in range(before, after + 1):
                assert inside(own, run[tick]).all(), (k, tick)
            image = of_one(box_of(many, 2), j)
            assert inside(image, run[after]).all()
            forms[j], one = sure((chain.later if k else chain.first)(forms[j]))
            alone = [float(x) for x in forms[j][:4]]
            assert alike(image, alone)
            assert alike(own, one)
        before = after
    if chain.last is None:
        return
    with no_underflow():
        (_, boxes), defined = sure(arrays.last).of_many(many)
    assert np.all(defined)
    for j, (run, acts) in enumerate(states):
        for at, tick in enumerate(acts[holds]):
            state = tuple(s[at : at + 1] for s in run[tick])
            assert inside(of_one(boxes, j), state).all()


@pytest.mark.parametrize("name", sorted(THINGS))
def test_free_phases_of_many_forms_enclose_runs(tmp_path: Path, name: str) -> None:
    thing = THINGS[name]
    model = test_local_chains.model_of(tmp_path, thing, 15, 20, 3)
    group = group_of(model)
    (step,) = FreeCheck(model, group, 80_000_000).phase(4).steps
    assert isinstance(step, chain_walks.ArrayStep)
    blocks = [((10, 12), (20, 22)), ((18, 19), (17, 18))]
    with no_underflow():
        (_, boxes), defined = step.of_many(of_boxes(boxes_of(group.grid, blocks)))
    assert np.all(defined)
    for j, block in enumerate(blocks):
        own = of_one(boxes, j)
        ends = [float(x) for interval in group.grid.box(block) for x in interval]
        for state in Runs(thing, model, ends, j).free(80):
            assert inside(own, state).all()
        one = sure(step(form_of_box(group.grid.box(block), symbols=True)))[1]
        assert alike(own, one)


def test_a_form_that_leaves_the_domain_is_not_defined(tmp_path: Path) -> None:
    """One that is not defined leaves the others as they are."""
    model = test_local_chains.model_of(tmp_path, THINGS["limited"], 15, 20, 3)
    grid = Grid(tuple(small_proofs.even_edges(9.0 * a, 9.0 * b, 40) for a, b in model.extents))
    arrays = sure(ChainCheck(model, group_of(model)).chain(1).arrays)
    blocks = [((20, 21), (20, 21)), ((39, 40), (39, 40))]
    with no_underflow():
        _, defined = arrays.first.of_many(of_boxes(boxes_of(grid, blocks)))
    assert list(defined) == [True, False]


def test_boxes_are_contained_as_one_by_one() -> None:
    draw = np.random.default_rng(5)
    grid = Grid((small_proofs.even_edges(-1.0, 1.0, 7), small_proofs.even_edges(0.0, 2.0, 5)))
    cells = Cells(grid, draw.random(grid.shape) < 0.8)
    edges = [np.array(e) for e in grid.edges]
    seen = set()
    for _ in range(30):
        box = []
        for e in edges:
            low = np.where(draw.random(50) < 0.5, draw.choice(e, 50), draw.uniform(-1.2, 2.2, 50))
            box += [low, low + draw.choice([0.0, 1e-16, 0.2, e[1] - e[0], 0.9], 50)]
        box[0][0] = np.nan
        answers = contained(cells, box)
        for k, answer in enumerate(answers):
            assert answer == cells.contains([float(x[k]) for x in box])
            seen.add(bool(answer))
    assert seen == {True, False}


def test_what_arrays_show_is_what_arb_shows(
    tmp_path: Path, sealed: Sealed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the cart's tables, right ones and wrong ones: the same cells are left either way."""
    path = tmp_path / "cart.soter"
    path.write_text(sealed.cart.text())
    facts = small_proofs.facts_of(path, "Track", "SafeCart")
    model = CaseModel(facts, (), tuple(facts.axes[i] for i in range(2)))
    grid = Grid(tuple(tuple(float(x) for x in e) for e in sealed.edges))
    tables = sealed.as_tables()
    group = GroupTables(
        (0, 1), grid, tables.core, tables.free > 0, tables.home, tables.rank, tables.rank_holds
    )
    core, home = Cells(grid, group.core > 0), Cells(grid, tables.home > 0)
    fewer = Cells(grid, core.members & (np.arange(grid.shape[0]) % 9 > 0)[:, None])
    none = Cells(grid, home.members & False)
    every = Cells(grid, np.ones(grid.shape, dtype=np.bool_))
    horizon = facts.times["H_ns"]
    monkeypatch.setattr(ChainCheck, "leads_in_parts", lambda *_: False)  # of single cells, by Arb
    left: list[list[set[Any]]] = []
    for few in (1, 1 << 30):
        monkeypatch.setattr(chain_walks, "FEW", few)
        check, phase = ChainCheck(model, group), FreeCheck(model, group, horizon)
        part = parts(grid.whole, 8)[3]
        left.append(
            [
                set(witnessed(check, group.core, every, core, part)),
                set(witnessed(check, group.core, every, fewer, part)),
                set(ranked(check, home, part)),
                set(ranked(check, none, part)),
                set(free(phase, Cells(grid, tables.free > 0), core, part)),
                set(free(phase, core, core, part)),
            ]
        )
        monkeypatch.setattr(group_claims, "unkept", _nothing_shown)
    assert left[0] == left[1]
    assert [bool(x) for x in left[0]] == [False, True, False, True, False, True]


def _nothing_shown(*of: Any) -> Any:
    """In place of `chain_walks.unkept`."""
    claimed, block = of[2], of[4]
    members = np.zeros_like(claimed.members)
    members[block_index(block)] = claimed.members[block_index(block)]
    return members


def test_ends_that_the_flow_keeps_cut_off_the_boxes_of_many() -> None:
    """As those of one, on the sides that are kept alone."""

    class Wider:
        """A step that makes boxes twice as wide."""

        def __call__(self, form: tuple[arb, ...]) -> Any:
            low, high = form[0], form[1]
            return (low * 2, high * 2, *form[2:]), (float(low * 2), float(high * 2))

        def of_many(self, form: Any) -> Any:
            low, high = 2 * form[0], 2 * form[1]
            return ((low, high, *form[2:]), [low.lower(), high.upper()]), True

    lows, highs = np.array([-1.0, 0.25, -0.5]), np.array([-0.5, 1.0, 0.75])
    for kept in ([(True, True)], [(True, False)], [(False, True)]):
        step = ClippedStep(kept, [(-1.0, 1.0)], Wider())
        (after, boxes), _ = step.of_many(of_boxes([(lows, highs)]))
        ends = box_of(after, 1)
        for k, interval in enumerate(zip(lows, highs, strict=True)):
            low, high = (exact(float(x)) for x in interval)
            one, box = sure(step(form_of_box([(low, high)], symbols=True)))
            assert of_one(boxes, k) == pytest.approx(list(box), abs=1e-12)
            assert of_one(ends, k) == pytest.approx([float(x) for x in one[:2]], abs=1e-12)
            assert (boxes[0][k] >= -1.0) == (kept[0][0] or lows[k] > -0.5)


def test_parts_of_many_cells_lead_where_those_of_one_do(
    tmp_path: Path, sealed: Sealed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cells that as a whole do not lead far enough: the same ones do in parts, and in windows."""
    monkeypatch.setattr(group_claims, "LED_IN", ((0, 0), (2, 2)))
    monkeypatch.setattr(group_claims, "LED_IN_MANY", ((0, 0), (2, 2)))
    path = tmp_path / "cart.soter"
    path.write_text(sealed.cart.text())
    facts = small_proofs.facts_of(path, "Track", "SafeCart")
    model = CaseModel(facts, (), tuple(facts.axes[i] for i in range(2)))
    grid = Grid(tuple(tuple(float(x) for x in e) for e in sealed.edges))
    check = ChainCheck(model, GroupTables((0, 1), grid, sealed.tables["K"]))
    every = Cells(grid, np.ones(grid.shape, dtype=np.bool_))
    cells = np.argwhere((sealed.tables["W"] > 0) & (sealed.tables["W_N"] <= 5))
    cells = cells[np.random.default_rng(3).integers(len(cells), size=4)]
    answers = set()
    for shrunk in (0.5, 0.75, 1.0):
        for cell in cells:
            block = tuple((int(i), int(i) + 1) for i in cell)
            holds = int(sealed.tables["W_N"][tuple(cell)])
            ends = sure(list(check.reached(block, [holds], every, _unseen(grid))))[0][1]
            target = Cells(grid, np.zeros(grid.shape, dtype=np.bool_))
            for end in ends:
                low, high = np.array(end[::2]), np.array(end[1::2])
                middle, half = (low + high) / 2, (high - low) / 2 * shrunk
                box = [x for pair in zip(middle - half, middle + half, strict=True) for x in pair]
                target.members[block_index(sure(grid.cells(box)))] = True
            target = Cells(grid, target.members)
            alone = check.leads_in_parts(grid.box(block), holds, every, target.contains)
            left = np.zeros(grid.shape, dtype=np.bool_)
            left[tuple(cell)] = True
            walk = chain_walks.Walk(
                sure(check.chain(1).arrays),
                every,
                sealed.tables["W_N"],
                np.ones(grid.shape, dtype=np.int64),
                partial(_outside, target),
            )
            together = not unled_in_parts(walk, left, check._tries()).any()
            assert together == alone
            answers.add(together)
    assert answers == {True, False}


@pytest.mark.parametrize("shown", [0, 3])
def test_what_arrays_show_of_few_cells_only_is_left_to_arb(
    shown: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever a certificate says that is not so, arrays look at a few cells of it alone."""
    grid = Grid(((*range(21),), (*range(51),)))
    left = np.ones(grid.shape, dtype=np.bool_)
    asked = []

    def some(self: part_walks._Parts, _: part_walks.Boxes) -> Any:
        asked.append(len(self.holds))
        return np.arange(len(self.holds)) % 10 < shown

    monkeypatch.setattr(part_walks._Parts, "shown", some)
    walk = _nothing_followed(grid)
    rest = unled_in_parts(walk, left, [Try((), 0, 0), Try((), 4, 4)])
    assert len(asked) == 2
    assert max(asked) <= SAMPLE
    assert left.sum() - rest.sum() == sum(n // 10 * shown + min(n % 10, shown) for n in asked)


def test_a_try_that_shows_most_cells_is_made_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = Grid(((*range(21),), (*range(51),)))
    left = np.ones(grid.shape, dtype=np.bool_)
    monkeypatch.setattr(
        part_walks._Parts, "shown", lambda self, _: np.arange(len(self.holds)) % 10 < 8
    )
    walk = _nothing_followed(grid)
    once = unled_in_parts(walk, left, [Try((), 0, 0)]).sum()
    assert 0.17 * left.sum() < once < 0.23 * left.sum()
    assert unled_in_parts(walk, left, [Try((), 0, 0), Try((), 4, 4)]).sum() < 0.25 * once


def _nothing_followed(grid: Grid) -> chain_walks.Walk:
    """A walk of which every cell is asked, in one hold."""
    every = Cells(grid, np.ones(grid.shape, dtype=np.bool_))
    return chain_walks.Walk(
        None,  # type: ignore[arg-type]
        every,
        np.ones(grid.shape, dtype=np.uint8),
        np.ones(grid.shape, dtype=np.int64),
        partial(_outside, every),
    )


def _outside(target: Cells, boxes: Sequence[Floats]) -> Any:
    return (~contained(target, boxes)).astype(np.int64)


def _unseen(grid: Grid) -> Any:
    return np.zeros(grid.shape, dtype=np.uint16)


def test_an_end_that_a_flow_keeps_stays_exact() -> None:
    """What rounding adds beyond it is cut: a box that ends there lies in the grid."""
    flows = LocalFlows.__new__(LocalFlows)
    flows._grid = np.array([[-1.0]]), np.array([[1.0]])
    off = np.array([[1e-12]])
    low, high = flows.clipped(
        (BallArray(np.array([[-1.0]]), off), BallArray(np.array([[1.0]]), off))
    )
    assert low.lower() == -1.0
    assert high.upper() == 1.0
