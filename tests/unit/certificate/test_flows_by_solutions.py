"""Enclosures of flows, and the forms of chains, against solutions and against every corner."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.grid import flow_enclosures
from soter.certificate.grid.flow_enclosures import (
    Enclosure,
    KeptEnds,
    LocalFlow,
    SolvedFlow,
    largest_row_sum,
    round_outwards,
)
from soter.certificate.reading.linear_flows import LinearFlow, exp_integrals
from soter.certificate.terms.compile_terms import compile_lines
from soter.certificate.terms.linear_enclosures import ONE, ZERO, exact
from soter.certificate.terms.straight_line import Builder, NotCertainError
from soter.certificate.terms.terms import Proposition, Terms
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Pairs = list[tuple[float, float]]

MODEL: Any = SimpleNamespace(extents=((-4.0, 4.0), (-2.0, 6.0)))


def balls(pairs: Sequence[tuple[float, float]]) -> list[tuple[Any, Any]]:
    return [(exact(a), exact(b)) for a, b in pairs]


def floats(pairs: Sequence[tuple[Any, Any]]) -> Pairs:
    return [(float(a), float(b)) for a, b in pairs]


def matrix(rows: Any) -> list[list[Any]]:
    return [[exact(float(x)) for x in row] for row in rows]


def local(
    rates: Callable[[Terms, Any, Any, Any], list[Any]],
    kept: Sequence[tuple[bool, bool]] = (),
    must: Callable[[Terms, Any], list[Proposition]] = lambda *_: [],
) -> LocalFlow:
    """A flow of two states and a command in [-1, 1], its rates as terms."""
    flow = object.__new__(LocalFlow)
    KeptEnds.__init__(flow, MODEL, (0, 1), kept)
    flow.may_branch = False
    terms = Terms()
    x, y = (terms.add_input("state", n, exact(-4.0), exact(8.0)) for n in "xy")
    u = terms.add_input("box", "u", -ONE, ONE)
    outputs = rates(terms, x, y, u)
    flow.moves, flow.domain, flow.ranges = [0], balls([(-4.0, 8.0)] * 2), balls([(-1.0, 1.0)])
    flow.written = compile_lines(terms, [0, 1, 2], 0, outputs, must(terms, x), {})
    return flow


def lag(terms: Terms, _: Any, y: Any, u: Any) -> list[Any]:
    """x' = y, y' = -2 y + 3 u + 1."""
    return [y, terms.combine(((exact(-2.0), y), (exact(3.0), u)), ONE)]


def swirl(terms: Terms, x: Any, y: Any, u: Any) -> list[Any]:
    """x' = y^2 / 8, y' = u - x y / 8."""
    square = terms.combine(((exact(0.125), terms.multiply(y, y)),))
    return [square, terms.combine(((ONE, u), (exact(-0.125), terms.multiply(x, y))))]


# ---------------------------------------------------------------- ends and boxes


@all_rows("kept", list(itertools.product((True, False), repeat=4)))
def test_a_box_is_cut_at_kept_ends_alone(kept: tuple[bool, ...]) -> None:
    ends = KeptEnds(MODEL, (1, 0), [kept[:2], kept[2:]])  # type: ignore[list-item]
    box = [(-9.0, 7.0), (-5.0, 5.0)]
    wanted = [
        (max(low, first) if a else low, min(high, last) if b else high)
        for (low, high), (first, last), (a, b) in zip(
            box, [(-2.0, 6.0), (-4.0, 4.0)], (kept[:2], kept[2:]), strict=True
        )
    ]
    assert floats(ends.clip_at_kept_ends(balls(box))) == wanted
    inside = [(-1.0, 1.0), (0.0, 2.0)]
    assert floats(ends.clip_at_kept_ends(balls(inside))) == inside
    assert floats(KeptEnds(MODEL, (1, 0), ()).clip_at_kept_ends(balls(box))) == box


def test_a_flow_is_asked_where_it_is_defined_alone() -> None:
    flow = local(
        lag, must=lambda terms, x: [terms.below_zero(terms.combine(((ONE, x),), exact(-7.0)))]
    )
    command = balls([(-1.0, 1.0)])
    for first, fine in (((-4.0, 6.5), True), ((-4.0, 7.0), False), ((-4.5, 1.0), False),
                        ((2.0, 1.0), False), ((1.0, 1.0), True)):  # fmt: skip
        for second, also in (((-4.0, 8.0), True), ((0.0, 8.5), False), ((-4.1, 0.0), False)):
            if fine and also:
                lines = flow.derivative_rows(balls([first, second]), command)
                low, high = second
                rates = [(low, high), (1 - 2 * high - 3, 1 - 2 * low + 3)]
                assert floats(flow.rate_ranges(lines)) == rates
            else:
                with pytest.raises(NotCertainError):
                    flow.derivative_rows(balls([first, second]), command)


@pytest.mark.parametrize(("start", "end"), [(0.0, 0.5), (-0.5, 0.0), (-0.25, 0.5), (0.0, 0.0)])
def test_states_move_as_far_as_rates_say(start: float, end: float) -> None:
    flow = local(lag)
    for p, q in itertools.combinations_with_replacement((-2.0, -1.0, 0.0, 0.5, 4.0), 2):
        box = [(-1.0, 1.0), (2.0, 2.0)]
        moved = flow._box_during_span(balls(box), balls([(p, q)] * 2), exact(start), exact(end))
        ways = [t * r for t in (start, 0.0, end) for r in (p, q)]
        wanted = [(low + min(ways), high + max(ways)) for low, high in box]
        assert floats(moved) == wanted
    kept = local(lag, kept=[(True, False), (False, True)])
    moved = kept._box_during_span(balls([(-4.0, 4.0)] * 2), balls([(-9.0, 9.0)] * 2), ZERO, ONE)
    assert floats(moved) == [(-4.0, 13.0), (-13.0, 6.0)]


def test_a_box_is_enlarged_by_a_tenth_and_by_a_hair() -> None:
    """Of the axis; of 1 and what the box is from 0 where that is less: axes may be endless."""
    flow = local(lag)
    box, moved = [(-1.0, 1.0), (0.0, 2.0)], [(-2.0, 4.0), (0.0, 2.0)]
    for hair in (0.0, 0.25):
        got = floats(flow._looser_box(balls(box), balls(moved), hair=exact(hair)))
        wanted = [(-1.0 - 1.1 - 3 * hair, 1.0 + 3.3 + 3 * hair), (-3 * hair, 2.0 + 3 * hair)]
        assert np.allclose(got, wanted, atol=1e-12)


@pytest.mark.parametrize("rates", [lag, swirl])
@pytest.mark.parametrize(("start", "end"), [(0, 1), (-1, 0), (-1, 2)])
def test_what_is_around_a_box_holds_what_its_own_rates_make_of_it(
    rates: Any, start: int, end: int
) -> None:
    """X + [s, t] F lies in the box, F being the rates over all of it; and hardly less would do."""
    flow, span = local(rates), (Fraction(start, 16), Fraction(end, 16))
    draw = np.random.default_rng(7)
    for _ in range(6):
        low = draw.uniform(-1.5, 1.0, 2)
        box = [(float(a), float(a + s)) for a, s in zip(low, draw.uniform(0, 1, 2), strict=True)]
        command = [(-1.0, float(draw.uniform(-1, 1)))]
        found = flow.enclose(balls(box), balls(command), *span)
        lines = flow.derivative_rows(found.box, balls(command))
        own = flow._box_during_span(
            balls(box), flow.rate_ranges(lines), exact(span[0]), exact(span[1])
        )
        for (a, b), (c, d), (e, f) in zip(found.box, own, box, strict=True):
            assert a <= c <= e
            assert f <= d <= b
            assert float(b - a) - (f - e) < 1.35 * (float(d - c) - (f - e)) + 1e-9
        for (least, most), (p, q) in zip(found.rates, flow.rate_ranges(lines), strict=True):
            assert least <= p
            assert q <= most


def test_of_a_flow_that_runs_away_nothing_is_around_a_box() -> None:
    flow = local(lambda terms, x, y, _: [terms.multiply(x, x), y])
    with pytest.raises(NotCertainError):
        flow.enclose(balls([(1.0, 2.0), (0.0, 0.0)]), balls([(0.0, 0.0)]), Fraction(0), Fraction(1))


def test_a_box_has_to_hold_what_comes_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is larger by hairs where time runs backwards."""
    flow, looser = local(lag), LocalFlow._looser_box
    hairs: list[Any] = []

    def noted(self: LocalFlow, box: Any, moved: Any, hair: Any) -> Any:
        hairs.append(hair)
        return looser(self, box, moved, hair)

    monkeypatch.setattr(LocalFlow, "_looser_box", noted)
    box, command = balls([(0.0, 1.0), (0.0, 1.0)]), balls([(-1.0, 1.0)])
    for start in (Fraction(0), Fraction(-1, 16)):
        hairs.clear()
        flow.enclose(box, command, start, Fraction(1, 16))
        assert hairs
        assert all(hair > 0 if start < 0 else hair.is_zero() for hair in hairs)
    monkeypatch.setattr(flow_enclosures, "is_within", lambda *_: False)
    with pytest.raises(NotCertainError):
        flow.enclose(box, command, Fraction(0), Fraction(1, 1024))


def test_a_linear_model_is_that_of_the_rows_and_stands_where_nothing_moves() -> None:
    flow = local(lambda terms, x, y, u: [terms.constant(0.0), *lag(terms, x, y, u)[1:]])
    box, command = balls([(0.0, 1.0), (-1.0, 2.0)]), balls([(-1.0, 0.5)])
    found = flow.enclosure_by_rows(box, command, flow.derivative_rows(box, command))
    assert [found.has_zero_rate(i) for i in (0, 1)] == [True, False]
    assert [[float(x) for x in row] for row in found.a] == [[0.0, 0.0], [0.0, -2.0]]
    assert [[float(x) for x in row] for row in found.b] == [[0.0], [3.0]]
    assert [float(x) for x in found.constant] == [0.0, 1.0]
    assert [float(x) for x in found.noise] == [0.0, 0.0]
    other = found.others[1]
    assert float(other.lower()) == pytest.approx(-2.0)
    assert float(other.upper()) == pytest.approx(2.5)
    for rates in ([(ZERO, ONE)], [(-ONE, ZERO)], [(ZERO, Builder().input_at(0))]):
        assert not Enclosure([], [], [], [], [], rates, []).has_zero_rate(0)
    lines = [exact(x) for x in (1.0, 2.0, 3.0, 0.5, 0.25, 0.0, 0.0, *[1.0] * 5, -1.0, 0.0)]
    made = flow.enclosure_by_rows(box, command, lines)
    assert [float(x) for x in (*made.a[0], *made.b[0], made.constant[0], made.noise[0])] == [
        0.0
    ] * 5
    assert [float(x) for x in (*made.a[1], *made.b[1], made.constant[1], made.noise[1])] == [
        1.0
    ] * 5
    assert floats(made.rates) == [(0.0, 0.0), (-1.0, 0.0)]
    # of a model that is not linear: noise, and a state of which its own rate is told apart
    bent = local(swirl)
    found = bent.enclosure_by_rows(box, command, bent.derivative_rows(box, command))
    draw = np.random.default_rng(2)
    for _ in range(50):
        x, y, u = (float(draw.uniform(a, b)) for a, b in ((0, 1), (-1, 2), (-1, 0.5)))
        truth = (y * y / 8, u - x * y / 8)
        for i, rate in enumerate(truth):
            row = [float(v) for v in (*found.a[i], *found.b[i])]
            off = rate - np.dot(row, (x, y, u)) - float(found.constant[i])
            assert abs(off) <= float(found.noise[i]) + 1e-12
            rest = exact(rate) - found.a[i][i] * exact((x, y)[i])
            assert not rest < found.others[i].lower() - 1e-12
            assert not rest > found.others[i].upper() + 1e-12


def test_where_states_are_in_the_end_is_known_twice() -> None:
    flow = local(lag, kept=[(True, True), (False, False)])
    around: Any = SimpleNamespace(box=balls([(-9.0, 1.0), (0.0, 3.0)]))
    ended = flow.end_ranges(balls([(-5.0, 2.0), (1.0, 2.5)]), around)
    assert floats(ended) == [(-4.0, 1.0), (1.0, 2.5)]
    ended = flow.end_ranges(balls([(-3.0, 0.5), (-1.0, 4.0)]), around)
    assert floats(ended) == [(-3.0, 0.5), (0.0, 3.0)]


@pytest.mark.parametrize(("rate", "span", "count"), [(1.0, 1.0, 1), (0.0, 1.0, 1), (2.4, 1.0, 2),
                                                     (3.0, 1.0, 3), (1e6, 1.0, 64)])  # fmt: skip
def test_into_how_many_steps_a_span_is_cut(rate: float, span: float, count: int) -> None:
    flow = local(lambda terms, x, _, u: [terms.combine(((exact(rate), x),)), u])
    flow.grid = balls([(-4.0, 4.0), (-2.0, 6.0)])
    assert flow.least_step_count(Fraction(span)) in (count, count + (rate == 2.4))
    flow.grid = balls([(-4.0, 9.0), (-2.0, 6.0)])
    assert flow.least_step_count(Fraction(span)) == 2


def test_outwards_is_without_a_radius_and_holds_both_ends() -> None:
    low, high = round_outwards(exact(Fraction(1, 3)), exact(Fraction(2, 3)))
    assert low.rad().is_zero()
    assert high.rad().is_zero()
    assert not low > exact(Fraction(1, 3))
    assert not high < exact(Fraction(2, 3))
    assert abs(high - low - exact(Fraction(1, 3))) < 1e-30
    assert largest_row_sum(matrix([[1, -2], [-4, 0.5]])) == 4.5
    assert flow_enclosures.is_within(balls([(0, 1)] * 2), balls([(0, 1), (-1, 1)]))
    for box in ([(-0.1, 1), (0, 1)], [(0, 1.1), (0, 1)], [(0, 1), (-1.1, 1)], [(0, 1), (0, 1.1)]):
        assert not flow_enclosures.is_within(balls(box), balls([(0, 1), (-1, 1)]))


# ---------------------------------------------------------------- solutions

MATRICES = [
    [[0, 1], [0, 0]],
    [[-2, 0], [0, 3]],
    [[0, -3], [3, 0]],
    [[-1, 2], [0.5, -4]],
    [[0, 0], [0, 0]],
]


def integral_at(a: Any, time: float) -> Any:
    """That of e^{As}, by its series."""
    term = np.eye(len(a)) * time
    whole = term.copy()
    for k in range(2, 60):
        term = term @ np.asarray(a, dtype=float) * time / k
        whole += term
    return whole


@pytest.mark.parametrize("a", MATRICES)
def test_integrals_of_exponentials(a: Any) -> None:
    flow = local(lag)
    enclosure: Any = SimpleNamespace(
        a=matrix(a), b=matrix([[1], [-2]]), constant=matrix([[3, 4]])[0]
    )
    theta = max(sum(map(abs, row)) for row in a)
    for time in (Fraction(1, 16), Fraction(1, 4), Fraction(1)):
        whole = integral_at(a, float(time))
        for i, row in enumerate(exp_integrals(enclosure.a, time, time)):
            for x, wanted in zip(row, whole[i], strict=True):
                assert not abs(x - exact(float(wanted))) > 1e-12
                assert float(x.rad()) < 1e-30
        law = flow.solution_over(enclosure, time)
        state = np.eye(2) + np.asarray(a) @ whole
        for i in range(2):
            for got, wanted in zip(
                (*law.state[i], *law.control[i], law.constant[i]),
                (*state[i], (whole @ [1, -2])[i], (whole @ [3, 4])[i]),
                strict=True,
            ):
                assert not abs(got - exact(float(wanted))) > 1e-9
                assert float(got.rad()) < 1e-2
    for start, end in ((0, 1), (-1, 0), (-1, 2), (1, 2), (-2, -1)):
        span = Fraction(start, 20), Fraction(end, 20)
        got = flow.exp_integral(enclosure, *span)
        far = max(map(abs, span))
        for t in np.linspace(float(span[0]), float(span[1]), 9):
            wanted = integral_at(a, float(t))
            for i, j in itertools.product(range(2), range(2)):
                off = got[i][j] - exact(float(wanted[i][j]))
                assert not off > 1e-13
                assert not off < -1e-13
        least = 0.0 if start <= 0 <= end else float(min(map(abs, span)))
        rest = theta**2 * float(far) ** 3 / 6 * math.exp(theta * float(far))
        for i, j in itertools.product(range(2), range(2)):
            wanted = abs(a[i][j]) * (float(far) ** 2 - least**2) / 2
            wanted += float(span[1] - span[0]) if i == j else 0.0
            wanted += 2 * rest if any(a[i]) else 0.0
            assert float(got[i][j].upper() - got[i][j].lower()) < wanted * 1.0001 + 1e-9


@all_rows("a", MATRICES)
@all_rows(("start", "end"), [(0, 1), (-1, 0), (-1, 2), (-2, 1)])
def test_noise_is_what_the_greatest_rates_make_of_it(a: Any, start: int, end: int) -> None:
    """M: |a_ij| off the diagonal; on it a_ii forwards, -a_ii backwards, |a_ii| both ways."""
    flow = local(lag)
    enclosure: Any = SimpleNamespace(
        a=matrix(a), b=matrix([[2], [-1]]), noise=[exact(0.5), exact(0.25)]
    )
    span, sizes = (Fraction(start, 8), Fraction(end, 8)), np.array([0.5 + 2 * 0.75, 0.25 + 0.75])
    major = np.abs(np.asarray(a, dtype=float))
    for i in range(2):
        major[i, i] = a[i][i] if start >= 0 else -a[i][i] if end <= 0 else abs(a[i][i])
    wanted = integral_at(major, max(abs(start), end) / 8) @ sizes
    got = flow.noise_bounds(enclosure, *span, [exact(0.75)])
    assert [float(x.mid()) for x in got] == pytest.approx(list(wanted), rel=1e-9, abs=1e-12)
    plain = flow.noise_bounds(enclosure, *span, [])
    without = integral_at(major, max(abs(start), end) / 8) @ [0.5, 0.25]
    assert [float(x.mid()) for x in plain] == pytest.approx(list(without), rel=1e-9, abs=1e-12)


def solved(kept: Sequence[tuple[bool, bool]] = ()) -> SolvedFlow:
    """x' = -x + 2 u + 1/2 + w, y' = 0 and a control that nothing feels; |w| <= 1/4."""
    rows = {"a": [[-1, 0], [0, 0]], "b": [[0, 2], [0, 0]], "noise": [[0.25], [0]]}
    flow = LinearFlow(
        (0, 1),
        matrix(rows["a"]),
        matrix(rows["b"]),
        [exact(0.5), ZERO],
        matrix(rows["noise"]),
        tuple(balls([(-7.0, 7.0), (-1.0, 3.0)])),
    )
    return SolvedFlow(MODEL, (0, 1), flow, kept)


def test_a_linear_flow_has_the_controls_that_it_feels() -> None:
    flow = solved()
    assert flow.moves == [1]
    assert floats(flow.ranges) == [(-1.0, 3.0)]
    assert [float(x) for x in flow.disturbed] == [0.25, 0.0]
    assert flow.least_step_count(Fraction(5)) == 1
    assert (SolvedFlow.apart, LocalFlow.apart) == (True, False)
    law = flow.solution_over(None, Fraction(1, 2))  # type: ignore[arg-type]
    decay = math.exp(-0.5)
    assert float(law.state[0][0]) == pytest.approx(decay)
    assert float(law.control[0][0]) == pytest.approx(2 * (1 - decay))
    assert float(law.constant[0]) == pytest.approx(0.5 * (1 - decay))
    assert float(law.state[1][1]) == 1.0
    kept = solved([(True, True), (False, False)])
    assert floats(kept.end_ranges(balls([(-9.0, 9.0)] * 2), None)) == [(-4.0, 4.0), (-9.0, 9.0)]  # type: ignore[arg-type]


@pytest.mark.parametrize(("start", "end"), [(0, 2), (-2, 0), (-1, 2)])
def test_a_linear_flow_is_around_its_solutions_and_little_else(start: int, end: int) -> None:
    flow, span = solved(), (Fraction(start, 4), Fraction(end, 4))
    box, commands = [(-0.5, 1.0), (2.0, 3.0)], [(-1.0, 2.0)]
    found = flow.enclose(balls(box), balls(commands), *span)
    values = []
    for t in np.linspace(float(span[0]), float(span[1]), 17):
        decay = math.exp(-t)
        for x, u, w in itertools.product(box[0], commands[0], (-0.25, 0.25)):
            values.append(x * decay + (2 * u + 0.5 + w) * (1 - decay))
    low, high = float(found.box[0][0].lower()), float(found.box[0][1].upper())
    assert low <= min(values) + 1e-12
    assert max(values) - 1e-12 <= high
    width = max(values) - min(values)
    assert high - low < width * 1.8
    assert [float(x) for x in (found.box[1][0], found.box[1][1])] == [2.0, 3.0]
    assert found.has_zero_rate(1)
    assert not found.has_zero_rate(0)
    rest = found.others[0]
    assert float(rest.lower()) == pytest.approx(-2.0 + 0.5 - 0.25, abs=1e-6)
    assert float(rest.upper()) == pytest.approx(4.0 + 0.5 + 0.25, abs=1e-6)
    rate = found.rates[0][0]
    assert float(rate.lower()) == pytest.approx(-high - 1.75, abs=1e-6)
    assert float(rate.upper()) == pytest.approx(-low + 4.75, abs=1e-6)
    (noise, still) = flow.noise_bounds(None, *span, [exact(1.5)])
    far = [abs(1 - math.exp(-float(t))) for t in span]
    assert float(noise) == pytest.approx(max(far) * (0.25 + 2 * 1.5), rel=0.05)
    assert float(noise) >= max(far) * 3.25 - 1e-9
    assert still == 0
    risen = flow.enclose(balls(box), balls([(2.0, 2.0)]), *span).box[0]
    for t in span:
        decay = math.exp(-t)
        for x, w in itertools.product(box[0], (-0.25, 0.25)):
            at = x * decay + (4.5 + w) * (1 - decay)
            assert float(risen[0].lower()) <= at + 1e-12
            assert at - 1e-12 <= float(risen[1].upper())
    cut = solved([(True, True), (True, True)]).enclose(
        balls([(3.9, 4.0), (5.0, 6.0)]), balls([(3.0, 3.0)]), *span
    )
    assert float(cut.box[0][1].upper()) == pytest.approx(4.0)
