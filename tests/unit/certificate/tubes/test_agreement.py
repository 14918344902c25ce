"""The check that flies calls no estimate good that the re-checker's tube does not: a sample.

`bench/tubes/agreement.py` draws more of them.
"""

from __future__ import annotations

from bench.tubes.agreement import FOLLOW, Subject, agreement

from unit.certificate.tubes.test_forged_rest import LANE

WAYS = {"p.y": (-1.74, 1.74), "p.psi": (-0.2, 0.2)}


def test_what_the_check_of_a_train_calls_good_is_confirmed() -> None:
    found = agreement(Subject(FOLLOW.read_text("utf-8"), {"r.v": (-0.35, 0.35)}), 4, seed=3)
    assert found.good >= 3
    assert found.unconfirmed == 0


def test_what_the_check_of_a_lane_calls_good_is_confirmed() -> None:
    """Two states that are coupled, late commands, old reads; the last good ones on some lines."""
    subject = Subject(LANE, WAYS)
    for end in ([1.7, 0.0], [-0.9, -0.2]):
        estimate = subject.last_good([0.0, 0.0], end)
        assert subject.good(estimate)
        assert subject.confirmed(estimate)
    assert not subject.confirmed([1.7, 0.2])
