"""Random programs whose parts share nothing but time.

Purpose: what `small_test_programs.py` makes too rarely: a few nodes that publish at moments of
their own, late or skewed, beside clocks that only let time pass, under properties that depend on
which moments are observed. They find two reductions that were believed and wrong: parts that ignore
the time they share, and ample sets that add observations.
Non-goals: anything else of the language.
"""

from __future__ import annotations

from random import Random

TICK = 10
"""Milliseconds."""


class Maker:
    """Makes one program; every choice comes from `random`."""

    def __init__(self, random: Random) -> None:
        self.random = random

    def _pick(self, *options: str) -> str:
        return self.random.choice(options)

    def _times(self, *counts: int) -> int:
        return self.random.choice(counts) * TICK

    def run(self) -> str:
        """The program's text."""
        parts = [self._group(), self._clock()]
        if self.random.random() < 0.4:
            parts.append(self._module())
        items = "".join(item for _, item, _ in parts)
        faults = "".join(fault for _, _, fault in parts)
        skew = f"skew {self._times(1, 1, 2)}ms; " if self.random.random() < 0.25 else ""
        horizon = self._times(3, 4, 6)
        module = "rta M" in parts[-1][0]
        return (
            "soter 1;\n"
            + "".join(text for text, _, _ in parts)
            + f"system S {{ {items}}}\ntest T {{ system S; horizon {horizon}ms; {skew}{faults}\n"
            f"  {self._property(horizon, module=module)} always tick || !tick; }}\n"
        )

    def _group(self) -> tuple[str, str, str]:
        """Two nodes: one publishes when it steps, the other says whether it saw that."""
        phase = self._times(0, 1, 1)
        late = self._times(1, 2, 3)
        told = self._pick("x ? 1 : 2", "x ? 1 : 0", "choose { 1, 2 }")
        text = (
            "topic x: bool;\ntopic y: int in [0, 2];\n"
            f"node A period {self._times(2, 3, 4)}ms phase {min(phase, TICK)}ms {{ publishes x; "
            f"step {{ publish x = {self._pick('true', 'true', 'choose bool')}; }} }}\n"
            f"node B period {self._times(2, 4, 4)}ms {{ subscribes x; publishes y; "
            f"step {{ publish y = {told}; }} }}\n"
        )
        fault = self._pick("", f"late B by {late}ms; ", f"late B by {late}ms; ", "skip A; ")
        return text, "node A; node B; ", fault

    def _clock(self) -> tuple[str, str, str]:
        text = (
            f"topic tick: bool;\nplant Clock period {self._times(1, 1, 2, 3)}ms {{ "
            "drives tick = s; state s: bool; next s = !s; }\n"
        )
        return text, "clock: Clock; ", ""

    def _module(self) -> tuple[str, str, str]:
        """A module that AC never leaves, or leaves at once; its DM or SC may be late."""
        period = self._times(2, 2, 3)
        text = (
            "topic u: bool;\ntopic go: bool = true;\n"
            f"node Ac period {TICK}ms {{ publishes u; step {{ publish u = true; }} }}\n"
            f"node Sc period {self._times(1, 2)}ms {{ publishes u; "
            "step { publish u = false; } }\n"
            f"rta M {{ ac Ac; sc Sc; period {period}ms; safe go || !go; "
            f"ttf {self._pick('!go', 'go')}; safer go; }}\n"
            f"plant K period {period}ms {{ drives go = s; state s: bool = true; next s = s; }}\n"
        )
        who = self._pick("M.dm", "M.dm", "M.Sc")
        return text, "module M; k: K; ", f"late {who} by {self._times(1, 3, 4)}ms; "

    def _property(self, horizon: int, *, module: bool) -> str:
        seen = self._pick("x && y == 0", "!x && y != 0", "x && y == 1", "y == 2", "x")
        owed = self._pick(f"({seen})", f"({seen}) || y == 2", f"({seen}) || y == 1")
        after = self.random.choice((15, 20, 25)) / 1000
        ways = [
            f"eventually {owed} within {horizon}ms;",
            f"eventually {owed} within {horizon - TICK}ms;",
            f"{self._pick('x', 'y != 0')} leadsto {owed} within {TICK}ms;",
            f"always !({seen}) || time < {after};",
        ]
        if module:
            ways += ["always invariant(M);", "always invariants;"]
        return self.random.choice(ways)


def program_apart(seed: int) -> str:
    """The text of program number `seed`."""
    return Maker(Random(seed)).run()  # noqa: S311 - the same programs every time are wanted
