"""Measures how far a predicate is from changing, on values of what it reads.

Purpose: `PredicateMargins` compiles a predicate to a `Distance`, one number in place of a truth:
above zero where the predicate holds, below where it does not. It is as far from zero as the nearest
comparison is from changing (`a < b`: b - a, in their unit), and the `Distance` names this
comparison. && takes the least, || the greatest, ! the negation; where a function decides by `if`,
every condition counts.
Non-goals: C; margins between instants.

A bool or an equality has no distance: it is infinitely far. Distances in different units are
compared as numbers, so a `Distance` says of which comparison it is.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from soter.language.evaluate.arithmetic import StepFault
from soter.language.model import typed as t
from soter.language.model.tree_walk import nodes

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.evaluate.environment import Environment
    from soter.language.evaluate.statements import Evaluator
    from soter.language.model.types import Value
    from soter.report.judged_curves import Compared


TEXT_MAX = 70
COMPARED = ("<", "<=", ">", ">=")


class Distance(NamedTuple):
    """A predicate's distance from changing; `bound`: its comparison's index in `bounds`, or -1."""

    far: float
    bound: int


Far = (Distance(math.inf, -1), Distance(-math.inf, -1))


class PredicatePosition(NamedTuple):
    """A place in a predicate: the calls that lead to it, and its effect on the predicate.

    `sense`: more distance is further from failing (1.0), nearer to failing (-1.0) or either (0.0).
    """

    calls: tuple[str, ...] = ()
    sense: float = 1.0


ROOT = PredicatePosition()


class PredicateMargins:
    """Margins of the predicates of one scope, compiled once.

    `bounds`: every comparison as it is written, and the calls that led there. `sides`: for each
    bound the value last compared, and the band in which it should lie. `seen`: for each bound its
    last distance, times its `sense`.
    """

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator
        self.bounds: list[tuple[str, tuple[str, ...]]] = []
        self._labels: list[str] = []
        self.seen: dict[int, float] = {}
        self.sides: dict[int, tuple[float, ...]] = {}
        self.curves: list[t.TypedExpr] = []
        """For each bound the side that is drawn: the left one, unless it is constant."""

    def distance_of(
        self, e: t.TypedExpr, at: PredicatePosition = ROOT
    ) -> Callable[[Environment], Distance]:
        """Gives the function from an environment to a predicate's distance; both fault alike."""
        if isinstance(e, t.TypedBinary) and e.op in ("&&", "||"):
            return self._distance_of_connective(e, at)
        if isinstance(e, t.TypedBinary) and e.op in COMPARED:
            return self._distance_of_comparison(e, at)
        if isinstance(e, t.TypedUnary) and e.op == "!":
            inner = self.distance_of(e.operand, at._replace(sense=-at.sense))
            return lambda env: _negated_distance(inner(env))
        if isinstance(e, t.Conditional):
            asked = self.distance_of(e.condition, at._replace(sense=0.0))
            then = self.distance_of(e.then, at)
            otherwise = self.distance_of(e.otherwise, at)
            return lambda env: _returned_distance(
                [c := asked(env)], (then if _holds(c) else otherwise)(env)
            )
        if isinstance(e, t.TypedCall) and not e.fun.extern and e.fun.body is not None:
            return self._distance_of_call(e, at)
        value = self._evaluator.compiled(e)
        return lambda env: Far[0] if value(env) else Far[1]

    def compared_signal(self, bound: int) -> Compared:
        """The text, unit and label of the side of a comparison that varies, for a drawing."""
        e = self.curves[bound]
        return _expression_text(e), getattr(e.type, "unit", ""), f"`{self.label_of_bound(bound)}`"

    def label_of_bound(self, bound: int) -> str:
        """The text of a comparison, with the calls that distinguish it from equal texts."""
        if len(self._labels) != len(self.bounds):
            self._labels = [self._label_of_comparison(*b) for b in self.bounds]
        return self._labels[bound]

    def _label_of_comparison(self, text: str, calls: tuple[str, ...]) -> str:
        others = [c for t_, c in self.bounds if t_ == text and c != calls]
        labels: list[str] = []
        for depth, call in enumerate(calls):
            if not others:
                break
            if any(c[depth : depth + 1] != (call,) for c in others):
                labels.append(call)
                others = [c for c in others if c[depth : depth + 1] == (call,)]
        return ": ".join((*labels, text))

    def _distance_of_connective(
        self, e: t.TypedBinary, at: PredicatePosition
    ) -> Callable[[Environment], Distance]:
        """The distance of `&&` or `||`; a fault on the right counts if the left does not decide."""
        left, right = self.distance_of(e.left, at), self.distance_of(e.right, at)
        choose = max if e.op == "||" else min

        def connective_distance(env: Environment) -> Distance:
            a = left(env)
            try:
                b = right(env)
            except StepFault:
                if _holds(a) == (choose is max):
                    return a
                raise
            return choose(a, b, key=_sort_key)

        return connective_distance

    def _distance_of_comparison(
        self, e: t.TypedBinary, at: PredicatePosition
    ) -> Callable[[Environment], Distance]:
        left, right = self._evaluator.compiled(e.left), self._evaluator.compiled(e.right)
        holds = self._evaluator.compiled(e)
        bound, seen = len(self.bounds), self.seen
        self.bounds.append((_expression_text(e), at.calls))
        self.curves.append(e.left if _varies(e.left) else e.right)
        first, sides = self.curves[-1] is e.left, self.sides
        sign = 1.0 if e.op in ("<", "<=") else -1.0
        above = (at.sense * sign < 0) == first

        def comparison_distance(env: Environment) -> Distance:
            a, b = float(left(env)), float(right(env))
            far = sign * (b - a)
            if far == 0.0 or math.isnan(far):
                size = 0.0 if far == 0.0 else math.inf
                far = size if holds(env) else -size
            if at.sense:
                seen[bound] = at.sense * far
                value, end = (a, b) if first else (b, a)
                band = (end, math.inf) if above else (-math.inf, end)
                sides[bound] = (value, *band)
            return Distance(far, bound)

        return comparison_distance

    def _distance_of_call(
        self, e: t.TypedCall, at: PredicatePosition
    ) -> Callable[[Environment], Distance]:
        arguments = [self._evaluator.compiled(a) for a in e.arguments]
        body = self._compiled_block(
            e.fun.body or (), PredicatePosition((*at.calls, _expression_text(e)), at.sense)
        )
        parameters = e.fun.parameters

        def call_distance(env: Environment) -> Distance:
            values = [a(env) for a in arguments]
            outside = env.variables
            env.variables = dict(zip(parameters, values, strict=True))
            try:
                way: list[Distance] = []
                distance = body(env, way)
                assert distance is not None
                return _returned_distance(way, distance)
            finally:
                env.variables = outside

        return call_distance

    def _compiled_block(
        self, statements: tuple[t.TypedStmt, ...], at: PredicatePosition
    ) -> Callable[[Environment, list[Distance]], Distance | None]:
        """Compiles statements to a function that gives what they return and collects conditions."""
        steps = [self._compiled_statement(s, at) for s in statements]

        def run(env: Environment, way: list[Distance]) -> Distance | None:
            for step in steps:
                distance = step(env, way)
                if distance is not None:
                    return distance
            return None

        return run

    def _compiled_statement(
        self, s: t.TypedStmt, at: PredicatePosition
    ) -> Callable[[Environment, list[Distance]], Distance | None]:
        if isinstance(s, t.TypedReturn):
            value = self.distance_of(s.value, at)
            return lambda env, _way: value(env)
        if isinstance(s, t.TypedIf):
            return self._compiled_branches(s, at)
        if isinstance(s, (t.ForRange, t.ForEach)):
            return self._compiled_loop(s, at)
        step = self._evaluator.compiled_block([s])

        def run(env: Environment, _way: list[Distance]) -> None:
            step(env)

        return run

    def _compiled_branches(
        self, s: t.TypedIf, at: PredicatePosition
    ) -> Callable[[Environment, list[Distance]], Distance | None]:
        asked = at._replace(sense=0.0)
        arms = [(self.distance_of(c, asked), self._compiled_block(body, at)) for c, body in s.arms]
        otherwise = self._compiled_block(s.otherwise, at)

        def choose(env: Environment, way: list[Distance]) -> Distance | None:
            for condition, body in arms:
                distance = condition(env)
                way.append(distance)
                if _holds(distance):
                    return body(env, way)
            return otherwise(env, way)

        return choose

    def _compiled_loop(
        self, s: t.ForRange | t.ForEach, at: PredicatePosition
    ) -> Callable[[Environment, list[Distance]], Distance | None]:
        body = self._compiled_block(s.body, at)
        items: Callable[[Environment], Value]
        if isinstance(s, t.ForRange):
            rounds = range(s.low, s.high)
            items = lambda _env: rounds  # noqa: E731
        else:
            items = self._evaluator.compiled(s.sequence)

        def run_loop(env: Environment, way: list[Distance]) -> Distance | None:
            for item in items(env):
                env.variables[s.variable] = item
                distance = body(env, way)
                if distance is not None:
                    return distance
            return None

        return run_loop


def _holds(d: Distance) -> bool:
    """Whether the predicate with this distance holds; -0.0 means that it just fails."""
    return math.copysign(1.0, d.far) > 0


def _sort_key(d: Distance) -> tuple[float, float]:
    return d.far, math.copysign(1.0, d.far)


def _negated_distance(d: Distance) -> Distance:
    return Distance(-d.far, d.bound)


def _returned_distance(way: list[Distance], distance: Distance) -> Distance:
    """The distance of a returned value, cut to the nearest condition that led to it."""
    nearest = min([*way, distance], key=lambda d: abs(d.far))
    return Distance(math.copysign(abs(nearest.far), distance.far), nearest.bound)


def _varies(e: t.TypedExpr) -> bool:
    return any(isinstance(n, (t.VarRead, t.TopicRead, t.AgeRead, t.TypedCall)) for n in nodes([e]))


def _expression_text(e: t.TypedExpr) -> str:
    text = e.span.text_on_one_line
    return text if len(text) <= TEXT_MAX else text[: TEXT_MAX - 3] + "..."
