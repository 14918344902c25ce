"""What a run does with steps that take time is among what a test of the same system tries.

The run holds publications in a topic and draws times, the enumerator holds them beside the
configuration and tries times; where every step takes one time only, they can be compared.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest

from generators.brute_force import BruteForce, World
from generators.lasting_step_programs import lasting_program
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of, system_of_test
from soter.semantics.interpreter import Interpreter

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.language.model.types import Value
    from soter.semantics.configuration import Configuration
    from soter.semantics.run_record import Record

    Seen = tuple[int, tuple[Value, ...], tuple[int, ...]]

PROGRAMS = 48
CHUNKS = 4
MOST = 4_000
"""Worlds of one program."""


def one_time(text: str) -> str:
    """Every step takes its longest time; the test asks nothing."""
    text = re.sub(r"takes \[[^,]*, ([^\]]*)\]", r"takes [\1, \1]", text)
    head, mark, test = text.partition("test T {")
    items = [
        line
        for line in test.splitlines()
        if not re.match(r"  (always|never|eventually|.* leadsto) ?", line)
    ]
    return head + mark + "\n".join(items) + "\n"


def seen_of(system: System, c: Configuration, left: set[int]) -> Seen:
    """The time, the topics of the test that somebody drives there, the modes."""
    topics = tuple([v for i, v in enumerate(c.Topics) if i in left])
    return c.ct, topics, tuple([c.L[m.dm] for m in system.modules])


def tried(judge: BruteForce, left: set[int]) -> set[Seen] | None:
    """What of everything observable is seen; None where that is too much."""
    todo: list[World] = list(judge._births())
    known = set(todo)
    observations: set[Seen] = set()
    while todo:
        w = todo.pop()
        if judge.observable(w):
            observations.add(seen_of(judge.system, w.c, left))
        for move in judge.moves(w):
            for after, _ in judge.made(w, move):
                if after is not None and after not in known:
                    known.add(after)
                    todo.append(after)
        if len(known) > MOST:
            return None
    return observations


def compared(seed: int) -> int:
    """Runs of a program that were compared; 0 where it is refused or too large."""
    text = one_time(lasting_program(seed))
    if "takes" not in text or re.search(
        "^  (replace|set|input)", text.partition("test T")[2], re.MULTILINE
    ):
        return 0
    checked = check_file(f"p{seed}.soter", text)
    try:
        system, test = system_of(checked, "S"), system_of_test(checked, "T")
    except SoterError:
        return 0
    assert test.test is not None
    left = {t.index for t in test.topics if t.driver not in ("", "input")}
    left |= {d.topic for d in test.inputs}
    all_of_them = tried(BruteForce(test), left)
    if all_of_them is None:
        return 0
    for run in range(5):
        seen: list[Seen] = []

        def see(c: Configuration, record: Record, seen: list[Seen] = seen) -> None:
            if record.violations == 0:
                seen.append(seen_of(system, c, left))

        Interpreter(system, run).run(test.test.horizon_ns, see)
        for one in seen:
            assert one in all_of_them, f"{one}\nrun {run} of program {seed}:\n{text}"
    return 5


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_what_a_run_does_is_tried_by_a_test(chunk: int) -> None:
    assert sum(compared(seed) for seed in range(chunk, PROGRAMS, CHUNKS)) > 0
