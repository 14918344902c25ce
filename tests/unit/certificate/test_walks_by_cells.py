"""Walks over the cells of a group: each cell against its own number of holds, rank and pieces."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.cell_sets import Cells
from soter.certificate.grid import group_claims
from soter.certificate.grid.group_claims import (
    ChainCheck,
    FreeCheck,
    GroupTables,
    cells_driven_out,
    cells_not_led,
    cells_not_nearer,
    distinct_holds,
)
from soter.certificate.grid.sc_chains import EVERY
from soter.certificate.terms.linear_enclosures import exact
from unit.certificate.grid_tables import LINE, bools, grid_beyond, tables

if TYPE_CHECKING:
    from collections.abc import Iterator


class Shift:
    """A chain that moves everything by so much a hold, followed in one box."""

    def __init__(self, step: float, group: GroupTables) -> None:
        self.step, self.group, self.calls = step, group, 0

    def follow(self, box: Any, wanted: Any, within: Cells, *_: Any, **__: Any) -> Iterator[Any]:
        low, high = (float(x) for x in box[0])
        for k in range(1, max(wanted, default=0) + 1):
            self.calls += 1
            before, now = (
                (low + (k - 1) * self.step, high + (k - 1) * self.step),
                (
                    low + k * self.step,
                    high + k * self.step,
                ),
            )
            if not within.contains([min(before[0], now[0]), max(before[1], now[1])]):
                return
            if k in wanted:
                yield k, [now]

    def leads_in_parts(self, box: Any, holds: int, within: Cells, target: Any) -> bool:
        return any(n == holds and target(ends[0]) for n, ends in self.follow(box, [holds], within))


def test_cells_of_which_a_chain_does_not_lead_back() -> None:
    """Each cell against its own number of holds, one by one."""
    for core in itertools.product((0, 1, 2), repeat=4):
        group = tables(list(core))
        kernel = Cells(LINE, group.core > 0)
        for allowed in (bools(1, 1, 1, 1), bools(1, 1, 1, 0), bools(0, 1, 1, 1)):
            check: Any = Shift(-1.0, group)
            left = list(
                cells_not_led(check, group.core, Cells(LINE, allowed), kernel, LINE.all_cells)
            )
            wanted = []
            for i, holds in enumerate(core):
                way = range(max(i - holds, -1), i + 1)
                fine = i - holds >= 0 and all(allowed[k] for k in way) and core[i - holds] > 0
                if holds and not fine:
                    wanted.append(i)
            assert sorted(a for ((a, _),) in left) == wanted


def test_cells_from_which_a_chain_does_not_come_nearer() -> None:
    every = itertools.product((0, 1, 2, 3), (0, 1, 2, 3), (0, 2, 3), *[(0, 1, 2)] * 3)
    for *rank, a, b, c in itertools.islice(every, 3, None, 7):
        for holds in ((a, b, c),):
            group = tables(
                [1] * 4,
                rank=np.array([1, *rank], dtype=np.uint16),
                rank_holds=np.array([0, *holds], dtype=np.uint8),
            )
            check: Any = Shift(-1.0, group)
            left = list(cells_not_nearer(check, Cells(LINE, bools(1, 0, 0, 0)), LINE.all_cells))
            order = [0, *(r or 10**6 for r in rank)]
            wanted = [
                i
                for i in (1, 2, 3)
                if rank[i - 1]
                and not (holds[i - 1] and i >= holds[i - 1] and order[i - holds[i - 1]] < order[i])
            ]
            assert sorted(a for ((a, _),) in left) == wanted
    grid = LINE
    holds_, asked = np.array([3, 0, 1, 3], dtype=np.uint8), bools(1, 1, 0, 1)
    assert distinct_holds(holds_, asked) == [3]
    assert distinct_holds(holds_, bools(1, 1, 1, 1)) == [1, 3]
    assert grid.all_cells == ((0, 4),)


def test_cells_from_which_a_command_may_lead_out() -> None:
    splits: list[int] = []

    def keeps(box: Any, _within: Cells, often: int) -> bool:
        splits.append(often)
        return float(box[0][1]) <= 3.0

    check: Any = SimpleNamespace(group=SimpleNamespace(grid=LINE), stays_in_parts=keeps)
    every = Cells(LINE, bools(1, 1, 1, 1))
    assert list(cells_driven_out(check, bools(1, 1, 1, 1), every, LINE.all_cells)) == [((3, 4),)]
    assert splits == [0, 0, 0, 0, group_claims.SPLITS] or splits[-1] in (0, group_claims.SPLITS)
    assert splits[0] == 0
    assert group_claims.SPLITS in splits
    assert list(cells_driven_out(check, bools(1, 1, 1, 0), every, LINE.all_cells)) == []


def test_a_free_phase_stays_from_its_beginning_on() -> None:
    """In a map the next step begins where the last one ended; else each begins at the start."""
    begun: list[float] = []

    def step(form: Any) -> Any:
        begun.append(float(form[0]))
        moved = tuple(x + 1 if k < 3 else x for k, x in enumerate(form))
        return moved, [float(moved[0]), float(moved[1])]

    group = tables([1] * 4)
    for kind, start, members, stays, forms in (
        ("flow", 0.0, (1, 1, 1, 1), True, [0.0, 0.0]),
        ("map", 0.0, (1, 1, 1, 1), True, [0.0, 1.0]),
        ("map", 2.0, (1, 1, 1, 1), False, [2.0, 3.0]),
        ("flow", 0.0, (0, 1, 1, 1), False, []),
        ("flow", 0.0, (1, 0, 1, 1), False, [0.0]),
        ("map", 0.0, (1, 1, 0, 1), False, [0.0, 1.0]),
    ):
        begun.clear()
        model: Any = SimpleNamespace(facts=SimpleNamespace(kind=kind))
        check = FreeCheck(model, group, 5)
        check._phases[4] = (step, step)
        within = Cells(LINE, bools(*members))
        assert check.stays_in([(exact(start), exact(start + 1))], within, 4) is stays
        assert begun == forms
    check._phases[4] = (lambda _: None,)
    assert check.stays_in([(exact(0.0), exact(1.0))], Cells(LINE, bools(1, 1, 1, 1)), 4) is False


def test_a_free_phase_is_cut_finer_where_it_may_be() -> None:
    for fine_from, splits, wanted in (
        (4, 0, True),
        (16, 0, False),
        (16, 2, True),
        (64, 2, True),
        (99, 2, False),
    ):
        asked: list[Any] = []

        def stays(
            box: Any, within: Cells, pieces: int, asked: list[Any] = asked, least: int = fine_from
        ) -> bool:
            del within
            asked.append((pieces, float(box[0][1] - box[0][0])))
            return pieces >= least

        check: Any = SimpleNamespace(stays_in=stays)
        assert FreeCheck.stays_in_parts(check, [(exact(0.0), exact(1.0))], None, splits) is wanted  # type: ignore[arg-type]
        assert asked[0] == (4, 1.0)
        assert (len(asked) > 1) is (splits > 0 and fine_from > 4)
        assert min(w for _, w in asked) == (0.25 if (splits and fine_from > 16) else 1.0)


def test_chains_are_tried_finer_and_finer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Any way through all windows of one division shows a cell; no half-shown division does."""
    monkeypatch.setattr(
        group_claims,
        "windows_of_runs",
        lambda *_, by_age=False: ("c", "d") if by_age else ("a", "b"),
    )
    every = Cells(LINE, bools(1, 1, 1, 1))
    group = tables([1] * 4)
    whole = EVERY
    for good, wanted in (
        ({whole}, True), ({"a", "b"}, True), ({"c", "d"}, True), ({"a", "d"}, False),
        (set(), False), ({"a"}, False), ({"b", "c"}, False),
    ):  # fmt: skip
        check = ChainCheck(model_with_reads(2, own=2), group)
        seen: set[Any] = set()

        def leads(box: Any, holds: int, within: Any, target: Any, pieces: int, *, cuts: int,
                  window: Any, good: Any = good, seen: set[Any] = seen) -> bool:  # fmt: skip
            assert (holds, within, target, pieces) == (3, every, every.contains, 4)
            seen.add((window, cuts, float(box[0][1] - box[0][0])))
            return window in good

        monkeypatch.setattr(check, "leads_to", leads)
        box = [(exact(0.0), exact(1.0))]
        assert check.leads_in_parts(box, 3, every, every.contains) is wanted
        assert whole not in good or seen == {(whole, 0, 1.0)}
        if not good:
            tried = {
                (cuts, min(w for v, c, w in seen if v == "c" and c == cuts)) for _, cuts, _ in seen
            }
            assert tried == {(0, 2.0**-6), (4, 2.0**-4), (7, 2.0**-4)}
    monkeypatch.setattr(group_claims, "windows_of_runs", lambda *_, **__: (whole,))
    assert ChainCheck(model_with_reads(2, own=2), group)._window_splits() == [(whole,)]


def model_with_reads(claimed: int, *, own: int) -> Any:
    """A model whose certificate has reads so old, where none are older than `own`."""
    return SimpleNamespace(
        facts=SimpleNamespace(delay_ns=claimed, derived=SimpleNamespace(delay=own))
    )


@pytest.mark.parametrize("good", [True, False])
def test_where_older_reads_than_there_are_are_too_much_those_that_there_are_follow(
    monkeypatch: pytest.MonkeyPatch, good: bool
) -> None:
    """Once, for all that this check is asked later, and for no other check."""
    monkeypatch.setattr(group_claims, "windows_of_runs", lambda *_, **__: ("a",))
    model, every = model_with_reads(5, own=2), Cells(LINE, bools(1, 1, 1, 1))
    check, asked = ChainCheck(model, tables([1] * 4)), set[Any]()

    def leads(*_: Any, window: Any, **__: Any) -> bool:
        asked.add((check.delay_ns, window))
        return good and check.delay_ns == 2 and window == "a"

    monkeypatch.setattr(check, "leads_to", leads)
    check._chains[1, EVERY] = "of reads 5 old"  # type: ignore[assignment]
    assert check.leads_in_parts([(exact(0.0), exact(1.0))], 3, every, every.contains) is good
    assert asked == {(5, EVERY), (2, EVERY), (2, "a")}
    assert check._chains == {}
    assert model.facts.delay_ns == ChainCheck(model, tables([1] * 4)).delay_ns == 5


def test_chains_and_phases_are_compiled_once(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[Any] = []

    def noted(*of: Any) -> Any:
        compiled.append(of[-2:])
        return object()

    monkeypatch.setattr(group_claims, "sc_chain", noted)
    monkeypatch.setattr(group_claims, "free_phase_steps", noted)
    check: Any = ChainCheck(model_with_reads(2, own=2), tables([1] * 4))
    assert check.compiled_chain(1) is check.compiled_chain(1)
    assert check.compiled_chain(1) is not check.compiled_chain(4)
    assert check.compiled_chain(1, "late") is not check.compiled_chain(1)
    assert compiled == [(1, EVERY), (4, EVERY), (1, "late")]
    compiled.clear()
    phases = FreeCheck(None, tables([1] * 4), 7)  # type: ignore[arg-type]
    assert phases.compiled_steps(4) is phases.compiled_steps(4)
    assert phases.compiled_steps(16) is not phases.compiled_steps(4)
    assert compiled == [(7, 4), (7, 16)]


def test_what_is_followed_has_to_hold_of_runs_beyond() -> None:
    """The last cell is 1 wide: what falls by more from the end says nothing of runs beyond."""
    grid = grid_beyond(LINE.edges, (True,))
    cells = Cells(grid, bools(1, 1, 1, 1))
    for fall, fine in ((1.0, True), (1.5, False)):
        for place in ("way", "end", "last"):

            def moved(form: Any, least: float) -> Any:
                return (exact(least), exact(least + 0.5), *form[2:]), [least, least + 0.5]

            def step(form: Any, place: str = place, fall: float = fall) -> Any:
                after, _ = moved(form, 3.5 - (fall if place == "end" else 0.0))
                return after, moved(form, 3.5 - fall)[1] if place == "way" else [3.5, 4.0]

            def last(form: Any, fall: float = fall) -> Any:
                return (), moved(form, 3.5 - fall)[1]

            group: Any = tables([1] * 4)
            group.grid = grid
            check: Any = ChainCheck(model_with_reads(2, own=2), group)
            chain = SimpleNamespace(first=step, later=step, last=last if place == "last" else None)
            check._chains[1, EVERY] = chain
            box = [(exact(3.5), exact(4.0))]
            found = list(check.follow(box, [1], cells, 1))
            assert bool(found) is fine, (fall, place)
            assert check.leads_to(box, 1, cells, cells.contains, 1) is fine
            assert check.leads_to(box, 1, cells, lambda _: False, 1) is False
