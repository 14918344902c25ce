"""How long after a request without an answer SC stands in, against a clock tick by tick."""

from __future__ import annotations

import random
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import soter
from soter.language.front_end import check_file, system_of
from soter.targets.takeover_bounds import longest_turn, takeover_bounds

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

TEXT = """soter 1;
topic seen: float max_age 100ms;
topic u: float in [-1.0, 1.0];
extern node Fast period 10ms { subscribes seen; publishes u; }
node Slow period 20ms { subscribes seen; publishes u; step { publish u = 0.0; } }
plant World period 10ms { reads u; drives seen = s; state s: float; der s = u; }
rta M {
  ac Fast;
  sc Slow;
  period 40ms;
  safe abs(seen) < 9.0;
  ttf abs(seen) > 2.0;
  safer abs(seen) < 1.0;
  verify { grid seen in [-9.0, 9.0] / 90; late dm 1ms, sc 2ms; response dm 3ms, sc 4ms; }
}
system S { w: World; module M; until 1s; }
"""


def clock(period: int, phase: int) -> Any:
    return SimpleNamespace(period_ns=period, phase_ns=phase)


def by_the_clock(ac: Any, dm: Any, sc: Any) -> int:
    """The longest of all: a tick a time, AC's answers looked at first, then the DM, then SC."""
    longest = 0
    span = ac.period_ns * dm.period_ns * sc.period_ns
    for k in range(span // ac.period_ns + 2):
        asked = now = ac.phase_ns + k * ac.period_ns
        missed = decided = False
        while True:
            missed = missed or now == asked + ac.period_ns
            due = now >= dm.phase_ns and (now - dm.phase_ns) % dm.period_ns == 0
            decided = decided or (missed and due)
            due = now >= sc.phase_ns and (now - sc.phase_ns) % sc.period_ns == 0
            if decided and due:
                break
            now += 1
        longest = max(longest, now - asked)
    return longest


def test_the_longest_turn_is_that_of_a_clock_that_goes_tick_by_tick() -> None:
    chance = random.Random(7)  # noqa: S311
    later = 0
    for _ in range(300):
        periods = [chance.randint(1, 9) for _ in range(3)]
        ac, dm, sc = (clock(p, chance.choice((0, 0, chance.randint(0, 12)))) for p in periods)
        turn = longest_turn(ac, dm, sc)
        assert turn == by_the_clock(ac, dm, sc), (ac, dm, sc)
        later += turn > ac.period_ns + dm.period_ns
    assert later > 20, "SC's turn counts"


def test_what_is_too_long_to_go_through_has_a_bound_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chance = random.Random(8)  # noqa: S311
    for _ in range(100):
        three = [clock(chance.randint(1, 9), chance.randint(0, 12)) for _ in range(3)]
        exact = longest_turn(*three)
        with monkeypatch.context() as patch:
            patch.setattr("soter.targets.takeover_bounds.RELEASES_MAX", 0)
            assert longest_turn(*three) >= exact


def test_the_package_says_it_of_every_module_with_a_foreign_ac(tmp_path: Path) -> None:
    path = tmp_path / "watched.soter"
    path.write_text(TEXT)
    (takeover,) = takeover_bounds(system_of(check_file(str(path)), None))
    # asked at 0, not answered by 10; decided at 40; asked at 40, not answered by 50: decided at 80
    assert (takeover.turn, takeover.work) == (40_000_000, 8_000_000)
    package = soter.load(path).build("posix", tmp_path / "out")
    assert takeover.bound_text in package.notes
    own = TEXT.replace("extern node Fast", "node Fast").replace(
        "publishes u; }", "publishes u; step { publish u = 1.0; } }", 1
    )
    path.write_text(own)
    assert takeover_bounds(system_of(check_file(str(path)), None)) == []
