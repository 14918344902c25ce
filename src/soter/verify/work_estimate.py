"""How long a proof will take, roughly, said before it begins.

Purpose: the first case on merged cells, twice; how its time grows with the cells says how long the
declared grid takes, in seconds of processor time: what else runs on the machine changes those
little. Said only where somebody waits for it, and where it is long.
Non-goals: a bound; verdicts; finer grids where only borders fail; what comes after the sets
(counterexamples, what may help). Asked by proofs, and by what computes tables before it flies.
"""

from __future__ import annotations

import math
import time
from itertools import islice
from typing import TYPE_CHECKING

from soter.diagnostics.current_phase import announce, lasting, passing_phase
from soter.verify.claims.cells import cells_of
from soter.verify.diagnosis.variations import merged
from soter.verify.grid.sets import UnboundedError
from soter.verify.problem.extract import cases

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.verify.problem.problem import Problem

    Settle = Callable[[Problem, tuple[int, ...]], object]

FROM_CELLS = 50_000
"""Fewer cells are not worth a look."""
PILOTS = (1_500, 6_000)
"""Cells of a group in the two tries."""
GROWTH = (1.0, 1.2)
"""Exponents of the cells between which the time is taken to grow."""
FROM_S = 20.0
"""Less is not said."""
TO_S = 10
"""Seconds that are told apart."""


def announce_work(problem: Problem, settle: Settle) -> None:
    """Say how much work the sets of a problem are. `settle`: a case of a problem, computed."""
    if cells_of(problem) >= FROM_CELLS:
        with passing_phase(f"{problem.name}: how long it will take"):
            announce(lambda: _said(problem, _estimate(problem, settle)))


def _estimate(problem: Problem, settle: Settle) -> float:
    """CPU seconds of all threads for all cases; 0 where nothing can be told."""
    first = next(iter(cases(problem)))
    count = sum(1 for _ in islice(cases(problem), 100_000))
    tries = []
    for most in PILOTS:
        small = merged(problem, most)
        began = time.process_time()
        try:
            settle(small, first)
        except UnboundedError:
            return 0.0
        tries.append((cells_of(small), time.process_time() - began))
    (n, t), (m, s) = tries
    slope = math.log(s / t) / math.log(m / n) if m > n and s > t > 0.0 else GROWTH[0]
    growth = min(max(slope, GROWTH[0]), GROWTH[1])
    return float(s * (cells_of(problem) / m) ** growth * count)


def _said(problem: Problem, seconds: float) -> str:
    """A line; "" where it is not worth one."""
    if seconds < FROM_S:
        return ""
    shapes = [" x ".join(str(len(a.edges) - 1) for a in g.axes) for g in problem.groups]
    axes = sum(len(g.axes) for g in problem.groups)
    many = "1 axis" if axes == 1 else f"{axes} axes"
    told = f"{problem.name}: {many} of {' and '.join(shapes)} cells"
    return f"{told}: about {lasting(seconds, TO_S)} of processor time"
