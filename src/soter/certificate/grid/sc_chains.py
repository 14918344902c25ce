"""Chains of SC periods and free phases, compiled for the states of one group.

Purpose: `Chain`: functions that enclose what SC makes of a cell, period by period, delays, jitter,
errors and disturbances inside; `FreeChain`: what any command makes of it (docs/verification.md,
section 3).
Non-goals: which cells, and whether what comes out lies in a set (`group_claims.py`).

SC acts at a_0 = 0 and a_k in [k delta - p, k delta - p + j], on a sample taken at most d before.
Every run has one p in [0, j]: how long after the beginning of its window a_0 was. For all p in a
part of [0, j] these windows lie in [k delta - e, k delta + l] (`Window`); for all p e = l = j. Time
is cut at k delta - e and k delta + l: between the cuts one command acts, within them first the old
and then the new one. What precedes a_k is a matter of old commands alone: nothing is circular.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING

from soter.certificate.grid.inward_flow import clipping, uncrossed_ends
from soter.certificate.grid.nonlinear_chains import DEPTH_MAX, NANOSECOND, LocalChain
from soter.certificate.reading.case_model import control_inputs
from soter.certificate.reading.linear_flows import (
    LinearFlow,
    exponential,
    integrals,
    is_linear,
    linear_flow,
)
from soter.certificate.reading.map_steps import atom_of, boxes_of, map_free, map_step
from soter.certificate.terms.arb_balls import HALF, ONE, UNIT, ZERO, exact, magnitude
from soter.certificate.terms.compile_terms import Sweep, compile_step
from soter.certificate.terms.terms import Linear, NotRecheckedError, Terms, half_sum

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flint import arb

    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.reading.linear_flows import Motion
    from soter.certificate.terms.compile_terms import Step


@dataclass(frozen=True, eq=False)
class Chain:
    """`first` takes a cell, `later` what came before; each gives a form and boxes met on the way.

    `last`: from the form before the last switch to the boxes it may then be in, None where that
    is simply the box of the form. A box is a flat tuple low, high, low, high, ...
    `bare`: first and later for parts of a set from which everything on the way was seen already:
    no boxes, and what must hold was shown.
    """

    dimension: int
    first: Step
    later: Step
    last: Step | None
    bare: tuple[Step, Step]


@dataclass(frozen=True, eq=False)
class FreeChain:
    """Any commands: `steps` of them one after the other, each giving the boxes met."""

    dimension: int
    steps: tuple[Step, ...]


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
    if model.facts.kind == "map":
        return (EVERY,)
    counts = count if model.facts.jitter_ns else 1
    paths = [path for read in model.facts.setting.by_sc for path in read.paths]
    by_age = by_age and len(paths) == 1 and is_linear(model, members)
    ages = count if by_age and model.facts.delay_ns else 1
    return tuple(Window(k, counts, age, ages) for k in range(counts) for age in range(ages))


def delays(model: CaseModel) -> tuple[int, int]:
    """D and j in ns: how old the sample behind a command is, how late a command may act."""
    return model.facts.delay_ns, model.facts.jitter_ns


def sc_chain(
    model: CaseModel, members: Sequence[int], pieces: int, window: Window = EVERY
) -> Chain:
    """The chain of a group, tubes cut into `pieces` a period."""
    if model.facts.kind == "map":
        step = map_step(model, members)
        return Chain(len(members), step, step, None, (step, step))
    if not is_linear(model, members):
        return _local_chain(model, members, pieces, window)
    chain = _FlowChain(model, members, pieces, window).chain()
    clip = clipping(model, members, uncrossed_ends(model, members))
    if clip is None:
        return chain
    last = None if chain.last is None else clip(chain.last)
    bare = clip(chain.bare[0]), clip(chain.bare[1])
    return Chain(chain.dimension, clip(chain.first), clip(chain.later), last, bare)


def _local_chain(model: CaseModel, members: Sequence[int], pieces: int, window: Window) -> Chain:
    """The same where the flow is not linear: nothing is compiled for good but rows."""
    d, j = delays(model)
    early, late = window.ends(j * NANOSECOND)
    times = (model.facts.times["delta_ns"] * NANOSECOND, d * NANOSECOND, early, late)
    local = LocalChain(model, members, uncrossed_ends(model, members), times)
    first, later = partial(local.first, pieces), partial(local.later, pieces)
    last = partial(local.last, pieces) if local.late else None
    return Chain(len(members), first, later, last, (first, later))


def free_phase(model: CaseModel, members: Sequence[int], time_ns: int, pieces: int) -> FreeChain:
    """Everything over [0, time] under any commands; for a map the instants within."""
    if model.facts.kind == "map":
        return FreeChain(len(members), map_free(model, members, time_ns))
    kept = uncrossed_ends(model, members)
    if not is_linear(model, members):
        none = Fraction(0)
        times = (model.facts.times["delta_ns"] * NANOSECOND, none, none, none)
        local = LocalChain(model, members, kept, times)
        time = exact(time_ns * NANOSECOND)
        return FreeChain(len(members), (partial(local.free, time, pieces),))
    flow = linear_flow(model, members).free()
    terms, states = model.new_terms()
    own = [states[i] for i in members]
    sweeps, _ = _sweeps(terms, flow, own, [], time_ns * NANOSECOND, pieces)
    step = _compiled(model, terms, members, own, [], sweeps)
    clip = clipping(model, members, kept)
    return FreeChain(len(members), (step if clip is None else clip(step),))


# ---------------------------------------------------------------- flows


def _moved(
    terms: Terms, motion: Motion, states: Sequence[Linear], controls: Sequence[Linear]
) -> list[Linear]:
    """The states at the times of a motion."""
    new_states = []
    for row, row_u, constant, noise in zip(
        motion.state, motion.control, motion.constant, motion.noise, strict=True
    ):
        x = terms.blurred([*row, *row_u], [*states, *controls])
        parts = [(ONE, x)]
        if not noise.is_zero():
            parts.append((ONE, terms.input("box", "noise", -noise, noise)))
        new_states.append(terms.combine(parts, constant))
    return new_states


def _sweeps(
    terms: Terms,
    flow: LinearFlow,
    states: Sequence[Linear],
    commands: Sequence[Linear],
    time: Fraction,
    pieces: int,
) -> tuple[list[Linear | Sweep], list[Linear]]:
    """The boxes met within a time under one command, and the states at its end."""
    sweeps: list[Linear | Sweep] = []
    start = list(states)
    for k in range(pieces if time else 0):
        at = time * (k + 1) / pieces
        end = _moved(terms, flow.motion(at, at), states, commands)
        acting = [(u,) for u in commands]
        sweeps.append(_sweep(flow, start, end, commands, acting, time / pieces))
        start = end
    return sweeps, start


def _sweep(
    flow: LinearFlow,
    starts: Sequence[Linear],
    ends: Sequence[Linear],
    commands: Sequence[Linear],
    acting: Sequence[tuple[Linear, ...]],
    time: Fraction,
    gaps: Sequence[tuple[Linear, list[arb]]] = (),
) -> Sweep:
    """Between two instants; `commands` act on the mean, up to `gaps`; `acting` at each instant."""
    motion = flow.motion(Fraction(0), time)
    drift, drift_constant, rate_constant = [], [], []
    for i in range(len(starts)):
        row = list(motion.state[i])
        row[i] -= ONE
        drift.append((*row, *motion.control[i], *(reach[i] for _, reach in gaps)))
        drift_constant.append(motion.constant[i] + motion.noise[i] * UNIT)
        size = sum((abs(x) for x in flow.noise[i]), ZERO)
        rate_constant.append(flow.constant[i] + size * UNIT)
    return Sweep(
        starts=tuple(starts),
        ends=tuple(ends),
        arguments=(*commands, *(gap for gap, _ in gaps)),
        drift=tuple(drift),
        drift_constant=tuple(drift_constant),
        commands=tuple(acting),
        rate=tuple((*a, *b) for a, b in zip(flow.a, flow.b, strict=True)),
        rate_constant=tuple(rate_constant),
        span=exact(time),
    )


def _compiled(
    model: CaseModel,
    terms: Terms,
    members: Sequence[int],
    states: Sequence[Linear],
    outputs: Sequence[Linear],
    ranges: Sequence[Linear | Sweep],
    others: Sequence[Linear] = (),
) -> Step:
    """`others`: all states, where those of other groups occur. Beyond the group's: commands."""
    boxes = boxes_of(model, others, members) if others else {}
    return compile_step(
        terms,
        [atom_of(x) for x in states],
        len(members),
        outputs,
        ranges=ranges,
        must=terms.obligations,
        boxes=boxes,
        memories=(len(states) - len(members), max(len(outputs) - len(members), 0)),
    )


class _FlowChain:
    """Builds the three steps of a chain of a linear flow."""

    def __init__(
        self, model: CaseModel, members: Sequence[int], pieces: int, window: Window
    ) -> None:
        self.model, self.members, self.pieces = model, list(members), pieces
        self.flow: LinearFlow = linear_flow(model, members)
        self.any: LinearFlow = self.flow.free()
        self.delta = model.facts.times["delta_ns"] * NANOSECOND
        d, j = delays(model)
        self.d = d * NANOSECOND
        self.early, late = window.ends(j * NANOSECOND)
        self.taken = window.taken(self.d)
        self.span = self.early + late
        """How long the old command or the new one may act."""
        if self.span > self.delta:
            raise NotRecheckedError("an SC whose jitter exceeds half its period")
        self.moves = [
            k
            for k in range(len(model.facts.controls))
            if any(not r[k].is_zero() for r in self.flow.b)
        ]
        """Controls that this group feels."""
        self.depth = int(-(-(self.d + self.span) // self.delta))
        """How many earlier commands may still matter when a command is computed."""
        if self.depth > DEPTH_MAX:
            raise NotRecheckedError("an SC that reads states much older than its period")

    def chain(self) -> Chain:
        """All of them."""
        (first, bare_first), (later, bare_later) = self._first(), self._later()
        bare = bare_first, bare_later
        return Chain(len(self.members), first, later, self._last(), bare)

    def _first(self) -> tuple[Step, Step]:
        """From a_0 to delta - e."""
        terms, states = self.model.new_terms()
        own = [states[i] for i in self.members]
        sampled = own
        if self.d:
            sampled = self._in_window(terms, self.any, self.taken, own, [])
        commands = self._commands(terms, states, sampled)
        tube, after = _sweeps(terms, self.flow, own, commands, self.delta - self.early, self.pieces)
        before = [control_inputs(self.model.facts, terms) for _ in range(1, self.depth)]
        outputs = after + self._remembered([commands, *before])  # what acted before a_0: anything
        return self._both(terms, own, outputs, tube, states)

    def _later(self) -> tuple[Step, Step]:
        """From k delta - e to (k + 1) delta - e."""
        terms, states = self.model.new_terms()
        own = [states[i] for i in self.members]
        old = [self._old_commands(terms) for _ in range(max(self.depth, 1))]
        sampled = self._sampled(terms, own, old)
        commands = self._commands(terms, states, sampled)
        current = own
        tube: list[Linear | Sweep] = []
        if self.span:
            current, sweep = self._switched(terms, own, old[0], commands)
            tube.append(sweep)
        rest = self.delta - self.span
        sweeps, after = _sweeps(terms, self.flow, current, commands, rest, self.pieces)
        tube += sweeps
        inputs = own + self._remembered(old)
        outputs = after + self._remembered([commands, *old])
        return self._both(terms, inputs, outputs, tube, states)

    def _both(
        self,
        terms: Terms,
        inputs: Sequence[Linear],
        outputs: Sequence[Linear],
        tube: Sequence[Linear | Sweep],
        states: Sequence[Linear],
    ) -> tuple[Step, Step]:
        """With the boxes on the way and what must hold, and without."""
        full = _compiled(self.model, terms, self.members, inputs, outputs, tube, states)
        terms.obligations = []
        bare = _compiled(self.model, terms, self.members, inputs, outputs, [], states)
        return full, bare

    def _sampled(
        self, terms: Terms, own: Sequence[Linear], old: Sequence[Sequence[Linear]]
    ) -> list[Linear]:
        """The states at the sample: from d before to e + l after k delta - e.

        Relative to that instant the i-th command before (1: the latest) acts, with w = e + l, at
        least over [-i delta + w, -(i - 1) delta]: in [-(i + 1) delta + w, -i delta + w] it is the
        (i + 1)th, or, in the latest w of that, the ith. What these differ from the latest counts
        for as long as they may have acted within the window.
        """
        if not self.depth:
            return list(own)
        moved = self._in_window(terms, self.flow, (-self.d, self.span), own, old[0])
        lengths = [Fraction(0)] * (self.depth + 1)
        for i in range(1, self.depth):
            reach = self.d + self.span - i * self.delta
            lengths[i + 1] += max(Fraction(0), min(reach, self.delta))
            if i > 1:
                lengths[i] += max(Fraction(0), min(reach, self.span))
        samples = []
        backs = [self._longest(k) for k in range(len(old[0]))]
        for i, x in enumerate(moved):
            parts = [(ONE, x)]
            for at, length in enumerate(lengths):
                for k, u in enumerate(old[0]):
                    if length and not backs[k][i].is_zero():
                        gap = terms.subtract(old[at - 1][k], u)
                        parts.append((ONE, terms.spread([backs[k][i] * exact(length)], [gap])))
            samples.append(terms.combine(parts))
        return samples

    def _longest(self, k: int) -> list[arb]:
        """How fast a command moves each state at most, as seen from up to d later."""
        column = [row[k] for row in self.flow.b]
        if all(x.is_zero() for x in column):
            return [ZERO] * len(column)
        over = exponential(self.flow.a, -self.d, Fraction(0))
        return [
            magnitude(sum((e * b for e, b in zip(row, column, strict=True)), ZERO)) for row in over
        ]

    def _in_window(
        self,
        terms: Terms,
        flow: LinearFlow,
        times: tuple[Fraction, Fraction],
        own: Sequence[Linear],
        commands: Sequence[Linear],
    ) -> list[Linear]:
        """The states at any time between two, under one command.

        x(s) = x + (integral of e^{At} over [0, s]) (A x + B u + c) +- noise.
        """
        rates = []
        for a, b, c in zip(flow.a, flow.b, flow.constant, strict=True):
            parts = [(f, x) for f, x in zip((*a, *b), (*own, *commands), strict=True)]
            rates.append(terms.combine([(f, x) for f, x in parts if not f.is_zero()], c))
        window = integrals(flow.a, *times)
        noise = flow.motion(*times).noise
        states = []
        for i, x in enumerate(own):
            parts = [(ONE, x), (ONE, terms.blurred(window[i], rates))]
            if not noise[i].is_zero():
                parts.append((ONE, terms.input("box", "noise", -noise[i], noise[i])))
            states.append(terms.combine(parts))
        return states

    def _last(self) -> Step | None:
        """From N delta - e over [0, e + l], the last command still acting."""
        if not self.span:
            return None
        terms, states = self.model.new_terms()
        own = [states[i] for i in self.members]
        old = [self._old_commands(terms) for _ in range(self.depth)]
        over, _ = _sweeps(terms, self.flow, own, old[0], self.span, self.pieces)
        inputs = own + self._remembered(old)
        return _compiled(self.model, terms, self.members, inputs, [], over)

    # ------------------------------------------------------------ parts

    def _old_commands(self, terms: Terms) -> list[Linear]:
        """The command that acts already: part of the form for controls that matter."""
        commands = []
        for k, c in enumerate(self.model.facts.controls):
            kind = "state" if k in self.moves else "box"
            commands.append(terms.input(kind, c.name, exact(c.low), exact(c.high)))
        return commands

    def _commands(
        self, terms: Terms, states: Sequence[Linear], sampled: Sequence[Linear]
    ) -> list[Linear]:
        """SC's answer to a sample of the own states; those of other groups: anything."""
        at = list(states)
        for i, x in zip(self.members, sampled, strict=True):
            at[i] = x
        return self.model.commands(terms, at)

    def _remembered(self, latest: Sequence[Sequence[Linear]]) -> list[Linear]:
        """The commands that a form carries along: those that this group feels."""
        return [commands[k] for commands in latest[: self.depth] for k in self.moves]

    def _command_noise(self, k: int, time: Fraction) -> list[arb]:
        """What a command adds at most that is anything in [-1, 1] all the time."""
        column = [[row[k]] for row in self.flow.b]
        none = [ZERO] * len(column)
        if all(r[0].is_zero() for r in column):
            return none
        empty: list[list[arb]] = [[] for _ in column]
        only = LinearFlow(self.flow.members, self.flow.a, empty, none, column, ())
        return only.motion(time, time).noise

    def _switched(
        self,
        terms: Terms,
        states: Sequence[Linear],
        old: Sequence[Linear],
        new: Sequence[Linear],
    ) -> tuple[list[Linear], Sweep]:
        """First one command and then another: their mean, and as noise half of what they differ."""
        span = self.span
        means = [half_sum(terms, u, v) for u, v in zip(old, new, strict=True)]
        gaps = []
        for k, (u, v) in enumerate(zip(old, new, strict=True)):
            gap = terms.spread([HALF], [terms.subtract(u, v)])
            gaps.append((gap, self._command_noise(k, span)))
        moved = _moved(terms, self.flow.motion(span, span), states, means)
        after = []
        for i, x in enumerate(moved):
            noise = [(ONE, terms.spread([reach[i]], [gap])) for gap, reach in gaps]
            after.append(terms.combine([(ONE, x), *noise]))
        acting = list(zip(old, new, strict=True))
        return after, _sweep(self.flow, states, after, means, acting, span, gaps)
