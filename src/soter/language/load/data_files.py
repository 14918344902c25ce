"""`const NAME: T = data "file";`: typed tables from json, csv and npy files.

Purpose: read a file and check it against a Soter type, so that bad data is a diagnostic.
Non-goals: writing files, units, partial reads.
"""

from __future__ import annotations

import csv
import io
import json
import math
import warnings
from itertools import accumulate
from operator import mul
from typing import TYPE_CHECKING, Any

from soter.language.load.bounded_read import read_bytes
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.language.model.values import Table, ValueShapeError, check_length, from_json, is_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from soter.language.model.types import Type, Value

MAX_DATA_BYTES = 16 * 1024 * 1024
MAX_TABLE_BYTES = 128 * 1024 * 1024
"""Of a file that holds a table."""
MAX_ITEMS = 10_000_000
"""Lists and numbers in an array; more than twice what a table has. Empty lists need no bytes."""
NPY_MAGIC = b"\x93NUMPY"
NUMBER_BYTES = 8
TOLD_EVERY = 4096
KINDS = {".json", ".csv", ".npy"}


class DataError(Exception):
    """A data file that is no value of the declared type; the text says why."""


def read_data(path: Path, t: Type, tell: Callable[[str], None]) -> tuple[Value, bytes]:
    """The value of type `t` in the file and the file's bytes (for the program's hash).

    `tell` is called with what is being done, again and again where that takes long. Raises
    `ReadError` where the file cannot be read, `DataError` where its content is wrong.
    """
    suffix = path.suffix.lower()
    if suffix not in KINDS:
        kind = f"a file called `*{suffix}`" if suffix else "a file without an ending"
        raise DataError(f"{kind} cannot be read as data: .json, .csv and .npy can")
    raw = read_bytes(path, MAX_TABLE_BYTES if is_table(t) else MAX_DATA_BYTES)
    tell(f"reading `{path.name}`")
    if suffix == ".json":
        document = _without_comment(_json(raw))
    elif suffix == ".csv":
        document = _csv(raw, t)
    else:
        document = _npy(raw, t)
    try:
        value = _value(t, document, lambda n: tell(f"reading `{path.name}`: {n} elements"))
    except (ValueShapeError, RecursionError) as error:
        raise DataError(str(error)) from error
    wrong = _not_finite(t, value, "")
    if wrong is not None:
        raise DataError(wrong)
    return value, raw


def _value(t: Type, document: object, tell: Callable[[int], None]) -> Value:
    """The value that a document stands for, a `Table` where the type is one."""
    if isinstance(document, Table):
        check_length(t, len(document), "")
        return document
    if (
        not isinstance(t, (ArrayType, ListType))
        or not is_table(t)
        or not isinstance(document, list)
    ):
        return from_json(t, document)
    check_length(t, len(document), "")
    return Table.of(t.element, _elements(t.element, document, tell))


def _elements(t: Type, documents: list[object], tell: Callable[[int], None]) -> Iterator[Value]:
    for i, document in enumerate(documents):
        if i % TOLD_EVERY == 0:
            tell(i)
        yield from_json(t, document, f"[{i}]")


def _not_finite(t: Type, value: Value, path: str) -> str | None:
    """Where a NaN or an infinity stands in the value, if one does."""
    if isinstance(t, FloatType):
        if math.isfinite(value):
            return None
        return (f"{path}: " if path else "") + f"{value} is no number a constant may have"
    parts: list[tuple[str, Type, Value]] = []
    if isinstance(value, Table):
        at = value.first_not_finite()
        return None if at is None else _not_finite(value.element, value[at], f"{path}[{at}]")
    if isinstance(t, RecordType):
        pairs = zip(t.fields, value, strict=True)
        parts = [(f"{path}.{n}" if path else n, f, v) for (n, f), v in pairs]
    elif isinstance(t, (ArrayType, ListType)):
        parts = [(f"{path}[{i}]", t.element, v) for i, v in enumerate(value)]
    return next((w for at, f, v in parts if (w := _not_finite(f, v, at))), None)


def parse_json(text: str | bytes) -> Any:  # noqa: ANN401  any JSON document
    """The document; ValueError where it is none or gives a name twice, RecursionError too deep."""
    return json.loads(text, object_pairs_hook=_named_once)


def _named_once(pairs: list[tuple[str, object]]) -> dict[str, object]:
    value_by_name: dict[str, object] = {}
    for name, value in pairs:
        if name in value_by_name:
            raise ValueError(f"`{name[:40]}` is given twice")
        value_by_name[name] = value
    return value_by_name


def _json(raw: bytes) -> object:
    try:
        return parse_json(raw.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise DataError(f"it is not valid JSON: {error}") from error


def _without_comment(document: object) -> object:
    """The document without its `"$comment"`, where a data file says whose data it is."""
    if isinstance(document, dict):
        return {k: v for k, v in document.items() if k != "$comment"}
    return document


# ---------------------------------------------------------------- csv


def _csv(raw: bytes, t: Type) -> object:
    """Rows of a csv: with a header line for records, plain numbers otherwise."""
    if not isinstance(t, (ArrayType, ListType)):
        raise DataError(f"a csv file gives an array or a list, not `{t}`")
    try:
        text = raw.decode("utf-8-sig")
        rows = [row for row in csv.reader(io.StringIO(text, newline=""), strict=True) if row]
    except (ValueError, csv.Error) as error:
        raise DataError(f"it is not a csv file: {error}") from error
    element = t.element
    if isinstance(element, RecordType):
        return _records(rows, element)
    if isinstance(element, (ArrayType, ListType)):
        return [[_cell(c, element.element, n) for c in row] for n, row in enumerate(rows, 1)]
    return [_cell(c, element, n) for n, row in enumerate(rows, 1) for c in row]


def _records(rows: list[list[str]], element: RecordType) -> list[dict[str, object]]:
    """One object a row; the header says which field each column is, other columns are left out."""
    if not rows:
        raise DataError("it is empty: a header line is expected")
    header = [h.strip() for h in rows[0]]
    if len(set(header)) != len(header):
        twice = next(h for h in header if header.count(h) > 1)
        raise DataError(f"the header names the column `{twice}` twice")
    types = dict(element.fields)
    missing = [n for n in types if n not in header]
    if missing:
        raise DataError(f"the header has no column `{missing[0]}`")
    records = []
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            raise DataError(f"row {number} has {len(row)} columns, the header {len(header)}")
        cells = zip(header, row, strict=True)
        records.append({h: _cell(cell, types[h], number) for h, cell in cells if h in types})
    return records


def _cell(text: str, t: Type, row: int) -> object:
    text = text.strip()
    if isinstance(t, (FloatType, IntType)):
        kind = "a number" if isinstance(t, FloatType) else "a whole number"
        try:
            if "_" in text or not text.isascii():  # Python reads 1_000, and digits of any script
                raise ValueError  # noqa: TRY301
            return float(text) if isinstance(t, FloatType) else int(text)
        except ValueError:
            shown = text if len(text) <= 40 else text[:37] + "..."
            raise DataError(f"row {row}: expected {kind}, found `{shown}`") from None
    if isinstance(t, BoolType) and text in {"true", "false"}:
        return text == "true"
    if isinstance(t, (BoolType, EnumType)):
        return text
    raise DataError(f"a cell of a csv file cannot hold a `{t}`")


# ---------------------------------------------------------------- npy


def _npy(raw: bytes, t: Type) -> object:
    if not raw.startswith(NPY_MAGIC):
        raise DataError("it is not an npy file")
    import numpy as np  # noqa: PLC0415 - only programs with npy data pay for it

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            array = np.load(io.BytesIO(raw), allow_pickle=False)
    except Exception as error:  # a broken header can break the reader in any way
        reason = " ".join(str(error).split())[:100]
        raise DataError(f"it is not a complete npy file: {reason}") from error
    if array.dtype.kind not in "biuf":
        raise DataError(f"its elements are `{array.dtype}`, not numbers or bools")
    if sum(accumulate(array.shape, mul)) > MAX_ITEMS:
        raise DataError(f"its shape {array.shape} is too large")
    if (
        isinstance(t, (ArrayType, ListType))
        and is_table(t)
        and array.dtype.itemsize <= NUMBER_BYTES
    ):
        shape = _shape(t.element)
        if shape == array.shape[1:] and array.dtype.kind in "iuf":
            return Table(t.element, array.astype("<f8", order="C").tobytes())
    return array.tolist()


def _shape(t: Type) -> tuple[int, ...] | None:
    """The shape of floats that a value is, None for anything but floats in arrays."""
    if isinstance(t, FloatType):
        return ()
    inner = _shape(t.element) if isinstance(t, ArrayType) else None
    return (t.size, *inner) if isinstance(t, ArrayType) and inner is not None else None
