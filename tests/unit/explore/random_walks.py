"""Random executions of tests, made by the brute-force enumerator: nothing of `explore/` steps here.

Purpose: traces for tests of replay, traces with and without violations.
Non-goals: coverage, speed.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from generators.brute_force import Answers, BruteForce
from soter.explore.trace import BEGIN, EFFECT, LOST, START, STEP, Choice, Step, Trace
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from soter.language.model.system import System
    from soter.semantics.configuration import Configuration

KINDS = {"step": STEP, "lost": LOST, "begins": BEGIN, "effect": EFFECT}


def system_of_text(text: str, test: str, name: str = "small.soter") -> System:
    """The flattened system of a test of a program given as text."""
    checked = check_file(name, text)
    assert checked.ok, [f"{d.code} {d.message}" for d in checked.diagnostics.items]
    return system_of_test(checked, test)


def system_of_path(path: Path, test: str) -> System:
    """The flattened system of a test of a program in a file."""
    return system_of_test(check_file(str(path)), test)


@dataclass
class _Recording(Answers):
    """Answers that also remember who asked."""

    asked: list[tuple[str, int, int]] = field(default_factory=list)

    def choice(self, stream: str, index: int, count: int) -> int:
        pick = super().choice(stream, index, count)
        if count > 1:
            self.asked.append((stream, pick, count))
        return pick

    def all_ways(self, run: Callable[[], Any]) -> Iterator[Any]:
        picks: list[int] | None = []
        while picks is not None:
            self.picks, self.counts, self.asked = picks, [], []
            yield run()
            picks = self._next()


@dataclass
class Walk:
    """An execution and what the enumerator says of its end.

    `topics`, `configurations`: after every step.
    """

    trace: Trace
    broken: tuple[str, int] | None
    topics: list[tuple[Any, ...]]
    configurations: list[Configuration]


def walk(system: System, seed: int, longest: int = 10_000) -> Walk:
    """A random execution up to the first violation, or to its end."""
    rng = random.Random(seed)  # noqa: S311 - a test
    brute = BruteForce(system)
    eager = [rng.choice((1.0, 0.001)) for _ in brute.actors]  # some come as late as they may
    answers = _Recording()
    brute.answers = answers
    brute.machine.draws = answers
    configuration, asked = rng.choice([(w, list(answers.asked)) for w in brute._births()])
    steps = [Step("", START, -1, -1, _choices(asked, ""))]
    there = [configuration.c]
    broken: tuple[str, int] | None = None
    while broken is None and len(steps) < longest:
        moves = list(brute.moves(configuration))
        if not moves:
            break
        (move,) = rng.choices(moves, [eager[m.actor] for m in moves])
        actor = brute.actors[move.actor]
        drive = actor.kind == "input"
        ways = [(w, b, list(answers.asked)) for w, b in brute.made(configuration, move)]
        after, broken, asked = rng.choice(ways)
        release = actor.phase + configuration.done[move.actor] * actor.period
        name = (
            f"input.{system.topics[system.inputs[actor.index].topic].name}"
            if drive
            else system.components[actor.index].name
        )
        if move.kind in ("effect", "lost"):
            asked = []
        picks = _choices(asked, "input." if drive else "")
        steps.append(Step(name, KINDS[move.kind], release, move.time, picks))
        if after is not None:
            configuration = after
            there.append(configuration.c)
            broken = next(iter(brute._judged(configuration, _Nothing())), None)  # type: ignore[arg-type]
    return Walk(_trace(system, broken, steps), broken, [c.Topics for c in there], there)


class _Nothing:
    """Where the enumerator would note what it observed."""

    observed: set[object] = set()  # noqa: RUF012 - thrown away


def _choices(asked: list[tuple[str, int, int]], prefix: str) -> tuple[Choice, ...]:
    return tuple(Choice(f"{prefix}{stream}", pick, of) for stream, pick, of in asked)


def _trace(system: System, broken: tuple[str, int] | None, steps: list[Step]) -> Trace:
    from soter.explore.replay import find_violation_id

    assert system.test is not None
    anything = [("property", 0), ("contract", 0), ("timed", 0)]
    named = next(
        filter(None, (find_violation_id(system, *b) for b in ([broken] if broken else anything)))
    )
    return Trace(
        program=system.program.path,
        sha256=system.program.sha256,
        system=system.name,
        test=system.test.name,
        params={},
        seed=0,
        skew_ns=system.test.skew_ns,
        horizon_ns=system.test.horizon_ns,
        broken=named,
        steps=tuple(steps),
        minimal=False,
    )
