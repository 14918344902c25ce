"""Checks whose constants are a little smaller than what the program declares.

    python bench/tubes/smaller_constants.py

Purpose: `KINDS`, each a change of the printed constants of a check: errors E, the delay L of a read
or of a switch, the horizon H, disturbances D and commands U; `seen`, whether fall-back runs of the
true module then leave the tube, or the constants differ from those of the program.
Non-goals: making the constants (`tube_check.py`).
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from bench.tubes.small_rests import drawn  # noqa: E402
from bench.tubes.tube_module import Loop, Module, module_of  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Callable

BY = 0.98
KINDS = {
    "E": ("ERRORS", 0), "L, reads": ("LATE_READ", 0), "L, switches": ("JITTER", 0),
    "H": ("WINDOW", 0), "D": ("DISTURBED", 0), "D, before SC acts": ("ANY", 0),
}  # fmt: skip
"""Constants, by what the theorem calls them."""
HOLDS = 20_000


def smaller(name: str, by: float = BY) -> Callable[[str], str]:
    """A check's text in which every number of a constant is a part of itself."""

    def changed(text: str) -> str:
        found = re.search(rf"const {name}: \w+ = (.*);", text)
        assert found is not None, name
        number = re.compile(r"(?<![\w.])\d+\.\d+(?:e-?\d+)?")
        value = number.sub(lambda m: repr(float(m.group()) * by), found.group(1))
        return text[: found.start(1)] + value + text[found.end(1) :]

    return changed


def seen(name: str, text: str, kind: str, holds: int = HOLDS) -> tuple[str, Module | None]:
    """How a test sees that a constant is smaller: "contained", "same" where it is 0, "" by none."""
    true = module_of(name, text, claimed=False)
    source = true.check.in_flight(true.claims.ways)
    changed = smaller(KINDS[kind][0])
    if changed(source) == source:
        return "same", None
    module = module_of(name, text, changed, claimed=False)
    told = Loop(module, "-O1").run("contain", 1, holds, 0)
    return "outside" if told.outside else "", module


def main() -> int:
    """Prints a line a variant; 3 where one is not seen."""
    lost = 0
    for kind in KINDS:
        found = []
        for number in range(2000):
            how, _ = seen("small.soter", drawn(number), kind)
            if how != "same":
                found.append(how)
                lost += not how
                print(f"{kind:20} program {number:3} {how or 'NOT SEEN'}", flush=True)
            if len(found) == 7:
                break
    return 3 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
