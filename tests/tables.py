"""Tables of rows, each table one test: it goes on after a row that fails, and names all that do.

Purpose: `@all_rows(names, rows)` stands where `@pytest.mark.parametrize(names, rows)` would, for
rows that are quick. Each row has a folder, patches and captured output of its own. `pytest --row
TEXT` tries of each table only the rows with the text in their name. Rows that skip are told at the
end, and the table passes or fails by the others; it skips where all do. What fails in a loop of a
test is told with the values of the loop's names, so that the row is known.
Non-goals: rows that are dear or marked: pytest counts them one by one, and `durations.py` leaves
out those for which a quick run has no time.
"""

from __future__ import annotations

import ast
import inspect
import reprlib
import traceback
from collections.abc import Callable, Iterable, Sequence
from functools import cache, partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Mapping
    from types import FrameType

Test = Callable[..., None]
Ids = Sequence[str] | Callable[[Any], object] | None
_asked = {"row": ""}
_left_out: list[str] = []
"""The rows that the test which runs now has left out, each with its reason."""
LEFT_OUT = "rows left out"
TESTS = str(Path(__file__).resolve().parent)
SHOWN = 200


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
    told = "\n".join([f"{len(skipped)} of {tried} rows", *skipped])
    if len(skipped) == tried:
        pytest.skip(told)
    _left_out.extend([told] * bool(skipped))


# ---------------------------------------------------------------- what is told of rows


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    call: pytest.CallInfo[None],
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A report tells which rows its table left out, and at which row of a loop it failed."""
    report = yield
    if report.when == "call":
        report.user_properties += [(LEFT_OUT, told) for told in _left_out]
        _left_out.clear()
    if report.failed and call.excinfo is not None:
        loops = [told for frame, _ in traceback.walk_tb(call.excinfo.tb) if (told := at_row(frame))]
        report.sections += [("row of the loop", told) for told in loops]
    return report


def pytest_terminal_summary(terminalreporter: Any) -> None:
    for report in terminalreporter.getreports("passed"):
        for told in (text for name, text in report.user_properties if name == LEFT_OUT):
            terminalreporter.write_line(f"ROWS LEFT OUT {report.nodeid}: {told}")


def at_row(frame: FrameType) -> str:
    """The values of the names of the loops of a test in which a frame is; "" outside of all."""
    if not frame.f_code.co_filename.startswith(TESTS):
        return ""
    names: list[str] = []
    for first, last, of in _loops(frame.f_code.co_filename):
        names += of if first <= frame.f_lineno <= last else ()
    known = {name: frame.f_locals[name] for name in names if name in frame.f_locals}
    return ", ".join(f"{name} = {repr(value)[:SHOWN]}" for name, value in known.items())


@cache
def _loops(file: str) -> list[tuple[int, int, list[str]]]:
    """First and last line of each loop of a file, the outer ones first, and its names."""
    found = []
    for loop in ast.walk(ast.parse(Path(file).read_text(encoding="utf-8"))):
        if isinstance(loop, ast.For | ast.While):
            told = loop.target if isinstance(loop, ast.For) else loop.test
            names = [n.id for n in ast.walk(told) if isinstance(n, ast.Name)]
            found.append((loop.body[0].lineno, loop.end_lineno or 0, names))
    return found


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
