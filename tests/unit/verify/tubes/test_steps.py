"""The functions of `tube.soter` and `check.soter`, and what is printed of random modules: whatever
one of the runs that their forms stand for does, they hold it.
"""

from __future__ import annotations

import random
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import mpmath
import pytest

from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.tube_precision import FINE, PRECISIONS
from unit.verify.tubes.random_plants import TIMES, drawn_subjects, source_of
from unit.verify.tubes.soter_forms import Library, down, drawn, eps_of, off_by, up

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from unit.verify.tubes.random_plants import DrawnModule, Subject

MODULES = 5
BOXES = 8
PARTS = 12


@pytest.fixture(scope="module")
def subjects(tmp_path_factory: pytest.TempPathFactory) -> tuple[Library, list[Subject]]:
    return drawn_subjects(tmp_path_factory.mktemp("steps"), MODULES, bent=False)


@pytest.fixture(scope="module")
def bent_subjects(tmp_path_factory: pytest.TempPathFactory) -> tuple[Library, list[Subject]]:
    return drawn_subjects(tmp_path_factory.mktemp("bent"), MODULES, bent=True)


@pytest.fixture(scope="module", params=[False, True])
def fine_subjects(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Library, list[Subject]]:
    folder = tmp_path_factory.mktemp("fine")
    return drawn_subjects(folder, MODULES, bent=request.param, precision=FINE)


def each(subjects: tuple[Library, list[Subject]], seed: str) -> Any:
    """Every module with a generator of its own."""
    library, found = subjects
    for s in found:
        yield library, s, s.module, random.Random(f"{seed} {s.name}")  # noqa: S311


def rows_at(**parts: Sequence[Sequence[float]]) -> Callable[[int], list[list[float]]]:
    """Forms of `tried`: x from 0, v from 10, u from 20, other from 30."""

    def made(symbols: int) -> list[list[float]]:
        rows = [[0.0] * (symbols + 4) for _ in range(40)]
        for name, start in (("x", 0), ("v", 10), ("u", 20), ("other", 30)):
            for i, row in enumerate(parts.get(name, ())):
                rows[start + i] = list(row)
        return rows

    return made


def some(
    rng: random.Random, eps: list[list[Fraction]], count: int, size: float, used: int
) -> list[Any]:
    """Forms over the first symbols, of a size that a tube has."""
    forms = [drawn(rng, eps, size, -3.0, 3.0) for _ in range(count)]
    if rng.random() < 0.5:  # all but known, so that every term counts
        for f in forms:
            v = f.values[0]
            f.row[:] = [float(v), up(abs(v - Fraction(float(v)))), down(v), up(v)]
            f.row += [0.0] * len(eps[0])
    for f in forms:
        for k in range(used, len(eps[0])):
            moved = abs(f.row[4 + k])
            f.row[4 + k] = 0.0
            f.row[1] = up(Fraction(f.row[1]) + Fraction(moved))
    return forms


SAFE = Fraction(2) ** -150
ENDLESS = float("inf")


def test_flows_hold_every_run(subjects: tuple[Library, list[Subject]]) -> None:
    flows_hold(subjects)


def test_flows_hold_every_run_of_rates_that_commands_and_disturbances_bend(
    bent_subjects: tuple[Library, list[Subject]],
) -> None:
    flows_hold(bent_subjects)


def test_flows_of_a_higher_order_hold_every_run(
    fine_subjects: tuple[Library, list[Subject]],
) -> None:
    flows_hold(fine_subjects, 0.2)


def flows_hold(subjects: tuple[Library, list[Subject]], longest: float = 0.05) -> None:
    """Commands and disturbances at their ends, switching whenever they like, are in each form.

    Runge and Kutta's steps of h / 36 are off by their fifth power and by rounding, 1e-10 in all;
    over a kink by their square times what the slope jumps by: 1e-4 h.
    """
    judged = 0
    for library, s, module, rng in each(subjects, "flow"):
        n, m = module.states, module.controls
        for _ in range(BOXES):
            eps = [eps_of(rng, s.symbols)]
            x = some(rng, eps, n, rng.choice((1.0, 0.1)), n)
            u = some(rng, eps, m, 1.0, n)
            h = rng.choice((0.002, 0.02, longest))
            wide = [module.disturbed, *[rng.choice((0.0, 0.5)) for _ in range(m)]]
            forms = rows_at(x=[f.row for f in x], u=[f.row for f in u])(s.symbols)
            got = library.call(s.name, 0, forms, [h, *wide])
            beyond = any(abs(f.values[0]) + w > 2 for f, w in zip(u, wide[1:], strict=True))
            if got is None or got[30][0] == 0.0 or beyond:  # no command is beyond its set
                continue
            judged += 1
            for _ in range(3):
                sides = [[rng.choice((-1, 1)) for _ in wide] for _ in range(PARTS)]
                if rng.random() < 0.5:
                    sides = [sides[0]] * PARTS
                at = [float(f.values[0]) for f in x]
                command = [float(f.values[0]) for f in u]
                off = max(
                    _followed(module, got, eps[0], at, command, wide, sides, h, s.moves),
                    default=0.0,
                )
                margin = 1e-10 + (1e-4 * h if module.kinked else 0.0)
                assert off <= margin, (s.name, forms, h, wide, off)
    assert judged > MODULES * BOXES // 3


def _followed(
    module: DrawnModule, got: list[list[float]], eps: list[Fraction], x: list[float],
    u: list[float], wide: list[float], sides: list[list[int]], h: float, first: int,
) -> Any:  # fmt: skip
    """How far a run is outside, at every step and at its end; the last symbol of a way is time."""
    n, dt = module.states, h / len(sides)
    for number, side in enumerate(sides):
        now = [*eps[:-1], Fraction(2 * number, len(sides)) - 1]
        w = side[0] * wide[0]
        commands = [a + b * c for a, b, c in zip(u, side[1:], wide[1:], strict=True)]

        def f(y: list[float], w: float = w, commands: list[float] = commands) -> list[float]:
            return module.rate(y, commands, w)

        r = f(x)
        for i in range(n):
            yield float(off_by(got[10 + i], now, x[i], x[i]))
            yield float(off_by(got[20 + i], eps, r[i], r[i]))
        for _ in range(3):
            x = stepped(f, x, dt / 3)
    means = list(eps)
    for k in range(len(wide)):
        means[first + k] = Fraction(sum(side[k] for side in sides), len(sides))
    for i in range(n):
        yield float(off_by(got[10 + i], [*eps[:-1], Fraction(1)], x[i], x[i]))
        yield float(off_by(got[i], means, x[i], x[i]))


def stepped(f: Callable[[list[float]], list[float]], x: list[float], dt: float) -> list[float]:
    a = f(x)
    b = f([y + dt / 2 * k for y, k in zip(x, a, strict=True)])
    c = f([y + dt / 2 * k for y, k in zip(x, b, strict=True)])
    d = f([y + dt * k for y, k in zip(x, c, strict=True)])
    return [
        y + dt / 6 * (p + 2 * q + 2 * v + z) for y, p, q, v, z in zip(x, a, b, c, d, strict=True)
    ]


def test_printed_functions_hold_rates_effects_bends_and_laws(
    subjects: tuple[Library, list[Subject]],
) -> None:
    with mpmath.workdps(70):
        for library, s, module, rng in each(subjects, "printed"):
            n, m = module.states, module.controls
            judged = 0
            for _ in range(BOXES):
                eps = [eps_of(rng, s.symbols)]
                size = rng.choice((1.0, 0.1, 1e-3))
                x, v = (some(rng, eps, n, size, n) for _ in range(2))
                u = some(rng, eps, m, size, n)
                forms = rows_at(x=[f.row for f in x], v=[f.row for f in v], u=[f.row for f in u])(
                    s.symbols
                )
                at, to, by = ([_mp(f.values[0]) for f in forms_] for forms_ in (x, v, u))
                if (got := library.call(s.name, 5, forms)) is not None:
                    judged += 1
                    _printed(module, got, eps[0], at, to, by)
                if (got := library.call(s.name, 6, forms)) is not None:
                    for k, law in enumerate(module.law):
                        value = _exact(law.value(at, Mp))
                        assert off_by(got[k], eps[0], value, value) <= SAFE
                        # what SC computes of the doubles that are next
                        near = [float(y) for y in at]
                        off = off_by(got[k], eps[0], *[Fraction(law.value(near, MpFloats))] * 2)
                        assert off <= Fraction(1, 10**14)
            assert judged > BOXES // 2


def _printed(
    module: DrawnModule, got: list[list[float]], eps: list[Fraction], x: list[Any], v: list[Any],
    u: list[Any],
) -> None:  # fmt: skip
    n, m = module.states, module.controls

    def still(y: list[Any]) -> list[Any]:
        return [
            module.drift[i].value(y, Mp)
            + sum(module.by_control[i][k].value(y, Mp) * u[k] for k in range(m))
            for i in range(n)
        ]

    step = mpmath.mpf(10) ** -25
    before = still([a - step * b for a, b in zip(x, v, strict=True)])
    after = still([a + step * b for a, b in zip(x, v, strict=True)])
    for i, value in enumerate(still(x)):
        assert off_by(got[i], eps, _exact(value), _exact(value)) <= SAFE
        bend = _exact((after[i] - before[i]) / (2 * step))
        assert off_by(got[10 + i], eps, bend, bend) <= Fraction(1, 10**30)
        parts = [module.by_disturbance[i], *module.by_control[i]]
        for k, e in enumerate(parts):
            effect = _exact(e.value(x, Mp) + (module.grips[i].value(x, Mp) * u[0] if k == 0 else 0))
            assert off_by(got[20 + n * k + i], eps, effect, effect) <= SAFE


class Mp:
    """Functions of 70 digits."""

    sin, cos, tanh, atan, sqrt, exp, tan = (
        mpmath.sin, mpmath.cos, mpmath.tanh, mpmath.atan, mpmath.sqrt, mpmath.exp, mpmath.tan,
    )  # fmt: skip
    number = mpmath.mpf
    max, min = max, min


class MpFloats(Mp):
    """The same of doubles, whose operators round as a program's."""

    sin, cos, tanh, atan, sqrt, exp, tan = (
        staticmethod(lambda x, f=f: float(f(x)))
        for f in (Mp.sin, Mp.cos, Mp.tanh, Mp.atan, Mp.sqrt, Mp.exp, Mp.tan)
    )
    number = float


def _mp(x: Fraction) -> Any:
    return mpmath.mpf(x.numerator) / x.denominator


def _exact(x: Any) -> Fraction:
    sign, man, exp, _ = mpmath.mpf(x)._mpf_
    value: Fraction = Fraction((-1) ** sign * int(man)) * Fraction(2) ** exp
    return value


def test_reduced_forms_hold_states_and_commands_of_one_run(
    subjects: tuple[Library, list[Subject]],
) -> None:
    """The kept columns are symbols of before, others are folded: all of x and u is still there,
    for one choice of the new symbols that x and u share.
    """
    for library, s, module, rng in each(subjects, "reduced"):
        n, m, keep = module.states, module.controls * s.depth, PRECISIONS[0].keep
        for _ in range(2 * BOXES):
            eps = [eps_of(rng, s.symbols)]
            x = [drawn(rng, eps, rng.choice((1.0, 1e-3)), -3.0, 3.0) for _ in range(n)]
            u = [drawn(rng, eps, 1.0, -3.0, 3.0) for _ in range(m)]
            if rng.random() < 0.3:  # a state of which nothing is known
                x[-1].row[:] = [0.0, 0.0, -ENDLESS, ENDLESS, *[0.0] * s.symbols]
                x[-1].row[rng.choice((1, 4 + n, s.symbols))] = ENDLESS
            forms = rows_at(x=[f.row for f in x], u=[f.row for f in u])(s.symbols)
            got = library.call(s.name, 1, forms)
            assert got is not None
            kept = _columns(forms, got, n, m, s.symbols, keep)
            new = [*eps[0][:n], *[eps[0][k] for k in kept], *[Fraction(0)] * (s.symbols - n - keep)]
            for i in range(n):
                own = n + keep + i
                new[own] = Fraction(0)
                width = Fraction(got[i][4 + own]) if got[i][4 + own] < 1e308 else Fraction(10**9)
                without = [*got[i][:4], *got[i][4:]]
                without[1], without[4 + own] = float(width) * (1 + 1e-15), 0.0
                v = x[i].values[0]
                assert off_by(without, new, v, v) <= 0, (s.name, i, forms)
            for k in range(m):
                v = u[k].values[0]
                assert off_by(got[20 + k], new, v, v) <= 0, (s.name, k, forms)


def _columns(
    forms: list[list[float]], got: list[list[float]], n: int, m: int, symbols: int, keep: int
) -> list[int]:
    """Which column of before each kept one is, by its numbers in x and u."""
    found = []
    for p in range(keep):
        new = [got[i][4 + n + p] for i in range(n)] + [got[20 + k][4 + n + p] for k in range(m)]
        fit = []
        for k in range(n, symbols):
            old = [forms[i][4 + k] for i in range(n)] + [forms[20 + q][4 + k] for q in range(m)]
            # of a state whose range says more nothing is kept
            if all(a in (b, 0.0) for a, b in zip(new, old, strict=True)) and new[n:] == old[n:]:
                fit.append(k)
        found.append(fit[0])
    return found


def test_between_and_apart_hold_both(subjects: tuple[Library, list[Subject]]) -> None:
    for library, s, module, rng in each(subjects, "between"):
        m = module.controls
        for _ in range(BOXES):
            eps = [eps_of(rng, s.symbols)]
            u, other = (some(rng, eps, m, 1.0, module.states) for _ in range(2))
            forms = rows_at(u=[f.row for f in u], other=[f.row for f in other])(s.symbols)
            half = library.call(s.name, 4, forms)
            assert half is not None
            for k in range(m):
                a, b = u[k].values[0], other[k].values[0]
                middle = (a + b) / 2
                assert off_by(half[k], eps[0], middle, middle) <= 0
                assert abs(a - b) / 2 <= Fraction(half[10 + k][0])


def test_estimates_hold_the_state_and_no_nan_is_good(
    subjects: tuple[Library, list[Subject]],
) -> None:
    for library, s, module, rng in each(subjects, "estimated"):
        n = module.states
        for _ in range(BOXES):
            at = [rng.uniform(-3, 3) for _ in range(n)]
            got = library.call(s.name, 7, [], at)
            assert got is not None
            for i in range(n):
                side = rng.choice((-1, 0, 1))
                eps = [Fraction(0)] * s.symbols
                eps[i] = Fraction(side)
                x = Fraction(at[i]) + side * Fraction(0.01)
                assert off_by(got[i], eps, x, x) <= 0
        assert library.call(s.name, 7, [], [0.0] * n)[10][0] == 1.0
        for bad in (float("nan"), ENDLESS, 1e300, -1e308):
            at = [0.0] * n
            at[rng.randrange(n)] = bad
            got = library.call(s.name, 7, [], at)
            assert got is None or got[10][0] == 0.0


BLOWN_UP = """soter 1;
type Pose = { s0: float, s1: float };
topic pose: Pose max_age 20ms;
topic order: float in [-2.0, 2.0] = 0.0;
plant Body period 10ms {
  reads order;
  drives pose = { s0: s0, s1: s1 };
  state s0: float = 0.0;
  state s1: float = 0.0;
  disturbance w: float in [-0.01, 0.01];
  der s0 = order + w;
  der s1 = s1 * s1;
  measured pose.s0 within 0.01, pose.s1 within 0.01;
}
node Ac period 50ms { subscribes pose; publishes order; step { publish order = 0.0; } }
node Sc period 50ms { subscribes pose; publishes order;
  step { publish order = clamp(-pose.s0 + clamp(0.001 * pose.s1, -0.1, 0.1), -2.0, 2.0); } }
rta M { ac Ac; sc Sc; period 50ms; safe abs(pose.s0) < 50.0; rest abs(pose.s0) < 1.0 within 2s; }
system S default { b: Body; module M; until 1s; }
"""


def test_a_solution_that_ends_is_not_good(tmp_path_factory: pytest.TempPathFactory) -> None:
    """s1 only reaches a limit of SC's; from 1,000 it has no value after a millisecond."""
    text, symbols, *_ = source_of(BLOWN_UP, TIMES)
    library = Library(tmp_path_factory.mktemp("blown"), {"blown": (text, symbols)})
    verdicts = []
    for s1 in (-3.0, 0.0, 1e3, 1e150, 1e299, float("nan")):
        got = library.call("blown", 7, [], [0.0, s1])
        verdicts.append(got is not None and got[10][0] == 1.0)
    assert verdicts == [True, True, False, False, False, False]


UNKNOWN = (
    BLOWN_UP.replace(
        "der s0 = order + w;",
        "der s0 = 10.0 - 30.0 * (s0 - s1)\n"
        "    + order * (1e10 * max(s0 + 1.0, 0.0) * exp(335.0 * (s1 - s0)));",
    )
    .replace("der s1 = s1 * s1;", "der s1 = 0.0;")
    .replace("  disturbance w: float in [-0.01, 0.01];\n", "")
)
"""Where s0 = s1 is not known, what a command does to s0 has no end a little above -1."""


def test_a_face_behind_which_nothing_is_known_has_no_slope() -> None:
    """s0 and s1 are one number of [-1, 1], the command is 0: no rate is bounded, no step found."""
    text, symbols, moves, _ = source_of(UNKNOWN, TIMES)
    x = (0.0, 0.0, -1.0, 1.0, (1.0, *[0.0] * (symbols - 1)))
    none = (0.0, 0.0, 0.0, 0.0, (0.0,) * symbols)
    caller = Caller(text)
    still = ((0.0, 0.0),)
    faced = caller.result("faced", 0, ((-1.0, -0.8), (-1.0, 1.0)), still, still, (0.0,))
    for row in (faced, caller.result("widened", none, float("nan"))[2:4]):
        assert tuple(row) == (-ENDLESS, ENDLESS)
    *_, found = caller.result("flow", (x, x), (none,), (0.0,), 0.02, moves)
    assert not found
