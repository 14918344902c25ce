"""What the checker of an editor does not compute again while somebody types, and what it does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.editor.documents import Overlay
from soter.language.check.constants_and_types import Calculator
from soter.language.front_end import check_file

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.front_end import CheckResult
    from soter.language.model import typed
    from soter.language.model.types import Value

BASE = """soter 1;
const ROW: float[3] = data "row.json";
fun total(): float {
  var sum: float = 0.0;
  for i in 0..3 { sum = sum + ROW[i]; }
  return sum;
}
const TOTAL: float = total();
"""
MIDDLE = 'soter 1;\nimport "base.soter" as base;\nconst TWICE: float = 2.0 * base.TOTAL;\n'
MAIN = 'soter 1;\nimport "middle.soter" as middle;\nconst MOST: float = middle.TWICE + 1.0;\n'
TOPIC = "topic x: float in [0.0, MOST] = 0.0;\n"


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was computed, in words."""
    told: list[str] = []
    value = Calculator.value

    def listen(self: Calculator, expr: typed.TypedExpr, what: str) -> Value | None:
        told.append(what)
        return value(self, expr, what)

    monkeypatch.setattr(Calculator, "value", listen)
    return told


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "row.json").write_text("[1.0, 2.0, 3.0]")
    (tmp_path / "base.soter").write_text(BASE)
    (tmp_path / "middle.soter").write_text(MIDDLE)
    return tmp_path


def most(checked: CheckResult) -> float:
    assert checked.ok, checked.diagnostics.items
    assert checked.program is not None
    return float(checked.program.consts["MOST"].value)


def test_constants_of_imports_are_computed_once_while_the_main_file_is_typed_in(
    folder: Path, computed: list[str]
) -> None:
    reading, main = Overlay(lambda _: None), str(folder / "main.soter")
    assert most(check_file(main, MAIN + TOPIC, reading=reading)) == 13.0
    assert {"constant `TOTAL`", "constant `TWICE`", "constant `MOST`"} <= set(computed)
    computed.clear()
    assert most(check_file(main, MAIN + TOPIC + "\n", reading=reading)) == 13.0
    assert "constant `MOST`" in computed
    assert not {"constant `TOTAL`", "constant `TWICE`"} & set(computed)


@pytest.mark.parametrize(
    ("file", "before", "after", "value"),
    [
        ("row.json", "3.0]", "40.0]", 87.0),
        ("base.soter", "sum + ROW[i]", "sum - ROW[i]", -11.0),
        ("middle.soter", "2.0 *", "3.0 *", 19.0),
    ],
)
def test_what_a_constant_is_made_of_is_looked_at_again(
    folder: Path, file: str, before: str, after: str, value: float
) -> None:
    reading, main = Overlay(lambda _: None), str(folder / "main.soter")
    assert most(check_file(main, MAIN, reading=reading)) == 13.0
    path = folder / file
    path.write_text(path.read_text().replace(before, after))
    assert most(check_file(main, MAIN, reading=reading)) == value
    assert most(check_file(main, MAIN)) == value


def test_what_is_remembered_counts_as_computed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reading, main = Overlay(lambda _: None), str(folder / "main.soter")
    assert most(check_file(main, MAIN, reading=reading)) == 13.0
    monkeypatch.setattr("soter.language.check.constants_and_types.CONSTANT_BUDGET", 3)
    again, anew = (check_file(main, MAIN, reading=r) for r in (reading, Overlay(lambda _: None)))
    told = [[(d.code, d.message) for d in c.diagnostics.items] for c in (again, anew)]
    assert told[0] == told[1]
    assert ("T020", "constant `TOTAL` takes too long to compute") in told[0]
