"""Groups on grids: what they read, what they say of themselves, the bytes that a DM has of them."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from soter.certificate.cell_sets import Grid
from soter.certificate.extras import estimates_and_shield, handovers, trial
from soter.certificate.extras.estimates_and_shield import packed_levels
from soter.certificate.grid import grid_group
from soter.certificate.grid.grid_group import GridGroup
from soter.certificate.grid.group_claims import (
    RESTS,
    GroupTables,
)
from soter.certificate.reading.folder import FREE
from soter.certificate.report import RejectedError
from unit.certificate.grid_tables import LINE, bools, check_of, fails, tables


def test_what_a_group_says_of_itself() -> None:
    group = GridGroup(tables([1, 0, 1, 0]))
    assert group.states == (0,)
    group.tables.free = bools(0, 0, 0, 0)
    told: Any = SimpleNamespace(cells=5)
    group.add_size_to(told)
    assert told.cells == 9
    assert group.why_ac_never == ""
    group.tables.given_back = bools(0, 0, 0, 0)
    assert "on no estimate" in group.why_ac_never
    group.tables.given_back = bools(0, 1, 0, 0)
    assert group.why_ac_never == ""
    for members, said in ((bools(0, 0, 0, 0), True), (bools(0, 1, 0, 0), False)):
        group.tables.levels = [members, bools(0, 0, 0, 0)]
        assert ("in control on no estimate" in group.why_ac_never) is said
    draws = group.random_points(np.random.default_rng(1))
    points = [next(draws)[0] for _ in range(200)]
    assert all(0 <= x < 1 or 2 <= x < 3 for x in points)
    assert {int(x) for x in points} == {0, 2}
    assert max(x % 1 for x in points) > 0.9


def test_the_law_is_looked_at_on_the_cells_of_sc() -> None:
    own = GridGroup(tables([1, 1, 0, 0]))
    law = GridGroup(tables([0, 2, 1, 0]))
    assert own.cells_kept_by_law([law]).members.tolist() == [False, True, True, False]
    shifted = GroupTables((0,), Grid(((0.0, 1.0, 2.0, 3.0, 5.0),)), law.tables.core)
    beside = GroupTables((1,), LINE, law.tables.core)
    for wrong in ([], [GridGroup(shifted)], [GridGroup(beside)]):
        with pytest.raises(RejectedError, match="other cells"):
            own.cells_kept_by_law(wrong)


def test_tables_are_read_where_they_are_named() -> None:
    def numbers(path: Any, shape: Any, kind: str) -> Any:
        return core if path == "k" else ("numbers", path, shape, kind)

    core = np.array([1, 2, 0, 1], dtype=np.uint8)
    facts: Any = SimpleNamespace(at_rest=False)
    certificate: Any = SimpleNamespace(
        number_table=numbers,
        set_of_cells=lambda path, shape: ("bits", path, shape),
        count_cells=lambda _: None,
    )
    axes: Any = SimpleNamespace(states=(0,), grid=LINE)
    entry = {"K": "k", "R": "r", "Q": "q", "W": "w", "W_N": "n", "S": ["s", "t"]}
    got = GridGroup.read(certificate, facts, entry, axes).tables
    shape = (4,)
    assert got.core is core
    assert not facts.at_rest
    assert got.free == ("bits", "r", shape)
    assert got.home == ("numbers", "q", shape, "<u1")
    assert got.rank == ("numbers", "w", shape, "<u2")
    assert got.rank_holds == ("numbers", "n", shape, "<u1")
    assert got.levels == [("bits", "s", shape), ("bits", "t", shape)]
    core[1] = RESTS
    bare = GridGroup.read(certificate, facts, {"K": "k"}, axes).tables
    assert facts.at_rest
    assert (bare.free, bare.home, bare.rank, bare.rank_holds, bare.levels) == (None,) * 4 + ([],)


def test_a_table_of_the_dm_is_that_of_all_cases() -> None:
    levels = [bools(1, 1, 1, 0), bools(1, 0, 0, 0)]
    facts: Any = SimpleNamespace(
        symbol=SimpleNamespace(shield=None), states=[SimpleNamespace(name="x")], leaves={0: None}
    )
    data = packed_levels(np.array([2, 1, 1, 0], dtype=np.uint8))

    def said(entry: Any, *groups: GroupTables, plain: bytes = data, edges: Any = None) -> str:
        given: Any = SimpleNamespace(
            table_bytes=lambda _: plain,
            breakpoints=lambda _: LINE.edges[0] if edges is None else edges,
        )
        compare: Any = estimates_and_shield.compare_table
        return fails(lambda: compare(given, facts, groups, entry) or ())

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
    monkeypatch.setattr(estimates_and_shield, "command_cells", lambda _: 2)
    monkeypatch.setattr(estimates_and_shield, "read_tops", lambda data, group, n: (data, group, n))
    facts: Any = SimpleNamespace(controls=[SimpleNamespace(name=n) for n in ("push", "pull")])
    given: Any = SimpleNamespace(table_bytes=lambda path: path)
    for name, index in (("push", 0), ("pull", 1), (None, None)):
        group = tables([1] * 4)
        estimates_and_shield.read_shield(given, facts, group, {"command": name, "commands": "c"})
        assert group.command == index
        assert group.tops == ("c", group, 2)


def test_what_may_hold_outside_r_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(handovers, "AdmitCheck", lambda *_, **k: asked.append(k))
    model: Any = SimpleNamespace(facts=SimpleNamespace(states=[SimpleNamespace(name="x")]))
    group = GridGroup(tables([1] * 4, free=bools(1, 0, 1, 1)))
    without: Any = GridGroup(tables([1] * 4))
    assert handovers.why_not_entered(model, [without], "expr") == "there is no R(H)"  # type: ignore[arg-type]
    for found, wanted in (([], ""), ([((1, 2),), ((2, 3),)], "outside R(H), at x in [1, 2]")):
        monkeypatch.setattr(
            handovers, "cells_wrongly_admitted", lambda *_, found=found: iter(found)
        )
        assert wanted in handovers.where_entered_outside(group, model, "expr")  # type: ignore[arg-type]
        assert bool(handovers.where_entered_outside(group, model, "expr")) is bool(wanted)  # type: ignore[arg-type]
    assert all(k == {"admits": True, "anywhere": True} for k in asked)


@pytest.mark.parametrize("claims", [set(), {"P2a"}, set(FREE)])
def test_a_few_cells_of_k_are_tried(claims: set[str], monkeypatch: pytest.MonkeyPatch) -> None:
    led: list[Any] = []
    stayed: list[Any] = []
    free_check = SimpleNamespace(
        stays_in=lambda box, _w, pieces: stayed.append((float(box[0][0]), pieces))
    )
    monkeypatch.setattr(trial, "FreeCheck", lambda *_: free_check)
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
            leads_to=lambda box, holds, within, target, pieces: led.append(
                (float(box[0][0]), holds, float(box[0][1]), within.size, target([0.0, 4.0]), pieces)
            )
        )
        trial.follow_few_cells(check, claims)
        assert [(a, n) for a, n, *_ in led] == wanted
        assert all((b - a, n, t, p) == (1.0, 4, True, 1) for a, _, b, n, t, p in led)
        assert stayed == ([(a, 4) for a, _ in wanted] if claims & FREE else [])


def test_who_shows_that_rates_are_defined(monkeypatch: pytest.MonkeyPatch) -> None:
    for kept, linear in itertools.product((True, False), repeat=2):
        monkeypatch.setattr(grid_group, "has_linear_rates", lambda *_, linear=linear: linear)
        assert check_of(tables([1] * 4), kept=kept).shows_rates_defined is (not kept and not linear)
