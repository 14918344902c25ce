"""Finds the parts of a system that the caller of an environment names, or the only ones.

Purpose: `chosen_module` and `chosen_plant` find a module and a plant, `observed_parts` what an
agent observes, `ordered_info_keys` the keys of `info`. Wrong choices are U001.
Non-goals: the system that is left (`language/elaborate/derived_systems.py`); stepping
(`session.py`); spaces (`array_mapping.py`), what the keys say (`guard.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.elaborate.derived_systems import with_components
from soter.language.model.types import has_list

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence

    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type


CAUSES = ("", "gate", "stale", "ttf", "recovering", "forced", "toward sc")
"""Why the agent's action did not count, or was changed; the index is `soter_cause` of C, and is
what `info["cause"]` of a vector has."""

INFO_KEYS = (
    *("mode", "ttf", "safer", "margin", "stale", "switched", "violations", "taken_by"),
    *("action_requested", "action_taken", "gate_fault", "intervened", "cause", "cost"),
    *("off_model", "action_mask", "not_finite"),
)
"""All keys of `info` that say something of the module."""


def is_flat(types: Iterable[Type]) -> bool:
    """Whether values of these types have a fixed count of numbers, as they contain no list."""
    return not any(has_list(t) for t in types)


@dataclass(frozen=True)
class ObservedPart:
    """A part of an observation: the topic at `index`, or with `truth` the states of that plant."""

    index: int
    truth: bool = False


def wrong_choice(message: str, *helps: str) -> SoterError:
    """The SoterError U001 for a wrong argument from the caller."""
    return SoterError((Diagnostic("U001", message, helps=tuple(h for h in helps if h)),))


def chosen_module(system: System, name: str | None) -> Module:
    """The module called `name`, by default the only one; raises SoterError U001 if none fits."""
    names = [m.name for m in system.modules]
    return system.modules[_chosen_index("module", names, name, system.name)]


def chosen_plant(system: System, name: str | None) -> Component:
    """The plant called `name`, by default the only one; raises SoterError U001 if none fits."""
    plants = [c for c in system.components if c.plant is not None]
    return plants[_chosen_index("plant", [c.name for c in plants], name, system.name)]


def _chosen_index(kind: str, names: list[str], wanted: str | None, system: str) -> int:
    shown = ", ".join(f"`{n}`" for n in names) or "none"
    if wanted is None:
        if len(names) == 1:
            return 0
        message = f"system `{system}` has {len(names)} {kind}s, so one has to be named"
        raise wrong_choice(message, f"there are {shown}: {kind}=...")
    if wanted not in names:
        raise wrong_choice(f"system `{system}` has no {kind} `{wanted}`", f"there are {shown}")
    return names.index(wanted)


def observed_parts(
    system: System, agent: Component, names: Sequence[str] | None
) -> list[ObservedPart]:
    """The topics and true states called `names`; by default the agent's topics, or all states.

    Raises SoterError U001 for no names, an unknown name, or values that contain a list.
    """
    plants = [c for c in system.components if c.plant is not None]
    if names is None:
        assert agent.node is not None
        topics = [ObservedPart(agent.scope.topics[s.topic]) for s in agent.node.subscribes]
        defaults = topics or [ObservedPart(c.index, truth=True) for c in plants]
        names = [_observed_name(system, x) for x in defaults]
    if not names:
        raise wrong_choice("an observation of nothing", "observe=[...] names topics and truths")
    known = _observable_parts(system, plants)
    for name in names:
        if name not in known:
            known_names = ", ".join(f"`{n}`" for n in known)
            raise wrong_choice(
                f"there is nothing to observe called `{name}`", f"there are {known_names}"
            )
        if not is_flat(_observed_types(system, known[name])):
            message = f"`{name}` has no fixed number of numbers"
            raise wrong_choice(message, "observe=[...] names topics and truths without lists")
    return [known[name] for name in names]


def _observable_parts(system: System, plants: Sequence[Component]) -> dict[str, ObservedPart]:
    """The parts that may be observed, by name: published topics and true states of plants."""
    topics = [t for t in system.topics if t.queue_of is None and not t.held]
    truths = {f"{c.name}.truth": ObservedPart(c.index, truth=True) for c in plants}
    return {t.name: ObservedPart(t.index) for t in topics} | truths


def _observed_name(system: System, seen: ObservedPart) -> str:
    parts = system.components if seen.truth else system.topics
    return f"{parts[seen.index].name}{'.truth' if seen.truth else ''}"


def _observed_types(system: System, seen: ObservedPart) -> list[Type]:
    if not seen.truth:
        return [system.topics[seen.index].type]
    plant = system.components[seen.index].plant
    assert plant is not None
    return [v.type for v in plant.states]


def require_no_shared_extern(system: System, agent: int) -> None:
    """Raises SoterError U003 if any component but the agent is extern, since worlds share it."""
    for c in system.components:
        if c.extern and c.index != agent:
            kind = "node" if c.node is not None else "plant"
            raise SoterError(
                (
                    Diagnostic(
                        "U003",
                        f"{kind} `{c.name}` is extern: many worlds step what is compiled",
                        helps=(
                            "replace it in the system by a node in Soter: `replace NODE by OTHER;`",
                            "or step one world at a time: soter.gym.Protected",
                        ),
                    ),
                )
            )


def system_with_errors(system: System, plant: Component, errors: bool | Sequence[str]) -> System:
    """The system with a plant's measurement errors only on the topics `errors` (True: on all).

    An environment's sensors already have errors. Raises SoterError U001 for a topic without errors.
    """
    if errors is True:
        return system
    names = {m.topic: system.topics[m.topic].name for m in plant.measured}
    for name in errors or ():
        if name not in names.values():
            known = ", ".join(f"`{n}`" for n in dict.fromkeys(names.values())) or "none"
            raise wrong_choice(
                f"plant `{plant.name}` has no `measured` topic `{name}`", f"there are {known}"
            )
    kept = tuple(m for m in plant.measured if names[m.topic] in (errors or ()))
    return with_components(system, (replace(plant, measured=kept),))


def ordered_info_keys(keys: Collection[str]) -> tuple[str, ...]:
    """The `keys` in the order of `INFO_KEYS`; raises SoterError U001 for an unknown key."""
    wanted = {keys} if isinstance(keys, str) else set(keys)
    if unknown := sorted(map(str, wanted.difference(INFO_KEYS))):
        names = ", ".join(f"`{name}`" for name in unknown)
        raise wrong_choice(f"`info` says nothing of {names}", f"it has {', '.join(INFO_KEYS)}")
    return tuple(key for key in INFO_KEYS if key in wanted)
