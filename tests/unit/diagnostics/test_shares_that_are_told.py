"""How far work is: a part of a whole, stages of it, nobody who listens, and who ends it."""

from __future__ import annotations

import pytest

from soter.diagnostics.current_phase import (
    CancelledError,
    between,
    cancelled_when,
    share_done,
    shares_to,
    whole_shares_to,
)


def test_a_part_of_a_part_is_told_as_a_share_of_the_whole_and_never_falls() -> None:
    said: list[float] = []
    with whole_shares_to(said.append):
        for k in range(2):
            with between(k / 2, (k + 1) / 2), between(0.0, 0.5):
                for share in (0.5, 0.25, 1.0):
                    share_done(share)
        share_done(1.0)
    share_done(0.0)
    assert said == [0.125, 0.125, 0.25, 0.625, 0.625, 0.75, 1.0]


def test_stages_are_equal_parts_and_others_are_told_by_name() -> None:
    said: list[tuple[float, str]] = []
    with shares_to(lambda *x: said.append(x)), between(0.0, 1.0, ("core", "way")):
        for stage in ("core", "way", "core", "else"):
            share_done(0.5, stage)
    assert said == [(0.25, ""), (0.75, ""), (0.75, ""), (0.5, "else")]
    shares: list[float] = []
    with whole_shares_to(shares.append):
        share_done(0.5, "core")
        with whole_shares_to(None):
            share_done(0.5)
        with shares_to(None):
            share_done(1.0)
    assert shares == [0.5]


def test_who_says_how_far_it_is_learns_that_nobody_waits() -> None:
    said: list[float] = []
    with whole_shares_to(said.append), cancelled_when(lambda: len(said) > 1):
        share_done(0.1)
        share_done(0.2)
        with pytest.raises(CancelledError), between(0.5, 1.0):
            share_done(0.3)
    assert said == [0.1, 0.2]
