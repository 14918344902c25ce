"""Fleets, twice: as an array of instances with parameters of their own, and written out.

Purpose: random values for every place where a parameter may stand, and two texts that must mean the
same: one with `param`, `set`, sub-systems, loops and wires, one with a declaration and a number for
each robot and none of these.
Non-goals: disturbances and draws, whose streams are named after what draws.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from random import Random

PARAMETERS = {
    "K": ("float", "1.0"),
    "START": ("float", "0.0"),
    "LIMIT": ("float", "4.0"),
    "STEP": ("duration", "10ms"),
    "COUNT": ("int in [0, 5]", "2"),
    "ON": ("bool", "true"),
}

ROBOT = """
topic pose@ : float in [-LIMIT, LIMIT] = START max_age 5 * STEP;
topic act@ : float in [-1.0, 1.0] = START / 9.0;
input topic near@ : float;
topic warned@ : int;
fun law@(e: float): float { return side@(clamp(K * e, -1.0, 1.0)); }
fun side@(e: float): float { return ON ? e : -e; }
fun plain@(e: float): float { return 0.5 * e; }
plant P@ period 10ms {
  reads act@;
  drives pose@ = clamp(x, -LIMIT, LIMIT);
  state x: float = START;
  let pull = K * act@;
  der x = pull + plain@(0.1);
  integrate euler substeps COUNT + 1;
}
node Fast@ period STEP {
  subscribes pose@, near@;
  publishes act@;
  var n: int = COUNT;
  step {
    n = n < 40 ? n + 1 : COUNT;
    publish act@ = law@(near@ - pose@) + (n == 7 ? 2.0 : 0.0);
  }
}
node Safe@ period 2 * STEP {
  subscribes pose@;
  publishes act@;
  step { publish act@ = -plain@(clamp(pose@, -K, K) / K); }
}
rta M@ {
  ac Fast@;
  sc Safe@;
  period 2 * STEP;
  safe abs(pose@) < LIMIT;
  ttf abs(pose@) > LIMIT / 2.0 + law@(0.01);
  safer abs(pose@) < LIMIT / 3.0;
  clean COUNT + 1;
}
node Watch@ period 30ms phase STEP / 2 {
  subscribes near@, pose@;
  publishes warned@;
  failsafe warned@ = COUNT - 7;
  assumes near@ < LIMIT + 9.0;
  var seen: int;
  step {
    seen = seen + (mode(M@) == Mode.AC ? 1 : COUNT);
    assert seen < 60 + 10 * COUNT;
    publish warned@ = seen;
  }
}
"""
PROPERTY = "abs(pose@) < K * LIMIT || warned@ > COUNT"


@dataclass(frozen=True)
class Fleet:
    """One fleet: the text with an array, and the text without."""

    array: str
    written_out: str


def fleet(seed: int) -> Fleet:
    """Fleet number `seed`."""
    random = Random(seed)  # noqa: S311 - the same programs every time are wanted
    count = random.randint(1, 4)
    shift = random.randint(0, count - 1)
    everywhere = _some(random, 0.4)
    own = [_some(random, 0.5) for _ in range(count)]
    by_path = [_some(random, 0.2) for _ in range(count)]
    return Fleet(
        _array(count, shift, everywhere, own, by_path),
        _written_out(
            count, shift, everywhere, [{**b, **o} for o, b in zip(own, by_path, strict=True)]
        ),
    )


def _some(random: Random, share: float) -> dict[str, str]:
    """Values of some of the parameters."""
    values = {
        "K": random.choice(("0.25", "1.5", "3.0")),
        "START": random.choice(("-1.0", "0.5", "2.0")),
        "LIMIT": random.choice(("3.0", "5.5", "9.0")),
        "STEP": random.choice(("5ms", "20ms", "30ms")),
        "COUNT": random.choice(("0", "1", "4")),
        "ON": random.choice(("true", "false")),
    }
    return {n: v for n, v in values.items() if random.random() < share}


def _array(
    count: int,
    shift: int,
    everywhere: dict[str, str],
    own: list[dict[str, str]],
    by_path: list[dict[str, str]],
) -> str:
    """Elements with the same settings in one loop; others are declared one by one."""
    lines = ["soter 1;", *(f"param {n}: {t} = {v};" for n, (t, v) in PARAMETERS.items())]
    lines += [ROBOT.replace("@", ""), "system Robot {", "  p: P;", "  module M;", "  node Watch;"]
    lines += [f"  always {PROPERTY.replace('@', '')};", "}", "system Fleet {"]
    at = 0
    while at < count:
        end = at + 1
        while end < count and own[end] == own[at]:
            end += 1
        wire = f"near = r[(i + {shift}) % {count}].pose"
        inside = ", ".join([wire, *(f"set {n} = {v}" for n, v in own[at].items())])
        lines.append(f"  for i in {at}..{end} {{ r[i]: Robot {{ {inside} }}; }}")
        at = end
    lines += [
        f"  set r[{i}].{n} = {v};"
        for i, s in enumerate(by_path)
        for n, v in s.items()
        if n not in own[i]
    ]
    lines += [f"  set {n} = {v};" for n, v in everywhere.items()]
    return "\n".join([*lines, "}", ""])


def _written_out(
    count: int, shift: int, everywhere: dict[str, str], own: list[dict[str, str]]
) -> str:
    lines, items, properties = ["soter 1;"], [], []
    for i in range(count):
        values = {**{n: v for n, (_, v) in PARAMETERS.items()}, **everywhere, **own[i]}
        text = re.sub(r"input topic near@.*\n", "", ROBOT)
        text = text.replace("near@", f"pose_{(i + shift) % count}").replace("@", f"_{i}")
        text = text.replace(f"subscribes pose_{i}, pose_{i};", f"subscribes pose_{i};")
        condition = PROPERTY.replace("@", f"_{i}")
        for name, value in values.items():
            text = re.sub(rf"\b{name}\b", value, text)
            condition = re.sub(rf"\b{name}\b", value, condition)
        lines.append(text)
        items += [f"  p_{i}: P_{i};", f"  module M_{i};", f"  node Watch_{i};"]
        properties.append(f"  always {condition};")
    return "\n".join([*lines, "system Fleet {", *items, *properties, "}", ""])
