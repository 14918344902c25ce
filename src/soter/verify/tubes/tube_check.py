"""The check by which a DM with `rest` decides, written as Soter source.

Purpose: `TubeCheck` reads a module's rates, law and predicates as expressions. Of them and of the
parts that all modules share (`forms.soter`, `tube.soter`, `check.soter`) it writes two programs:
`text_in_flight`, with `fun good(estimate: float[n]): bool`, and `offline_text`, with the functions
of `rest.soter`, which are asked before anything flies.
Non-goals: asking it (`rest_claims.py`), the DM's predicates (`tube_levels.py`).
"""

from __future__ import annotations

import re
from copy import copy
from dataclasses import astuple, replace
from fractions import Fraction
from math import inf
from typing import TYPE_CHECKING

from soter.core.execution import STATEMENTS_MAX, TooManyStatementsError
from soter.language.model.tree_walk import cost_of
from soter.language.model.types import leaves
from soter.verify.deploy.shield_tables import command_edges
from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import (
    NoExpressionError,
    half_width,
    in_order,
    middle,
    reads_kind,
    states_read,
    states_read_through,
)
from soter.verify.tubes.generated_functions import (
    FORMS,
    MAP,
    RANGES,
    array_text,
    decided_text,
    exact_form_text,
    form_text,
    fun_text,
    functions_of,
    number_text,
    numbers_text,
    sure_text,
    text_of_package_file,
)
from soter.verify.tubes.kinks import text_that_follows_sc
from soter.verify.tubes.module_expressions import ModuleExpressions
from soter.verify.tubes.moved_rates import domain_conditions, state_that_may_grow_without_end
from soter.verify.tubes.problem import (
    FARTHEST,
    TubeProblem,
    TubeTimes,
    nearest_seconds,
    refusal,
    rounded_up,
    topics_read,
)
from soter.verify.tubes.sc_step import ScStep
from soter.verify.tubes.tube_precision import PLAIN, PRECISIONS, text_in_precision
from soter.verify.tubes.turns import A_TURN, FARTHEST_TURN, turning_states, with_rounding_of_turns

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.model.system import Shield
    from soter.language.model.typed import Cost
    from soter.verify.tubes.expression_graph import Node
    from soter.verify.tubes.generated_functions import Inputs
    from soter.verify.tubes.kinks import Kink


RANGED = "x: Ranges, u: Orders"
ON = ", on: bool[BRANCHES]"
"""The parameter of rates with branches: for each branch whether a step takes it."""
SYMBOLS_MAX = 2000
"""The most symbols of a form; the rounding bounds of `forms.soter` depend on it."""
ATTEMPTS, LEVELS, PARTS = 5, 6, 4
NO_RANGE = "{ lo: 0.0, hi: 0.0 }"
FREE, LONGEST = 2, 8
"""The steps of a tube until SC acts, and the most periods in a step of an SC that reads nothing."""
UNBOUNDED = "no bound is seen of `{}`, which SC keeps from step to step"
BOUND = "limit it where it is assigned: `i = clamp(i + ..., -1.0, 1.0)`"
BOUND_READ = "a filter needs sets of the topics that it reads"
WAY = 3
"""A command that is not permitted is moved to SC's in so many steps, and each is judged."""
ENDINGS = 2
"""The number of parts of the time during which a judged command may cease to act."""


class TubeCheck:
    """The check of one problem; raises R007 if it needs more than real expressions.

    `states` has the states on which the law or a condition depends, in the order of estimates. By
    state, `read_sets` has the values that SC may read, and `rooms` the range within C, by the sets
    of published values. `turning` has angles that need not come back and range over a turn;
    `precision` is an index of `PRECISIONS`; `kink` says where runs are collected.
    """

    law: Sequence[Node]

    def __init__(self, problem: TubeProblem) -> None:
        self.problem = problem
        self.kink: Kink | None = None
        self.times = TubeTimes.of_problem(problem)
        try:
            self._read_module()
        except NoExpressionError as error:
            raise refusal(problem, str(error)) from None
        except (TooManyStatementsError, RecursionError):
            why = f"an expression is too large ({STATEMENTS_MAX:,} statements are read at most)"
            raise refusal(problem, why) from None

    def _read_module(self) -> None:
        module = ModuleExpressions(self.problem)
        self.make = module.make
        self.rates = every = self.make.rates_by_branch(module.rates())[0]
        self._read_sc(module)
        self._safe = module.constraint_condition()
        self.rooms = module.rooms
        self._rest = module.condition_of_predicate(self.problem.rest)
        asked = [*self.law, self._defined, self._safe, self._rest]
        self.states = states_read_through(asked, every)
        rates, zero = [every[s] for s in self.states], self.make.constant(0.0)
        moved = module.split_rates(rates)
        self._still, self._ranged, of_movers = moved.still, moved.ranged, enumerate(moved.effects)
        found = [(k, m, e) for m, row in of_movers for k, e in enumerate(row) if e is not zero]
        self._effects = found or [(0, 0, zero)]  # as an array must not be empty
        _, self._decided, self._branches = self.make.rates_by_branch(self._still)
        self._bends = module.derivatives_of_rates(self._decided)
        effects = [e for row in moved.effects for e in row]
        parts, slopes = [*self._still, *effects], module.derivatives_of_rates(effects)
        for condition in domain_conditions(self.make, parts, slopes):  # SC's are in `_defined`
            self._safe = self.make.join("and", self._safe, condition)
        asked = [*self.law, self._safe, self._rest]
        self.turning = turning_states(asked, rates, self.problem.drifts)
        self.rooms |= dict.fromkeys(self.turning, A_TURN)
        asked = [self._safe, self._rest, *self.law]
        near = with_rounding_of_turns(self.make, asked, self.turning)
        self._safe, self._rest, self.law = near[0], near[1], near[2:]
        self._faced = [k for k, s in enumerate(self.states) if s in states_read([self._still[k]])]
        self.read_by_law = states_read([*self.law, self._defined])
        for s in self.read_by_law & {*self.turning}:
            far = rounded_up(Fraction(FARTHEST_TURN) + Fraction(self.error_by_state()[s]))
            self.read_sets[s] = Interval(-far, far)
        self.answers_vary = bool(self.read_by_law or self.kept)
        self.precision = 0 if self.answers_vary else PLAIN  # no answer shares a symbol with a state
        self.read_by_rates = states_read(rates)
        self.read_by_rest, self.read_by_safe = map(states_read, ([self._rest], [self._safe]))
        moving = states_read_through([self._rest], every)
        self.commands_move_rest = any(reads_kind(every[s], "u") for s in moving)
        inputs = [e for e in in_order([self._defined, *asked, *rates]) if e.op == "input"]
        if any(e.of[0] not in "lxyuwm" for e in inputs):
            raise NoExpressionError("something reads a time, an age or a mode")
        endless = state_that_may_grow_without_end(self.make, self.rates, self.states)
        if endless is not None:
            name = self.problem.quantities.states[endless].name
            raise NoExpressionError(
                f"nothing bounds `{name}`, which may end (a set of its topic would)"
            )
        self._refuse_other_topics(module.seen)
        driven = {o.topic for step in self.problem.core.plants.values() for o in step.outputs}
        self._sample = {s: (t, -1 if t in driven else s) for s, (t, _) in module.seen.items()}

    def _read_sc(self, module: ModuleExpressions) -> None:
        step, topics = ScStep(module), self.problem.system.topics
        bounds = {s: topics[t].bounds[k] for s, (t, k) in module.seen.items()}
        endless = Interval(-inf, inf)
        self.read_sets = {s: Interval(b.low, b.high) if b else endless for s, b in bounds.items()}
        if name := step.find_ranges(self.read_sets):
            raise refusal(self.problem, UNBOUNDED.format(name), (BOUND, BOUND_READ))
        self.variables = {name: step.ranges[k] for name, k in step.floats.items()}
        self.law, self.kept, self._defined = (step.commands, step.ranges, step.step_condition())

    def _refuse_other_topics(self, seen: Mapping[int, tuple[int, int]]) -> None:
        """Refuses an SC that reads a state by a topic, perhaps older, that its DM does not read."""
        problem, topics = self.problem, self.problem.system.topics
        estimate = {problem.topic_leaf_of_state[s][0] for s in self.states}
        other = sorted(topics[i].name for i in {topic for topic, _ in seen.values()} - estimate)
        if other:
            raise NoExpressionError(
                f"SC sees the plant by `{other[0]}`, which its DM does not read"
            )
        unread = sorted(topics[i].name for i in estimate - topics_read(problem))
        if unread:
            raise NoExpressionError(f"only `{unread[0]}`, which nobody reads, shows a state")

    def text_in_flight(self, ways: Mapping[int, Interval]) -> str:
        """The text of the check in flight; `ways` is Y, the range of each state not in `moves`."""
        return self._joined_text(self._texts_in_flight(ways))

    def _texts_in_flight(self, ways: Mapping[int, Interval]) -> list[str]:
        shield = self.problem.module.shield
        return [*self._tube_texts(ways), *([self._judging_text(shield)] if shield else [])]

    def decision_cost(self) -> Cost:
        """The largest cost of a decision: `good`, `judged` and `toward` together, if they exist."""
        functions = functions_of(self.text_in_flight({s: Interval(-1.0, 1.0) for s in self.states}))
        every = [cost_of(functions[n]) for n in ("good", "judged", "toward") if n in functions]
        most = max(cost.bytes for cost in every)
        return every[0]._replace(operations=sum(cost.operations for cost in every), bytes=most)

    def offline_operations(self, switches: int) -> int:
        """The most operations of a function if SC has `switches` outputs; TooLongError if many."""
        shorter = copy(self)
        shorter.times = replace(self.times, switches=switches)
        functions = functions_of(
            shorter.offline_text({s: Interval(-1.0, 1.0) for s in self.states})
        )
        return max(cost_of(f).operations for f in functions.values())

    def offline_text(self, ways: Mapping[int, Interval]) -> str:
        """The text of `text_in_flight` with the functions that are called before the flight."""
        inputs = self._input_texts()
        texts = [
            sure_text("law_defined", "y: Forms", self._defined, inputs),
            sure_text("surely_not_at_rest", "x: Forms", self._rest, inputs, truth=False),
            text_of_package_file("rest.soter"),
        ]
        return self._joined_text([*self._texts_in_flight(ways), *texts])

    def _joined_text(self, parts: Sequence[str]) -> str:
        """The joined text, without parameters for maps and branches if the module has none.

        If no rate has commands as ranges, it leaves out `spread`, which widens commands.
        """
        text = text_in_precision("\n".join(parts), self.precision)
        first = self.problem.first_map
        if not any(x.of[0] == "u" for x in self._ranged):
            text = re.sub(r"spread\((\w+), \w+\)", r"\1", text)
        if not self._branches:
            text = re.sub(r"  let on = .*\n", "", text).replace(ON, "").replace(", on)", ")")
        if not first:
            for map_text in (f", {MAP}: Map", f", {MAP}", ", FIRST_MAP"):
                text = text.replace(map_text, "")
            return text
        lines = [
            f"const MAPS: int = {len(first)};",
            "type Map = float[MAPS];",
            f"const FIRST_MAP: Map = {numbers_text(first)};",
        ]
        return "\n".join([*lines, text])

    def _judging_text(self, shield: Shield) -> str:
        """The text of the functions and constants that judge a command (`judged.soter`)."""
        times = self.times
        command_ns = times.latest - times.any_command
        numbers = len(self.problem.system.topics[shield.topic].default)
        edges = (command_edges(r.low, r.high, shield.cells) for r in self.problem.controls)
        cells = [numbers_text(e) for e in edges]
        lines = [
            f"const CELLS: int = {shield.cells};",
            f"const HELD: int = {numbers};",
            f"const EDGES: float[CELLS + 1][{len(cells)}] = {array_text(cells)};",
            f"const ENDINGS: int = {ENDINGS};",
            f"const ENDING: float = {number_text(nearest_seconds(command_ns, ENDINGS))};",
            f"const ANY_FOR: float = {number_text(nearest_seconds(times.any_command))};",
        ]
        moving = [] if shield.proposed is None else [self._moving_text()]
        return "\n".join([*lines, text_of_package_file("judged.soter"), *moving])

    def _moving_text(self) -> str:
        """The text of the functions and constants that move a command (`toward.soter`)."""
        topics, controls = self.problem.system.topics, self.problem.quantities.controls
        places = [(i, p) for i in self.problem.module.outputs for p, _ in leaves(topics[i].type)]
        lasting_ns = self.times.latest - self.times.any_command + self.problem.lead_ns
        at, count = [str(places.index((c.owner, c.path))) for c in controls], len(places)
        tried, text = self.problem.module.symbol.candidates, text_of_package_file("toward.soter")
        more = 0 if tried is None else sum(1 for _ in leaves(tried.type)) // count
        if more:
            each = "s == 0 ? a : wanted[(s + 1) * NUMBERS + NUMBER[k]]"
            text = re.sub(r"clamp\(a \+ .*\)(?= : b;)", each, text)
        sizes = {"NUMBERS": count, "WANTED": (2 + more) * count, "FOUND": count + 1}
        sizes["WAY"] = 1 + more if more else WAY
        lines = [
            *(f"const {name}: int = {size};" for name, size in sizes.items()),
            f"const LASTING: float = {number_text(nearest_seconds(lasting_ns, ENDINGS))};",
            f"const NUMBER: int[CONTROLS] = {array_text(at)};",
            f"const NO_COMMAND: float[CONTROLS] = {numbers_text([0.0] * len(at))};",
            f"const NOT_FOUND: float[FOUND] = {numbers_text([0.0] * (count + 1))};",
        ]
        return "\n".join([*lines, text])

    def _input_texts(self, of: str = FORMS) -> Inputs:
        """The text of each input, by kind and number; a state has its index in `states`."""
        places = [(s, k) for k, s in enumerate(self.states)]
        found = {(kind, s): f"{kind}[{k}]" for kind in "xyv" for s, k in places}
        q = self.problem.quantities
        found |= {("w", k): f"WIND_{of}[{k}]" for k in range(len(q.disturbances))}
        found |= {("l", k): f"KEPT_BY_SC[{k}]" for k, _ in enumerate(self.kept)}
        return found | {("u", k): f"u[{k}]" for k in range(len(q.controls))}

    def _tube_texts(self, ways: Mapping[int, Interval]) -> list[str]:
        """The texts of the tube's constants and functions, the same in flight and offline."""
        inputs, ranges = self._input_texts(), self._input_texts(RANGES)
        constant = text_of_package_file(
            "constant.soter"
        )  # simpler functions of an SC that reads nothing
        return [
            self._constants_text(),
            text_of_package_file("forms.soter"),
            text_of_package_file("tube.soter"),
            self._ranged_movers_text(),
            fun_text("rates", f"x: Forms, u: Controls{ON}", self._decided, inputs, "Forms"),
            fun_text("speeds", RANGED, self._still, ranges, "Ranges", RANGES),
            fun_text("effects", RANGED, [e for *_, e in self._effects], ranges, "Effects", RANGES),
            fun_text("bends", f"x: Forms, u: Controls, v: Forms{ON}", self._bends, inputs, "Forms"),
            *([decided_text("branches", RANGED, self._branches, ranges)] if self._branches else []),
            self._rates_by_number_text(ranges),
            fun_text("law", "y: Forms", self.law, inputs, "Controls"),
            sure_text("safe", f"x: Forms, {MAP}: Map", self._safe, inputs, first=self._map_guard()),
            sure_text("rests", "x: Forms", self._rest, inputs),
            self._at_rest_text(ways),
            text_of_package_file("check.soter"),
            text_that_follows_sc(self.states, self.kink) if self.answers_vary else constant,
        ]

    def _map_guard(self) -> str:
        """The first lines of `safe`, which refuse a map with NaN or a number beyond `FARTHEST`."""
        asked = f"    if !(abs({MAP}[k]) < {number_text(FARTHEST)}) {{ return false; }}"
        return f"  for k in 0..MAPS {{\n{asked}\n  }}\n" if self.problem.map_leaves else ""

    def _ranged_movers_text(self) -> str:
        """The text of the ranges of disturbances and commands that stand in rates as ranges."""
        lines, winds = [], self.problem.disturbances
        if any(reads_kind(x, "w") for x in self._ranged):
            forms = [form_text(middle(d), half_width(d), d.low, d.high) for d in winds]
            ranges = [f"{{ lo: {number_text(d.low)}, hi: {number_text(d.high)} }}" for d in winds]
            pairs = (f"{FORMS}: Form", forms), (f"{RANGES}: Range", ranges)
            lines += [f"const WIND_{of}[{len(winds)}] = {array_text(x)};" for of, x in pairs]
        if control_numbers := [x.of[1] for x in self._ranged if x.of[0] == "u"]:
            lines += ["fun spread(u: Controls, wide: Wide): Controls {", "  var v = u;"]
            for k in control_numbers:
                ends = ", ".join(map(number_text, astuple(self.problem.controls[k])))
                lines.append(f"  v[{k}] = cut(widened(u[{k}], wide[DISTURBANCES + {k}]), {ends});")
            lines += ["  return v;", "}"]
        return "\n".join(lines)

    def _rates_by_number_text(self, inputs: Inputs) -> str:
        """The text of `fun faced` for `tube.soter`; it gives the rate of a state by its number."""
        lines, calls = [], "  return EVERYTHING;"
        for k in self._faced:
            rate = [self._still[k]]
            lines.append(fun_text(f"rate_{k}", RANGED, rate, inputs, "Range[1]", RANGES))
            movers = [m for state, m, _ in self._effects if state == k]
            body = [f"    return rate_{k}(x, u)[0];"]
            if movers:
                effects = [e for state, _, e in self._effects if state == k]
                result = f"Range[{len(movers)}]"
                lines.append(fun_text(f"effects_{k}", RANGED, effects, inputs, result, RANGES))
                sizes = [f"size(b[{p}])" for p, _ in enumerate(movers)]
                added = " + ".join(f"{b} * wide[{m}]" for b, m in zip(sizes, movers, strict=True))
                off = f"{' + '.join(sizes)} > 0.0 ? ({added}) * GROW + TINY : 0.0"
                moved = f"i_widened(rate_{k}(x, u)[0], {off})"
                body = [f"    let b = effects_{k}(x, a);", f"    return {moved};"]
            taken = "\n".join(body)
            calls = f"  if i == {k} {{\n{taken}\n  }} else {{\n{calls}\n  }}"
        head = "fun faced(i: int, x: Ranges, u: Orders, a: Orders, wide: Wide): Range"
        return "\n".join([*lines, f"{head} {{\n{calls}\n}}\n"])

    def _at_rest_text(self, ways: Mapping[int, Interval]) -> str:
        """The text of `fun at_rest`: `rest` holds, and `safe` wherever SC may move from there."""
        lines, read = [], self.read_by_safe
        for k, s in enumerate(self.states):
            if s in read and (drift := self.problem.drifts.get(s)) is not None:
                ends = f"x[{k}], {number_text(-drift.below)}, {number_text(drift.above)}"
                lines.append(f"  m[{k}] = moved({ends});")
            elif s in read and (way := ways.get(s)) is not None:
                lines.append(
                    f"  m[{k}] = f_range({number_text(way.low)}, {number_text(way.high)});"
                )
            elif s in read:
                lines.append("  if true { return false; }  // nothing is shown of where it goes")
        body = "\n".join(["  if !rests(x) { return false; }", "  var m = x;", *lines])
        head = f"fun at_rest(x: Forms, {MAP}: Map): bool"
        return f"{head} {{\n{body}\n  return safe(m, {MAP});\n}}\n"

    def error_by_state(self) -> dict[int, float]:
        """The bound of the measurement error of each state in `states`, by the state's number."""
        p, found = self.problem, dict.fromkeys(self.states, 0.0)
        for leaf, bounds in zip(p.quantities.errors, p.errors, strict=True):
            paths = [path for path, _ in leaves(p.system.topics[leaf.owner].type)]
            state = p.state_of_leaf.get((leaf.owner, paths.index(leaf.path)))
            if state in found:
                found[state] = max(found[state], -bounds.low, bounds.high)
        return found

    def _constants_text(self) -> str:
        """The text of all constants, which are sizes, times in seconds, and ranges."""
        sizes = self._whole_number_constants()
        if sizes["SYMBOLS"] > SYMBOLS_MAX:
            msg = f"{sizes['SYMBOLS']} symbols of a form: more than {SYMBOLS_MAX}"
            raise refusal(self.problem, msg)
        lines = [f"const {name}: int = {value};" for name, value in sizes.items()]
        lines += [f"const {name}: float = {number_text(t)};" for name, t in self._seconds().items()]
        shares = str(PRECISIONS[self.precision].shares).lower()
        lines += [f"const SHARES: bool = {shares};"]
        lines += [f"const RESET: float = {0.5 if self.answers_vary else 0.9};"]
        return "\n".join([*lines, *self._array_lines(sizes)]) + "\n"

    def _whole_number_constants(self) -> dict[str, int]:
        """The integer constants by name: counts of states, commands, ...; and first symbols."""
        q, times, n = self.problem.quantities, self.times, len(self.states)
        moved = len(q.controls) + len(q.disturbances)
        keep, _, steps, order = PRECISIONS[self.precision]
        stride = moved + n * (steps > 1)
        read = 2 * n + keep
        commands = read + n + len(self.kept)
        closed = commands + len(q.controls)
        moves = closed + moved
        symbols, holds = moves + stride * steps + 1, times.switches + 1
        depth = times.depth
        if not self.answers_vary:  # no command shares a symbol with a state, and none switches
            closed = moves = read
            symbols, holds, depth = read + max(moved, n) + 1, 2 * holds, 1
        return {
            "SYMBOLS": symbols, "STATES": n, "CONTROLS": len(q.controls),
            "DISTURBANCES": len(q.disturbances), "MOVED": moved,
            "EFFECTS": len(self._effects), "KEEP": keep, "READS": read, "COMMANDS": commands,
            "CLOSED": closed, "SAMPLES": len(self._sources_of_reads()),
            "MOVES": moves, "ATTEMPTS": ATTEMPTS, "FREE_STEPS": FREE, "STEPS": steps,
            "HOLDS": holds, "DEPTH": depth, "ACTED": depth * len(q.controls),
            "FACES": len(self._faced),
            "TIME": symbols - 1, "LEVELS": LEVELS, "PARTS": PARTS,
            "BRANCHES": 2 * len(self._branches),
            **({"STRIDE": stride, "ORDER": order} if steps > 1 else {}),
        }  # fmt: skip

    def _sources_of_reads(self) -> list[tuple[int, int]]:
        """The sources of SC's reads, as (topic, state or -1); each shows only one instant."""
        return sorted({self._sample[s] for s in self.read_by_law}) or [(-1, -1)]

    def _seconds(self) -> dict[str, float]:
        """The constants that are times, in s, by name."""
        times, steps = self.times, PRECISIONS[self.precision].steps
        begin = max(0, times.start - times.period - times.jitter)
        return {
            "FREE_STEP": nearest_seconds(times.earliest, FREE),
            "WINDOW": nearest_seconds(times.latest - times.earliest),
            "START_STEP": nearest_seconds(begin, FREE),
            "START_WINDOW": nearest_seconds(times.start - begin),
            "LATE_READ": rounded_up(Fraction(times.delay, 10**9)),
            "JITTER": nearest_seconds(times.jitter),
            "FIRST_STEP": nearest_seconds(times.period - times.jitter, steps),
            "LATER_STEP": nearest_seconds(times.period - 2 * times.jitter, steps),
            "SHORTEST": nearest_seconds(times.period, 2),
            "LONGEST": nearest_seconds(LONGEST * times.period),
            "SETTLED": nearest_seconds(times.switches * times.period),
        }

    def _kept_form_texts(self, sizes: Mapping[str, int]) -> list[str]:
        """The text of a form for each number that SC keeps; each form has a separate symbol."""
        forms, first = [], sizes["READS"] + sizes["STATES"]
        for k, r in enumerate(self.kept, first):
            g = [half_width(r) * (i == k) for i in range(sizes["SYMBOLS"])]
            form = form_text(middle(r), 0.0, r.low, r.high)
            forms.append(form.replace("NONE", numbers_text(g)))
        return forms

    def _array_lines(self, sizes: Mapping[str, int]) -> list[str]:
        """The lines of the array constants: ranges of commands, and initial values."""
        symbols, kept = sizes["SYMBOLS"], self._kept_form_texts(sizes)
        half = [half_width(c) for c in self.problem.controls]
        wide = [half_width(d) for d in self.problem.disturbances]
        n, m, faced = len(self.states), len(half), [str(k) for k in self._faced]
        effects = [f"{{ state: {k}, mover: {mover} }}" for k, mover, _ in self._effects]
        halves = [0.5 if k in self._faced else 1.0 for k in range(n)]
        middles = [exact_form_text(middle(c)) for c in self.problem.controls]
        any_of = [form_text(middle(c), half_width(c), c.low, c.high) for c in self.problem.controls]
        places = {sample: str(k) for k, sample in enumerate(self._sources_of_reads())}
        sample = [places.get(self._sample.get(s, (-1, -1)), "0") for s in self.states]
        depth = self.times.depth if self.answers_vary else 1
        earlier = [
            rounded_up(Fraction(self.times.earlier_command_ns(p), 10**9)) for p in range(depth)
        ]
        zero, low, high = (numbers_text([x] * n) for x in (0.0, inf, -inf))
        return [
            *[f"const KEPT_BY_SC: Form[{len(kept)}] = {array_text(kept)};"] * bool(kept),
            f"const NONE: float[SYMBOLS] = {numbers_text([0.0] * symbols)};",
            f"const NO_RATES: float[STATES] = {zero};",
            f"const ERRORS: float[STATES] = {numbers_text(self.error_by_state().values())};",
            f"const NOWHERE: Forms = {array_text([exact_form_text(0.0)] * n)};",
            f"const NO_RANGES: Ranges = {array_text([NO_RANGE] * n)};",
            f"const NO_ORDERS: Orders = {array_text([NO_RANGE] * m)};",
            f"const NO_PAST: Ranges[DEPTH] = {array_text(['NO_RANGES'] * depth)};",
            f"const SAMPLE: int[STATES] = {array_text(sample)};",
            f"const ANY_ACTED: Acted = {array_text(any_of * depth)};",
            f"const EARLIER: float[DEPTH] = {numbers_text(earlier)};",
            "type Effect = { state: int, mover: int };",
            f"const EFFECT: Effect[EFFECTS] = {array_text(effects)};",
            f"const FACED: int[{max(1, len(self._faced))}] = {array_text(faced or ['0'])};",
            f"const AT_FIRST: float[STATES] = {numbers_text(halves)};",
            f"const ANY_COMMAND: Controls = {array_text(middles)};",
            f"const ANY: Wide = {numbers_text(wide + half)};",
            f"const DISTURBED: Wide = {numbers_text(wide + [0.0] * m)};",
            f"const NO_REGION: Region = {{ lo: {zero}, hi: {zero} }};",
            f"const NO_SPAN: Region = {{ lo: {low}, hi: {high} }};",
            "const IN_FLIGHT: Wanted = { asked: false, way: NO_REGION, end: NO_REGION };",
        ]
