"""Small modules whose proofs are checked in a fraction of a second, and edits of certificates.

Purpose: the programs of `overstated.py`, and every edit of one of their certificates: of
the program, of parameters, modules, systems, times, claims, inputs, assumptions and tables.
Non-goals: judging what a re-checker makes of them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TOPICS = """topic x: float{set} max_age {age}ms;
topic u: float in [-1.0, 1.0] = 0.0;
"""
PLANT = """plant P period {sensor}ms {{
  reads u;
  drives x = p;
  state p: float in [-0.1, 0.1];
  disturbance w: float in [-0.1, 0.1];
  der p = u + w;
  measured x within 0.02;
}}
"""
NODES = """node Fast period 50ms {{
  subscribes x;
  publishes u;
  step {{ publish u = x > 0.0 ? 1.0 : -1.0; }}
}}
node Slow period 50ms{phase} {{
  subscribes x;
  publishes u;
  step {{ publish u = clamp(-GAIN * x, -1.0, 1.0); }}
}}
"""
MODULE = """rta M {{
  ac Fast;
  sc Slow;
  period 100ms;
  safe abs(x) < 1.0;
{predicates}  verify {{
    grid x in [-1.25, 1.25] / {cells};
{more}  }}
}}
"""
WRITTEN = "  ttf abs(x) > 0.5;\n  safer abs(x) < 0.4;\n"
TIMES = (
    "    late dm 2ms, sc 1ms;\n    response dm 1ms, sc 1ms;\n    acts within 1ms;\n"
    "    recover within 30s;\n"
)
GAIN = "param GAIN: float = 2.0 in [0.5, 9.0];\n"
SYSTEM = "system S default { p: P; module M; until 10s; }\n"
FORCED = "system Bare { p: P; module M; force M ac; until 10s; }\n"


def _program(
    *,
    predicates: str = WRITTEN,
    more: str = TIMES,
    phase: str = "",
    before: str = "",
    systems: str = SYSTEM,
    age: int = 20,
    sensor: int = 10,
    cells: int = 50,
    bounds: str = "",
) -> str:
    parts = [
        "soter 1;\n",
        GAIN,
        TOPICS.format(age=age, set=bounds),
        PLANT.format(sensor=sensor),
        before,
        NODES.format(phase=phase),
        MODULE.format(predicates=predicates, more=more, cells=cells),
        systems,
    ]
    return "".join(parts)


FLYING = """topic raw: float max_age 20ms;
topic force: float in [-1.0, 1.0] = 0.0;
plant World period 10ms {
  reads force;
  drives raw = q;
  state q: float in [-0.1, 0.1];
  der q = force;
}
node Estimate period 10ms { subscribes raw; publishes x; step { publish x = raw; } }
node Driver period 5ms { subscribes u; publishes force; step { publish force = u; } }
"""
ABSTRACT = (
    "    abstracts world by p: P = { p: world.truth.q };\n"
    "    late dm 2ms, sc 1ms, Estimate 1ms, Driver 0ms;\n"
    "    response dm 1ms, sc 1ms, Estimate 1ms, Driver 1ms;\n    acts within 1ms;\n"
)
STEPS = """soter 1;
param GAIN: float = 0.5 in [0.1, 0.9];
topic x: float max_age 20ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant P period 50ms {
  reads u;
  drives x = p;
  state p: float in [-0.1, 0.1];
  disturbance w: float in [-0.01, 0.01];
  next p = p + 0.1 * u + w;
  measured x within 0.01;
}
"""
PROGRAMS = {
    "written": _program(),
    "computed": _program(predicates="", cells=80),
    "assumed": _program(more=""),
    "late phase": _program(phase=" phase 10ms", systems=SYSTEM + FORCED, bounds=" in [-9.0, 9.0]"),
    "silent": _program(more=TIMES + "    dropout 20ms;\n", age=30),
    "flying": _program(
        more=ABSTRACT,
        before=FLYING,
        systems="system S default { world: World; node Estimate; module M; node Driver; }\n",
        age=30,
    ),
    "steps": STEPS
    + NODES.format(phase="")
    + MODULE.format(predicates=WRITTEN, more="", cells=50)
    + SYSTEM,
}


# ---------------------------------------------------------------- edits


@dataclass(frozen=True)
class Edit:
    """`wrong`: what is certain of it: True: it overstates, False: it does not, None: to be judged.

    `manifest` changes an entry, `text` is another program, `adapt`: the manifest follows it.
    """

    kind: str
    name: str
    wrong: bool | None
    manifest: Callable[[dict[str, Any]], None] | None = None
    text: str | None = None
    tables: Callable[[dict[str, bytes], dict[str, Any]], None] | None = None
    values: dict[str, str] = field(default_factory=dict)


def _put(value: object, *path: str | int) -> Callable[[dict[str, Any]], None]:
    """Another value somewhere in the first module of a manifest."""

    def change(manifest: dict[str, Any]) -> None:
        at: Any = manifest["modules"][0]
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = value

    return change


def _drop(*path: str | int, module: bool = True) -> Callable[[dict[str, Any]], None]:
    """Something left out, of the first module or of the manifest itself."""

    def change(manifest: dict[str, Any]) -> None:
        at: Any = manifest["modules"][0] if module else manifest
        for key in path[:-1]:
            at = at[key]
        at.pop(path[-1])

    return change


def _params(value: object) -> Callable[[dict[str, Any]], None]:
    return lambda manifest: manifest.update(params=value)


def manifest_edits(manifest: dict[str, Any]) -> Iterator[Edit]:
    """Everything that can be said differently in a manifest."""
    entry = manifest["modules"][0]
    for said in ([], ["none: holds for every robot"], ["P1c"]):
        yield Edit("assumptions", f"{said}", True, _put(said, "assumptions"))
    yield from _times(entry)
    for claim, verdict in entry["claims"].items():
        for other in ("proved", "assumed", "undecided", "refuted", "certain"):
            if other != verdict:
                wrong = other == "certain" or (claim, other) == ("P1c", "proved")
                yield Edit(
                    "claims",
                    f"{claim} {other}",
                    wrong,
                    _put(other, "claims", claim),
                )
    for i, item in enumerate(entry["inputs"]):
        for side, factor in (("low", 0.5), ("high", 0.5), ("low", 0.99), ("high", 0.99)):
            value = (float.fromhex(item[side]) * factor).hex()
            yield Edit(
                "inputs",
                f"{item['name']} {side} {factor}",
                True,
                _put(value, "inputs", i, side),
            )
        for key in ("name", "kind"):
            yield Edit(
                "inputs",
                f"{item['name']} {key}",
                True,
                _put("other", "inputs", i, key),
            )
        yield Edit("inputs", f"no {item['name']}", True, _drop("inputs", i))
    yield from _names(manifest)


REACHED = {
    "A_ns": "age_dm",
    "A_sc_ns": "age_sc",
    "d_ns": "delay",
    "j_ns": "jitter",
    "h0_ns": "start",
    "H_star_ns": "h_star",
    "H_ns": "h_star",
}
"""Derived times, and the quantity of `tests/generators/every_schedule.py` that each one bounds."""


def _times(entry: dict[str, Any]) -> Iterator[Edit]:
    """A declared time that is another one overstates; of a derived one the report is judged.

    Longer ones are claims about more schedules; shorter ones may be true, too, if no schedule
    exceeds what is reported.
    """
    declared = ("Delta_ns", "delta_ns", "J_dm_ns", "J_sc_ns", "R_dm_ns", "R_sc_ns", "L_ns")
    for key, value in entry["times"].items():
        for by in (-1, 1, -1_000_000, 1_000_000, -10_000_000, 10_000_000, -value, value):
            if by:
                edit = _put(value + by, "times", key)
                yield Edit("times", f"{key} {by:+d}", key in declared, edit)
        for odd in (True, None, float(value), str(value), 1 << 70):
            yield Edit(
                "times",
                f"{key} = {odd!r}",
                True,
                _put(odd, "times", key),
            )


def _names(manifest: dict[str, Any]) -> Iterator[Edit]:
    entry = manifest["modules"][0]
    for key in ("system", "module"):
        for name in ("Bare", "N", "", 3, None):
            yield Edit(
                "names",
                f"{key} {name}",
                True,
                _put(name, key),
            )
    yield Edit("names", "twice", True, lambda m: m.update(modules=2 * m["modules"]))
    yield Edit("names", "none", True, lambda m: m.update(modules=[]))
    yield Edit("names", "plants", True, _put(["q"], "plants"))
    yield Edit("names", "no plants", True, _put([], "plants"))
    extra = [{"name": "p.k", "values": [0]}]
    yield Edit("names", "parameters", True, _put(extra, "parameters"))
    recover = entry["recover_ns"]
    for time in (0, 1, 10**9, 10**12, None, True):
        if time != recover:
            yield Edit(
                "names",
                f"recover {time}",
                True,
                _put(time, "recover_ns"),
            )
    for key in list(entry):
        yield Edit("names", f"no {key}", True, _drop(key))
    for key in list(manifest):
        if key != "files":
            yield Edit("names", f"no {key} at all", True, _drop(key, module=False))
    for value in (0.5, 0.6, 1.0, 1.5, 1.9, 2.5, 3.0, 5.0, 9.0, -1.0, 100.0):
        yield Edit(
            "parameters",
            f"GAIN {value}",
            None,
            _params({"GAIN": value.hex()}),
            values={"GAIN": repr(value)},
        )
    yield Edit("parameters", "left out", None, _params({}))
    yield Edit("parameters", "unknown", True, _params({"B": (1.0).hex()}))


def table_edits(manifest: dict[str, Any]) -> Iterator[Edit]:
    """Tables that say too much; the first group of the first case."""
    group = manifest["modules"][0]["cases"][0]["groups"][0]
    for key in ("K", "R", "Q", "W", "W_N"):
        if key not in group:
            continue
        for name, how in _FILLED.items():
            full = name in ("full", "more") and key in ("K", "R", "Q", "W")
            yield Edit("tables", f"{key} {name}", True if full else None, tables=_filling(key, how))
    for k in range(len(group.get("S", []))):
        yield Edit(
            "tables", f"S{k} full", True, tables=_filling("S", lambda d: b"\xff" * len(d), k)
        )
    for axis in range(len(group["axes"])):
        for at in (0, 8, -8):
            yield Edit("tables", f"edge {axis} {at}", None, tables=_moved_edge(axis, at))


_FILLED: dict[str, Callable[[bytes], bytes]] = {
    "full": lambda d: b"\x01" * len(d),
    "more": lambda d: bytes(b or 3 for b in d),
    "empty": lambda d: b"\0" * len(d),
    "ones": lambda d: bytes(min(b, 1) for b in d),
    "half": lambda d: bytes(b // 2 for b in d),
    "up": lambda d: bytes(min(b + 1, 255) if b else 0 for b in d),
    "shifted": lambda d: d[1:] + d[:1],
    "reversed": lambda d: d[::-1],
    "short": lambda d: d[:-1],
    "long": lambda d: d + b"\0",
}


def _filling(
    key: str, how: Callable[[bytes], bytes], at: int | None = None
) -> Callable[[dict[str, bytes], dict[str, Any]], None]:
    def change(contents: dict[str, bytes], manifest: dict[str, Any]) -> None:
        name = manifest["modules"][0]["cases"][0]["groups"][0][key]
        name = name if at is None else name[at]
        contents[name] = how(contents[name])

    return change


def _moved_edge(axis: int, at: int) -> Callable[[dict[str, bytes], dict[str, Any]], None]:
    def change(contents: dict[str, bytes], manifest: dict[str, Any]) -> None:
        name = manifest["modules"][0]["cases"][0]["groups"][0]["axes"][axis]["edges"]
        data = bytearray(contents[name])
        data[at + 6 if at >= 0 else len(data) + at + 6] ^= 4
        contents[name] = bytes(data)

    return change


# ---------------------------------------------------------------- programs

FACTORS = (0.0, 0.5, 0.8, 0.95, 1.05, 1.25, 2.0, 5.0, -1.0)
NUMBER = re.compile(r"(?<![\w.])(\d+\.\d+|\d+)(ms|s)?(?![\w.])")
BAD = "node Bad period 50ms { subscribes x; publishes u; step { publish u = 1.0; } }\n"
STRUCTURES: dict[str, tuple[str, str]] = {
    "takeover": ("node Slow(.*?)  step", r"node Slow\1  on takeover { assert false; }\n  step"),
    "takeover that does nothing": ("node Slow(.*?)  step", r"node Slow\1  on takeover { }\n  step"),
    "in_control": ("step { publish u = clamp", "step { assert in_control; publish u = clamp"),
    "in_control in a value": ("clamp\\(-GAIN", "(in_control ? 1.0 : 0.0) * clamp(-GAIN"),
    "mode": ("step { publish u = clamp", "step { assert mode(M) == Mode.SC; publish u = clamp"),
    "time": ("step { publish u = clamp", "step { assert time < 5.0; publish u = clamp"),
    "age": ("step { publish u = clamp", "step { assert age(x) < 5.0; publish u = clamp"),
    "assert": ("step { publish u = clamp", "step { assert x < 0.3; publish u = clamp"),
    "assert false": ("step { publish u = clamp", "step { assert false; publish u = clamp"),
    "choose": ("publish u = clamp\\((.*?)\\);", r"publish u = choose { clamp(\1), 1.0 };"),
    "fair choose": (
        "publish u = clamp\\((.*?)\\);",
        r"publish u = fair choose { clamp(\1), 1.0 };",
    ),
    "queue": ("(node Slow.*?)subscribes x;", r"\1subscribes x, noise queue 1 fault;"),
    "queue that drops": ("(node Slow.*?)subscribes x;", r"\1subscribes x, noise queue 1;"),
    "local": ("(node Slow.*?)  step {", r"\1  var n: int in [0, 3] = 0;\n  step { n = n + 1;"),
    "one side": (
        "step { publish u = clamp(.*?); }",
        r"step { if x > 0.0 { publish u = clamp\1; } }",
    ),
    "division": ("step { publish u = clamp\\(-GAIN", "step { publish u = clamp(-GAIN / x"),
    "assumes": ("(node Slow.*?)  step", r"\1  assumes x < 0.0;\n  step"),
    "guarantees": ("(node Slow.*?)  step", r"\1  guarantees u < 0.0;\n  step"),
    "forced": ("module M;", "module M; force M ac;"),
    "forced to sc": ("module M;", "module M; force M sc;"),
    "another SC": (
        "module M;(.*)$",
        rf"module M; replace Slow by Bad;\1{BAD}",
    ),
    "extern SC": ("node Slow(.*?)step {.*?}\n", r"extern node Slow\1"),
    "extern plant": ("reads u;(.*?)der p = u \\+ w;", r"reads u;\1der p = 3.0 * u + w;"),
    "slow sensor": ("plant P period 10ms", "plant P period 1s"),
    "slow sensor of an abstraction": ("plant World period 10ms", "plant World period 1s"),
    "slow estimate": ("node Estimate period 10ms", "node Estimate period 1s"),
    "estimate now and then": (
        "step { publish x = raw; }",
        "step { if raw > 0.0 { publish x = raw; } }",
    ),
    "estimate of a queue": ("subscribes raw;", "subscribes raw queue 3;"),
    "slow driver": ("node Driver period 5ms", "node Driver period 1s"),
    "driver now and then": (
        "step { publish force = u; }",
        "step { if u > 0.0 { publish force = u; } }",
    ),
    "no max_age": ("topic x: float(.*?) max_age \\d+ms", r"topic x: float\1"),
    "wind": ("disturbance w: float in \\[-(.*?), (.*?)\\]", "disturbance w: float in [-0.5, 0.5]"),
    "no error": ("\n  measured x within .*?;", ""),
    "phase of SC": ("node Slow period 50ms", "node Slow period 50ms phase 49ms"),
    "phase of SC by little": ("node Slow period 50ms", "node Slow period 50ms phase 1ms"),
    "AC publishes more": (
        "(node Fast.*?)publishes u;(.*?)step {",
        r"\1publishes u, v;\2step { publish v = 1.0;",
    ),
    "negated safe": ("safe abs\\(x\\) < 1.0", "safe abs(x) > 1.0"),
    "ttf never": ("ttf abs\\(x\\) > 0.5", "ttf false"),
    "safer always": ("safer abs\\(x\\) < 0.4", "safer true"),
    "no dropout": ("\n    dropout 20ms;", ""),
    "a long dropout": ("dropout 20ms", "dropout 400ms"),
    "more late": ("late dm 2ms", "late dm 40ms"),
    "undeclared": ("    late dm.*?response.*?\n", ""),
    "levels": ("    grid x", "    levels 5;\n    grid x"),
    "horizon": ("    grid x", "    horizon 5ms;\n    grid x"),
    "recover": ("recover within 30s", "recover within 100ms"),
    "wired": ("module M;", "module M { x = y };"),
}
NEEDED = {
    "noise": "input topic noise: float in [0.0, 1.0];\n",
    "u, v;": "topic v: float in [-1.0, 1.0];\n",
    "x = y": "topic y: float max_age 9s;\n",
}


def program_edits(text: str) -> Iterator[Edit]:
    """Every number of the program otherwise; and other words."""
    for match in NUMBER.finditer(text):
        if match.start() < len("soter 1;"):
            continue
        number, unit = match.groups()
        for factor in FACTORS:
            value = float(number) * factor
            if unit or "." not in number:
                written = str(round(value))
            else:
                written = f"({value!r})" if value < 0 else repr(value)
            if written in (number, f"({number})"):
                continue
            changed = text[: match.start()] + written + (unit or "") + text[match.end() :]
            line = text.count("\n", 0, match.start()) + 1
            yield Edit(
                "numbers", f"line {line}: {number}{unit or ''} -> {written}", None, text=changed
            )
    for name, (old, new) in STRUCTURES.items():
        changed, count = re.subn(old, new, text, count=1, flags=re.DOTALL)
        if not count:
            continue
        for word, declared in NEEDED.items():
            if word in changed and word not in text:
                changed = changed.replace("topic u:", f"{declared}topic u:", 1)
                if word == "noise":
                    changed = changed.replace("module M;", "module M; input noise every 10ms;", 1)
        yield Edit("structure", name, None, text=changed)
