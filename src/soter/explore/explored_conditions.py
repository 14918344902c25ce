"""Under which conditions a test was explored that its program leaves open, or that it changed.

Purpose: sentences about the values of parameters, forced modules, and what inputs take and when;
which inputs take fewer values than their sets have.
Non-goals: replacements and timing (`assumptions.py`, `contracts.py`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.explore.trace_view import shown
from soter.language.check.declarations import show
from soter.language.model.durations import show_ns
from soter.language.model.python_values import to_json
from soter.language.model.typed import Literal
from soter.language.model.types import BoolType, EnumType, FloatType, IntType, leaves

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.system import Bound, InputDrive, System, Topic
    from soter.language.model.types import Type

NAMED = 12
"""So many parameters that are as declared are named; those that are not are, however many."""


def told(system: System) -> Iterator[str]:
    """A sentence for all parameters, one for each forced module and each driven input."""
    yield from _parameters(system)
    for m in system.modules:
        if m.forced is not None:
            mode = m.forced.upper()
            yield f"{m.name} is forced to {mode}: nothing is said of it where its DM decides"
    for drive in system.inputs:
        topic = system.topics[drive.topic]
        every = f"every {show_ns(drive.every_ns)} and keeps it until then"
        if drive.values:
            values = [shown(to_json(topic.type, v)) for v in drive.values]
            which = f"one of {', '.join(values)}"
            which += ", which is its whole set," if has_all(topic, drive) else ""
            which += "" if has_all(topic, drive) else f", picked of {set_of(topic)},"
        else:
            which = f"any value of {set_of(topic)}"
        yield f"{topic.name} takes {which} {every}: no other value and no other time was tried"


def picked(system: System) -> list[str]:
    """Inputs that take some values of a set that has more."""
    drives = [(system.topics[d.topic], d) for d in system.inputs if d.values]
    return [topic.name for topic, drive in drives if not has_all(topic, drive)]


def has_all(topic: Topic, drive: InputDrive) -> bool:
    """Whether the values of a drive are all that the set of its topic has."""
    counts = [_count(t, b) for (_, t), b in zip(leaves(topic.type), topic.bounds, strict=True)]
    if any("[]" in path for path, _ in leaves(topic.type)):
        return False
    return len(set(drive.values)) >= math.prod(counts)


def set_of(topic: Topic) -> str:
    """The set of a topic as people write it."""
    bound = topic.bounds[0] if len(topic.bounds) == 1 else None
    if bound is None:
        return "its set"
    low, high = bound.low, bound.high
    if isinstance(topic.type, IntType):
        low, high = int(low), int(high)
    return f"[{low:,}, {high:,}]" if isinstance(low, int) else f"[{low:g}, {high:g}]"


def _count(t: Type, bound: Bound | None) -> float:
    """How many values a leaf may have; of a float with more than one, no end of them."""
    if isinstance(t, BoolType):
        return 2
    if isinstance(t, EnumType):
        return len(t.members)
    low, high = (-math.inf, math.inf) if bound is None else (bound.low, bound.high)
    if isinstance(t, IntType):
        return max(high, t.low) - low + 1 if bound is not None else t.high - t.low + 1
    assert isinstance(t, FloatType), t
    return 1 if low == high else math.inf


def _parameters(system: System) -> Iterator[str]:
    """Their values; of one that is set, its own as well: those come first, all of them."""
    changed, values = [], []
    for name, value in system.params.items():
        param = system.program.param(name)
        if param is None:
            continue
        own = param.default.value if isinstance(param.default, Literal) else value
        at = f"{name} = {show(value, param.type)}"
        if value == own:
            values.append(at)
        else:
            changed.append(f"{at} (by itself {show(own, param.type)})")
    if changed or values:
        more = f" and {len(values) - NAMED} more" if len(values) > NAMED else ""
        yield f"said of these values of parameters: {', '.join(changed + values[:NAMED])}{more}"
