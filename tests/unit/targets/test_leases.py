"""Leases: the C of the actuators and of who gives leases, against definitions and brute force."""

from __future__ import annotations

import re
from random import Random
from typing import TYPE_CHECKING

import pytest
from bench.real_time.delays import (
    AC,
    LAW,
    SC,
    Delay,
    Flown,
    Node,
    Timing,
    fly,
    shipped,
    stop_flights,
)
from bench.real_time.delays import STOP as STOP_MODULE
from bench.real_time.lease_code import Grant, Lease

import soter
from generators.c_packages import EXAMPLES, command, package
from long_tests import examples, seed_of
from soter.language.front_end import check_file, system_of
from soter.native.compiler import STANDARD, WARNINGS, find_compiler
from soter.native.shared_library import CHECK_FAILED, RUNTIME
from soter.targets.late_limits import age_limits
from soter.targets.leases import lease_times
from soter.verify.problem.extract import extract
from soter.verify.problem.schedule import ActuationPath, Releases, Schedule
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

STOP = EXAMPLES / "wall" / "stop.soter"
FILTERED = """soter 1;
topic raw: float in [-1.0, 1.0] max_age 20ms;
topic clean: float in [-1.0, 1.0] max_age 40ms;
topic u: float in [-1.0, 1.0] = 0.0;
node Filter period 10ms { subscribes raw; publishes clean; step { publish clean = raw; } }
node F period 10ms { publishes u; step { publish u = 1.0; } }
node S period 10ms { subscribes clean; publishes u; step { publish u = -clean; } }
rta M { ac F; sc S; period 20ms; safe clean < 0.9; ttf clean > 0.5; safer clean < 0.4; }
system Vehicle { external topic raw; external topic u; node Filter; module M; }
"""
ALIKE = """soter 1;
topic x: float in [0.0, 1.0] max_age 20ms;
topic u: float in [0.0, 1.0] = 0.0;
topic y: float in [0.0, 1.0] max_age 20ms;
topic w: float in [0.0, 1.0] = 0.0;
node F period 10ms { subscribes x; publishes u; step { publish u = x; } }
node S period 10ms { subscribes x; publishes u; step { publish u = x; } }
node G period 10ms { subscribes y; publishes w; step { publish w = y; } }
node T period 10ms { subscribes y; publishes w; step { publish w = y; } }
rta b { ac F; sc S; period 20ms; safe x < 0.9; ttf x > 0.5; safer x < 0.4; failsafe u = 0.0; }
rta a_b { ac G; sc T; period 20ms; safe y < 0.9; ttf y > 0.5; safer y < 0.4; failsafe w = 0.0; }
system Part { external topic x; external topic u; module b; }
system V default { external topic y; external topic w; a: Part; module a_b; }
"""
FACTORS = (None, 0.5, 0.99, 1.0, 1.01, 2.0, 10.0, float("inf"))


# ---------------------------------------------------------------- the actuator side


class Written:
    """The lease as docs/semantics.md has it, in Python."""

    def __init__(self, longest: int) -> None:
        self.longest, self.seen = longest, -(10**9)
        self.command, self.held = LAW, (-1, -1)
        self.armed, self.over = True, False

    def _at(self, now: int) -> int:
        self.seen = max(self.seen, now)
        if not self.armed and self.seen > self.held[1]:
            self.over = True
        return self.seen

    def take(self, now: int, value: float, stamp: int, expiry: int) -> bool:
        time = self._at(now)
        last, until = (0, -(10**9)) if self.armed else self.held
        fits = max(last, 0) <= stamp <= time <= expiry and until <= expiry <= stamp + self.longest
        if self.over or not fits:
            return False
        self.command, self.held, self.armed = value, (stamp, expiry), False
        return True

    def read(self, now: int) -> tuple[bool, float]:
        self._at(now)
        holds = not self.armed and not self.over
        return holds, self.command if holds else LAW

    def arm(self) -> None:
        self.armed, self.over = True, False


@all_rows("seed", range(20))
def test_actuators_obey_what_is_written(seed: int) -> None:
    chance = Random(seed)  # noqa: S311 - a test
    c, written = Lease(LAW, 7), Written(7)
    now = taken = ended = 0
    for k in range(600):
        now += chance.choice((0, 0, 1, 1, 2, 5, -3))
        what = chance.random()
        if what < 0.6:
            stamp = now - chance.randint(-1, 6)
            given = (now, float(k + 3), stamp, stamp + chance.randint(2, 9))
            got = c.take(*given)
            assert got == written.take(*given), given
            taken += got
        elif what < 0.65:
            c.arm()
            written.arm()
        reading = c.read(now)
        assert reading == written.read(now)
        ended += not reading[0]
    assert taken > 20
    assert ended > 20


def test_what_comes_late_does_not_renew_a_lease_and_a_clock_that_steps_back_does_not_either() -> (
    None
):
    lease = Lease(LAW, 10)
    assert lease.read(0) == (False, LAW)
    assert lease.take(5, SC, 4, 14)
    assert lease.read(14) == (True, SC)
    assert lease.read(15) == (False, LAW)
    assert lease.read(3) == (False, LAW), "the clock stepped back"
    assert not lease.take(3, AC, 4, 14)
    assert not lease.take(16, AC, 14, 24), "too late, by one instant"
    lease.arm()
    assert lease.read(16) == (False, LAW), "armed, and nobody has spoken"
    assert lease.take(16, SC, 14, 24)
    assert lease.read(24) == (True, SC)


def test_a_lease_that_is_too_long_too_old_or_from_the_future_is_not_taken() -> None:
    lease = Lease(LAW, 10)
    assert not lease.take(5, SC, 4, 15)
    assert not lease.take(5, SC, -6, 4)
    assert not lease.take(5, SC, 6, 14)
    assert lease.take(5, SC, 4, 14)
    assert not lease.take(6, AC, 3, 13), "older than the one in force"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("state", 0), ("state", 77), ("stamp", -1), ("stamp", 6)),
        *(("until", 15), ("until", 2**63 - 1)),
    ],
)
def test_a_lease_that_was_overwritten_is_none(field: str, value: int) -> None:
    """The law, and nothing is taken until somebody arms it; the process goes on."""
    lease = Lease(LAW, 10)
    assert lease.take(5, SC, 4, 14)
    setattr(lease.c, field, value)
    assert lease.read(5) == (False, LAW)
    assert not lease.take(5, AC, 5, 15)
    lease.arm()
    assert lease.take(5, SC, 5, 15)


@pytest.mark.parametrize(
    ("stamp", "expiry", "begin", "answer"),
    [
        (14, 24, 24, 0),
        (16, 24, 24, 0),
        (14, 16, 16, 0),
        (14, 24, 15, 2),
        (14, 24, -1, 2),
        (14, 15, 24, 1),
        (17, 24, 24, 1),
        (-1, 9, 24, 1),
        (14, 25, 24, 1),
    ],
    ids=[
        "in force",
        "just given",
        "at its end",
        "begun too late",
        "no state to begin from",
        "over",
        "from the future",
        "none was heard",
        "too long",
    ],
)
def test_what_may_be_armed_is_taken_at_that_instant_and_nothing_else_is(
    stamp: int, expiry: int, begin: int, answer: int
) -> None:
    lease = Lease(LAW, 10)
    assert lease.take(5, SC, 4, 14)
    assert lease.read(16) == (False, LAW), "ended"
    assert lease.may_arm(16, stamp, expiry, begin) == answer
    assert not lease.take(16, SC, stamp, expiry), "asking arms nothing"
    lease.arm()
    assert lease.take(16, SC, stamp, expiry) == (answer in {0, 2})


# ---------------------------------------------------------------- who gives leases


def schedules(count: int, seed: int) -> Iterator[tuple[Schedule, Timing, Random]]:
    """Small schedules in which outputs of SC do not meet (R015), with all kinds of times."""
    chance = Random(seed)  # noqa: S311 - a test
    while count:
        delta = chance.randint(2, 12)
        own = chance.randint(1, delta)
        dm = Releases(delta, 0, chance.randint(0, delta // 3), chance.randint(0, delta // 3))
        phase, late = chance.randint(0, own - 1), chance.randint(0, own // 2)
        sc = Releases(own, phase, late, chance.randint(0, own // 3))
        schedule = Schedule(dm, sc, (), (), (ActuationPath(0, chance.randint(0, 2)),))
        if not schedule.are_windows_short:
            continue
        nodes = tuple(
            Node(n, r.period, r.phase, r.late, r.response) for n, r in (("dm", dm), ("sc", sc))
        )
        acts = schedule.outputs[0].most
        yield (
            schedule,
            Timing(nodes, 0, schedule.h_star, acts, schedule.lease, schedule.start),
            chance,
        )
        count -= 1


def due_by(schedule: Schedule, release: int) -> int:
    """SC's response after its latest start: J_sc late, or when the last DM's verdict is out."""
    dm, sc = schedule.dm, schedule.sc
    waited = release - (release - dm.phase) % dm.period + dm.latest if dm.phase <= release else 0
    return max(release + sc.late, waited) + sc.response


def test_due_and_the_longest_lease_are_those_of_the_proof() -> None:
    longest = 0
    for schedule, timing, _ in schedules(200, 1):
        grant, reached = Grant([(n.period, n.phase, n.late, n.response) for n in timing.nodes]), 0
        for k in range(60):
            release = schedule.sc.phase + k * schedule.sc.period
            assert grant.due(1) == due_by(schedule, release)
            reached = max(reached, grant.due(1) - release + schedule.sc.period)
            grant.done(1, release, release)
        assert reached == schedule.lease, "reached, never exceeded"
        longest = max(longest, schedule.lease)
    assert longest > 12


def test_an_sc_that_overtakes_a_dm_that_hangs_gets_no_more_leases() -> None:
    grant = Grant([(50, 0, 0, 40), (10, 0, 0, 1)])
    assert grant.done(0, 0, 3)
    for t in range(0, 50, 10):
        start = max(t, 3)  # it waits for the verdict
        assert grant.done(1, start, start + 1)
        assert grant.lease(start + 1) is not None
    assert not grant.done(1, 50, 51), "the verdict of 50 is not out"
    assert grant.lease(51) is None


def test_an_sc_that_starts_before_the_verdict_is_out_was_not_done() -> None:
    grant = Grant([(50, 0, 0, 40), (10, 0, 0, 1)])
    assert grant.done(0, 0, 30)
    assert not grant.done(1, 5, 6)


def test_times_that_no_difference_holds_break_the_grant_and_nothing_else() -> None:
    grant = Grant([(50, 0, 0, 40), (10, 0, 0, 1)])
    assert not grant.done(0, -(2**63), 2**63 - 1)
    assert grant.lease(1) is None


@pytest.mark.parametrize("origin", [1, 12345, 10**15, -7])
def test_a_new_origin_moves_every_time_and_nothing_else(origin: int) -> None:
    for _, timing, chance in schedules(60, 5):
        budgets = [(n.period, n.phase, n.late, n.response) for n in timing.nodes]
        one, other = Grant(budgets), Grant(budgets, origin)
        for k in range(40):
            node, late = chance.randint(0, 1), chance.choice((0, 0, 0, 1, 2))
            start = one.due(node) - timing.nodes[node].response - chance.randint(0, 1) + late
            assert other.due(node) == one.due(node) + origin
            done = one.done(node, start, start)
            assert other.done(node, start + origin, start + origin) == done
            leases = one.lease(start + k % 3), other.lease(start + k % 3 + origin)
            if leases[0] is None:
                assert leases[1] is None
            else:
                assert leases[1] == tuple(t + origin for t in leases[0])


def outcome(timing: Timing, delay: Delay | None, chance: Random, *, watchdog: bool) -> Flown:
    switch, often = chance.randint(0, 24 * timing.nodes[0].period), chance.choice((0.0, 0.0, 0.5))

    def says_ac(_: Flown, start: int) -> bool:
        return (start < switch) != (chance.random() < often)

    until = 20 * timing.nodes[0].period
    return fly(timing, until, delay, says_ac, chance, watchdog=watchdog)


@pytest.mark.random
def test_in_time_or_the_law_before_h_runs_out() -> None:
    """No third outcome, and none of the bounds is longer than it has to be."""
    kept = lawful = tight = fed = 0
    cases = examples(1_500)
    for _, timing, chance in schedules(cases, seed_of(2)):
        factor = chance.choice(FACTORS)
        node = chance.choice((0, 1))
        delay = None if factor is None else Delay(node, factor, chance.randint(0, 8))
        seed = chance.getrandbits(64)
        same, again = Random(seed), Random(seed)  # noqa: S311 - a test
        flight = outcome(timing, delay, same, watchdog=False)
        if factor is None or factor <= 1.0:
            assert flight.kept, (timing, delay, flight)
            kept += 1
            continue
        assert flight.safe, (timing, delay, flight)
        lawful += 1
        tight += bool(flight.law) and flight.law == flight.deadline
        fed += not outcome(timing, delay, again, watchdog=True).safe
    assert min(kept, lawful) > cases // 4
    assert tight > lawful // 10, "H is used to its end"
    assert fed > lawful // 2, "a watchdog that is fed by late outputs never bites"


FLIGHTS = examples(1)


@pytest.mark.long
def test_flights_of_the_emergency_stop_stay_between_the_walls_with_leases_only() -> None:
    timing = dict(shipped())[STOP_MODULE]
    assert isinstance(timing, Timing)
    assert stop_flights(timing, FLIGHTS, Random(3), watchdog=False) == (12 * FLIGHTS, 0)  # noqa: S311 - a test
    assert stop_flights(timing, FLIGHTS, Random(3), watchdog=True)[1] > 0  # noqa: S311 - a test


def test_times_of_the_package_are_those_of_the_proof() -> None:
    for name in ("wall/stop", "wall/cart", "wall/lift", "generality/drag", "drone/battery"):
        checked = check_file(str(EXAMPLES / f"{name}.soter"))
        flat = system_of(checked, None)
        for module in flat.modules:
            times = extract(flat, module).times
            timing = lease_times(flat, module)
            assert timing.longest == times.schedule.lease
            dm, sc = timing.budgets[:2]
            assert (dm.late, dm.response) == (times.late_dm, times.response_dm)
            assert (sc.late, sc.response) == (times.late_sc, times.response_sc)


def test_nodes_between_sensors_and_module_are_watched() -> None:
    flat = system_of(check_file(str(EXAMPLES / "drone" / "battery.soter")), None)
    watched = {b.name: b.latest for b in lease_times(flat, flat.modules[0]).budgets[2:]}
    assert {n.rpartition(".")[2] for n in watched} == {"Order", "Reserve"}
    assert set(watched.values()) == {2_000_000}


@pytest.mark.parametrize(
    ("said", "most_ms"), [("", 20), ("dropout 15ms;", 35), ("age 12ms;", 12), ("age 90ms;", 20)]
)
def test_sc_may_read_what_is_as_old_as_its_proof_says(
    tmp_path: Path, said: str, most_ms: int
) -> None:
    text = (EXAMPLES / "wall" / "cart.soter").read_text()
    assert "    acts within 1ms;" in text
    more = f"    acts within 1ms; {said}"
    (tmp_path / "cart.soter").write_text(text.replace("    acts within 1ms;", more))
    world = EXAMPLES / "wall" / "cart_firmware.soter"
    (tmp_path / world.name).write_text(world.read_text())
    flat = system_of(check_file(str(tmp_path / world.name)), None)
    (age,) = age_limits(flat, flat.modules[0])
    assert flat.topics[age.topic].name == "cart.motion"
    assert flat.components[age.component].role == "sc"
    assert age.most_ns == most_ms * 1_000_000
    proved = system_of(check_file(str(tmp_path / "cart.soter")), "Protected")
    assert age_limits(proved, proved.modules[0]) == (), "plants say when"


def test_nodes_before_sc_may_not_read_what_is_too_old_either(tmp_path: Path) -> None:
    (tmp_path / "p.soter").write_text(FILTERED)
    flat = system_of(check_file(str(tmp_path / "p.soter")), None)
    age_by_reader = {
        (flat.components[a.component].name, flat.topics[a.topic].name): a.most_ns
        for a in age_limits(flat, flat.modules[0])
    }
    ms = 1_000_000
    assert age_by_reader == {("M.S", "clean"): 40 * ms, ("Filter", "raw"): 20 * ms}


# ---------------------------------------------------------------- what is emitted

MAIN = """
#include "stop.h"
#include "stop_lease.h"
#include <stdio.h>

static stop_state state;
static int64_t done[2];

/* One start of the trusted part, killed after `steps` releases of SC: its first mode. */
static int run(soter_lease* lease, int64_t from, int steps) {
  soter_grant grant;
  soter_start(&stop_program, &state, 1);
  const int mode = (int)soter_modules_of(&stop_program, &state)->mode;
  soter_grant_begin(&grant, &stop_Guard_grant, done, from);
  stop_Guard_command command = {1.0};
  int64_t stamp, expiry;
  if (soter_grant_lease(&grant, from, &stamp, &expiry)) { return -1; } /* SC has not spoken yet */
  for (int k = 0; k < steps; k++) {
    const int64_t t = from + k * INT64_C(10000000);
    if (k % 5 == 0) { (void)soter_grant_done(&grant, stop_Guard_node_Guard_dm, t, t); }
    (void)soter_grant_done(&grant, stop_Guard_node_Guard_Stop, t, t + 1000000);
    if (!soter_grant_lease(&grant, t + 1000000, &stamp, &expiry)) { return -2; }
    if (!soter_lease_take(lease, t + 1000000, &command, stamp, expiry)) { return -3; }
  }
  return mode;
}

static void show(soter_lease* lease, int64_t now) {
  stop_Guard_command held = {9.0};
  const int obeys = soter_lease_read(lease, now, &held);
  printf("%d %g\\n", obeys, held.speed);
}

int main(void) {
  soter_lease lease;
  stop_Guard_command room;
  soter_lease_init(&lease, &stop_Guard_lease, &room);
  show(&lease, 0);
  const int first = run(&lease, 0, 10); /* the last lease: of 90 ms, until 103 ms */
  show(&lease, 103000000);
  show(&lease, 103000001);
  printf("%d\\n", run(&lease, 200000000, 3));
  soter_lease_arm(&lease);
  printf("%d %d\\n", first, run(&lease, 300000000, 3));
  show(&lease, 322000000);
  return 0;
}
"""


def test_a_killed_trusted_part_and_its_restart(tmp_path: Path) -> None:
    """The law within the lease; the restart comes up in SC, and is obeyed once it was armed."""
    package(STOP, tmp_path)
    (tmp_path / "main.c").write_text(MAIN)
    sources = sorted(p.name for p in tmp_path.glob("*.c") if p.name != "soter_app.c")
    built = [*find_compiler().command, STANDARD, *WARNINGS, "-ffp-contract=off", "-I.", *sources]
    compiled = command([*built, str(CHECK_FAILED), "-o", "own", "-lm"], tmp_path)
    assert compiled.returncode == 0, compiled.stderr
    said = command(["./own"], tmp_path).stdout.split("\n")
    assert said[:6] == ["0 0", "1 1", "0 0", "-3", "0 0", "1 1"]


def test_the_actuator_side_needs_nothing_of_the_program(tmp_path: Path) -> None:
    package(STOP, tmp_path)
    for name, allowed in (
        ("stop_lease", set()),
        ("soter_lease", {"memcpy"}),
        ("soter_grant", {"soter_check_failed"}),
    ):
        done = command([*find_compiler().command, STANDARD, *WARNINGS, "-c", f"{name}.c"], tmp_path)
        assert done.returncode == 0, done.stderr
        said = command(["nm", f"{name}.o"], tmp_path).stdout
        assert " T " in said or " R " in said or " D " in said, said
        wanted = set(re.findall(r"\bU (\w+)", said)) - {"_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}
        assert wanted <= allowed
        written = (tmp_path / f"{name}.c").read_text()
        assert not re.search(r"\b(malloc|free|static [a-z0-9_]+ [a-z]+;)", written)


def test_names_that_c_writes_alike_stay_two(tmp_path: Path) -> None:
    (tmp_path / "p.soter").write_text(ALIKE)
    for target in ("c", "posix"):
        soter.load(tmp_path / "p.soter").build(target, tmp_path / target)
        for name in ("p_lease", "p_grant"):
            words = [*find_compiler().command, STANDARD, *WARNINGS, "-I.", "-c", f"{name}.c"]
            done = command(words, tmp_path / target)
            assert done.returncode == 0, done.stderr
        written = (tmp_path / target / "p_lease.h").read_text()
        assert {"p_a_b_lease", "p_a_b_2_lease"} <= set(re.findall(r"\w+_lease\b", written))


def test_a_program_without_a_law_has_no_files_of_leases(tmp_path: Path) -> None:
    source, out = tmp_path / "stop.soter", tmp_path / "out"
    source.write_text(STOP.read_text().replace("  failsafe speed = 0.0;\n", ""))
    package(source, out)
    assert (out / "stop.c").exists()
    assert not [*out.glob("*lease*"), *out.glob("*grant*")]


def test_the_runtime_says_why_it_is_there() -> None:
    for name in ("soter_lease", "soter_grant"):
        for ending in (".h", ".c"):
            assert "Purpose:" in (RUNTIME / f"{name}{ending}").read_text()
