"""A flight that breaks an assumption of its certificate is doubted, where its log shows that."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.certificate.extras.flight_assumptions import LoggedAssumptions
from soter.language.front_end import check_file, system_to_prove
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.system import System

MS = 1_000_000
TEXT = """soter 1;
topic pos: float max_age 100ms;
topic vel: float in [-9.0, 9.0] max_age 100ms;
topic u: float in [-1.0, 1.0];
plant P period 10ms {
  reads u; drives pos = x; drives vel = v;
  state x: float; state v: float;
  der x = v; der v = u;
}
node Fast period 20ms { publishes u; step { publish u = 1.0; } }
node Slow period 20ms {
  subscribes pos, vel; publishes u;
  step { publish u = clamp(-pos - vel, -1.0, 1.0); }
}
rta M {
  ac Fast; sc Slow; period 40ms;
  safe abs(pos) < 8.0;
  rest abs(pos) < 3.0 && abs(vel) < 2.0 within 9s;
  verify { late dm 1ms, sc 2ms; response dm 3ms, sc 4ms; DROPOUT }
}
system S { p: P; module M; }
system World deploys S {
  module M;
  external topic pos every 10ms delayed 2ms measured pos within 0.0;
  external topic vel every 30ms delayed 1ms measured vel within 0.0;
  external topic u;
}
"""
SENSORS = {"pos", "vel"}


def flat_of(system: str, dropout: str = "") -> System:
    checked = check_file("test.soter", TEXT.replace("DROPOUT", dropout))
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    return system_to_prove(checked, system)


class Log:
    """What a log holds: by topic times and values, the module's verdicts; to be changed."""

    def __init__(self, last_ms: int = 200, first_ms: int = 0, every_ms: int = 10) -> None:
        times = range(first_ms * MS, last_ms * MS + 1, every_ms * MS)
        self.messages = {name: dict.fromkeys(times, 1.0) for name in SENSORS}
        self.messages["u"] = {t * MS: -1.0 for t in range(0, last_ms + 1, 20)}
        self.verdicts = {t * MS: t >= 80 for t in range(0, last_ms + 1, 40)}
        self.last_ns = last_ms * MS

    def leave_out(self, name: str, *times_ms: int) -> None:
        for t in times_ms:
            del self.messages[name][t * MS]

    def doubts(self, flat: System) -> list[tuple[int, str]]:
        """Every doubt about it, by its time in ms."""
        (module,) = flat.modules
        assumed = LoggedAssumptions(flat, [module])
        every = {t for of in self.messages.values() for t in of} | self.verdicts.keys()
        for time_ns in sorted(every):
            for name, of in self.messages.items():
                if time_ns in of:
                    assumed.note_message(time_ns, name, of[time_ns])
            if time_ns in self.verdicts:
                assumed.note_verdict(time_ns, module, is_ac=self.verdicts[time_ns])
            assumed.end_instant(time_ns)
        assumed.end_log(self.last_ns)
        return [(d.time_ns // MS, d.reason) for d in assumed.doubts]


NEVER = "it is published every 10 ms, and sensors never drop out"
SC_SILENT = "SC published no u in time after its release"
TOO_LONG = "sensors are silent for 30 ms longer than that at most"


def nothing_until(log: Log, first_ms: int) -> None:
    log.leave_out("pos", *range(0, first_ms, 10))


def moved(log: Log, old_ms: int, new_ms: int) -> None:
    log.messages["u"][new_ms * MS] = log.messages["u"].pop(old_ms * MS)


def answered(log: Log, read_ms: int) -> None:
    """SC answers at 60 ms as if it had read what `vel` is at one time alone."""
    log.messages["vel"][read_ms * MS] = log.messages["u"][60 * MS] = -0.5


def late_verdict(log: Log, answered_ms: int = 40) -> None:
    log.verdicts[41 * MS] = log.verdicts.pop(40 * MS)
    log.messages["u"][26 * MS] = -1.0
    moved(log, 40, answered_ms)


def taken_over_late(log: Log, *answers_ms: int) -> None:
    """The DM gives control to SC 1 ms after its release of 120 ms, at which AC published."""
    del log.verdicts[120 * MS]
    log.verdicts |= dict.fromkeys((121 * MS, 160 * MS, 200 * MS), False)
    log.messages["u"] |= {t * MS: -1.0 for t in answers_ms}


BROKEN: dict[str, tuple[str, Callable[[Log], object], list[tuple[int, str]]]] = {
    "nothing": ("", lambda _: None, []),
    "one message": (
        "",
        lambda log: log.leave_out("pos", 50),
        [(40, f"nothing came of pos for 20 ms, {NEVER}")],
    ),
    "the first one": (
        "",
        lambda log: nothing_until(log, 20),
        [(0, f"nothing came of pos for 20 ms, {NEVER}")],
    ),
    "the last one": (
        "",
        lambda log: log.leave_out("vel", 190, 200),
        [(180, f"nothing came of vel for 20 ms, {NEVER}")],
    ),
    "as many as may be": ("dropout 30ms;", lambda log: log.leave_out("pos", 50, 60, 70), []),
    "one more": (
        "dropout 30ms;",
        lambda log: log.leave_out("pos", 50, 60, 70, 80),
        [(40, f"nothing came of pos for 50 ms, it is published every 10 ms, and {TOO_LONG}")],
    ),
    "between two releases": (
        "",
        lambda log: log.messages["vel"].update({57 * MS: 1.0}),
        [(57, "vel was published otherwise than once at a release of its plant")],
    ),
    "outside of its set": (
        "",
        lambda log: log.messages["vel"].update({50 * MS: 9.5}),
        [(50, "vel is 9.5, outside of its set [-9.0, 9.0]")],
    ),
    "a command outside of its set": (
        "",
        lambda log: log.messages["u"].update({100 * MS: -1.5}),
        [(100, "u is -1.5, outside of its set [-1.0, 1.0]")],
    ),
    "SC skips a release": ("", lambda log: log.leave_out("u", 20), [(20, SC_SILENT)]),
    # 1 ms late and 3 for the DM, 4 for itself
    "SC is as late as it may be": ("", lambda log: moved(log, 40, 48), []),
    "SC is later": ("", lambda log: moved(log, 40, 49), [(40, SC_SILENT)]),
    "SC is later where no verdict is due": ("", lambda log: moved(log, 20, 27), [(20, SC_SILENT)]),
    "SC does not wait for a verdict that is late": (
        "",
        late_verdict,
        [(40, "SC published u before the verdict of its release")],
    ),
    "SC of the release before is out while the DM is late": (
        "",
        lambda log: late_verdict(log, 43),
        [],
    ),
    "SC waits for a verdict that is late": ("", lambda log: taken_over_late(log, 123), []),
    "SC skips the release of a verdict that is late": ("", taken_over_late, [(120, SC_SILENT)]),
    "SC publishes what its step does not": (
        "",
        lambda log: log.messages["u"].update({20 * MS: -0.5, 60 * MS: 1.0, 100 * MS: 0.5}),
        [(t, "SC published u, which its step gives on nothing it may have read") for t in (20, 60)],
    ),
    "SC reads one topic before, and one after it has changed": (
        "",
        lambda log: answered(log, 60),
        [],
    ),
    "SC reads what was replaced long ago": (
        "",
        lambda log: answered(log, 30),
        [(60, "SC published u, which its step gives on nothing it may have read")],
    ),
    "AC publishes nothing": ("", lambda log: log.leave_out("u", 100, 120, 140), []),
}


@all_rows("name", BROKEN)
def test_a_log_that_breaks_an_assumption_is_doubted(name: str) -> None:
    dropout, change, doubts = BROKEN[name]
    log = Log()
    change(log)
    assert log.doubts(flat_of("S", dropout)) == doubts


@pytest.mark.parametrize(("system", "most"), [("S", 0), ("World", 31 * MS)])
def test_reads_of_one_verdict_are_no_further_apart_than_they_may_be(system: str, most: int) -> None:
    flat = flat_of(system)
    assumed = LoggedAssumptions(flat, list(flat.modules))
    for apart, doubts in ((most, 0), (most + 1, 1)):
        assert (
            len(list(assumed.why_not_one_instant({"pos": 40 * MS, "vel": 40 * MS + apart})))
            == doubts
        )
        assert (
            len(list(assumed.why_not_one_instant({"pos": 40 * MS + apart, "vel": 40 * MS})))
            == doubts
        )


def test_a_sensor_of_the_world_may_come_as_seldom_as_it_says() -> None:
    flat = flat_of("World")
    seldom = Log(first_ms=3, every_ms=12)
    seldom.messages["vel"] = dict.fromkeys(range(31 * MS, 200 * MS, 31 * MS), 1.0)
    assert seldom.doubts(flat) == []
    seldom.leave_out("vel", 62)
    assert [t for t, _ in seldom.doubts(flat)] == [31]


SENSED = TEXT.replace("drives vel = v;", "drives vel = v; drives twice = y; drives gust = w;")
SENSED = SENSED.replace(
    "state v: float;", "state v: float; let y = 2.0 * x; disturbance w: float in [-1.0, 1.0];"
)
SENSED = SENSED.replace("der v = u;", "der v = u; measured pos within 0.5;")
SENSED = SENSED.replace("subscribes pos, vel;", "subscribes pos, vel, twice, gust;")
SENSED = SENSED.replace(
    "topic u:", "topic twice: float max_age 1s; topic gust: float max_age 1s; topic u:"
)


@pytest.mark.parametrize(
    ("published", "said"),
    [
        ({"pos": 2.5, "vel": 1.0, "twice": 4.0, "gust": 7.0}, []),
        ({"pos": 2.6}, ["pos is 2.6 where the plant is at 2.0, measured within 0.5"]),
        ({"vel": 1.1}, ["vel is 1.1 where the plant is at 1.0, measured within 0.0"]),
        ({"twice": 4.5}, ["twice is 4.5 where the plant is at 4.0, measured within 0.0"]),
    ],
)
def test_a_sensor_that_errs_more_than_it_may_is_doubted(
    published: dict[str, float], said: list[str]
) -> None:
    """A simulation logs the states; what a plant makes of a disturbance cannot be compared."""
    checked = check_file("test.soter", SENSED.partition("system World")[0].replace("DROPOUT", ""))
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_to_prove(checked, "S")
    (plant,) = [c for c in flat.components if c.plant is not None]
    assumed = LoggedAssumptions(flat, list(flat.modules))
    for name, value in published.items():
        assumed.note_message(0, name, value)
    assumed.note_truth(0, plant, (2.0, 1.0))
    assumed.note_truth(10 * MS, plant, (50.0, 50.0))  # nothing was published then
    assert [d.reason for d in assumed.doubts] == said


def test_a_plant_publishes_once_at_a_release() -> None:
    flat = flat_of("S")
    assumed = LoggedAssumptions(flat, list(flat.modules))
    for _ in range(2):
        assumed.note_message(0, "pos", 1.0)
    twice = "pos was published otherwise than once at a release of its plant"
    assert [d.reason for d in assumed.doubts] == [twice]
