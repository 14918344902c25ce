"""How large a system is: instances and numbers, before they are made.

Purpose: a few lines can ask for 2^50 instances or a petabyte of state; M007 instead.
Non-goals: the exact size of the state (`lower/layout.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.types import leaf_count

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.program.types import Type

MAX_COMPONENTS = 20_000
MAX_NUMBERS = 1_000_000
MAX_DEPTH = 100


class TooLargeError(Exception):
    """The system is too large to be flattened; reported."""


class Measure:
    """Counts what a system is made of."""

    def __init__(self, system: typed.SystemSymbol, diagnostics: Diagnostics) -> None:
        self.system = system
        self.diagnostics = diagnostics
        self._numbers = 0
        self._sizes: dict[int, tuple[Type, int]] = {}

    def instances(self) -> bool:
        """Whether the system has a possible number of instances; M007 otherwise."""
        counts: dict[typed.SystemSymbol, int] = {}
        depths: dict[typed.SystemSymbol, int] = {}
        path = [self.system]
        while path:
            system = path[-1]
            inner = [i.what for i in system.instances if isinstance(i.what, typed.SystemSymbol)]
            missing = [s for s in inner if s not in counts]
            if missing:
                path.append(missing[0])
                continue
            path.pop()
            counts[system] = sum(
                counts[i.what] if isinstance(i.what, typed.SystemSymbol) else _weight(i.what)
                for i in system.instances
            )
            depths[system] = 1 + max((depths[s] for s in inner), default=0)
        inner = [i.what for i in self.system.instances if isinstance(i.what, typed.SystemSymbol)]
        if any(counts[s] > MAX_COMPONENTS or depths[s] > MAX_DEPTH for s in inner):
            return False  # reported there
        if counts[self.system] > MAX_COMPONENTS:
            shown = counts[self.system]
            text = str(shown) if shown < 10**12 else f"about 10^{len(str(shown)) - 1}"
            self._report(
                f"has {text} plants, nodes and decision modules",
                f"at most {MAX_COMPONENTS} are possible",
            )
        elif depths[self.system] > MAX_DEPTH:
            self._report(
                f"nests {depths[self.system]} levels deep", f"at most {MAX_DEPTH} are possible"
            )
        return counts[self.system] <= MAX_COMPONENTS and depths[self.system] <= MAX_DEPTH

    def fits(self, t: Type) -> bool:
        """Whether there is room for a topic, a local or a state of type `t`; M007 if not."""
        known = self._sizes.get(id(t))
        if known is None:
            known = self._sizes[id(t)] = (t, leaf_count(t))
        self._numbers += known[1]
        if self._numbers > MAX_NUMBERS:
            self._report(f"has a state of more than {MAX_NUMBERS} numbers", "in this system")
        return self._numbers <= MAX_NUMBERS

    def _report(self, what: str, label: str) -> None:
        if not self.system.name:
            return  # no system of the program's
        self.diagnostics.error(
            "M007",
            f"system `{self.system.name}` {what}",
            self.system.span,
            label,
            notes=("everything that runs has a place in memory of its own from the start",),
        )


def _weight(what: object) -> int:
    return 3 if isinstance(what, typed.ModuleSymbol) else 1
