"""Random programs under a driver that chooses: the engines agree after every step.

Components fire in a random order at random times, and what they ask (`choose`, inputs,
disturbances, errors, starts) gets random answers: the C through `soter_answers`, the interpreter
through `AnsweredDraws`. Contracts, queues and latches are part of the compared states.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.any_order_driver import first_disagreement
from generators.engine_comparison import compile_library, subject
from generators.random_programs import program
from long_tests import examples, seeds

if TYPE_CHECKING:
    from pathlib import Path

CHUNKS = 4
EACH = examples(3)
STEPS = 400


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_the_engines_agree_in_any_order_with_any_answers(chunk: int, tmp_path: Path) -> None:
    numbers = list(seeds(30_000 + chunk, 30_000 + chunk + CHUNKS * EACH, CHUNKS))
    subjects = [subject(f"p{n}", program(n), n * 0x9E3779B97F4A7C15 % 2**56, 10) for n in numbers]
    library = compile_library(subjects, tmp_path, "-O1")
    for s in subjects:
        words = first_disagreement(s, library, STEPS)
        assert words is None, f"{s.name}: {words}\n{s.text}"
