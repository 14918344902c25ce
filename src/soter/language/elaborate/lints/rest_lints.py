"""Warns of a module whose `rest`, `moves` or `within` a few runs of SC contradict.

Purpose: W022 of a `rest` that bounds nothing, or holds where `safe` does not, or not where SC ends;
of numbers that SC moves further than `moves` says; of a `within` that is over too soon. SC is
followed from the start, and from where commands at the ends of their sets bring the plants.
Non-goals: a proof; errors, delays, disturbances off their middle; an SC that is extern or keeps
something; a `rest` that no values satisfy.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import islice, product
from typing import TYPE_CHECKING, Any, cast

from soter.diagnostics.diagnostic import Span, replace
from soter.language.elaborate.lints import contradictory_predicates as trials
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

    Doubt = tuple[Span, str, str, Help] | None
    """Where, what, a label and a help."""

BUDGET = 2_000_000
"""Most operations of the runs of a module: some tenths of a second."""
PUSHES, PUSHED = 8, 2
"""Before so many runs commands are at ends of their sets, for so many periods of the DM."""
STEPS, HOLDS, LATELY = 8, 400, 30
"""Steps of integration in a period; periods of SC in a run; those in which it comes to its end."""
SETTLED, FAR = 0.01, 1e9
"""As a share of a number's way: how much it moves `LATELY` where a run has come to its end."""


class _Run:
    """After each period of SC which parts of `rest` hold, and the numbers that plants publish."""

    def __init__(self) -> None:
        self.parts, self.seen = list[list[bool]](), list[list[float]]()

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
        topics = [(i, system.topics[i]) for i in self.driven]
        self.bounds = {(i, k): b for i, t in topics for k, b in enumerate(t.bounds)}
        self.names = [leaf_name(t.name, path) for _, t in topics for path, _ in leaves(t.type)]
        self.parts = [(p, self._numbers_of(p)) for p in conjuncts(rest.condition)]
        self.read = sorted({k for _, read in self.parts for k in read})
        calls = [f for _, plant in self.plants for f in calls_in(*plant_code(plant))]
        self.cost = STEPS * (50 * len(self.plants) + sum(cost_of(f.fun).operations for f in calls))
        outputs = [b for i in module.outputs for b in system.topics[i].bounds if b]
        self.all: list[_Run] = []
        with suppress(BudgetExceeded, StepFault):
            for push in ((), *islice(product(*((b.low, b.high) for b in outputs)), PUSHES)):
                self.all.append(self._run(push))

    def _numbers_of(self, e: typed.TypedExpr) -> list[int]:
        """The numbers that an expression reads."""
        found = set()

        def read(place: ReadPlace) -> Range:
            found.add((place.index, leaf_index(self.system.topics[place.index], place.path)))
            return cast("Range", anything(place.type))

        with suppress(TooHardError):
            RangeEvaluator(self.module.scope, 0, read).number(e)
        return [k for k, number in enumerate(self.bounds) if number in found]

    def _run(self, push: Sequence[float]) -> _Run:
        run, topics = _Run(), [t.default for t in self.system.topics]
        plants = [
            (c, plant, Evaluator.of(c.scope).expression, at_first(c, 0, topics))
            for c, plant in self.plants
        ]
        assert self.sc.node is not None
        law, env = Evaluator.of(self.sc.scope).block(self.sc.node.step), Environment(topics=topics)
        if push:
            _fill(topics, self.module.outputs, push)
            _hold(plants, topics, PUSHED * self.module.period_ns)
        while len(run.seen) < HOLDS and not run.ended(self.read):
            _hold(plants, topics, self.sc.period_ns if run.seen else 0)
            self.left -= self.cost
            if self.left < 0:
                raise BudgetExceeded
            run.parts.append([bool(self.own.expression(p)(env)) for p, _ in self.parts])
            run.seen.append([x for i in self.driven for x in trials.flat(topics[i])])
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

    def doubt(self) -> Doubt:
        """The first of all claims that is one."""
        claims = self._outside, self._elsewhere, self._unmoved, self._moved, self._late
        return next((found for claim in claims if self.all and (found := claim())), None)

    def _outside(self) -> Doubt:
        """`rest` holds at both ends of a number that it reads, or where `safe` does not."""
        rest, safe = self.rest.condition, self.module.symbol.safe
        for k, bound in enumerate(self.bounds.values()):
            parts, name = [p for p, read in self.parts if k in read], self.names[k]
            ends = (-FAR, FAR) if bound is None else (bound.low, bound.high)
            if parts and all(self._holds(p, k, x) for p in parts for x in ends):
                op, other = getattr(parts[0], "op", ""), ""
                if isinstance(parts[0], typed.TypedBinary) and op == "||":
                    other = f"{parts[0].left.span.text} && {parts[0].right.span.text}"
                elif op == "!" or op[:1] == ">":
                    other = trials.opposite(parts[0])
                help_ = (
                    replace(parts[0].span, other) if other else f"bound `{name}` to where SC ends"
                )
                label = f"true of `{name}` = {ends[0]:.4g}, and of {ends[1]:.4g}"
                return parts[0].span, f"`rest` holds whatever `{name}` is", label, help_
            for x in trials.numbers_in((rest, safe)) if parts else ():
                if self._holds(rest, k, x) and not self._holds(safe, k, x):
                    label = f"true of `{name}` = {x:.4g}, and `safe` is false there"
                    what = "`rest` holds where `safe` does not"
                    return parts[0].span, what, label, "let `rest` lie in `safe`"
        return None

    def _elsewhere(self) -> Doubt:
        """A part of `rest` holds in no run where that ends."""
        ends = [run.parts[-1] for run in self.all]
        k = next((k for k in range(len(self.parts)) if not any(end[k] for end in ends)), None)
        if k is None or not all(run.ended(self.read) for run in self.all):
            return None
        (part, read), last = self.parts[k], self.all[0].seen[-1]
        help_: Help = "let `rest` hold there, or SC go on to where it holds"
        if len(self.all) > 1 and all(run.parts[0][k] for run in self.all[1:]):
            help_ = replace(part.span, trials.opposite(part))
        elif getattr(part, "op", "") == "==":
            help_ = "say how near: a float is hardly ever equal to a number"
        values = " and ".join(f"`{self.names[n]}` is {last[n]:.4g}" for n in read)
        what = "`rest` does not hold where SC brings the plant"
        return part.span, what, f"false where {values}", help_

    def _unmoved(self) -> Doubt:
        """No command moves what `rest` reads."""
        ends = enumerate(zip(*(run.seen[0] for run in self.all[1:]), strict=True))
        moved = [k for k, x in ends if min(x) < max(x)]
        if not moved or {*moved} & {*self.read}:
            return None
        help_ = f"say it of what they move: {', '.join(f'`{self.names[k]}`' for k in moved)}"
        what, label = "`rest` reads nothing that commands move", "SC does not bring it to rest"
        return self.rest.condition.span, what, label, help_

    def _moved(self) -> Doubt:
        """SC moves a number further than `moves` says, or `safe` is lost on a way left open."""
        rest, items, found, moves = self.rest, list[str](), None, {}
        for m in rest.moves:
            i = self.module.scope.topics[m.topic]
            moves[i, leaf_index(self.system.topics[i], (*positions(m.topic.type, m.path),))] = m
        for k, (number, bound) in enumerate(self.bounds.items()):
            move, drift, safe = moves.get(number), self._drift(k), self.module.symbol.safe
            lost = [w for w, x in (("down", -FAR), ("up", FAR)) if not self._holds(safe, k, x)]
            if move is None and (k in self.read or bound is not None or not lost):
                continue
            way, said = (move.way, [move.way] if move.way else [*drift]) if move else ("", [])
            by = 0.0 if move is None else cast("float", self.own.value(move.by))
            wrong = [w for w in said if drift[w] > 1.01 * by] + [w for w in lost if w not in said]
            far = max(drift[w] for w in lost or said)
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
        help_ = replace(gap, f"{before}{new} within ", f"write `{new}`, four times what runs show")
        return found[0], "`moves` does not bound all that SC moves", found[1], help_

    def _drift(self, k: int) -> dict[str, float]:
        """How far SC moves number `k` once `rest` holds, each way."""
        of = [[x[k] for x in run.seen[run.first :]] for run in self.all if run.first is not None]
        down = max((x[0] - min(x) for x in of), default=0.0)
        return {"down": down, "up": max((max(x) - x[0] for x in of), default=0.0)}

    def _late(self) -> Doubt:
        """`within` is over before `rest` holds."""
        at, needed = self.rest.within, max(run.first or 1 for run in self.all) * self.sc.period_ns
        if needed <= cast("int", self.own.value(at)):
            return None
        longer, label = write_ns(3 * needed // 2), f"SC needs {show_ns(needed)}"
        help_ = replace(at.span, longer, f"`within {longer}`, or longer")
        return at.span, "`within` is over before SC rests", label, help_


def _fill(topics: list[Value], indices: Sequence[int], numbers: Sequence[Any]) -> None:
    """Gives topics these numbers, in the order of `flat`."""
    new = trials.rebuilt([topics[i] for i in indices], numbers)
    for i, value in zip(indices, new, strict=True):
        topics[i] = value


def _hold(plants: Sequence[tuple[Any, ...]], topics: list[Value], ns: int) -> None:
    """Plants move for a time while commands stay as they are, by Euler's rule, and publish."""
    for c, plant, code, env in plants:
        now = env.variables
        for h in (*[ns / 1e9 / STEPS] * STEPS, 0.0):
            now.update((v, code(e)(env)) for v, e in plant.lets)
            rates = [(v, zipper(v.type), code(e)(env)) for v, e in plant.der.items()]
            euler: Any = lambda x, rate, h=h: x + h * rate  # noqa: E731
            now.update((v, add(euler, now[v], r)) for v, add, r in rates)
        for topic, e in plant.drives:
            topics[c.scope.topics[topic]] = code(e)(env)


def rest_doubt(system: System, module: Module) -> Doubt:
    """What is doubtful about `rest` of a module; it is asked once for the same plants."""
    rest, sc = module.symbol.rest, system.components[module.sc]
    plants = [c.plant for c in system.components if c.plant is not None]
    if rest is None or sc.node is None or sc.extern or sc.node.locals:
        return None
    if any(p.extern or chooses(*plant_code(p)) for p in plants):
        return None
    known, key = system.program.trials, ("rest", rest, *plants, *module.scope.params.items())
    if key not in known:
        never = always_by_parts(rest.condition, system, module.scope) is False
        known[key] = [None if never else _Runs(system, module, rest).doubt()]
    return cast("Doubt", known[key][0])


def doubt_rest(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W022 of what is doubtful about `rest`."""
    if (found := rest_doubt(system, module)) is not None:
        at, what, label, help_ = found
        also = ((module.symbol.sc_span or module.symbol.span, "SC"),)
        notes = ("AC has control only where SC surely comes to rest, and stays there",)
        what += f" (module `{module.symbol.name}`)"
        diagnostics.warning("W022", what, at, label, also=also, notes=notes, helps=(help_,))
