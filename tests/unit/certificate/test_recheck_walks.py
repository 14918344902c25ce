"""Blocks of cells, what is known of them, and groups that no run leaves."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from bench.recheck.models import Cart

from soter.certificate.case_check import CaseCheck
from soter.certificate.cell_sets import Cells, Grid, cell_count, cells_unshown
from soter.certificate.extras import estimates_and_shield
from soter.certificate.grid.grid_group import GridGroup
from soter.certificate.grid.group_claims import ChainCheck, GroupTables, cells_not_nearer
from soter.certificate.grid.sc_chains import is_grid_never_left
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.report import RejectedError
from soter.certificate.terms.compile_terms import form_of_box
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from soter.certificate.cell_sets import Block

CLAMPED = "clamp(-2.0 * seen, -1.0, 1.0)"
LAG = """soter 1;
topic seen: float max_age 10ms;
topic push: float in [-1.0, 1.0] = 0.0;
plant Lag period 10ms {
  reads push;
  drives seen = w;
  state w: float in [-0.1, 0.1];
  state q: float in [-0.1, 0.1];
  disturbance d: float in [-0.5, 0.5];
  der w = push;
  der q = RATE * (w - q) + EXTRA;
}
node Any period 20ms { subscribes seen; publishes push; step { publish push = 0.0; } }
node Zero period 20ms {
  subscribes seen;
  publishes push;
  step { publish push = clamp(-2.0 * seen, -1.0, 1.0); }
}
rta Module {
  ac Any;
  sc Zero;
  period 20ms;
  safe abs(seen) < 1.01;
  ttf abs(seen) > 0.5;
  safer abs(seen) < 0.3;
  verify { grid l.w in [-1.0, 1.0] / 40; grid l.q in [-BOUND, BOUND] / 1; }
}
system S default { l: Lag; module Module; until 10s; }
"""


def lag(
    tmp_path: Path, rate: str, extra: str, bound: float, law: str = CLAMPED, more: str = ""
) -> tuple[CaseModel, list[GroupTables]]:
    """The model, and a table for w and for q; `bound`: of the grid of q."""
    text = LAG.replace(CLAMPED, law).replace("verify {", f"verify {{ {more}")
    text = text.replace("RATE", rate).replace("EXTRA", extra).replace("BOUND", repr(bound))
    (tmp_path / "lag.soter").write_text(text)
    facts = small_proofs.facts_of(tmp_path / "lag.soter", "S", "Module")
    model = CaseModel(facts, (), tuple(facts.axes[i] for i in range(2)))
    grids = (Grid((small_proofs.even_edges(-1.0, 1.0, 40),)), Grid(((-bound, bound),)))
    groups = []
    for i, grid in enumerate(grids):
        every = np.ones(grid.shape, dtype=np.uint8)
        free = np.ones(grid.shape, dtype=np.bool_)
        rank = np.ones(grid.shape, dtype=np.uint16)
        groups.append(GroupTables((i,), grid, every, free, every, rank, every))
    return model, groups


@pytest.mark.parametrize(
    ("rate", "extra", "bound", "inwards"),
    [
        ("4.0", "0.0", 1.01, True),
        ("4.0", "0.0", 0.99, False),  # w may be beyond
        ("4.0", "d", 1.13, True),
        ("4.0", "d", 1.12, False),  # 4 (1 - 1.12) + 0.5 > 0
        ("4.0", "d + 0.4", 1.23, True),
        ("4.0", "d + 0.4", 1.2, False),  # at the upper end alone
        ("4.0", "d - 0.4", 1.2, False),  # at the lower end alone
        ("4.0", "0.01 * push", 1.5, False),  # a command moves it
        ("-4.0", "0.0", 1.5, False),
        ("0.0", "d", 1.5, False),
    ],
)
def test_what_flows_inwards(
    tmp_path: Path, rate: str, extra: str, bound: float, inwards: bool
) -> None:
    model, groups = lag(tmp_path, rate, extra, bound)
    assert is_grid_never_left(model, groups[1].states) == inwards
    assert not is_grid_never_left(model, groups[0].states), "its command moves it"


def test_a_group_that_flows_inwards_needs_no_chain(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, groups = lag(tmp_path, "4.0", "d", 1.13)
    asked = []
    chain = ChainCheck.compiled_chain

    def noted(self: ChainCheck, pieces: int) -> Any:
        asked.append(self.group.states)
        return chain(self, pieces)

    monkeypatch.setattr(ChainCheck, "compiled_chain", noted)
    check = GridGroup(groups[1]).make_check(model, None)
    assert check.kept
    assert list(check.core_tasks()) == list(check.free_tasks(10**6)) == []
    assert asked == []
    check.kept = False
    assert list(check.core_tasks())
    assert asked


def test_a_part_of_a_group_that_flows_inwards_is_not_kept_for_free(tmp_path: Path) -> None:
    """Half of the grid is left at once although the whole is not."""
    model, groups = lag(tmp_path, "4.0", "d", 1.13)
    grid = Grid(((-1.13, 0.0, 1.13),))
    half = np.array([1, 0], dtype=np.uint8)
    part = GroupTables((1,), grid, half, half > 0, half, np.ones(2, np.uint16), half)
    own = [GridGroup(tables) for tables in (groups[0], part)]
    case = CaseCheck(model, own, {"P2a"}, {}, 1)
    with pytest.raises(RejectedError, match="lead back"):
        case.show_claims()


def some_cells(*members: int) -> NDArray[np.uint8]:
    table = np.zeros(40, dtype=np.uint8)
    table[list(members)] = 1
    return table


REFUSED: dict[str, tuple[str, dict[str, Any], int | None]] = {
    "K is empty": ("P2a", {"core": some_cells()}, None),
    "a claim needs R, which is not there": ("ttf", {"free": None}, None),
    "an initial state may leave K before SC acts": ("start", {"core": some_cells(3)}, None),
    "a claim needs Q and W, which are not there": ("P2b", {"home": None}, None),
    "Q holds cells on which `safer` is not certain": ("P2b", {}, None),
    "W does not hold all of K": (
        "P2b",
        {"home": some_cells(20), "rank": np.zeros(40, dtype=np.uint16)},
        None,
    ),
    "the program declares no time to return": ("P2b", {}, 10**9),
}


@pytest.mark.parametrize("why", REFUSED)
def test_a_claim_for_which_the_tables_are_not_enough_is_refused(why: str, tmp_path: Path) -> None:
    model, groups = lag(tmp_path, "4.0", "d", 1.13)
    claim, tables, recover_ns = REFUSED[why]
    own = [GridGroup(replace(groups[0], **tables)), GridGroup(groups[1])]
    with pytest.raises(RejectedError, match=why):
        CaseCheck(model, own, {claim}, {"recover_ns": recover_ns}, 1).show_claims()


def test_the_longest_way_back_is_no_longer_than_the_program_allows(tmp_path: Path) -> None:
    model, groups = lag(tmp_path, "4.0", "d", 1.13, more="recover within 1s;")
    slow = replace(groups[0], rank_holds=np.full(40, 51, dtype=np.uint8))  # 51 times 20 ms
    own = [GridGroup(slow), GridGroup(groups[1])]
    for recover_ns, why in ((10**9, "SC may take longer"), (2 * 10**9, "is another one in the")):
        with pytest.raises(RejectedError, match=why):
            CaseCheck(model, own, {"P2b"}, {"recover_ns": recover_ns}, 1).show_claims()


def test_what_a_law_keeps_is_told_on_the_cells_of_sc(tmp_path: Path) -> None:
    own = lag(tmp_path, "4.0", "d", 1.13)[1][0]
    law = replace(own, core=some_cells(3))
    others = [replace(law, grid=Grid((tuple(2.0 * x for x in law.grid.edges[0]),)))]
    others.append(replace(law, states=(1,)))
    for other in others:
        with pytest.raises(RejectedError, match="other cells than SC"):
            GridGroup(own).cells_kept_by_law([GridGroup(other)])
    kept = GridGroup(own).cells_kept_by_law([*map(GridGroup, others), GridGroup(law)])
    assert kept.members.tolist() == (law.core > 0).tolist()


def test_where_the_dm_gives_control_back_by_a_table_q_lies_in_it(tmp_path: Path) -> None:
    model, groups = lag(tmp_path, "4.0", "d", 1.13)
    every = np.ones(40, dtype=np.bool_)
    for given_back, why in (
        (None, "needs the table of the DM"),
        (~(some_cells(3) > 0), "Q holds cells on which `safer` is not certain"),  # w is not shown
        (every, "W does not begin with Q"),
    ):
        home = some_cells(20)
        tables = replace(
            groups[0], home=home, given_back=given_back, rank=np.full(40, 2, np.uint16)
        )
        check = GridGroup(tables).make_check(model, None)
        with pytest.raises(RejectedError, match=why):
            list(check.return_tasks(None))


def test_levels_are_as_many_as_are_asked_for_and_each_in_the_one_before(tmp_path: Path) -> None:
    model, groups = lag(tmp_path, "4.0", "d", 1.13)
    sets = [some_cells(*cells) > 0 for cells in ((20, 21), (20, 22), (20,))]
    for levels, why in (
        (sets[:1], "not as many as the levels ask for"),
        (sets, "not as many as the levels ask for"),
        (sets[:2], "S_1 is no part of S_0"),
    ):
        check = GridGroup(replace(groups[0], levels=levels)).make_check(model, None)
        with pytest.raises(RejectedError, match=why):
            list(check.tasks_for_levels(10**6))
    check = GridGroup(replace(groups[0], levels=[sets[0], sets[2]])).make_check(model, None)
    assert len(list(check.tasks_for_levels(10**6))) == 2


@pytest.mark.parametrize(
    ("law", "near", "far"),
    [(CLAMPED, True, True), ("-2.0 * seen", True, False), ("2.0 + 0.0 * seen", False, False)],
)
def test_a_command_outside_its_set_ends_a_chain(
    tmp_path: Path, law: str, near: bool, far: bool
) -> None:
    model, groups = lag(tmp_path, "4.0", "d", 1.13, law)
    chain = ChainCheck(model, groups[0]).compiled_chain(1)
    for at, known in (((20, 22), near), ((38, 39), far)):
        form = form_of_box(groups[0].grid.box_of((at,)), symbols=True)
        assert (chain.first(form) is not None) == known


# ---------------------------------------------------------------- walks


def test_a_walk_gives_back_the_cells_that_nothing_showed() -> None:
    draw = np.random.default_rng(5)
    for shape in [(1,), (37,), (9, 14), (5, 4, 6)]:
        for _ in range(10):
            todo, true = draw.random((2, *shape)) < 0.7
            tried: list[int] = []

            def attempt(
                at: Block,
                wanted: NDArray[np.bool_],
                true: NDArray[np.bool_] = true,
                todo: NDArray[np.bool_] = todo,
                tried: list[int] = tried,
            ) -> NDArray[np.bool_]:
                here = tuple(slice(a, b) for a, b in at)
                assert not (wanted & ~todo[here]).any(), "only what is wanted"
                tried.append(cell_count(at))
                some = draw.random(wanted.shape) < 0.3
                shown: NDArray[np.bool_] = true[here] & (some | (cell_count(at) == 1))
                return shown

            whole = tuple((0, n) for n in shape)
            cells = {tuple(low for low, _ in b) for b in cells_unshown(todo, whole, attempt, 8)}
            assert cells == {tuple(int(i) for i in c) for c in np.argwhere(todo & ~true)}
            assert max(tried, default=1) <= 8


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[CaseModel, GroupTables]:
    cart = Cart(cells_x=12, cells_v=10)
    path = tmp_path_factory.mktemp("small") / "cart.soter"
    path.write_text(cart.text())
    facts = small_proofs.facts_of(path, "Track", "SafeCart")
    extents = tuple(facts.axes[i] for i in range(2))
    model = CaseModel(facts, (), extents)
    grid = Grid(
        tuple(small_proofs.even_edges(*e, n) for e, n in zip(extents, (12, 10), strict=True))
    )
    return model, GroupTables((0, 1), grid, np.ones(grid.shape, dtype=np.uint8))


def test_a_block_is_followed_while_all_of_it_is_within(
    small: tuple[CaseModel, GroupTables],
) -> None:
    """Every number of holds that is wanted, in parts as in one, and none from where it is left."""
    model, group = small
    check = ChainCheck(model, group)
    everywhere = Cells(group.grid, np.ones(group.grid.shape, dtype=np.bool_))
    box = group.grid.box_of(((5, 7), (4, 6)))
    whole = dict(check.follow(box, [2, 5], everywhere, 1))
    assert list(whole) == [2, 5]
    assert all(len(ends) == 1 for ends in whole.values())
    assert check.leads_to(box, 5, everywhere, lambda end: end in whole[5], 1)
    assert not check.leads_to(box, 5, everywhere, lambda end: end in whole[2], 1)
    halves = dict(check.follow(box, [2, 5], everywhere, 1, cuts=1))
    assert [len(ends) for ends in halves.values()] == [1, 2]
    for axis in (0, 1):  # the parts together are no larger than the whole
        low, high = whole[5][0][2 * axis : 2 * axis + 2]
        assert min(end[2 * axis] for end in halves[5]) >= low
        assert max(end[2 * axis + 1] for end in halves[5]) <= high
    edge = group.grid.box_of(((11, 12), (9, 10)))  # at the wall, as fast as the grid goes
    assert list(check.follow(edge, [3], everywhere, 1)) == []


def test_every_cell_is_held_to_its_own_rank(small: tuple[CaseModel, GroupTables]) -> None:
    """In a block of several ranks no cell may count another's as its own."""
    model, group = small
    shape = group.grid.shape
    home = np.zeros(shape, dtype=np.bool_)
    home[4:8, 3:7] = True
    rank = np.zeros(shape, dtype=np.uint16)
    rank[home] = 1
    holds = np.full(shape, 60, dtype=np.uint8)
    rank[3, 4:6] = (2, 3)
    group = replace(group, rank=rank, rank_holds=holds)
    check = ChainCheck(model, group)
    whole = group.grid.all_cells
    assert list(cells_not_nearer(check, Cells(group.grid, home), whole)) == []
    rank[8, 4:6] = 1  # beside home, and of a rank that only home is below
    rank[2, 4:6] = 1
    assert list(cells_not_nearer(check, Cells(group.grid, home), whole)) == []
    holds[3, 4] = 0
    blocks = list(cells_not_nearer(check, Cells(group.grid, home), whole))
    assert blocks == [((3, 4), (4, 5))], "no hold, no way"
    none = Cells(group.grid, np.zeros(shape, dtype=np.bool_))
    rank[:], holds[:] = 0, 1
    rank[home] = 1
    left = list(cells_not_nearer(check, none, whole))
    assert len(left) == home.sum(), "what leads to rank 1 is not below rank 1"


def estimated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *errors: float
) -> tuple[CaseModel, list[GroupTables]]:
    """A model whose first states have estimates, off by these errors at most."""
    model, groups = lag(tmp_path, "4.0", "d", 1.13)
    for state in range(len(errors)):
        monkeypatch.setitem(model.facts.leaves, state, (0, ()))
    monkeypatch.setattr(estimates_and_shield, "estimate_error", lambda _, state: errors[state])
    return model, groups


@pytest.mark.parametrize("seed", range(6))
def test_levels_lose_the_cells_of_which_an_estimate_lies_outside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """All of them at once as each by itself; of the second state there is no estimate."""
    draw = np.random.default_rng(seed)
    error = float(draw.choice([0.03, 0.05, 0.12]))
    model, groups = estimated(tmp_path, monkeypatch, error)
    grid = Grid((groups[0].grid.edges[0], small_proofs.even_edges(*model.extents[1], 3)))
    group = GroupTables((0, 1), grid, np.ones(grid.shape, dtype=np.uint8))
    level = Cells(grid, np.repeat(draw.random((40, 1)) < 0.9, 3, axis=1))
    expected = np.zeros(grid.shape, dtype=np.bool_)
    for cell in np.argwhere(level.members):
        block = tuple((int(i), int(i) + 1) for i in cell)
        expected[tuple(cell)] = level.contains(
            estimates_and_shield.estimates_around(model, group, grid.box_of(block))
        )
    assert np.array_equal(estimates_and_shield.eroded_cells(model, group, level).members, expected)
    assert 0 < expected.sum() < level.members.sum()


@pytest.mark.parametrize("seed", range(6))
def test_levels_of_two_estimated_states_lose_cells_on_either_axis(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    """Counted out on the edges, which are dyadic as the errors are: nothing is rounded."""
    draw, errors = np.random.default_rng(seed), (0.25, 0.125)
    model, _ = estimated(tmp_path, monkeypatch, *errors)
    edges = (tuple(k * 0.1875 for k in range(13)), tuple(k * 0.25 for k in range(9)))
    grid = Grid(edges)
    group = GroupTables((0, 1), grid, np.ones(grid.shape, dtype=np.uint8))
    level = Cells(grid, draw.random(grid.shape) < 0.95)
    left = estimates_and_shield.eroded_cells(model, group, level).members
    for at in np.ndindex(*grid.shape):
        touched, met = (cells_around(edges, errors, at, closed=c) for c in (False, True))
        assert level.members[np.ix_(*touched)].all() or not left[at]
        # rounding outwards may cost a cell whose error ends on an edge, or on the grid's end
        ends = [(e[n] - d, e[n + 1] + d) for e, d, n in zip(edges, errors, at, strict=True)]
        inner = all(e[0] < a and b < e[-1] for e, (a, b) in zip(edges, ends, strict=True))
        assert left[at] or not (inner and level.members[np.ix_(*met)].all())
        outside = any(a < e[0] or b > e[-1] for e, (a, b) in zip(edges, ends, strict=True))
        assert not (outside and left[at])
    assert 0 < left.sum() < level.members.sum()


def cells_around(
    edges: Sequence[tuple[float, ...]], errors: Sequence[float], at: Sequence[int], *, closed: bool
) -> list[list[int]]:
    """By axis the cells that have a point nearer to a cell than the error; `closed`: or as near."""
    found = []
    for e, d, n in zip(edges, errors, at, strict=True):
        a, b = e[n] - d, e[n + 1] + d
        pairs = list(enumerate(pairwise(e)))
        found.append(
            [k for k, (x, y) in pairs if (y >= a and x <= b if closed else y > a and x < b)]
        )
    return found
