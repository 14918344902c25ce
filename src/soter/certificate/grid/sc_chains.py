"""Chains of SC's periods and free phases of one group, and ends of a grid that no run crosses.

Purpose: `sc_chain` makes a `Chain`, functions that enclose where SC leads a cell, period by period,
with delays, jitter, errors and disturbances in it; `free_phase_steps` encloses where any command
leads it (docs/verification.md, section 3). `uncrossed_ends` finds the ends of axes that no run
crosses, whatever is commanded; `is_grid_never_left` asks whether no run leaves the grid of a group
that no command moves.
Non-goals: steps of flows (`flow_chains.py`), of maps (`extras/maps.py`); which cells, and whether
what comes out lies in a set (`group_claims.py`); ends that only SC keeps: chains show those.

Let x_i' >= 0 wherever x_i is at the lower end of its axis, all other states in their grids, for
every command, disturbance and influence of other groups (at the upper end: x_i' <= 0). Replace x in
f by its projection p(x) onto the grid in the axes with such ends. A solution of x' = f(p(x), u, w)
that begins in the grid stays above that end for as long as its other states are in their grids:
before it were below at some t, it was at the end at some t_0 < t and below from then on, where x_i'
= f_i(p(x), u, w) >= 0, so that x_i(t) >= x_i(t_0). There p does nothing: it solves x' = f(x, u, w),
too, and solutions are unique (a linear flow is Lipschitz; for others a printed assumption). Where f
jumps, a solution has any rate between those on both sides, whatever f is at the jump alone; so what
touches a jump has all of these here (`widened_at_jump` of `symbolic_operations.py`), and there is
one that stays if from one side of all such ends together rates point inwards. Of x_i compared with
the end itself that side is the strip outside: what is asked there holds up to the end. So a box
that encloses the states of one step may be cut off at such an end, if what is left of it lies in a
set of cells: whoever uses such a box checks that. Where all ends are of this kind the same holds of
the whole grid, with no condition.

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

from flint import arb

from soter.certificate.cell_sets import holds_in_parts
from soter.certificate.extras import extras
from soter.certificate.grid.flow_chains import FlowChain, Times
from soter.certificate.grid.flow_enclosures import LocalFlow, SolvedFlow
from soter.certificate.reading.linear_flows import has_linear_rates, linear_flow
from soter.certificate.terms.linear_enclosures import exact
from soter.certificate.terms.straight_line import Builder, Function, NotCertainError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.certificate.grid.flow_chains import Image
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.compile_terms import Step

    Kept = list[tuple[bool, bool]]
    Side = list[tuple[float, float]]
    Test = Callable[[Side, int, int], bool]


SPLITS = 8
"""How often a side of the grid is halved along each axis."""
STRIP = arb(2) ** -20
"""How wide the strip outside of an end is, as a part of its axis."""
NANOSECOND = Fraction(1, 10**9)
WINDOWS = 4
"""Into so many parts runs are cut by how late their first command acted, and then also by how old
the sample was that it answers."""


def is_grid_never_left(model: CaseModel, states: Sequence[int]) -> bool:
    """Whether no run leaves the grid of a group that no command moves; False where uncertain."""
    if model.facts.kind != "flow" or LocalFlow(model, states).moves:
        return False
    return all(low and high for low, high in uncrossed_ends(model, states))


def uncrossed_ends(model: CaseModel, members: Sequence[int]) -> Kept:
    """For each state, whether no run crosses the lower and the upper end of its axis.

    It is False if uncertain and, as solutions may branch, whenever K has cells at rest. An open end
    counts as not crossed.
    """
    if model.facts.kind != "flow" or model.facts.at_rest:
        return [(False, False)] * len(members)
    inwards = _inward_test(model, members)
    ends = []
    for i in range(len(members)):
        sides = [[model.extents[k] for k in members] for _ in range(2)]
        if members[i] in model.facts.unbounded | model.facts.turning:
            ends.append((False, False))
            continue
        low, high = model.extents[members[i]]
        sides[0][i], sides[1][i] = (low, low), (high, high)
        is_open = members[i] in model.facts.open_ends  # nobody gets there: an assumption
        ends.append((inwards(sides[0], i, 1), is_open or inwards(sides[1], i, -1)))
    return ends


def _inward_test(model: CaseModel, members: Sequence[int]) -> Test:
    """The test that runs move inwards at an end: on that side of the grid, or in a strip beyond."""
    flow = LocalFlow(model, members)

    def inwards(side: Side, i: int, sign: int) -> bool:
        end, (low, high) = exact(side[i][0]), map(exact, model.extents[members[i]])
        if _moves_inwards(flow, side, i, sign, (end, end)):
            return True
        beyond = end - sign * (high - low) * STRIP
        strip = (beyond, end) if sign > 0 else (end, beyond)
        return (
            flow.compared[i]
            and bool(strip[0] < strip[1])
            and _moves_inwards(LocalFlow(model, members, outside=i), side, i, sign, strip)
        )

    return inwards


def _moves_inwards(flow: LocalFlow, side: Side, i: int, sign: int, fixed: tuple[arb, arb]) -> bool:
    """Whether state i, in `fixed`, moves up (`sign` 1) or down, with other states in `side`."""

    def holds(others: list[tuple[arb, arb]]) -> bool:
        try:
            lines = flow.derivative_rows([*others[:i], fixed, *others[i:]], flow.ranges)
        except NotCertainError:
            return False
        low, high = flow.rate_ranges(lines)[i]
        return bool(low >= 0 if sign > 0 else high <= 0)

    others = [(exact(a), exact(b)) for k, (a, b) in enumerate(side) if k != i]
    return holds_in_parts(others, holds, SPLITS * len(others)) if others else holds([])


@dataclass(frozen=True, eq=False)
class Chain:
    """Functions from form to form: `first` follows a cell over a hold, `later` over a next hold.

    Both also give the boxes of all states on the way: low, high, low, high, ..., flat. `last` maps
    the form before the last switch to the boxes of the switch; None means the form's box.
    """

    first: Step
    later: Step
    last: Step | None


@dataclass(frozen=True)
class Window:
    """The runs whose p (see the head) is in part `index` of `count` equal parts of [0, j].

    Their first sample was taken before a_0 by a time in the `age`th of `ages` equal parts of [0,
    d]; this limits better how far any command may have led since.
    """

    index: int = 0
    count: int = 1
    age: int = 0
    ages: int = 1

    def early_and_late(self, jitter: Fraction) -> tuple[Fraction, Fraction]:
        """(e, l) in s: how early and how late commands act, relative to their nominal times."""
        first = jitter * self.index / self.count
        return first + jitter / self.count, jitter - first

    def sample_span(self, delay: Fraction) -> tuple[Fraction, Fraction]:
        """The span, relative to a_0, in which the first sample was taken."""
        return -delay * (self.age + 1) / self.ages, -delay * self.age / self.ages


EVERY = Window()


def windows_of_runs(
    model: CaseModel, members: Sequence[int], delay_ns: int, *, by_age: bool = False
) -> tuple[Window, ...]:
    """Splits all runs into `WINDOWS` windows, or a single window if no command acts late.

    `by_age`: divides each again into `WINDOWS` parts, by the age of the first sample, `delay_ns` at
    most. This needs a linear flow and a single way by which SC reads everything: several ways may
    show several instants, as may a node that combines topics, if one of them may be silent.
    """
    if model.facts.kind == "map" or model.facts.has_late_commands:
        return (EVERY,)
    counts = WINDOWS if model.facts.jitter_ns else 1
    paths = [path for read in model.facts.setting.by_sc for path in read.paths]
    mixed = model.facts.setting.silent and any(path.clocks[1:] for path in paths)
    by_age = by_age and len(paths) == 1 and not mixed and has_linear_rates(model, members)
    ages = WINDOWS if by_age and delay_ns else 1
    return tuple(Window(k, counts, age, ages) for k in range(counts) for age in range(ages))


def sc_chain(
    model: CaseModel, members: Sequence[int], delay_ns: int, pieces: int, window: Window
) -> Chain:
    """Makes the chain of a group whose reads are `delay_ns` old at most.

    A hold has `pieces` times the least number of steps.
    """
    if model.facts.kind == "map":
        step = extras.maps.map_steps_in_period(model, members)
        return Chain(step, step, None)
    facts = model.facts
    times_ns = facts.times["delta_ns"], delay_ns, facts.jitter_ns
    delta, d, j = (t * NANOSECOND for t in times_ns)
    times = Times(delta, d, *window.early_and_late(j), window.sample_span(d))
    if facts.has_late_commands:
        times = Times(delta, facts.derived.in_force * NANOSECOND, anew=True)
    chain = FlowChain(model, members, _flow_of_group(model, members), times)
    cell, form = (chain.layout.form_length(fresh=fresh) for fresh in (True, False))
    first = _form_step(chain, partial(chain.lead_over_first_hold, pieces), cell)
    later = _form_step(chain, partial(chain.lead_over_later_hold, pieces), form)
    last = _form_step(chain, partial(chain.last_switch_boxes, pieces), form) if chain.span else None
    return Chain(first, later, last)


def free_phase_steps(
    model: CaseModel, members: Sequence[int], time_ns: int, pieces: int
) -> tuple[Step, ...]:
    """Functions that lead a form over [0, time] under any commands; a map's step each instant."""
    if model.facts.kind == "map":
        steps: tuple[Step, ...] = extras.maps.map_steps_in_time(model, members, time_ns)
        return steps
    delta = model.facts.times["delta_ns"] * NANOSECOND
    chain = FlowChain(model, members, _flow_of_group(model, members), Times(delta))
    free = partial(chain.boxes_under_any_commands, time_ns * NANOSECOND, pieces)
    return (_form_step(chain, free, chain.layout.form_length(fresh=True)),)


def _flow_of_group(model: CaseModel, members: Sequence[int]) -> LocalFlow | SolvedFlow:
    kept = uncrossed_ends(model, members)
    if has_linear_rates(model, members):
        return SolvedFlow(model, members, linear_flow(model, members), kept)
    return LocalFlow(model, members, kept)


def _form_step(chain: FlowChain, image: Callable[[tuple[Any, ...]], Image], length: int) -> Step:
    """Makes a function of forms of this length; compiles it if the flow is solved only once."""
    if isinstance(chain.flow, LocalFlow):
        return partial(_image_of_balls, image)
    make = Builder()
    form, boxes = image(tuple(make.input_at(i) for i in range(length)))
    return Function(make, length, [*form, *boxes], after=len(form))


def _image_of_balls(
    image: Callable[[tuple[Any, ...]], Image], form: tuple[arb, ...]
) -> tuple[tuple[arb, ...], tuple[float, ...]] | None:
    try:
        after, boxes = image(form)
    except NotCertainError:
        return None
    return after, tuple(boxes)
