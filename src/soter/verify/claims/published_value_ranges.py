"""What plants can publish: beyond the declared set of a topic a plant stops.

Purpose: which driven leaves may leave their sets, or the range of doubles, somewhere in the ranges
of a proof, in words. The states at which one of them does are no part of C (`constraint` of
`verify/enclose/enclosure_code.py`).
Non-goals: lists, and arrays too long to be numbered: that they stay in their sets is an assumption.
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

from soter.language.model.types import leaf_name, leaves
from soter.verify.claims.results import UNDECIDED
from soter.verify.enclose.enclosed_steps import room_of
from soter.verify.enclose.enclosure_inputs import paths

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.language.model.system import Bound
    from soter.verify.claims.case import Case
    from soter.verify.claims.results import ModuleResult
    from soter.verify.enclose.compiled_enclosures import CompiledEnclosures
    from soter.verify.problem.problem import Problem

FAULT = "what plants drive may fault"


def narrowed(problem: Problem, forms: CompiledEnclosures) -> list[str]:
    """Each leaf that its plant cannot publish everywhere in the ranges, with what it takes."""
    driven = list(_driven(problem))
    if len(driven) > forms.results:
        return []
    ends = forms.numbers("drives", forms.whole, len(driven))
    if ends is None:
        return [FAULT]
    messages = []
    for (name, bound, error, numbered), (low, high) in zip(driven, ends, strict=True):
        if bound is None:
            if numbered and not (isfinite(low) and isfinite(high)):
                messages.append(f"`{name}` takes only finite numbers")
            continue
        least, most = room_of(bound, error)
        if not least <= low <= high <= most:
            messages.append(f"`{name}` takes only [{bound.low:.6g}, {bound.high:.6g}]")
    return messages


def say_narrowed(result: ModuleResult, done: Sequence[Case], claims: Iterable[str]) -> None:
    """What plants cannot publish is no part of C: said, and where something is open as a help."""
    texts = narrowed(result.problem, done[0].forms)
    if not texts:
        return
    result.notes += (
        f"C is no more than what plants can publish, as they stop there: {', '.join(texts)}",
    )
    for finding in (result.findings[c] for c in claims):
        if finding.verdict == UNDECIDED:
            wider = f"a wider set ({texts[0]}: a plant stops there)"
            finding.hint = f"{finding.hint}; or {wider}" if finding.hint else wider


def _driven(problem: Problem) -> Iterator[tuple[str, Bound | None, float, bool]]:
    """Name, set and error of every driven leaf, in the order of `drives`; whether it is one number.

    Of lists, and arrays too long to be numbered, it is not.
    """
    system = problem.system
    plants = [c for c in system.components if c.plant is not None]
    topics = {c.scope.topics[t] for c in plants if c.plant for t, _ in c.plant.drives}
    measured = {(m.topic, m.leaf): m.bound for c in plants for m in c.measured}
    for index in sorted(topics):
        topic = system.topics[index]
        every = [path for path, _ in leaves(topic.type)]
        for path, _ in paths(topic.type):
            at = every.index(path) if path in every else None
            bound = None if at is None else topic.bounds[at]
            error = 0.0 if at is None else measured.get((index, at), 0.0)
            yield leaf_name(topic.name, path), bound, error, at is not None
