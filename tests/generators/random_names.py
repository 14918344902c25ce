"""Names of a random program.

Purpose: mostly plain names, now and then one that means something in C or in the generated code,
so that naming mistakes of the back end show.
Non-goals: scopes (`scope.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from generators.hypothesis_choices import Chooser

PLAIN = {
    "type": ("Motion", "Pose", "Color", "Reading", "Plan", "Gear"),
    "field": ("x", "v", "id", "ok", "pos", "tag", "level", "rate"),
    "member": ("Red", "Green", "Low", "High", "On", "Off", "Idle"),
    "value": ("a", "b", "c", "d", "e", "n", "t", "u", "w", "sum", "gain", "best", "next_x", "err"),
    "constant": ("LIMIT", "GAIN", "TABLE", "ZERO", "WALL", "BASE"),
    "function": ("pick_one", "shape", "score", "blend", "walk", "gate"),
    "topic": ("motion", "goal", "accel", "alarm", "plan", "level", "cmd", "beat"),
    "node": ("Fast", "Careful", "Planner", "Filter", "Monitor", "Helper"),
    "plant": ("Cart", "Tank", "Arm", "Field"),
    "module": ("Safe", "Guard", "Shield"),
    "instance": ("c", "tank", "left", "right", "arm"),
}
_NASTY = """
s m k h i a v v_s v_int8_t flags published answer fault status first began result done index div
mod add sub mul abs_2 neg narrow int8_t uint8_t int64_t double char long short register volatile
struct union static inline switch default case goto void signed unsigned sizeof typedef const_2
NULL NAN INFINITY INT64_MAX errno main y0 j1 gamma exp2 fabs fmod round memcpy offsetof isnan
assert_2 items len at pad_ pad header components modules properties stamps topics state_2 init
program out_0 has_0 soter_add soter_header SOTER_OK x2 k1 substep time_2 dt_2 double_ int_ float_t
double_t size_t bool_ true_ self None class def lambda within measured hold until always truth
_Atomic __LINE__ m___LINE__ __func__ class template this new linux
Mode_2 property_0 input_0 constant default_2 initial record value
"""
NASTY = tuple(_NASTY.split())


class Namer:
    """Hands out names: `fresh` ones are unique in the whole program, others in their own scope."""

    def __init__(self, choose: Chooser, nasty_percent: int) -> None:
        self.choose = choose
        self.nasty_percent = nasty_percent
        self._taken: set[str] = set()

    def base(self, kind: str) -> str:
        """A name, perhaps used already."""
        if self.choose.chance(self.nasty_percent):
            return self.choose.pick(NASTY)
        return self.choose.pick(PLAIN[kind])

    def outside(self, kind: str, taken: set[str]) -> str:
        """A name that is not among those taken."""
        base = self.base(kind)
        name, n = base, 2
        while name in taken:
            name, n = f"{base}{n}", n + 1
        return name

    def fresh(self, kind: str) -> str:
        """A name of a declaration."""
        name = self.outside(kind, self._taken)
        self._taken.add(name)
        return name

    def different(self, kind: str, count: int) -> list[str]:
        """So many different names."""
        names: list[str] = []
        for _ in range(count):
            names.append(self.outside(kind, set(names)))
        return names
