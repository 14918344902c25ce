"""Random programs with two modules that have contracts, and four tests of each.

Purpose: a module in a composition, and the same one replaced by its contract. The test is called
`T`; what it replaces is a choice of who asks: both as they are, either by its contract, both.
Non-goals: large programs; properties that only other variants could have (`mode`, `invariant`).
"""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

VARIANTS = {"concrete": "", "M": "replace N by contract;", "N": "replace M by contract;"}
VARIANTS["neither"] = " ".join((VARIANTS["M"], VARIANTS["N"]))


@dataclass(frozen=True)
class Contracted:
    """A program in two pieces: the test stands last."""

    head: str
    items: str
    asked: str

    def variant(self, name: str, *, asked: bool) -> str:
        """The program with test `T`; not `asked`: only contracts are judged."""
        always = self.asked if asked else "always true;"
        return f"{self.head}test T {{ system S; {VARIANTS[name]} {self.items} {always} }}\n"


class _Maker:
    def __init__(self, random: Random) -> None:
        self.random = random
        self.outputs = {"M": ["a"], "N": ["b"]}
        if random.random() < 0.3:
            self.outputs["M"].append("a2")
        self.words = {"M": self.word("b"), "N": self.word("a")}
        """What each module keeps to: a value that it never publishes, and whether its output is at
        most that of the other one."""
        self.by_node = {m: random.random() < 0.2 for m in "MN"}

    def word(self, other: str) -> tuple[int | None, bool, str]:
        r = self.random
        return r.choice([None, 1, 2, 2]), r.random() < 0.3, other

    def atom(self, topics: list[str]) -> str:
        t = self.random.choice(topics)
        if self.random.random() < 0.25 and len(topics) > 1:
            other = self.random.choice([x for x in topics if x != t])
            return f"{t} {self.random.choice(['==', '!=', '<=', '<'])} {other}"
        return f"{t} {self.random.choice(['==', '!=', '<', '>', '!='])} {self.random.randint(0, 2)}"

    def condition(self, topics: list[str]) -> str:
        one = self.atom(topics)
        if self.random.random() < 0.5:
            return one
        return f"{one} {self.random.choice(['&&', '||', '||'])} {self.atom(topics)}"

    def value(self, topics: list[str]) -> str:
        r = self.random
        plain = str(r.randint(0, 2))
        if not topics:
            return r.choice([plain, f"choose {{ {plain}, {r.randint(0, 2)} }}", "choose [0, 2]"])
        read = r.choice(topics)
        return r.choice(
            [
                plain,
                read,
                f"({read} + 1) % 3",
                f"choose {{ {plain}, {read} }}",
                f"{self.condition(topics)} ? {plain} : {r.randint(0, 2)}",
            ]
        )

    def kept(self, name: str, value: str) -> str:
        """The value, changed where the module would break its word; not always."""
        forbidden, relative, other = self.words[name]
        if self.random.random() < 0.08:
            return value
        value = f"min({value}, {other})" if relative else value
        if forbidden is None:
            return value
        instead = 0 if relative else (forbidden + 1) % 3
        return f"({value}) == {forbidden} ? {instead} : ({value})"

    def node(self, module: str, name: str, reads: list[str], period: str) -> str:
        r, outputs = self.random, self.outputs[module]
        _, relative, other = self.words[module]
        if relative and other not in reads:
            reads = [*reads, other]
        body = ""
        for t in outputs:
            value = self.value(reads)
            publish = f"let v = {value}; publish {t} = v;"
            if t == outputs[0]:
                publish = f"let v = {value}; publish {t} = {self.kept(module, 'v')};"
            guard = "true"
            if r.random() < 0.35:
                guard = self.condition(reads) if reads and r.random() < 0.6 else "choose bool"
            body += f" if {guard} {{ {publish} }}"
        some = [t for t in reads if t in body]
        heads = f"subscribes {', '.join(some)}; " if some else ""
        own = f"guarantees {self.clause(module)}; " if self.by_node[module] else ""
        text = f"node {name} period {period} {{ {heads}publishes {', '.join(outputs)}; "
        if own and relative and other not in some:
            own = ""
        return f"{text}{own}step {{{body} }} }}\n"

    def clause(self, module: str) -> str:
        forbidden, relative, other = self.words[module]
        output = self.outputs[module][0]
        said = [f"{output} <= {other}"] if relative else []
        said += [f"{output} != {forbidden}"] if forbidden is not None else []
        return " && ".join(said) or f"{output} >= 0"

    def module(self, name: str, other: list[str]) -> str:
        r, outputs = self.random, self.outputs[name]
        phase = " phase 5ms" if r.random() < 0.15 else ""
        seen = [t for t in other if r.random() < 0.6]
        text = self.node(name, f"{name}a", seen, "10ms" + phase)
        some = [t for t in other if r.random() < 0.4]
        text += self.node(name, f"{name}s", some, r.choice(["10ms", "10ms", "20ms"]))
        period = "20ms" if "s period 20ms" in text.replace(f"{name}s", "s") else "10ms"
        text += f"rta {name} {{ ac {name}a; sc {name}s; period {period}; safe true; "
        text += f"ttf {self.condition([*other, *outputs])}; "
        text += f"safer {self.condition([*other, *outputs])}; "
        if not self.by_node[name]:
            text += f"guarantees word: {self.clause(name)}; "
        theirs, relative, _ = self.words["N" if name == "M" else "M"]
        if r.random() < 0.3 and theirs and not relative:
            text += f"assumes theirs: {other[0]} != {theirs}; "
        return text + "}\n"


def contracted(seed: int) -> Contracted:
    """Program number `seed`."""
    random = Random(seed)  # noqa: S311
    maker = _Maker(random)
    all_of = maker.outputs["M"] + maker.outputs["N"]
    head = "soter 1;\n" + "".join(f"topic {t}: int in [0, 2];\n" for t in all_of)
    head += "topic c: int in [0, 3];\n"
    head += maker.module("M", maker.outputs["N"]) + maker.module("N", maker.outputs["M"])
    body = "publish c = a + b > 3 ? 3 : a + b;"
    queue = ""
    if random.random() < 0.3:
        queue = f" queue {random.choice([1, 2])}"
        body = "var n: int = 0; for x in a { n = n + x; } publish c = min(n, 3);"
    elif random.random() < 0.3:
        body = "publish c = age(a) > 0.012 ? 3 : b;"
    reads = f"a{queue}" + ("" if queue else ", b")
    head += f"node C period {random.choice(['10ms', '20ms'])} {{ subscribes {reads}; publishes c; "
    head += f"step {{ {body} }} }}\n"
    head += "system S { module M; module N; node C; }\n"
    items = f"horizon {random.choice(['10ms', '10ms', '20ms'])};"
    kind = random.random()
    if kind < 0.2:
        items += " late M.Ms by 5ms;"
    elif kind < 0.35:
        items += " skip N.Na at most 1;"
    elif kind < 0.55:
        items += " order deployed;"
    elif kind < 0.65 and not queue:
        items += " overrun N.Na by 5ms;"
    asked = f"always {maker.condition([*all_of, 'c'])} || {maker.condition([*all_of, 'c'])};"
    return Contracted(head, items, asked)
