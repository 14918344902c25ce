"""Programs that were once called proved and leave C, or of which the verdict left out what matters.

Each failed before the model of time (verify/problem/schedule.py) and the coverage of a verdict were
there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.verify.command import verify
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import assumption_texts

if TYPE_CHECKING:
    from soter.verify.claims.results import VerifyReport
    from soter.verify.problem.problem import Problem

ms = 1_000_000

#: An undamped mode at 36 rad/s; SC takes out just more than its own lateness puts in.
MODE = """soter 1;
const W: float = 36.0;
type Mode = { p: float, v: float };
topic mode: Mode max_age 5ms;
topic u: float in [-1.0, 1.0];
plant Beam period 5ms { reads u; drives mode = { p: p, v: v }; state p: float; state v: float;
  der p = W * v; der v = u - W * p; }
node Fast period 50ms { subscribes mode; publishes u; step { publish u = 1.0; } }
node Damp period 50ms { subscribes mode; publishes u;
  step { publish u = clamp(-2.0 * mode.v - GAIN * mode.p, -1.0, 1.0); } }
const GAIN: float = 0.0;
rta M { ac Fast; sc Damp; period 100ms;
  safe abs(mode.p) < 1.0 && abs(mode.v) < 1.0;
  ttf abs(mode.p) > 0.05 || abs(mode.v) > 0.05;
  safer abs(mode.p) < 0.02 && abs(mode.v) < 0.02;
  verify { grid mode.p in [-1.0, 1.0] / 60, mode.v in [-1.0, 1.0] / 60; late dm 40ms, sc 0ms; } }
system S { b: Beam; module M; }
"""

#: The topic that the module reads comes from an estimator that steps after SC in every instant.
SEEN = """soter 1;
topic raw: float max_age 20ms;
topic x: float = 0.0 max_age MAX;
topic u: float in [-1.0, 1.0];
plant Real period 10ms { reads u; drives raw = p; state p: float = 1.4; der p = u; }
plant Model period 10ms { reads u; drives x = q; state q: float = 1.4; der q = u; }
node Est period PERIOD { subscribes raw; publishes x; step { publish x = raw; } }
node Fast period 20ms { subscribes x; publishes u; step { publish u = 1.0; } }
node Slow period 20ms { subscribes x; publishes u; step { publish u = clamp(-x, -1.0, 1.0); } }
rta M { ac Fast; sc Slow; period 20ms;
  safe abs(x) < 1.5;
  ttf abs(x) > 1.0;
  safer abs(x) < 0.5;
  verify { abstracts r by m: Model = { q: r.truth.p }; grid x in [-1.5, 1.5] / 300; } }
system S default { r: Real; node Est; module M; }
"""


def problem_of(text: str) -> Problem:
    checked = check_file("once.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    return extract(flat, flat.modules[0])


def report_of(text: str) -> VerifyReport:
    checked = check_file("once.soter", text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    return verify(checked, refute=False)


def seen(period: str, max_age: str) -> str:
    return SEEN.replace("PERIOD", period).replace("MAX", max_age)


def codes_of(text: str) -> set[str]:
    with pytest.raises(SoterError) as raised:
        problem_of(text)
    return {d.code for d in raised.value.diagnostics}


def test_waiting_for_a_late_dm_makes_sc_late() -> None:
    late = problem_of(MODE).times  # 40 ms of 50: more than half of SC's period
    assert late.jitter_sc == 40 * ms
    assert not late.schedule.are_windows_short
    (module,) = report_of(MODE).modules
    assert module.findings["P2a"].verdict == "undecided"
    times = problem_of(MODE.replace("late dm 40ms, sc 0ms", "late dm 20ms, sc 0ms")).times
    assert times.jitter_sc == times.start == 20 * ms


def test_the_start_waits_for_the_dm_too() -> None:
    late = "late dm 20ms; response dm 4ms, sc 1ms; acts within 0ms;"
    assert problem_of(MODE.replace("late dm 40ms, sc 0ms;", late)).times.start == 25 * ms


def test_a_default_is_no_first_read() -> None:
    times = problem_of(seen("10ms", "20ms")).times
    assert times.start == 20 * ms  # SC's second step: at the first one `x` was never published
    assert times.schedule.steps_that_read_defaults == 1


def test_a_start_that_only_a_default_saves_is_not_proved() -> None:
    runaway = seen("10ms", "30ms").replace("1.4", "1.49")
    module_result = report_of(runaway).modules[0]
    assert module_result.findings["start"].verdict == "undecided"


@pytest.mark.long
def test_an_sc_that_faults_on_the_default_is_not_proved() -> None:
    text = seen("10ms", "20ms").replace("1.4", "0.3")
    assert report_of(text).modules[0].verdict == "proved"
    faulty = text.replace("= 0.0 max_age", "= 9.0 max_age").replace(
        "step { publish u = clamp(-x", "step { assert x < 8.0; publish u = clamp(-x"
    )
    finding = report_of(faulty).modules[0].findings["start"]
    assert finding.verdict == "undecided"
    assert "defaults" in finding.text


def test_an_estimator_that_is_slower_than_max_age_is_refused() -> None:
    assert codes_of(seen("1s", "20ms")) == {"R011"}


def test_only_what_sc_reads_is_as_young_as_age_says() -> None:
    text = seen("10ms", "90ms")
    aged = text.replace("verify {", "verify { age 20ms;")
    schedules = [problem_of(t).times.schedule for t in (text, aged)]
    assert {s.age_dm for s in schedules} == {schedules[0].age_sc}
    assert schedules[0].age_sc - schedules[1].age_sc == 70 * ms
    assert codes_of(text.replace("verify {", "verify { age 1ms;")) == {"R011"}


def test_an_estimator_before_its_sensor_is_refused() -> None:
    text = seen("10ms", "40ms")
    text = text.replace(
        "node Est ",
        "node Pre period 10ms phase 5ms {\n"
        "  subscribes raw; publishes mid; step { publish mid = raw; } }\n"
        "topic mid: float;\nnode Est ",
    )
    text = text.replace(
        "subscribes raw; publishes x; step { publish x = raw;",
        "subscribes mid; publishes x; step { publish x = mid;",
    ).replace("node Est; mod", "node Pre; node Est; mod")
    assert codes_of(text) == {"R017"}


def test_that_sensors_never_drop_out_is_an_assumption_or_counted() -> None:
    problem = problem_of(seen("10ms", "20ms"))
    assert any("never drop out" in a for a in assumption_texts(problem.assumptions))
    silent = seen("10ms", "20ms").replace("grid x", "dropout 30ms; grid x")
    longer = problem_of(silent)
    assert not any("never drop out" in a for a in assumption_texts(longer.assumptions))
    assert longer.times.delay_sc == problem.times.delay_sc + 30 * ms


def test_a_sample_and_hold_behind_sc_is_counted_or_refused() -> None:
    text = seen("10ms", "20ms").replace(
        "reads u; drives raw = p; state p: float = 1.4; der p = u;",
        "reads held; drives raw = p; state p: float = 1.4; der p = held;",
    )
    text = text.replace(
        "node Est ",
        "topic held: float;\nnode Hold period HOLD {"
        " subscribes u; publishes held; step { publish held = u; } }\nnode Est ",
    )
    text = text.replace("module M; }", "module M; node Hold; }")
    assert "R018" in codes_of(text.replace("HOLD", "100ms"))
    with_phase = text.replace("period HOLD", "period 5ms phase 2ms")
    assert problem_of(with_phase).times.jitter_sc == 0  # always 2 ms later: no jitter, but a delay
    assert (
        problem_of(with_phase).times.h_star > problem_of(text.replace("HOLD", "5ms")).times.h_star
    )


def test_another_system_with_the_module_is_verified_or_named() -> None:
    text = seen("10ms", "20ms").replace("1.4", "0.3")
    wild = "plant Wild period 10ms { reads u; drives x = q; state q: float; der q = 3.0 * u; }\n"
    plain = text.replace("abstracts r by m: Model = { q: r.truth.p }; ", "").replace(
        "system S default { r: Real; node Est; module M; }",
        wild + "system S default { m: Model; module M; }\nsystem T { m: Wild; module M; }\n"
        "system U { m: Model; module M; }\nsystem V { m: Model; module M; force M ac; }",
    )
    coverage = report_of(plain).coverage
    assert coverage.also == ("M in system U",)
    assert [r.split(":")[0] for r in coverage.rest] == ["M in system T", "M in system V"]


def test_contracts_of_sc_are_named() -> None:
    text = seen("10ms", "20ms").replace("1.4", "0.3")
    text = text.replace(
        "node Slow period 20ms { subscribes x; publishes u;",
        "node Slow period 20ms { subscribes x; publishes u; assumes x < 0.0;",
    )
    assert any("contracts of Slow" in r for r in report_of(text).coverage.rest)


def test_values_of_parameters_are_named() -> None:
    text = "soter 1;\nparam speed: float = 2.0;\n" + seen("10ms", "20ms").partition("\n")[2]
    assert dict(report_of(text.replace("1.4", "0.3")).coverage.params) == {"speed": 2.0}


def test_a_module_that_is_forced_is_refused() -> None:
    text = seen("10ms", "20ms").replace("1.4", "0.3")
    with pytest.raises(SoterError) as raised:
        report_of(text.replace("module M; }", "module M; force M ac; }"))
    assert [d.code for d in raised.value.diagnostics] == ["R019"]


def test_times_of_a_node_are_found_inside_of_a_sub_system_and_must_name_one() -> None:
    text = seen("10ms", "60ms").replace("grid x", "late Est 5ms; grid x")
    inner = text.replace("system S default", "system S") + "system Outer default { s: S; }\n"
    assert problem_of(text).times.age_dm == problem_of(inner).times.age_dm == 65 * ms
    assert codes_of(text.replace("late Est", "late Esst")) == {"R017"}
