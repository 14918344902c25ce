"""The programs whose certificates are forged, and edits of them.

Purpose: programs whose proofs take seconds, by families of proofs, with what stands in a forgery
in place of their texts.
Non-goals: forging (`forgeries.py`).
"""

from __future__ import annotations

from bench.recheck.small_modules import FORCED, SYSTEM
from bench.recheck.small_modules import PROGRAMS as SMALL

from unit.certificate.test_claims_without_tables import PROGRAMS as IN_PART
from unit.certificate.test_induction_values import ARRAYS
from unit.certificate.test_nodes_that_take_time import SAID, TAKES
from unit.certificate.test_recheck_induction import PLANNER
from unit.verify.test_composition import COUPLED

OTHERS = SYSTEM + FORCED + "system T { set GAIN = 8.9; p: P; module M; until 10s; }\n"
OUTSIDE = (
    "system Vehicle deploys S {\n  external topic x every 5ms delayed 1ms measured x within 0.02;\n"
    "  external topic u;\n  module M;\n}\n"
)
WRITTEN = SMALL["written"].replace(SYSTEM, OTHERS)
COMPUTED = SMALL["computed"].replace(SYSTEM, OTHERS)
SHIELDED = (
    SMALL["computed"]
    .replace("safe abs", "shield 4;\n  safe abs")
    .replace("Fast period 50ms", "Fast period 10ms")
)
UNTOLD = ARRAYS.replace("var last:", "var many: bool[65];\n  var last:").replace(
    "way.count = ", "many[last] = true;\n way.count = "
)
PROGRAMS: dict[str, tuple[str, str]] = {
    "written": ("grid", WRITTEN),
    "computed": ("grid", COMPUTED),
    "flying": ("grid", SMALL["flying"]),
    "shielded": ("grid", SHIELDED),
    "in part": ("grid", IN_PART["a grid"]),
    "induction": ("induction", PLANNER + FORCED.replace("p: P; module M", "module Planner")
                  .replace("force M", "node Follower; force Planner")),
    "arrays": ("induction", ARRAYS),
    "untold": ("induction", UNTOLD),
    "inherited": ("inherited", SMALL["computed"] + OUTSIDE),
    "taking": ("inherited", SMALL["flying"].replace(*SAID).replace(*TAKES)),
    "composed": ("composed", COUPLED),
}  # fmt: skip
"""By name the family, and the text."""
OPEN = ("in part", "untold")
"""What is not proved, or proved and not re-checked."""
EDITS: tuple[tuple[str, str, str], ...] = (
    ("less gain", r"GAIN: float = 2.0", "GAIN: float = 1.5"),
    ("more noise", r"within 0\.02", "within 0.03"),
    ("nearer", r"abs\(x\) < 1\.0", "abs(x) < 0.95"),
    ("weaker", r"clamp\(-GAIN \* x", "clamp(0.5 * GAIN * x"),
    ("wind", r"disturbance (\w+): float in \[-[\d.]+, [\d.]+\]",
     r"disturbance \1: float in [-1.5, 1.5]"),
    ("later", r"response dm \w+, sc \w+", "response dm 9ms, sc 9ms"),
    ("larger sets", r"float in \[-1\.0, 1\.0\] = 0\.0", "float in [-1.6, 1.6] = 0.0"),
    ("softer", r"clamp\(-2\.0 \*", "clamp(-1.9 *"),
    ("turned", r"clamp\(-2\.0 \*", "clamp(2.0 *"),
    ("wider", r"WALL: float = 1\.5", "WALL: float = 1.4"),
    ("far out", r"WALL: float = 1\.5", "WALL: float = 0.5"),
    ("sooner", r"seconds\(30ms\)", "seconds(40ms)"),
    ("at once", r"if age\(candidate\) > seconds\(30ms\) \{(.*?)\}", r"\1"),
    ("lax", r"safer good\(candidate\)", "safer true"),
    ("guarantee", r"pull <= 0\.5", "pull <= 0.45"),
    ("no guarantee", r" && push <= 0\.5 && push >= -0\.5", ""),
)  # fmt: skip
"""Of programs: a name, what is replaced, and by what; right ones first."""
HIDDEN: tuple[tuple[str, str, str], ...] = (
    ("narrow", r"topic (x|y): float( in \[[^\]]*\])? max_age",
     r"topic \1: float in [-0.3, 0.3] max_age"),
    ("dial", r"topic (u|accel): float", r"topic dial: float in [-1.0, 1.0];\ntopic \1: float"),
    ("stiff", r"  der p = ", "  state z: float = 0.01;\n  der z = -1000.0 * z;\n  der p = "),
    ("jitter", r"(node (?:Slow|SlowX|Careful|Hold) period \w+ \{)", r"\1\n  jitter 9ms;"),
    ("forced", r"module (M|SafeCart|KeepX|Planner);", r"module \1; force \1 ac;"),
    ("never", r"recover within \w+;", "recover never;"),
    ("set", r"system S default \{", "system S default { set GAIN = 8.9;"),
    ("phase", r"(node (?:Slow|SlowX|Careful|Hold) period )(\w+) \{", r"\1\2 phase 9ms {"),
)  # fmt: skip
"""What a re-checker could overlook."""
DRIVEN = {"dial": (r"(drives (?:x|motion) = [^;]*;)", r"\1 drives dial = 10.0 * STATE;")}
FACTS: tuple[tuple[str, str, str], ...] = (
    ("takes longer", r"takes \[1us, \d+us\]", "takes [1us, 9ms]"),
    ("takes a little longer", r"takes \[1us, \d+us\]", "takes [1us, 1100us]"),
    ("takes less", r"takes \[1us, \d+us\]", "takes [1us, 500us]"),
    ("takes what nobody said", r"(node Driver period 5ms \{)", r"\1 takes [1us, 4ms];"),
    ("slower node", r"node Driver period 5ms", "node Driver period 25ms"),
    ("older topic", r"topic force: float", "topic force: float max_age 500ms"),
    ("another world", r"p: world\.truth\.q", "p: 0.5 * world.truth.q"),
    ("more cells of commands", r"shield 4", "shield 5"),
    ("fewer cells of commands", r"shield 4", "shield 2"),
    ("no shield", r"shield 4;", ""),
    ("toward sc", r"shield 4;", "shield 4 toward sc;"),
    ("a stronger command", r"u: float in \[-1\.0, 1\.0\]", "u: float in [-2.0, 2.0]"),
)
"""Edits of programs about nodes that take time and shields."""
