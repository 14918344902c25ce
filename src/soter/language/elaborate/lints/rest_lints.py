"""Warns of a module whose `rest`, `moves` or `within` a few runs of SC contradict.

Purpose: W022 of a `rest` that bounds nothing, or does not hold where SC ends; of numbers that SC
moves further than `moves` says; of a `within` that is over too soon. SC is followed from the start,
and from where commands at the ends of their sets bring the plants in some periods of the DM.
Non-goals: a proof; errors, delays, disturbances off their middle; an SC that is extern or keeps
something; a `rest` that no values satisfy.
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any, cast

from soter.diagnostics.diagnostic import Span, replace
from soter.language.elaborate.lints.contradictory_predicates import flat, opposite, rebuilt
from soter.language.elaborate.lints.refuted_at_once import at_first
from soter.language.evaluate.arithmetic import StepFault, zipper
from soter.language.evaluate.environment import BudgetExceeded, Environment
from soter.language.evaluate.range_evaluation import RangeEvaluator, TooHardError, anything
from soter.language.evaluate.statements import Evaluator
from soter.language.evaluate.topic_ranges import always_by_parts, leaf_index
from soter.language.model import typed
from soter.language.model.tree_walk import calls_in, chooses, conjuncts, cost_of, plant_code
from soter.language.model.types import leaf_name, leaves, positions, show_ns, write_ns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Diagnostics, Help
    from soter.language.evaluate.range_evaluation import ReadPlace
    from soter.language.evaluate.ranges import Range
    from soter.language.model.system import Module, System
    from soter.language.model.types import Value

    Found = tuple[Span, str, str, Help] | None
    """Where, what, a label and a help."""

BUDGET = 2_000_000
"""Most operations of the runs of a module: some tenths of a second."""
PUSHES = (2, 10)
"""For how many periods of the DM commands are at ends of their sets before SC has control."""
COMBINED = 3
"""Of so many commands all combinations of ends are tried, of more all low and all high."""
STEPS, HOLDS, LATELY = 8, 400, 30
"""Steps of integration in a period; periods of SC in a run; those in which it comes to its end."""
SETTLED = 0.01
"""As a share of a number's way: how much it moves `LATELY` where a run has come to its end."""
FAR = 1e9


class _Run:
    """After each period of SC which parts of `rest` hold, and the numbers that plants publish."""

    def __init__(self, pushed: int) -> None:
        self.pushed, self.parts, self.seen = pushed, list[list[bool]](), list[list[float]]()

    @property
    def first(self) -> int | None:
        """After how many periods `rest` first holds."""
        return next((k for k, parts in enumerate(self.parts) if all(parts)), None)

    def ended(self, numbers: Sequence[int]) -> bool:
        """Whether these numbers hardly move any more."""
        of = [[x[k] for x in self.seen] for k in numbers]
        return len(self.seen) > LATELY and all(
            abs(x[-1] - x[-LATELY]) <= SETTLED * (max(x) - min(x)) for x in of
        )


class _Runs:
    """The runs of a module, and what they contradict."""

    def __init__(self, system: System, module: Module, rest: typed.RestSymbol) -> None:
        self.system, self.module, self.rest, self.left = system, module, rest, BUDGET
        self.sc, self.own = system.components[module.sc], Evaluator.of(module.scope)
        self.plants = [(c, c.plant) for c in system.components if c.plant is not None]
        self.driven = sorted({i for c, _ in self.plants for i in c.writes})
        topics = [system.topics[i] for i in self.driven]
        self.numbers = [(i, k) for i in self.driven for k, _ in enumerate(system.topics[i].bounds)]
        self.names = [leaf_name(t.name, path) for t in topics for path, _ in leaves(t.type)]
        self.parts, self.read = conjuncts(rest.condition), self._numbers_of(rest.condition)
        calls = [f for _, plant in self.plants for f in calls_in(*plant_code(plant))]
        self.cost = STEPS * (50 * len(self.plants) + sum(cost_of(f.fun).operations for f in calls))
        self.all: list[_Run] = []
        with suppress(BudgetExceeded, StepFault):
            self.all.append(self._run(0, ()))
            outputs = [b for i in module.outputs for b in system.topics[i].bounds if b]
            ends = [(b.low, b.high) for b in outputs]
            for push in product(*ends) if len(ends) <= COMBINED else zip(*ends, strict=True):
                self.all += [self._run(count, push) for count in PUSHES]

    def _numbers_of(self, e: typed.TypedExpr) -> list[int]:
        """The numbers that an expression reads."""
        found = set()

        def read(place: ReadPlace) -> Range:
            found.add((place.index, leaf_index(self.system.topics[place.index], place.path)))
            return cast("Range", anything(place.type))

        with suppress(TooHardError):
            RangeEvaluator(self.module.scope, 0, read).number(e)
        return [k for k, number in enumerate(self.numbers) if number in found]

    def _run(self, pushed: int, push: Sequence[float]) -> _Run:
        run, topics = _Run(pushed), [t.default for t in self.system.topics]
        plants = [
            (c, plant, Evaluator.of(c.scope).expression, at_first(c, 0, topics))
            for c, plant in self.plants
        ]
        assert self.sc.node is not None
        law, env = Evaluator.of(self.sc.scope).block(self.sc.node.step), Environment(topics=topics)
        if push:
            _fill(topics, self.module.outputs, push)
        for _ in range(pushed):
            _hold(plants, topics, self.module.period_ns)
        while len(run.seen) < HOLDS and not run.ended(self.read):
            _hold(plants, topics, self.sc.period_ns if run.seen else 0)
            self.left -= self.cost
            if self.left < 0:
                raise BudgetExceeded
            run.parts.append([bool(self.own.expression(p)(env)) for p in self.parts])
            run.seen.append([x for i in self.driven for x in flat(topics[i])])
            law(env)
            for i, value in env.published.items():
                topics[i] = value
        return run

    def _holds(self, e: typed.TypedExpr, k: int, value: float) -> bool:
        """Whether a condition holds where SC ends, with another value of number `k`."""
        last, topics = self.all[0].seen[-1], [t.default for t in self.system.topics]
        _fill(topics, self.driven, [*last[:k], value, *last[k + 1 :]])
        return bool(self.own.value(e, Environment(topics=topics)))

    # ------------------------------------------------------------ claims

    def unbounded(self) -> Found:
        """`rest` reads a number, and holds at both of its ends."""
        for k in self.read:
            i, leaf = self.numbers[k]
            name, bound = self.names[k], self.system.topics[i].bounds[leaf]
            low, high = (-FAR, FAR) if bound is None else (bound.low, bound.high)
            parts = [p for p in self.parts if k in self._numbers_of(p)]
            if all(self._holds(p, k, x) for p in parts for x in (low, high)):
                helps: Help = f"bound `{name}` to where SC brings it: narrower than its set"
                op = getattr(parts[0], "op", "")
                if isinstance(parts[0], typed.TypedBinary) and op == "||":
                    both = f"{parts[0].left.span.text} && {parts[0].right.span.text}"
                    helps = replace(parts[0].span, both, f"if both are meant: `{both}`")
                elif op == "!" or op[:1] == ">":
                    helps = _other_way(parts[0])
                label = f"true of `{name}` = {low:.4g}, and of {high:.4g}"
                return parts[0].span, f"`rest` holds whatever `{name}` is", label, helps
        return None

    def elsewhere(self) -> Found:
        """A part of `rest` holds in no run where that ends."""
        ends = [run.parts[-1] for run in self.all]
        k = next((k for k in range(len(self.parts)) if not any(end[k] for end in ends)), None)
        if k is None or not all(run.ended(self.read) for run in self.all):
            return None
        part, last = self.parts[k], self.all[0].seen[-1]
        helps: Help = "let `rest` hold there, or SC go on to where it holds"
        if len(self.all) > 1 and all(run.parts[0][k] for run in self.all if run.pushed):
            helps = _other_way(part)
        elif isinstance(part, typed.TypedBinary) and part.op == "==":
            helps = "say how near: a float is hardly ever equal to a number"
        values = " and ".join(f"`{self.names[n]}` is {last[n]:.4g}" for n in self._numbers_of(part))
        what = "`rest` does not hold where SC brings the plant"
        return part.span, what, f"false where {values}", helps

    def unmoved(self) -> Found:
        """No command moves what `rest` reads."""
        ends = [run.seen[0] for run in self.all if run.pushed == PUSHES[-1]]
        moved = [k for k, x in enumerate(zip(*ends, strict=True)) if min(x) < max(x)]
        if not moved or {*moved} & {*self.read}:
            return None
        helps = f"say it of what they move: {', '.join(f'`{self.names[k]}`' for k in moved)}"
        what, label = "`rest` reads nothing that commands move", "SC does not bring it to rest"
        return self.rest.condition.span, what, label, helps

    def moved(self) -> Found:
        """SC moves a number further than `moves` says, or `safe` is lost on a way left open."""
        rest, at, items, found = self.rest, self.module.scope.topics, list[str](), None
        moves = {(at[m.topic], tuple(positions(m.topic.type, m.path))): m for m in rest.moves}
        said = {(i, leaf_index(self.system.topics[i], path)): m for (i, path), m in moves.items()}
        for k, (i, leaf) in enumerate(self.numbers):
            move, drift = said.get((i, leaf)), self._drift(k)
            safe, set_ = self.module.symbol.safe, self.system.topics[i].bounds[leaf]
            lost = [w for w, x in (("down", -FAR), ("up", FAR)) if not self._holds(safe, k, x)]
            if move is None and (k in self.read or set_ is not None or not lost):
                continue
            way, bounded = (move.way, [move.way] if move.way else [*drift]) if move else ("", [])
            by = 0.0 if move is None else cast("float", self.own.value(move.by))
            wrong = [w for w in bounded if drift[w] > 1.01 * by] or [
                w for w in lost if w not in bounded
            ]
            far = max(drift[w] for w in lost or bounded)
            if wrong:
                label = f"SC moves `{self.names[k]}` {wrong[0]} from where `rest` holds"
                found = found or ((move or rest.condition).span, label)
                way = lost[0] if len(lost) == 1 else ""
            by_ = move.by.span.text if move and far <= by else f"{4.0 * far or 0.1:.1g}"
            items.append(f"{self.names[k]} by {by_} {way}".strip())
        if found is None:
            return None
        gap = Span(rest.span.source, rest.condition.span.end, rest.within.span.start)
        new = f"moves {', '.join(items)}"
        before = gap.text[: gap.text.index("moves" if rest.moves else "within")]
        helps = replace(gap, f"{before}{new} within ", f"write `{new}`, four times what runs show")
        return found[0], "`moves` does not bound all that SC moves", found[1], helps

    def _drift(self, k: int) -> dict[str, float]:
        """How far SC moves number `k` once `rest` holds, each way."""
        of = [[x[k] for x in run.seen[run.first :]] for run in self.all if run.first is not None]
        down = max((x[0] - min(x) for x in of), default=0.0)
        return {"down": down, "up": max((max(x) - x[0] for x in of), default=0.0)}

    def late(self) -> Found:
        """From the start, or from what commands do in two periods, `within` is over too soon."""
        at, period = self.rest.within, self.sc.period_ns
        needed = max(run.first or 1 for run in self.all if run.pushed <= PUSHES[0]) * period
        if needed <= cast("int", self.own.value(at)):
            return None
        longer = write_ns(3 * max(run.first or 1 for run in self.all) * period // 2)
        label = f"SC needs {show_ns(needed)} from where it takes over"
        helps = replace(at.span, longer, f"`within {longer}`, or longer")
        return at.span, "`within` is over before SC rests", label, helps


def _fill(topics: list[Value], indices: Sequence[int], numbers: Sequence[Any]) -> None:
    """Gives topics these numbers, in the order of `flat`."""
    for i, value in zip(indices, rebuilt([topics[i] for i in indices], numbers), strict=True):
        topics[i] = value


def _step(h: float, x: float, rate: float) -> float:
    return x + h * rate


def _hold(plants: Sequence[tuple[Any, ...]], topics: list[Value], ns: int) -> None:
    """Plants move for a time while commands stay as they are, by Euler's rule, and publish."""
    for c, plant, code, env in plants:
        now = env.variables
        for h in (*[ns / 1e9 / STEPS] * STEPS, 0.0):
            now.update((v, code(e)(env)) for v, e in plant.lets)
            rates = [(v, zipper(v.type), code(e)(env)) for v, e in plant.der.items()]
            step = partial(_step, h)
            now.update((v, add(step, now[v], r)) for v, add, r in rates)
        for topic, e in plant.drives:
            topics[c.scope.topics[topic]] = code(e)(env)


def _other_way(part: typed.TypedExpr) -> Help:
    return replace(part.span, opposite(part), f"the other way round: `{opposite(part)}`")


def rest_claim(system: System, module: Module) -> Found:
    """What is doubtful about `rest` of a module; it is asked once for the same plants."""
    rest, sc = module.symbol.rest, system.components[module.sc]
    plants = [c.plant for c in system.components if c.plant is not None]
    if rest is None or sc.node is None or sc.extern or sc.node.locals:
        return None
    if any(p.extern or chooses(*plant_code(p)) for p in plants):
        return None
    known, key = system.program.trials, ("rest", rest, *plants, *module.scope.params.items())
    if key not in known:
        known[key] = [None]
        if always_by_parts(rest.condition, system, module.scope) is not False:
            runs = _Runs(system, module, rest)
            claims = runs.unbounded, runs.elsewhere, runs.unmoved, runs.moved, runs.late
            known[key] = [next((f for claim in claims if runs.all and (f := claim())), None)]
    return cast("Found", known[key][0])


def doubt_rest(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W022 of what is doubtful about `rest`."""
    if (found := rest_claim(system, module)) is not None:
        at, what, label, helps = found
        symbol = module.symbol
        also = ((symbol.sc_span or symbol.span, "SC"),)
        notes = ("AC has control only where SC surely comes to rest, and stays there",)
        what += f" (module `{symbol.name}`)"
        diagnostics.warning("W022", what, at, label, also=also, notes=notes, helps=(helps,))
