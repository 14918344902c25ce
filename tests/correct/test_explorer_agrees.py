"""Small random programs: the explorer and the brute-force enumerator say the same.

The enumerator walks over the reference interpreter and knows nothing of the explorer; see
tests/generators/brute_force.py. More programs: bench/testing_soundness.py.

    SOTER_EXPLORED_PROGRAMS=500 pytest tests/correct/test_explorer_agrees.py -n 2
    SOTER_EXPLORED_ONLY=17 pytest tests/correct/test_explorer_agrees.py       one, by its number
"""

from __future__ import annotations

import os

import pytest

from generators.agreement import compared, small
from generators.brute_force import BruteForce, TooLargeError

CHUNKS = 6
PROGRAMS = int(os.environ.get("SOTER_EXPLORED_PROGRAMS", "60"))
ONLY = os.environ.get("SOTER_EXPLORED_ONLY")
FAST = ("-O0",)


def seeds(chunk: int) -> list[int]:
    """The programs of one chunk."""
    if ONLY:
        return [int(ONLY)] if chunk == 0 else []
    return list(range(chunk, PROGRAMS, CHUNKS))


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_explorer_and_enumerator_agree(chunk: int) -> None:
    for seed in seeds(chunk):
        s = small(seed)
        if s is None:
            continue
        told = compared(s, FAST)
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])


def test_what_is_compared_determines_the_future() -> None:
    """Telling worlds apart by everything the interpreter knows finds nothing more."""
    for seed in range(40):
        s = small(seed, 1_500)
        if s is None:
            continue
        try:
            whole = BruteForce(s.system, whole=True).run(8_000)
        except TooLargeError:
            continue
        assert whole.configurations == s.found.configurations, s.text
        assert whole.observed == s.found.observed, s.text
        assert whole.least == s.found.least, s.text
