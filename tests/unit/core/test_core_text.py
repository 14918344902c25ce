"""What each statement, expression and type is lowered to, as text, beside the piece of Soter.

`tests/golden/core/lowering.txt` has the cases: `[step]` is a step of the node `N` below,
`[program]` a whole program. `--update-golden` writes what stands below `[core]`.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import golden as golden_files
from soter.core.core_text import core_text

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.core import CoreSystem
    from soter.language.model.system import System

    Lowered = Callable[[str], tuple[System, CoreSystem]]

CASES = golden_files.FOLDER / "core" / "lowering.txt"
LINES = r"((?:(?!\[).*\n)*)"
CASE = re.compile(rf"^\[(step|program)\] (.+)\n{LINES}\[core\]\n{LINES}", re.MULTILINE)
AROUND = """
type Mood = enum {{ Calm, Eager }};
type Vec = {{ x: float, y: float }};
type Spot = {{ p: Vec, turn: int in [0, 3] }};
const LATE: duration = 30ms;
param FAST: bool = true;
param GAIN: float = 2.5;
fun twice(v: float): float {{ return v + v; }}
fun bent(v: float): float {{ if v > 0.0 {{ return v; }} let w = -v; return w * 2.0; }}
fun first(vs: float[3]): float {{ for v in vs {{ if v > 0.0 {{ return v; }} }} return 0.0; }}
fun some(vs: float[<=4]): bool {{ for v in vs {{ if v > 0.0 {{ return true; }} }} return false; }}
fun next_of(n: int): int {{ return n + 1; }}
topic z: float;
input topic seen: float in [0.0, 1.0];
topic alarm: int;
node N period 20ms {{
  subscribes seen;
  publishes z, alarm[<=2];
  var n: int; var m: int; var x: float; var y: float; var on: bool; var mood: Mood; var spot: Spot;
  var a: float[3]; var xs: float[<=4]; var small: int in [0, 3];
  step {{ {} }}
}}
system S {{ node N; input seen every 1s; until 1s; }}
"""


def of_step(text: str) -> str:
    """The functions and the step in the text of a system; the rest is always the same."""
    parts = text.split("\n\n")
    functions = [p for p in parts if p.startswith("function")]
    (node,) = [p for p in parts if p.startswith("node")]
    lines = node.splitlines()
    ends = next(i for i, line in enumerate(lines) if line.startswith(("  reads", "  writes")))
    step = [line[4:] for line in lines[lines.index("  step") + 1 : ends]]
    return "\n\n".join([*functions, "\n".join(step)]) + "\n"


def test_every_piece_of_a_program_is_lowered_as_it_was(
    lowered: Lowered, golden: Callable[[str, str], None]
) -> None:
    cases = CASES.read_text(encoding="utf-8")

    def with_core(case: re.Match[str]) -> str:
        kind, name, program, _ = case.groups()
        text = core_text(*lowered(AROUND.format(program) if kind == "step" else program))
        core = of_step(text) if kind == "step" else text
        return f"[{kind}] {name}\n{program}[core]\n{core}\n"

    assert len(CASE.findall(cases)) == cases.count("[core]")
    golden("core/lowering.txt", CASE.sub(with_core, cases))
