"""Whether an estimate of a flight is good, checked again by a tube in Arb.

Purpose: `ModuleTube`: a module, read once; `good` follows SC from an estimate as
"Decisions by tubes" (proof-flight.md) has it, and gives a reason where it is not certain that SC
ends at rest within C.
Non-goals: what is shown beforehand (`rest_claims.py`).

The argument: let s be the instant of the estimate, x^. Any command acts until a_0 in [s + alpha,
s + H]. That window is cut, and of each part all states at some instant of it are followed by
themselves: every fall-back run is in one of these tubes. On all boxes that are met C is certain,
until some a_N: all states in which output N begins to act are in Q, and what rest may move them to
is in C. Parts where that does not come out are cut again, with shorter steps. Boxes are cut off at
ends of sets that no run crosses (`grid/inward_flow.py`): that they lie in C is what is asked.
"""

from __future__ import annotations

from functools import reduce
from math import inf, isfinite
from typing import TYPE_CHECKING

import flint
from flint import arb

from soter.certificate.grid.inward_flow import uncrossed_ends
from soter.certificate.reading.symbolic_operations import filled, flat
from soter.certificate.terms.arb_balls import UNIT_ROUNDOFF, exact
from soter.certificate.terms.straight_line import NotCertainError
from soter.certificate.tubes.rest_problem import (
    NANOSECOND,
    WIDE,
    RestModel,
    constraint,
)
from soter.certificate.tubes.tube_chains import Body, Truths, TubeChain, TubeFlow

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from fractions import Fraction

    from soter.certificate.tubes.rest_problem import Range, RestProblem
    from soter.certificate.tubes.tube_chains import Box
    from soter.language.model.types import Value

CUTS = 4
"""How often a part of the window is halved."""
PIECES = (1, 1, 2, 4, 8)
"""Into how many steps a hold is cut, by how often its part of the window was."""
FREE_PIECES = 4
BEYOND, FINE = arb(2) ** 1100, 1400
"""More than any number that is published, and bits that tell it from its neighbours."""


class ModuleTube:
    """Tubes of a module that was read.

    `ways`: of states that its `moves` does not name where they are once it rests (Y); without them
    it rests only where no condition reads these.
    """

    def __init__(self, problem: RestProblem, ways: Mapping[int, Range]) -> None:
        self.problem, self.ways = problem, dict(ways)
        facts, members = problem.facts, problem.followed
        model = RestModel(facts, (), facts.extents)
        self._seen: list[str] | None = None
        self._within(problem.first_map)
        self.rest = Truths(
            model, members, lambda t, x: model.predicate(t, x, problem.rest.condition, errors=False)
        )
        flow = TubeFlow(model, members, uncrossed_ends(model, members))
        self.chain = TubeChain(model, members, flow, problem.times.holds)

    @property
    def reads(self) -> list[str]:
        """What an estimate is made of, as `topic.field`, in the order of the states; and maps."""
        maps = [name for names in self.problem.map_leaves.values() for name in names]
        return [*(self.problem.leaf(s) for s in self.problem.followed), *maps]

    @property
    def judges(self) -> bool:
        """Whether its DM looks at commands, too: then more is good than what is good here.

        What is good here is good with any command, until the next verdict is in force.
        """
        return self.problem.facts.symbol.shield is not None

    def good(self, estimate: Mapping[str, float]) -> str | None:
        """None where the estimate is good, else why that is not certain."""
        box, maps = [], {}
        for index, names in self.problem.map_leaves.items():
            numbers = [estimate[name] for name in names]
            if not all(isfinite(x) for x in numbers):
                return f"a number of `{self.problem.facts.system.topics[index].name}` is none"
            maps[index] = filled(self.problem.facts.system.topics[index].type, numbers)
        self._within(maps)
        for s in self.problem.followed:
            x, error = exact(estimate[self.problem.leaf(s)]), exact(self.problem.error(s))
            if not x.is_finite():
                return f"`{self.problem.leaf(s)}` is no number"
            error += (abs(x) + error) * UNIT_ROUNDOFF * 2  # a sensor rounds the sum
            box.append((x - error, x + error))
        times = self.problem.times
        return self.followed(box, times.alpha, times.horizon)

    def starts(self) -> str | None:
        """The same of every start: until h_0 anything acts."""
        states, times = self.problem.facts.states, self.problem.times
        box = [(exact(states[s].low), exact(states[s].high)) for s in self.problem.followed]
        self._within(self.problem.first_map)
        return self.followed(box, times.start_alpha, times.start)

    def _within(self, maps: Mapping[int, Value]) -> None:
        """C is that of these maps from here on."""
        seen = [x.hex() for of in maps.values() for x in flat(of)]
        if seen != self._seen:
            model = RestModel(self.problem.facts, (), self.problem.facts.extents, known=maps)
            self._seen = seen
            self.constraint = Truths(
                model, self.problem.followed, lambda t, x: constraint(model, t, x)
            )

    # ------------------------------------------------------------ tubes

    def followed(self, box: Box, earliest: int, latest: int) -> str | None:
        """None where SC, acting first in [earliest, latest] ns, ends at rest from all of `box`."""
        if not self.stays(box):
            return "C is not certain of the estimate itself"
        body, step = Body.of(box), earliest * NANOSECOND / FREE_PIECES
        try:
            for _ in range(FREE_PIECES if earliest else 0):
                body, boxes = self.chain.anything(body, step)
                if not self.stay(boxes):
                    return "any command may lead out of C before SC acts"
        except NotCertainError:
            return "where any command leads before SC acts is not known"
        return self._window(body, (latest - earliest) * NANOSECOND, 0)

    def _window(self, body: Body, span: Fraction, cut: int) -> str | None:
        """From `body` on an output of SC begins to act within `span`."""
        try:
            inside = self.chain.window(body, span) if span else body
            why = None
            if not self.stays(inside.box):
                why = "any command may lead out of C before SC acts"
            why = why or self._settles(inside, PIECES[cut])
            if why is None or cut == CUTS:
                return why
            if not span:
                return self._window(body, span, cut + 1)
            middle, _ = self.chain.anything(body, span / 2)
            return self._window(body, span / 2, cut + 1) or self._window(middle, span / 2, cut + 1)
        except NotCertainError:
            return "a tube has no end"

    def _settles(self, body: Body, pieces: int) -> str | None:
        """From an output of SC on, that acts in `body`."""
        if self.at_rest(body.box):
            return None
        late = bool(self.chain.span)
        for n in range(self.problem.times.switches + 1):
            if n and not late and self.at_rest(body.box):
                return None
            body, boxes = self.chain.hold(body, pieces)
            if n and late:  # the first box has all states in which this output begins to act
                first, *boxes = boxes
                if self.stays(first) and self.at_rest(first):
                    return None
                boxes = [first, *boxes]
            if not self.stay(boxes):
                return f"SC may lead out of C within {n + 1} of its steps"
        return "SC is not certainly at rest in time"

    def stays(self, box: Box) -> bool:
        """Whether all of a box is in C, and where it is known which ends no run crosses."""
        near = all(low >= -WIDE and high <= WIDE for low, high in box)
        return near and self.constraint.certain(box)

    def stay(self, boxes: Sequence[Box]) -> bool:
        """Whether all of these boxes are: one around them is asked first, as one is cheaper."""
        sides = [zip(*of_state, strict=True) for of_state in zip(*boxes, strict=True)]
        around = [(reduce(arb.min, lows), reduce(arb.max, highs)) for lows, highs in sides]
        return self.stays(around) or (len(boxes) > 1 and all(map(self.stays, boxes)))

    def at_rest(self, box: Box) -> bool:
        """Whether all of a box is in Q, and what rest may move it to in C."""
        if not self.rest.certain(box):
            return False
        moved, endless = [], False
        for s, (low, high) in zip(self.problem.followed, box, strict=True):
            drift, way = self.problem.drifts.get(s), self.ways.get(s)
            if drift is not None:
                below, above = drift
                endless = endless or inf in drift
                moved.append(
                    (
                        -BEYOND if below == inf else low - exact(below),
                        BEYOND if above == inf else high + exact(above),
                    )
                )
            elif way is not None:
                moved.append((exact(way[0]), exact(way[1])))
            else:
                endless = True
                moved.append((-BEYOND, BEYOND))
        precision = flint.ctx.prec
        try:
            if endless:
                flint.ctx.prec = FINE
            return self.constraint.certain(moved)
        finally:
            flint.ctx.prec = precision
