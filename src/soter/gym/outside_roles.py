"""The module, plant and topics of an environment, and where their numbers lie in memory.

Purpose: `chosen_module` and `chosen_plant` find what a caller names, or the only one;
`observed_parts` what an agent observes; `places` the leaves of a value, as `soter_leaf` of
`c/soter_gym.h`; `known_keys` the keys of `info` that a caller chooses. Wrong choices are U001.
Non-goals: the system that is left (`language/elaborate/derived_systems.py`); stepping
(`session.py`); spaces (`array_mapping.py`), what the keys say (`guard.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from soter.core.layout import placed_leaves, scalar
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.elaborate.derived_systems import with_components
from soter.language.model.types import BoolType, EnumType, FloatType, IntType, has_list

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type


FLOAT, BOOL = 0, 1
KINDS = {"b": 2, "B": 3, "h": 4, "H": 5, "i": 6, "I": 7, "q": 8}


class MemoryLeaf(NamedTuple):
    """A number: its offset, `soter_leaf_kind`, and what an int or enum may be."""

    offset: int
    kind: int
    low: int = 0
    high: int = 0


def is_flat(types: Iterable[Type]) -> bool:
    """Whether values of these types have a fixed number of numbers: no lists."""
    return not any(has_list(t) for t in types)


def places(t: Type, offset: int) -> Iterator[MemoryLeaf]:
    """The leaves of a value that lies at `offset`, in declared order."""
    return (_leaf(leaf, at) for _, leaf, at in placed_leaves(t, offset))


def _leaf(t: Type, offset: int) -> MemoryLeaf:
    if isinstance(t, FloatType):
        return MemoryLeaf(offset, FLOAT)
    if isinstance(t, BoolType):
        return MemoryLeaf(offset, BOOL)
    storage = scalar(t)
    assert storage is not None, t
    if isinstance(t, EnumType):
        return MemoryLeaf(offset, KINDS[storage.format], 0, len(t.members) - 1)
    assert isinstance(t, IntType)
    return MemoryLeaf(offset, KINDS[storage.format], t.low, t.high)


@dataclass(frozen=True)
class ObservedPart:
    """A part of an observation: a topic, or the true states of a plant (index)."""

    index: int
    truth: bool = False


class LeafBuffer:
    """`soter_leaves` in C, and the memory that they lie in."""

    def __init__(self, ffi: Any, leaves: Sequence[MemoryLeaf], size: int = 0) -> None:  # noqa: ANN401 - cffi
        self.count = len(leaves)
        self.memory = ffi.new("soter_leaf[]", [tuple(leaf) for leaf in leaves] or 1)
        self.fields = {"at": self.memory, "count": len(leaves), "size": size}


def wrong_choice(message: str, *helps: str) -> SoterError:
    """U001: an argument that names nothing, or not one thing."""
    return SoterError((Diagnostic("U001", message, helps=tuple(h for h in helps if h)),))


def chosen_module(system: System, name: str | None) -> Module:
    """The module of that name, or the only one; SoterError U001."""
    names = [m.name for m in system.modules]
    return system.modules[_index("module", names, name, system.name)]


def chosen_plant(system: System, name: str | None) -> Component:
    """The plant of that name, or the only one; SoterError U001."""
    plants = [c for c in system.components if c.plant is not None]
    return plants[_index("plant", [c.name for c in plants], name, system.name)]


def _index(kind: str, names: list[str], wanted: str | None, system: str) -> int:
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
    """What an agent observes: topics and truths by name, by default the topics that it reads.

    Where it reads none, the truths of all plants. SoterError U001.
    """
    plants = [c for c in system.components if c.plant is not None]
    if names is None:
        assert agent.node is not None
        topics = [ObservedPart(agent.scope.topics[s.topic]) for s in agent.node.subscribes]
        defaults = topics or [ObservedPart(c.index, truth=True) for c in plants]
        names = [_topic_names(system, x) for x in defaults]
    if not names:
        raise wrong_choice("an observation of nothing", "observe=[...] names topics and truths")
    known = _observable(system, plants)
    for name in names:
        if name not in known:
            known_names = ", ".join(f"`{n}`" for n in known)
            raise wrong_choice(
                f"there is nothing to observe called `{name}`", f"there are {known_names}"
            )
        if not is_flat(_types(system, known[name])):
            message = f"`{name}` has no fixed number of numbers"
            raise wrong_choice(message, "observe=[...] names topics and truths without lists")
    return [known[name] for name in names]


def _observable(system: System, plants: Sequence[Component]) -> dict[str, ObservedPart]:
    """Name -> topic that nodes publish, or truth of a plant."""
    topics = [t for t in system.topics if t.queue_of is None and not t.held]
    truths = {f"{c.name}.truth": ObservedPart(c.index, truth=True) for c in plants}
    return {t.name: ObservedPart(t.index) for t in topics} | truths


def _topic_names(system: System, seen: ObservedPart) -> str:
    place = system.components if seen.truth else system.topics
    return f"{place[seen.index].name}{'.truth' if seen.truth else ''}"


def _types(system: System, seen: ObservedPart) -> list[Type]:
    if not seen.truth:
        return [system.topics[seen.index].type]
    plant = system.components[seen.index].plant
    assert plant is not None
    return [v.type for v in plant.states]


def require_compiled(system: System, agent: int) -> None:
    """SoterError U003 where something but the agent is extern: it would be one for all worlds."""
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
    """The system with the program's measurement errors on these topics that a plant drives, or all.

    An environment has sensors of its own; SoterError U001 for a topic that has no such errors.
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


INFO_KEYS = (
    *("mode", "ttf", "safer", "margin", "stale", "switched", "violations", "taken_by"),
    *("action_requested", "action_taken", "gate_fault", "intervened", "cause", "cost"),
    *("off_model", "action_mask", "not_finite"),
)
"""All keys that `info` may have on the module."""


def known_keys(keys: Collection[str]) -> tuple[str, ...]:
    """`keys` in the order of `INFO_KEYS`; SoterError U001 for others."""
    wanted = {keys} if isinstance(keys, str) else set(keys)
    if unknown := sorted(map(str, wanted.difference(INFO_KEYS))):
        names = ", ".join(f"`{name}`" for name in unknown)
        raise wrong_choice(f"`info` says nothing of {names}", f"it has {', '.join(INFO_KEYS)}")
    return tuple(key for key in INFO_KEYS if key in wanted)
