"""What a trace holds, by the names people use: topics, truths, modes, plain arrays.

Purpose: the name of a topic, `<plant>.truth`, or a dotted part of one becomes a view of the
trace, or an array of floats; an unknown name is a SoterError with the nearest known one.
Non-goals: decoding single values (`figures.py`), drawing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from soter.lower.layout import group_field
from soter.program.types import ArrayType, ListType, RecordType
from soter.simulate.settings import did_you_mean, usage_error

if TYPE_CHECKING:
    import numpy.typing as npt

    from soter.program.types import Type
    from soter.simulate.run import Run


def values(run: Run, name: str) -> tuple[Type, npt.NDArray[Any]]:
    """Type and values, (n,), of a topic or of a plant's truth; SoterError U001."""
    trace = run.require_trace()
    for topic in run.system.topics:
        if topic.name == name:
            return topic.type, trace["topics"][name]
    for group in run.layout.groups:
        x = run.system.components[group.owner] if group.owner >= 0 else None
        if x is not None and x.plant is not None and name == f"{x.name}.truth":
            return x.plant.truth, trace[group_field(group)]
    raise usage_error(
        "U001", f"the run has no topic and no truth `{name}`", did_you_mean(name, _names(run))
    )


def mode(run: Run, module: str) -> npt.NDArray[np.uint8]:
    """Mode of a module, (n,); SoterError U001."""
    trace = run.require_trace()
    for m in run.system.modules:
        if m.name == module:
            return trace["modules"]["mode"][:, m.index]
    known = did_you_mean(module, [m.name for m in run.system.modules])
    raise usage_error("U001", f"the run has no module `{module}`", known)


def array(run: Run, path: str) -> npt.NDArray[np.float64]:
    """Floats of a topic, a truth or a part of one: (n,) or (n, k); SoterError U001."""
    run.require_trace()
    known = [n for n in _names(run) if path == n or path.startswith(f"{n}.")]
    name = max(known, key=len, default=path)
    t, found = values(run, name)
    for part in path[len(name) + 1 :].split(".") if len(path) > len(name) else ():
        fields = dict(t.fields) if isinstance(t, RecordType) else {}
        if part not in fields:
            help_ = did_you_mean(part, fields)
            raise usage_error("U001", f"`{path}`: there is no field `{part}`", help_)
        t, found = fields[part], found[part]
    if _has_list(t):
        raise usage_error("U001", f"`{path}` has a list in it, which is no array", "use run.topic")
    numbers = _numbers(t, found)
    return numbers if isinstance(t, (RecordType, ArrayType)) else numbers[:, 0]


def _names(run: Run) -> list[str]:
    truths = [f"{x.name}.truth" for x in run.system.components if x.plant is not None]
    return [*(t.name for t in run.system.topics), *truths]


def _numbers(t: Type, found: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
    """(..., k): the k numbers of every value."""
    if isinstance(t, RecordType):
        return np.concatenate([_numbers(f, found[n]) for n, f in t.fields], axis=-1)
    if isinstance(t, ArrayType):
        parts = _numbers(t.element, found)
        return parts.reshape(*parts.shape[:-2], -1)
    return found.astype(np.float64)[..., np.newaxis]


def _has_list(t: Type) -> bool:
    if isinstance(t, RecordType):
        return any(_has_list(f) for _, f in t.fields)
    return isinstance(t, ListType) or (isinstance(t, ArrayType) and _has_list(t.element))
