"""Chains of SC periods and free phases, compiled for the states of one group.

Purpose: `Chain`: functions that enclose what SC makes of a cell, period by period, delays, jitter,
errors and disturbances inside; `FreePhase`: what any command makes of it (docs/verification.md,
section 3).
Non-goals: which cells, and whether what comes out lies in a set (`inclusion.py`).

SC acts at a_0 = 0 and a_k in [k delta - j, k delta + j], on a sample taken at most d before. Time
is cut at k delta - j and k delta + j: between the cuts one command acts, within them first the old
and then the new one. What precedes a_k is a matter of old commands alone: nothing is circular.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from soter.recheck.balls import HALF, ONE, UNIT, ZERO, exact
from soter.recheck.compile_terms import Drift, compile_step
from soter.recheck.flows import LinearFlow, linear_flow
from soter.recheck.model import control_inputs
from soter.recheck.terms import Linear, NotRecheckedError, Terms, half_sum

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flint import arb

    from soter.recheck.compile_terms import Step
    from soter.recheck.flows import Motion
    from soter.recheck.model import Model

NANOSECOND = Fraction(1, 10**9)


@dataclass(frozen=True, eq=False)
class Chain:
    """`first` takes a cell, `later` what came before; each gives a form and boxes met on the way.

    `last`: from the form before the last switch to the boxes it may then be in, None where that
    is simply the box of the form. A box is a flat tuple low, high, low, high, ...
    """

    dimension: int
    first: Step
    later: Step
    last: Step | None


@dataclass(frozen=True, eq=False)
class FreePhase:
    """Any commands: `steps` of them one after the other, each giving the boxes met."""

    dimension: int
    steps: tuple[Step, ...]


def delays(model: Model) -> tuple[int, int]:
    """D and j in ns: how old the sample behind a command is, how late a command may act."""
    t = model.facts.times
    if model.facts.kind == "map":
        return 0, 0
    late = t["R_sc_ns"] + t["L_ns"]
    return t["A_sc_ns"] + late, t["J_sc_ns"] + late


def sc_chain(model: Model, members: Sequence[int], pieces: int) -> Chain:
    """The chain of a group, tubes cut into `pieces` a period."""
    if model.facts.kind == "map":
        step = _map_step(model, members)
        return Chain(len(members), step, step, None)
    return _FlowChain(model, members, pieces).chain()


def free_phase(model: Model, members: Sequence[int], time_ns: int, pieces: int) -> FreePhase:
    """Everything over [0, time] under any commands; for a map the instants within."""
    if model.facts.kind == "map":
        return _free_map(model, members, time_ns)
    flow = linear_flow(model, members).free()
    total = time_ns * NANOSECOND
    steps = []
    for k in range(pieces):
        terms, states = model.new_terms()
        own = [states[i] for i in members]
        motion = flow.motion(total * k / pieces, total * (k + 1) / pieces)
        tube = _moved(terms, motion, own, [])
        steps.append(_compiled(model, terms, members, own, [], tube))
    return FreePhase(len(members), tuple(steps))


# ---------------------------------------------------------------- maps


def _boxes(
    model: Model, states: Sequence[Linear], members: Sequence[int]
) -> dict[int, tuple[arb, arb]]:
    """States of other groups range over their grids."""
    found = {}
    for i, x in enumerate(states):
        if i not in members:
            (atom,) = x.terms
            low, high = model.extents[i]
            found[atom] = (exact(low), exact(high))
    return found


def _atom(x: Linear) -> int:
    (found,) = x.terms
    return found


def _map_step(model: Model, members: Sequence[int]) -> Step:
    """One period of SC: so many steps of the map under one command."""
    terms, states = model.new_terms()
    commands = model.commands(terms, states)
    count = model.facts.times["delta_ns"] // model.facts.plants[0].period_ns
    current, between = states, []
    for _ in range(count):
        current = model.next_states(terms, current, commands)
        between += [current[i] for i in members]
    return compile_step(
        terms,
        [_atom(states[i]) for i in members],
        len(members),
        [current[i] for i in members],
        ranges=between,
        must=terms.obligations,
        boxes=_boxes(model, states, members),
    )


def _free_map(model: Model, members: Sequence[int], time_ns: int) -> FreePhase:
    period = model.facts.plants[0].period_ns
    terms, states = model.new_terms()
    commands = control_inputs(model.facts, terms)
    after = model.next_states(terms, states, commands)
    step = compile_step(
        terms,
        [_atom(states[i]) for i in members],
        len(members),
        [after[i] for i in members],
        ranges=[after[i] for i in members],
        must=terms.obligations,
        boxes=_boxes(model, states, members),
    )
    return FreePhase(len(members), (step,) * -(-time_ns // period))


# ---------------------------------------------------------------- flows


def _moved(
    terms: Terms, motion: Motion, states: Sequence[Linear], controls: Sequence[Linear]
) -> list[Linear]:
    """The states at the times of a motion."""
    found = []
    for row, row_u, constant, noise in zip(
        motion.state, motion.control, motion.constant, motion.noise, strict=True
    ):
        x = terms.blurred([*row, *row_u], [*states, *controls])
        parts = [(ONE, x)]
        if not noise.is_zero():
            parts.append((ONE, terms.input("box", "noise", -noise, noise)))
        found.append(terms.combine(parts, constant))
    return found


def _compiled(
    model: Model,
    terms: Terms,
    members: Sequence[int],
    states: Sequence[Linear],
    outputs: Sequence[Linear],
    ranges: Sequence[Linear | Drift],
    others: Sequence[Linear] = (),
) -> Step:
    """`others`: all states, where those of other groups occur. Beyond the group's: commands."""
    boxes = _boxes(model, others, members) if others else {}
    return compile_step(
        terms,
        [_atom(x) for x in states],
        len(members),
        outputs,
        ranges=ranges,
        must=terms.obligations,
        boxes=boxes,
        memories=(len(states) - len(members), max(len(outputs) - len(members), 0)),
    )


class _FlowChain:
    """Builds the three steps of a chain of a linear flow."""

    def __init__(self, model: Model, members: Sequence[int], pieces: int) -> None:
        self.model, self.members, self.pieces = model, list(members), pieces
        self.flow: LinearFlow = linear_flow(model, members)
        self.any: LinearFlow = self.flow.free()
        self.delta = model.facts.times["delta_ns"] * NANOSECOND
        d, j = delays(model)
        self.d, self.j = d * NANOSECOND, j * NANOSECOND
        if 2 * self.j > self.delta:
            raise NotRecheckedError("an SC whose jitter exceeds half its period")
        self.moves = [
            k
            for k in range(len(model.facts.controls))
            if any(not r[k].is_zero() for r in self.flow.b)
        ]
        """Controls that this group feels."""
        self.remembers = bool(self.d or self.j)

    def chain(self) -> Chain:
        """All three."""
        return Chain(len(self.members), self._first(), self._later(), self._last())

    def _first(self) -> Step:
        """From a_0 to delta - j."""
        terms, states = self.model.new_terms()
        own = [states[i] for i in self.members]
        sampled = own
        if self.d:
            sampled = _moved(terms, self.any.motion(-self.d, Fraction(0)), own, [])
        commands = self._commands(terms, states, sampled)
        tube = self._tube(terms, own, commands, self.delta - self.j)
        after = _moved(terms, self._at(self.delta - self.j), own, commands)
        outputs = after + ([commands[k] for k in self.moves] if self.remembers else [])
        return _compiled(self.model, terms, self.members, own, outputs, tube, states)

    def _later(self) -> Step:
        """From k delta - j to (k + 1) delta - j."""
        terms, states = self.model.new_terms()
        own = [states[i] for i in self.members]
        old = self._old_commands(terms)
        sampled = own
        if self.remembers:
            window = (-self.d, 2 * self.j)
            if self.d + 2 * self.j <= self.delta:
                sampled = _moved(terms, self.flow.motion(*window), own, old)
            else:
                sampled = _moved(terms, self.any.motion(*window), own, [])
        commands = self._commands(terms, states, sampled)
        current = own
        tube: list[Linear | Drift] = []
        if self.j:
            span = 2 * self.j
            mixed = []
            for u, v in zip(old, commands, strict=True):
                gap = terms.subtract(u, v)
                either = terms.spread([HALF], [gap])
                mixed.append((half_sum(terms, u, v), either))
            if self.pieces == 1:
                tube += self._drift(own, old, span, mixed)
            else:
                tube += self._mixed(terms, own, mixed, Fraction(0), span)
            current = self._mixed(terms, own, mixed, span, span)
        rest = self.delta - 2 * self.j
        tube += self._tube(terms, current, commands, rest)
        after = _moved(terms, self._at(rest), current, commands)
        remembered = [commands[k] for k in self.moves] if self.remembers else []
        inputs = own + ([old[k] for k in self.moves] if self.remembers else [])
        return _compiled(self.model, terms, self.members, inputs, after + remembered, tube, states)

    def _last(self) -> Step | None:
        """From N delta - j over [0, 2j], the last command still acting."""
        if not self.j:
            return None
        terms, states = self.model.new_terms()
        own = [states[i] for i in self.members]
        old = self._old_commands(terms)
        over = _moved(terms, self.flow.motion(Fraction(0), 2 * self.j), own, old)
        inputs = own + [old[k] for k in self.moves]
        return _compiled(self.model, terms, self.members, inputs, [], over)

    # ------------------------------------------------------------ parts

    def _at(self, time: Fraction) -> Motion:
        return self.flow.motion(time, time)

    def _old_commands(self, terms: Terms) -> list[Linear]:
        """The command that acts already: part of the form for controls that matter."""
        found = []
        for k, c in enumerate(self.model.facts.controls):
            kind = "state" if k in self.moves else "box"
            found.append(terms.input(kind, c.name, exact(c.low), exact(c.high)))
        return found

    def _commands(
        self, terms: Terms, states: Sequence[Linear], sampled: Sequence[Linear]
    ) -> list[Linear]:
        """SC's answer to a sample of the own states; those of other groups: anything."""
        at = list(states)
        for i, x in zip(self.members, sampled, strict=True):
            at[i] = x
        return self.model.commands(terms, at)

    def _tube(
        self,
        terms: Terms,
        states: Sequence[Linear],
        commands: Sequence[Linear],
        time: Fraction,
    ) -> list[Linear | Drift]:
        if self.pieces == 1:
            return self._drift(states, commands, time) if time else []
        found: list[Linear | Drift] = []
        for k in range(self.pieces if time else 0):
            piece = self.flow.motion(time * k / self.pieces, time * (k + 1) / self.pieces)
            found += _moved(terms, piece, states, commands)
        return found

    def _drift(
        self,
        states: Sequence[Linear],
        commands: Sequence[Linear],
        time: Fraction,
        mixed: Sequence[tuple[Linear, Linear]] = (),
    ) -> list[Linear | Drift]:
        """The tube as the states and what is added to them at most."""
        motion = self.flow.motion(Fraction(0), time)
        used = [middle for middle, _ in mixed] if mixed else list(commands)
        found: list[Linear | Drift] = []
        for i, x in enumerate(states):
            row = list(motion.state[i])
            row[i] -= ONE
            gaps = [self._command_noise(k, time)[i] for k in range(len(mixed))]
            coefficients = (*row, *motion.control[i], *gaps)
            arguments = (*states, *used, *(gap for _, gap in mixed))
            constant = motion.constant[i] + motion.noise[i] * UNIT
            found.append(Drift(x, coefficients, arguments, constant))
        return found

    def _command_noise(self, k: int, time: Fraction) -> list[arb]:
        """What a command adds at most that is anything in [-1, 1] all the time."""
        column = [[row[k]] for row in self.flow.b]
        none = [ZERO] * len(column)
        if all(r[0].is_zero() for r in column):
            return none
        empty: list[list[arb]] = [[] for _ in column]
        only = LinearFlow(self.flow.members, self.flow.a, empty, none, column, ())
        return only.motion(time, time).noise

    def _mixed(
        self,
        terms: Terms,
        states: Sequence[Linear],
        mixed: Sequence[tuple[Linear, Linear]],
        start: Fraction,
        end: Fraction,
    ) -> list[Linear]:
        """First one command and then another: their mean, and as noise half of what they differ."""
        moved = _moved(terms, self.flow.motion(start, end), states, [middle for middle, _ in mixed])
        found = []
        for i, x in enumerate(moved):
            parts = [(ONE, x)]
            for k, (_, either) in enumerate(mixed):
                reach = self._command_noise(k, end)[i]
                parts.append((ONE, terms.spread([reach], [either])))
            found.append(terms.combine(parts))
        return found
