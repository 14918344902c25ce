"""What an expression may mention at the place where it stands.

Purpose: one object that says which locals, topics and specials are in reach, so that the
expression checker has a single rule for every place.
Non-goals: resolving names of declarations (`scope.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.codes import Code
    from soter.diagnostics.span import Span
    from soter.language.check.scope import FileScope
    from soter.language.model.typed import InstanceSymbol, NodeSymbol, TopicSymbol, Variable
    from soter.language.model.types import Type


SPECIALS = {
    "in_control": "only the step of a node is in control or not",
    "time": "only nodes, plants and properties see the time",
    "dt": "only nodes and plants have a period",
}
"""Words with a meaning of their own in expressions, and where they have one."""


@dataclass(eq=False)
class Context:
    """A place in the program.

    `where` names the place in messages ("function `f`", "node `Fast`", "the size of an array").
    `constant` is the code to report where only constants may stand (T008; T007 for the bound of
    a loop), else empty; `hidden` is then the place around it, whose locals exist but are not
    known yet. `topics` is None where no topic may be read, "any" where each may (predicates,
    properties), else the readable ones.
    """

    scope: FileScope
    where: str
    constant: Code | Literal[""] = ""
    hidden: Context | None = None
    topics: set[TopicSymbol] | str | None = None
    queues: dict[TopicSymbol, int] = field(default_factory=dict)
    """Topics that are read as the queue of a subscription, and its length."""
    inputs: str = "subscribes"
    """The word that would make a topic readable."""
    has_time: bool = False
    has_period: bool = False
    has_modes: bool = False
    choices: list[Variable] | None = None
    """Where `choose` may stand: the hidden locals of a node's fair choices so far; else None."""
    node: NodeSymbol | None = None
    """The node whose step this is: `in_control`, publish."""
    result: Type | None = None
    """Inside a function: what `return` gives."""
    result_span: Span | None = None
    """Where that is declared."""
    owner: object = None
    """The node or plant whose code this is."""
    instances: dict[str, InstanceSymbol] | None = None
    """Inside a system: `instance.truth`, `mode(instance)`, topics of sub-systems."""
    broken: bool = False
    """The declaration lost a part when it was parsed: names unknown here may have been in it."""
    lost: frozenset[str] = frozenset()
    """Names of instances that could not be made: they were reported."""
    private: dict[str, Variable] = field(default_factory=dict)
    """Locals of a node that its contract cannot speak about."""
    locals: list[dict[str, Variable]] = field(default_factory=list)
    gone: dict[str, Variable] = field(default_factory=dict)
    """Locals of blocks that have ended."""
    topics_read: dict[TopicSymbol, None] = field(default_factory=dict)
    """Topics read so far, in order of first use."""

    def find_local(self, name: str) -> Variable | None:
        """The innermost local called `name`."""
        for frame in reversed(self.locals):
            if name in frame:
                return frame[name]
        return None

    def local_names(self) -> Iterator[str]:
        """The names of all locals in reach."""
        return (name for frame in self.locals for name in frame)
