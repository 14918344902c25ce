"""The values of parameters, everywhere in a system.

Purpose: who sets a parameter of which instance: from outside (`--set r[0].K=2`), the test, the
system that runs, its parts; ranges of parameters.
Non-goals: what the values are used for (`numeric_values.py`, `elaborator.py`).

The rule: within an instance a parameter has the value that was set for this instance, or else the
one that it has around it. Of several who set it for an instance, who speaks last wins: the command
line, then the test, then systems from the outside in. Around everything stand the command line, the
test, the system that runs and the default, in this order.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from soter.language.check.declarations import show
from soter.language.model import typed

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.language.model.types import Value

Values = dict[typed.ParamSymbol, Any]


class Parameters:
    """The parameters of one system that runs.

    `everywhere`: values where no instance has its own; `named`: those and the own ones of
    instances, by full name (`GAIN`, `r[0].GAIN`), as they are told and can be given again.
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
        self.add("", sets)
        self.everywhere: Values = {
            p: self._value("", p, p.default.value)
            for p in program.params.values()
            if isinstance(p.default, typed.Literal)
        }
        self.named: dict[str, Value] = {p.name: v for p, v in self.everywhere.items()}

    def add(self, prefix: str, sets: Iterable[typed.SetSymbol]) -> None:
        """What a system below `prefix` sets; outer ones first, as what is there stays."""
        for item in sets:
            if item.path or not prefix:
                self._set.setdefault((prefix + item.path, item.param), item)

    def inside(self, path: str, around: Values) -> Values:
        """The values in the instance with this full path; `around` itself where it has no own."""
        own = {p: v for p in around if (v := self._value(path, p, None)) is not None}
        if not own:
            return around
        self.named |= {f"{path}.{p.name}": v for p, v in own.items()}
        key = id(around), repr([(id(p), v) for p, v in own.items()])
        return self._known.setdefault(key, {**around, **own})

    def of_instances(self) -> list[typed.SetSymbol]:
        """What texts set for instances that there are, each with the full path."""
        return [
            replace(item, path=path)
            for (path, param), item in self._set.items()
            if path and f"{path}.{param.name}" in self.named
        ]

    def sets(self, param: typed.ParamSymbol, path: str) -> bool:
        """Whether a value is set for everything, or for an instance around `path`."""
        around = ["", *(path[:i] for i, c in enumerate(path) if c == "."), path]
        return any((at, param) in self._set for at in around)

    def _value(self, path: str, param: typed.ParamSymbol, default: Value | None) -> Value | None:
        name = f"{path}.{param.name}" if path else param.name
        if name in self.overrides:
            value = self.overrides[name]
            self._check(name, param, value, (param.span, "was set to"))
            return value
        item = self._set.get((path, param))
        if item is None:
            return default
        self._check(name, param, item.value, (item.span, "is set to"))
        return item.value

    def _check(
        self, name: str, param: typed.ParamSymbol, value: Value, set_at: tuple[Span, str]
    ) -> None:
        """V007 for a value outside the range of its parameter."""
        if not isinstance(param.low, typed.Literal) or not isinstance(param.high, typed.Literal):
            return
        low, high = param.low.value, param.high.value
        if not low <= value <= high:
            span, how = set_at
            shown = [show(x, param.type) for x in (value, low, high)]
            self.diagnostics.error(
                "V007",
                f"parameter `{name}` {how} {shown[0]}, outside [{shown[1]}, {shown[2]}]",
                span,
                also=((param.span, "declared here"),) if span is not param.span else (),
            )


def has_param(
    program: typed.TypedProgram, systems: Iterable[typed.SystemSymbol], name: str
) -> bool:
    """Whether a full name means a parameter of the program, or of an instance in such a system."""
    param = program.param(name)
    if param is None or name == param.name:
        return param is not None
    path = name[: -len(param.name) - 1].split(".")
    return any(_has(system, path) for system in systems)


def _has(system: typed.SystemSymbol, path: list[str]) -> bool:
    what: object = system
    for part in path:
        instance = what.by_name.get(part) if isinstance(what, typed.SystemSymbol) else None
        if instance is None:
            return False
        what = instance.what
    return True
