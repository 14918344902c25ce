"""Claims of a group on a grid: which tables fit, what is left to show, what the DM's bytes are."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.cell_sets import Cells, Grid, cell_count
from soter.certificate.extras import estimates_and_shield
from soter.certificate.extras.estimates_and_shield import least_levels, packed_levels
from soter.certificate.grid import grid_group, group_claims
from soter.certificate.grid.grid_group import BLOCKS, LOOK, SMALL, GridCheck, block_tasks
from soter.certificate.grid.group_claims import RESTS
from soter.certificate.report import NotRecheckedError, RejectedError
from unit.certificate.grid_tables import LINE, bools, check_of, fails, tables

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.certificate.grid.group_claims import (
        GroupTables,
    )

Flags = list[int]


# ---------------------------------------------------------------- bytes of the DM


@pytest.mark.parametrize("count", range(1, 10))
def test_two_bits_a_cell(count: int) -> None:
    draw = np.random.default_rng(count)
    for _ in range(5):
        levels = draw.integers(0, 3, count).astype(np.uint8)
        data = packed_levels(levels)
        assert len(data) == (count + 3) // 4
        whole = int.from_bytes(data, "little")
        assert [(whole >> (2 * k)) & 3 for k in range(count)] == levels.tolist()
        assert whole < 4**count
    plane = np.array([[0, 1], [2, 1]], dtype=np.uint8)
    assert packed_levels(plane) == packed_levels(plane.reshape(-1))


def test_the_level_of_a_cell_is_the_least_of_all_cases() -> None:
    def of(*levels: Any) -> GroupTables:
        return tables([1] * 4, levels=list(levels))

    outer, inner = bools(1, 1, 1, 0), bools(1, 0, 1, 0)
    assert least_levels([of(outer, inner)]).tolist() == [2, 1, 2, 0]
    assert least_levels([of(outer, bools(1, 1, 0, 0), inner)]).tolist() == [2, 1, 2, 0]
    assert least_levels([of(inner)]).tolist() == [2, 0, 2, 0]
    other = of(bools(1, 1, 0, 1), bools(0, 1, 0, 1))
    for cases in ([of(outer, inner), other], [other, of(outer, inner)]):
        assert least_levels(cases).tolist() == [1, 1, 0, 0]
    for cases in ([of()], [of(outer), of()]):
        with pytest.raises(RejectedError, match="tables S"):
            least_levels(cases)


# ---------------------------------------------------------------- claims in blocks


def test_a_claim_is_dealt_out_with_its_work() -> None:
    for cells in (1, SMALL, SMALL + 1):
        grid = Grid((tuple(float(k) for k in range(cells + 1)),))
        holds = np.arange(cells) % 7
        seen: list[Any] = []

        def show(block: Any, seen: list[Any] = seen) -> Iterator[Any]:
            seen.append(block)
            if block[0][0] == 0:
                yield from (((0, 1),), ((1, 2),))

        for given in (None, holds):
            tasks = list(block_tasks("no way from", grid, show, given))
            assert len(tasks) == (BLOCKS if cells > SMALL else 1)
            extra = 0 if given is None else int(holds.sum())
            assert sum(work for _, work in tasks) == LOOK * cells + extra
            seen.clear()
            said = [task() for task, _ in tasks]
            assert sorted(said) == [*[""] * (len(tasks) - 1), "no way from [0, 1]"]
            assert sum(map(cell_count, seen)) == cells
            for (_, work), block in zip(tasks, seen, strict=True):
                (a, b) = block[0]
                own = 0 if given is None else int(holds[a:b].sum())
                assert work == LOOK * (b - a) + own


def test_k_lies_where_safe_and_the_law_are_certain() -> None:
    group = tables([0, 1, 2, 0])
    assert "K is empty" in fails(
        lambda: check_of(tables([0] * 4)).note_safe_cells(Cells(LINE, bools(1, 1, 1, 1))) or ()
    )
    for safe, lawful, fine in (
        ((1, 1, 1, 1), None, True),
        ((0, 1, 1, 0), None, True),
        ((1, 0, 1, 1), None, False),
        ((1, 1, 1, 1), (0, 1, 1, 0), True),
        ((1, 1, 1, 1), (1, 1, 0, 1), False),
    ):
        for kept in (True, False):
            check = check_of(group, kept=kept)
            check.lawful = None if lawful is None else Cells(LINE, bools(*lawful))
            check.note_safe_cells(Cells(LINE, bools(*safe)))
            said = fails(check.core_tasks)
            assert ("K holds cells" in said) is not fine
            assert not said or ("law" in said) is (lawful is not None)
            if fine:
                assert len(list(check.core_tasks())) == 1
                assert check.allowed.tolist() == (bools(*safe) & bools(*(lawful or safe))).tolist()
    whole = tables([1] * 4)
    assert list(check_of(whole, kept=True).core_tasks()) == []
    assert len(list(check_of(whole, kept=False).core_tasks())) == 1


def test_what_is_published_lies_in_its_set_on_all_of_k() -> None:
    topic = SimpleNamespace(topics={3: SimpleNamespace(name="seen")})
    for members, fine in (((0, 1, 1, 0), True), ((1, 1, 0, 1), False)):
        check = check_of(tables([0, 1, 1, 0]), system=topic)
        if fine:
            check.keep_in_topic_set(3, Cells(LINE, bools(*members)))
            assert check.allowed.tolist() == [False, True, True, False]
        else:
            with pytest.raises(RejectedError, match="`seen` lies"):
                check.keep_in_topic_set(3, Cells(LINE, bools(*members)))


def test_a_free_phase_is_shown_where_something_may_be_left(monkeypatch: pytest.MonkeyPatch) -> None:
    cut: list[int] = []
    monkeypatch.setattr(
        grid_group, "FreeCheck", lambda *_: SimpleNamespace(compiled_steps=cut.append)
    )
    every = bools(1, 1, 1, 1)
    assert "needs R" in fails(lambda: check_of(tables([1] * 4)).free_tasks(5))
    for core, kept, tasks in (([1] * 4, True, 0), ([1] * 4, False, 1), ([0, 1, 1, 1], True, 1)):
        assert len(list(check_of(tables(core, free=every), kept=kept).free_tasks(5))) == tasks
    assert cut == [group_claims.FREE_PIECES[0]] * 2


def test_where_ac_may_act_everywhere_nothing_is_left_to_show(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(grid_group, "AdmitCheck", lambda *a, **k: asked.append((a[2], k)))
    for members, tasks in ((bools(1, 1, 1, 1), 0), (bools(1, 0, 1, 1), 1)):
        for admits in (True, False):
            check = check_of(tables([1] * 4, free=members))
            assert len(list(check.predicate_tasks("ttf", "expr", admits=admits))) == tasks
            assert not tasks or asked.pop() == ("expr", {"admits": admits})


# ---------------------------------------------------------------- levels


def test_levels_begin_in_r_and_lie_in_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimates_and_shield, "FreeCheck", lambda *_: None)
    monkeypatch.setattr(estimates_and_shield, "eroded_cells", lambda _m, _g, cells: cells)
    free_ = bools(1, 1, 1, 1)
    good = [bools(1, 1, 1, 0), bools(0, 1, 1, 0)]
    for levels, said, tasks in (
        (good, "", 2),
        ([*good, bools(0, 1, 0, 0)], "not as many", 0),
        (good[:1], "not as many", 0),
        ([], "not as many", 0),
        ([good[0], good[0]], "", 2),
        ([good[0], bools(0, 0, 0, 1)], "S_1 is no part of S_0", 0),
        ([good[0], bools(1, 1, 1, 1)], "S_1 is no part of S_0", 0),
    ):
        check = check_of(tables([1] * 4, free=free_, levels=levels))
        assert said in fails(lambda check=check: check.tasks_for_levels(5))  # type: ignore[misc]
        if not said:
            assert len(list(check.tasks_for_levels(5))) == tasks
    three = [*good, bools(0, 1, 0, 0)]
    check = check_of(tables([1] * 4, free=free_, levels=three), levels=4)
    assert len(list(check.tasks_for_levels(5))) == 3
    three[2] = bools(1, 0, 0, 0)
    assert "S_2 is no part of S_1" in fails(lambda: check.tasks_for_levels(5))
    # what nothing leaves need not be shown to stay
    whole = [bools(1, 1, 1, 1), bools(0, 1, 0, 0)]
    for kept, tasks in ((True, 1), (False, 2)):
        check = check_of(tables([1] * 4, free=free_, levels=whole), kept=kept)
        assert len(list(check.tasks_for_levels(5))) == tasks
    shown = [("of commands", lambda _: iter(()))] * 2
    monkeypatch.setattr(estimates_and_shield, "shield_inclusions", lambda *_: shown)
    check = check_of(tables([1] * 4, free=free_, levels=good), symbol=SimpleNamespace(shield=1))
    assert len(list(check.tasks_for_levels(5))) == 4


def test_each_level_is_shown_from_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    levels = [bools(1, 1, 1, 0), bools(0, 1, 1, 0), bools(0, 1, 0, 0)]
    group = tables([1] * 4, free=bools(1, 1, 1, 1), levels=levels)
    shown: list[Any] = []

    def noted(*of: Any) -> Iterator[Any]:
        shown.append(of)
        return iter(())

    monkeypatch.setattr(estimates_and_shield, "FreeCheck", lambda *of: of)
    monkeypatch.setattr(estimates_and_shield, "eroded_cells", lambda _m, _g, cells: cells)
    monkeypatch.setattr(estimates_and_shield, "estimates_of_states_outside", noted)
    monkeypatch.setattr(estimates_and_shield, "estimates_driven_out", noted)
    check = check_of(group, levels=4)
    assert [task() for task, _ in check.tasks_for_levels(7)] == [""] * 3
    first, *others = shown
    assert first[:2] == (check.model, group)
    assert first[2] is levels[0]
    assert first[3].members is group.free
    for k, (phase, claimed, calm, block) in enumerate(others, 1):
        assert phase == (check.model, group, 7)
        assert claimed is levels[k]
        assert calm.members is levels[k - 1]
        assert block == LINE.all_cells


def test_what_is_known_from_the_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid_group, "is_grid_never_left", lambda *_: True)
    compiled: list[int] = []
    monkeypatch.setattr(
        grid_group, "ChainCheck", lambda *_: SimpleNamespace(compiled_chain=compiled.append)
    )
    check = GridCheck(None, tables([0, 1, 2, 0]), None)  # type: ignore[arg-type]
    assert check.kernel.members.tolist() == [False, True, True, False]
    assert check.allowed.tolist() == [True] * 4
    assert check.kept is True
    assert check.chains is check.chains
    assert compiled == [group_claims.PIECES[0]]
    every, some = (Cells(LINE, bools(1, 1, 1, last)) for last in (1, 0))
    for sets, fine in (((every,), True), ((some,), False), ((every, some), False)):
        assert check.are_never_left(*sets) is fine


# ---------------------------------------------------------------- ranks


def with_ranks(home: Flags, rank: Flags, holds: Flags, core: Flags | None = None) -> GroupTables:
    return tables(
        core or [1] * 4,
        home=np.array(home, dtype=np.uint8),
        rank=np.array(rank, dtype=np.uint16),
        rank_holds=np.array(holds, dtype=np.uint8),
    )


def test_the_way_home_takes_the_longest_of_every_rank() -> None:
    for rank, holds, total in (
        ([1, 2, 2, 3], [0, 3, 5, 2], 7), ([1, 1, 1, 1], [0] * 4, 0),
        ([3, 2, 1, 1], [1, 9, 0, 0], 10), ([0, 1, 2, 0], [0, 0, 4, 0], 4),
        ([1, 2, 5, 5], [0, 1, 2, 3], 4), ([2, 2, 2, 2], [200] * 4, 200),
        ([1, 2, 3, 4], [0, 200, 200, 200], 600),
    ):  # fmt: skip
        assert check_of(with_ranks([1, 0, 0, 0], rank, holds)).holds_to_return == total
    for missing in ("rank", "rank_holds"):
        group = with_ranks([1, 0, 0, 0], [1, 2, 2, 2], [0, 1, 1, 1])
        setattr(group, missing, None)
        with pytest.raises(RejectedError, match="Q and W"):
            _ = check_of(group).holds_to_return


def test_which_ranks_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimates_and_shield, "eroded_cells", lambda _m, _g, cells: cells)
    calm = Cells(LINE, bools(1, 1, 0, 0))
    good = ([1, 0, 0, 0], [1, 2, 3, 0], [0, 1, 2, 0], [1, 1, 1, 0])
    for args, said in (
        (good, ""),
        (([0, 0, 1, 0], [2, 2, 1, 0], [1, 1, 0, 0], [1, 1, 1, 0]), "Q holds cells"),
        (([1, 0, 1, 0], [1, 2, 1, 0], [0, 1, 0, 0], [1, 1, 1, 0]), "Q holds cells"),
        (([1, 0, 0, 0], [1, 2, 0, 0], [0, 1, 0, 0], [1, 1, 1, 0]), "W does not hold all of K"),
        (([1, 0, 0, 0], [1, 2, 3, 4], [0, 1, 2, 1], [1, 1, 1, 0]), ""),
        (([1, 1, 0, 0], [1, 2, 3, 0], [0, 1, 2, 0], [1, 1, 1, 0]), "W does not begin with Q"),
        (([1, 0, 0, 0], [0, 2, 3, 0], [0, 1, 2, 0], [1, 1, 1, 0]), "W does not begin with Q"),
        (([1, 0, 0, 0], [1, 2, 3, 0], [1, 1, 2, 0], [1, 1, 1, 0]), "nowhere to go"),
        (([1, 0, 0, 0], [1, 2, 3, 0], [0, 1, 2, 1], [1, 1, 1, 0]), "nowhere to go"),
        (([1, 0, 0, 0], [1, 1, 3, 0], [0, 1, 2, 0], [1, 1, 1, 0]), "nowhere to go"),
    ):
        check = check_of(with_ranks(*args))
        found = fails(lambda check=check: check.return_tasks(calm))  # type: ignore[misc]
        assert (said in found) if said else not found
        if not said:
            assert len(list(check.return_tasks(calm))) == 2
    for missing in ("home", "rank", "rank_holds"):
        group = with_ranks(*good)
        setattr(group, missing, None)
        assert "Q and W" in fails(lambda group=group: check_of(group).return_tasks(calm))  # type: ignore[misc]
    group = with_ranks(*good)
    assert "table of the DM" in fails(lambda: check_of(group).return_tasks(None))
    group.given_back = bools(1, 0, 0, 0)
    assert len(list(check_of(group).return_tasks(None))) == 2
    group.given_back = bools(0, 1, 1, 1)
    assert "Q holds cells" in fails(lambda: check_of(group).return_tasks(None))
    everywhere = Cells(LINE, bools(1, 1, 1, 1))
    whole = with_ranks([1] * 4, [1] * 4, [0] * 4)
    for kept, tasks in ((True, 0), (False, 2)):
        assert len(list(check_of(whole, kept=kept).return_tasks(everywhere))) == tasks
    assert len(list(check_of(with_ranks(*good), kept=True).return_tasks(calm))) == 2


def test_a_way_back_over_finer_cells_needs_the_table_of_the_dm() -> None:
    group = tables([1] * 4, finer=LINE)
    assert "cells of its own" in fails(lambda: check_of(group).return_tasks(None))


def test_no_way_back_is_shown_where_sc_rests() -> None:
    with pytest.raises(NotRecheckedError, match="cells at rest"):
        list(check_of(tables([RESTS, 1, 1, 1])).return_tasks(None))


# ---------------------------------------------------------------- the start


@pytest.mark.parametrize("stays", [True, False])
def test_a_start_is_looked_at_unless_nothing_leaves(
    stays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def stays_in(box: Any, within: Cells, pieces: int) -> bool:
        asked.append((float(box[0][0]), float(box[0][1]), within.size, pieces))
        return stays

    monkeypatch.setattr(grid_group, "FreeCheck", lambda *_: SimpleNamespace(stays_in=stays_in))
    for core, kept, high, looked in (
        ([1] * 4, True, 2.0, False),
        ([1] * 4, True, 5.0, True),
        ([1] * 4, False, 2.0, True),
        ([1, 1, 1, 0], True, 2.0, True),
    ):
        asked.clear()
        states = [SimpleNamespace(low=1.0, high=high, name="x")]
        check = check_of(tables(core), kept=kept, states=states)
        said = fails(lambda check=check: check.start_tasks(5))  # type: ignore[misc]
        assert ("may leave K" in said) is (looked and not stays)
        finest = group_claims.FREE_PIECES[-1]
        assert asked == ([(1.0, high, sum(core), finest)] if looked else [])
