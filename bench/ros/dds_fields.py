"""Every field of a message, and the code that fills and checks them, in C, C++ and Python.

Purpose: from the definitions of rosbags to statements over what `idlc` and `fastddsgen` make of the
same IDL; the k-th sample has in field i, element j what `dds_values.h` says.
Non-goals: sending (`dds_samples.py`).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

TYPES = {"odom": "nav_msgs/msg/Odometry", "scan": "sensor_msgs/msg/LaserScan"}
COUNTERS = {"odom": "pose.pose.position.x", "scan": "angle_min"}
"""The field that has k."""
BASE, NAMED, ARRAY = 1, 2, 3


@dataclass(frozen=True)
class Field:
    """A primitive, or an array or a sequence of one: `many` is 0, its size, or -1."""

    number: int
    path: tuple[str, ...]
    primitive: str
    many: int

    @property
    def name(self) -> str:
        """As people write it."""
        return ".".join(self.path)


def definitions(name: str) -> dict[str, list[list[Any]]]:
    """The fields of a type and of all that it is made of, as JSON has them."""
    from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 - the peer lacks it

    store = get_typestore(Stores.ROS2_JAZZY).fielddefs
    found: dict[str, list[list[Any]]] = {}

    def add(of: str) -> None:
        if of in found:
            return
        found[of] = json.loads(json.dumps(store[of][1]))
        for _, kind in found[of]:
            inner = kind[1][0] if kind[0] > NAMED else kind
            if inner[0] == NAMED:
                add(inner[1])

    add(name)
    return found


def fields(name: str, given: dict[str, list[list[Any]]]) -> list[Field]:
    """In declared order."""
    found = _walk(name, given, ())
    return [Field(i, path, primitive, many) for i, (path, primitive, many) in enumerate(found)]


def _walk(
    name: str, given: dict[str, list[list[Any]]], before: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], str, int]]:
    for member, kind in given[name]:
        path = (*before, member)
        if kind[0] == NAMED:
            yield from _walk(kind[1], given, path)
        elif kind[0] == BASE:
            yield path, kind[1][0], 0
        else:
            element, size = kind[1]
            assert element[0] == BASE, name
            yield path, element[1][0], size if kind[0] == ARRAY else -1


# ---------------------------------------------------------------- C and C++


def code(key: str, *, cpp: bool) -> str:
    """Functions `fill_KEY(m, k)` and `check_KEY(m, k)`: NULL, or the name of what is misread."""
    name = TYPES[key]
    found = fields(name, definitions(name))
    parts = (*name.split("/")[:2], "dds_", f"{name.split('/')[2]}_")
    kind = "::".join(parts) if cpp else "_".join(parts)
    fill, check = [], []
    for f in found:
        at = _access(f, cpp=cpp)
        fill += _fill(f, at, key, cpp=cpp)
        check += _check(f, at, key, cpp=cpp)
    lines = "\n  "
    ref = f"{kind}& m" if cpp else f"{kind}* m"
    const = f"const {kind}& m" if cpp else f"const {kind}* m"
    return f"""\
static void fill_{key}({ref}, uint32_t k) {{
  {lines.join(fill)}
}}

static const char* check_{key}({const}, uint32_t k, int bridged) {{
  char text[32];
  (void)text;
  (void)bridged;
  {lines.join(check)}
  return NULL;
}}

static uint32_t counter_{key}({const}) {{
  return (uint32_t){_access(next(f for f in found if f.name == COUNTERS[key]), cpp=cpp)};
}}
"""


def _access(f: Field, *, cpp: bool) -> str:
    return "m" + "".join(f".{p}_()" for p in f.path) if cpp else f"m->{'_.'.join(f.path)}_"


def _value(f: Field, j: str) -> str:
    kind = {"float64": "dds_double", "float32": "dds_float"}.get(f.primitive)
    cast = {"int32": "(int32_t)", "uint32": "(uint32_t)"}.get(f.primitive, "")
    return f"{kind or f'{cast}dds_mixed'}(k, {f.number}u, {j})"


def _set(at: str, value: str, *, cpp: bool) -> str:
    return f"{at[:-2]}({value});" if cpp else f"{at} = {value};"


def _fill(f: Field, at: str, key: str, *, cpp: bool) -> list[str]:
    if f.name == COUNTERS[key]:
        return [_set(at, "k", cpp=cpp)]
    if f.primitive == "string":
        text = f"dds_text(k, {f.number}u, text_{f.number})"
        declared = f"static char text_{f.number}[32];"
        return [declared, _set(at, text if cpp else f"(char*){text}", cpp=cpp)]
    if f.many == 0:
        return [_set(at, _value(f, "0u"), cpp=cpp)]
    size = str(f.many) if f.many > 0 else f"dds_length(k, {f.number}u)"
    lines, target = [], f"{at}[j]"
    if f.many < 0 and cpp:
        lines.append(f"{at}.resize({size});")
    elif f.many < 0:
        element = {"float64": "double", "float32": "float"}[f.primitive]
        lines.append(f"static {element} room_{f.number}[1024];")
        lines.append(f"{at}._buffer = room_{f.number};")
        lines.append(f"{at}._length = {at}._maximum = {size};")
        target = f"room_{f.number}[j]"
    return [*lines, f"for (uint32_t j = 0; j < {size}; j++) {target} = {_value(f, 'j')};"]


def _check(f: Field, at: str, key: str, *, cpp: bool) -> list[str]:
    fail = f'return "{f.name}";'
    if f.name == COUNTERS[key]:
        return [f"if ({at} != k) {fail}"]
    if f.name.startswith("header.stamp"):
        return [f"if (!bridged && {at} != {_value(f, '0u')}) {fail}"]
    if f.primitive == "string":
        chars = f"{at}.c_str()" if cpp else at
        own = f"strcmp({chars}, dds_text(k, {f.number}u, text)) != 0"
        if f.name == "child_frame_id":
            bridged = f"strcmp({chars}, child_of(k)) != 0"
        else:
            bridged = f'strcmp({chars}, "odom") != 0'
        return [f"if (bridged ? {bridged} : {own}) {fail}"]
    if f.many == 0:
        return [f"if ({at} != {_value(f, '0u')}) {fail}"]
    size = str(f.many) if f.many > 0 else f"dds_length(k, {f.number}u)"
    lines = []
    if f.many < 0:
        length = f"{at}.size()" if cpp else f"{at}._length"
        lines.append(f"if ({length} != {size}) {fail}")
    element = f"{at}[j]" if f.many > 0 or cpp else f"{at}._buffer[j]"
    compared = f"if ({element} != {_value(f, 'j')}) {fail}"
    return [*lines, f"for (uint32_t j = 0; j < {size}; j++) {compared}"]


CHILD = """\
static const char* const children[] = {"base_link", "body", "arm"};
static inline const char* child_of(uint32_t k) { return children[k % 3u]; }
"""

# ---------------------------------------------------------------- Python


def mixed(k: int, i: int, j: int) -> int:
    """As dds_values.h has it, and what follows, too."""
    return (k * 2654435761 + i * 40503 + j * 7919 + 12345) & 0xFFFFFFFF


def value(f: Field, key: str, k: int) -> object:
    """What stands in a field of the k-th sample."""
    if f.name == COUNTERS[key]:
        return k
    if f.primitive == "string":
        m = mixed(k, f.number, 0) >> 8
        return "".join(chr(97 + (m + at) % 26) for at in range(m % 24))
    if f.many == 0:
        return _number(f, k, 0)
    size = f.many
    if size < 0:
        m = mixed(k, f.number, 0) >> 8
        size = 360 + m % 361 if m % 64 == 0 else m % 24
    return [_number(f, k, j) for j in range(size)]


def _number(f: Field, k: int, j: int) -> float:
    m = mixed(k, f.number, j)
    if f.primitive == "float64":
        return m / 1024.0 - 1.0e6
    if f.primitive == "float32":
        return (m & 0xFFFFFF) / 256.0
    return m - 2**32 if f.primitive == "int32" and m >= 2**31 else m


# ---------------------------------------------------------------- the bridge's own values


def mapping() -> str:
    """The mapping of dds_fields.soter: every number of both."""
    odom = {"child": "child_frame_id"}
    for name, path in (
        ("position", "pose.pose.position"),
        ("orientation", "pose.pose.orientation"),
        ("linear", "twist.twist.linear"),
        ("angular", "twist.twist.angular"),
    ):
        axes = "xyzw"[: 4 if name == "orientation" else 3]
        odom |= {f"{name}.[{n}]": f"{path}.{axis}" for n, axis in enumerate(axes)}
    for name in ("pose", "twist"):
        odom |= {f"{name}_covariance.[{n}]": f"{name}.covariance.{n}" for n in range(36)}
    about = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time")
    scan = {f"about.[{n}]": p for n, p in enumerate((*about, "range_min", "range_max"))}
    scan |= {f"ranges.[{n}]": f"ranges.{n}" for n in range(8)}
    reliable = '{ reliability = "reliable", depth = "all" }'
    return "\n".join(
        (
            'system = "Wire"',
            *_topic("odom", "/odom", "nav_msgs/Odometry", odom, reliable),
            *_topic("scan", "/scan", "sensor_msgs/LaserScan", scan, reliable),
            *_topic("echo", "/echo", "nav_msgs/Odometry", odom, "{}"),
            "",
        )
    )


def _topic(name: str, channel: str, kind: str, rows: dict[str, str], qos: str) -> list[str]:
    set_ = 'set = { "header.frame_id" = "odom" }' if name == "echo" else 'frame_id = "odom"'
    return [
        f"[topics.{name}]",
        f'channel = "{channel}"\ntype = "{kind}"\nqos = {qos}\n{set_}',
        f"[topics.{name}.fields]",
        *(f'"{leaf}" = "{path}"' for leaf, path in rows.items()),
    ]


def numbered(path: str, found: list[Field]) -> tuple[int, int]:
    """The field and the element of a path of the mapping."""
    head, _, last = path.rpartition(".")
    for f in found:
        if f.name == path:
            return f.number, 0
        if f.many and f.name == head:
            return f.number, int(last)
    raise KeyError(path)


def write_code(folder: Path) -> None:
    """`wire_code.h` for idlc's C, `fast_code.h` for fastddsgen's C++."""
    for name, cpp in (("wire_code.h", False), ("fast_code.h", True)):
        texts = [code(key, cpp=cpp) for key in TYPES]
        (folder / name).write_text("\n".join((CHILD, *texts)), encoding="utf-8")
