"""Claims of a group on a grid: which tables fit, what is left to show, what the DM's bytes are."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.cells.cell_sets import Cells, Grid, volume
from soter.certificate.format.errors import RejectedError
from soter.certificate.grid import grid_group, group_claims
from soter.certificate.grid.grid_group import (
    BLOCKS,
    SMALL,
    GridCheck,
    GridGroup,
    blocks,
    levels_of,
    packed,
)
from soter.certificate.grid.group_claims import (
    GroupTables,
)
from soter.certificate.groups import LOOK

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

LINE = Grid(((0.0, 1.0, 2.0, 3.0, 4.0),))
Flags = list[int]


def bools(*flags: int) -> Any:
    return np.array(flags, dtype=np.bool_)


def tables(core: Flags, **more: Any) -> GroupTables:
    return GroupTables((0,), LINE, np.array(core, dtype=np.uint8), **more)


def check_of(group: GroupTables, *, kept: bool = False, **facts: Any) -> Any:
    check: Any = object.__new__(GridCheck)
    state = SimpleNamespace(low=1.0, high=2.0, name="x")
    known = {"states": [state], "levels": 3, "symbol": SimpleNamespace(shield=None)} | facts
    check.model = SimpleNamespace(facts=SimpleNamespace(**known))
    check.tables, check.grid, check.kept = group, group.grid, kept
    check.kernel = Cells(group.grid, group.core > 0)
    check.allowed = np.ones(group.grid.shape, dtype=np.bool_)
    check.lawful = None
    check.chains = None
    return check


def fails(made: Callable[[], Any]) -> str:
    """What is said where it is rejected, else nothing."""
    try:
        list(made())
    except RejectedError as error:
        return str(error)
    return ""


# ---------------------------------------------------------------- bytes of the DM


@pytest.mark.parametrize("count", range(1, 10))
def test_two_bits_a_cell(count: int) -> None:
    draw = np.random.default_rng(count)
    for _ in range(5):
        levels = draw.integers(0, 3, count).astype(np.uint8)
        data = packed(levels)
        assert len(data) == (count + 3) // 4
        whole = int.from_bytes(data, "little")
        assert [(whole >> (2 * k)) & 3 for k in range(count)] == levels.tolist()
        assert whole < 4**count
    plane = np.array([[0, 1], [2, 1]], dtype=np.uint8)
    assert packed(plane) == packed(plane.reshape(-1))


def test_the_level_of_a_cell_is_the_least_of_all_cases() -> None:
    def of(*levels: Any) -> GroupTables:
        return tables([1] * 4, levels=list(levels))

    outer, inner = bools(1, 1, 1, 0), bools(1, 0, 1, 0)
    assert levels_of([of(outer, inner)]).tolist() == [2, 1, 2, 0]
    assert levels_of([of(outer, bools(1, 1, 0, 0), inner)]).tolist() == [2, 1, 2, 0]
    assert levels_of([of(inner)]).tolist() == [2, 0, 2, 0]
    other = of(bools(1, 1, 0, 1), bools(0, 1, 0, 1))
    for cases in ([of(outer, inner), other], [other, of(outer, inner)]):
        assert levels_of(cases).tolist() == [1, 1, 0, 0]
    for cases in ([of()], [of(outer), of()]):
        with pytest.raises(RejectedError, match="tables S"):
            levels_of(cases)


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
            tasks = list(blocks("no way from", grid, show, given))
            assert len(tasks) == (BLOCKS if cells > SMALL else 1)
            extra = 0 if given is None else int(holds.sum())
            assert sum(work for _, work in tasks) == LOOK * cells + extra
            seen.clear()
            said = [task() for task, _ in tasks]
            assert sorted(said) == [*[""] * (len(tasks) - 1), "no way from [0, 1]"]
            assert sum(map(volume, seen)) == cells
            for (_, work), block in zip(tasks, seen, strict=True):
                (a, b) = block[0]
                own = 0 if given is None else int(holds[a:b].sum())
                assert work == LOOK * (b - a) + own


def test_k_lies_where_safe_and_the_law_are_certain() -> None:
    group = tables([0, 1, 2, 0])
    assert "K is empty" in fails(
        lambda: check_of(tables([0] * 4)).safe(Cells(LINE, bools(1, 1, 1, 1))) or ()
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
            check.safe(Cells(LINE, bools(*safe)))
            said = fails(check.core)
            assert ("K holds cells" in said) is not fine
            assert not said or ("law" in said) is (lawful is not None)
            if fine:
                assert len(list(check.core())) == 1
                assert check.allowed.tolist() == (bools(*safe) & bools(*(lawful or safe))).tolist()
    whole = tables([1] * 4)
    assert list(check_of(whole, kept=True).core()) == []
    assert len(list(check_of(whole, kept=False).core())) == 1


def test_what_is_published_lies_in_its_set_on_all_of_k() -> None:
    topic = SimpleNamespace(topics={3: SimpleNamespace(name="seen")})
    for members, fine in (((0, 1, 1, 0), True), ((1, 1, 0, 1), False)):
        check = check_of(tables([0, 1, 1, 0]), system=topic)
        if fine:
            assert check.published(3, Cells(LINE, bools(*members)), []) is True
            assert check.allowed.tolist() == [False, True, True, False]
        else:
            with pytest.raises(RejectedError, match="`seen` lies"):
                check.published(3, Cells(LINE, bools(*members)), [])


def test_a_free_phase_is_shown_where_something_may_be_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid_group, "FreeCheck", lambda *_: SimpleNamespace(phase=lambda _: None))
    every = bools(1, 1, 1, 1)
    assert "needs R" in fails(lambda: check_of(tables([1] * 4)).free(5))
    for core, kept, tasks in (([1] * 4, True, 0), ([1] * 4, False, 1), ([0, 1, 1, 1], True, 1)):
        assert len(list(check_of(tables(core, free=every), kept=kept).free(5))) == tasks


def test_where_ac_may_act_everywhere_nothing_is_left_to_show(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(grid_group, "AdmitCheck", lambda *a, **k: asked.append((a[2], k)))
    for members, tasks in ((bools(1, 1, 1, 1), 0), (bools(1, 0, 1, 1), 1)):
        for admits in (True, False):
            check = check_of(tables([1] * 4, free=members))
            assert len(list(check.admits("ttf", "expr", admits=admits))) == tasks
            assert not tasks or asked.pop() == ("expr", {"admits": admits})


# ---------------------------------------------------------------- levels


def test_levels_begin_in_r_and_lie_in_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid_group, "FreeCheck", lambda *_: None)
    monkeypatch.setattr(grid_group, "eroded", lambda _m, _g, cells: cells)
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
        assert said in fails(lambda check=check: check.levels(5))
        if not said:
            assert len(list(check.levels(5))) == tasks
    three = [*good, bools(0, 1, 0, 0)]
    check = check_of(tables([1] * 4, free=free_, levels=three), levels=4)
    assert len(list(check.levels(5))) == 3
    three[2] = bools(1, 0, 0, 0)
    assert "S_2 is no part of S_1" in fails(lambda: check.levels(5))
    # what nothing leaves need not be shown to stay
    whole = [bools(1, 1, 1, 1), bools(0, 1, 0, 0)]
    for kept, tasks in ((True, 1), (False, 2)):
        check = check_of(tables([1] * 4, free=free_, levels=whole), kept=kept)
        assert len(list(check.levels(5))) == tasks
    shown = [("of commands", lambda _: iter(()))] * 2
    monkeypatch.setattr(grid_group, "to_show", lambda *_: shown)
    check = check_of(tables([1] * 4, free=free_, levels=good), symbol=SimpleNamespace(shield=1))
    assert len(list(check.levels(5))) == 4


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
        assert check_of(with_ranks([1, 0, 0, 0], rank, holds)).holds == total
    for missing in ("rank", "rank_holds"):
        group = with_ranks([1, 0, 0, 0], [1, 2, 2, 2], [0, 1, 1, 1])
        setattr(group, missing, None)
        with pytest.raises(RejectedError, match="Q and W"):
            _ = check_of(group).holds


def test_which_ranks_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid_group, "eroded", lambda _m, _g, cells: cells)
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
        found = fails(lambda check=check: check.home(calm))
        assert (said in found) if said else not found
        if not said:
            assert len(list(check.home(calm))) == 2
    for missing in ("home", "rank", "rank_holds"):
        group = with_ranks(*good)
        setattr(group, missing, None)
        assert "Q and W" in fails(lambda group=group: check_of(group).home(calm))
    group = with_ranks(*good)
    assert "table of the DM" in fails(lambda: check_of(group).home(None))
    group.given_back = bools(1, 0, 0, 0)
    assert len(list(check_of(group).home(None))) == 2
    group.given_back = bools(0, 1, 1, 1)
    assert "Q holds cells" in fails(lambda: check_of(group).home(None))
    everywhere = Cells(LINE, bools(1, 1, 1, 1))
    whole = with_ranks([1] * 4, [1] * 4, [0] * 4)
    for kept, tasks in ((True, 0), (False, 2)):
        assert len(list(check_of(whole, kept=kept).home(everywhere))) == tasks
    assert len(list(check_of(with_ranks(*good), kept=True).home(calm))) == 2


# ---------------------------------------------------------------- the start


@pytest.mark.parametrize("stays", [True, False])
def test_a_start_is_looked_at_unless_nothing_leaves(
    stays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def stays_in(box: Any, within: Cells, pieces: int) -> bool:
        asked.append((float(box[0][0]), float(box[0][1]), within.size, pieces))
        return stays

    monkeypatch.setattr(grid_group, "FreeCheck", lambda *_: SimpleNamespace(stays=stays_in))
    for core, kept, high, looked in (
        ([1] * 4, True, 2.0, False),
        ([1] * 4, True, 5.0, True),
        ([1] * 4, False, 2.0, True),
        ([1, 1, 1, 0], True, 2.0, True),
    ):
        asked.clear()
        states = [SimpleNamespace(low=1.0, high=high, name="x")]
        check = check_of(tables(core), kept=kept, states=states)
        said = fails(lambda check=check: check.start(5))
        assert ("may leave K" in said) is (looked and not stays)
        finest = group_claims.FREE_PIECES[-1]
        assert asked == ([(1.0, high, sum(core), finest)] if looked else [])


# ---------------------------------------------------------------- groups


def test_what_a_group_says_of_itself() -> None:
    group = GridGroup(tables([1, 0, 1, 0]))
    assert group.states == (0,)
    assert group.unentered == "there is no R(H)"
    group.tables.free = bools(0, 0, 0, 0)
    assert group.unentered == ""
    told: Any = SimpleNamespace(cells=5)
    group.tell(told)
    assert told.cells == 9
    assert group.never(iter(())) == ("", "")
    group.tables.given_back = bools(0, 0, 0, 0)
    assert "on no estimate" in group.never(iter(()))[0]
    group.tables.given_back = bools(0, 1, 0, 0)
    assert group.never(iter(())) == ("", "")
    for members, said in ((bools(0, 0, 0, 0), True), (bools(0, 1, 0, 0), False)):
        group.tables.levels = [members, bools(0, 0, 0, 0)]
        assert ("in control on no estimate" in group.never(iter(()))[0]) is said
    draws = group.drawn(None, np.random.default_rng(1))  # type: ignore[arg-type]
    points = [next(draws)[0] for _ in range(200)]
    assert all(0 <= x < 1 or 2 <= x < 3 for x in points)
    assert {int(x) for x in points} == {0, 2}


def test_the_law_is_looked_at_on_the_cells_of_sc() -> None:
    own = GridGroup(tables([1, 1, 0, 0]))
    law = GridGroup(tables([0, 2, 1, 0]))
    others: Any = SimpleNamespace(tables=None)
    assert own.kept_by([others, law]).members.tolist() == [False, True, True, False]
    shifted = GroupTables((0,), Grid(((0.0, 1.0, 2.0, 3.0, 5.0),)), law.tables.core)
    beside = GroupTables((1,), LINE, law.tables.core)
    for wrong in ([], [others], [GridGroup(shifted)], [GridGroup(beside)]):
        with pytest.raises(RejectedError, match="other cells"):
            own.kept_by(wrong)


def test_tables_are_read_where_they_are_named() -> None:
    def numbers(path: Any, shape: Any, kind: str) -> Any:
        return ("numbers", path, shape, kind)

    certificate: Any = SimpleNamespace(
        numbers=numbers, bits=lambda path, shape: ("bits", path, shape), count=lambda _: None
    )
    axes: Any = SimpleNamespace(states=(0,), grid=LINE)
    entry = {"K": "k", "R": "r", "Q": "q", "W": "w", "W_N": "n", "S": ["s", "t"]}
    got = GridGroup.read(certificate, None, entry, axes).tables  # type: ignore[arg-type]
    shape = (4,)
    assert got.core == ("numbers", "k", shape, "<u1")
    assert got.free == ("bits", "r", shape)
    assert got.home == ("numbers", "q", shape, "<u1")
    assert got.rank == ("numbers", "w", shape, "<u2")
    assert got.rank_holds == ("numbers", "n", shape, "<u1")
    assert got.levels == [("bits", "s", shape), ("bits", "t", shape)]
    bare = GridGroup.read(certificate, None, {"K": "k"}, axes).tables  # type: ignore[arg-type]
    assert (bare.free, bare.home, bare.rank, bare.rank_holds, bare.levels) == (None,) * 4 + ([],)


def test_a_table_of_the_dm_is_that_of_all_cases() -> None:
    levels = [bools(1, 1, 1, 0), bools(1, 0, 0, 0)]
    facts: Any = SimpleNamespace(
        symbol=SimpleNamespace(shield=None), states=[SimpleNamespace(name="x")], leaves={0: None}
    )
    data = packed(np.array([2, 1, 1, 0], dtype=np.uint8))

    def said(entry: Any, *groups: GroupTables, plain: bytes = data, edges: Any = None) -> str:
        given: Any = SimpleNamespace(
            plain=lambda _: plain, edges=lambda _: LINE.edges[0] if edges is None else edges
        )
        own = [GridGroup(g) for g in groups]
        return fails(lambda: own[0].compare(given, facts, own, entry) or ())

    axis = {"state": "x", "edges": "e"}
    entry = {"axes": [axis], "levels": "l"}
    group = tables([1] * 4, levels=levels)
    more = tables([1] * 4, levels=[bools(1, 1, 1, 1)])
    assert said(entry, group) == ""
    assert group.given_back is not None
    assert group.given_back.tolist() == [True, False, False, False]
    assert said(entry, group, more) == ""
    assert more.given_back is not None
    assert more.given_back.tolist() == [True, False, False, False]
    assert "as it should" in said(entry | {"more": 1}, group)
    assert "as it should" in said({"axes": [axis]}, group)
    assert "as it should" in said(entry | {"command": None, "commands": "c"}, group)
    other = GroupTables((0,), Grid(((0.0, 1.0, 2.0, 3.0, 5.0),)), group.core, levels=levels)
    assert "other grids" in said(entry, group, other)
    other = GroupTables((1,), LINE, group.core, levels=levels)
    assert "other grids" in said(entry, group, other)
    assert "other axes" in said(entry | {"axes": [axis | {"state": "y"}]}, group)
    assert "other axes" in said(entry | {"axes": []}, group)
    assert "elsewhere" in said(entry | {"axes": [axis | {"more": 1}]}, group)
    assert "elsewhere" in said(entry, group, edges=(0.0, 4.0))
    assert "not that of S" in said(entry, group, plain=b"\x00")
    facts.symbol.shield = 1
    assert "as it should" in said(entry, group)
    facts.controls = [SimpleNamespace(name="push"), SimpleNamespace(name="pull")]
    shielded = entry | {"command": "turn", "commands": "c"}
    assert "that there is not" in said(shielded, group)


def test_what_is_of_a_shield_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid_group, "cells_of", lambda _: 2)
    monkeypatch.setattr(grid_group, "tops_of", lambda data, group, n: (data, group, n))
    facts: Any = SimpleNamespace(controls=[SimpleNamespace(name=n) for n in ("push", "pull")])
    given: Any = SimpleNamespace(plain=lambda path: path)
    for name, index in (("push", 0), ("pull", 1), (None, None)):
        group = tables([1] * 4)
        grid_group._shield(given, facts, group, {"command": name, "commands": "c"})
        assert group.command == index
        assert group.tops == ("c", group, 2)


def test_what_may_hold_outside_r_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(grid_group, "AdmitCheck", lambda *_, **k: asked.append(k))
    model: Any = SimpleNamespace(facts=SimpleNamespace(states=[SimpleNamespace(name="x")]))
    group = GridGroup(tables([1] * 4, free=bools(1, 0, 1, 1)))
    for found, wanted in (([], ""), ([((1, 2),), ((2, 3),)], "outside R(H), at x in [1, 2]")):
        monkeypatch.setattr(grid_group, "admitted", lambda *_, found=found: iter(found))
        assert wanted in group.entered(model, "expr")  # type: ignore[arg-type]
        assert bool(group.entered(model, "expr")) is bool(wanted)  # type: ignore[arg-type]
    assert all(k == {"admits": True, "anywhere": True} for k in asked)


@pytest.mark.parametrize("claims", [set(), {"P2a"}, set(grid_group.FREE)])
def test_a_few_cells_of_k_are_tried(claims: set[str], monkeypatch: pytest.MonkeyPatch) -> None:
    led: list[Any] = []
    stayed: list[Any] = []
    free_check = SimpleNamespace(
        stays=lambda box, _w, pieces: stayed.append((float(box[0][0]), pieces))
    )
    monkeypatch.setattr(grid_group, "FreeCheck", lambda *_: free_check)
    for core, wanted in (
        ([0, 0, 0, 0], []),
        ([0, 5, 0, 0], [(1.0, 2)]),
        ([1, 0, 3, 0], [(0.0, 1), (2.0, 2)]),
        ([1, 2, 3, 1], [(0.0, 1), (1.0, 2), (3.0, 1)]),
    ):
        led.clear()
        stayed.clear()
        check = check_of(tables(core), times={"H_ns": 5})
        check.chains = SimpleNamespace(
            leads=lambda box, holds, within, target, pieces: led.append(
                (float(box[0][0]), holds, float(box[0][1]), within.size, target([0.0, 4.0]), pieces)
            )
        )
        check.tried(claims)
        assert [(a, n) for a, n, *_ in led] == wanted
        assert all((b - a, n, t, p) == (1.0, 4, True, 1) for a, _, b, n, t, p in led)
        assert stayed == ([(a, 4) for a, _ in wanted] if claims & grid_group.FREE else [])


def test_who_sees_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    for kept, linear in itertools.product((True, False), repeat=2):
        monkeypatch.setattr(grid_group, "is_linear", lambda *_, linear=linear: linear)
        assert check_of(tables([1] * 4), kept=kept).sees_rates is (not kept and not linear)
