"""`const NAME: T = data "file";`: typed tables from json, csv and npy files.

Purpose: read a file and check it against a Soter type, so that bad data is a diagnostic.
Non-goals: writing files, units, partial reads.
"""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING

from soter.program.types import ArrayType, FloatType, IntType, ListType, RecordType
from soter.program.values import ValueShapeError, from_json

if TYPE_CHECKING:
    from pathlib import Path

    from soter.program.types import Type, Value

MAX_DATA_BYTES = 16 * 1024 * 1024


class DataError(Exception):
    """A data file that cannot be read as the declared type; the text says why."""


def read_data(path: Path, t: Type) -> tuple[Value, bytes]:
    """The value of type `t` in the file and the file's bytes (for the program's hash)."""
    try:
        if path.stat().st_size > MAX_DATA_BYTES:
            raise DataError(f"the file is larger than {MAX_DATA_BYTES} bytes")
        raw = path.read_bytes()
    except OSError as error:
        raise DataError((error.strerror or str(error)).lower()) from error
    suffix = path.suffix.lower()
    if suffix == ".json":
        document = _without_comment(_json(raw))
    elif suffix == ".csv":
        document = _csv(raw, t)
    elif suffix == ".npy":
        document = _npy(raw)
    else:
        raise DataError(f"unknown kind of data file `{suffix}`: json, csv and npy are read")
    try:
        return from_json(t, document), raw
    except ValueShapeError as error:
        raise DataError(str(error)) from error


def _json(raw: bytes) -> object:
    try:
        return json.loads(raw.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise DataError(f"not valid JSON: {error}") from error


def _without_comment(document: object) -> object:
    """The document without its `"$comment"`, where a data file says whose data it is."""
    if isinstance(document, dict):
        return {k: v for k, v in document.items() if k != "$comment"}
    return document


def _csv(raw: bytes, t: Type) -> object:
    """Rows of a csv: with a header line for records, plain numbers otherwise."""
    if not isinstance(t, (ArrayType, ListType)):
        raise DataError(f"a csv file gives an array or a list, not `{t}`")
    try:
        rows = [row for row in csv.reader(io.StringIO(raw.decode("utf-8-sig"))) if row]
    except (ValueError, csv.Error) as error:
        raise DataError(f"not a csv file: {error}") from error
    element = t.element
    if isinstance(element, RecordType):
        if not rows:
            raise DataError("the csv file is empty: a header line is expected")
        header = [h.strip() for h in rows[0]]
        if len(set(header)) != len(header):
            raise DataError("the header names a column twice")
        bodies = rows[1:]
        for number, row in enumerate(bodies, start=2):
            if len(row) != len(header):
                raise DataError(f"row {number} has {len(row)} columns, the header {len(header)}")
        types = dict(element.fields)
        return [
            {
                h: _cell(cell, types.get(h), n)
                for h, cell in zip(header, row, strict=True)
                if h in types
            }
            for n, row in enumerate(bodies, start=2)
        ]
    if isinstance(element, (ArrayType, ListType)):
        return [[_cell(c, element.element, n) for c in row] for n, row in enumerate(rows, 1)]
    return [_cell(c, element, n) for n, row in enumerate(rows, 1) for c in row]


def _cell(text: str, t: Type | None, row: int) -> object:
    text = text.strip()
    try:
        if isinstance(t, FloatType):
            return float(text)
        if isinstance(t, IntType):
            return int(text)
    except ValueError as error:
        raise DataError(f"row {row}: `{text}` is not a number") from error
    if text in {"true", "false"}:
        return text == "true"
    return text


def _npy(raw: bytes) -> object:
    import numpy as np  # noqa: PLC0415 - only programs with npy data pay for it

    try:
        array = np.load(io.BytesIO(raw), allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise DataError(f"not an npy file: {error}") from error
    return array.tolist()
