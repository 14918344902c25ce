"""Commands that a shield tries in the place of AC's: `shield toward plans, sc;`.

Purpose: `why_no_candidates` says why a topic cannot hand them over (M027).
Non-goals: which of them is published (`verify/tubes/toward.soter`), how old they are (AC).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.types import ArrayType

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.language.model.system import Component, Module, Topic


def why_no_candidates(
    module: Module, topics: Sequence[Topic], components: Sequence[Component]
) -> str:
    """Why commands cannot be tried in the place of AC's; "": they can, or none are named.

    What is published in the place of AC's command passes no gate, so the topic's set has to be one.
    """
    tried = module.symbol.candidates
    if tried is None:
        return ""
    index = components[module.ac].scope.topics.get(tried)
    if index is None:
        return f"its AC does not subscribe `{tried.name}`, so that it cannot say that it is old"
    if module.symbol.rest is None:
        return f"it has no `rest`: on a grid a command is moved toward SC's, not to `{tried.name}`"
    topic, (output, *others) = topics[index], (topics[i] for i in module.outputs)
    if others or not isinstance(topic.type, ArrayType) or topic.type.element != output.type:
        return f"`{tried.name}` is no array of what it publishes, as `{output.type}[3]` is"
    ends = (*output.bounds,) * topic.type.size
    within = all(
        a is not None and (b is None or (b.low <= a.low and a.high <= b.high))
        for a, b in zip(topic.bounds, ends, strict=True)
    )
    plants = [(x.scope.topics, x.plant.drives) for x in components if x.plant is not None]
    if not within or index in {at[symbol] for at, drives in plants for symbol, _ in drives}:
        return f"a value of `{tried.name}` may lie outside of the set of `{output.name}`"
    return ""
