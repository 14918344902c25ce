"""A robot's program as numpy functions, and as functions of C, read from its text.

Purpose: `robot_of`: plant, SC, times, bounds and `safe` of a program of the shape of
`../shared/robots`: one plant, one module; SC's step is of `let` and `publish`; a `? :` has no
parentheses in it. Of arrays the first element is flown. Other shapes end in an exception.
Non-goals: Soter's language: nothing of Soter is imported, so that what flies is read once more.
"""

from __future__ import annotations

import itertools
import math
import re
from typing import TYPE_CHECKING, Any

import numpy as np
from bench.newcomers.flights import Array, Robot

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Names = Mapping[str, Any]
    Ends = Mapping[str, tuple[float | None, float | None]]

UNITS = {"us": 1e-6, "ms": 1e-3, "s": 1.0}


def clamp(x: Array, low: Array, high: Array) -> Array:
    """In [low, high]."""
    return np.minimum(np.maximum(x, low), high)


FUNCTIONS: dict[str, Any] = {
    "__builtins__": {},
    **{name: getattr(np, name) for name in ("abs", "sin", "cos", "hypot", "where")},
    "max": np.maximum,
    "min": np.minimum,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "clamp": clamp,
    "saturate": lambda x, most: clamp(x, -most, most),
    "wrap_angle": lambda angle: (angle + math.pi) % (2 * math.pi) - math.pi,
}


def condition(text: str) -> str:
    """`&&` binds tighter than `||`, as `&` than `|`; none may stand in parentheses."""
    ways = (" & ".join(f"({one})" for one in way.split("&&")) for way in text.split("||"))
    return " | ".join(ways)


def joined(expression: str) -> str:
    """With the name `pose_y` for `pose.y`."""
    return re.sub(r"([A-Za-z]\w*)\.(?=[A-Za-z])", r"\1_", expression)


def compiled(expression: str) -> Callable[[Names], Any]:
    """Its value, of the values of names; `pose.y` is the name `pose_y`."""
    text = joined(expression)
    text = re.sub(
        r"([^?(),]+)\?([^:]+):([^,()]+)",
        lambda c: f"where({condition(c[1])}, {c[2]}, {c[3]})",
        text if "?" in text else condition(text),
    )
    code = compile(text.strip(), expression, "eval")
    return lambda names: eval(code, FUNCTIONS, {**names})  # noqa: S307 - text of this repository


def seconds(text: str) -> float:
    """Of `40ms`."""
    ((value, unit),) = re.findall(r"^([\d.]+)(us|ms|s)$", text)
    return float(value) * UNITS[unit]


def block(text: str, head: str) -> tuple[str, str]:
    """The group of `head`, and the text in the braces behind it."""
    (match,) = re.finditer(head + r"[^{]*\{", text)
    end, depth = match.end(), 1
    while depth:
        depth += {"{": 1, "}": -1}.get(text[end], 0)
        end += 1
    return match[1], text[match.end() : end - 1]


def found(pattern: str, text: str) -> str:
    """The group of a pattern that stands once."""
    (group,) = re.findall(pattern, text)
    return str(group)


def fields(name: str, value: str) -> dict[str, str]:
    """`{ v: a, w: b }` as `name_v: a` and `name_w: b`; anything else as `name`."""
    if not value.startswith("{"):
        return {name: value}
    return {f"{name}_{field}": of for field, of in re.findall(r"(\w+): ([^,{}]+?) ?[,}]", value)}


def stacked(values: list[Any], n: int) -> Array:
    """Values of n flights below each other; a number stands for n equal ones."""
    rows = np.empty((len(values), n))
    for row, value in zip(rows, values, strict=True):
        row[:] = value
    return rows


def named(names: list[str], values: Array) -> dict[str, Array]:
    """Rows of an array by name."""
    return dict(zip(names, values, strict=True))


def steps_of(body: str) -> list[tuple[str, str]]:
    """Names and their values, in the order of a node's step."""
    steps: list[tuple[str, str]] = []
    for word, name, value in re.findall(r"(let|publish) (\w+) = (\{[^}]*\}|[^;]+);", body):
        steps += (fields(name, value) if word == "publish" else {name: value}).items()
    return steps


def sc_of(body: str, reads: list[str], writes: list[str], given: Names) -> Callable[[Array], Array]:
    """SC's step: of what is measured, in the order of `reads`, the commands."""
    steps = [(name, compiled(value)) for name, value in steps_of(body)]

    def step(seen: Array) -> Array:
        names = {**given, **named(reads, seen)}
        for name, value in steps:
            names[name] = value(names)
        return stacked([names[name] for name in writes], seen.shape[1])

    return step


def rates_of(
    plant: str, states: list[str], writes: list[str], given: Names
) -> Callable[[Array, Array, Array], Array]:
    """Of states, commands and disturbances: what the plant's equations say of each state."""
    right = dict(re.findall(r"(?:der|next) (\w+) = ([^;]+);", plant))
    equations = [compiled(right[state]) for state in states]
    disturbances = re.findall(r"disturbance (\w+)", plant)

    def rates(x: Array, u: Array, d: Array) -> Array:
        names = {**given, **named(states, x), **named(writes, u), **named(disturbances, d)}
        return stacked([equation(names) for equation in equations], x.shape[1])

    return rates


def function_in_c(
    head: str, reads: Mapping[str, list[str]], lines: list[tuple[str, str]], ends: str
) -> str:
    """A function of C: `reads` are the arrays that hold the values of names."""
    places = [(n, f"{at}[{i}]") for at, names in reads.items() for i, n in enumerate(names)]
    body = "".join(f"  double {name} = {joined(of)};\n" for name, of in places + lines)
    return f"static {head} {{\n{body}  {ends}\n}}\n"


def in_c(
    plant: str, body: str, safe: str, names: tuple[list[str], list[str], list[str]], given: Names
) -> str:
    """`rates`, `sc` and `safe` of C; `names`: states, what is measured of each, commands."""
    states, reads, writes = names
    right = dict(re.findall(r"(?:der|next) (\w+) = ([^;]+);", plant))
    rates = "".join(f"out_[{i}] = {joined(right[state])}; " for i, state in enumerate(states))
    commands = "".join(f"out_[{i}] = {name}; " for i, name in enumerate(writes))
    const = "const double *"
    of = {"x_": states, "u_": writes, "d_": re.findall(r"disturbance (\w+)", plant)}
    return (
        "".join(f"static const double {name} = {value!r};\n" for name, value in given.items())
        + function_in_c(f"void rates({const}x_, {const}u_, {const}d_, double *out_)", of, [], rates)
        + function_in_c(
            f"void sc({const}x_, double *out_)", {"x_": reads}, steps_of(body), commands
        )
        + function_in_c(f"int safe({const}x_)", {"x_": reads}, [], f"return {joined(safe)};")
    )


def held(bounds: list[tuple[float, float]]) -> tuple[tuple[float, ...], ...]:
    """Commands that AC may hold: one at an end, the others at an end or in the middle."""
    each = itertools.product(*((low, (low + high) / 2, high) for low, high in bounds))
    return tuple(u for u in each if any(v in two for v, two in zip(u, bounds, strict=True)))


def robot_of(text: str, until_s: float, starts: Ends) -> Robot:
    """What flies of a program; `starts`: where the lattice does not begin or end with the grid."""
    text = re.sub(r"\[\d\]", "", re.sub(r"//.*", "", text))
    given: dict[str, Any] = {}
    for name, value in re.findall(r"const (\w+): float = ([^;]+);", text):
        given[name] = compiled(value)(given)

    def pairs(pattern: str, where: str) -> list[tuple[str, float, float]]:
        """The name before, and the ends, of each `[-Q, Q]`."""
        each = ((name, *ends.split(",")) for name, ends in re.findall(pattern, where))
        return [(name, *(float(compiled(end)(given)) for end in two)) for name, *two in each]

    plant_period, plant = block(text, r"plant \w+ period (\w+)")
    _, module = block(text, r"rta (\w+)")
    sc_period, sc = block(text, rf"node {found(r'[^#]sc (.+?);', module)} period (\w+)")
    states = re.findall(r"state (\w+)", plant)
    topic, driven = re.findall(r"drives (\w+) = (\w+|\{[^}]*\});", plant)[0]
    measured = {state: name for name, state in fields(topic, driven).items()}
    reads = [measured[state] for state in states]
    command = found(r"reads (\w+);", plant)
    bounds = pairs(r"(\w+) in \[([^\]]+)\]", found(rf"topic {command}: (.+);", text))
    writes = [command if name == "float" else f"{command}_{name}" for name, *_ in bounds]
    ends = {
        name.replace(".", "_"): two for name, *two in pairs(r"([\w.]+) in \[([^\]]+)\]", module)
    }
    for name, two in starts.items():
        key = name.replace(".", "_")
        ends[key] = [of if of is not None else old for of, old in zip(two, ends[key], strict=True)]
    within = dict(re.findall(r"([\w.]+) within ([\d.]+)", plant))
    errors = {name.replace(".", "_"): float(error) for name, error in within.items()}
    safe_text = found(r"safe ([^;]+);", module)
    safe = compiled(safe_text)
    late = re.findall(r"acts within (\w+);", module)
    step_s = seconds(sc_period)
    return Robot(
        low=tuple(ends.get(name, (0.0, 0.0))[0] for name in reads),
        high=tuple(ends.get(name, (0.0, 0.0))[1] for name in reads),
        safe=lambda x: safe({**given, **named(reads, x)}),
        rates=rates_of(plant, states, writes, given),
        sc=sc_of(sc, reads, writes, given),
        ac=held([(low, high) for _, low, high in bounds]),
        disturbed=tuple(
            (low, high) for _, low, high in pairs(r"(\w+: float) in \[([^\]]+)\]", plant)
        ),
        errors=tuple(errors.get(name, 0.0) for name in reads),
        age_s=seconds(found(rf"topic {topic}: .*?max_age (\w+);", text)),
        period_s=seconds(found(r"[^#]period (\w+);", module)),
        step_s=step_s,
        until_s=until_s,
        pieces=math.ceil(step_s / seconds(plant_period) - 1e-9),
        late_s=seconds(late[0]) if late else 0.0,
        maps=bool(re.search(r"\bnext ", plant)),
        in_c=in_c(plant, sc, safe_text, (states, reads, writes), given),
    )
