"""Single functions of the re-checker's core at the values at which they begin to say else."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from flint import arb

from soter.certificate import cell_predicates
from soter.certificate.cell_sets import Cells, Grid, holds_in_parts
from soter.certificate.extras import prelude_functions
from soter.certificate.extras.estimates_and_shield import axes_seen_by_dm
from soter.certificate.grid.flow_enclosures import LocalFlow
from soter.certificate.grid.group_claims import ChainCheck, GroupTables
from soter.certificate.reading.case_model import FARTHEST
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import (
    FUNCTIONS,
    ONE,
    exact,
    line_noisy_max0,
    line_or_range,
    lower,
    upper,
)
from soter.certificate.terms.straight_line import growth_bound
from soter.certificate.terms.terms import Terms
from tables import all_rows
from unit.certificate.grid_tables import grid_beyond
from unit.certificate.test_single_refusals import facts_of

if TYPE_CHECKING:
    from pathlib import Path

# ---------------------------------------------------------------- numbers

UNIVARIATE = {**FUNCTIONS, **prelude_functions.FUNCTIONS}
del UNIVARIATE["atan2"], UNIVARIATE["pow"]


def test_a_bound_in_doubles_is_the_nearest_one() -> None:
    for number in (Fraction(k, d) for k in range(-9, 10) for d in (1, 3, 7, 10)):
        low, high = lower(exact(number)), upper(exact(number))
        assert Fraction(low) <= number <= Fraction(high)
        assert high <= math.nextafter(low, math.inf)


def test_of_what_nothing_bounds_no_double_is_a_bound() -> None:
    for x in (arb("nan"), arb("inf"), arb(0, math.inf), exact(1.5) * exact(2.0) ** 1100):
        assert upper(x) == math.inf


@all_rows("name", sorted(UNIVARIATE))
def test_a_line_over_a_short_interval_says_nearly_all(name: str) -> None:
    for low in (0.25, 0.6, 1.2, 2.9):
        slope, offset, spread, least, most = UNIVARIATE[name](exact(low), exact(low + 1e-3))
        assert spread < 1e-4
        assert most - least < 0.02
        assert abs(slope * exact(low) + offset - (least + most) / 2) < 0.02


def test_a_kink_has_the_best_line() -> None:
    """Between the chord and the parallel through the kink: half of their distance."""
    for low, high in itertools.product((-3.0, -1.0, -0.25), (0.5, 1.0, 6.0)):
        best = -low * high / (2 * (high - low))
        assert abs(UNIVARIATE["max0"](exact(low), exact(high))[2] - best) < 1e-15
        for noise in (0.0, 0.125):
            first, last = max(low + noise, 0.0), max(high + noise, 0.0)
            slope = (last - first) / (high - low)
            over = first - slope * low
            under = -slope * min(max(noise, low), high)
            line = line_noisy_max0(exact(low), exact(high), exact(noise))
            assert abs(line[3] + line[1] * noise - (over - under) / 2) < 1e-15


def test_a_line_between_ends_that_are_balls_encloses() -> None:
    draw = np.random.default_rng(17)
    for _ in range(300):
        middle, size = draw.uniform(-2, 2), draw.uniform(0.1, 1.5)
        low, high = arb(middle, 0.4), arb(middle + size, 0.4)
        noise = exact(float(draw.uniform(0, 0.5)))
        slope, *kink = UNIVARIATE["max0"](low, high)
        lines: list[Any] = [(line_noisy_max0(low, high, noise), noise), ((slope, 0, *kink), 0)]
        for (slope, kept, offset, spread, *_), n in lines:
            for x, sign in itertools.product((low.lower(), high.upper(), noise), (-1, 0, 1)):
                if low.lower() <= x <= high.upper():
                    off = (x + sign * n).max(arb(0)) - slope * x - kept * sign * n - offset
                    assert not abs(off) > spread + 1e-15


def test_of_a_line_and_a_range_that_are_as_wide_the_line_is_kept() -> None:
    """It remembers what it comes of."""
    assert line_or_range(exact(0.0), exact(1.0), exact(-1.0), exact(1.0))[0] == 1


def test_growth_at_a_rate_that_is_a_ball_is_that_of_the_greatest() -> None:
    for own, most in ((arb(2, 0.5), 2.5), (arb(-2, 0.5), -1.5)):
        assert growth_bound(own, exact(1.0)) >= math.expm1(most) / most


@pytest.mark.parametrize("rate", [-2.0, 0.5, 2.0])
@pytest.mark.parametrize(("start", "end"), [(0, 1), (-1, 0), (-1, 1)])
def test_noise_adds_what_the_flow_makes_of_it_in_that_direction(
    rate: float, start: int, end: int
) -> None:
    enclosure: Any = SimpleNamespace(a=[[exact(rate)]], b=[[exact(3.0)]], noise=[exact(1.0)])
    of: Any = LocalFlow.noise_bounds
    (bound,) = of(None, enclosure, Fraction(start), Fraction(end), [exact(0.5)])
    most = max(abs(math.expm1(rate * t) / rate) for t in (start, end)) * 2.5
    assert abs(float(bound.upper()) - most) < 1e-9 * most


# ---------------------------------------------------------------- cells


def test_a_box_is_halved_as_often_as_is_allowed() -> None:
    for splits in range(5):
        seen: list[float] = []

        def attempt(box: Any, seen: list[float] = seen) -> bool:
            width = float((box[0][1] - box[0][0]) * (box[1][1] - box[1][0]))
            seen.append(width)
            return width <= 1 / 8

        square = [(exact(0.0), exact(1.0))] * 2
        assert holds_in_parts(square, attempt, splits) is (splits >= 3)
        assert min(seen) == 2.0 ** -min(splits, 3)


def test_a_box_on_an_edge_has_cells_on_its_inner_side() -> None:
    grid = Grid(((0.0, 1.0, 2.0, 3.0),))
    for box, cells in {
        (0.0, 0.0): (0, 1),
        (3.0, 3.0): (2, 3),
        (1.0, 2.0): (1, 2),
        (0.5, 2.5): (0, 3),
        (0.0, 3.0): (0, 3),
    }.items():
        assert grid.cells_around(box) == (cells,)
    for outside in ((-0.1, 1.0), (2.0, 3.1), (math.nan, 1.0), (1.0, math.nan)):
        assert grid.cells_around(outside) is None
    ends = grid_beyond(grid.edges, (True,))
    for box, cells in {(-1.0, -0.5): (0, 1), (4.0, 5.0): (2, 3), (-1.0, 5.0): (0, 3)}.items():
        assert ends.cells_around(box) == (cells,)
    assert ends.cells_around((-3.5, 1.0)) is None


@pytest.mark.parametrize("outside", [None, 0, 1, 2, "unknown"])
def test_a_run_that_may_leave_the_set_on_its_way_reaches_nothing(outside: int | str | None) -> None:
    cells = Cells(Grid(((0.0, 1.0, 2.0, 3.0),)), np.array([True, True, False]))
    done: list[int] = []

    def step(form: Any) -> Any:
        done.append(len(done))
        if outside == "unknown":
            return None
        return form, [0.25, 2.5] if done[-1] == outside else [0.25, 1.75]

    chain = SimpleNamespace(first=step, later=step, last=None)
    check: Any = SimpleNamespace(
        compiled_chain=lambda *_: chain,
        group=SimpleNamespace(states=(0,)),
        _parts=lambda form: [form],
    )
    check._boxes_at_switch = lambda *of: ChainCheck._boxes_at_switch(check, *of)
    box = [(exact(0.5), exact(0.75))]
    found = [n for n, _ in ChainCheck.follow(check, box, [1, 2, 3], cells, 1)]
    until = outside if isinstance(outside, int) else 3 if outside is None else 0
    assert found == [1, 2, 3][:until]


def test_a_start_beyond_an_end_is_moved_in_and_any_other_is_not() -> None:
    grid = grid_beyond(((0.0, 1.0, 2.0), (0.0, 1.0, 2.0)), (True, False))
    for (low, high), moved in {
        (0.5, 1.5): (0.5, 1.5),
        (-4.0, 1.5): (0.0, 1.5),
        (0.5, 9.0): (0.5, 2.0),
        (-4.0, -3.0): (0.0, 0.0),
        (7.0, 9.0): (2.0, 2.0),
    }.items():
        assert [grid.move_onto_axis(k, low, high) for k in (0, 1)] == [moved, (low, high)]


def test_what_holds_on_the_grid_alone_does_not_hold_beyond_its_open_end() -> None:
    model: Any = SimpleNamespace(extents=((-2.0, 2.0),))
    for unbounded, members in (((False,), [True] * 4), ((True,), [False, True, True, True])):
        terms = Terms()
        x = terms.add_input("state", "x", -FARTHEST, FARTHEST)
        inside = terms.below_zero(terms.combine(((-ONE, x),), exact(-5.0)))
        grid = grid_beyond(((-2.0, -1.0, 0.0, 1.0, 2.0),), unbounded)
        decision = cell_predicates.TruthOverBox(model, (0,), terms, [0], inside)
        found = cell_predicates.cells_where_certain(decision, grid)
        assert found.members.tolist() == members


def test_a_state_that_the_dm_does_not_see_has_one_cell(tmp_path: Path) -> None:
    facts = facts_of(tmp_path)
    del facts.leaves[1]
    every = tuple(k / 4 for k in range(5))

    def group(*edges: tuple[float, ...]) -> GroupTables:
        grid = Grid(edges)
        return GroupTables((0, 1), grid, np.ones(grid.shape, np.uint8))

    assert axes_seen_by_dm(facts, group(every, (0.0, 1.0))) == [0]
    with pytest.raises(NotRecheckedError, match=r"no topic shows `q.q`.* write `/ 1`"):
        axes_seen_by_dm(facts, group(every, (0.0, 0.5, 1.0)))
