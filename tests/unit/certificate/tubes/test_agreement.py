"""The check that flies calls no estimate good that the re-checker's tube does not: a sample.

Estimates of a module with `rest` are drawn, and between one that its generated check calls good and
one that it does not the last good one is looked for: where it is nearest to being wrong. The tube
in Arb (`certificate/tubes/`) is asked of every good one. More of them: `make soak`.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from long_tests import examples, seed_of
from soter.certificate.tubes.rest_problem import read_rest_problem
from soter.certificate.tubes.tube_chains import ModuleTube
from soter.language.front_end import check_file, system_to_prove
from soter.verify.deploy.missing_predicates import rest_claims
from soter.verify.problem.extract import extract
from soter.verify.tubes.generated_functions import Caller
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.tube_check import TubeCheck
from unit.certificate.tubes.test_forged_rest import LANE

if TYPE_CHECKING:
    from soter.verify.problem.problem import Interval

FOLLOW = Path(__file__).resolve().parents[4] / "examples" / "evidence" / "follow.soter"
FAR = 400.0
"""Where estimates of states without a set are drawn: between 0 and this."""
HALVINGS = 10


@dataclass
class Counts:
    """Estimates: called good, of these not confirmed; others, of these good by Arb."""

    good: int = 0
    unconfirmed: int = 0
    others: int = 0
    left_out: int = 0


class Subject:
    """A module by both: the check that flies, interpreted, and the re-checker's tube."""

    def __init__(self, text: str, ways: dict[str, tuple[float, float]] | None = None) -> None:
        """`ways`: Y, where it is not the one that `verify` finds; R007 as `verify`."""
        checked = check_file("module.soter", text)
        flat = system_to_prove(checked, next(iter(checked.systems)), {}, exact=False)
        module = flat.modules[0]
        problem = extract(flat, module)
        assert isinstance(problem, TubeProblem)
        check, names = TubeCheck(problem), [s.name for s in problem.quantities.states]
        if ways is None:
            found: dict[int, Interval] = rest_claims(check).ways
            ways = {names[s]: (r.low, r.high) for s, r in found.items()}
        of = {names.index(n): type(problem.states[0])(*r) for n, r in ways.items()}
        self.caller = Caller(check.text_in_flight(of))
        own = read_rest_problem(flat, module.name)
        states = [s.name for s in own.facts.states]
        self.arb = ModuleTube(own, {states.index(n): r for n, r in ways.items()})
        self.ranges = [problem.states[s] for s in check.states]
        assert self.arb.estimate_fields == [problem.leaf_of_state(s) for s in check.states]

    def good(self, estimate: list[float]) -> bool:
        """What the check says."""
        return self.caller.returns_true("good", estimate)

    def confirmed(self, estimate: list[float]) -> bool:
        """What the tube in Arb says."""
        return (
            self.arb.why_not_good(dict(zip(self.arb.estimate_fields, estimate, strict=True)))
            is None
        )

    def drawn(self, draw: random.Random) -> list[float]:
        """An estimate, anywhere in the sets of its states."""
        ends = [(r.low, r.high) if isfinite(r.high - r.low) else (0.0, FAR) for r in self.ranges]
        return [draw.uniform(*e) for e in ends]

    def last_good(
        self, good: list[float], bad: list[float], halvings: int = HALVINGS
    ) -> list[float]:
        """On the line between two the last one that the check calls good."""
        for _ in range(halvings):
            middle = [0.5 * (a + b) for a, b in zip(good, bad, strict=True)]
            if self.good(middle):
                good = middle
            else:
                bad = middle
        return good


def agreement(subject: Subject, count: int, seed: int) -> Counts:
    """Of so many drawn estimates, and the last good one on the way from each to the next."""
    draw, counts, before = random.Random(seed), Counts(), None  # noqa: S311
    for _ in range(count):
        estimate = subject.drawn(draw)
        said = subject.good(estimate)
        asked = [(estimate, said)]
        if before is not None and before[1] != said:
            ends = (estimate, before[0]) if said else (before[0], estimate)
            asked.append((subject.last_good(*ends), True))
        for e, is_good in asked:
            confirmed = subject.confirmed(e)
            if is_good:
                counts.good += 1
                counts.unconfirmed += not confirmed
                if not confirmed:
                    print("not confirmed:", e, flush=True)
            else:
                counts.others += 1
                counts.left_out += confirmed
        before = estimate, said
    return counts


WAYS = {"p.y": (-1.74, 1.74), "p.psi": (-0.2, 0.2)}


@pytest.mark.random
def test_what_the_check_of_a_train_calls_good_is_confirmed() -> None:
    subject, seed = Subject(FOLLOW.read_text("utf-8"), {"r.v": (-0.35, 0.35)}), seed_of(3)
    found = agreement(subject, examples(2), seed)
    assert found.good >= 2 or seed != 3, "what other seeds draw is not known"
    assert found.unconfirmed == 0


def test_a_check_that_says_too_much_is_seen(capsys: pytest.CaptureFixture[str]) -> None:
    subject = Subject(FOLLOW.read_text("utf-8"), {"r.v": (-0.35, 0.35)})
    subject.caller.returns_true = lambda *_: True  # type: ignore[method-assign]
    subject.ranges = [type(r)(low, low) for r, low in zip(subject.ranges, (2, 0, 30), strict=True)]
    found = agreement(subject, 1, seed=1)
    assert (found.good, found.unconfirmed) == (1, 1)
    assert "not confirmed" in capsys.readouterr().out


BENT = (
    LANE.replace("clamp(-0.1 * pose.y", "clamp(atan2(-0.1 * pose.y, 1.0)")
    .replace("psi = turn + wind", "psi = tan(turn) + 2500.0 * pow(wind, 3.0)")
    .replace("sin(psi) + slide", "sin(psi) + clamp(slide * slide * 20.0, 0.01, 0.04)")
)
"""The lane with a command and disturbances in which its rates are not affine."""


@pytest.mark.parametrize("text", [LANE, BENT], ids=["affine", "bent"])
def test_what_the_check_of_a_lane_calls_good_is_confirmed(text: str) -> None:
    """Two states that are coupled, late commands, old reads; the last good ones on some lines."""
    subject = Subject(text, WAYS)
    for end in ([1.7, 0.0], [-0.9, -0.2]):
        estimate = subject.last_good([0.0, 0.0], end, halvings=4)
        assert subject.good(estimate)
        assert subject.confirmed(estimate)
    assert not subject.confirmed([1.7, 0.2])
