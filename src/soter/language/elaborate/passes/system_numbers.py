"""Computes the numbers of a system: parameters, constant expressions, and its size.

Purpose: finds the value of each parameter in each instance, and evaluates periods, counts and
intervals with checks of their ranges. It counts instances and numbers before it makes them, as a
few lines can ask for 2^50 instances; then it reports M007. It warns of settings of instances that
nothing there reads (W010).
Non-goals: what the numbers are for (`make_components.py`), the exact size of the state
(`core/layout.py`).

The rule: inside an instance a parameter has the value that is set for this instance, or else the
value that it has around it. If several set it for one instance, the first of these wins: the
command line, the test, systems from the outermost in. The value around everything comes from the
first of: the command line, the test, the system that runs, the default.
"""

from __future__ import annotations

import math
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

from soter.diagnostics.fixes import exchange_bounds
from soter.language.check.constants_and_types import Calculator
from soter.language.check.declarations import scalar_text
from soter.language.check.parts.node import UNKNOWN
from soter.language.model import typed
from soter.language.model.types import leaf_count, show_ns

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.model.types import Type, Value

    Reads = frozenset[typed.ParamSymbol]


Values = dict[typed.ParamSymbol, Any]


class Parameters:
    """The parameters of one running system.

    `everywhere` has the values that apply unless an instance has another. `named` has these and the
    values of instances, by full name (`GAIN`, `r[0].GAIN`), for reports and overrides.
    """

    def __init__(
        self,
        program: typed.TypedProgram,
        sets: Iterable[typed.SetSymbol],
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
    ) -> None:
        self.program = program
        self.overrides = overrides
        self.diagnostics = diagnostics
        self._set: dict[tuple[str, typed.ParamSymbol], typed.SetSymbol] = {}
        self._known: dict[object, Values] = {}
        self.add_settings("", sets)
        self.everywhere: Values = {
            p: self._setting_for("", p, p.default.value)
            for p in program.params.values()
            if isinstance(p.default, typed.Literal)
        }
        self.named: dict[str, Value] = {p.name: v for p, v in self.everywhere.items()}

    def add_settings(self, prefix: str, sets: Iterable[typed.SetSymbol]) -> None:
        """Adds settings of a system below `prefix`; settings of outer systems take precedence."""
        for item in sets:
            if item.path or not prefix:
                self._set.setdefault((prefix + item.path, item.param), item)

    def values_inside(self, path: str, around: Values) -> Values:
        """Gives the values in the instance at a full path; `around` itself if none is set there."""
        set_here = {p: v for p in around if (v := self._setting_for(path, p, None)) is not None}
        if not set_here:
            return around
        self.named |= {f"{path}.{p.name}": v for p, v in set_here.items()}
        key = id(around), repr([(id(p), v) for p, v in set_here.items()])
        return self._known.setdefault(key, {**around, **set_here})

    def settings_of_instances(self) -> list[typed.SetSymbol]:
        """Gives the settings for existing instances, each with the full path."""
        return [
            replace(item, path=path)
            for (path, param), item in self._set.items()
            if path and f"{path}.{param.name}" in self.named
        ]

    def is_set_around(self, param: typed.ParamSymbol, path: str) -> bool:
        """Whether a value is set for everything, or for an instance around `path`."""
        around = ["", *(path[:i] for i, c in enumerate(path) if c == "."), path]
        return any((at, param) in self._set for at in around)

    def _setting_for(
        self, path: str, param: typed.ParamSymbol, default: Value | None
    ) -> Value | None:
        name = f"{path}.{param.name}" if path else param.name
        if name in self.overrides:
            value = self.overrides[name]
            self._require_in_range(name, param, value, (param.span, "was set to"))
            return value
        item = self._set.get((path, param))
        if item is None:
            return default
        self._require_in_range(name, param, item.value, (item.span, "is set to"))
        return item.value

    def _require_in_range(
        self, name: str, param: typed.ParamSymbol, value: Value, set_at: tuple[Span, str]
    ) -> None:
        """Reports V007 for a value outside the range of its parameter."""
        if not isinstance(param.low, typed.Literal) or not isinstance(param.high, typed.Literal):
            return
        low, high = param.low.value, param.high.value
        if not low <= value <= high:
            span, how = set_at
            shown = [scalar_text(x, param.type) for x in (value, low, high)]
            self.diagnostics.error(
                "V007",
                f"parameter `{name}` {how} {shown[0]}, outside [{shown[1]}, {shown[2]}]",
                span,
                also=((param.span, "declared here"),) if span is not param.span else (),
            )


def has_param(
    program: typed.TypedProgram, systems: Iterable[typed.SystemSymbol], name: str
) -> bool:
    """Whether a full name means a parameter of the program, or of an instance in `systems`."""
    param = program.param(name)
    if param is None or name == param.name:
        return param is not None
    path = name[: -len(param.name) - 1].split(".")
    return any(_has_instance(system, path) for system in systems)


def _has_instance(system: typed.SystemSymbol, path: list[str]) -> bool:
    symbol: object = system
    for part in path:
        instance = symbol.by_name.get(part) if isinstance(symbol, typed.SystemSymbol) else None
        if instance is None:
            return False
        symbol = instance.what
    return True


MIN_PERIOD_NS = 1_000
MAX_PERIOD_NS = 3_600_000_000_000
MAX_TIME_NS = 2**62


class Numbers:
    """Computes the numbers of one system under its parameters."""

    def __init__(
        self,
        program: typed.TypedProgram,
        symbol: typed.SystemSymbol,
        overrides: Mapping[str, Value],
        diagnostics: Diagnostics,
    ) -> None:
        self.program = program
        self.symbol = symbol
        self.diagnostics = diagnostics
        self.parameters = Parameters(program, symbol.sets, overrides, diagnostics)
        self.params = self.parameters.everywhere
        self.calculator = Calculator(diagnostics, self.params)
        self._calculators = {id(self.params): (self.params, self.calculator)}

    @contextmanager
    def with_params(self, params: Values) -> Iterator[None]:
        """Lets the numbers inside the `with` be computed with these parameters, in one budget."""
        before, outer = self.params, self.calculator
        if params is not before:
            known = self._calculators.get(id(params))
            if known is None:
                known = params, Calculator(self.diagnostics, params)
                self._calculators[id(params)] = known
            self.params, self.calculator = known
            self.calculator.left = outer.left
        try:
            yield
        finally:
            outer.left = self.calculator.left
            self.params, self.calculator = before, outer

    # ------------------------------------------------------------ numbers

    def value_of(self, expr: typed.TypedExpr | None, subject: str) -> Value | None:
        """Gives the value of `expr` with the system's parameters; None if absent or after T020."""
        return None if expr is None else self.calculator.value(expr, subject)

    def time_ns_from(
        self, expr: typed.TypedExpr | None, subject: str, least: int, too_little: str
    ) -> int | None:
        """Gives a time of at least `least` ns; None if undeclared or after reporting C001."""
        value = self.value_of(expr, subject)
        if value is None or expr is None or value >= least:
            return value
        this = f"this is {show_ns(value)}"
        self.diagnostics.error("C001", f"{subject} {too_little}", expr.span, this)
        return None

    def _value_in_limits(
        self,
        value: Value | None,
        expr: typed.TypedExpr | None,
        subject: str,
        limits: tuple[int, int],
        shown: Callable[[int], str],
    ) -> int | None:
        """Gives `value` if it is within `limits`; None if it is absent or after reporting C002."""
        low, high = limits
        if value is None or expr is None or low <= value <= high:
            return value
        possible = f"{shown(low)} to {shown(high)} are possible"
        self.diagnostics.error("C002", f"{subject} cannot be {shown(value)}", expr.span, possible)
        return None

    def duration_ns(self, expr: typed.TypedExpr | None, subject: str) -> int | None:
        """Gives a time in ns; None without one or after C001 (not above 0), C002 (too long)."""
        if isinstance(expr, typed.Literal) and expr.name == UNKNOWN:
            return None
        value = self.time_ns_from(expr, subject, 1, "must be longer than zero")
        return self._value_in_limits(value, expr, subject, (MIN_PERIOD_NS, MAX_PERIOD_NS), show_ns)

    def run_length_ns(self, expr: typed.TypedExpr | None, subject: str) -> int | None:
        """Gives the length of a run in ns; None if it is undeclared or after a reported error."""
        value = self.time_ns_from(expr, subject, 1, "must be longer than zero")
        if value is None or expr is None or value <= MAX_TIME_NS:
            return value
        years = "at most 146 years are possible"
        self.diagnostics.error("C002", f"{subject} is too long", expr.span, years)
        return None

    def delay_ns(self, expr: typed.TypedExpr | None, subject: str) -> int | None:
        """Gives a delay in ns, which may be 0; None if undeclared or after a reported error."""
        value = self.time_ns_from(expr, subject, 0, "cannot be negative")
        return self._value_in_limits(value, expr, subject, (0, MAX_PERIOD_NS), show_ns)

    def count(self, expr: typed.TypedExpr | None, subject: str, low: int, high: int) -> int | None:
        """Gives a whole number in [low, high]; None if undeclared or after reporting C002."""
        return self._value_in_limits(self.value_of(expr, subject), expr, subject, (low, high), str)

    def bound(self, expr: typed.TypedExpr, subject: str) -> float | None:
        """Gives the value of a bound, which is not negative; None after reporting V006."""
        bound = self.value_of(expr, subject)
        if bound is None or (math.isfinite(bound) and bound >= 0):
            return bound
        message = f"{subject} must be finite and not negative"
        self.diagnostics.error("V006", message, expr.span, f"this is {bound!r}")
        return None

    def interval(
        self, low: typed.TypedExpr, high: typed.TypedExpr, span: Span, subject: str
    ) -> tuple[float, float] | None:
        """Gives the two bounds; None after reporting V006 (not finite) or V001 (wrong order)."""
        a, b = self.value_of(low, subject), self.value_of(high, subject)
        if a is None or b is None:
            return None
        shown = f"[{a!r}, {b!r}]"
        if not (math.isfinite(a) and math.isfinite(b)):
            self.diagnostics.error("V006", f"{subject} must be bounded", span, f"this is {shown}")
            return None
        if not math.isfinite(b - a):
            self.diagnostics.error(
                "V006", f"{subject} is wider than any float", span, f"this is {shown}"
            )
            return None
        if a > b:
            self.diagnostics.error(
                "V001",
                f"{shown} is empty",
                span,
                "the lower bound is above the upper one",
                helps=(exchange_bounds(low.span, high.span),),
            )
            return None
        return a, b

    def skew_ns(self, expr: typed.TypedExpr | None) -> int:
        """Gives the skew of a test in ns, 0 or more; 0 also after a reported error."""
        value = self.value_of(expr, "`skew`")
        return self._value_in_limits(value, expr, "`skew`", (0, MAX_PERIOD_NS), show_ns) or 0


MAX_COMPONENTS = 10_000
MAX_NUMBERS = 1_000_000
MAX_DEPTH = 100


class TooLargeError(Exception):
    """An error for a system that is too large to be flattened; it has been reported."""


class SizeCounter:
    """Counts the parts of a system before they are made."""

    def __init__(
        self,
        system: typed.SystemSymbol,
        known: dict[typed.SystemSymbol, tuple[int, int]],
        diagnostics: Diagnostics,
    ) -> None:
        self.system = system
        self.known = known
        self.diagnostics = diagnostics
        self._numbers = 0
        self._sizes: dict[int, tuple[Type, int]] = {}

    def has_few_instances(self) -> bool:
        """Whether the number of instances is within the limit; reports M007 if not."""
        count, depth = self._count_parts()
        inner = [self.known[s] for s in _inner_systems(self.system)]
        if any(c > MAX_COMPONENTS or d > MAX_DEPTH for c, d in inner):
            return False  # it is reported for that inner system
        if count > MAX_COMPONENTS:
            text = str(count) if count < 10**12 else f"about 10^{len(str(count)) - 1}"
            self._report_size(
                f"has {text} parts",
                f"at most {MAX_COMPONENTS} are possible, systems inside it included",
            )
        elif depth > MAX_DEPTH and not self.diagnostics.has_errors:
            self._report_size(f"nests {depth} levels deep", f"at most {MAX_DEPTH} are possible")
        return count <= MAX_COMPONENTS and depth <= MAX_DEPTH

    def _count_parts(self) -> tuple[int, int]:
        """Gives the numbers of components and of levels of the system, with all inner systems."""
        path = [self.system]
        while path:
            system = path[-1]
            missing = next((s for s in _inner_systems(system) if s not in self.known), None)
            if missing is not None:
                path.append(missing)
                continue
            path.pop()
            parts = [self.known[s] for s in _inner_systems(system)]
            rest = [i.what for i in system.instances if not isinstance(i.what, typed.SystemSymbol)]
            count = sum(1 + c for c, _ in parts) + sum(
                3 if isinstance(w, typed.ModuleSymbol) else 1 for w in rest
            )
            self.known[system] = count, 1 + max((d for _, d in parts), default=0)
        return self.known[self.system]

    def has_room_for(self, t: Type) -> bool:
        """Whether a topic, local or state of type `t` still fits; reports M007 if not."""
        known = self._sizes.get(id(t))
        if known is None:
            known = self._sizes[id(t)] = (t, leaf_count(t))
        self._numbers += known[1]
        if self._numbers > MAX_NUMBERS:
            self._report_size(f"has a state of more than {MAX_NUMBERS} numbers", "in this system")
        return self._numbers <= MAX_NUMBERS

    def _report_size(self, problem: str, label: str) -> None:
        if not self.system.name:
            return  # the system is not one that the program declares
        self.diagnostics.error(
            "M007",
            f"system `{self.system.name}` {problem}",
            self.system.span,
            label,
            notes=("everything that runs has a place in memory of its own from the start",),
        )


def _inner_systems(system: typed.SystemSymbol) -> list[typed.SystemSymbol]:
    return [i.what for i in system.instances if isinstance(i.what, typed.SystemSymbol)]


# ---------------------------------------------------------------- settings that nothing reads


def warn_of_idle_settings(
    settings: Iterable[typed.SetSymbol],
    code: Iterable[tuple[str, tuple[object, ...]]],
    diagnostics: Diagnostics,
) -> None:
    """Warns W010 of each setting, with a full path, that nothing in its instance reads.

    `code`: the paths of all instances, each with parts of the checked program that stand there.
    Settings in a loop get one warning, at the first one.
    """
    known: dict[int, Reads] = {}
    read_by_path: dict[str, set[typed.ParamSymbol]] = {}
    for path, roots in code:
        for root in roots:
            if id(root) not in known:
                known[id(root)] = _params_read(root)
        around = path
        while around:
            read_by_path.setdefault(around, set()).update(*(known[id(root)] for root in roots))
            around = around.rpartition(".")[0]
    warned: set[Span] = set()
    for item in settings:
        if item.param in read_by_path.get(item.path, ()) or item.span in warned:
            continue
        warned.add(item.span)
        diagnostics.warning(
            "W010",
            f"nothing in `{item.path}` reads the parameter `{item.param.name}`",
            item.span,
            "this changes nothing",
            also=((item.param.span, "the parameter"),),
            notes=("the sets of topics belong to the system that they stand in",),
        )


def _params_read(root: object) -> Reads:
    """Gives the parameters that a part of a program reads, also in the functions that it calls.

    Parameters in the declaration of a topic do not count for a part that reads the topic.
    """
    params: set[typed.ParamSymbol] = set()
    seen: set[int] = set()
    todo = [root]
    while todo:
        node = todo.pop()
        kind: Any = type(node)
        if isinstance(node, (tuple, list)):
            todo.extend(node)
        elif isinstance(node, dict):
            todo.extend(node.values())
        elif isinstance(node, typed.ParamRead):
            params.add(node.param)
        elif _is_searched(kind) and id(node) not in seen:
            seen.add(id(node))
            todo.extend(vars(node).values())
    return frozenset(params)


@cache
def _is_searched(kind: type) -> bool:
    return kind.__module__ == typed.__name__ and not issubclass(kind, typed.TopicSymbol)
