"""Forms of chains, rows and spans of time, against matrices and every corner."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.grid.chain_form_layout import (
    CommandRows,
    FormLayout,
    StateRows,
    absolute_sum,
    interval_hull,
)
from soter.certificate.grid.flow_chains import (
    DEPTH_MAX,
    FlowChain,
    Times,
    _greatest_gap,
    _recentre_row,
)
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import exact
from soter.certificate.terms.straight_line import (
    Builder,
    bound_of_dot,
    dot,
    plus_scaled,
    product,
    side_by_side,
    times_column,
    total,
    unit_rows,
)
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

    Pairs = list[tuple[float, float]]

MODEL: Any = SimpleNamespace(extents=((-4.0, 4.0), (-2.0, 6.0)))


def balls(pairs: Sequence[tuple[float, float]]) -> list[tuple[Any, Any]]:
    return [(exact(a), exact(b)) for a, b in pairs]


def floats(pairs: Sequence[tuple[Any, Any]]) -> Pairs:
    return [(float(a), float(b)) for a, b in pairs]


def matrix(rows: Any) -> list[list[Any]]:
    return [[exact(float(x)) for x in row] for row in rows]


def test_rows_are_matrices() -> None:
    draw = np.random.default_rng(1)
    a, b = draw.integers(-4, 5, (2, 3)), draw.integers(-4, 5, (3, 2))
    make = Builder()

    def numbers(rows: Any) -> Any:
        return [[float(getattr(x, "content", x)) for x in row] for row in rows]

    values = [[make.constant(x) for x in row] for row in matrix(a)]
    mixed = [list(row) for row in matrix(b)]
    mixed[2][1] = make.constant(mixed[2][1])
    for left, right in ((matrix(a), matrix(b)), (values, matrix(b)), (matrix(a), mixed)):
        assert (np.array(numbers(product(left, right))) == a @ b).all()
    assert (np.array(numbers([times_column(matrix(a), matrix(b.T)[0])])) == (a @ b[:, 0])).all()
    assert (np.array(numbers(plus_scaled(matrix(a), matrix(b.T)))) == a + b.T).all()
    assert (
        np.array(numbers(plus_scaled(matrix(a), matrix(b.T), exact(-2.0)))) == a - 2 * b.T
    ).all()
    assert numbers(side_by_side(matrix(a), matrix(b.T))) == np.hstack([a, b.T]).tolist()
    assert numbers(unit_rows(2)) == np.eye(2).tolist()
    assert numbers(unit_rows(2, width=4, first=1)) == np.eye(4)[1:3].tolist()
    assert float(dot(matrix(a)[0], matrix(a)[1])) == a[0] @ a[1]
    assert float(total(matrix(a)[0])) == a[0].sum()
    assert float(bound_of_dot(matrix(a)[0], matrix(abs(a))[1])) == abs(a[0]) @ abs(a[1])
    assert bound_of_dot(matrix(a)[0], []) == 0
    assert float(absolute_sum(matrix(a)[0])) == abs(a[0]).sum()
    assert floats([interval_hull(balls([(0.0, 1.0), (-2.0, 0.5), (-1.0, 3.0)]))]) == [(-2.0, 3.0)]
    assert floats([interval_hull(balls([(0.0, 1.0)]))]) == [(0.0, 1.0)]
    for one, other, gap in (
        ((0, 1), (3, 5), 5),
        ((3, 5), (0, 1), 5),
        ((0, 4), (1, 2), 3),
        ((2, 2), (2, 2), 0),
    ):
        assert float(_greatest_gap(*balls([one, other]))) == gap


# ---------------------------------------------------------------- forms


@pytest.mark.parametrize(("q", "depth"), [(1, 0), (1, 1), (1, 2), (2, 1)])
def test_a_form_is_opened_and_closed_with_all_that_is_in_it(q: int, depth: int) -> None:
    """Every corner of an opened form, a random motion of it, and rests that are reached."""
    n, draw = 2, np.random.default_rng(q + 5 * depth)
    layout, count, memories = FormLayout(n, q, depth), n + q * depth, q * depth
    assert layout.form_length(fresh=True) == (4 + n) * n
    assert layout.form_length(fresh=False) == (4 + n) * count + n * memories
    centre, symbols = draw.uniform(-1, 1, count), draw.uniform(-1, 1, (count, n))
    rests, common = draw.uniform(0.1, 1, count), draw.uniform(-1, 1, (memories, n))
    ranges = [(float(-k - 1), float(k + 1)) for k in range(count)]
    flat = [*(x for r in ranges for x in r), *centre, *symbols.reshape(-1), *rests]
    form = tuple(exact(float(x)) for x in (*flat, *common.reshape(-1)))
    start = layout.take_apart(form, None)
    assert floats(start.ranges) == ranges
    width = 1 + n + count + q

    def at(generators: Any) -> Any:
        """States, old commands, new unknowns and 1 where symbols and betas are these."""
        z = np.array([[float(x) for x in row] for row in start.z])
        return z @ [1.0, *generators]

    corners = [np.array(c) for c in itertools.product((-1.0, 1.0), repeat=width - 1)]
    for corner in corners[:: max(1, len(corners) // 32)]:
        eps, beta = corner[:n], corner[n : n + count]
        known = centre + symbols @ eps + rests * beta
        known[n:] += common @ (rests[:n] * beta[:n])
        assert at(corner) == pytest.approx([*known, *[0.0] * q, 1.0])
    for k in range(q):  # what the commands that answer are off
        start.z[count + k][-q + k] = exact(0.25 + k)
    rows, rest = draw.uniform(-1, 1, (n, count + q + 1)), draw.uniform(0, 0.5, n)
    rows[:, :n] = np.eye(n) + 0.1 * rows[:, :n]
    answers = draw.uniform(-1, 1, (q, count + q + 1))
    box = balls([(-10.0, 10.0), (-20.0, 20.0)])
    way = StateRows(matrix(rows), [exact(float(x)) for x in rest], box)
    new = CommandRows(matrix(answers), balls([(-30.0 - k, 30.0) for k in range(q)]))
    after = layout.put_together(start, way, new)
    assert len(after) == layout.form_length(fresh=False)
    made = np.array([float(x) for x in after])
    wanted_ranges = [*floats(box), *(floats(new.ranges) if depth else [])]
    wanted_ranges += ranges[n : n + q * (depth - 1)] if depth else []
    assert made[: 2 * count].reshape(-1, 2).tolist() == [list(r) for r in wanted_ranges]
    m, g = made[2 * count : 3 * count], made[3 * count : (3 + n) * count].reshape(count, n)
    b = made[(3 + n) * count : (4 + n) * count]
    a = made[(4 + n) * count :].reshape(memories, n)
    most = np.zeros(count)
    for corner in corners:
        z = at(corner)
        for noise in itertools.product((-1.0, 1.0), repeat=n):
            states = rows @ z + rest * noise
            commands = [*(answers @ z), *z[n : n + q * (depth - 1)]] if depth else []
            own = states - m[:n] - g[:n] @ corner[:n]
            off = np.abs(np.concatenate([own, commands - m[n:] - g[n:] @ corner[:n] - a @ own]))
            most = np.maximum(most, off)
    assert most == pytest.approx(b, rel=1e-9)
    near = np.linalg.norm(a[:q]) if depth else 0.0
    assert near < 10


@all_rows(("d", "early", "late"), [(0, 0, 0), (5, 0, 0), (10, 0, 0), (0, 2, 3),
                                                  (10, 1, 0), (17, 4, 2)])  # fmt: skip
@all_rows("felt", [True, False])
def test_how_many_commands_a_form_carries(d: int, early: int, late: int, felt: bool) -> None:
    flow: Any = SimpleNamespace(
        moves=[0] if felt else [], least_step_count=lambda _: 1, ranges=[], apart=True
    )
    given = Times(Fraction(10), Fraction(d), Fraction(early), Fraction(late))
    chain = FlowChain(MODEL, (0, 1), flow, given)
    reach = d + early + late if felt else 0
    assert chain.depth == math.ceil(reach / 10)
    assert [float(x) for x in chain.behind] == [
        max(0.0, reach - 10 * k) for k in range(1, chain.depth + 1)
    ]
    assert chain.span == (early + late if felt else 0)
    early_, span = (early, early + late) if felt else (0, 0)
    for apart, count, fresh in itertools.product((True, False), (1, 3), (True, False)):
        flow.apart = apart
        spans = chain.spans(count, fresh=fresh)
        whole = 10 - early_ if fresh else 10
        handed = 0 if fresh else span
        assert sum(length for length, _ in spans) == whole
        assert all(length > 0 for length, _ in spans)
        assert [old for _, old in spans] == [handed, *[0] * (len(spans) - 1)]
        if count == 1 and not apart:
            assert spans == [(whole, handed)]  # type: ignore[comparison-overlap]
        else:
            assert len(spans) == count + (handed > 0)
            assert not handed or spans[0][0] == handed
            assert len({length for length, old in spans if not old}) == 1


def test_a_form_carries_so_many_commands_and_no_more() -> None:
    flow: Any = SimpleNamespace(moves=[0], least_step_count=lambda _: 1, ranges=[])
    for over, fine in ((0, True), (1, False)):
        given = Times(Fraction(1), Fraction(DEPTH_MAX) + Fraction(over, 10))
        if fine:
            assert FlowChain(MODEL, (0, 1), flow, given).depth == DEPTH_MAX
        else:
            with pytest.raises(NotRecheckedError, match="older"):
                FlowChain(MODEL, (0, 1), flow, given)


def test_a_row_is_moved_to_the_middle_of_what_its_number_may_be_off_it() -> None:
    """For all points: the number is off its row by `spread` at most, and lies in an interval."""
    dice = np.random.default_rng(41)
    for _ in range(60):
        gain, constant, middle, reach = dice.uniform(-2, 2, 4)
        spread, (low, high) = float(dice.uniform(0, 2)), sorted(map(float, dice.uniform(-6, 6, 2)))
        z = [[exact(float(middle)), exact(float(reach))], [exact(1.0), exact(0.0)]]
        row = [exact(float(gain)), exact(float(constant))]
        ends = exact(low), exact(high)
        left = float(_recentre_row(row, exact(spread), ends, z))
        at, far = gain * middle + constant, abs(gain * reach)
        first, last = max(-spread, low - at - far), min(spread, high - at + far)
        assert left == pytest.approx(abs(last - first) / 2)
        assert float(row[1]) == pytest.approx(constant + (first + last) / 2)
        for unknown, off in itertools.product(
            np.linspace(-1, 1, 5), np.linspace(-spread, spread, 9)
        ):
            number = at + gain * reach * unknown + off
            if low <= number <= high:
                new = float(row[0]) * (middle + reach * unknown) + float(row[1])
                assert abs(number - new) <= left + 1e-12
