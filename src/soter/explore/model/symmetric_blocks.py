"""Equal instances of a test: families of blocks of a packed configuration that may change places.

Purpose: `find_families` proposes renamings that swap two components and whatever has to be swapped
with them, keeps those that `symmetry.py` accepts, and finds the bits of a packed configuration that
they swap. Two swaps that share a block make a family of three, and so on: swaps of one block with
each of the others generate all orders of the blocks. `SymmetricInstances` tells the C engine of
them: what one instance reached, its equals can reach, too.
Non-goals: why that is sound (docs/testing.md, "Equal instances"), using it (`engine/c/`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.explore.judge import test_plan
from soter.explore.model.symmetry import Renaming, RenamingCheck
from soter.explore.search_options import REDUCTIONS, SAMPLING, SYMMETRY

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    import numpy.typing as npt

    from soter.core.core import CoreSystem
    from soter.explore.engine.coverage import CoverageCounters
    from soter.explore.model.exploration_plan import ExplorationPlan, IndependentPart
    from soter.explore.model.explorer_model import ExplorerModel
    from soter.explore.model.footprints import Label
    from soter.explore.model.symmetry import Field
    from soter.explore.search_options import SearchOptions
    from soter.language.model.system import Component, System

    Span = tuple[int, int]
    """First bit and width of a field."""

WORD = 64
FIELDS_MAX = 4096
"""The most fields that all blocks of a family have together (`SOTER_WORDS`)."""


@dataclass(frozen=True, eq=False)
class Family:
    """Equal instances: their names, and the fields of each, which correspond in order.

    `swaps`: renamings that swap the first one with each of the others. `actors`, `properties`
    and `timeds` are masks of what they rename.
    """

    names: tuple[str, ...]
    blocks: tuple[tuple[Span, ...], ...]
    swaps: tuple[Renaming, ...]
    actors: int
    properties: int
    timeds: int

    def is_inside(self, part: IndependentPart | None) -> bool:
        """Whether all that it renames is in this part of the system (None: the whole system)."""
        if part is None or part.actors == 0:
            return True
        judged = ((self.properties, part.properties), (self.timeds, part.timeds))
        return not self.actors & ~part.actors and all(
            not mine & ~own or not mine & own for mine, own in judged
        )


def find_families(
    system: System, lowered: CoreSystem, plan: ExplorationPlan, fields: tuple[Field, ...]
) -> tuple[Family, ...]:
    """The families of a test, those with the smallest blocks first: they may be inside others."""
    judge = RenamingCheck(system, lowered, plan, fields)
    places: dict[Label, list[Span]] = {}
    for label, at, width in fields:
        places.setdefault(label, []).append((at, width))
    families: list[Family] = []
    tried: set[tuple[int, int]] = set()
    for x in system.components:
        swaps: list[tuple[Component, Renaming]] = []
        for y in system.components[x.index + 1 :]:
            if not _alike(x, y) or (x.index, y.index) in tried:
                continue
            tried.add((x.index, y.index))
            renaming = _propose_swap(judge, x, y)
            if renaming is not None and judge.accepts(renaming):
                tried |= set(renaming.components.items())
                swaps.append((y, renaming))
        for family in _group_swaps(system, places, x, swaps):
            if not any(_contains_swap(f, family) for f in families):
                families.append(family)
                tried |= _pairs(family)
    return tuple(sorted(families, key=lambda f: len(f.blocks[0])))


def _contains_swap(family: Family, pair: Family) -> bool:
    """Whether two blocks of a family are those that the pair swaps."""
    moved = {s for b in pair.blocks for s in b}
    return any({*a, *b} == moved for a, b in combinations(family.blocks, 2))


def _pairs(family: Family) -> set[tuple[int, int]]:
    """The pairs of components that have the same place in two of a family's blocks."""
    pairs = set()
    for r, s in combinations(family.swaps, 2):
        for i in r.components.keys() & s.components.keys():
            pairs |= {(r.components[i], s.components[i]), (s.components[i], r.components[i])}
    return pairs


def _alike(x: Component, y: Component) -> bool:
    """Whether two components are so similar that a swap is worth a try."""
    if x.node is not y.node or x.plant is not y.plant:
        return False
    return (x.role, x.period_ns, x.phase_ns) == (y.role, y.period_ns, y.phase_ns)


# ---------------------------------------------------------------- what has to be swapped as well


class _Swap:
    """A renaming that is its own inverse, as it grows."""

    def __init__(self, judge: RenamingCheck) -> None:
        self.judge = judge
        self.system = judge.system
        self.renaming = Renaming()
        self.waiting: list[tuple[str, int, int]] = []
        self.possible = True

    def add(self, kind: str, a: int, b: int) -> None:
        """Adds that two components, topics or modules change places (or one stays)."""
        renamed = {
            "component": self.renaming.components,
            "topic": self.renaming.topics,
            "module": self.renaming.modules,
        }[kind]
        if renamed.get(a, b) != b or renamed.get(b, a) != a:
            self.possible = False
        elif a not in renamed and a != b:
            renamed[a], renamed[b] = b, a
            self.waiting.append((kind, a, b))

    def grow(self) -> None:
        """Adds swaps until nothing more has to be swapped; topics come after code."""
        while self.possible and self.waiting:
            at = next((i for i, w in enumerate(self.waiting) if w[0] != "topic"), 0)
            kind, a, b = self.waiting.pop(at)
            {
                "component": self._swap_components,
                "module": self._swap_modules,
                "topic": self._swap_namers,
            }[kind](a, b)

    def _swap_components(self, a: int, b: int) -> None:
        first, second = self.system.components[a], self.system.components[b]
        named, other = self.judge.reads(first), self.judge.reads(second)
        self.possible = len(named) == len(other) and (first.module is None) == (
            second.module is None
        )
        if not self.possible:
            return
        if first.module is not None and second.module is not None:
            self.add("module", first.module, second.module)
        for (kind, own), (same, other_index) in zip(named, other, strict=True):
            self.possible = self.possible and kind == same
            self.add(kind, own, other_index)

    def _swap_modules(self, a: int, b: int) -> None:
        m, n = self.system.modules[a], self.system.modules[b]
        for i, j in ((m.dm, n.dm), (m.ac, n.ac), (m.sc, n.sc)):
            self.add("component", i, j)

    def _swap_namers(self, a: int, b: int) -> None:
        """Swaps the components that name one of two topics; a component that names both stays."""
        there, here = self._components_naming(a), self._components_naming(b)
        stay = [i for i in there if i in here]
        left = [i for i in there if i not in stay and i not in self.renaming.components]
        right = [i for i in here if i not in stay and i not in self.renaming.components]
        self.possible = len(left) == len(right)
        for i in left:
            component = self.system.components[i]
            j = next((j for j in right if _alike(component, self.system.components[j])), None)
            if j is None:
                self.possible = False
                return
            right.remove(j)
            self.add("component", i, j)
        self._swap_queues(a, b)

    def _swap_queues(self, a: int, b: int) -> None:
        """Swaps queues behind two topics, of one subscriber or of two that are swapped."""
        topics = self.system.topics
        of_a, of_b = topics[a].queue_of, topics[b].queue_of
        if of_a is not None and of_b is not None:
            self.add("topic", of_a, of_b)
        for q in topics[a].queues:
            if q in self.renaming.topics:
                continue
            namers = {self.renaming.component(i) for i in self._components_naming(q)}
            same = [p for p in topics[b].queues if namers & set(self._components_naming(p))]
            if same:
                self.add("topic", q, same[0])

    def _components_naming(self, topic: int) -> list[int]:
        """The components whose code names a topic, or a queue behind it."""
        some = {("topic", t) for t in (topic, *self.system.topics[topic].queues)}
        return [x.index for x in self.system.components if some & set(self.judge.reads(x))]


def _propose_swap(judge: RenamingCheck, x: Component, y: Component) -> Renaming | None:
    """The renaming that swaps two components; None where that cannot be completed."""
    swap = _Swap(judge)
    swap.add("component", x.index, y.index)
    swap.grow()
    return swap.renaming if swap.possible else None


# ---------------------------------------------------------------- families


def _group_swaps(
    system: System,
    places: dict[Label, list[Span]],
    first: Component,
    swaps: list[tuple[Component, Renaming]],
) -> list[Family]:
    """Families of swaps: as many as fit together in one; a swap that fits no other by itself."""
    moved = [_moved_labels(places, renaming) for _, renaming in swaps]
    left, made = list(range(len(swaps))), []
    while left:
        together = max((_compatible_swaps(moved, left[0], other, left) for other in left), key=len)
        row = sorted(set.intersection(*[set(moved[number]) for number in together]))
        if len(together) == 1:
            row = [label for label in row if label < moved[together[0]][label]]  # one of each two
        blocks = [row, *([moved[number][label] for label in row] for number in together)]
        made.append(
            _swap_family(system, places, first, [swaps[number] for number in together], blocks)
        )
        left = [number for number in left if number not in together]
    return [family for family in made if family is not None]


def _compatible_swaps(
    moved: list[dict[Label, Label]], first: int, second: int, others: list[int]
) -> list[int]:
    """The swaps, at least the first, that exchange one block, common to two, with others."""
    inside = set(moved[first]) & set(moved[second])
    taken, swaps = set(inside), []
    for i in dict.fromkeys((first, second, *others)):
        block = {moved[i].get(x, x) for x in inside}
        if set(moved[i]) == inside | block and not block & taken:
            swaps.append(i)
            taken |= block
    return swaps if first in swaps else [first]


def _moved_labels(places: dict[Label, list[Span]], r: Renaming) -> dict[Label, Label]:
    """The pieces of a configuration that change places, each with what takes its place."""
    return {x: r.label(x) for x in places if r.label(x) != x}


def _swap_family(
    system: System,
    places: dict[Label, list[Span]],
    first: Component,
    swaps: Sequence[tuple[Component, Renaming]],
    blocks: Sequence[Sequence[Label]],
) -> Family | None:
    """The family of these swaps; None where there is nothing to swap, or too much."""
    spans = [[span for label in block for span in places[label]] for block in blocks]
    own = _merge_fields(spans)
    if not own[0] or len(own) * len(own[0]) > FIELDS_MAX:
        return None
    renamed = [renaming for _, renaming in swaps]
    return Family(
        names=_instance_names(
            system, [first.name, *(component.name for component, _ in swaps)], renamed
        ),
        blocks=tuple([tuple(b) for b in own]),
        swaps=tuple(renamed),
        actors=_renamed_mask(renaming.actors for renaming in renamed),
        properties=_renamed_mask(renaming.properties for renaming in renamed),
        timeds=_renamed_mask(renaming.timeds for renaming in renamed),
    )


def _merge_fields(blocks: list[list[Span]]) -> list[list[Span]]:
    """The blocks' bits in as few fields, of at most a word each, as possible."""
    fields: list[list[Span]] = [[] for _ in blocks]
    for row in sorted(zip(*blocks, strict=True)):
        ends = [b[-1][0] + b[-1][1] if b else -1 for b in fields]
        width = row[0][1]
        wide = width + fields[0][-1][1] if fields[0] else WORD + 1
        if wide <= WORD and all(e == at for e, (at, _) in zip(ends, row, strict=True)):
            for b in fields:
                b[-1] = (b[-1][0], wide)
            continue
        for b, (at, _) in zip(fields, row, strict=True):
            b += [(at + k, min(WORD, width - k)) for k in range(0, width, WORD)]
    return fields


def _instance_names(
    system: System, names: list[str], renamed: Sequence[Renaming]
) -> tuple[str, ...]:
    """The names of instances: `r[0]`, `r[1]` for `r[0].Go`, `r[1].Go` if all in them is swapped."""
    moved = {system.components[i].name for r in renamed for i in r.components}
    still = [x.name for x in system.components if x.name not in moved]
    parts = [n.split(".") for n in names]
    while min(len(p) for p in parts) > 1 and len({p[-1] for p in parts}) == 1:
        shorter = [p[:-1] for p in parts]
        if any(n.startswith(".".join(p) + ".") for p in shorter for n in still):
            break
        parts = shorter
    return tuple([".".join(p) for p in parts])


def _renamed_mask(maps: Iterable[Mapping[int, int]]) -> int:
    """A mask of those that are renamed by any of some maps."""
    return sum(1 << i for i in {i for of in maps for i, j in of.items() if i != j})


class SymmetricInstances:
    """The equal instances of one test."""

    def __init__(self, system: System, lowered: CoreSystem, model: ExplorerModel) -> None:
        self._system = system
        self._lowered = lowered
        self._model = model
        self._fields: Any = None

    @cached_property
    def families(self) -> tuple[Family, ...]:
        """All families; none where a declared order puts one instance before another."""
        if test_plan(self._system).ordered:
            return ()
        return find_families(self._system, self._lowered, self._model.plan, self._model.fields)

    def usable_families(
        self, options: SearchOptions, part: IndependentPart | None
    ) -> tuple[Family, ...]:
        """The families that a search of a part of the system (None: all of it) can use."""
        if not REDUCTIONS[options.reduction] & SYMMETRY or options.strategy in SAMPLING:
            return ()
        return tuple([f for f in self.families if f.is_inside(part)])

    def options(self, ffi: Any, some: Sequence[Family]) -> dict[str, object]:  # noqa: ANN401 - cffi
        """The fields for `soter_explore_options`; they live until the next call."""
        self._fields = [ffi.new("soter_field[]", [x for b in f.blocks for x in b]) for f in some]
        rows = [(len(f.blocks), len(f.blocks[0]), x) for f, x in zip(some, self._fields)]  # noqa: B905
        self._fields.append(ffi.new("soter_family[]", rows))
        return {"family": self._fields[-1], "families": len(some)}

    # ------------------------------------------------------------ coverage

    def spread(self, some: Sequence[Family], seen: CoverageCounters) -> None:
        """Adds what was seen of one instance to each of its equals."""
        for family in some:
            for r in family.swaps:
                self._spread(r, seen)
            for r in family.swaps:  # and back from the first one to the others
                self._spread(r, seen)

    def _spread(self, renaming: Renaming, seen: CoverageCounters) -> None:
        """Adds what was seen once more, after a renaming."""
        timed = len(self._system.properties)
        of_timed = {timed + i: timed + j for i, j in renaming.timeds.items()}
        for rows, to in (
            (seen.classes, self._leaves(renaming)),
            (seen.modes, renaming.modules),
            (seen.switches, renaming.modules),
            (seen.fired, renaming.actors),
            (seen.judged, renaming.properties | of_timed),
        ):
            _join_rows(rows, to)
        bits = np.unpackbits(seen.branches.view(np.uint8), bitorder="little")
        _join_rows(bits, dict(self._branches(renaming)))
        seen.branches[:] = np.packbits(bits, bitorder="little").view(np.uint64)

    def _leaves(self, renaming: Renaming) -> dict[int, int]:
        number = {leaf: i for i, leaf in enumerate(self._model.leaves)}
        moved = {i: number.get((renaming.topic(t), path), i) for (t, path), i in number.items()}
        return {i: j for i, j in moved.items() if i != j}

    def _branches(self, renaming: Renaming) -> Iterator[tuple[int, int]]:
        """For each branch the one that stands for it after a renaming."""
        numbers: dict[str, list[int]] = {}
        for i, b in enumerate(self._model.unit.branches):
            numbers.setdefault(b.component, []).append(i)
        names: Sequence[str] = [x.name for x in self._system.components]
        for i, j in renaming.components.items():
            yield from zip(numbers.get(names[i], ()), numbers.get(names[j], ()), strict=True)


def _join_rows(rows: npt.NDArray[Any], stands_for: dict[int, int]) -> None:
    """Joins each row with the one that stands for it: what is set in one is set in both."""
    before = rows.copy()
    for i, j in stands_for.items():
        rows[j] |= before[i]
