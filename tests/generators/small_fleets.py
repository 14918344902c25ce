"""Random small programs of one or two instances of a sub-system, each with parameters of its own.

Purpose: what the explorer and the brute-force enumerator are compared on where systems have arrays
of instances, loops, wires between instances, parameters set for an instance, and tests that set
them: the programs of `small_test_programs.py`, put into a system that is a part.
Non-goals: meaning (`tests/correct/test_fleets_agree.py` compares with what is written out).
"""

from __future__ import annotations

import re
from random import Random

from generators.small_test_programs import HEAD, RANGES, Maker, Seen, Topic

PARAMETERS = {"Small": "LEVEL", "Cell": "LEVEL", "bool": "FLAG"}
DECLARED = "param LEVEL: Small = 1 in [0, 2];\nparam FLAG: bool = true;\n"


class FleetMaker(Maker):
    """Makes one program of instances."""

    def _declare(self) -> list[tuple[Topic, str]]:
        """Mostly one thing that is driven, and an input like it that may be wired to another's."""
        if self.chance(0.3):
            return super()._declare()
        kind = self.pick(("node", "node", "plant", "module"))
        driven = self._topic()
        topic = Topic("open", driven.type, True, driven.max_age)
        self.p.topics.append(topic)
        return [(topic, "open"), (driven, kind)]

    def _open(self, topic: Topic) -> None:
        if self.chance(0.2):
            self._drawn(topic)

    def _literal(self, t: str) -> str:
        if t in PARAMETERS and self.chance(0.3):
            return PARAMETERS[t]
        return super()._literal(t)

    def _assembled(self) -> str:
        count = 2 if self.p.actors <= 3 else 1
        topics = [self._declaration(t) for t in self.p.topics]
        items = "".join(f"  {item}\n" for item in self.p.items)
        code = "\n".join(self.p.text)
        self.p.topics = [t for t in self.p.topics if re.search(rf"\b{t.name}\b", code)]
        wires = self._wires() if count == 2 else []
        inside = [*wires, *self._sets("")]
        braces = f" {{ {', '.join(inside)} }}" if inside else ""
        fleet = f"  for i in 0..{count} {{ r[i]: Part{braces}; }}\n"
        loops = [f"for i in 0..{count} {{ {x} }}" for x in self._in_loops(self.p.replaced)]
        self._spread(count)
        loops += [f"{s};" for k in range(count) for s in self._sets(f"r[{k}].")]
        loops += [f"{s};" for s in self._sets("")]
        self.p.replaced = loops
        test = "".join(f"  {item}\n" for item in self._test())
        body = "\n".join([*topics, *self.p.text])
        return (
            f"{HEAD}{DECLARED}{body}\nsystem Part {{\n{items}}}\nsystem S {{\n{fleet}}}\n"
            f"test T {{\n  system S;\n{test}}}\n"
        )

    def _in_loops(self, items: list[str]) -> list[str]:
        return [re.sub(r"^(\w+) ", r"\1 r[i].", item) for item in items]

    def _faults(self) -> list[str]:
        """Some for every element, by a loop."""
        items = super()._faults()
        if len(items) == 1 and self.chance(0.5):
            (item,) = items
            inside = re.sub(r"r\[\d\]", "r[2 - i]", item)
            count = len({t.name.partition(".")[0] for t in self.p.topics})
            return [f"for i in {3 - count}..3 {{ {inside} }}"]
        return items

    def _sets(self, path: str) -> list[str]:
        """Settings for one place, without what ends them."""
        settings = []
        if self.chance(0.4):
            level = self.pick((0, 1, 2, "i", "2 - i") if path == "" and not self.spread else (0, 2))
            settings.append(f"set {path}LEVEL = {level}")
        if self.chance(0.4):
            settings.append(f"set {path}FLAG = {self.pick(('true', 'false'))}")
        return settings

    spread = False

    def _spread(self, count: int) -> None:
        """What tests may name: everything, once in each element."""
        p = self.p
        self.spread = True
        at = [f"r[{k}]." for k in range(count)]
        p.topics = [Topic(f"{a}{t.name}", t.type, t.input, t.max_age) for t in p.topics for a in at]
        by_name = {t.name: t for t in p.topics}
        p.nodes = {
            f"{a}{n}": [by_name[f"{a}{t.name}"] for t in ts]
            for n, ts in p.nodes.items()
            for a in at
        }
        p.queued = {f"{a}{t}" for t in p.queued for a in at}
        p.modules = [f"{a}{m}" for m in p.modules for a in at]
        p.truths = [Seen(f"{a}{s.text}", s.type) for s in p.truths for a in at]
        p.actors *= count

    def _wires(self) -> list[str]:
        """Inputs of each element that are driven topics of the other one."""
        wires = []
        for t in self.p.topics:
            driven = [
                d.name
                for d in self.p.topics
                if not d.input and (d.type, d.max_age) == (t.type, t.max_age)
            ]
            if t.input and driven and self.chance(0.7):
                other = self.pick(driven)
                wires.append(f"{t.name} = r[(i + 1) % 2].{other}")
                if t.name in self.p.queued:
                    self.p.queued.add(other)
        return wires


assert set(PARAMETERS) - {"bool"} <= set(RANGES)


def small_fleet(seed: int) -> str:
    """The text of program number `seed`."""
    return FleetMaker(Random(seed)).run()  # noqa: S311 - the same programs every time are wanted
