"""Several sources of one topic: what each promises, how old the topic may get, which one is read.

Purpose: the records and the reading of `sources`; the rule by which one of them is read, which is
that of `runtime/bridge/soter_sources.hpp`.
Non-goals: what a deploying system declares, and whether the promises fit (`targets/`).

The rule, of stamps in the order of arrival (docs/mapping.md, "Several sources", has the reason and
the bound): it is a sample's turn where it was measured more than `after` later than the newest
sample of the sources before it whose turn it was; in its turn it is taken where it is newer than
all that was taken.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from soter.language.model.durations import show_ns
from soter.language.model.types import FloatType, leaves
from soter.mapping.mapping_errors import is_number, unknown

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.language.model.system import Topic
    from soter.mapping.mapping_errors import MappingProblems

PROMISE_KEYS = ("every", "delayed", "measured", "after")
SOURCES_MAX = 8
WHOLE = "value"
"""What `measured` calls all of a topic."""


@dataclass(frozen=True)
class SourcePromise:
    """What a source promises, times in ns, and when it takes over.

    While it works it measures at least every `every_ns`, and a sample is there at most `delayed_ns`
    after it was measured. `errors`: how far a float leaf may be off, in the topic's unit; a leaf
    that is not there has none. `after_ns`: by how much its samples have to be younger than those of
    the sources before it; of the first source (`rank` 0) 0, which nothing asks for.
    """

    rank: int
    every_ns: int
    delayed_ns: int = 0
    errors: Mapping[tuple[str, ...], float] = field(default_factory=dict)
    after_ns: int = 0

    @property
    def alone_ns(self) -> int:
        """How old its newest sample may be while it keeps its promise."""
        return self.every_ns + self.delayed_ns

    @property
    def oldest_ns(self) -> int:
        """How old the topic may be while it keeps its promise, whatever the other sources do."""
        return self.after_ns + self.alone_ns


class SourceTurns:
    """Which samples of several sources are taken; `after_ns`: of each source, by rank."""

    def __init__(self, after_ns: Sequence[int]) -> None:
        self.after_ns = tuple(after_ns)
        self.newest: list[int | None] = [None] * len(self.after_ns)
        """By source the stamp of the newest sample whose turn it was."""

    def judge(self, rank: int, stamp_ns: int) -> Literal["taken", "waits", "older"]:
        """What becomes of a sample of the source `rank` that was measured at `stamp_ns`.

        `waits`: it is not its turn; `older`: it is, and something as new was taken before.
        """
        before = [s for s in self.newest[:rank] if s is not None]
        if before and stamp_ns <= max(before) + self.after_ns[rank]:
            return "waits"
        taken = max((s for s in self.newest if s is not None), default=None)
        own = self.newest[rank]
        self.newest[rank] = stamp_ns if own is None else max(own, stamp_ns)
        return "taken" if taken is None or stamp_ns > taken else "older"


def read_promise(
    table: Mapping[str, Any], rank: int, topic: Topic, problems: MappingProblems, name: str
) -> SourcePromise:
    """What a source says of itself; of no use where problems were added."""
    delayed = problems.duration(table, "delayed", name) if "delayed" in table else 0
    after = 0
    if rank > 0:
        after = problems.duration(table, "after", name)
    elif "after" in table:
        problems.add(f"`after` of `{name}`: the first source takes over from nobody")
    errors = _errors(problems.table(table, "measured", f"`{name}`"), topic, problems, name)
    return SourcePromise(rank, problems.duration(table, "every", name), delayed, errors, after)


def _errors(
    measured: Mapping[str, Any], topic: Topic, problems: MappingProblems, name: str
) -> dict[tuple[str, ...], float]:
    """The errors of float leaves; a name of a part that has several is of each of them."""
    floats = [path for path, t in leaves(topic.type) if isinstance(t, FloatType)]
    errors: dict[tuple[str, ...], float] = {}
    for key, error in measured.items():
        parts = () if key == WHOLE else tuple(key.split("."))
        meant = [path for path in floats if path[: len(parts)] == parts]
        if not meant:
            known = [".".join(path) or WHOLE for path in floats]
            problems.add(unknown(f"`measured` of `{name}`: no float of the topic is", key, known))
        elif not is_number(error) or error < 0:
            problems.add(f"`{key}` in `measured` of `{name}` is no error, 0 or more: {error!r}")
        else:
            errors.update(dict.fromkeys(meant, float(error)))
    return errors


def early_turns(name: str, promises: Sequence[SourcePromise]) -> Iterator[str]:
    """Problems: sources that take over from others that keep what they promise.

    What those before it have had in their turn may be as old as the topic is with one of them that
    keeps its promise: its own sample is newer, but may have waited for its turn in vain.
    """
    for promise in promises[1:]:
        patience = max(p.oldest_ns for p in promises[: promise.rank])
        if promise.after_ns < patience:
            yield (
                f"`after` of `{name}.sources.{promise.rank + 1}` is {show_ns(promise.after_ns)}: "
                f"with a source before it the topic may be {show_ns(patience)} old while it keeps "
                "its promise"
            )
