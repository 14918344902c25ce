"""Random functions over ints, bools and small arrays: branches, loops, early returns, faults.

Purpose: the text of functions whose values the evaluator gives, for whoever reads code otherwise.
Non-goals: floats, records, calls; functions that make sense.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from random import Random


class FunctionMaker:
    """Draws functions of one program; their names are told apart."""

    def __init__(self, dice: Random) -> None:
        self.dice, self.made = dice, 0

    def function(self) -> str:
        """A function of `a: int in [-3, 6], b: int, c: bool`, with an array `v` of three ints."""
        name, seen = self._name("f"), ["a", "b", "x"]
        body = " ".join(self._statements(2, 4, seen))
        return (
            f"fun {name}(a: int in [-3, 6], b: int, c: bool): int "
            f"{{ var x = a; var v = [a, b, 3]; {body} return {self._int(2, seen)}; }}"
        )

    def _name(self, kind: str) -> str:
        self.made += 1
        return f"{kind}{self.made}"

    def _int(self, depth: int, seen: list[str]) -> str:
        dice = self.dice
        if depth == 0 or dice.random() < 0.3:
            return dice.choice([*seen, str(dice.randint(-2, 5))])
        a, b = self._int(depth - 1, seen), self._int(depth - 1, seen)
        return dice.choice(
            [
                f"({a} {dice.choice('+-*')} {b})",
                f"({a} {dice.choice('+-*')} {b})",
                f"({a} {dice.choice('/%')} {dice.choice(['2', '3', '-1', '-2'])})",
                f"{dice.choice(['min', 'max'])}({a}, {b})",
                f"abs({a})",
                f"({self._bool(depth - 1, seen)} ? {a} : {b})",
                f"v[{dice.choice(seen)}]",
                f"(-{a})",
            ]
        )

    def _bool(self, depth: int, seen: list[str]) -> str:
        dice = self.dice
        if depth == 0:
            return dice.choice(["c", "true", f"{dice.choice(seen)} < {dice.randint(-1, 4)}"])
        a, b = self._bool(depth - 1, seen), self._bool(depth - 1, seen)
        compared = dice.choice(["<", "<=", ">", ">=", "==", "!="])
        ints = f"({self._int(depth - 1, seen)} {compared} {self._int(depth - 1, seen)})"
        return dice.choice([f"({a} && {b})", f"({a} || {b})", f"!({a})", ints, ints])

    def _statements(self, depth: int, count: int, outside: list[str]) -> list[str]:
        seen, made = list(outside), []
        for _ in range(count):
            kind = self.dice.randrange(8 if depth else 4)
            if kind == 0:
                name = self._name("l")
                made.append(f"let {name} = {self._int(2, seen)};")
                seen.append(name)
            elif kind < 3:
                made.append(f"x = {self._int(2, seen)};")
            elif kind == 3:
                made.append(f"v[{self.dice.choice(seen)}] = {self._int(2, seen)};")
            elif kind < 6:
                then = " ".join(self._statements(depth - 1, 2, seen))
                leaves = f"return {self._int(1, seen)};" if kind == 4 else ""
                other = " ".join(self._statements(depth - 1, 1, seen))
                made.append(f"if {self._bool(2, seen)} {{ {then} {leaves} }} else {{ {other} }}")
            else:
                name = self._name("k")
                rounds = f"0..{self.dice.randint(1, 3)}" if kind == 6 else "v"
                inner = " ".join(self._statements(depth - 1, 2, [*seen, name]))
                made.append(f"for {name} in {rounds} {{ {inner} }}")
        return made
