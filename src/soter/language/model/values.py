"""Values of Soter in Python: tables, and conversions to and from users' Python and JSON.

Purpose: `Table` keeps a constant that was read from a file packed, 8 bytes a number. One conversion
serves extern nodes, functions and plants of both engines, another one `data` files and logs.
Non-goals: whether a value lies in a topic's set (the gate decides), reading files
(`language/load/`), images of states (`core/layout.py`).

NumPy is imported only when an array crosses the border: `soter check` never needs it.
"""

from __future__ import annotations

import hashlib
import math
import struct
from collections.abc import Mapping, Sequence
from itertools import islice
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, SupportsFloat, SupportsIndex, TypeGuard, cast, overload

from soter.language.model.types import (
    INT,
    ArrayType,
    BoolType,
    DurationType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    Type,
    Value,
    is_vector_part,
    leaf_count,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator


VALUE_MAX = 100_000
"""Most numbers in a value of a step, state or message, which copy it whole."""
TABLE_MAX = 4_000_000
"""Most numbers in a table."""


def is_table(t: Type) -> TypeGuard[ArrayType | ListType]:
    """Whether values of the type are too large to be copied, and so are kept as a `Table`."""
    return isinstance(t, (ArrayType, ListType)) and leaf_count(t) > VALUE_MAX


def is_value(t: Type, value: Value) -> bool:
    """Whether an object is a value of the type in the interpreter's form."""
    if isinstance(t, FloatType):
        return isinstance(value, float)
    if isinstance(t, BoolType):
        return isinstance(value, bool)
    if isinstance(t, (EnumType, IntType)):
        low, high = (0, len(t.members) - 1) if isinstance(t, EnumType) else (t.low, t.high)
        return isinstance(value, int) and not isinstance(value, bool) and low <= value <= high
    if not isinstance(value, tuple):
        return False
    if isinstance(t, RecordType):
        return len(value) == len(t.fields) and all(
            is_value(f, v) for (_, f), v in zip(t.fields, value, strict=True)
        )
    assert isinstance(t, (ArrayType, ListType)), t
    fits = len(value) == t.size if isinstance(t, ArrayType) else len(value) <= t.capacity
    return fits and all(is_value(t.element, v) for v in value)


class Table(Sequence[Value]):
    """The elements of an array or list, which never change; tables are equal if all bits are equal.

    `packed` has the leaves of all elements, little-endian: floats as binary64, bools as one byte,
    others as 64-bit ints. An inner list has its length and all elements of its capacity.
    """

    __slots__ = ("_read", "_row", "_sha256", "_size", "element", "packed")

    def __init__(self, element: Type, packed: bytes) -> None:
        self.element = element
        self.packed = packed
        self._row = struct.Struct("<" + _struct_format(element))
        self._read = _value_reader(element)
        self._size = len(packed) // self._row.size
        self._sha256 = ""

    @classmethod
    def of_values(cls, element: Type, values: Iterable[Value]) -> Table:
        """Gives the table whose elements are these values."""
        row, flat = struct.Struct("<" + _struct_format(element)), _leaf_lister(element)
        return cls(element, b"".join([row.pack(*flat(v)) for v in values]))

    @property
    def has_only_floats(self) -> bool:
        """Whether every leaf is a float, so that `packed` is an array of doubles."""
        return is_vector_part(self.element)

    def index_of_first_not_finite(self) -> int | None:
        """Gives the index of the first element with a NaN or an infinity; or None."""
        rows = enumerate(self._row.iter_unpack(self.packed))
        return next((at for at, leaves in rows if not all(map(math.isfinite, leaves))), None)

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, index: int) -> Value: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Value, ...]: ...

    def __getitem__(self, index: int | slice) -> Value | tuple[Value, ...]:
        if isinstance(index, slice):
            return tuple([self[i] for i in range(*index.indices(self._size))])
        at = index + self._size if index < 0 else index
        if not 0 <= at < self._size:
            raise IndexError(index)
        return self._read(iter(self._row.unpack_from(self.packed, at * self._row.size)))

    def __iter__(self) -> Iterator[Value]:
        read = self._read
        return (read(iter(leaves)) for leaves in self._row.iter_unpack(self.packed))

    @property
    def sha256(self) -> str:
        """Gives the SHA-256 of the packed bytes, by which tables are stored and compared."""
        if not self._sha256:
            self._sha256 = hashlib.sha256(self.packed).hexdigest()
        return self._sha256

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Table):
            return NotImplemented
        return self.element == other.element and self.packed == other.packed

    def __hash__(self) -> int:
        return hash(self.sha256)

    def __repr__(self) -> str:
        return f"<table of {self._size} {self.element} {self.sha256}>"


def _struct_format(t: Type) -> str:
    """Gives the format by which `struct` packs the leaves of a value."""
    if isinstance(t, RecordType):
        return "".join(_struct_format(f) for _, f in t.fields)
    if isinstance(t, ArrayType):
        inner = _struct_format(t.element)
        return f"{t.size}{inner}" if len(inner) == 1 else inner * t.size
    if isinstance(t, ListType):
        return "q" + _struct_format(t.element) * t.capacity
    return "d" if isinstance(t, FloatType) else "?" if isinstance(t, BoolType) else "q"


def _value_reader(t: Type) -> Callable[[Iterator[Value]], Value]:
    """Gives the function that makes a value of the type from an iterator over its leaves."""
    if isinstance(t, RecordType):
        readers = [_value_reader(f) for _, f in t.fields]
        return lambda leaves: tuple([read(leaves) for read in readers])
    if isinstance(t, ArrayType):
        size, element = t.size, _value_reader(t.element)
        if leaf_count(t.element) == 1 and not isinstance(t.element, (RecordType, ArrayType)):
            return lambda leaves: tuple(islice(leaves, size))
        return lambda leaves: tuple([element(leaves) for _ in range(size)])
    if isinstance(t, ListType):
        capacity, element = t.capacity, _value_reader(t.element)

        def read_list(leaves: Iterator[Value]) -> Value:
            length = next(leaves)
            return tuple([element(leaves) for _ in range(capacity)])[:length]

        return read_list
    return next


def _leaf_lister(t: Type) -> Callable[[Value], list[Value]]:
    """Gives a function that lists the leaves of a value of the type, in order."""
    if isinstance(t, RecordType):
        parts = [_leaf_lister(f) for _, f in t.fields]
        return lambda v: [x for part, each in zip(parts, v, strict=True) for x in part(each)]
    if isinstance(t, ArrayType):
        element = _leaf_lister(t.element)
        if isinstance(t.element, FloatType):
            return list
        return lambda v: [x for each in v for x in element(each)]
    if isinstance(t, ListType):
        inner, width, capacity = _leaf_lister(t.element), len(_zero_leaves(t.element)), t.capacity
        padding = _zero_leaves(t.element)

        def list_with_padding(v: Value) -> list[Value]:
            elements = [x for each in v for x in inner(each)]
            assert len(elements) <= width * capacity
            return [len(v), *elements, *(padding * (capacity - len(v)))]

        return list_with_padding
    return lambda v: [v]


def _zero_leaves(t: Type) -> list[Value]:
    """Gives the leaves of a value of the type as a table stores them, all set to zero."""
    if isinstance(t, RecordType):
        return [x for _, f in t.fields for x in _zero_leaves(f)]
    if isinstance(t, ArrayType):
        return _zero_leaves(t.element) * t.size
    if isinstance(t, ListType):
        return [0, *(_zero_leaves(t.element) * t.capacity)]
    return [0.0 if isinstance(t, FloatType) else False if isinstance(t, BoolType) else 0]


DURATION_BITS = IntType()
"""A duration is stored as any 64-bit int."""


class ValueShapeError(Exception):
    """A Python or JSON object is no value of the type; `path` says where, and `reason` why."""

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(f"{path}: {reason}" if path else reason)
        self.path = path
        self.reason = reason


class ValueStructureError(ValueShapeError):
    """The names or counts in a Python or JSON object are not those of the type."""


# ---------------------------------------------------------------- Soter -> Python


def to_python(t: Type, value: Value, record: Callable[..., Any] = SimpleNamespace) -> Any:  # noqa: ANN401
    """Gives a value of any Soter type as the Python object that users' code gets.

    Records become namespaces, or the result of `record` for their fields. Arrays and lists of
    floats (or of arrays of floats) become NumPy arrays; others become Python lists. Enums become
    the names of their members, durations ns.
    """
    if isinstance(t, RecordType):
        fields = zip(t.fields, value, strict=True)
        return record(**{n: to_python(f, v, record) for (n, f), v in fields})
    if isinstance(t, EnumType):
        return t.members[value]
    if isinstance(t, (ArrayType, ListType)):
        if _is_block(t.element):
            import numpy as np  # noqa: PLC0415  see the module's docstring

            if isinstance(value, Table):
                doubles = np.frombuffer(value.packed, dtype="<f8").astype(np.float64)
                return doubles.reshape(len(value), *_block_shape(t.element))
            return np.array(value, dtype=np.float64).reshape(len(value), *_block_shape(t.element))
        return [to_python(t.element, v, record) for v in value]
    return value


def _is_block(t: Type) -> bool:
    """Whether a type is a float or nested arrays of floats, which stack into one NumPy array."""
    return isinstance(t, FloatType) or (isinstance(t, ArrayType) and _is_block(t.element))


def _block_shape(t: Type) -> tuple[int, ...]:
    return (t.size, *_block_shape(t.element)) if isinstance(t, ArrayType) else ()


# ---------------------------------------------------------------- Python -> Soter


def from_python(t: Type, value: object, path: str = "") -> Value:
    """Gives the Soter value of a Python object, `value`; raises `ValueShapeError`.

    Floats: anything with `__float__`, but no array with dimensions. Ints: anything with
    `__index__`, in the type's range. Bools: bools. Enums: the name of a member. Records: a mapping
    with exactly the fields, an object with the fields as attributes, or a sequence or array of one
    element for each field. Arrays: a sequence or array of that length; lists: up to it. A float may
    be NaN or infinite: the gate refuses it, not the shape.
    """
    if hasattr(value, "tolist") and hasattr(value, "ndim"):
        value = cast("Any", value).tolist()
    if isinstance(t, FloatType):
        return _float_from(value, path)
    if isinstance(t, BoolType):
        if isinstance(value, bool):
            return value
        raise _shape_error(path, "a bool", value)
    if isinstance(t, (IntType, DurationType)):
        return _int_from(t if isinstance(t, IntType) else DURATION_BITS, value, path)
    if isinstance(t, EnumType):
        if isinstance(value, str) and value in t.members:
            return t.members.index(value)
        raise _shape_error(path, f"one of {', '.join(map(repr, t.members))}", value)
    if isinstance(t, RecordType):
        return _record_from(t, value, path)
    assert isinstance(t, (ArrayType, ListType)), t
    if not _is_sequence(value):
        raise _shape_error(path, f"a sequence for `{t}`", value, parts=True)
    items = list(cast("Any", value))
    check_length(t, len(items), path)
    return tuple([from_python(t.element, v, f"{path}[{i}]") for i, v in enumerate(items)])


def _float_from(value: object, path: str) -> float:
    if not hasattr(value, "__float__") and not hasattr(value, "__index__"):
        raise _shape_error(path, "a number", value)
    try:
        return float(cast("SupportsFloat", value))
    except Exception as error:
        raise ValueShapeError(path, f"expected a number, but {error}") from error


def _int_from(t: IntType, value: object, path: str) -> int:
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise _shape_error(path, "an int", value)
    try:
        number = int(cast("SupportsIndex", value).__index__())
    except Exception as error:
        raise ValueShapeError(path, f"expected an int, but {error}") from error
    if not t.low <= number <= t.high:
        raise ValueShapeError(path, f"{number} is outside [{t.low}, {t.high}]")
    return number


def _record_from(t: RecordType, value: object, path: str) -> Value:
    names = [n for n, _ in t.fields]
    if isinstance(value, Mapping):
        _check_keys(names, value, path)
        parts = [value[n] for n in names]
    elif _is_sequence(value):
        parts = list(cast("Any", value))
        if len(parts) != len(names):
            reason = f"expected {len(names)} elements for `{t}`, found {len(parts)}"
            raise ValueStructureError(path, reason)
    else:
        missing = [n for n in names if not hasattr(value, n)]
        if missing:
            raise _shape_error(path, f"`{t}`", value, parts=True)
        parts = [getattr(value, n) for n in names]
    pairs = zip(t.fields, parts, strict=True)
    return tuple([from_python(f, v, _field_path(path, n)) for (n, f), v in pairs])


def _is_sequence(value: object) -> bool:
    """Whether an object is a list, tuple, tensor or the like, and no text or named tuple."""
    if isinstance(value, (str, bytes, bytearray, Mapping)) or hasattr(value, "_fields"):
        return False
    return hasattr(value, "__len__") and hasattr(value, "__getitem__")


# ---------------------------------------------------------------- extern steps


def inputs_to_python(named: Iterable[tuple[str, Type, Value]]) -> SimpleNamespace:
    """Gives the argument of an extern step: one attribute for each (short name, type, value)."""
    return SimpleNamespace(**{name: to_python(t, value) for name, t, value in named})


def outputs_from_python(named: Sequence[tuple[str, Type]], answer: object) -> list[Value | None]:
    """Gives an extern step's answer as values, one for each of `named`; None for one left out.

    The answer maps short names to values; a single output may also be the answer itself. None as
    the answer, or for a name, leaves outputs out. Raises `ValueShapeError`, or
    `ValueStructureError` if names or counts are wrong.
    """
    if answer is None:
        return [None] * len(named)
    if len(named) == 1:
        (name, t) = named[0]
        if not isinstance(answer, Mapping) or (answer and list(answer) != [name]):
            return [from_python(t, answer, name)]
    if not isinstance(answer, Mapping):
        raise _shape_error("", "a mapping from names to values", answer, parts=True)
    names = [name for name, _ in named]
    unknown = [str(key) for key in answer if key not in names]
    if unknown:
        raise ValueStructureError("", f"there is no `{unknown[0]}` to give a value to")
    answers = [(name, t, answer.get(name)) for name, t in named]
    return [None if value is None else from_python(t, value, name) for name, t, value in answers]


# ---------------------------------------------------------------- JSON


def to_json(t: Type, value: Value) -> Any:  # noqa: ANN401  any JSON document
    """Gives the value as a JSON document; records have field names, enums their member's name.

    JSON has no NaN and no infinities, so they become "NaN", "Infinity" and "-Infinity".
    """
    if isinstance(t, RecordType):
        return {n: to_json(f, v) for (n, f), v in zip(t.fields, value, strict=True)}
    if isinstance(t, (ArrayType, ListType)):
        return [to_json(t.element, v) for v in value]
    if isinstance(t, EnumType):
        return t.members[value]
    if isinstance(t, FloatType) and not math.isfinite(value):
        return "NaN" if value != value else "Infinity" if value > 0 else "-Infinity"  # noqa: PLR0124
    return value


def from_json(t: Type, json: object, path: str = "") -> Value:
    """Gives the Soter value of a JSON document; raises `ValueShapeError`.

    It is stricter than `from_python`: a bool is no number, and a record is an object with exactly
    the fields. A float is a finite number, or one of the strings that `to_json` writes.
    """
    if isinstance(t, FloatType):
        return _float_from_json(json, path)
    if isinstance(t, RecordType):
        if not isinstance(json, dict):
            raise _shape_error(path, f"an object for `{t}`", json)
        _check_keys([n for n, _ in t.fields], json, path)
        return tuple([from_json(f, json[n], _field_path(path, n)) for n, f in t.fields])
    if isinstance(t, (ArrayType, ListType)):
        if not isinstance(json, list):
            raise _shape_error(path, f"an array for `{t}`", json)
        check_length(t, len(json), path)
        if isinstance(t.element, FloatType) and {float} == set(map(type, json)):
            return tuple(json)  # a fast path with the same result as below
        return tuple([from_json(t.element, v, f"{path}[{i}]") for i, v in enumerate(json)])
    return from_python(t, json, path)


def _float_from_json(json: object, path: str) -> float:
    if isinstance(json, str) and json in ("NaN", "Infinity", "-Infinity"):
        return float(json)
    if isinstance(json, bool) or not isinstance(json, (int, float)):
        raise _shape_error(path, "a number", json)
    return _float_from(json, path)


# ---------------------------------------------------------------- reasons


def _field_path(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _shape_error(
    path: str, expected: str, value: object, *, parts: bool = False
) -> ValueShapeError:
    """Gives the error that `value` is not as `expected`; `parts`: which has several parts."""
    structure = parts or isinstance(value, Mapping) or _is_sequence(value)
    error = ValueStructureError if structure else ValueShapeError
    return error(
        path, f"expected {expected}, found {_value_description(value)}{_shape_hint(value)}"
    )


def _shape_hint(value: object) -> str:
    """Gives a hint at the right form for a wrong value; "" if no hint is known."""
    if isinstance(value, (list, tuple)) and len(value) == 1:
        return ": give its one element, `float(y[0])`"
    if isinstance(value, Mapping) and value and all(isinstance(k, str) for k in value):
        keys = ", ".join(f"`{k}`" for k in list(value)[:3])
        return f" with {keys}: an answer's keys are the names of its topics and fields"
    return ""


def _value_description(value: object) -> str:
    if value is None or isinstance(value, (bool, int, float, str)):
        text = repr(value)
        return text if len(text) <= 40 else f"a long {type(value).__name__}"
    if isinstance(value, (list, tuple)):
        return f"a sequence of {len(value)}"
    return f"a `{type(value).__name__}`"


def _check_keys(names: list[str], values: Mapping[Any, object], path: str) -> None:
    missing = [n for n in names if n not in values]
    if missing:
        raise ValueStructureError(path, f"field `{missing[0]}` is missing")
    extra = [str(k) for k in values if k not in names]
    if extra:
        raise ValueStructureError(path, f"there is no field `{extra[0]}`")


def check_length(t: Type, length: int, path: str) -> None:
    """Raises `ValueStructureError` if an array or list cannot have so many elements."""
    if isinstance(t, ArrayType) and length != t.size:
        raise ValueStructureError(path, f"expected {t.size} elements for `{t}`, found {length}")
    if isinstance(t, ListType) and length > t.capacity:
        raise ValueStructureError(path, f"at most {t.capacity} elements fit `{t}`, found {length}")


def without_ranges(t: Type) -> Type:
    """Gives the type with plain `int` in place of each ranged int, to leave ranges unchecked."""
    if isinstance(t, IntType):
        return INT
    if isinstance(t, RecordType):
        return RecordType(tuple((n, without_ranges(f)) for n, f in t.fields), t.name)
    if isinstance(t, ArrayType):
        return ArrayType(without_ranges(t.element), t.size)
    return ListType(without_ranges(t.element), t.capacity) if isinstance(t, ListType) else t
