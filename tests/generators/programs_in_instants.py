"""Random programs whose actors fall into groups within an instant.

Purpose: what `small_test_programs.py` makes too rarely: nothing skewed, late or long, so that only
ends of instants are stored; two or three clusters of actors that are due together, read mostly what
their own cluster wrote in the same instant, and break contracts or fault there; properties that
read across clusters, which often share nothing else. Now and then something that switches a
reduction off.
Non-goals: times that are chosen.
"""

from __future__ import annotations

from random import Random

from generators.small_test_programs import TICK, Maker, Seen, Topic

TYPES = ("bool", "bool", "Small", "Signed", "Color")


class InstantsMaker(Maker):
    """Makes one program; every choice comes from `random`.

    With `loose` its clusters share nothing, and a property reads two of them.
    """

    def __init__(self, random: Random, *, loose: bool = False) -> None:
        super().__init__(random)
        self.loose = loose
        self.timed = not self.loose and self.chance(0.1)
        self.owed = not self.loose and self.chance(0.3)
        self.cluster: dict[str, int] = {}
        self.at = 0

    def _declare(self) -> list[tuple[Topic, str]]:
        driven = []
        left = 6
        for cluster in range(self.pick((2, 2, 3))):
            self.at = cluster
            kinds = self.pick(
                (("node",), ("node", "node"), ("plant", "node"), ("drawn", "node"), ("module",))
            )
            kinds = kinds if len(kinds) + 2 * kinds.count("module") <= left else ("node",)
            left -= len(kinds) + 2 * kinds.count("module")
            driven += [(self._topic(input_=k == "drawn"), k) for k in kinds]
        return driven

    def _topic(self, *, input_: bool = False) -> Topic:
        topic = super()._topic(input_=input_)
        topic.type = self.pick(TYPES)
        topic.max_age = topic.max_age if self.timed else 0
        self.cluster[topic.name] = self.at
        return topic

    def _clock_apart(self) -> None:
        return

    def _reads(self, publishes: list[Topic]) -> list[Topic]:
        self.at = self.cluster[publishes[0].name]
        near = [
            t
            for t in self.p.topics
            if t not in publishes
            and (self.cluster[t.name] == self.at or (self.chance(0.1) and not self.loose))
        ]
        return self.random.sample(near, min(len(near), self.pick((1, 1, 2))))

    def _seen_by_a_module(self, outputs: list[Topic]) -> list[Topic]:
        return self._reads(outputs)[:1] or outputs[:1]

    def _period(self, most: int = 3) -> int:
        return int(self.pick((1, 1, 2)[:most])) * TICK

    def _test(self) -> list[str]:
        ticks = self.pick((1, 1, 2) if self.p.actors > 4 else (1, 2, 3))
        self.horizon = ticks * TICK
        items = [*self.p.replaced, f"horizon {self.horizon}ms;"]
        if self.chance(0.12):
            items.append(f"skip {self.pick(self.p.nodes)} at most {self.pick((1, 2))};")
        if self.chance(0.04):
            items.append(f"skew {TICK}ms;")
        return [*items, *self._properties()]

    def _properties(self) -> list[str]:
        return [*super()._properties(), *([self._joint()] if self.loose else [])]

    def _joint(self) -> str:
        """What is true in most combinations of the clusters' topics."""
        of: dict[int, list[Seen]] = {}
        for t in self.p.topics:
            of.setdefault(self.cluster[t.name], []).append(Seen(t.name, t.type))
        some = self.random.sample(sorted(of), min(len(of), self.pick((2, 2, 3))))
        told = [self._bool(of[n], 1) for n in some]
        told += [self._bool(of[n], 0) for n in some if self.chance(0.4)]
        told_one = " || ".join(told)
        return str(self.pick((f"always {told_one};", f"never !({told_one});")))

    def _mostly(self, sees: list[Seen]) -> str:
        return f"({super()._mostly(sees)} || {self._bool(sees, 1)})"

    def _likely(self, sees: list[Seen]) -> str:
        return f"({super()._likely(sees)} || {self._bool(sees, 1)})"

    def _property(self, way: str, sees: list[Seen]) -> str:
        promise = way in ("within", "leadsto", "invariant")
        return super()._property("always" if promise and not self.owed else way, sees)


def program_joined(seed: int) -> str:
    """The text of program number `seed`: parts that only properties join."""
    return InstantsMaker(Random(seed), loose=True).run()  # noqa: S311 - as below


def program_in_instants(seed: int) -> str:
    """The text of program number `seed`."""
    return InstantsMaker(Random(seed)).run()  # noqa: S311 - the same programs every time
