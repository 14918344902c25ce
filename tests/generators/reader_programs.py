"""Random programs with a stand-in that publishes records, and readers that tell some values apart.

Purpose: what readers do with a number decides which of its values a test has to try
(docs/testing.md): they compare it with constants or with other fields, calculate, copy, index, pass
it on, queue it, or leave it alone. The test is called `T`; `Maker` is replaced by its contract.
Non-goals: large programs; what makes contracts hide violations (`contract_programs.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from random import Random

MOST_OF = {"n": 12, "m": 2, "b": 12}
"""The largest value of each int: fields of the record, and a topic of its own."""
SHORT, LONG = "9ms", "10ms"
"""Horizons: one step of the stand-in, or two, of a record with fewer values."""
OPERATORS = ("==", "!=", "<", "<=", ">", ">=")
WAYS = ("fields", "sums", "signs", "prelude", "functions", "indices", "copies", "records")
"""How numbers are read other than by comparison with a constant, one way a program."""
FLOATS = (0.0, 0.5, 1.0, 2.5, 4.0)
"""What the float is compared with; it is of [0, 4]."""


@dataclass(frozen=True)
class Read:
    """A program without the last items of its test, and the values of its float, if it has one."""

    head: str
    items: str
    dense: str

    def text(self, *, stated: bool) -> str:
        """The program; `stated`: the float is held to values on all sides of each constant."""
        return f"{self.head}test T {{ {self.items} {self.dense if stated else ''} }}\n"


@dataclass
class _Maker:
    random: Random
    fields: list[str] = field(default_factory=list)
    """Numbers that the stand-in publishes, as they are read: `a.n`, `b`."""
    bools: list[str] = field(default_factory=list)
    floats: list[str] = field(default_factory=list)
    constants: dict[str, float] = field(default_factory=dict)
    copies: float = 0.3
    """How often a number is read as it is; in others it is compared with constants alone."""
    way: str = ""
    """How it is read then."""
    horizon: str = SHORT
    guarded: bool = True
    """Whether there is a module, besides the reader."""

    def pick(self, *of: str) -> str:
        return self.random.choice(of)

    def constant(self, number: str) -> str:
        most = MOST_OF[number[-1]]
        c = self.random.randint(-1, most + 1)
        return self.pick(str(c), str(c), "P", f"(P + {self.random.randint(0, 2)})", "C")

    def compared(self, number: str) -> str:
        """A number against a constant, on either side."""
        op, c = self.pick(*OPERATORS), self.constant(number)
        if self.random.random() < 0.25:
            least = self.random.randint(0, 9)
            return f"{number} > {least} && {number} < {least + self.random.randint(2, 4)}"
        return self.pick(f"{number} {op} {c}", f"{number} {op} {c}", f"{c} {op} {number}")

    def atom(self, reads: list[str]) -> str:
        """A condition on some of what is read; `reads`: numbers, bools and floats."""
        r = self.random
        x = r.choice(reads)
        if x in self.bools:
            return self.pick(x, f"!{x}", f"{x} == true")
        if x in self.floats:
            i = r.randint(0, len(FLOATS) - 2)
            between = f"{FLOATS[i]} < {x} && {x} < {FLOATS[i + 1]}"
            return self.pick(f"{x} {self.pick(*OPERATORS)} {r.choice(FLOATS)}", between)
        if r.random() > self.copies:
            return self.compared(x)
        y = r.choice([y for y in reads if y in self.fields])
        op = self.pick(*OPERATORS)
        expressions = {
            "fields": (f"{x} {op} {y}", f"({x} > {r.randint(0, 5)} ? {x} : {y}) {op} 4"),
            "sums": (f"{x} + {r.randint(0, 3)} {op} 5", f"{x} % 3 == {r.randint(0, 2)}"),
            "signs": (f"-{x} {op} -{r.randint(0, 9)}", f"float({x}) {op} {r.randint(0, 9)}.5"),
            "prelude": (f"min({x}, 5) {op} 4", f"abs({x} - {r.randint(1, 6)}) {op} 2"),
            "functions": (f"near({x}, {r.randint(0, 9)})", f"digit({x}) == {r.randint(3, 6)}"),
        }
        return self.pick(*expressions.get(self.way, (self.compared(x),)))

    def condition(self, reads: list[str]) -> str:
        one = self.atom(reads)
        way = self.random.random()
        if way < 0.6:
            return one
        if way < 0.75:
            return f"!({one}) || {self.atom(reads)}"
        return f"({one}) {self.pick('&&', '||', '||')} ({self.atom(reads)})"

    def value(self, reads: list[str]) -> str:
        """An int of [0, 6]."""
        r = self.random
        numbers = [x for x in reads if x in self.fields]
        if numbers and r.random() < self.copies:
            x = r.choice(numbers)
            values = {
                "sums": (f"{x} % 7",),
                "prelude": (f"min({x}, 6)",),
                "indices": (f"TABLE[{x} % 5]", f"TABLE[{x}]"),
                "functions": (f"digit({x})",),
            }
            if self.way in values:
                return self.pick(*values[self.way])
        return f"{self.condition(reads)} ? {r.randint(0, 6)} : {r.randint(0, 6)}"

    def whole(self) -> str:
        """Statements that read records as wholes."""
        r = self.random
        return self.pick(
            f"let w = a; if w.on {{ s = {r.randint(0, 6)}; }}",
            f"if graded(a) > {r.randint(0, 9)} {{ s = {r.randint(0, 6)}; }}",
            f"if a.m == last.m && last.on {{ s = {r.randint(0, 6)}; }} last = a;",
            f"if last.m > a.m {{ s = {r.randint(0, 6)}; }} last.m = a.m;",
        )

    def statements(self, reads: list[str], *, record: bool) -> str:
        r = self.random
        if self.guarded and r.random() < 0.3:
            return "s = 0;"
        out = [f"if {self.condition(reads)} {{ s = {self.value(reads)}; }}"]
        if self.way == "copies" or r.random() < 0.4:
            numbers = [x for x in reads if x in self.fields]
            out.append(f"s = {self.value(reads)};")
            if numbers and self.way == "copies":
                out.append(f"kept = {numbers[-1]};")
                out.append(f"if kept {self.pick('>', '==')} {r.randint(1, 9)} {{ s = 1; }}")
        if record and self.way == "records":
            out.append(self.whole())
        if r.random() < 0.2:
            out.append(f"if age({reads[0].partition('.')[0]}) > 0.005 {{ s = {r.randint(0, 6)}; }}")
        if r.random() < 0.15:
            out.append(f"assert {self.condition(reads)};")
        r.shuffle(out)
        return " ".join(out)


def readers(seed: int) -> Read:
    """Program number `seed`."""
    r = Random(seed)  # noqa: S311
    maker = _Maker(r, copies=r.choice([0.0, 0.2, 0.5]), way=r.choice(WAYS))
    kind = r.random()
    maker.horizon = LONG if kind < 0.25 else SHORT
    maker.floats = ["a.f"] if 0.25 <= kind < 0.5 else []
    maker.guarded = r.random() < 0.5
    large = "b" if kind > 0.8 else "a.n"
    maker.fields = ["a.m"] if kind < 0.5 else ["a.m", large]
    maker.bools = ["a.on"] if r.random() < 0.6 else []
    return _program(maker, own="b" in maker.fields)


def _program(maker: _Maker, *, own: bool) -> Read:
    r = maker.random
    fields = [f"{x[2:]}: int in [0, {MOST_OF[x[2:]]}]" for x in maker.fields if x != "b"]
    fields += ["on: bool"] + (["f: float"] if maker.floats else [])
    outputs = "a, b" if own else "a"
    head = "soter 1;\n" + f"type R = {{ {', '.join(fields)} }};\n"
    head += f"const C: int = {r.randint(0, 6)};\nparam P: int = {r.randint(0, 9)};\n"
    head += "const TABLE: int[5] = [0, 5, 1, 2, 4];\n"
    head += "fun near(x: int, y: int): bool { return x == y || x == y + 1; }\n"
    head += "fun digit(x: int): int { return x > 7 ? 6 : x > 2 ? 3 : 0; }\n"
    head += "fun graded(w: R): int { return w.m * 2 + (w.on ? 1 : 0); }\n"
    within = " in { f in [0.0, 4.0] }" if maker.floats else ""
    head += f"topic a: R{within};\n" + ("topic b: int in [0, 12];\n" if own else "")
    head += "topic o: int in [0, 6];\ntopic u: int in [0, 6];\n"
    reads = [*maker.fields, *maker.bools, *maker.floats]
    promise = f"guarantees {maker.condition(reads)}; " if r.random() < 0.4 else ""
    head += f"node Maker period 10ms {{ publishes {outputs}; {promise}step {{ }} }}\n"
    head += _reader(maker, reads, outputs)
    if maker.guarded:
        head += _module(maker, reads, outputs)
    guard = "module Guard; " if maker.guarded else ""
    head += f"system S {{ node Maker; node Reader; {guard}}}\n"
    return Read(head, _items(maker, reads), _dense(maker))


def _reader(maker: _Maker, reads: list[str], outputs: str) -> str:
    r = maker.random
    state = "var s: int in [0, 6]; var kept: int; var last: R;"
    text = f"subscribes {outputs}; publishes o; {state} "
    body = maker.statements(reads, record=not maker.floats)
    if r.random() < 0.15 and not maker.floats:
        text = f"subscribes a queue 1; publishes o; {state} "
        asked = f"x.m {maker.pick('>', '==')} {r.randint(0, 3)}"
        body = f"for x in a {{ if {asked} {{ s = {r.randint(1, 6)}; }} }}"
    elif r.random() < 0.2:
        text += f"assumes {maker.condition(reads)}; "
    period = maker.pick("10ms", "3ms", "3ms")
    return f"node Reader period {period} {{ {text}step {{ {body} publish o = s; }} }}\n"


def _module(maker: _Maker, reads: list[str], outputs: str) -> str:
    r = maker.random
    state = "var s: int in [0, 6]; var kept: int;"
    text = ""
    for name in ("Advanced", "Safe"):
        body = maker.statements(reads, record=False) if name == "Advanced" else ""
        body += f" publish u = {'s' if name == 'Advanced' else r.randint(0, 6)};"
        heads = f"subscribes {outputs}; publishes u; {state} " if "s = " in body else "publishes u;"
        text += f"node {name} period 3ms {{ {heads} step {{ {body} }} }}\n"
    ttf = maker.condition(reads)
    word = f"u {maker.pick('!=', '<=')} {r.randint(0, 6)} || {maker.condition(reads)}"
    clause = f"guarantees word: {word}; " if r.random() < 0.25 else ""
    assumes = f"assumes theirs: {maker.condition(reads)}; " if r.random() < 0.2 else ""
    return (
        f"{text}rta Guard {{ ac Advanced; sc Safe; period 3ms; safe true; ttf {ttf}; "
        f"safer {maker.condition(reads)}; {clause}{assumes}}}\n"
    )


def _items(maker: _Maker, reads: list[str]) -> str:
    r = maker.random
    items = f"system S; horizon {maker.horizon}; replace Maker by contract;"
    if maker.guarded and r.random() < 0.15:
        items += " replace Guard by contract;"
    if r.random() < 0.7:
        items += " order deployed;"
    elif r.random() < 0.3:
        items += " late Reader by 5ms;"
    for asked in r.sample(
        [f"{t} != {v}" for t in ("ou" if maker.guarded else "o") for v in range(1, 7)],
        r.randint(2, 3),
    ):
        more = f" || {maker.condition(reads)}" if r.random() < 0.15 else ""
        items += f" always {asked}{more};"
    if maker.guarded and r.random() < 0.3 and "Guard by" not in items:
        items += f" never mode(Guard) == Mode.SC && {maker.atom(reads)};"
    if r.random() < 0.25:
        items += f" {maker.condition(reads)} leadsto o == {r.randint(0, 6)} within 5ms;"
    return items


def _dense(maker: _Maker) -> str:
    if not maker.floats:
        return ""
    values = {0.25, 0.75, 1.5, 3.25, *FLOATS}
    for c in FLOATS:
        values |= {math.nextafter(c, -1.0), math.nextafter(c, 9.0)}
    inside = sorted(v for v in values if 0.0 <= v <= 4.0)
    return f"guarantees a.f in {{ {', '.join(map(repr, inside))} }};"
