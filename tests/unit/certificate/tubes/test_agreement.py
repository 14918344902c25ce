"""The check that flies calls no estimate good that the re-checker's tube does not: a sample.

More of them: `make soak`.
"""

from __future__ import annotations

import pytest

from generators.tube_agreement import FOLLOW, Subject, agreement
from long_tests import examples, seed_of
from unit.certificate.tubes.test_forged_rest import LANE

WAYS = {"p.y": (-1.74, 1.74), "p.psi": (-0.2, 0.2)}


@pytest.mark.random
def test_what_the_check_of_a_train_calls_good_is_confirmed() -> None:
    subject, seed = Subject(FOLLOW.read_text("utf-8"), {"r.v": (-0.35, 0.35)}), seed_of(3)
    found = agreement(subject, examples(2), seed)
    assert found.good >= 2 or seed != 3, "what other seeds draw is not known"
    assert found.unconfirmed == 0


def test_a_check_that_says_too_much_is_seen(capsys: pytest.CaptureFixture[str]) -> None:
    subject = Subject(FOLLOW.read_text("utf-8"), {"r.v": (-0.35, 0.35)})
    subject.caller.holds = lambda *_: True  # type: ignore[method-assign]
    subject.ranges = [type(r)(low, low) for r, low in zip(subject.ranges, (2, 0, 30), strict=True)]
    found = agreement(subject, 1, seed=1)
    assert (found.good, found.unconfirmed) == (1, 1)
    assert "not confirmed" in capsys.readouterr().out


def test_what_the_check_of_a_lane_calls_good_is_confirmed() -> None:
    """Two states that are coupled, late commands, old reads; the last good ones on some lines."""
    subject = Subject(LANE, WAYS)
    for end in ([1.7, 0.0], [-0.9, -0.2]):
        estimate = subject.last_good([0.0, 0.0], end, halvings=4)
        assert subject.good(estimate)
        assert subject.confirmed(estimate)
    assert not subject.confirmed([1.7, 0.2])
