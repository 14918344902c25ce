"""Chunks of actions over a clock that the test owns."""

from __future__ import annotations

import pytest

from soter.remote.robot import Chunk, Player

MS = 10**6
EVERY = 20 * MS


class Clock:
    """Says what it was told."""

    def __init__(self) -> None:
        self.now = 1000 * MS

    def __call__(self) -> int:
        return self.now


class Written:
    """What was written, in ms since the clock's start: (stamp, action)."""

    def __init__(self) -> None:
        self.all: list[tuple[int, bytes]] = []

    def __call__(self, stamp_ns: int, image: bytes) -> None:
        self.all.append((stamp_ns // MS - 1000, image))


class Played:
    """A player without its thread: time passes when the test says so."""

    def __init__(self) -> None:
        self.clock, self.written = Clock(), Written()
        self.player = Player(self.clock)
        self.player._thread = self.player  # type: ignore[assignment]  # nobody else plays

    def begin(self, actions: str, start: int = 0, measured: int | None = None) -> None:
        images = [a.encode() for a in actions]
        stamp = None if measured is None else (1000 + measured) * MS
        chunk = Chunk(images, (1000 + start) * MS, EVERY, stamp)
        self.player.begin_chunk("wish", chunk, self.written)

    def at(self, ms: int) -> int | None:
        """Time is `ms`; when something is due again."""
        self.clock.now = (1000 + ms) * MS
        wake = self.player.write_due_actions(self.clock.now)
        return None if wake is None else wake // MS - 1000


@pytest.fixture
def played() -> Played:
    return Played()


def test_each_action_is_written_at_its_time_and_once(played: Played) -> None:
    played.begin("abc")
    assert played.written.all == [(0, b"a")]
    assert [played.at(ms) for ms in (0, 5, 19, 20, 21, 39)] == [20, 20, 20, 40, 40, 40]
    assert played.written.all == [(0, b"a"), (20, b"b")]
    assert played.at(40) is None
    assert played.written.all[2:] == [(40, b"c")]


def test_after_the_last_action_nothing_is_written_any_more(played: Played) -> None:
    played.begin("ab")
    assert played.at(20) is None
    before = list(played.written.all)
    assert [played.at(ms) for ms in (40, 60, 1000, 100_000)] == [None] * 4
    assert played.written.all == before == [(0, b"a"), (20, b"b")]


def test_the_next_chunk_replaces_what_is_left(played: Played) -> None:
    played.begin("abcd")
    played.at(20)
    played.clock.now = 1030 * MS
    played.begin("xy", start=30)
    assert [played.at(ms) for ms in (40, 50, 60, 80)] == [50, None, None, None]
    assert played.written.all == [(0, b"a"), (20, b"b"), (30, b"x"), (50, b"y")]


def test_no_actions_end_what_is_played(played: Played) -> None:
    played.begin("abcd")
    played.begin("")
    assert played.at(20) is None
    assert played.written.all == [(0, b"a")]


def test_something_else_ends_what_is_played(played: Played) -> None:
    played.begin("abcd")
    played.player.write_instead("wish", lambda: played.written(1010 * MS, b"!"))
    assert played.at(20) is None
    assert played.written.all == [(0, b"a"), (10, b"!")]


def test_actions_whose_time_has_passed_are_left_out(played: Played) -> None:
    played.begin("abcde", start=-50)
    assert played.written.all == [(-10, b"c")], "its slot is from -10 to 10"
    assert played.at(75) is None
    assert played.written.all == [(-10, b"c")], "d and e had their time from 10 to 50"


def test_a_player_that_is_late_makes_nothing_up(played: Played) -> None:
    played.begin("abcdef")
    assert played.at(65) == 80
    assert played.written.all == [(0, b"a"), (60, b"d")]


def test_a_chunk_that_is_over_when_it_comes_is_silent(played: Played) -> None:
    played.begin("abc", start=-60)
    assert played.written.all == []
    assert played.at(0) is None


def test_a_chunk_may_begin_later(played: Played) -> None:
    played.begin("ab", start=30)
    assert [played.at(ms) for ms in (0, 29)] == [30, 30]
    assert played.written.all == []
    assert played.at(30) == 50
    assert played.written.all == [(30, b"a")]


def test_all_actions_may_say_when_their_observation_was_measured(played: Played) -> None:
    played.begin("ab", measured=-7)
    played.at(20)
    assert played.written.all == [(-7, b"a"), (-7, b"b")]


def test_topics_are_played_beside_each_other(played: Played) -> None:
    other = Written()
    played.begin("ab")
    chunk = Chunk([b"1", b"2", b"3"], 1005 * MS, 10 * MS)
    played.player.begin_chunk("arm", chunk, other)
    assert [played.at(ms) for ms in (5, 15, 20, 25)] == [15, 20, 25, None]
    assert other.all == [(5, b"1"), (15, b"2"), (25, b"3")]
    assert played.written.all == [(0, b"a"), (20, b"b")]
