"""Headers of ROS messages without ROS: the structs that roscpp has, from rosbags' definitions.

Purpose: generated conversions compile and run where no ROS is. Non-goals: serialization.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from soter.mapping.message_types import MessageType

BASE, NAMED, ARRAY, SEQUENCE = 1, 2, 3, 4
PRIMITIVES = {
    "bool": "uint8_t", "byte": "int8_t", "char": "uint8_t", "float32": "float",
    "float64": "double", "string": "std::string",
    **{f"int{n}": f"int{n}_t" for n in (8, 16, 32, 64)},
    **{f"uint{n}": f"uint{n}_t" for n in (8, 16, 32, 64)},
}  # fmt: skip
TIME = """#ifndef STUB_TIME
#define STUB_TIME
#include <cstdint>
namespace ros {
struct Time { uint32_t sec = 0, nsec = 0; };
}
#endif
"""


def write_headers(message: MessageType, folder: Path) -> None:
    """`package/Name.h` of a type, with all that it has, and `ros/time.h`."""
    (folder / "ros").mkdir(parents=True, exist_ok=True)
    (folder / "ros" / "time.h").write_text(TIME, encoding="utf-8")
    done: dict[str, str] = {}
    _struct(message.ros2, message.definitions[1], done)
    header = folder / message.package / f"{message.name}.h"
    header.parent.mkdir(exist_ok=True)
    parts = "".join(done.values())
    top = "#include <ros/time.h>\n#include <array>\n#include <string>\n#include <vector>\n"
    header.write_text(f"#pragma once\n{top}{parts}", encoding="utf-8")


def _struct(name: str, definitions: Any, done: dict[str, str]) -> None:
    if name in done or name.endswith(("msg/Time", "msg/Duration")):
        return
    fields = [(n, _type(kind, definitions, done)) for n, kind in definitions[name][1]]
    package, _, short = name.partition("/msg/")
    guard = f"STUB_{package}_{short}"
    lines = "".join(f"  {t} {n}{{}};\n" for n, t in fields)
    done[name] = (
        f"#ifndef {guard}\n#define {guard}\nnamespace {package} {{\nstruct {short} {{\n{lines}}};\n"
        "}\n#endif\n"
    )


def _type(kind: Any, definitions: Any, done: dict[str, str]) -> str:
    if kind[0] == BASE:
        return PRIMITIVES[kind[1][0]]
    if kind[0] == NAMED:
        if kind[1].endswith(("msg/Time", "msg/Duration")):
            return "ros::Time"
        _struct(kind[1], definitions, done)
        return str(kind[1]).replace("/msg/", "::")
    element, size = kind[1]
    inner = _type(element, definitions, done)
    return f"std::array<{inner}, {size}>" if kind[0] == ARRAY else f"std::vector<{inner}>"
