"""Tables of rows, each table one test: it goes on after a row that fails, and names all that do.

Purpose: `@all_rows(names, rows)` stands where `@pytest.mark.parametrize(names, rows)` would, for
rows that are quick. Each row has a folder, patches and captured output of its own. `pytest --row
TEXT` tries of each table only the rows with the text in their name.
Non-goals: rows that are dear or marked: pytest counts them one by one, and `durations.py` leaves
out those for which a quick run has no time.
"""

from __future__ import annotations

import inspect
import reprlib
import traceback
from collections.abc import Callable, Iterable, Sequence
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

Test = Callable[..., None]
Ids = Sequence[str] | Callable[[Any], object] | None
_asked = {"row": ""}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--row", default="", help="of each table the rows with this in their name")


def pytest_configure(config: pytest.Config) -> None:
    _asked["row"] = config.getoption("--row")


def all_rows(
    names: str | Sequence[str],
    rows: Iterable[Any] | Callable[[], Iterable[Any]],
    *,
    ids: Ids = None,
) -> Callable[[Test], Test]:
    """The test is called with every row; where two tables stand over it, with all their pairs.

    A row is a value for the one name, or a tuple of one for each; `rows` that are dear to make may
    be a function, which is called when the test is. `ids`: the names of the rows,
    or what gives that of a value.
    """
    columns = [names] if isinstance(names, str) else list(names)
    make = list(rows).copy if isinstance(rows, Iterable) else rows

    def mine() -> Iterator[Row]:
        for number, row in enumerate(make()):
            values = (row,) if isinstance(names, str) else row
            arguments = dict(zip(columns, values, strict=True))
            yield Row(partial(_name, ids, number, tuple(values)), arguments)

    def decorate(test: Test) -> Test:
        inner, below = vars(test).get("table", (test, lambda: [Row(str, {})]))

        def both() -> list[Row]:
            return [row.beside(other) for other in below() for row in mine()]

        @wraps(test)
        def whole(**fixtures: Any) -> None:
            _tried(inner, both(), fixtures)

        asked = inspect.signature(test)
        left = [p for name, p in asked.parameters.items() if name not in columns]
        vars(whole).update(table=(inner, both), __signature__=asked.replace(parameters=left))
        return whole

    return decorate


class Row(NamedTuple):
    name: Callable[[], str]
    arguments: dict[str, Any]

    def beside(self, other: Row) -> Row:
        """A row of the product of two tables."""
        return Row(
            lambda: ", ".join(name for name in (other.name(), self.name()) if name),
            other.arguments | self.arguments,
        )


def _name(ids: Ids, number: int, row: tuple[Any, ...]) -> str:
    if isinstance(ids, Sequence):
        return ids[number]
    given = [(ids(value) if ids else None) or value for value in row]
    return ", ".join(str(x) if isinstance(x, str | Path) else _brief(x) for x in given)


def _brief(value: object) -> str:
    return str(getattr(value, "__name__", reprlib.repr(value)))


def _tried(test: Test, rows: Sequence[Row], fixtures: Mapping[str, Any]) -> None:
    failed: list[str] = []
    skipped: list[str] = []
    tried, first = 0, None
    for number, row in enumerate(rows):
        if _asked["row"] and _asked["row"] not in row.name():
            continue
        tried += 1
        try:
            _called(test, number, {**fixtures, **row.arguments})
        except pytest.skip.Exception as skip:
            skipped.append(f"{row.name()}: {skip}")
        except (Exception, pytest.fail.Exception) as error:  # noqa: BLE001 - told of below
            failed.append(f"{row.name()}: {_shown(error)}")
            first = first or error
    if failed:
        raise AssertionError("\n".join([f"{len(failed)} of {tried} rows", *failed])) from first
    if skipped or not tried:
        pytest.skip("\n".join([f"{len(skipped)} of {tried} rows", *skipped]))


def _called(test: Test, number: int, arguments: dict[str, Any]) -> None:
    """The test of one row, with what pytest makes anew for each test."""
    with pytest.MonkeyPatch.context() as patch:
        if "monkeypatch" in arguments:
            arguments["monkeypatch"] = patch
        if "tmp_path" in arguments:
            arguments["tmp_path"] /= str(number)
            arguments["tmp_path"].mkdir()
        if "capsys" in arguments:
            arguments["capsys"].readouterr()
        test(**arguments)


def _shown(error: BaseException) -> str:
    """What failed and where, in a line."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    kind = "" if isinstance(error, AssertionError) else f"{type(error).__name__}: "
    said = str(error).partition("\n")[0]
    return f"{kind}{said} ({where.name}:{where.lineno})"
