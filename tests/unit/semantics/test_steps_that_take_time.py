"""Steps that take time: when publications count, which releases are lost, what a stamp says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.semantics.configuration import AC, NEVER, SC
from soter.semantics.draws import draw_bits

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.semantics.configuration import Configuration
    from soter.semantics.interpreter import Interpreter
    from soter.semantics.run_record import Record

    Build = Callable[..., Interpreter]

MS = 1_000_000
SLOW = """
topic n: int in [0, 1000];
topic seen: int in [0, 1000];
topic old: float in [0.0, 1000000000000.0];
node Slow period 10ms phase 2ms {
  publishes n;
  takes [%s];
  var k: int in [0, 1000];
  guarantees n == 0 || age(n) == 0.0;
  step { k = k + 1; publish n = k; }
}
node Look period 1ms {
  subscribes n;
  publishes seen, old;
  step { publish seen = n; publish old = n == 0 ? 0.0 : age(n); }
}
system S { node Slow; node Look; until 100ms; }
"""


def instants(it: Interpreter) -> list[tuple[int, Configuration, int]]:
    """(time, configuration, violations) of every instant."""
    rows: list[tuple[int, Configuration, int]] = []

    def see(c: Configuration, record: Record) -> None:
        rows.append((c.ct, c, record.violations))

    it.run(observe=see)
    return rows


def changes(it: Interpreter, topic: str) -> list[tuple[int, object]]:
    """When a topic was published, and what."""
    index = it.system.topic(topic).index
    publications: list[tuple[int, object]] = []
    for time, c, _ in instants(it):
        if c.stamps[index] == time:
            publications.append((time, c.Topics[index]))
    return publications


def test_what_a_step_publishes_counts_when_its_time_is_over(build: Build) -> None:
    it = build(SLOW % "3ms, 3ms")
    assert changes(it, "n")[:3] == [(5 * MS, 1), (15 * MS, 2), (25 * MS, 3)]


def test_an_instant_comes_where_nothing_is_released(build: Build) -> None:
    it = build(SLOW % "3500us, 3500us")
    assert changes(it, "n")[0] == (5_500_000, 1)


def test_releases_of_a_node_that_is_busy_are_lost(build: Build) -> None:
    it = build(SLOW % "25ms, 25ms")
    assert changes(it, "n") == [(27 * MS, 1), (57 * MS, 2), (87 * MS, 3)]


def test_a_release_at_which_a_step_ends_is_not_lost(build: Build) -> None:
    it = build(SLOW % "20ms, 20ms")
    assert changes(it, "n")[:3] == [(22 * MS, 1), (42 * MS, 2), (62 * MS, 3)]


def test_the_age_of_a_topic_counts_from_when_it_took_effect(build: Build) -> None:
    it = build(SLOW % "3ms, 3ms")
    index = it.system.topic("old").index
    ages = {time: c.Topics[index] for time, c, _ in instants(it)}
    assert ages[5 * MS] == 0.0
    assert ages[9 * MS] == 0.004


def test_times_are_drawn_from_the_seed_release_by_release(build: Build) -> None:
    it = build(SLOW % "1ms, 9ms", seed=7)
    at = [time for time, _ in changes(it, "n")]
    drawn = [draw_bits(7, "Slow.takes", k) % (8 * MS + 1) + 1 * MS for k in range(10)]
    assert at == [2 * MS + 10 * MS * k + drawn[k] for k in range(10) if at[k:]]


def test_guarantees_are_judged_as_if_a_step_counted_at_once(build: Build) -> None:
    assert all(violations == 0 for _, _, violations in instants(build(SLOW % "25ms, 25ms")))
    never = build(SLOW.replace("age(n) == 0.0", "n != 2") % "3ms, 3ms")
    first = next(time for time, _, violations in instants(never) if violations)
    assert first == 12 * MS


def test_a_step_that_publishes_nothing_takes_its_time_as_well(build: Build) -> None:
    it = build((SLOW % "25ms, 25ms").replace("publish n = k;", "if k != 1 { publish n = k; }"))
    assert changes(it, "n") == [(57 * MS, 2), (87 * MS, 3)]


def test_queues_get_what_a_step_published_when_it_counts(build: Build) -> None:
    text = SLOW.replace("subscribes n;", "subscribes n queue 3;").replace(
        "publish seen = n; publish old = n == 0 ? 0.0 : age(n);",
        "for m in n { publish seen = m; } publish old = 0.0;",
    )
    it = build(text % "3ms, 3ms")
    assert changes(it, "seen")[:2] == [(5 * MS, 1), (15 * MS, 2)]


def test_a_fault_counts_at_once_and_the_node_latches(build: Build) -> None:
    text = SLOW.replace("takes", "failsafe n = 9; takes").replace("k = k + 1;", "assert k > 5;")
    it = build(text % "3ms, 3ms")
    assert changes(it, "n")[0] == (2 * MS, 9)
    assert all(c.latched[0] for time, c, _ in instants(it) if time >= 2 * MS)


MODULE = """
input topic x: float in [-9.0, 9.0];
topic u: float in [-1.0, 1.0];
node Ac period 10ms { subscribes x; publishes u; takes [%s]; step { publish u = %s; } }
node Sc period 10ms { publishes u; step { publish u = 0.0; } }
rta M { ac Ac; sc Sc; period 20ms; clean 1; safe true; ttf x > 1.0; safer x < 1.0; }
system S { module M; until 1s; }
"""


def drive(it: Interpreter, values: dict[int, float], until: int) -> list[tuple[int, Configuration]]:
    """Instants up to `until`, with x set at these times."""

    def given(c: Configuration) -> list[tuple[int, float]]:
        return [(0, values[c.ct])] if c.ct in values else []

    c, record, configurations = it.initial(), it.record(), []
    while c.ct < until:
        c = it.instant(c, choose_input=given, record=record)
        configurations.append((c.ct, c))
    return configurations


def test_an_ac_that_lost_control_meanwhile_publishes_nothing(build: Build) -> None:
    it = build(MODULE % ("10ms, 10ms", "0.5"))
    u = it.system.topic("u").index
    seen = dict(drive(it, {35 * MS: 2.0, 40 * MS: 2.0}, 70 * MS))
    assert seen[30 * MS].Topics[u] == 0.5  # of the step at 20 ms
    assert seen[40 * MS].Topics[u] == 0.0  # the decision came first: SC, and 0.5 reaches nobody
    assert seen[50 * MS].Topics[u] == 0.0


def test_a_step_that_began_without_control_publishes_nothing(build: Build) -> None:
    it = build(MODULE % ("10ms, 10ms", "0.5"))
    u, ac = it.system.topic("u").index, it.system.modules[0].ac
    seen = dict(drive(it, {0: 2.0, 20 * MS: 0.0}, 60 * MS))
    assert seen[20 * MS].OE[ac]  # decided before the step of 10 ms ends
    assert seen[20 * MS].Topics[u] == 0.0
    assert seen[30 * MS].Topics[u] == 0.5


def test_a_gate_fault_counts_at_once_and_the_step_takes_its_time(build: Build) -> None:
    it = build(MODULE % ("10ms, 10ms", "x + 5.0"))
    seen = dict(drive(it, {}, 60 * MS))
    held = next(c.held for c in it.system.components if c.held is not None)
    assert seen[0].stamps[held] == 10 * MS
    assert seen[0].gate_fault == (True,)
    assert [seen[t * MS].L[0] for t in (0, 20, 40)] == [AC, SC, SC]


@pytest.mark.parametrize("low", ["3ms", "1ms"])
def test_nothing_is_held_when_no_step_lasts(build: Build, low: str) -> None:
    it = build(SLOW % f"{low}, 3ms")
    held = it.system.topic("Slow.held")
    for time, c, _ in instants(it):
        if (time - 2 * MS) % (10 * MS) >= 3 * MS or time < 2 * MS:
            assert c.stamps[held.index] == NEVER
            assert c.Topics[held.index] == held.default
