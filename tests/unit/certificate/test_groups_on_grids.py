"""Groups on grids: what they read, what they say of themselves, the bytes that a DM has of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.cell_sets import Axes, Grid
from soter.certificate.extras import estimates_and_shield, handovers, trial
from soter.certificate.extras.estimates_and_shield import packed_levels
from soter.certificate.grid.grid_group import GridGroup
from soter.certificate.grid.group_claims import (
    RESTS,
    GroupTables,
)
from soter.certificate.reading.folder import FREE, Certificate
from soter.certificate.report import RecheckedModule, RejectedError
from unit.certificate.grid_tables import LINE, bools, check_of, fails, tables
from unit.certificate.test_single_refusals import facts_of

if TYPE_CHECKING:
    from pathlib import Path


def test_what_a_group_says_of_itself() -> None:
    group = GridGroup(tables([1, 0, 1, 0]))
    assert group.states == (0,)
    group.tables.free = bools(0, 0, 0, 0)
    told = RecheckedModule("M", {}, cells=5)
    group.add_size_to(told)
    assert told.cells == 9
    assert group.why_never_ac == ""
    group.tables.given_back = bools(0, 0, 0, 0)
    assert "on no estimate" in group.why_never_ac
    group.tables.given_back = bools(0, 1, 0, 0)
    assert group.why_never_ac == ""
    for members, said in ((bools(0, 0, 0, 0), True), (bools(0, 1, 0, 0), False)):
        group.tables.levels = [members, bools(0, 0, 0, 0)]
        assert ("in control on no estimate" in group.why_never_ac) is said
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


def test_tables_are_read_where_they_are_named(tmp_path: Path) -> None:
    contents = {
        "sets/k": bytes([1, 2, 0, 1]), "sets/r": bytes([0b0101]), "sets/q": bytes([3, 0, 0, 1]),
        "sets/w": np.array([1, 2, 300, 0], dtype="<u2").tobytes(), "sets/n": bytes([0, 4, 5, 0]),
        "sets/s": bytes([0b0111]), "sets/t": bytes([0b0010]), "sets/still": bytes([1, RESTS, 0, 1]),
    }  # fmt: skip
    facts, line = facts_of(tmp_path), Axes((0,), LINE)

    def read(**entry: Any) -> GroupTables:
        certificate = Certificate(tmp_path, {}, contents, set())
        return GridGroup.read(certificate, facts, entry, line).tables

    named: dict[str, dict[str, Any]] = {
        "R": {"R": "sets/r"}, "Q": {"Q": "sets/q"}, "W": {"W": "sets/w", "W_N": "sets/n"},
        "S": {"S": ["sets/s", "sets/t"]},
    }  # fmt: skip
    for there in ("", "R", "Q", "W", "S", "RQWS"):
        got = read(K="sets/k", **{n: path for name in there for n, path in named[name].items()})
        assert got.core.tolist() == [1, 2, 0, 1]
        found = [of is not None for of in (got.free, got.home, got.rank, got.rank_holds)]
        assert found == [name in there for name in "RQWW"]
        assert len(got.levels) == (2 if "S" in there else 0)
    assert got.free is not None
    assert got.free.tolist() == [True, False, True, False]
    assert [of.tolist() for of in (got.home, got.rank, got.rank_holds) if of is not None] == [
        [3, 0, 0, 1], [1, 2, 300, 0], [0, 4, 5, 0],
    ]  # fmt: skip
    assert [of.tolist() for of in got.levels] == [
        bools(1, 1, 1, 0).tolist(),
        bools(0, 1, 0, 0).tolist(),
    ]
    assert not facts.at_rest
    read(K="sets/still")
    assert facts.at_rest


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
    monkeypatch.setattr(
        estimates_and_shield, "read_shield_table", lambda data, group, n: (data, group, n)
    )
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
        assert wanted in handovers.place_entered_outside(group, model, "expr")  # type: ignore[arg-type]
        assert bool(handovers.place_entered_outside(group, model, "expr")) is bool(wanted)  # type: ignore[arg-type]
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
