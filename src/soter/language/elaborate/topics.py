"""Makes the topics of a system: their value sets, first values, and the memory of modules.

Purpose: computes bounds of every leaf, defaults inside them and `max_age`, and makes one topic for
all that is wired together. Hidden topics hold what a decision module remembers: for how many
periods AC surely keeps control (`margin(M)`), what a latch waits for, which of several plans SC
follows, and until when a command in each cell of a `shield` was held. It reports modules that
cannot have a shield (M027).
Non-goals: who drives a topic (`composition_check.py`); how many periods or which commands these are
(`verify/`); how a latch moves and when commands are judged (`semantics/`,
`runtime/soter_kernel.c`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from soter.language.elaborate.candidates import why_no_candidates
from soter.language.elaborate.instantiate import Instantiation, TopicKey
from soter.language.elaborate.system_numbers import SizeCounter, TooLargeError
from soter.language.model.system import Bound, Shield, Topic
from soter.language.model.typed import TopicSymbol
from soter.language.model.types import (
    FLOAT,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    default_value,
    has_list,
    is_vector_part,
    leaves,
    numbers_in,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.elaborate.system_numbers import Values
    from soter.language.model import typed
    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import TypedExpr
    from soter.language.model.types import Type, Value


def make_margin_topics(read: Iterable[int], modules: list[Module], first: int) -> list[Topic]:
    """A hidden topic for every module whose margin some code reads, with indices from `first` on.

    `read`: indices of these modules. The modules get the topics' indices.
    """
    made: list[Topic] = []
    for index in sorted(set(read)):
        module = modules[index]
        module.looked = first + len(made)
        made.append(_memory_topic(module, "margin", module.looked, max(module.levels - 1, 1)))
    return made


def make_latch_topics(modules: Iterable[Module], first: int) -> list[Topic]:
    """A hidden topic for every module with a latch that may switch, with indices from `first` on.

    The modules get the indices of these topics and of the acknowledgements.
    """
    made: list[Topic] = []
    for module in modules:
        latch = module.symbol.latch
        if latch is None or module.forced is not None:
            continue
        module.latch = first + len(made)
        if latch.topic is not None:
            module.acknowledgement = module.scope.topics[latch.topic]
        made.append(_memory_topic(module, "latch", module.latch, 1 if latch.topic is None else 2))
    return made


def make_plan_topics(
    modules: Iterable[Module], components: Sequence[Component], first: int
) -> list[Topic]:
    """A hidden topic for every module with several plans, with indices from `first` on.

    One whose SC was replaced has none. The modules get the indices, and SC the topic.
    """
    made: list[Topic] = []
    for module in modules:
        sc, symbol = components[module.sc], module.symbol.plan
        if symbol is None or sc.node is not module.symbol.sc:
            continue
        module.plan = sc.scope.topics[symbol] = first + len(made)
        topic = _memory_topic(module, "plan", module.plan, len(module.symbol.plans) - 1)
        made.append(replace(topic, symbol=symbol))
    return made


def _memory_topic(module: Module, what: str, index: int, most: int) -> Topic:
    return _hidden_topic(module, what, index, IntType(0, most), (Bound(0, most),), 0)


def _hidden_topic(
    module: Module,
    what: str,
    index: int,
    held: Type,
    bounds: tuple[Bound | None, ...],
    default: Value,
) -> Topic:
    name = f"{module.name}.{what}"
    return Topic(
        index=index,
        name=name,
        symbol=TopicSymbol(name, module.symbol.span, held, False, {}, None, None),
        type=held,
        bounds=bounds,
        set_declared=True,
        default=default,
        max_age_ns=None,
        driver=module.name,
        held=True,
    )


NEVER_HELD = -1.0e18
"""A time in seconds before every run."""


NO_FLOATS = "is not made of floats"
AS_FLOAT = (
    "publish the number as a float; an agent still chooses, with masks: `action_space` and `act` of"
    " soter.gym make commands of a Discrete space (docs/gym.md)"
)


def make_shield_topics(
    modules: Sequence[Module],
    cells: Mapping[int, int],
    topics: Sequence[Topic],
    components: Sequence[Component],
    diagnostics: Diagnostics,
) -> list[Topic]:
    """Hidden topics for every module with a shield, with indices from `len(topics)` on.

    `cells`: module index -> into how many cells each number of its commands is cut.
    """
    made: list[Topic] = []
    for module in modules:
        clause = module.symbol.shield
        if clause is None or module.index not in cells:
            continue
        why = _why_not(module, topics, components)
        if why:
            _no_shield(module, clause, why, diagnostics)
            continue
        numbers = len(_numbers(module, topics))
        first = len(topics) + len(made)
        times = (NEVER_HELD,) * (numbers * cells[module.index])
        made.append(_topic(module, "shield", first, times))
        module.shield = Shield(cells[module.index], first)
        if module.symbol.toward_sc:
            both = 2 * _numbers(module, topics)
            made.append(_topic(module, "proposed", first + 1, both))
            module.shield.proposed = first + 1
        if (tried := module.symbol.candidates) is not None:
            module.scope.topics.setdefault(tried, components[module.ac].scope.topics[tried])
    return made


def _why_not(module: Module, topics: Sequence[Topic], components: Sequence[Component]) -> str:
    if module.symbol.ttf is not None or module.symbol.safer is not None:
        return "`ttf` and `safer` are written: what a shield permits is computed together with them"
    for i in module.outputs:
        t = topics[i].type
        if has_list(t) or not all(isinstance(leaf, FloatType) for _, leaf in leaves(t)):
            return f"`{topics[i].name}` {NO_FLOATS}"
    slow = [components[i] for i in (module.ac, module.sc) if components[i].takes_ns is not None]
    if slow:
        return f"a step of `{slow[0].name}` takes time: it is judged when it begins"
    return why_no_candidates(module, topics, components)


def refuse_overrun(
    system: System, component: Component, fault: str, diagnostics: Diagnostics
) -> None:
    """Reports M027 if a controller that a shield judges would publish later than it steps."""
    module = None if component.module is None else system.modules[component.module]
    if module is None or module.shield is None or module.symbol.shield is None:
        return
    why = f"`{fault}`: what a step publishes later is judged when it begins"
    _no_shield(module, module.symbol.shield, why, diagnostics)


def _no_shield(module: Module, clause: TypedExpr, why: str, diagnostics: Diagnostics) -> None:
    diagnostics.error(
        "M027",
        f"module `{module.symbol.name}` can have no shield",
        clause.span,
        also=((module.symbol.span, "this module"),),
        notes=(why,),
        helps=("leave `shield` out", *([AS_FLOAT] if why.endswith(NO_FLOATS) else [])),
    )


def _numbers(module: Module, topics: Sequence[Topic]) -> tuple[float, ...]:
    """The first values of all numbers in a module's commands."""
    return tuple(numbers_in(tuple(topics[i].default for i in module.outputs)))


def _topic(module: Module, what: str, index: int, default: tuple[float, ...]) -> Topic:
    size = len(default)
    return _hidden_topic(module, what, index, ArrayType(FLOAT, size), (None,) * size, default)


class Topics(Instantiation):
    """Makes the topics of one system when they are first mentioned."""

    def __init__(
        self,
        program: typed.TypedProgram,
        symbol: typed.SystemSymbol,
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
        *,
        draft: bool = False,
    ) -> None:
        super().__init__(program, symbol, overrides, diagnostics, draft=draft)
        self.measure = SizeCounter(symbol, program.system_sizes, diagnostics)
        self.topics: list[Topic] = []
        self._by_key: dict[TopicKey, Topic] = {}
        self._ranges: dict[
            tuple[typed.TopicSymbol, int], tuple[tuple[Bound | None, ...], bool, Value]
        ] = {}

    def topic(self, key: TopicKey) -> int:
        """Index of a topic, which is made when it is first mentioned.

        TooLargeError where there is no room for its values.
        """
        known = self._by_key.get(key)
        if known is None:
            prefix, symbol = key
            if not self.measure.fits(symbol.type):
                raise TooLargeError
            with self.under(self.params_at[prefix]):
                bounds, declared, default = self._range(symbol)
                max_age = self.duration(symbol.max_age, f"`max_age` of `{symbol.name}`")
            known = Topic(
                index=len(self.topics),
                name=prefix + symbol.name,
                symbol=symbol,
                type=symbol.type,
                bounds=bounds,
                set_declared=declared,
                default=default,
                max_age_ns=max_age,
                driver="",
            )
            self._by_key[key] = known
            self.topics.append(known)
        return known.index

    def queue(self, source: Topic, subscribed: typed.Subscribed, node: str) -> int:
        """Index of a new topic: the queue in which a node collects the values of `source`.

        Raises TooLargeError if there is no room for its values.
        """
        assert subscribed.queue is not None
        t = ListType(source.type, subscribed.queue)
        if not self.measure.fits(t):
            raise TooLargeError
        index = len(self.topics)
        queue = Topic(
            index=index,
            name=f"{node}.{subscribed.topic.name}.queue",
            symbol=source.symbol,
            type=t,
            bounds=source.bounds,
            set_declared=source.set_declared,
            default=(),
            max_age_ns=None,
            driver="",
            queue_of=source.index,
            policy=subscribed.policy,
        )
        self.topics.append(queue)
        source.queues = (*source.queues, index)
        return index

    def _range(self, symbol: typed.TopicSymbol) -> tuple[tuple[Bound | None, ...], bool, Value]:
        """Bounds, whether every number has one, and the first value, under these parameters."""
        key = symbol, id(self.params)
        if key not in self._ranges:
            bounds, declared = self._bounds(symbol)
            self._ranges[key] = bounds, declared, self._default(symbol, bounds)
        return self._ranges[key]

    def check_wired_sets(self) -> None:
        """Reports V010 for a wire between topics with different sets or `max_age`s."""
        for part in self.parts:
            for instance in part.system.instances:
                for inner, target in instance.renames.items():
                    home, outer = self.key(target, part.prefix, part.wires)
                    if not {inner, outer} & self.program.damaged:
                        place = f"{part.prefix}{instance.name}."
                        params = self.params_at.get(place, part.params)
                        self._same_set((inner, params), (outer, self.params_at[home]), instance)

    def _same_set(
        self,
        written: tuple[typed.TopicSymbol, Values],
        used: tuple[typed.TopicSymbol, Values],
        instance: typed.InstanceSymbol,
    ) -> None:
        """Reports V010 if the instance's topic and the one wired to it differ, by parameters."""
        inner, outer = written[0], used[0]
        (own, old), (given, new) = (self._set_and_age(*x) for x in (written, used))
        what = "other values" if any(own) and own != given else ""
        if not what and inner.max_age is not None and old != new:
            what = "another `max_age`"
        if what:
            self.diagnostics.error(
                "V010",
                f"`{outer.name}` has {what} than `{inner.name}`, in whose place it stands",
                instance.rename_spans.get(inner, instance.span),
                "wired here",
                also=((inner.span, "written for these"), (outer.span, "gets these")),
                notes=("what was concluded from a set holds for that set only",),
                helps=("declare both alike",),
            )

    def _set_and_age(
        self, symbol: typed.TopicSymbol, params: Values
    ) -> tuple[tuple[Bound | None, ...], Value | None]:
        with self.under(params):
            return self._range(symbol)[0], self.number(symbol.max_age, "a `max_age`")

    def _bounds(self, symbol: typed.TopicSymbol) -> tuple[tuple[Bound | None, ...], bool]:
        """A bound for each leaf, and whether every number has one."""
        what = f"the set of `{symbol.name}`"
        resolved: dict[tuple[str, ...], Bound] = {}
        for path, values in symbol.values.items():
            interval = self.interval(values.low, values.high, values.span, what)
            if interval is not None:
                resolved[path] = Bound(*interval)
            else:  # consequences of the error are not reported
                self.program.damaged.add(symbol)
        bounds, declared = _Bounder(resolved).bounds(symbol.type)
        if any(b is not None and b.low > b.high for b in bounds):
            self.diagnostics.error(
                "V001", f"{what} holds no value of its type `{symbol.type}`", symbol.span
            )
            self.program.damaged.add(symbol)
        return bounds, declared

    def _default(self, symbol: typed.TopicSymbol, bounds: tuple[Bound | None, ...]) -> Value:
        """The first value of a topic; reports V002 if it lies outside the set."""
        written = symbol.default
        what = f"the default of `{symbol.name}`"
        value = self.number(written, what)
        if value is None:
            value = default_value(symbol.type)
        if symbol in self.program.damaged:
            return value
        if written is None and (not any(bounds) or _all_allow_zeros(symbol.type, bounds)):
            return value
        outside = first_outside(symbol.type, value, bounds)
        if outside is not None:
            leaf, number, bound = outside
            where = f" (`{leaf}`)" if leaf else ""
            sets = tuple((r.span, "its set") for r in symbol.values.values())
            self.diagnostics.error(
                "V002",
                f"{what}{where} is {beyond(number, bound)}",
                written.span if written is not None else symbol.span,
                f"starts at {number!r}" if written is None else "",
                also=sets if len(sets) == 1 else (),
                notes=()
                if written is not None
                else ("without `= ...` a topic starts at the default of its type",),
                helps=(f"give it a first value in {shown(bound)}: `= ...`",)
                if written is None
                else (),
            )
        return value


def _all_allow_zeros(t: Type, bounds: tuple[Bound | None, ...]) -> bool:
    """Whether a value of zeros is inside all bounds; does not build the value."""
    return is_vector_part(t) and all(b is None or b.low <= 0.0 <= b.high for b in set(bounds))


def shown(bound: Bound) -> str:
    """A bound as text."""
    return f"[{bound.low!r}, {bound.high!r}]"


def beyond(number: float, bound: Bound) -> str:
    """The end of a sentence about a number that is not in its bound."""
    if math.isfinite(number):
        return f"{number!r}, outside {shown(bound)}"
    return f"{number!r}, which no topic may hold"


class _Bounder:
    """Finds the bound of each leaf of a type: the innermost declared set that covers it."""

    def __init__(self, sets: dict[tuple[str, ...], Bound]) -> None:
        self.sets = sets
        self._known: dict[tuple[int, Bound | None], tuple[tuple[Bound | None, ...], bool]] = {}

    def bounds(
        self, t: Type, path: tuple[str, ...] = (), outer: Bound | None = None
    ) -> tuple[tuple[Bound | None, ...], bool]:
        """A bound or None for each leaf of `t`, and whether every number has one."""
        outer = self.sets.get(path, outer)
        if isinstance(t, (RecordType, ArrayType, ListType)):
            if any(len(p) > len(path) and p[: len(path)] == path for p in self.sets):
                return self._part_bounds(t, path, outer)
            key = id(t), outer  # one type may occur inside another many times
            if key not in self._known:
                self._known[key] = self._part_bounds(t, path, outer)
            return self._known[key]
        if not isinstance(t, (FloatType, IntType)):
            return (None,), True
        if isinstance(t, IntType):
            outer = _inside_type(outer, t)
        return (outer,), outer is not None

    def _part_bounds(
        self, t: RecordType | ArrayType | ListType, path: tuple[str, ...], outer: Bound | None
    ) -> tuple[tuple[Bound | None, ...], bool]:
        if isinstance(t, RecordType):
            parts = [self.bounds(f, (*path, n), outer) for n, f in t.fields]
            return tuple(b for bounds, _ in parts for b in bounds), all(d for _, d in parts)
        bounds, declared = self.bounds(t.element, (*path, ""), outer)
        return bounds * (t.size if isinstance(t, ArrayType) else 1), declared


def _inside_type(bound: Bound | None, t: IntType) -> Bound | None:
    """The bound of an int cut to what its type can hold: draws and the gate rely on that."""
    if bound is None:
        return None if t.is_full else Bound(t.low, t.high)
    return Bound(max(bound.low, t.low), min(bound.high, t.high))


def first_outside(
    t: Type, value: Value, bounds: tuple[Bound | None, ...]
) -> tuple[str, float, Bound] | None:
    """The first leaf of a value outside its bound: (path, value, bound), or None."""
    violation, _ = _outside(t, value, bounds, 0, "")
    return violation


def _parts(t: RecordType | ArrayType, value: Value, path: str) -> Iterator[tuple[Type, Value, str]]:
    """Yields type, value and path of each part of a value."""
    if isinstance(t, RecordType):
        for (name, part_type), part in zip(t.fields, value, strict=True):
            yield part_type, part, f"{path}.{name}" if path else name
    else:
        yield from ((t.element, part, f"{path}[{i}]") for i, part in enumerate(value))


def _outside(
    t: Type, value: Value, bounds: tuple[Bound | None, ...], at: int, path: str
) -> tuple[tuple[str, float, Bound] | None, int]:
    """The first leaf outside, and the position in `bounds` behind this value's leaves."""
    if isinstance(t, (RecordType, ArrayType)):
        for part_type, part, where in _parts(t, value, path):
            violation, at = _outside(part_type, part, bounds, at, where)
            if violation is not None:
                return violation, at
        return None, at
    if isinstance(t, ListType):
        after = at + len(_Bounder({}).bounds(t.element)[0])
        for i, e in enumerate(value):
            violation, _ = _outside(t.element, e, bounds, at, f"{path}[{i}]")
            if violation is not None:
                return violation, after
        return None, after
    bound = bounds[at]
    if bound is None and isinstance(t, FloatType) and not math.isfinite(value):
        bound = Bound(-math.inf, math.inf)
    if bound is None or isinstance(t, (BoolType, EnumType)):
        return None, at + 1
    if bound.low <= value <= bound.high and math.isfinite(value):
        return None, at + 1
    return (path, value, bound), at + 1
