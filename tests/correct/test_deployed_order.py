"""`order deployed;` of a test: the explorer and the brute-force enumerator say the same."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from generators.explorer_agreement import compared, enumerated, small
from generators.programs_apart import program_apart
from generators.programs_in_instants import program_in_instants, program_joined
from generators.small_test_programs import small_program
from long_tests import examples, seeds
from soter.explore.engine.explorer_library import Engine, EngineSettings

if TYPE_CHECKING:
    from collections.abc import Callable

PROGRAMS = examples(3)
MAKERS = (program_in_instants, program_joined, program_apart, small_program)


def ordered(make: Callable[[int], str]) -> Callable[[int], str]:
    """The same programs; those in which a step may be late are refused then (E017)."""
    return lambda seed: make(seed).replace("test T {", "test T { order deployed; ", 1)


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.random
def test_explorer_and_enumerator_agree_on_the_deployed_order(make: Callable[[int], str]) -> None:
    seen = fewer = 0
    for seed in seeds(PROGRAMS * 20):
        s = small(seed, make=ordered(make))
        if s is None:
            continue
        told = compared(s, ("-O0",))
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])
        free = small(seed, make=make)
        seen += 1
        fewer += free is None or s.found.configurations < free.found.configurations
        if seen >= PROGRAMS:
            break
    assert seen >= PROGRAMS // 2
    assert fewer


WRITER_FIRST = """soter 1;
topic x: int in [0, 9];
topic y: int in [0, 9];
node A period 10ms { publishes x; var n: int in [0, 9]; step { n = min(n + 1, 9); publish x = n; } }
node B period 10ms { subscribes x; publishes y; step { publish y = x; } }
system S { node A; node B; }
test T { system S; %s horizon 30ms; always y == x; }
"""


@pytest.mark.parametrize("strategy", ["bfs", "random", "falsify"])
def test_what_only_another_order_violates_is_not_found(strategy: str) -> None:
    for said, wanted in (("", True), ("order deployed;", False)):
        s = enumerated(0, WRITER_FIRST % said)
        assert bool(s.found.least) == wanted
        engine = Engine(s.system)
        how = EngineSettings(strategy=strategy, reduction="all", runs=200)
        exploration = engine.explore(how)
        engine.close()
        assert (exploration.status == "violated") == wanted, (strategy, said, exploration.status)
