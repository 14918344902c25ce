"""Equal instances: as many configurations are stored as there are orbits, and nothing is missed.

The orbits are counted over the configurations of the brute-force enumerator, with instances
swapped by their names; see tests/generators/symmetry_agreement.py. More programs: `make soak`.
"""

from __future__ import annotations

import pytest

from generators.equal_instance_programs import equal_instances
from generators.explorer_agreement import enumerated, small
from generators.symmetry_agreement import compared_as_equals
from long_tests import examples, seeds

PROGRAMS = examples(12)
CHUNKS = 6 if PROGRAMS >= 36 else 2
MOST = 2_500
FAST = ("-O0",)


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_equal_instances_are_stored_once(chunk: int) -> None:
    equal = 0
    for seed in seeds(chunk, PROGRAMS, CHUNKS):
        s = small(seed, MOST, equal_instances)
        if s is None:
            continue
        told = compared_as_equals(s, FAST)
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])
        equal += bool(told.equal)
    assert equal >= 2, "programs of which hardly any has equal instances show nothing"


LATCHED = """soter 1;
topic u : int in [0, 1];
input topic button : bool max_age 20ms;
node A period 10ms { publishes u; step { publish u = 1; } }
node C period 10ms { publishes u; step { publish u = 0; } }
rta M { ac A; sc C; period 10ms; safe true; ttf false; safer true; returns after button; }
system R { module M; input button every 10ms; }
system S { r[0]: R; r[1]: R; }
test T { system S; horizon 10ms; always mode(r[0].M) == Mode.SC || mode(r[1].M) == Mode.SC; }
"""


@pytest.mark.whole
def test_equal_instances_with_latches_are_stored_once() -> None:
    told = compared_as_equals(enumerated(0, LATCHED, 50_000), FAST)
    assert not told.complaints, told.complaints
    assert told.equal == (("r[0]", "r[1]"),)
    assert told.stored < told.whole


@pytest.mark.long
def test_orbits_are_counted() -> None:
    """Of some programs there is more to say than the verdict."""
    counted = 0
    for seed in range(3000, 3012):
        s = small(seed, MOST, equal_instances)
        told = None if s is None else compared_as_equals(s, FAST)
        counted += told is not None and 0 < told.stored < told.whole
    assert counted >= 2
