"""The re-checker's chains of SC periods and free phases, for the states of one group.

Purpose: `Chain`: functions that enclose what SC makes of a cell, period by period, delays, jitter,
errors and disturbances inside; `free_phase`: what any command makes of it (docs/verification.md,
section 3).
Non-goals: which cells, and whether what comes out lies in a set (`group_claims.py`).

SC acts at a_0 = 0 and a_k in [k delta - p, k delta - p + j], on a sample taken at most d before.
Every run has one p in [0, j]: how long after the beginning of its window a_0 was. For all p in a
part of [0, j] these windows lie in [k delta - e, k delta + l] (`Window`); for all p e = l = j. Time
is cut at k delta - e and k delta + l: between the cuts one command acts, within them first the old
and then the new one. What precedes a_k is a matter of old commands alone: nothing is circular.

Where commands act later than half a period (2 j > delta) several may follow each other between two
cuts. Then of an instant only this is used: what acts answers, in each component, some sample that
was taken since `in_force` before it (proof-sets.md, "Late commands"). Time is cut at a_0 + k delta.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any

from soter.certificate.grid.flow_chains import FlowChain, Times
from soter.certificate.grid.flow_enclosures import LocalFlow, SolvedFlow
from soter.certificate.grid.inward_flow import uncrossed_ends
from soter.certificate.reading.linear_flows import is_linear, linear_flow
from soter.certificate.reading.map_steps import map_free, map_step
from soter.certificate.terms.straight_line import Builder, Function, NotCertainError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flint import arb

    from soter.certificate.grid.flow_chains import Image
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.compile_terms import Step

NANOSECOND = Fraction(1, 10**9)


@dataclass(frozen=True, eq=False)
class Chain:
    """`first` takes a cell, `later` what came before; each gives a form and boxes met on the way.

    `last`: from the form before the last switch to the boxes it may then be in, None where that
    is simply the box of the form. A box is a flat tuple low, high, low, high, ...
    """

    first: Step
    later: Step
    last: Step | None


@dataclass(frozen=True)
class Window:
    """Runs with p in the `index`th of `count` equal parts of [0, j].

    Of these the ones whose first sample was taken as long before a_0 as the `age`th of `ages`
    equal parts of [0, d] says: how far any command may have led since is then known better.
    """

    index: int = 0
    count: int = 1
    age: int = 0
    ages: int = 1

    def ends(self, jitter: Fraction) -> tuple[Fraction, Fraction]:
        """(e, l): a command acts from e before its nominal time until l after it."""
        first = jitter * self.index / self.count
        return first + jitter / self.count, jitter - first

    def taken(self, delay: Fraction) -> tuple[Fraction, Fraction]:
        """From when to when, relative to a_0, the first sample was taken."""
        return -delay * (self.age + 1) / self.ages, -delay * self.age / self.ages


EVERY = Window()


def windows(
    model: CaseModel, members: Sequence[int], count: int, *, by_age: bool = False
) -> tuple[Window, ...]:
    """All runs in `count` parts, in one where no command acts late.

    `by_age`: each of these in `count` parts, where a linear flow led from the first sample and all
    that SC reads of it comes one way: what comes several ways may show several instants.
    """
    if model.facts.kind == "map" or model.facts.late_commands:
        return (EVERY,)
    counts = count if model.facts.jitter_ns else 1
    paths = [path for read in model.facts.setting.by_sc for path in read.paths]
    by_age = by_age and len(paths) == 1 and is_linear(model, members)
    ages = count if by_age and model.facts.delay_ns else 1
    return tuple(Window(k, counts, age, ages) for k in range(counts) for age in range(ages))


def sc_chain(
    model: CaseModel, members: Sequence[int], pieces: int, window: Window = EVERY
) -> Chain:
    """The chain of a group, tubes cut into `pieces` a period."""
    if model.facts.kind == "map":
        step = map_step(model, members)
        return Chain(step, step, None)
    facts = model.facts
    given = facts.times["delta_ns"], facts.delay_ns, facts.jitter_ns
    delta, d, j = (t * NANOSECOND for t in given)
    times = Times(delta, d, *window.ends(j), window.taken(d))
    if facts.late_commands:
        times = Times(delta, facts.own.in_force * NANOSECOND, anew=True)
    chain = FlowChain(model, members, _flow(model, members), times)
    cell, form = (chain.layout.length(fresh=fresh) for fresh in (True, False))
    first = _step(chain, partial(chain.first, pieces), cell)
    later = _step(chain, partial(chain.later, pieces), form)
    return Chain(
        first, later, _step(chain, partial(chain.last, pieces), form) if chain.span else None
    )


def free_phase(
    model: CaseModel, members: Sequence[int], time_ns: int, pieces: int
) -> tuple[Step, ...]:
    """Steps over [0, time] under any commands, one after the other; for a map to its instants."""
    if model.facts.kind == "map":
        return map_free(model, members, time_ns)
    delta = model.facts.times["delta_ns"] * NANOSECOND
    chain = FlowChain(model, members, _flow(model, members), Times(delta))
    free = partial(chain.free, time_ns * NANOSECOND, pieces)
    return (_step(chain, free, chain.layout.length(fresh=True)),)


def _flow(model: CaseModel, members: Sequence[int]) -> LocalFlow | SolvedFlow:
    kept = uncrossed_ends(model, members)
    if is_linear(model, members):
        return SolvedFlow(model, members, linear_flow(model, members), kept)
    return LocalFlow(model, members, kept)


def _step(chain: FlowChain, image: Callable[[tuple[Any, ...]], Image], length: int) -> Step:
    """A step over balls; written down once where the flow is solved once. `length`: of a form."""
    if isinstance(chain.flow, LocalFlow):
        return partial(_of_balls, image)
    make = Builder()
    form, boxes = image(tuple(make.input(i) for i in range(length)))
    return Function(make, length, [*form, *boxes], after=len(form))


def _of_balls(
    image: Callable[[tuple[Any, ...]], Image], form: tuple[arb, ...]
) -> tuple[tuple[arb, ...], tuple[float, ...]] | None:
    try:
        after, boxes = image(form)
    except NotCertainError:
        return None
    return after, tuple(boxes)
