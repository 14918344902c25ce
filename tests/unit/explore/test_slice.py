"""The steps of a trace that matter: whatever the others choose, it is violated all the same."""

from __future__ import annotations

from dataclasses import replace
from random import Random
from typing import TYPE_CHECKING

import pytest

from generators.programs_apart import program_apart
from generators.small_test_programs import small_program
from long_tests import examples, seeds
from soter.diagnostics.diagnostic import SoterError
from soter.explore.command import TraceHeader, explore_test
from soter.explore.engine.explorer_library import Engine
from soter.explore.engine.search import Search
from soter.explore.engine.shrink import Guided, steps_to_array
from soter.explore.search_options import SearchOptions
from unit.explore.explored_programs import CONTRACTS, FAULTS, QUEUED, STARTS, TESTED
from unit.explore.random_walks import system_of_text

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.explore.replay import Replayed
    from soter.language.model.system import System

TOLD = TraceHeader("small.soter", {})
PROGRAMS = examples(32)
TRIES = 40
TALK = """
soter 1;
topic a: bool;
topic b: bool;
topic n: int in [0, 3];
node Talks period 10ms { publishes a; step { publish a = choose bool; } }
node Other period 10ms { publishes b; step { publish b = choose bool; } }
node Counts period 10ms {
  subscribes b; publishes n;
  var k: int in [0, 3] = 0;
  step { if b { k = min(k + 1, 3); } publish n = k; }
}
system S { talks: Talks; other: Other; counts: Counts; until 1s; }
test Three { system S; horizon 200ms; never n == 3; }
"""


def violated(system: System, strategy: str, seed: int = 1) -> Replayed | None:
    """A violating trace as it was found, marked; None where there is none."""
    options = replace(SearchOptions(), strategy=strategy, minimise=0.0, runs=200, seed=seed)
    return explore_test(system, options, TOLD).replayed


class Chooser:
    """Runs a trace again with other choices in some of its steps."""

    def __init__(self, found: Replayed) -> None:
        self.found = found
        self.steps = found.trace.steps
        what = ("property", "contract", "fault", "timed").index(found.trace.broken.what)
        with Search(found.system, SearchOptions()) as search:
            self.raw = steps_to_array([search._raw_step(s) for s in self.steps])
        wanted = (what, found.trace.broken.index)
        self.guided = Guided(Engine(found.system), found.trace.seed, wanted)

    def stays(self, random: Random, *, matters: bool) -> bool:
        """With other choices in the steps that matter, or do not: something is violated by then."""
        wish = self.raw.copy()
        for k, s in enumerate(self.steps):
            if s.matters is matters:
                for i, c in enumerate(s.choices):
                    wish["choice"]["pick"][k, i] = random.randrange(c.of)
        made = self.guided.run(wish, len(wish))
        return made.violates or len(made.steps) < len(wish)

    @property
    def free(self) -> bool:
        return any(s.choices and not s.matters for s in self.steps)


def test_steps_of_actors_that_the_property_does_not_hear_of_do_not_matter() -> None:
    violation = violated(system_of_text(TALK, "Three"), "bfs")
    assert violation is not None
    *before, last = violation.steps
    assert last.matters  # there it is seen, whoever steps
    assert not any(s.matters for s in before if s.actor == "talks")
    counted = [s for s in before if s.matters and s.actor == "counts"]
    assert len(counted) == 3  # those that counted one more, of all that were made


@pytest.mark.parametrize("text", [TESTED, FAULTS, STARTS, CONTRACTS, QUEUED, TALK])
@pytest.mark.long
def test_what_does_not_matter_may_choose_otherwise(text: str) -> None:
    random = Random(1)  # noqa: S311 - no secret
    for name in (line.split()[1] for line in text.splitlines() if line.startswith("test ")):
        for strategy in ("bfs", "random"):
            violation = violated(system_of_text(text, name), strategy)
            if violation is None:
                continue
            again = Chooser(violation)
            assert all(again.stays(random, matters=False) for _ in range(TRIES)), name


@pytest.mark.long
@pytest.mark.parametrize("make", [small_program, program_apart])
@pytest.mark.random
def test_what_does_not_matter_may_choose_otherwise_in_random_programs(
    make: Callable[[int], str],
) -> None:
    free = removed = 0
    for number in seeds(PROGRAMS):
        try:
            system = system_of_text(make(number), "T")
        except (SoterError, AssertionError):
            continue
        violation = violated(system, "random", number + 1)
        if violation is None:
            continue
        again, random = Chooser(violation), Random(number)  # noqa: S311 - the same
        for _ in range(TRIES):
            assert again.stays(random, matters=False), number
        free += again.free
        removed += not all(again.stays(random, matters=True) for _ in range(TRIES))
    assert free > 0
    assert removed > 0


def test_marks_are_kept_in_the_file(tmp_path: object) -> None:
    from pathlib import Path

    from soter.explore.trace import read_trace, write_trace

    violation = violated(system_of_text(TALK, "Three"), "bfs")
    assert violation is not None
    path = write_trace(violation.trace, Path(str(tmp_path)) / "t.trace.json")
    assert [s.matters for s in read_trace(path).steps] == [s.matters for s in violation.trace.steps]
    old = path.read_text("utf-8").replace(', "matters": true', "").replace(', "matters": false', "")
    assert "matters" not in old
    path.write_text(old, "utf-8")
    assert {s.matters for s in read_trace(path).steps} == {None}
