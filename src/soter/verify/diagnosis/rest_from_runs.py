"""A `rest` clause read off runs of the model: where SC stops, how far it drifts, how long it needs.

Purpose: `rests_of` makes clauses for a module whose SC brings every state that it or a rate reads
to a place: the checked `RestSymbol`, and its text. A state that nothing but `safe` reads stands
behind `moves`, if runs that begin at rest move it and come to an end.
Non-goals: showing anything: the proof by tubes decides (`tried_remedies.py`).
"""

from __future__ import annotations

import math
import time
from itertools import islice, product
from typing import TYPE_CHECKING

import numpy as np

from soter.language.model import typed as t
from soter.language.model.types import DURATION, leaf_name, leaves, write_ns
from soter.verify.deploy.level_tables import Writer
from soter.verify.diagnosis.model_runs import FALSE, NS, PointModel, patterns, run

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.core.layout import Floats
    from soter.verify.claims.case import Case
    from soter.verify.diagnosis.model_runs import ModelTrace, Pattern
    from soter.verify.problem.problem import Problem

    Ends = dict[int, tuple[float, float]]

HOLDS, PATTERNS, CORNERS = 5000, 9, 8
"""For how many periods of SC a run is followed; how many patterns, and corners, are tried."""
STILL, LEAST = 2e-3, 0.01
"""As shares of an axis: how little moves what has stopped; how wide a rest is to either side."""
WIDER, ROOM = (1.25, 3.0), 1.5
"""By how much the place where runs end is widened, in turn; room for how far and how long."""
CPU_S = 4.0
"""CPU seconds for all runs."""


def rests_of(case: Case) -> Iterator[tuple[t.RestSymbol, str]]:
    """Clauses to try, the narrowest first; none where an undisturbed SC does not stop."""
    followed, reads = _Followed(case), case.forms.library.reads
    model, span_s = followed.model, HOLDS * followed.model.inputs.period_ns * NS
    read = {k for f in ("law", "derivative") for k in reads.get(f, ())}
    held = [s for s in range(len(model.low)) if s in read]
    ways = [s for s in range(len(model.low)) if s not in read and s in reads.get("safe", ())]
    every, width = list(patterns(model)), model.high - model.low
    every = every[:1] + every[1 :: max(1, len(every) // PATTERNS)]
    calm = followed.runs([model.start], every[:1], span_s)
    rest = calm[0].states[-1] if calm else model.start
    settled_s = _settled_s(calm, held, STILL * width)
    if not held or not calm or settled_s > 0.75 * span_s:
        return
    half_way = {s: ((rest[s] + model.low[s]) / 2, (rest[s] + model.high[s]) / 2) for s in held}
    back = followed.runs(_corners(rest, half_way), every[:1], max(2 * settled_s, span_s / 20))
    within_s = ROOM * _settled_s([*calm, *back], held, STILL * width)
    stopped = [r for r in back if _settled_s([r], held, STILL * width) <= 0.75 * r.times[-1]]
    away = np.max([rest * 0.0, *(np.abs(r.states[-1] - rest) for r in stopped)], axis=0)
    ways += [s for s in held if away[s] > 4 * STILL * width[s] and s in reads.get("safe", ())]
    held = [s for s in held if away[s] <= 4 * STILL * width[s]]
    pushed = followed.runs([rest], every, within_s)
    late = np.concatenate([rest[None], *(r.states[len(r.states) // 2 :] for r in pushed)])
    low, high = late.min(axis=0), late.max(axis=0)
    for factor in WIDER:
        half = factor * np.maximum((high - low) / 2, LEAST * width)
        ends = {s: _rounded_ends(low[s] / 2 + high[s] / 2, float(half[s])) for s in held}
        moved = every[:: max(1, len(every) - 1)] if ways else []
        resting = followed.runs(_corners(rest, ends), moved, 2 * within_s)
        by = {z: w for z in ways if (w := _way(resting, z)) is not None}
        if held and followed.going():
            yield from _clause(case.problem, ends, by, max(within_s, model.inputs.period_ns * NS))


class _Followed:
    """Runs of a case's model, for a limited time."""

    def __init__(self, case: Case) -> None:
        self.model, self.until = PointModel(case), time.process_time() + CPU_S

    def going(self) -> bool:
        """Whether there is time left."""
        return time.process_time() < self.until

    def runs(
        self, starts: Iterable[Floats], every: Sequence[Pattern], until_s: float
    ) -> list[ModelTrace]:
        """The runs from states in `safe` that end there, under each pattern."""
        model = self.model
        found: list[ModelTrace] = []
        for x in (x for x in starts if model.safe(x) != FALSE):
            found += [run(model, x, p, until_s, self.going, beyond=True) for p in every]
        return [r for r in found if model.safe(r.states[-1]) != FALSE]


def _settled_s(traces: Sequence[ModelTrace], held: Sequence[int], near: Floats) -> float:
    """From when on each of some runs is near its end, in s; `near`: how near, of each state."""
    latest = 0.0
    for trace in traces:
        away = np.abs(np.array(trace.states) - trace.states[-1])[:, held] > near[held]
        at = np.flatnonzero(away.any(axis=1))
        latest = max(latest, trace.times[int(at[-1])] if len(at) else 0.0)
    return latest


def _corners(at: Floats, ends: Ends) -> Iterator[Floats]:
    """A state with those of a box at its corners, at some of them where there are many."""
    for corner in islice(product(*ends.values()), 0, None, max(1, 2 ** len(ends) // CORNERS)):
        x = at.copy()
        x[list(ends)] = corner
        yield x


def _way(resting: Sequence[ModelTrace], z: int) -> float | None:
    """How far runs from rest move a state, with room; None where they do not come to an end."""
    ways = [np.abs(np.array(r.states)[:, z] - r.states[0][z]) for r in resting]
    furthest = max((float(w.max()) for w in ways), default=0.0)
    half = max((float(w[: len(w) // 2].max()) for w in ways), default=0.0)
    return None if furthest > 1.05 * half + 1e-9 else ROOM * furthest


def _rounded_ends(middle: float, half: float) -> tuple[float, float]:
    """The ends of an interval, with as many digits as its width has; around 0 where it may be."""
    unit = 10.0 ** (math.floor(math.log10(half)) - 1)
    if abs(middle) < half / 4:
        middle, half = 0.0, half + abs(middle)
    low, high = math.floor((middle - half) / unit), math.ceil((middle + half) / unit)
    return float(f"{low * unit:.12g}"), float(f"{high * unit:.12g}")


def _clause(
    problem: Problem, ends: Ends, by: dict[int, float], within_s: float
) -> Iterator[tuple[t.RestSymbol, str]]:
    """The clause; none where the module's conditions do not read what shows a state."""
    scope, span = problem.module.scope.topics, problem.module.symbol.safe.span
    symbols = {index: symbol for symbol, index in scope.items()}
    shown = {s: problem.topic_leaf_of_state.get(s, (-1, 0)) for s in (*ends, *by)}
    if any(topic not in symbols for topic, _ in shown.values()):
        return
    places = {s: symbols[topic] for s, (topic, _) in shown.items()}
    paths = {s: list(leaves(places[s].type))[k][0] for s, (_, k) in shown.items()}
    names = {s: leaf_name(places[s].name, paths[s]) for s in shown}
    w, parts, said = Writer(span), [], []
    for s, (low, high) in ends.items():
        parts += [w.op(">", w.leaf(places[s], paths[s]), w.decimal(low))]
        parts += [w.op("<", w.leaf(places[s], paths[s]), w.decimal(high))]
        both = f"{names[s]} > {low!r} && {names[s]} < {high!r}"
        said.append(f"abs({names[s]}) < {high!r}" if low == -high else both)
    far = {z: float(f"{x * 1.05:.2g}") for z, x in by.items()}
    moves = tuple(t.RestMove(places[z], paths[z], w.decimal(x), "", span) for z, x in far.items())
    ns = int(float(f"{1.05 * within_s:.2g}") * 1e9)
    condition = w.chain("&&", parts)
    text = f"rest {' && '.join(said)}"
    text += f" moves {', '.join(f'{names[z]} by {x!r}' for z, x in far.items())}" * bool(far)
    within = t.Literal(DURATION, span, ns)
    yield t.RestSymbol(condition, moves, within, span), f"{text} within {write_ns(ns)};"
