"""What SC answers in a tube: whatever its reads are of, up to their age, the forms hold it.

Non-goals: steps (`test_steps.py`); the law itself (`test_expressions.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest

from soter.verify.tubes.tube_precision import PRECISIONS
from unit.verify.tubes.random_plants import OLD_READS, Floats, drawn_subjects
from unit.verify.tubes.soter_forms import eps_of
from unit.verify.tubes.test_steps import BOXES, ENDLESS, MODULES, each, rows_at, some, stepped

if TYPE_CHECKING:
    import random
    from collections.abc import Sequence
    from fractions import Fraction

    from soter.verify.tubes.problem import TubeTimes
    from unit.verify.tubes.random_plants import DrawnModule, Subject
    from unit.verify.tubes.soter_forms import Library


@pytest.fixture(scope="module")
def old_reads(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Library, list[Subject]]]:
    """Modules with reads of more than a period of SC, whose rates are affine, or bent."""
    folders = (tmp_path_factory.mktemp(f"old_reads_{bent}") for bent in (False, True))
    return [
        drawn_subjects(folder, MODULES, bent=bent, times=OLD_READS)
        for folder, bent in zip(folders, (False, True), strict=True)
    ]


@pytest.mark.parametrize("bent", [False, True], ids=["affine", "bent"])
def test_answers_hold_what_sc_makes_of_reads_of_one_instant(
    old_reads: list[tuple[Library, list[Subject]]], bent: bool
) -> None:
    """A run is followed back from states of the form, and on until the next command may act; what
    SC answers to what it was at one instant, with errors, is in each direction within the forms.
    """
    judged = 0
    for library, s, module, rng in each(old_reads[bent], "answered"):
        n, m, shared = module.states, module.controls, 2 * module.states + PRECISIONS[0].keep
        for _ in range(4 * BOXES):
            eps = [eps_of(rng, s.symbols)]
            first = rng.random() < 0.3
            size = rng.choice((1.0, 0.1, 1e-3))
            x = some(rng, eps, n, size, shared)
            acted = some(rng, eps, m * s.depth, 1.0, shared)
            past = Past(module, OLD_READS, rng, first=first)
            runs = [past.run([float(f.values[0]) for f in x], acted) for _ in range(6)]
            rates = [r for run in runs for _, _, r in run]
            met = [_around([r[i] for r in rates]) for i in range(n)]
            wide = [[0.0, ENDLESS, *ends, *[0.0] * s.symbols] for ends in met]
            forms = rows_at(x=[f.row for f in x], v=wide, u=[f.row for f in acted])(s.symbols)
            got = library.call(s.name, 2, forms, [0.0 if first else 1.0])
            if got is None or got[10][0] == 0.0:
                continue
            judged += 1
            for run in runs:
                for _ in range(4):
                    _, at, _ = rng.choice(run)
                    seen = [a + rng.choice((-0.01, 0.0, 0.01)) for a in at]
                    answer = [law.value(seen, Floats) for law in module.law]
                    margin = 1e-9 + (1e-5 if module.kinked else 0.0)
                    off = _off_along(rng, got[:m], eps[0], answer, shared)
                    assert off <= margin, (s.name, forms, first, seen, answer, off)
    assert judged > MODULES * BOXES


def _around(values: Sequence[float]) -> tuple[float, float]:
    """A range around numbers that were met at some instants only."""
    slack = 0.02 * (max(values) - min(values)) + 1e-6
    return min(values) - slack, max(values) + slack


def _off_along(
    rng: random.Random, got: Sequence[Sequence[float]], eps: Sequence[Fraction],
    answer: Sequence[float], shared: int,
) -> float:  # fmt: skip
    """How far answers are outside of forms, in some direction, the first `shared` symbols known."""
    by = [rng.choice((-1.0, 0.0, 1.0, rng.uniform(-1, 1))) for _ in answer]
    known = [
        f[0] + sum(g * float(e) for g, e in zip(f[4 : 4 + shared], eps, strict=False)) for f in got
    ]
    off = abs(sum(b * (a - c) for b, a, c in zip(by, answer, known, strict=True)))
    columns = zip(*(f[4 + shared :] for f in got), strict=True)
    room = sum(abs(sum(b * g for b, g in zip(by, c, strict=True))) for c in columns)
    outside: float = off - room - sum(abs(b) * f[1] for b, f in zip(by, got, strict=True))
    ends = [max(f[2] - a, a - f[3]) for f, a in zip(got, answer, strict=True)]
    return max(outside, *ends)


@dataclass
class Past:
    """What may have led to the states of a tube, and goes on from there: times in s after it."""

    module: DrawnModule
    times: TubeTimes
    rng: random.Random
    first: bool
    """Whether it is of SC's first output, before which any command acted."""

    def run(self, at: list[float], acted: Sequence[Any]) -> list[tuple[float, list[float], Any]]:
        """Instants, states and rates of one run: those of the read's times."""
        m, rng, times = self.module.controls, self.rng, self.times
        d, j, period = (t * 1e-9 for t in (times.delay, times.jitter, times.period))
        given = [float(f.values[0]) for f in acted]
        begun = [[-k * period + rng.uniform(0, 2 * j) for _ in range(m)] for k in (1, 2)]
        steps = rng.choice((12, 40))

        def commands(t: float) -> list[float]:
            if self.first:
                return [rng.choice((-2.0, 2.0)) for _ in range(m)]
            found = []
            for i in range(m):
                age = 0 if t >= begun[0][i] else 1 if t >= begun[1][i] else 2
                known = age * m < len(given)
                found.append(given[age * m + i] if known else rng.choice((-2.0, 2.0)))
            return found

        met = []
        for span in (-d, 0.0 if self.first else 2 * j):
            x, h = list(at), span / steps
            for k in range(steps + 1):
                w = rng.choice((-1, 1)) * self.module.disturbed
                u = commands((k + 0.5) * h)

                def f(y: list[float], w: float = w, u: list[float] = u) -> list[float]:
                    return self.module.rate(y, u, w)

                met.append((k * h, x, f(x)))
                x = stepped(f, x, h)
                met.append((k * h, met[-1][1], f(x)))
        return met
