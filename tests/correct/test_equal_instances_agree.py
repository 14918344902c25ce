"""Equal instances: as many configurations are stored as there are orbits, and nothing is missed.

The orbits are counted over the configurations of the brute-force enumerator, with instances
swapped by their names; see tests/generators/symmetry_agreement.py. More programs:
bench/testing/soundness.py --equal.

    SOTER_EQUAL_PROGRAMS=300 pytest tests/correct/test_equal_instances_agree.py -n 2
"""

from __future__ import annotations

import pytest

from generators.equal_instance_programs import equal_instances
from generators.explorer_agreement import small
from generators.symmetry_agreement import compared_as_equals
from long_tests import examples

PROGRAMS = examples("SOTER_EQUAL_PROGRAMS", quick=12, long=108)
CHUNKS = 6 if PROGRAMS >= 36 else 2
MOST = 2_500
FAST = ("-O0",)


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_equal_instances_are_stored_once(chunk: int) -> None:
    equal = 0
    for seed in range(chunk, PROGRAMS, CHUNKS):
        s = small(seed, MOST, equal_instances)
        if s is None:
            continue
        told = compared_as_equals(s, FAST)
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])
        equal += bool(told.equal)
    assert equal >= 2, "programs of which hardly any has equal instances show nothing"


@pytest.mark.long
def test_orbits_are_counted() -> None:
    """Of some programs there is more to say than the verdict."""
    counted = 0
    for seed in range(3000, 3012):
        s = small(seed, MOST, equal_instances)
        told = None if s is None else compared_as_equals(s, FAST)
        counted += told is not None and 0 < told.stored < told.whole
    assert counted >= 2
