"""What a random piece of code can see where it stands.

Purpose: scopes, topics, functions and specials in reach, how much it may still cost, and how
readily it takes a risk.
Non-goals: choosing.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.language.model.types import EnumType, Type


@dataclass(frozen=True)
class Seen:
    """A name with a value. `below`: of a loop variable that starts at 0, where it ends."""

    name: str
    type: Type
    assignable: bool = False
    below: int = 0


@dataclass(frozen=True)
class Callable:
    """A declared function."""

    name: str
    parameters: tuple[Type, ...]
    result: Type
    cost: int
    risky: bool


@dataclass
class Globals:
    """What a whole program declares, as far as it is declared already."""

    constants: list[Seen] = field(default_factory=list)
    parameters: list[Seen] = field(default_factory=list)
    durations: list[str] = field(default_factory=list)
    functions: list[Callable] = field(default_factory=list)
    enums: list[EnumType] = field(default_factory=list)
    vectors: list[Type] = field(default_factory=list)
    reserved: set[str] = field(default_factory=set)
    """Names that no local may take: those of types and functions."""


@dataclass
class Sight:
    """One place in the program."""

    world: Globals
    frames: list[dict[str, Seen]] = field(default_factory=list)
    topics: list[Seen] = field(default_factory=list)
    modules: list[str] = field(default_factory=list)
    has_time: bool = False
    has_period: bool = False
    has_control: bool = False
    has_choice: bool = False
    has_fair: bool = True
    constant: bool = False
    """Only constants can be seen, and nothing may fault."""
    risk: int = 0
    """How often, of 100, what may fault is written without care."""
    fuel: int = 60
    """How many more operations, roughly, one execution may take."""
    spent: int = 0
    rounds: int = 1
    """How often the present place runs in one execution."""

    def spend(self, cost: int) -> bool:
        """Take so much out of the fuel, if there is so much."""
        if self.spent + cost * self.rounds > self.fuel:
            return False
        self.spent += cost * self.rounds
        return True

    def shadowed(self, name: str) -> bool:
        """Whether a local has this name."""
        return any(name in frame for frame in self.frames)

    def locals(self) -> list[Seen]:
        """Locals that can be seen, innermost first."""
        seen_by_name: dict[str, Seen] = {}
        for frame in reversed(self.frames):
            for name, seen in frame.items():
                seen_by_name.setdefault(name, seen)
        return list(seen_by_name.values())

    def values(self) -> list[Seen]:
        """Everything with a value."""
        outside = list(self.world.constants)
        if not self.constant:
            outside += [*self.world.parameters, *self.topics]
        return [*self.locals(), *(s for s in outside if not self.shadowed(s.name))]

    def durations(self) -> list[str]:
        """Parameters that are times."""
        if self.constant:
            return []
        return [d for d in self.world.durations if not self.shadowed(d)]

    def declare(self, seen: Seen) -> None:
        """Enter a local into the innermost scope."""
        self.frames[-1][seen.name] = seen
