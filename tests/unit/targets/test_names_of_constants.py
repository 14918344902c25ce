"""A number that the source names has that name in the generated C, too."""

from __future__ import annotations

import pytest

from soter.codegen.unit import generate
from soter.language.front_end import check_file, system_of

TEXT = """soter 1;
const WALL: float = 10.0;
const LOW: float = -3.0;
const COUNT: int = 7;
const while_: float = 4.0;
param GAIN: float = 2.0 in [1.0, 3.0];
topic x: float in [-100.0, 100.0] = 0.0;
node N period 10ms {
  publishes x;
  var n: int in [0, 9] = 0;
  step {
    n = min(n + 1, COUNT);
    publish x = WALL - LOW + GAIN * float(n) + while_;
  }
}
system S { node N; until 1s; }
"""


def source(**values: float) -> str:
    checked = check_file("named.soter", TEXT)
    assert checked.ok, checked.diagnostics.items
    return generate(system_of(checked, None, values)).source


@pytest.mark.parametrize(
    "line",
    [
        "#define named_WALL 10.0",
        "#define named_LOW (-3.0)",
        "#define named_COUNT 7",
        "#define named_GAIN 2.0",
        "named_WALL - named_LOW + named_GAIN * ",
    ],
)
def test_a_number_has_its_name(line: str) -> None:
    assert line in source()


def test_each_name_is_defined_once() -> None:
    defined = [line.split()[1] for line in source().split("\n") if line.startswith("#define")]
    assert len(defined) == len(set(defined)) == 5


def test_the_value_of_a_parameter_is_the_one_that_was_given() -> None:
    assert "#define named_GAIN 2.5" in source(GAIN=2.5)
