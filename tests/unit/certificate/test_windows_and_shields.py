"""Windows of late commands, estimates in cells, tables of shields: each against its definition."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from fractions import Fraction
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.cell_sets import Cells
from soter.certificate.extras import estimates_and_shield
from soter.certificate.grid import sc_chains
from soter.certificate.grid.sc_chains import EVERY, Window, windows_of_runs
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.report import RejectedError
from tables import all_rows
from unit.certificate.grid_tables import LINE, bools, tables
from unit.certificate.test_single_refusals import facts_of

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# ---------------------------------------------------------------- windows


def test_a_window_holds_its_share_of_all_runs() -> None:
    """With p in its part of [0, j] a command acts in [-p, j - p]."""
    jitter, delay = Fraction(3), Fraction(5)
    for count in (1, 2, 4):
        for index in range(count):
            early, late = Window(index, count).early_and_late(jitter)
            p = [jitter * k / count for k in (index, index + 1)]
            assert early == max(p)
            assert late == max(jitter - x for x in p)
        for age in range(count):
            begin, end = Window(0, 1, age, count).sample_span(delay)
            assert (begin, end) == (-delay * (age + 1) / count, -delay * age / count)
    assert EVERY.early_and_late(jitter) == (jitter, jitter)
    assert EVERY.sample_span(delay) == (-delay, 0)  # type: ignore[comparison-overlap]


@all_rows("jitter", [0, 2])
@all_rows("delay", [0, 3])
@all_rows("paths", [[1], [2], [1, 1], [0]])
@all_rows("linear", [True, False])
@all_rows("stations", [("sensor",), ("sensor", "node")])
@all_rows("silent", [0, 5])
def test_into_which_windows_runs_are_told_apart(
    jitter: int,
    delay: int,
    paths: list[int],
    linear: bool,
    stations: tuple[str, ...],
    silent: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sc_chains, "has_linear_rates", lambda *_: linear)
    reads = [SimpleNamespace(paths=[SimpleNamespace(clocks=stations)] * n) for n in paths]
    facts = SimpleNamespace(
        kind="flow",
        jitter_ns=jitter,
        has_late_commands=False,
        setting=SimpleNamespace(by_sc=reads, silent=silent),
    )
    model: Any = SimpleNamespace(facts=facts)
    parts = 4 if jitter else 1
    assert windows_of_runs(model, [0], delay) == tuple(Window(k, parts) for k in range(parts))
    mixed = bool(silent) and len(stations) > 1
    ages = 4 if delay and linear and sum(paths) == 1 and not mixed else 1
    assert windows_of_runs(model, [0], delay, by_age=True) == tuple(
        Window(k, parts, a, ages) for k in range(parts) for a in range(ages)
    )
    facts.kind = "map"
    assert windows_of_runs(model, [0], delay, by_age=True) == (EVERY,)


# ---------------------------------------------------------------- estimates


def model_with(folder: Path, error: float) -> CaseModel:
    """The topic that shows the first state is measured with this error."""
    measured = f"der p = u; measured x within {error};" if error else "der p = u;"
    facts = facts_of(folder, ("der p = u;", measured))
    assert [s.name for s in facts.states] == ["p.p", "q.q"]
    return CaseModel(facts, (), ((0.0, 4.0), (0.0, 4.0)))


def test_estimates_are_as_far_off_as_errors_are(tmp_path: Path) -> None:
    group = tables([1] * 4)
    for error in (0.0, 0.25, 1.5):
        model = model_with(tmp_path, error)
        low, high = estimates_and_shield.estimates_around(model, group, LINE.box_of(((1, 3),)))
        assert low == pytest.approx(1.0 - error)
        assert high == pytest.approx(3.0 + error)
        if error:
            assert low < 1.0 - error - 2.0**-53 * (1 + error)
            assert high > 3.0 + error + 2.0**-53 * (3 + error)
        else:
            assert (low, high) == (1.0, 3.0)
        for members in itertools.product((0, 1), repeat=4):
            level = Cells(LINE, bools(*members))
            kept = estimates_and_shield.eroded_cells(model, group, level).members
            for i in range(4):
                near = [k for k in range(-3, 8) if k + 1 > i - error and k < i + 1 + error]
                near = near if error else [i]
                fine = all(0 <= k < 4 and members[k] for k in near)
                assert kept[i] == (fine and bool(members[i]))


def test_levels_hold_and_drift_by_what_is_behind_estimates(tmp_path: Path) -> None:
    group = tables([1] * 4)
    inside = Cells(LINE, bools(1, 1, 1, 0))
    for error, left in ((0.0, [3]), (0.5, [0, 2, 3])):
        model = model_with(tmp_path, error)
        cells = estimates_and_shield.estimates_of_states_outside(
            model, group, bools(1, 1, 1, 1), inside, LINE.all_cells
        )
        assert sorted(a for ((a, _),) in cells) == left
        asked: list[Any] = []

        def keeps(box: Any, within: Cells, splits: int, asked: list[Any] = asked) -> bool:
            asked.append((round(float(box[0][1] - box[0][0]), 6), splits))
            return within.contains([float(x) for x in box[0]])

        check: Any = SimpleNamespace(group=group, model=model, stays_in_parts=keeps)
        found = estimates_and_shield.estimates_driven_out(
            check, bools(1, 1, 1, 1), inside, LINE.all_cells
        )
        assert sorted(a for ((a, _),) in found) == left
        assert {s for w, s in asked if w == 1 + 2 * error} == {estimates_and_shield.SPLITS}  # type: ignore[attr-defined]
        assert {s for w, s in asked if w > 1 + 2 * error} == {0}


def test_a_state_that_no_topic_shows_is_anywhere_on_its_axis(tmp_path: Path) -> None:
    group, model = tables([1] * 4), model_with(tmp_path, 0.0)
    assert estimates_and_shield.estimates_around(model, group, LINE.box_of(((1, 2),))) == (1.0, 2.0)
    del model.facts.leaves[0]
    assert estimates_and_shield.estimates_around(model, group, LINE.box_of(((1, 2),))) == (0.0, 4.0)


# ---------------------------------------------------------------- shields


@dataclass
class Control:
    name: str
    low: float
    high: float


def test_tables_of_a_shield_are_of_the_grid_and_the_command_cells() -> None:
    group = tables([1] * 4)
    good = np.array([[2, 2], [1, 0], [0, 2], [0, 0]], dtype=np.uint8)
    assert (
        estimates_and_shield.read_shield_table(good.tobytes(), group, 2).tolist() == good.tolist()
    )
    for row, fine in (([3, 0], False), ([1, 1], False), ([2, 1], False), ([1, 2], True)):
        wrong = good.copy()
        wrong[3] = row
        if fine:
            assert (
                estimates_and_shield.read_shield_table(wrong.tobytes(), group, 2).tolist()
                == wrong.tolist()
            )
        else:
            with pytest.raises(RejectedError, match="names"):
                estimates_and_shield.read_shield_table(wrong.tobytes(), group, 2)
    for data in (good.tobytes()[:-1], good.tobytes() + b"\0", b""):
        with pytest.raises(RejectedError, match="size"):
            estimates_and_shield.read_shield_table(data, group, 2)
    assert [estimates_and_shield.command_edge(-1.0, 3.0, k, 4) for k in range(5)] == [
        -1.0,
        0.0,
        1.0,
        2.0,
        3.0,
    ]


def test_what_a_shield_permits_is_shown_for_each_range_of_commands(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Beyond S_0, for every least and greatest cell that the table names together."""
    asked: list[Any] = []

    def drifts(check: Any, claimed: Any, core: Any, block: Any) -> Iterator[Any]:
        asked.append((check[0].controls[1], claimed.tolist(), core, block))
        return iter(())

    monkeypatch.setattr(estimates_and_shield, "command_cells", lambda _: 2)
    monkeypatch.setattr(estimates_and_shield, "LocalFlow", lambda *_: SimpleNamespace(moves=moves))  # type: ignore[has-type]
    monkeypatch.setattr(estimates_and_shield, "CaseModel", lambda facts, *_: facts)
    monkeypatch.setattr(
        estimates_and_shield, "FreeCheck", lambda model, group, ns: (model, group, ns)
    )
    monkeypatch.setattr(estimates_and_shield, "estimates_driven_out", drifts)
    controls = [Control("turn", 0.0, 1.0), Control("push", -1.0, 3.0)]
    facts = SimpleNamespace(controls=controls, times={"H_ns": 9})
    model: Any = SimpleNamespace(facts=facts, parameter=(), extents=())
    group, moves = tables([1] * 4, levels=[bools(1, 0, 0, 0)]), [1]
    core: Any = "core"
    with pytest.raises(RejectedError, match="not there"):
        list(estimates_and_shield.shield_inclusions(model, group, core))
    group.tops = np.array([[2, 2], [1, 0], [2, 2], [1, 2]], dtype=np.uint8)
    with pytest.raises(RejectedError, match="says which"):
        list(estimates_and_shield.shield_inclusions(model, group, core))
    group.command = 1
    found = list(estimates_and_shield.shield_inclusions(model, group, core))
    assert [what.split(" in ")[1].split("],")[0] for what, _ in found] == [
        "[-1, 1",
        "[-1, 3",
        "[1, 3",
    ]
    for _, show in found:
        list(show(LINE.all_cells))
    ends = [(c.low, c.high) for c, *_ in asked]
    assert ends == [(-1.0, 1.0), (-1.0, 3.0), (1.0, 3.0)]
    assert [claimed for _, claimed, *_ in asked] == [
        [False, True, False, True],
        [False, False, True, False],
        [False, False, True, True],
    ]
    assert controls[1] == Control("push", -1.0, 3.0)
    moves.clear()
    with pytest.raises(RejectedError, match="says which"):
        list(estimates_and_shield.shield_inclusions(model, group, core))
    group.command = None
    with pytest.raises(RejectedError, match="no command keeps K"):
        list(estimates_and_shield.shield_inclusions(model, group, core))
    group.tops[1:] = 0
    assert list(estimates_and_shield.shield_inclusions(model, group, core)) == []


# ---------------------------------------------------------------- ends


def test_an_end_is_kept_where_the_rate_points_inwards_all_over_its_side(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of drawn linear rates, whose least and greatest values are at corners."""
    draw = np.random.default_rng(9)
    for _ in range(40):
        a, (b, c, w) = draw.integers(-3, 4, 2), draw.integers(-3, 4, 3)

        def rates(box: Any, commands: Any, *, a: Any = a, given: Any = (b, c, w)) -> list[float]:
            b, c, w = given
            return [
                float(a[0] * x + a[1] * y + b * u + c + w * p)
                for x, y, u, p in itertools.product(*box, *commands, (-1, 1))
            ]

        flow = SimpleNamespace(
            derivative_rows=rates,
            rate_ranges=lambda found: [(min(found), max(found))],
            ranges=[(-1.0, 2.0)],
            compared=[False, False],
        )
        monkeypatch.setattr(sc_chains, "LocalFlow", lambda *_, flow=flow: flow)
        model: Any = SimpleNamespace(extents=[(-1.0, 1.0), (0.0, 2.0)])
        inwards = sc_chains._inward_test(model, [0, 1])
        side = [(-1.0, -1.0), (0.0, 2.0)]
        found = rates(side, flow.ranges)
        assert inwards(side, 0, 1) is (min(found) >= 0)
        assert inwards(side, 0, -1) is (max(found) <= 0)
