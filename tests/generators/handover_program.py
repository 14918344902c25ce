"""The cart between two walls that are moved: two boxes that overlap, and a node that changes them.

Purpose: texts whose `enters` is kept by the node, or is not.
Non-goals: the proof of one wall (`corridor_program.py`).
"""

from __future__ import annotations

from generators.corridor_program import program

FOLLOWER = """const BOXES: Box[2] = [{ low: LOW, high: HIGH }, { low: 2.0, high: 10.0 }];
fun May(b: Box, m: Motion): bool {
  return Fits({ room: m.x - b.low, toward: -m.v }, 0.05)
      && Fits({ room: b.high - m.x, toward: m.v }, 0.05);
}
node Estimator period 10ms {
  subscribes motion;
  publishes left, right, along, box;
  var at: int in [0, 1];
  var might: bool;
  step {
    let other = BOXES[1 - at];
    let asked = choose bool;
    if asked && May(other, motion) {
      at = 1 - at;
    }
    let b = BOXES[at];
    publish box = b;
    publish left = { room: motion.x - b.low, toward: -motion.v };
    publish right = { room: b.high - motion.x, toward: motion.v };
    publish along = {
      low: clamp(motion.x - b.low, -NEAR, NEAR), high: clamp(b.high - motion.x, -NEAR, NEAR),
      w: motion.v
    };
  }
}

"""
GUARD = "asked && May(other, motion)"
CHANGES = {
    "none": [(GUARD, "asked")],
    "of the old box": [(GUARD, "asked && May(BOXES[at], motion)")],
    "one step old": [
        (GUARD, "asked && might"),
        ("let b =", "might = May(other, motion);\n    let b ="),
    ],
    "for less time": [
        ("}, 0.05)\n      && Fits({ room: b.high", "}, 0.01)\n      && Fits({ room: b.high")
    ],
    "of one wall": [
        (GUARD, "asked && Fits({ room: other.high - motion.x, toward: motion.v }, 0.05)")
    ],
    "not every time": [(GUARD, "asked && (May(other, motion) || motion.x > 3.0)")],
    "of another state": [(GUARD, "asked && May(other, { x: motion.x, v: 0.0 })")],
    "another box is published": [("publish box = b;", "publish box = asked ? BOXES[0] : b;")],
    "left out at times": [("publish box = b;", "if asked { publish box = b; }")],
    "shown later": [
        ("publish left =", "if !asked { publish left ="),
        ("toward: -motion.v };\n    publish right", "toward: -motion.v }; }\n    publish right"),
    ],
    "with a fail-safe value": [("  var at:", "  failsafe box = BOXES[1];\n  var at:")],
    "not at the start": [("var at: int in [0, 1];", "var at: int in [0, 1] = 1;")],
}
"""How a node may fail to keep its guard."""


IN = """fun In(l: Wall, r: Wall): bool {
  return Fits(l, 0.05) && Fits(r, 0.05) && l.room < 50.0 && r.room < 50.0;
}
"""
OF_BOX = "({ room: m.x - b.low, toward: -m.v }, { room: b.high - m.x, toward: m.v });"
GUARDS = [
    ("Fits(l, 0.05)", "Fits(l, 0.0)", [False, True], "outside R(H)"),
    ("Fits(l, 0.05) && ", "", [False, True], "outside the grid"),
    ("l.room < 50.0", "true", [False, True], "outside the grid"),
    ("r.room < 50.0", "r.room < 70.0", [True, False], "outside the grid"),
    ("Fits(r, 0.05)", "(Fits(r, 0.05) || r.toward < -2.3)", [True, False], "the grid"),
    ("Fits(r, 0.05)", "r.room > 0.5 && abs(r.toward) < 2.0", [True, False], "outside R(H)"),
]
"""What of `IN` is replaced by what, in which views it then shows that the state lies in R(H), and
where it does not in the others."""


def of_walls(inside: str = IN, *changes: tuple[str, str]) -> str:
    """The program whose boxes are entered where `In` holds of what is published of both walls."""
    text = handover(*changes, enters="In(left, right)")
    begin, end = text.index("  return Fits({ room: m.x"), text.index("node Estimator")
    text = text[:begin] + "  return In" + OF_BOX + "\n}\n" + text[end:]
    return text.replace("fun May", inside + "fun May")


def handover(*changes: tuple[str, str], enters: str = "May(box, motion)") -> str:
    """The program, with changes to the node that hands over."""
    node = FOLLOWER
    for old, new in changes:
        assert old in node, old
        node = node.replace(old, new, 1)
    text = program()
    begin, end = text.index("node Estimator"), text.index("node Fast")
    text = text[:begin] + node + text[end:]
    text = text.replace("d.truth.x - LOW", "d.truth.x - box.low")
    text = text.replace("HIGH - d.truth.x", "box.high - d.truth.x")
    text = text.replace(
        "topic push:",
        "type Box = { low: float, high: float };\n"
        "topic box: Box = { low: LOW, high: HIGH };\ntopic push:",
    )
    text = text.replace("acts within 0ms;", f"acts within 0ms;\n    enters {enters};")
    text = text.replace("push = along.w >= 0.0 ? U : -U", "push = choose { U, -U, 0.0 }")
    return text.replace(
        "always abs(d.truth.x - 1.0) <= 4.0;",
        "always d.truth.x >= box.low && d.truth.x <= box.high;",
    )
