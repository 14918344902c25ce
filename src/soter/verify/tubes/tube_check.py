"""The check of a decision module by tubes, written as Soter source.

Purpose: `TubeCheck` reads a module's rates, law and predicates as expressions. Of them and of the
parts that all modules share (`forms.soter`, `tube.soter`, `check.soter`) it writes two programs:
`in_flight`, with `fun good(estimate: float[n]): bool`, which the DM calls, and `offline`, with the
functions of `rest.soter`, which are asked before anything flies.
Non-goals: asking them (`rest_claims.py`), the predicates of the DM (`tube_table.py`).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from fractions import Fraction
from importlib.resources import files
from math import inf, nextafter
from typing import TYPE_CHECKING

from soter.core.core_walks import STATEMENTS_MAX, TooManyStatementsError
from soter.language.model.tree_walk import cost_of
from soter.language.model.types import leaves
from soter.verify.deploy.shield_tables import command_edges
from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import NoExpressionError, in_order, middle
from soter.verify.tubes.generated_functions import (
    MAP,
    RANGES,
    certain,
    function,
    functions_of,
    number,
)
from soter.verify.tubes.module_expressions import ModuleExpressions
from soter.verify.tubes.problem import FARTHEST, read_by, refused

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from soter.language.model.system import Shield
    from soter.language.model.typed import Cost
    from soter.verify.tubes.expression_graph import Node
    from soter.verify.tubes.generated_functions import Inputs
    from soter.verify.tubes.problem import TubeProblem

RANGED = "x: Ranges, u: Orders"
PARTIAL = frozenset({"sqrt", "tan", "inverse", "limit"})
"""Functions that are not defined everywhere."""
SYMBOLS_MAX = 2000
"""How many symbols a form may have: the rounding bounds of `forms.soter` count on it."""
ATTEMPTS, LEVELS, PARTS = 5, 6, 4
NO_RANGE = "{ lo: 0.0, hi: 0.0 }"
FREE, STEPS, LONGEST = 2, 1, 8
"""How finely a tube is cut: steps until SC acts, steps in a period of SC, periods in one step of an
SC that reads nothing."""
CUTS = (6, True), (6, False), (40, True)
"""Ways to shorten forms: how many columns are kept, and whether the largest as shares of their
state's width are kept (True) or the largest as they are."""
PLAIN, MOST = 1, 2
ENDINGS = 2
"""Into how many parts the time is cut in which a judged command may cease to act."""


@dataclass(frozen=True)
class TubeTimes:
    """Times of a tube in ns, after the estimate (docs/proof-flight.md, "Decisions by tubes")."""

    earliest: int
    """alpha: no output of SC is complete before."""
    latest: int
    """H, the look-ahead: an output of SC is complete by then."""
    start: int
    """h_0: in a new run an output of SC is complete by then."""
    delay: int
    """d: the age of the state behind a command that begins to act, at most."""
    jitter: int
    """j: the length of the window in which an output of SC acts."""
    period: int
    """delta: the period of SC."""
    switches: int
    """N_T: after this many outputs of SC, the first not counted, the plant has to be at rest."""
    any_command: int = 0
    """W: where commands are judged, any command may act for this long before SC's output does."""

    @property
    def depth(self) -> int:
        """How many periods of SC a read may reach back: those in d + j, at least 1."""
        return max(1, -(-(self.delay + self.jitter) // self.period))

    @staticmethod
    def of(problem: TubeProblem) -> TubeTimes:
        """The times of a module, from its schedule and its `within`."""
        t = problem.times
        h, j, period = t.horizon_ns, t.jitter_sc, t.delta_sc
        earliest = max(t.delta_dm - t.late_dm + t.acts_least, h - period - j, 0)
        switches = (problem.within_ns - j) // period
        any_command = t.schedule.h_star - t.age_dm - t.delta_dm - t.acts_least
        times = min(earliest, h), h, t.start, t.delay_sc, j, period, switches
        return TubeTimes(*times, min(any_command, h))


class TubeCheck:
    """The expressions of one problem; `SoterError` R007 where something is none of reals.

    `states`: those that the law or a condition depends on, in the order of estimates; no rate of
    theirs reads another one. `read_sets`: the set of what SC reads of a state; `rooms`: its range
    within C, by the sets of what plants publish; `cut`: which of `CUTS` the tubes use: each is
    sound, and `leading_back.py` looks for one that shows rest.
    """

    def __init__(self, problem: TubeProblem) -> None:
        self.problem = problem
        self.times = TubeTimes.of(problem)
        try:
            self._read()
        except NoExpressionError as error:
            raise refused(problem, str(error)) from None
        except (TooManyStatementsError, RecursionError):
            why = f"an expression is too large ({STATEMENTS_MAX:,} statements are read at most)"
            raise refused(problem, why) from None

    def _read(self) -> None:
        module = ModuleExpressions(self.problem)
        self.make = module.make
        self.rates = every = module.rates()
        self.law = module.law()
        self._defined = module.law_defined(self.law)
        self._safe = module.constraint()
        self.rooms = module.rooms
        self._rest = module.predicate(self.problem.rest)
        asked = [*self.law, self._defined, self._safe, self._rest]
        self.states = _states_read_through(asked, every)
        self.read_by_law = _states_read([*self.law, self._defined])
        self.cut = 0 if self.read_by_law else PLAIN  # no answer shares a symbol with a state
        self.read_by_rates = _states_read([every[s] for s in self.states])
        self.read_by_rest = _states_read([self._rest])
        every_input = in_order([*asked, *(every[s] for s in self.states)])
        if any(e.op == "input" and e.of[0] not in "xyuwm" for e in every_input):
            raise NoExpressionError("something reads a time, an age or a mode")
        self._left_out()
        self._reads_what_sc_reads(module.seen)
        self.read_sets = {s: self._set_of(t, k) for s, (t, k) in module.seen.items()}
        rates = [every[s] for s in self.states]
        self._still = module.still(rates)
        every_effect = enumerate(module.effects(rates, self._still))
        zero = self.make.number(0.0)
        self._effects = [
            (k, m, e) for m, row in every_effect for k, e in enumerate(row) if e is not zero
        ] or [(0, 0, zero)]  # no array is empty
        self._bends = module.bends(self._still)
        self._faced = [k for k, s in enumerate(self.states) if s in _states_read([self._still[k]])]

    def _set_of(self, topic: int, leaf: int) -> Interval:
        """The declared set of a leaf of a topic."""
        bound = self.problem.system.topics[topic].bounds[leaf]
        return Interval(-inf, inf) if bound is None else Interval(bound.low, bound.high)

    def _left_out(self) -> None:
        """Refuses a state that is not followed and may grow without end in finite time.

        It cannot where its rate is defined everywhere and affine in the states that are left out.
        """
        names = self.problem.quantities.states
        left = set(range(len(names))) - set(self.states)
        for s in left:
            rate = self.rates[s]
            partial = any(e.op in PARTIAL for e in in_order([rate]))
            along = [self.make.input("x", k) for k in _states_read([rate]) & left]
            slopes = [self.make.along(rate, {x: self.make.number(1.0)}, {}) for x in along]
            if partial or _states_read(slopes) & left:
                raise NoExpressionError(
                    f"nothing bounds `{names[s].name}`, which may end (a set of its topic would)"
                )

    def _reads_what_sc_reads(self, seen: Mapping[int, tuple[int, int]]) -> None:
        """Refuses an SC that sees plants by a topic the DM does not read: it may be older (2.)."""
        problem, topics = self.problem, self.problem.system.topics
        estimate = {topic for topic, _ in self.estimate}
        other = sorted(topics[i].name for i in {topic for topic, _ in seen.values()} - estimate)
        if other:
            raise NoExpressionError(
                f"SC sees the plant by `{other[0]}`, which its DM does not read"
            )
        unread = sorted(topics[i].name for i in estimate - read_by(problem))
        if unread:
            raise NoExpressionError(f"only `{unread[0]}`, which nobody reads, shows a state")

    @property
    def estimate(self) -> list[tuple[int, int]]:
        """(topic, leaf) of each of `states`."""
        at = self.problem.topic_leaf_of_state
        return [at[s] for s in self.states]

    def in_flight(self, ways: Mapping[int, Interval]) -> str:
        """The text that flies; `ways`: Y of each state that `moves` does not name, as was shown."""
        judge = (
            [] if self.problem.module.shield is None else [self._judge(self.problem.module.shield)]
        )
        return self._with_maps([*self._parts(ways), self._check(), *judge])

    def cost(self) -> Cost:
        """The worst cost of one decision: `good`, and `judged` where commands are judged."""
        known = self.in_flight({s: Interval(-1.0, 1.0) for s in self.states})
        functions = functions_of(known)
        look = cost_of(functions["good"])
        if self.problem.module.shield is None:
            return look
        judged = cost_of(functions["judged"])
        both = look.operations + judged.operations
        return look._replace(operations=both, bytes=max(look.bytes, judged.bytes))

    def operations(self, switches: int) -> int:
        """Operations of the dearest function, for `switches` outputs of SC; `TooLongError`."""
        shorter = copy(self)
        shorter.times = replace(self.times, switches=switches)
        functions = functions_of(shorter.offline({}))
        return max(cost_of(f).operations for f in functions.values())

    def offline(self, ways: Mapping[int, Interval]) -> str:
        """The text of `in_flight` with the functions that are asked before anything flies."""
        parts = self._parts(ways)
        over = self._over()
        return self._with_maps(
            [
                *parts,
                self._check(),
                certain("law_defined", "y: Forms", self._defined, over),
                certain("surely_not_at_rest", "x: Forms", self._rest, over, truth=False),
                part("rest.soter"),
            ]
        )

    def _with_maps(self, parts: Sequence[str]) -> str:
        """The joined text; in that of a module without maps no function has a map parameter."""
        text, first = "\n".join(parts), self.problem.first_map
        if not first:
            for given in (f", {MAP}: Map", f", {MAP}", ", FIRST_MAP"):
                text = text.replace(given, "")
            return text
        lines = [
            f"const MAPS: int = {len(first)};",
            "type Map = float[MAPS];",
            f"const FIRST_MAP: Map = {_vector(first)};",
        ]
        return "\n".join([*lines, text])

    # ------------------------------------------------------------ parts

    def _check(self) -> str:
        """The functions that follow SC; an SC that reads nothing has simpler ones."""
        settles = "answer.soter" if self.read_by_law else "constant.soter"
        return "\n".join([part("check.soter"), part(settles)])

    def _judge(self, shield: Shield) -> str:
        """The functions and constants that judge a command (`judged.soter`)."""
        times = self.times
        of_v = times.latest - times.any_command
        numbers = len(self.problem.system.topics[shield.topic].default)
        cells = [command_edges(r.low, r.high, shield.cells) for r in self.problem.controls]
        edges = f"float[CELLS + 1][{len(cells)}]"
        lines = [
            f"const CELLS: int = {shield.cells};",
            f"const HELD: int = {numbers};",
            f"const EDGES: {edges} = {_array_text([_vector(e) for e in cells])};",
            f"const ENDINGS: int = {ENDINGS};",
            f"const ENDING: float = {number(near(of_v, ENDINGS))};",
            f"const ANY_FOR: float = {number(near(times.any_command))};",
        ]
        return "\n".join([*lines, part("judged.soter")])

    def _over(self) -> Inputs:
        """The text for each input; a state is indexed by its place in `states`."""
        places = [(s, k) for k, s in enumerate(self.states)]
        found = {(kind, s): f"{kind}[{k}]" for kind in "xyv" for s, k in places}
        controls = range(len(self.problem.quantities.controls))
        return found | {("u", k): f"u[{k}]" for k in controls}

    def _parts(self, ways: Mapping[int, Interval]) -> list[str]:
        over = self._over()
        return [
            self._constants(),
            part("forms.soter"),
            part("tube.soter"),
            function("rates", "x: Forms, u: Controls", self._still, over, "Forms"),
            function("speeds", RANGED, self._still, over, "Ranges", RANGES),
            function("effects", RANGED, [e for *_, e in self._effects], over, "Effects", RANGES),
            function("bends", "x: Forms, u: Controls, v: Forms", self._bends, over, "Forms"),
            self._rate_by_number(over),
            function("law", "y: Forms", self.law, over, "Controls"),
            certain("safe", f"x: Forms, {MAP}: Map", self._safe, over, first=self._known()),
            certain("rests", "x: Forms", self._rest, over),
            self._at_rest(ways),
        ]

    def _known(self) -> str:
        """The first lines of `safe`: false for a map with a NaN or a number beyond `FARTHEST`."""
        asked = f"    if !(abs({MAP}[k]) < {number(FARTHEST)}) {{ return false; }}"
        return f"  for k in 0..MAPS {{\n{asked}\n  }}\n" if self.problem.map_leaves else ""

    def _rate_by_number(self, over: Inputs) -> str:
        """`fun faced`, which `tube.soter` calls for the rate of one state by its number."""
        lines, calls = [], "  return EVERYTHING;"
        for k in self._faced:
            of = [(m, e) for i, m, e in self._effects if i == k]
            lines.append(function(f"rate_{k}", RANGED, [self._still[k]], over, "Range[1]", RANGES))
            moved = [f"size(b[{p}]) * wide[{m}]" for p, (m, _) in enumerate(of)]
            if moved:
                effects = [e for _, e in of]
                result = f"Range[{len(of)}]"
                lines.append(function(f"effects_{k}", RANGED, effects, over, result, RANGES))
                moved = [f"    let b = effects_{k}(x, a);", f"    let d = {' + '.join(moved)};"]
            else:
                moved = ["    let d = 0.0;"]
            moved.append(f"    return i_widened(rate_{k}(x, u)[0], d * GROW + TINY);")
            body = "\n".join(moved)
            calls = f"  if i == {k} {{\n{body}\n  }} else {{\n{calls}\n  }}"
        head = "fun faced(i: int, x: Ranges, u: Orders, a: Orders, wide: Wide): Range"
        return "\n".join([*lines, f"{head} {{\n{calls}\n}}\n"])

    def _at_rest(self, ways: Mapping[int, Interval]) -> str:
        """`fun at_rest`: `rest` holds, and `safe` holds in all that SC may move to from there."""
        lines = []
        read = _states_read([self._safe])
        for k, s in enumerate(self.states):
            drift = self.problem.drifts.get(s)
            if s not in read:
                continue
            if drift is not None:
                ends = f"x[{k}], {number(-drift.below)}, {number(drift.above)}"
                lines.append(f"  m[{k}] = moved({ends});")
            elif s in ways:
                way = ways[s]
                lines.append(f"  m[{k}] = f_range({number(way.low)}, {number(way.high)});")
            else:
                lines.append("  if true { return false; }  // nothing is shown of where it goes")
        body = "\n".join(["  if !rests(x) { return false; }", "  var m = x;", *lines])
        head = f"fun at_rest(x: Forms, {MAP}: Map): bool"
        return f"{head} {{\n{body}\n  return safe(m, {MAP});\n}}\n"

    def errors(self) -> list[float]:
        """The error bound of each of `states`, as it is measured."""
        p = self.problem
        found = dict.fromkeys(range(len(p.quantities.states)), 0.0)
        for leaf, bounds in zip(p.quantities.errors, p.errors, strict=True):
            paths = [path for path, _ in leaves(p.system.topics[leaf.owner].type)]
            state = p.state_of_leaf.get((leaf.owner, paths.index(leaf.path)))
            if state is not None:
                found[state] = max(found[state], -bounds.low, bounds.high)
        return [found[s] for s in self.states]

    def _constants(self) -> str:
        """The constants of the text: sizes, times in seconds, and ranges."""
        q, times = self.problem.quantities, self.times
        n, m, w = len(self.states), len(q.controls), len(q.disturbances)
        moved = m + w
        keep, shares = CUTS[self.cut]
        read = 2 * n + keep
        closed, moves = read + n, read + n + moved
        symbols, holds = moves + moved * STEPS + 1, times.switches + 1
        if not self.read_by_law:  # no command shares a symbol with a state, and none switches
            closed = moves = read
            symbols, holds = read + max(moved, n) + 1, 2 * holds
        if symbols > SYMBOLS_MAX:
            msg = f"{symbols} symbols of a form: more than {SYMBOLS_MAX}"
            raise refused(self.problem, msg)
        whole = {
            "SYMBOLS": symbols, "STATES": n, "CONTROLS": m, "DISTURBANCES": w, "MOVED": moved,
            "EFFECTS": len(self._effects), "KEEP": keep, "READS": read, "CLOSED": closed,
            "MOVES": moves, "ATTEMPTS": ATTEMPTS, "FREE_STEPS": FREE, "STEPS": STEPS,
            "HOLDS": holds, "DEPTH": times.depth, "FACES": len(self._faced),
            "TIME": symbols - 1, "LEVELS": LEVELS, "PARTS": PARTS,
        }  # fmt: skip
        begin = max(0, times.start - times.period - times.jitter)
        seconds = {
            "FREE_STEP": near(times.earliest, FREE),
            "WINDOW": near(times.latest - times.earliest),
            "START_STEP": near(begin, FREE),
            "START_WINDOW": near(times.start - begin),
            "LATE_READ": above(Fraction(times.delay, 10**9)),
            "JITTER": near(times.jitter),
            "FIRST_STEP": near(times.period - times.jitter, STEPS),
            "LATER_STEP": near(times.period - 2 * times.jitter, STEPS),
            "SHORTEST": near(times.period, 2),
            "LONGEST": near(LONGEST * times.period),
            "SETTLED": near(times.switches * times.period),
        }
        lines = [f"const {name}: int = {value};" for name, value in whole.items()]
        lines += [f"const {name}: float = {number(t)};" for name, t in seconds.items()]
        lines += [f"const SHARES: bool = {str(shares).lower()};"]
        lines += [f"const RESET: float = {0.5 if self.read_by_law else 0.9};"]
        half = [half_width(c) for c in self.problem.controls]
        wide = [half_width(d) for d in self.problem.disturbances]
        zero, faced = form(0.0), [str(k) for k in self._faced]
        effects = [f"{{ state: {k}, mover: {mover} }}" for k, mover, _ in self._effects]
        halves = [0.5 if k in self._faced else 1.0 for k in range(n)]
        middles = [form(middle(c)) for c in self.problem.controls]
        lines += [
            f"const NONE: float[SYMBOLS] = {_vector([0.0] * symbols)};",
            f"const NO_RATES: float[STATES] = {_vector([0.0] * n)};",
            f"const ERRORS: float[STATES] = {_vector(self.errors())};",
            f"const NOWHERE: Forms = {_array_text([zero] * n)};",
            f"const NO_RANGES: Ranges = {_array_text([NO_RANGE] * n)};",
            f"const NO_ORDERS: Orders = {_array_text([NO_RANGE] * m)};",
            f"const NO_FORMS: Forms[DEPTH] = {_array_text(['NOWHERE'] * times.depth)};",
            "type Effect = { state: int, mover: int };",
            f"const EFFECT: Effect[EFFECTS] = {_array_text(effects)};",
            f"const FACED: int[{max(1, len(self._faced))}] = {_array_text(faced or ['0'])};",
            f"const AT_FIRST: float[STATES] = {_vector(halves)};",
            f"const ANY_COMMAND: Controls = {_array_text(middles)};",
            f"const ANY: Wide = {_vector(wide + half)};",
            f"const DISTURBED: Wide = {_vector(wide + [0.0] * m)};",
            f"const NO_REGION: Region = {{ lo: {_vector([0.0] * n)}, hi: {_vector([0.0] * n)} }};",
            f"const NO_SPAN: Region = {{ lo: {_vector([inf] * n)}, hi: {_vector([-inf] * n)} }};",
            "const IN_FLIGHT: Wanted = { asked: false, way: NO_REGION, end: NO_REGION };",
        ]
        return "\n".join(lines) + "\n"


def near(ns: int, parts: int = 1) -> float:
    """The double nearest to `ns / parts`, in seconds: `flow` allows for that rounding."""
    return float(Fraction(ns, 10**9 * parts))


def above(x: Fraction) -> float:
    """The least double that is at least `x`."""
    value = float(x)
    return value if Fraction(value) >= x else nextafter(value, inf)


def half_width(r: Interval) -> float:
    """How far a range goes from its middle, rounded up."""
    m = Fraction(middle(r))
    return above(max(Fraction(r.high) - m, m - Fraction(r.low)))


def part(name: str) -> str:
    """The file `name` of this package, a text that is the same for all modules."""
    return (files(__package__) / name).read_text(encoding="utf-8")


def _states_read(roots: Iterable[Node]) -> set[int]:
    """The numbers of the states that some expressions read, as they are (x) or as SC reads (y)."""
    return {e.of[1] for e in in_order(list(roots)) if e.op == "input" and e.of[0] in "xy"}


def _states_read_through(asked: Iterable[Node], rates: Sequence[Node]) -> list[int]:
    """The states that `asked` reads, those that their rates read, and so on, in order."""
    found: set[int] = set()
    new = _states_read(asked)
    while new - found:
        found |= new
        new = _states_read([rates[s] for s in found])
    return sorted(found)


def form(value: float) -> str:
    """The text of a form that is one number without error."""
    v = number(value)
    return f"{{ c: {v}, r: 0.0, lo: {v}, hi: {v}, g: NONE }}"


def _vector(values: Iterable[float]) -> str:
    return _array_text([number(float(v)) for v in values])


def _array_text(items: Sequence[str]) -> str:
    return f"[{', '.join(items)}]"
