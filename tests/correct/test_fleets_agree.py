"""An array of instances means what it is written out as, in both engines.

A fleet is a program with parameters in every place where they may stand, set for instances, in
loops, with wires from one robot to the next; beside it stands the same with a declaration and a
number for each robot. Every state after every instant is the same, of interpreter and C of both.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.engine_comparison import (
    compile_library,
    first_difference,
    interpreted_trace,
    native_trace,
    subject,
)
from generators.random_fleets import fleet
from long_tests import examples, seeds

if TYPE_CHECKING:
    from pathlib import Path

FLEETS = examples(8)
CHUNKS = max(2, FLEETS // 6)
INSTANTS = 150


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_a_fleet_is_what_it_is_written_out_as(chunk: int, tmp_path: Path) -> None:
    numbers = seeds(chunk, FLEETS, CHUNKS)
    made = [fleet(seed) for seed in numbers]
    arrays = [
        subject(f"a{n}", f.array, n, INSTANTS, "Fleet") for n, f in zip(numbers, made, strict=True)
    ]
    plain = [
        subject(f"w{n}", f.written_out, n, INSTANTS) for n, f in zip(numbers, made, strict=True)
    ]
    library = compile_library([*arrays, *plain], tmp_path, "-O1")
    for array, out in zip(arrays, plain, strict=True):
        told = f"{array.text}\n{out.text}"
        expected = interpreted_trace(out)
        for name, trace in (
            ("array, interpreter", interpreted_trace(array)),
            ("array, C", native_trace(library, array)),
            ("written out, C", native_trace(library, out)),
        ):
            difference = first_difference(out, trace, expected)
            assert difference is None, f"{name}: {difference}\n{told}"
