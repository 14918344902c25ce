"""How large a system is: instances and numbers, before they are made.

Purpose: a few lines can ask for 2^50 instances or a petabyte of state; M007 instead.
Non-goals: the exact size of the state (`core/layout.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model import typed
from soter.language.model.types import leaf_count

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.types import Type

MAX_COMPONENTS = 10_000
MAX_NUMBERS = 1_000_000
MAX_DEPTH = 100


class TooLargeError(Exception):
    """The system is too large to be flattened; reported."""


class SizeCounter:
    """Counts what a system is made of."""

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

    def instances(self) -> bool:
        """Whether the system has a possible number of instances; M007 otherwise."""
        count, depth = self._count()
        inner = [self.known[s] for s in _parts(self.system)]
        if any(c > MAX_COMPONENTS or d > MAX_DEPTH for c, d in inner):
            return False  # reported there
        if count > MAX_COMPONENTS:
            text = str(count) if count < 10**12 else f"about 10^{len(str(count)) - 1}"
            self._report(
                f"has {text} parts",
                f"at most {MAX_COMPONENTS} are possible, systems inside it included",
            )
        elif depth > MAX_DEPTH and not self.diagnostics.has_errors:
            self._report(f"nests {depth} levels deep", f"at most {MAX_DEPTH} are possible")
        return count <= MAX_COMPONENTS and depth <= MAX_DEPTH

    def _count(self) -> tuple[int, int]:
        """Components and levels of the system; of its parts first, however deep they nest."""
        path = [self.system]
        while path:
            system = path[-1]
            missing = next((s for s in _parts(system) if s not in self.known), None)
            if missing is not None:
                path.append(missing)
                continue
            path.pop()
            parts = [self.known[s] for s in _parts(system)]
            own = [i.what for i in system.instances if not isinstance(i.what, typed.SystemSymbol)]
            count = sum(1 + c for c, _ in parts) + sum(_weight(w) for w in own)
            self.known[system] = count, 1 + max((d for _, d in parts), default=0)
        return self.known[self.system]

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


def _parts(system: typed.SystemSymbol) -> list[typed.SystemSymbol]:
    return [i.what for i in system.instances if isinstance(i.what, typed.SystemSymbol)]


def _weight(what: object) -> int:
    return 3 if isinstance(what, typed.ModuleSymbol) else 1
