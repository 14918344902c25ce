"""Says whether what a step read from a log is young enough to be judged.

Purpose: `TopicsHeard` compares ages with `max_age`, or without one with some periods of what is
measured: of what a DM reads and of what nodes read that ran for it.
Non-goals: what a DM decides on old reads (`semantics/rules.py`); stamps against the log's clock
(`typed_samples.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from math import inf
from statistics import median
from typing import TYPE_CHECKING

from soter.language.elaborate.passes.read_ages import is_measured
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import AgeRead
from soter.monitor.decidable_modules import ReplayPlan, reads_of_node, source_topics, writes_of_node
from soter.monitor.model_membership import SILENT

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.model.system import System
    from soter.monitor.typed_samples import TopicSamples
    from soter.semantics.configuration import Configuration


@dataclass
class Dependencies:
    """The topics of the log and the nodes on which a step depends."""

    topics: set[int]
    nodes: set[int]


@dataclass
class TopicsHeard:
    """The limits of the ages of a log's topics, and whether nodes read young enough values.

    `most_ns`: for each topic of the log, the greatest age at which a read can be judged;
    `silent_ns`: the age beyond which the topic counts as silent. `sound`: for each node, whether
    all topics of the log that it reads itself were young enough at its last step.
    """

    system: System
    plan: ReplayPlan
    most_ns: dict[int, float] = field(default_factory=dict)
    silent_ns: dict[int, float] = field(default_factory=dict)
    sound: dict[int, bool] = field(default_factory=dict)

    @classmethod
    def before_log(
        cls, system: System, samples: Iterable[TopicSamples], plan: ReplayPlan
    ) -> TopicsHeard:
        """The limits for a log whose replay has not begun."""
        made = cls(system, plan)
        with_read_ages = _topics_with_read_ages(system)
        own_age_max_ns = min((system.modules[m].period_ns for m in plan.modules), default=0)
        for s in samples:
            if s.is_constant:
                continue
            topic, gaps = s.topic, [b - a for a, b in pairwise(s.times_ns) if b > a]
            measured = is_measured(system, topic.index) and topic.index not in with_read_ages
            silent_ns = SILENT * (median(gaps) if gaps else own_age_max_ns if measured else inf)
            age_ns = topic.max_age_ns
            made.silent_ns[topic.index] = max(silent_ns, age_ns or 0)
            made.most_ns[topic.index] = silent_ns if measured else inf
            if age_ns is not None:
                made.most_ns[topic.index] = age_ns
        return made

    def dependencies_of_reads(self, topics: Iterable[int]) -> Dependencies:
        """The topics of the log and the nodes on which these reads of a DM or of `safe` depend."""
        topics = set(topics)
        behind = source_topics(self.system, self.plan.nodes, topics)
        ran = {n for n in self.plan.nodes if writes_of_node(self.system.components[n]) & behind}
        return Dependencies(source_topics(self.system, (), topics) & self.most_ns.keys(), ran)

    def note_node_step(self, c: Configuration, node: int) -> None:
        """Notes a step of a node, before the node publishes."""
        reads = reads_of_node(self.system, self.system.components[node])
        self.sound[node] = self._are_young(c, reads & self.most_ns.keys())

    def rests_on_young_topics(self, c: Configuration, on: Dependencies) -> bool:
        """Whether the topics are young enough now and were so at each node's last step."""
        return self._are_young(c, on.topics) and all(self.sound.get(n, False) for n in on.nodes)

    def stamps_of_silent_topics(self, c: Configuration, on: Dependencies) -> dict[str, int]:
        """The last stamps, in ns, of the topics that a step depends on and that are silent now."""
        read = on.topics.union(*(self._logged_reads(n) for n in on.nodes))
        return {
            self.system.topics[i].name: c.stamps[i]
            for i in sorted(read)
            if c.ct - c.stamps[i] > self.silent_ns[i]
        }

    def _logged_reads(self, node: int) -> set[int]:
        reads = reads_of_node(self.system, self.system.components[node])
        return set(reads & self.silent_ns.keys())

    def _are_young(self, c: Configuration, topics: Iterable[int]) -> bool:
        return all(c.ct - c.stamps[i] <= self.most_ns[i] for i in topics)


def _topics_with_read_ages(system: System) -> set[int]:
    """The topics whose `age` a predicate reads."""
    return {
        m.scope.topics[n.topic]
        for m in system.modules
        for n in nodes([e for e in m.symbol.predicates if e is not None])
        if isinstance(n, AgeRead) and n.topic in m.scope.topics
    }
