"""Warns of a module whose `rest`, `moves` or `within` a run of SC contradicts.

Purpose: warns W022 of a `rest` that bounds nothing, that holds where `safe` does not, or that does
not hold where SC brings the plants; of a number that `moves` leaves out or bounds too closely; and
of a `within` that is over before SC rests.
Non-goals: a proof; errors, delays, disturbances off their middle; other starts; an SC that is
extern or keeps something; a `rest` that no values satisfy.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import product
from math import isfinite, tau
from typing import TYPE_CHECKING, Any, cast

from soter.diagnostics.diagnostic import Span
from soter.diagnostics.fixes import replace
from soter.language.elaborate.lints import contradictory_predicates as trials
from soter.language.elaborate.lints.refuted_at_once import start_values
from soter.language.evaluate.arithmetic import StepFault, function_on_pairs
from soter.language.evaluate.environment import BudgetExceeded, Environment
from soter.language.evaluate.range_evaluation import RangeEvaluator, TooHardError, all_values
from soter.language.evaluate.statements import Evaluator
from soter.language.evaluate.topic_ranges import leaf_index, truth_by_parts
from soter.language.model import typed
from soter.language.model.tree_walk import (
    calls_in,
    chooses,
    conjuncts,
    cost_of,
    plant_code,
    topic_reads,
)
from soter.language.model.types import (
    leaf_name,
    leaves,
    positions,
    show_ns,
    write_ns,
)

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics, Help
    from soter.language.evaluate.range_evaluation import ReadPlace
    from soter.language.evaluate.ranges import Range
    from soter.language.model.system import Module, System

    Doubt = tuple[Span, str, str, Help] | None
    """Place, message, label and help of a doubt; None without a doubt."""

STEPS, HOLDS, LATELY = 8, 400, 30
"""Steps of integration in a period; periods of SC in a run; the last, which must be at rest."""
BEGINS = None, "low", "high"
"""What acts for a period of the DM before SC: nothing, or each command at that end of its set."""
COSTLY = 3_000
"""Operations of calls in one step of plants and SC: with more a run would take a second."""
SETTLED, GOES_ON, FAR, TURNS = 0.01, 0.05, 1e9, 15_900 * tau
"""Shares of a number's way, `LATELY`: below the first it rests, above the next not; far values."""


class _Run:
    """A run in which SC brings the plants to rest; `begins`, of BEGINS, is the phase before."""

    def __init__(
        self, system: System, module: Module, rest: typed.RestSymbol, begins: str | None
    ) -> None:
        self.system, self.module, self.rest = system, module, rest
        self.sc, self.evaluator = system.components[module.sc], Evaluator.for_scope(module.scope)
        self.topics = [t.default for t in system.topics]
        assert self.sc.node is not None
        self.law = Evaluator.for_scope(self.sc.scope).compiled_block(self.sc.node.step)
        plants = [c for c in system.components if c.plant is not None]
        self.plants = [
            (c, Evaluator.for_scope(c.scope), start_values(c, 0, self.topics)) for c in plants
        ]
        driven = [(i, system.topics[i]) for i in sorted({i for c in plants for i in c.writes})]
        self.driven = [i for i, _ in driven]
        self.bounds = {(i, k): b for i, t in driven for k, b in enumerate(t.bounds)}
        self.names = [leaf_name(t.name, path) for _, t in driven for path, _ in leaves(t.type)]
        self.parts = [(p, self._numbers_read_by(p)) for p in conjuncts(rest.condition)]
        self.read = {k for _, read in self.parts for k in read}
        self.held: list[list[bool]] = []
        self.seen: list[list[float]] = []
        self.followed, self.lost, self.after = False, False, ""
        with suppress(StepFault, ArithmeticError, BudgetExceeded, LookupError):
            if begins:
                self._move_by_commands(begins)
            while len(self.seen) < HOLDS and not self._has_come_to_rest():
                self._run_period_of_sc()
            whole = len(self.seen[-1]) == len(self.bounds)  # no lists
            self.followed = whole and all(map(isfinite, self.seen[-1]))
        self.first = next((k for k, parts in enumerate(self.held) if all(parts)), None)

    def _numbers_read_by(self, e: typed.TypedExpr) -> list[int]:
        """Gives the numbers that an expression reads, as indices of all driven numbers."""
        found = set()

        def range_of_place(place: ReadPlace) -> Range:
            found.add((place.index, leaf_index(self.system.topics[place.index], place.path)))
            return cast("Range", all_values(place.type))

        with suppress(TooHardError):
            RangeEvaluator(self.module.scope, 0, range_of_place).bounds(e)
        return [k for k, number in enumerate(self.bounds) if number in found]

    def _has_come_to_rest(self) -> bool:
        ways = [[x[k] for x in self.seen] for k in self.read]
        return len(self.seen) > LATELY and all(
            abs(x[-1] - x[-LATELY]) <= SETTLED * (max(x) - min(x)) for x in ways
        )

    def _move_by_commands(self, end: str) -> None:
        """Moves the plants for a period of the DM, with each command at this end of its set."""
        for i in self.module.outputs:
            if None in (bounds := self.system.topics[i].bounds):
                raise LookupError
            now = [getattr(bound, end) for bound in bounds]
            self.topics[i] = trials.with_scalars([self.topics[i]], now)[0]
        self._move_plants(0)
        self.was = [x for i in self.driven for x in trials.scalars_in(self.topics[i])]
        times = max(1, self.module.period_ns // self.sc.period_ns)
        for _ in range(times):
            self._move_plants(self.sc.period_ns)
        ends = "largest" if end == "high" else "smallest"
        self.after = f" after {show_ns(times * self.sc.period_ns)} of the {ends} commands"

    def _run_period_of_sc(self) -> None:
        """Moves the plants for a period of SC, records which conditions hold, and steps SC."""
        self._move_plants(self.sc.period_ns if self.seen else 0)
        env = Environment(topics=self.topics)
        self.held.append([bool(self.evaluator.value(p, env)) for p, _ in self.parts])
        self.seen.append([x for i in self.driven for x in trials.scalars_in(self.topics[i])])
        self.lost |= not self.evaluator.value(self.module.symbol.safe, env)
        self.law(env)
        for i, value in env.published.items():
            self.topics[i] = value

    def _move_plants(self, duration_ns: int) -> None:
        """Moves the plants for this time by Euler's rule, and then publishes their outputs."""
        h = duration_ns / 1e9 / STEPS
        for c, evaluator, env in self.plants:
            code, plant = evaluator.compiled, cast("typed.PlantSymbol", c.plant)
            for _ in range(STEPS):
                env.variables.update((v, code(e)(env)) for v, e in plant.lets)
                rates = [(v, code(e)(env)) for v, e in plant.der.items()]
                for v, rate in rates:
                    euler: Any = lambda x, r: x + h * r  # noqa: E731
                    env.variables[v] = function_on_pairs(v.type)(euler, env.variables[v], rate)
            env.variables.update((v, code(e)(env)) for v, e in plant.lets)
            for topic, e in plant.drives:
                self.topics[c.scope.topics[topic]] = code(e)(env)

    def _holds_with(self, e: typed.TypedExpr, k: int, value: float) -> bool:
        """Whether a condition holds at the end of the run if number `k` were `value`."""
        last, topics = self.seen[-1], list(self.topics)
        was, now = [topics[i] for i in self.driven], [*last[:k], value, *last[k + 1 :]]
        for i, new in zip(self.driven, trials.with_scalars(was, now), strict=True):
            topics[i] = new
        return bool(self.evaluator.value(e, Environment(topics=topics)))

    # ------------------------------------------------------------ doubts

    def first_doubt(self, *, unproved: bool) -> Doubt:
        """Gives the first doubt about `rest`, or None; after commands only if SC keeps `safe`."""
        claims = [self._doubt_of_end, self._doubt_of_moves, self._doubt_of_within]
        if self.after:
            claims += [self._doubt_of_unmoved_number] * unproved
        else:
            claims = [
                self._doubt_of_start,
                self._doubt_of_bounds,
                claims[0],
                self._doubt_of_safety,
                *claims[1:],
            ]
        if not self.followed or (self.after and self.lost):
            return None
        with suppress(StepFault, ArithmeticError, BudgetExceeded):
            for claim in claims:
                if (found := claim()) is not None:
                    return found[0], found[1], found[2] + self.after, found[3]
        return None

    def _doubt_of_unmoved_number(self) -> Doubt:
        """Gives a doubt about a number in `rest` that stays where the commands brought it."""
        for k in self.read:
            if self.seen[0][k] != self.was[k] and len({x[k] for x in self.seen}) == 1:
                message = f"SC does not move `{self.names[k]}`, which `rest` bounds"
                at = self.module.symbol.sc_span or self.rest.span
                return at, message, f"it stays {self.seen[0][k]:.4g}", "let SC bring it back"
        return None

    def _doubt_of_start(self) -> Doubt:
        """Gives a doubt about `safe` if it is false where plants start, with default maps."""
        safe, topics = self.module.symbol.safe, [t.default for t in self.system.topics]
        values = trials.with_scalars([topics[i] for i in self.driven], self.seen[0])
        for i, value in zip(self.driven, values, strict=True):
            topics[i] = value
        if self.evaluator.value(safe, Environment(topics=topics)):
            return None
        maps = [f"`{t.name}`" for t in topic_reads(safe) if t.static]
        help_ = f"a default of {' and '.join(maps)} that lets it hold" if maps else "another start"
        return safe.span, "`safe` is false at the start", "false of what is published first", help_

    def _doubt_of_bounds(self) -> Doubt:
        """Gives a doubt about `rest` if it reads a number and holds at both ends of its set."""
        for k, bound in enumerate(self.bounds.values()):
            parts, name = [p for p, read in self.parts if k in read], self.names[k]
            ends = (-FAR, FAR) if bound is None else (bound.low, bound.high)
            if parts and all(self._holds_with(p, k, x) for p in parts for x in ends):
                op, other = getattr(parts[0], "op", ""), ""
                if isinstance(parts[0], typed.TypedBinary) and op == "||":
                    other = f"{parts[0].left.span.text} && {parts[0].right.span.text}"
                elif op == "!" or op[:1] == ">":
                    other = trials.negated_text(parts[0])
                near = f"bound `{name}` to where SC ends"
                help_ = replace(parts[0].span, other) if other else near
                label = f"true of `{name}` = {ends[0]:.4g}, and of {ends[1]:.4g}"
                return parts[0].span, f"`rest` holds whatever `{name}` is", label, help_
        return None

    def _doubt_of_safety(self) -> Doubt:
        rest, safe = self.rest.condition, self.module.symbol.safe
        for k, x in product(self.read, trials.numbers_to_try((rest, safe))):
            if self._holds_with(rest, k, x) and not self._holds_with(safe, k, x):
                label = f"true of `{self.names[k]}` = {x:.4g}, and `safe` is false there"
                message, help_ = "`rest` holds where `safe` does not", "let it lie in `safe`"
                return rest.span, message, label, help_
        return None

    def _doubt_of_end(self) -> Doubt:
        """Gives a doubt about a part of `rest` that is false where SC ends; or None."""
        k = next((k for k, held in enumerate(self.held[-1]) if not held), None)
        safe = self.evaluator.value(self.module.symbol.safe, Environment(topics=self.topics))
        if k is None or (safe and not self._has_come_to_rest()):
            return None
        (part, read), at = self.parts[k], self.parts[k][0].span
        help_: Help = "let `rest` hold there, or SC go on to where it holds"
        if not safe:
            at, help_ = self.module.symbol.sc_span or at, "perhaps a sign of SC is wrong"
        if getattr(part, "op", "")[:1] == ">":
            help_ = replace(part.span, trials.negated_text(part))
        elif getattr(part, "op", "") == "==":
            help_ = "say how near: a float is hardly ever equal to a number"
        values = " and ".join(f"`{self.names[n]}` is {self.seen[-1][n]:.4g}" for n in read)
        values += "" if safe else ", and `safe` is, too"
        message = "`rest` does not hold where SC brings the plant"
        return at, message, f"false where {values}", help_

    def _doubt_of_moves(self) -> Doubt:
        """Gives a doubt about `moves` if SC moves a number further, or loses `safe` without it."""
        rest, items, found, moves = self.rest, list[str](), None, {}
        for m in rest.moves:
            i = self.module.scope.topics[m.topic]
            moves[i, leaf_index(self.system.topics[i], (*positions(m.topic.type, m.path),))] = m
        for k, (number, bound) in enumerate(self.bounds.items()):
            move = moves.get(number)
            if move is None and (k in self.read or bound is not None):
                continue
            wrong, item = self._excess_over_moves(k, move)
            items += [item] if item else []
            lost, goes = self._directions_that_lose_safe(k), self._direction_at_end(k)
            if wrong and goes and (goes in lost or not lost):
                way_out = "leave it out: `safe` does not ask where it is"
                if lost:
                    way_out = f"an SC that stops it, or a `safe` without `{self.names[k]}`"
                message = f"SC moves `{self.names[k]}` without end: no bound of `moves` is true"
                at = self.module.symbol.safe if lost else (move or rest)
                return at.span, message, f"SC moves it {goes}, and goes on", way_out
            if wrong:
                label = f"SC moves `{self.names[k]}` {wrong} from where `rest` holds"
                found = found or ((move or rest).span, label)
        if found is None or (one_sided := self._doubt_of_one_side()):
            return found and one_sided
        gap = Span(rest.span.source, rest.condition.span.end, rest.within.span.start)
        new = f"moves {', '.join(items)}"
        before = gap.text[: gap.text.index("moves" if rest.moves else "within")]
        help_ = replace(gap, f"{before}{new} within ", f"write `{new}`, or more")
        return found[0], "`moves` does not bound all that SC moves", found[1], help_

    def _doubt_of_one_side(self) -> Doubt:
        """Gives a doubt about a `rest` that bounds a number on one side of where SC ends only."""
        for k, bound in enumerate(self.bounds.values()):
            parts, name = [p for p, read in self.parts if k in read], self.names[k]
            for x in (-FAR, FAR) if bound is None else (bound.low, bound.high):
                other = 2 * self.seen[-1][k] - x
                true, false = (all(self._holds_with(p, k, v) for p in parts) for v in (x, other))
                if parts and true and not false:
                    label, message = (
                        f"true of `{name}` = {x:.4g}",
                        f"`rest` bounds `{name}` on one side",
                    )
                    return parts[0].span, message, label, "bound it on the other side, too (`abs`)"
        return None

    def _direction_at_end(self, k: int) -> str:
        """Gives the direction of number `k` at the end: "up", "down", or "" if it hardly moves."""
        way = [x[k] for x in self.seen]
        last = way[-1] - way[-LATELY]
        if abs(last) <= GOES_ON * (max(way) - min(way)):
            return ""
        return "up" if last > 0.0 else "down"

    def _directions_that_lose_safe(self, k: int) -> list[str]:
        """Gives the directions in which number `k`, far away or turned often, loses `safe`."""
        safe, ways = self.module.symbol.safe, (("down", -1.0), ("up", 1.0))
        ends = ((w, (x * FAR, self.seen[-1][k] + x * TURNS)) for w, x in ways)
        return [w for w, places in ends if not any(self._holds_with(safe, k, x) for x in places)]

    def _excess_over_moves(self, k: int, move: typed.RestMove | None) -> tuple[str, str]:
        """Gives the direction in which number `k` exceeds `moves`, or "", and a right `moves`."""
        ways = [0.0] if self.first is None else [x[k] for x in self.seen[self.first :]]
        drift = {"down": ways[0] - min(ways), "up": max(ways) - ways[0]}
        lost = self._directions_that_lose_safe(k)
        if move is None and not lost:
            return "", ""
        way, directions = (move.way, [move.way] if move.way else [*drift]) if move else ("", [])
        by = 0.0 if move is None else cast("float", self.evaluator.value(move.by))
        wrong = [w for w in directions if drift[w] > 1.01 * by] + [
            w for w in lost if w not in directions
        ]
        far = max(drift[w] for w in lost or directions)
        if wrong:
            way = lost[0] if len(lost) == 1 else ""
        bound = move.by.span.text if move and far <= by else f"{4.0 * far or 0.1:.1g}"
        return wrong[0] if wrong else "", f"{self.names[k]} by {bound} {way}".strip()

    def _doubt_of_within(self) -> Doubt:
        """Gives a doubt about a `within` that ends before `rest` holds; or None."""
        at, needed = self.rest.within, (self.first or 1) * self.sc.period_ns
        if needed <= cast("int", self.evaluator.value(at)):
            return None
        longer, label = write_ns(3 * needed // 2), f"SC needs {show_ns(needed)}"
        help_ = replace(at.span, longer, f"`within {longer}`, or longer")
        return at.span, "`within` is over before SC rests", label, help_


def doubt_about_rest(system: System, module: Module, *, unproved: bool = False) -> Doubt:
    """Gives a doubt about `rest`, or None; `unproved` says that the proof of `rest` failed."""
    rest = module.symbol.rest
    if rest is None or not _can_be_followed(system, module, rest):
        return None
    runs = (_Run(system, module, rest, begins).first_doubt(unproved=unproved) for begins in BEGINS)
    return next((found for found in runs if found is not None), None)


def _can_be_followed(system: System, module: Module, rest: typed.RestSymbol) -> bool:
    """Whether a run depends on plants and SC alone, and can be followed in less than a second."""
    sc = system.components[module.sc]
    plants = [c for c in system.components if c.plant is not None]
    if sc.node is None or sc.extern or sc.node.locals:
        return False
    read = {*sc.reads, *(module.scope.topics[t] for t in topic_reads(rest.condition))}
    if not read <= {i for c in plants for i in c.writes}:
        return False
    if not {i for c in plants for i in c.reads} <= {*module.outputs}:
        return False
    symbols = [c.plant for c in plants if c.plant is not None]
    code = [e for p in symbols for e in plant_code(p)]
    asked = (*code, rest.condition, module.symbol.safe, *sc.node.step)
    calls = sum(cost_of(f.fun).operations for f in calls_in(*asked))
    if any(p.extern or p.next for p in symbols) or chooses(*code) or calls > COSTLY:
        return False
    return truth_by_parts(rest.condition, system, module.scope) is not False


def warn_of_rest(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W022 of the first doubt about `rest`."""
    if (found := doubt_about_rest(system, module)) is not None:
        at, message, label, help_ = found
        also = ((module.symbol.sc_span or module.symbol.span, "SC"),)
        notes = ("AC has control only where SC surely comes to rest, and stays there",)
        message += f" (module `{module.symbol.name}`)"
        diagnostics.warning("W022", message, at, label, also=also, notes=notes, helps=(help_,))
