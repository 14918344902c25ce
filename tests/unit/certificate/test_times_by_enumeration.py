"""Times of small settings beside a plain second definition, which looks at every nanosecond."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace
from math import lcm
from types import SimpleNamespace
from typing import Any

import pytest

from soter.certificate.extras.maps import require_instants_of_map
from soter.certificate.reading import derived_times
from soter.certificate.reading.derived_times import (
    Clock,
    Effect,
    TimingSetting,
    TopicPath,
    TopicReading,
    check_runs_do_not_overlap,
    derive_times,
    releases_in_hyperperiod,
)
from soter.certificate.report import NotRecheckedError
from tables import all_rows

LATER = 200
"""Everything has begun."""


def is_release(of: Clock, time: int) -> bool:
    """Whether it is due then, as if it had always run."""
    return (time - of.phase) % of.period == 0


def first_from(of: Clock, time: int) -> int:
    return next(t for t in itertools.count(max(time, of.phase)) if is_release(of, t))


def last_until(of: Clock, time: int) -> int:
    return next(t for t in itertools.count(time, -1) if is_release(of, t))


def start_of(s: TimingSetting, t: int) -> int:
    """The latest: late, or waiting for the verdict of every DM that was due."""
    verdicts = [
        due + s.dm.late + s.dm.response for due in range(s.dm.phase, t + 1) if is_release(s.dm, due)
    ]
    return max([t + s.sc.late, *verdicts])


class Defaults(TopicPath):
    """Shows what was made of a default before it shows a state, and a state that is older."""

    def may_publish_nothing(self, silent: int = 0) -> bool:
        del silent
        return True

    def longest_lag(self, silent: int) -> int:
        return 2 + silent


class Missed(Effect):
    """Acts at once only on what is published in the instant of its release."""

    def latest_action(self, published: int, *, at_once: bool) -> int:
        return published + self.most + (0 if at_once else 1)


def act_of(s: TimingSetting, release: int, start: int) -> int:
    published = start + s.sc.response
    missed = published != release
    return published + max(e.most + (isinstance(e, Missed) and missed) for e in s.effects)


def defined(s: TimingSetting) -> dict[str, Any]:
    """All times, from what they mean."""
    whole = lcm(*(c.period for c in s.clocks))
    steady = [t for t in range(LATER, LATER + whole) if is_release(s.sc, t)]
    age = age_sc = delay = jitter = 0
    stamps = {r.name: 0 for r in s.by_sc}
    if s.instants:
        stamps = {}
    else:
        lags = [
            r.max_age + (2 + s.silent if isinstance(p, Defaults) else 0)
            for r in s.by_dm
            for p in r.paths
        ]
        age = max(lags, default=0)
        for t in steady:
            end = start_of(s, t)
            delay = max(delay, act_of(s, t, end) - end)
            for r, time in itertools.product(s.by_sc, range(t, end + 1)):
                for path in r.paths:
                    old = time - last_until(path.sensor, time)
                    stamps[r.name] = max(stamps[r.name], old)
                    age_sc = max(age_sc, old + s.silent)
                    delay = max(delay, act_of(s, t, time) - time + old + s.silent)
        jitter = max(act_of(s, t, start_of(s, t)) - t for t in steady)
        jitter -= min(e.least for e in s.effects)

    def there(reads: Any, silent: int) -> list[int]:
        return [p.sensor.phase + silent for r in reads for p in r.paths]

    def acts_from(time: int) -> int:
        release = first_from(s.sc, time)
        return act_of(s, release, start_of(s, release))

    known = [r.name for r in s.by_dm]
    others = there([r for r in s.by_sc if r.name not in known], s.silent)
    waits = [
        acts_from(max([t + s.dm.period, *others])) - t
        for t in range(s.dm.phase, LATER + whole)
        if is_release(s.dm, t)
    ]
    h_0 = acts_from(max([0, *there(s.by_sc, 0)]))
    said = [  # "AC" on a default is in force until the next one is due
        due + s.dm.period
        for certain in (
            p.sensor.phase + s.silent for r in s.by_dm for p in r.paths if isinstance(p, Defaults)
        )
        for due in range(s.dm.phase, certain)
        if is_release(s.dm, due)
    ]
    start = acts_from(max([0, *there(s.by_sc, s.silent), *said]))
    return {
        "age": age,
        "age_sc": age_sc,
        "delay": delay,
        "jitter": jitter,
        "stamps": stamps,
        "h_star": age + max(waits),
        "h_0": h_0,
        "start": max(start, h_0),
    }


def runs(s: TimingSetting) -> bool:
    """Whether every run of a node is over when its next one is due."""
    if any(c.late + c.response > c.period for c in s.clocks) or s.sc.period > s.dm.period:
        return False
    whole = lcm(*(c.period for c in s.clocks))
    return s.instants or all(
        start_of(s, t) + s.sc.response <= t + s.sc.period
        for t in range(LATER, LATER + whole)
        if is_release(s.sc, t)
    )


def drawn(dice: random.Random) -> TimingSetting:
    def clock(name: str, *periods: int, slow: int = 2) -> Clock:
        period = dice.choice(periods)
        times = dice.choice((0, dice.randrange(9))), dice.randint(0, slow), dice.randint(0, slow)
        return Clock(name, period, *times)

    def sensor() -> TopicPath:
        kind = dice.choice((TopicPath, Defaults))
        return kind(Clock("sensor", dice.choice((1, 2, 3, 4, 5)), dice.randrange(12)))

    reads = [
        TopicReading(n, tuple(sensor() for _ in range(dice.choice((1, 1, 2)))), dice.randrange(9))
        for n in "xy"
    ]
    effects = []
    for _ in range(dice.choice((1, 1, 2))):
        least = dice.choice((0, 1, 2))
        effects.append(dice.choice((Effect, Missed))(least, least + dice.choice((0, 1, 3))))
    return TimingSetting(
        clock("the DM", 4, 6, 8),
        clock("SC", 2, 3, 4, 6, slow=1),
        tuple(dice.sample(reads, dice.choice((0, 1, 1, 2)))),
        tuple(dice.sample(reads, dice.choice((0, 1, 2, 2)))),
        tuple(effects),
        dice.choice((0, 0, 3)),
        dice.random() < 0.1,
    )


def test_times_are_what_they_are_defined_to_be() -> None:
    dice, fine = random.Random(23), 0  # noqa: S311 - no secret
    for _ in range(150):
        setting = drawn(dice)
        if runs(setting):
            fine += 1
            found = derive_times(setting)
            wanted = defined(setting)
            assert {key: getattr(found, key) for key in wanted} == wanted, setting
        else:
            with pytest.raises(NotRecheckedError):
                check_runs_do_not_overlap(setting)
    assert 40 < fine < 140


def test_a_clock_is_due_at_its_releases() -> None:
    for period, phase, time in itertools.product((1, 2, 5), (0, 1, 4, 7), range(-8, 12)):
        clock = Clock("c", period, phase)
        assert clock.next_release(time) == first_from(clock, time)
        assert clock.last_release(time) == last_until(clock, time)
        for end, other in itertools.product(range(time - 1, time + 7), (0, 3)):
            times = [t for t in range(time, end) if (t - other) % period == 0]
            assert list(clock.times_at_phase(time, end, other)) == times
    assert Clock("c", 9, late=2, response=3).max_delay == 5
    assert Clock("c", 9) == Clock("c", 9, 0, 0, 0)
    assert list(releases_in_hyperperiod(Clock("c", 2), [3])) == [0, 2, 4]


def test_a_read_is_oldest_before_a_publication() -> None:
    for period, phase, start, end in itertools.product((1, 3, 4), (0, 2), range(5), range(5, 9)):
        path = TopicPath(Clock("s", period, phase))
        ages = {t: t - last_until(path.sensor, t) for t in range(start, end + 1)}
        assert {t: t - path.oldest_stamp(t) for t in ages} == ages
        assert {t: t - path.oldest_state(t) for t in ages} == ages
        turns = list(path.age_peaks(start, end))
        assert set(turns) <= set(ages)
        assert max(ages[t] for t in turns) == max(ages.values())
        assert turns == [t for t in range(start, end) if ages[t] == period - 1] + [end]
        assert path.clocks == (path.sensor,)
        assert path.certain_since() == phase
        for silent in (0, 5):
            assert path.longest_lag(silent) == 0
            assert path.certain_since(silent) == phase + silent
            assert path.may_publish_nothing(silent) is False


def test_an_output_acts_between_its_bounds() -> None:
    effect = Effect(2, 5)
    for at_once in (True, False):
        assert (effect.earliest_action(7), effect.latest_action(7, at_once=at_once)) == (9, 12)
    assert effect.clocks == ()
    assert (Effect().least, Effect().most) == (0, 0)
    plain = TimingSetting(Clock("the DM", 4), Clock("SC", 4), (), ())
    assert (plain.silent, plain.instants, plain.effects) == (0, False, (Effect(),))


def test_as_many_releases_as_are_gone_through(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = Clock("c", 2, 1)
    assert list(releases_in_hyperperiod(clock, [3, 4], after=6)) == [7, 9, 11, 13, 15, 17]
    for most in (5, 6, 7):
        monkeypatch.setattr(derived_times, "RELEASES_MAX", most)
        if most >= 6:
            assert len(list(releases_in_hyperperiod(clock, [3, 4]))) == 6
        else:
            with pytest.raises(NotRecheckedError, match="6 releases"):
                releases_in_hyperperiod(clock, [3, 4])


def test_as_many_releases_of_the_dm_as_are_gone_through(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = TimingSetting(Clock("the DM", 4), Clock("SC", 4), (), ())
    assert derive_times(plain).h_star == 4  # settled after 16: so 1 + 4 + 1 releases
    for most in (1, 2, 3):
        monkeypatch.setattr(derived_times, "RELEASES_MAX", most)
        if most == 3:
            derive_times(plain)
        else:
            with pytest.raises(NotRecheckedError, match="DM has too many"):
                derive_times(plain)


def test_a_run_may_last_until_the_next_one_is_due() -> None:
    for late, response in ((0, 4), (2, 2), (3, 2), (0, 5)):
        dm = Clock("the DM", 8)
        setting = TimingSetting(dm, Clock("SC", 4, 0, late, response), (), ())
        slow = Clock("the DM", 4, 0, late, response)
        for s in (setting, replace(setting, dm=slow, sc=Clock("SC", 4))):
            if late + response <= 4:
                check_runs_do_not_overlap(s)
            else:
                with pytest.raises(NotRecheckedError, match="may not be over"):
                    check_runs_do_not_overlap(s)
    for period in (3, 4, 5):
        s = TimingSetting(Clock("the DM", 4), Clock("SC", period), (), ())
        if period <= 4:
            check_runs_do_not_overlap(s)
        else:
            with pytest.raises(NotRecheckedError, match="slower"):
                check_runs_do_not_overlap(s)
    for response in (1, 2, 3):
        s = TimingSetting(Clock("the DM", 8, 0, 1, 1), Clock("SC", 4, 0, 0, response), (), ())
        if response <= 2:
            check_runs_do_not_overlap(s)
        else:
            with pytest.raises(NotRecheckedError, match="may not be done"):
                check_runs_do_not_overlap(s)


# ---------------------------------------------------------------- beside a map


def map_setting(**more: Any) -> tuple[Any, Any]:
    """Facts with two maps, and a setting that is fine beside them."""
    sensor = Clock("s", more.pop("sensor", 10), more.pop("sensor_phase", 0))
    nodes: tuple[Clock, ...] = more.pop("follows", ())

    class Path(TopicPath):
        @property
        def clocks(self) -> tuple[Clock, ...]:
            return (self.sensor, *nodes)

    behind: tuple[Clock, ...] = more.pop("behind", ())

    class Behind(Effect):
        @property
        def clocks(self) -> tuple[Clock, ...]:
            return behind

    age = more.pop("age", 5)
    steps = more.pop("steps", (10, 10))
    least, most = more.pop("acts", (0, 0))
    plain = TopicReading("y", (TopicPath(Clock("s", 10)),), 5)
    read = TopicReading("x", (Path(sensor),), age)
    reads: dict[str, Any] = {"by_dm": (plain,), "by_sc": (plain, read)}
    if more.pop("dm_reads", False):
        reads = {"by_dm": (read,), "by_sc": (plain,)}
    clocks = {name: Clock(name, *more.pop(name, (20, 0, 0, 0))) for name in ("dm", "sc")}
    setting = TimingSetting(
        clocks["dm"],
        clocks["sc"],
        effects=(Effect(), Behind(least, most)),
        instants=True,
        **reads,
        **more,
    )
    return SimpleNamespace(plants=[SimpleNamespace(period_ns=ns) for ns in steps]), setting


@all_rows("dm_reads", [False, True])
@all_rows(
    ("more", "why"),
    [
        ({}, ""),
        ({"sensor": 5, "age": 4}, ""),
        ({"age": 9}, ""),
        ({"dm": (40, 10, 0, 0)}, ""),
        ({"steps": (10, 20)}, "different periods"),
        ({"steps": (10, 5)}, "different periods"),
        ({"dm": (25, 0, 0, 0)}, "step together"),
        ({"sc": (25, 0, 0, 0)}, "step together"),
        ({"dm": (20, 5, 0, 0)}, "step together"),
        ({"sc": (20, 5, 0, 0)}, "step together"),
        ({"dm": (20, 0, 1, 0)}, "delays"),
        ({"dm": (20, 0, 0, 1)}, "delays"),
        ({"sc": (20, 0, 1, 0)}, "delays"),
        ({"sc": (20, 0, 0, 1)}, "delays"),
        ({"acts": (0, 1)}, "delays"),
        ({"acts": (1, 0)}, "delays"),
        ({"silent": 1}, "dropout"),
        ({"follows": (Clock("n", 10),)}, "nodes between"),
        ({"behind": (Clock("n", 10),)}, "nodes between"),
        ({"sensor_phase": 10}, "does not publish whenever"),
        ({"sensor": 20, "age": 5}, "does not publish whenever"),
        ({"sensor": 4, "age": 3}, "does not publish whenever"),
        ({"age": 10}, "shorter than its period"),
        ({"age": 11}, "shorter than its period"),
    ],
)
def test_what_stands_beside_a_map(more: dict[str, Any], why: str, dm_reads: bool) -> None:
    facts, setting = map_setting(**more, dm_reads=dm_reads)
    if why:
        with pytest.raises(NotRecheckedError, match=why):
            require_instants_of_map(facts, setting)
    else:
        require_instants_of_map(facts, setting)
