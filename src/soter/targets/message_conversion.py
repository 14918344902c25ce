"""Writes statements of C or C++ that turn messages of a middleware into values and back.

Purpose: a `MessageConverter` writes what a mapping says of a topic as code, for the bridges of all
targets, with the arithmetic of `monitor` (a number is multiplied, then the offset is added; the way
out is the reverse): a message and a log give the same bits. D015 for what no code can do.
Non-goals: how messages come and go (`runtime/`), what a mapping may say (`soter.mapping`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.codegen.c_names import field_name
from soter.core.layout import scalar, storage_range
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.language.model.types import (
    BoolType,
    DurationType,
    EnumType,
    FloatType,
    IntType,
    Type,
    Value,
    leaves,
)
from soter.mapping.message_types import MessageType, StampSource, path_steps, text_bound
from soter.mapping.topic_mapping import (
    ConstantSource,
    Leaf,
    LeafPath,
    NearestSource,
    SignalSource,
    TopicMap,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from soter.language.model.system import Topic

INTEGERS = {
    **{f"int{n}": (-(2 ** (n - 1)), 2 ** (n - 1) - 1) for n in (8, 16, 32, 64)},
    **{f"uint{n}": (0, 2**n - 1) for n in (8, 16, 32, 64)},
    "byte": (-128, 127),
    "char": (0, 255),
}
"""The least and greatest value of each integer type of ROS 1."""
UNSIGNED_BYTE = {"byte": (0, 255)}
"""The ranges of integer types that differ in ROS 2."""
FLOATS = ("float32", "float64")


@dataclass(frozen=True)
class Dialect:
    """The code forms of a language: size and item of a sequence, member, setting a text.

    `set_bounded`: how it sets a text whose length in bytes is bounded; "" means like any text.
    """

    size: str
    item: str
    same_text: str
    set_text: str
    member: str = "{0}.{1}"
    set_bounded: str = ""


CPP = Dialect("{0}.size()", "{0}[{1}]", "{0} == {1}", "{0} = {1}")
"""roscpp: std::vector and std::string."""
CYCLONE = Dialect(
    "{0}._length",
    "{0}._buffer[{1}]",
    "strcmp({0}, {1}) == 0",
    "{0} = (char*){1}",
    "{0}.{1}_",
    "(void)strcpy({0}, {1})",
)
"""The C of Cyclone DDS, of the IDL that ROS 2 makes: names end in `_`."""


class MessageConverter:
    """Writes the code for a topic and its messages; `message`, `value`: lvalues in that code."""

    def __init__(self, mapped: TopicMap, ros: int, dialect: Dialect, message: str) -> None:
        if mapped.message is None:
            raise unmappable(f"`{mapped.topic.name}` has no `type`: which messages are its?")
        self.mapped = mapped
        self.type: MessageType = mapped.message
        self.ros = ros
        self.dialect = dialect
        self.message = message
        self.types = dict(leaves(mapped.topic.type))
        self.integers = INTEGERS if ros == 1 else {**INTEGERS, **UNSIGNED_BYTE}

    # ------------------------------------------------------------ in

    def inward_statements(self) -> list[str]:
        """Statements that fill the value `*to`, or `return false` if the message lacks a part."""
        lines: list[str] = []
        for name, most in self._indexed_sequences():
            size = self.dialect.size.format(self.field_code(name))
            lines += refusal_code(f"{size} <= {most}U")
        for path, leaf in self.mapped.leaves.items():
            lines += self._inward_leaf_lines(path, leaf, f"(*to){self.leaf_code(path)}")
        return [*lines, "return true;"]

    def _inward_leaf_lines(self, path: LeafPath, leaf: Leaf, to: str) -> list[str]:
        t = self.types[path]
        if isinstance(leaf, ConstantSource):
            return [f"{to} = {self._constant_code(t, leaf.value)};"]
        if isinstance(leaf, NearestSource):
            return [*self._inward_scan_lines(path, leaf, to)]
        if not isinstance(leaf, SignalSource):
            field = "is a slope, which `monitor` can take and a robot in flight cannot: map a speed"
            raise unmappable(f"`{self.mapped.leaf_name(path)}` {field}")
        field, kind = self.field_code(leaf.name), self.type.primitive_type(leaf.name, self.ros)
        if isinstance(t, FloatType):
            return [f"{to} = {_scaling_code(f'(double){field}', leaf)};"]
        if isinstance(t, BoolType):
            return [f"{to} = {field} ? 1U : 0U;"]
        if isinstance(t, EnumType):
            return [*self._inward_enum_lines(t, field, to)]
        assert isinstance(t, (IntType, DurationType)), t
        return [*self._inward_int_lines(path, t, field, kind, to)]

    def _inward_scan_lines(self, path: LeafPath, leaf: NearestSource, to: str) -> Iterable[str]:
        """The statements that call a function of soter_scan.hpp, which needs C++."""
        if self.dialect is not CPP:
            problem = "is what is nearest in a scan, which only the bridges of ROS can tell"
            raise unmappable(f"`{self.mapped.leaf_name(path)}` {problem}")
        limits = f"{leaf.most!r}, {leaf.unseen}U"
        return refusal_code(f"!soter::nearest_{leaf.quantity}({self.message}, {limits}, &{to})")

    def _inward_enum_lines(self, t: EnumType, field: str, to: str) -> Iterator[str]:
        for k, member in enumerate(t.members):
            word = "if" if k == 0 else "} else if"
            yield f"{word} ({self.dialect.same_text.format(field, text_literal(member))}) {{"
            yield f"  {to} = {k}U;"
        yield "} else {"
        yield "  return false;"
        yield "}"

    def _inward_int_lines(
        self, path: LeafPath, t: Type, field: str, kind: str, to: str
    ) -> Iterator[str]:
        if kind not in self.integers:
            raise unmappable(f"`{self.mapped.leaf_name(path)}` is `{t}`, the field a `{kind}`")
        s = scalar(t)
        assert s is not None
        (low, high), (least, most) = storage_range(s), self.integers[kind]
        tests = []
        if least < low:
            tests.append(f"(int64_t){field} < {_int_code(low)}")
        if most > high:
            cast = "(uint64_t)" if least >= 0 else "(int64_t)"
            tests.append(f"{cast}{field} > {_int_code(high, unsigned=least >= 0)}")
        if tests:
            yield from refusal_code(" || ".join(tests))
        yield f"{to} = ({s.c_type}){field};"

    def _indexed_sequences(self) -> list[tuple[str, int]]:
        """The sequences whose elements the mapping reads, each with the greatest index."""
        most: dict[str, int] = {}
        for name in self.mapped.names:
            if self.type.field_at(name, self.ros).through != "sequence":
                continue
            parts = name.split(".")
            at, *more = [i for i, p in enumerate(parts) if p.isdigit()]
            if more:
                raise unmappable(f"`{name}` of {self.type.ros1} is in a list of lists")
            sequence = ".".join(parts[:at])
            most[sequence] = max(most.get(sequence, 0), int(parts[at]))
        return sorted(most.items())

    # ------------------------------------------------------------ out

    def outward_statements(self) -> list[str]:
        """Statements that fill a message from `*from`; raises SoterError D015 for a scan."""
        lines = []
        for path, leaf in self.mapped.leaves.items():
            if isinstance(leaf, NearestSource):
                raise unmappable(
                    f"`{self.mapped.leaf_name(path)}` goes out, and no scan is made of it"
                )
            if isinstance(leaf, SignalSource):
                lines += self._outward_leaf_lines(path, leaf, f"(*from){self.leaf_code(path)}")
        for name, constant in self.mapped.constants.items():
            lines.append(self._constant_statement(name, constant))
        return lines

    def _outward_leaf_lines(self, path: LeafPath, leaf: SignalSource, value: str) -> list[str]:
        t, to = self.types[path], self.field_code(leaf.name)
        field = self.type.field_at(leaf.name, self.ros)
        named = f"`{self.mapped.leaf_name(path)}`"
        if field.through == "sequence":
            raise unmappable(f"{named} goes into an element of a sequence, which is empty")
        if isinstance(t, FloatType) and field.type in FLOATS:
            cast = "(float)" if field.type == "float32" else ""
            return [f"{to} = {cast}({_unscaling_code(value, leaf)});"]
        if isinstance(t, BoolType) and field.type in ("bool", "uint8"):
            return [f"{to} = {value} != 0U;"]
        if isinstance(t, EnumType) and field.type == "string":
            *first, last = [text_literal(m) for m in t.members]
            chain = "".join(f"{value} == {k}U ? {m} : " for k, m in enumerate(first))
            return [self._text_statement(leaf.name, t.members, f"({chain}{last})")]
        if isinstance(t, IntType) and field.type in self.integers:
            low, high = self.integers[field.type]
            if t.low < low or t.high > high:
                raise unmappable(f"{named} is `{t}`, which a `{field.type}` cannot hold")
            return [f"{to} = {value};"]
        raise unmappable(f"{named} is `{t}`, and the field that it goes into a `{field.type}`")

    def _constant_statement(self, name: str, constant: object) -> str:
        kind, to = self.type.primitive_type(name, self.ros), self.field_code(name)
        if isinstance(constant, str) and kind == "string":
            return self._text_statement(name, [constant], text_literal(constant))
        if isinstance(constant, bool) and kind in ("bool", "uint8"):
            return f"{to} = {'true' if constant else 'false'};"
        if isinstance(constant, (int, float)) and not isinstance(constant, bool):
            if kind in FLOATS:
                return f"{to} = {float(constant)!r};"
            low, high = self.integers.get(kind, (1, 0))
            if isinstance(constant, int) and low <= constant <= high:
                return f"{to} = {_int_code(constant, unsigned=low == 0)};"
        raise unmappable(f"`set` of `{self.mapped.topic.name}`: {constant!r} is no `{kind}`")

    def _text_statement(self, name: str, texts: Iterable[str], code: str) -> str:
        """The statement that sets a text field to `code`, whose value is one of `texts`."""
        bound = text_bound(self.type, name, self.ros) if self.dialect.set_bounded else 0
        long = [t for t in texts if bound and len(t.encode("utf-8", "surrogatepass")) > bound]
        if long:
            raise unmappable(f"`{name}` of {self.type.ros2} holds {bound} bytes, not {long[0]!r}")
        form = self.dialect.set_bounded if bound else self.dialect.set_text
        return f"{form.format(self.field_code(name), code)};"

    # ------------------------------------------------------------ names

    def field_code(self, name: str) -> str:
        """The code that accesses a field of the message."""
        code = self.message
        for part, step in path_steps(self.type, name, self.ros):
            form = {
                "member": self.dialect.member,
                "array": "{0}[{1}]",
                "sequence": self.dialect.item,
            }
            code = form[step].format(code, part)
        return code

    def number_stamp_code(self, stamp: StampSource) -> str:
        """The code for the time of measurement in ns, from a stamp that is a plain number."""
        unit = f"{stamp.unit_ns.numerator}, {stamp.unit_ns.denominator}"
        return f"soter_ns_of_number((long double){self.field_code(stamp.path)}, {unit})"

    @staticmethod
    def leaf_code(path: LeafPath) -> str:
        """The code of a leaf, to be appended to the code of its topic's value."""
        return "".join(f".at{p}" if p.startswith("[") else f".{field_name(p)}" for p in path)

    @staticmethod
    def _constant_code(t: Type, value: Value) -> str:
        if isinstance(t, FloatType):
            return repr(float(value))
        return f"{int(value)}U" if isinstance(t, (BoolType, EnumType)) else _int_code(int(value))


def topic_tests(topic: Topic) -> list[str]:
    """C++ conditions that the trusted part has for `value`: finite, and in the topic's set."""
    tests = []
    for (path, t), bound in zip(leaves(topic.type), topic.bounds, strict=True):
        field = f"value{MessageConverter.leaf_code(path)}"
        if isinstance(t, FloatType):
            tests.append(f"std::isfinite({field})")
        if bound is not None and isinstance(t, FloatType):
            tests.append(f"{field} >= {float(bound.low)!r} && {field} <= {float(bound.high)!r}")
        elif bound is not None and isinstance(t, IntType):
            low, high = math.ceil(bound.low), math.floor(bound.high)
            tests.append(
                f"(int64_t){field} >= {_int_code(low)} && (int64_t){field} <= {_int_code(high)}"
            )
    return tests


def _scaling_code(code: str, leaf: SignalSource) -> str:
    if leaf.scale != 1.0:
        code = f"{leaf.scale!r} * {code}"
    return code if leaf.offset == 0.0 else f"{code} + {leaf.offset!r}"


def _unscaling_code(code: str, leaf: SignalSource) -> str:
    if leaf.offset != 0.0:
        code = f"({code} - {leaf.offset!r})"
    return code if leaf.scale == 1.0 else f"{code} / {leaf.scale!r}"


def _int_code(value: int, *, unsigned: bool = False) -> str:
    if unsigned:
        return f"UINT64_C({value})"
    return "INT64_MIN" if value == -(2**63) else f"INT64_C({value})"


def text_literal(text: str) -> str:
    """A text as a C and C++ literal, in which all but plain letters become octal bytes."""
    plain = frozenset(b" -./:_")
    letters = [
        chr(b) if b in plain or (chr(b).isalnum() and b < 128) else f"\\{b:03o}"
        for b in text.encode("utf-8")
    ]
    return f'"{"".join(letters)}"'


def unmappable(why: str) -> SoterError:
    """The SoterError D015 for a mapping that no bridge can implement."""
    return mistake("D015", why)


def refusal_code(condition: str) -> tuple[str, str, str]:
    """C (and C++) statements that refuse a message if a condition holds."""
    return f"if ({condition}) {{", "  return false;", "}"
