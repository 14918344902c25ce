"""Runs with faults: the same states on both engines, whatever goes wrong; and what goes wrong."""

from __future__ import annotations

import random
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from long_tests import examples, seed_of
from soter import SoterError, load, recheck
from soter.language.elaborate.derived_systems import faultless, with_faults
from soter.language.front_end import check_file, system_of
from soter.language.model.system import Fault
from soter.semantics.draws import draw_bits
from soter.semantics.faults import actual_release_ns, is_active, is_released, next_release
from soter.simulate.run import NativeProgram, run_interpreted
from soter.verify.problem.problem import assumption_texts

if TYPE_CHECKING:
    from soter.language.model.system import System

PROGRAM = """soter 1;
type Pose = { x: float, v: float, near: int in [0, 7], on: bool };
topic pose: Pose in { x in [-40.0, 40.0], v in [-9.0, 9.0] } max_age 60ms;
topic pace: float max_age 60ms;
topic push: float in [-4.0, 4.0];
topic extra: float[2] in [-2.0, 2.0];
topic spoken: int in [0, 100];
plant P period 5ms {
  reads push, extra;
  drives pose = { x: clamp(x, -40.0, 40.0), v: clamp(v, -9.0, 9.0), near: 3, on: x > 0.0 };
  drives pace = v;
  state x: float = 0.0;
  state v: float = 0.0;
  disturbance wind: float in [-0.3, 0.3];
  disturbance gust: float in [-0.1, 0.1] hold 100ms;
  der x = v;
  der v = clamp(push + wind + gust + extra[1], -5.0, 5.0);
  measured pose.x within 0.05;
}
node Fast period 10ms {
  subscribes pose; publishes push;
  var n: int = 0;
  step { n = (n + 1) % 100; publish push = clamp(3.0 * (5.0 - pose.x) - pose.v, -4.0, 4.0); }
}
node Slow period 20ms phase 5ms {
  subscribes pose; publishes push;
  step { publish push = clamp(-pose.x - 2.0 * pose.v, -4.0, 4.0); }
}
node Other period 7ms {
  subscribes pose; publishes extra, spoken;
  step { publish extra = [choose [0, 1] == 0 ? 0.5 : -0.5, 0.0]; publish spoken = pose.near * 10; }
}
node Ear period 20ms {
  subscribes spoken queue 4 drop_oldest; publishes heard;
  step { publish heard = spoken.len; }
}
topic heard: int in [0, 4];
rta M {
  ac Fast; sc Slow; period 50ms;
  safe abs(pose.x) < 12.0;
  ttf abs(pose.x) + 0.1 * abs(pace) > 5.0;
  safer abs(pose.x) < 3.0;
}
system S {
  p: P; module M; node Other; node Ear;
  until 10s;
  always abs(p.truth.x) < 20.0;
  FAULTS
}
"""
SECOND = 10**9
CART = Path(__file__).resolve().parents[2] / "examples" / "wall" / "cart.soter"
TIMED = ("M.dm", "M.Fast", "M.Slow", "Other", "Ear", "all", "modules")
VALUED = (
    "M.Fast",
    "M.Slow",
    "M.Fast.push",
    "Other.extra",
    "Other.extra[1]",
    "p.pose.x",
    "p.pose",
    "p.pace",
)
LASTING = ("M.Fast", "Other", "Ear")
ODD = ("p", "p.pose.near", "p.pose.on", "Other.spoken", "Other", "M.Slow.push")
RANDOM_PROGRAMS = examples(5)


def flat_of(folder: Path, faults: str) -> System:
    path = folder / "p.soter"
    path.write_text(PROGRAM.replace("FAULTS", f"faults {{ {faults} }}" if faults else ""))
    return system_of(check_file(str(path)), "S")


def slowly(folder: Path, faults: str, takes: dict[str, str]) -> System:
    """The same, with nodes whose steps take time."""
    text = PROGRAM
    for node, lasts in takes.items():
        head = next(line for line in text.splitlines() if line.startswith(f"node {node} "))
        text = text.replace(head, f"{head}\n  takes {lasts};")
    (folder / "p.soter").write_text(text.replace("FAULTS", f"faults {{ {faults} }}"))
    return system_of(check_file(str(folder / "p.soter")), "S")


def random_faults(rng: random.Random) -> str:
    faults = ["order any;"] if rng.random() < 0.5 else []
    for _ in range(rng.randint(1, 6)):
        often = f"at {rng.choice([200, 700, 1900])} per 1h"
        lasts = rng.choice(["", f" for {rng.choice([30, 100, 450])}ms"])
        kind = rng.choice(["late", "held", "skip", "value", "odd", "wind", "overrun"])
        if kind == "late":
            times = [0, *sorted(rng.randint(0, 30) for _ in range(rng.randint(1, 3)))]
            by = f"[{', '.join(f'{t}ms' for t in times)}]" if rng.random() < 0.5 else "6ms"
            faults.append(f"late {rng.choice(TIMED)} by {by};")
        elif kind == "held":
            faults.append(f"late {rng.choice(TIMED)} by {rng.choice([15, 120, 400])}ms {often};")
        elif kind == "skip":
            faults.append(f"skip {rng.choice(TIMED)} {often}{lasts};")
        elif kind == "value":
            what = rng.choice(["nan", "saturated", "bias", "noise", "scale", "stuck", "silent"])
            where = rng.choice(VALUED)
            if what == "nan" and where[0] == "p":
                where = "Other.extra"
            if what == "silent" and where.count(".") + where.count("[") > 1:
                where = "M.Slow"
            by = f" by {rng.choice(['0.5', '-1.5', '3.0'])}" if what in "bias noise scale" else ""
            faults.append(f"{what} {where}{by} {often}{lasts};")
        elif kind == "overrun":
            by = rng.choice(["1ns", "3ms", "7ms", "10ms", "25ms", "160ms"])
            faults.append(f"overrun {rng.choice(LASTING)} by {by} {often}{lasts};")
        elif kind == "odd":
            faults.append(f"stuck {rng.choice(ODD)} {often}{lasts};")
        else:
            faults.append(f"scale p.{rng.choice(['wind', 'gust'])} by 7.0 {often}{lasts};")
    return "\n    ".join(faults)


@pytest.mark.parametrize("number", range(RANDOM_PROGRAMS))
@pytest.mark.random
def test_both_engines_do_the_same(number: int, tmp_path: Path) -> None:
    faults = random_faults(random.Random(seed_of(number)))  # noqa: S311 - it draws programs
    flat = flat_of(tmp_path, faults)
    native = NativeProgram(flat)
    for seed in range(2):
        one = native.run(6 * SECOND, seed, hash_trace=True)
        two = run_interpreted(flat, 6 * SECOND, seed, hash_trace=True)
        assert one.trace_sha256 == two.trace_sha256, faults
        assert [c.time_ns for c in one.changes] == [c.time_ns for c in two.changes]


@pytest.mark.parametrize("number", range(RANDOM_PROGRAMS))
@pytest.mark.random
def test_both_engines_do_the_same_where_steps_take_time(number: int, tmp_path: Path) -> None:
    rng = random.Random(seed_of(number))  # noqa: S311 - it draws programs
    faults = random_faults(rng)
    nodes = rng.sample(LASTING, rng.randint(1, len(LASTING)))
    lasts = ("[1us, 2us]", "[1ms, 9ms]", "[3ms, 3ms]", "[7ms, 10ms]", "[2ms, 45ms]")
    takes = {node.rpartition(".")[2]: rng.choice(lasts) for node in nodes}
    faults += f"\n    late {nodes[0]} by [0ms, {rng.choice([1, 6, 30])}ms];"
    faults += f"\n    {rng.choice(['skip', 'late'])} all " + rng.choice(
        ["by 9ms at 900 per 1h;", "by 120ms at 300 per 1h;"]
    )
    faults = faults.replace("skip all by 9ms", "skip all").replace("skip all by 120ms", "skip all")
    flat = slowly(tmp_path, faults, takes)
    native = NativeProgram(flat)
    for seed in range(2):
        one = native.run(6 * SECOND, seed, hash_trace=True)
        two = run_interpreted(flat, 6 * SECOND, seed, hash_trace=True)
        assert one.trace_sha256 == two.trace_sha256, (faults, takes)
        assert [c.time_ns for c in one.changes] == [c.time_ns for c in two.changes]


def test_what_has_no_faults_is_what_it_was(tmp_path: Path) -> None:
    none = flat_of(tmp_path, "")
    rare = flat_of(
        tmp_path, "nan M.Fast at 0 per 1h; late all by [0ms, 0ms]; skip Ear at 0 per 1s;"
    )
    assert len(rare.faults) > 5
    runs = [NativeProgram(x).run(4 * SECOND, 3, hash_trace=True) for x in (none, rare)]
    assert runs[0].trace_sha256 == runs[1].trace_sha256


@pytest.mark.parametrize(
    ("fault", "seen"),
    [
        ("nan M.Fast at 2000 per 1h for 1s;", "gate"),
        ("silent p at 2000 per 1h for 300ms;", "stale"),
        ("skip M.dm at 900 per 1h for 1s;", "undecided"),
        ("nan M.Slow at 2000 per 1h for 1s;", "latched"),
    ],
)
def test_a_fault_is_seen(fault: str, seen: str, tmp_path: Path) -> None:
    run = NativeProgram(flat_of(tmp_path, fault)).run(20 * SECOND, 1, observed=True)
    fine = NativeProgram(flat_of(tmp_path, "")).run(20 * SECOND, 1, observed=True)
    if seen == "gate":
        assert run.modules["M"].gate_faults > 0 == fine.modules["M"].gate_faults
    elif seen == "stale":
        assert any(c.stale for c in run.changes)
        assert not any(c.stale for c in fine.changes)
    elif seen == "latched":
        assert run.violations > 0 == fine.violations
    else:
        assert [c.time_ns for c in run.changes] != [c.time_ns for c in fine.changes]


def fault(**changes: object) -> Fault:
    base = {"kind": "skip", "component": 1, "stream": "f", "probability": 0.1, "slot_ns": 0}
    return Fault(**{**base, **changes})  # type: ignore[arg-type]


def test_slots_that_last_are_as_frequent_as_was_said_and_never_two_in_a_row() -> None:
    period, lasts = 10_000_000, 300_000_000
    rate = 0.2  # a second
    f = fault(probability=(1.0 - np.sqrt(1.0 - 4.0 * rate * 0.3)) / 2.0, slot_ns=lasts, apart=True)
    times = np.arange(0, 4_000 * SECOND, period)
    there = np.array([is_active(f, 7, int(t), period) for t in times[::5]])
    begins = int((there[1:] & ~there[:-1]).sum())
    runs = np.diff(np.flatnonzero(np.diff(there.astype(np.int8)) != 0))
    assert 4_000 * rate * 0.93 < begins < 4_000 * rate * 1.07
    lengths = runs[1::2] if there[0] else runs[::2]
    assert set(lengths.tolist()) == {6}, "300 ms, seen every 50 ms"


@pytest.mark.parametrize("seed", range(5))
def test_releases_happen_in_order_and_are_those_that_are_told(seed: int, tmp_path: Path) -> None:
    flat = flat_of(
        tmp_path,
        "late Other by [0ms, 2ms, 30ms]; late all by 80ms at 9000 per 1h; "
        "skip Other at 9000 per 1h for 50ms;",
    )
    c = flat.component("Other")
    own = [f for f in flat.faults if f.component == c.index]
    told, t = [], -1
    while t < 2 * SECOND:
        t = next_release(flat, own, c, seed, t)
        told.append(t)
    listed = [
        actual_release_ns(flat, own, c, seed, k) for k in range(2 * SECOND // c.period_ns + 60)
    ]
    kept = [t for t in listed if t is not None]
    assert kept == sorted(set(kept))
    assert told == kept[: len(told)]
    assert all(is_released(flat, own, c, seed, t) for t in told)
    assert not any(is_released(flat, own, c, seed, t + 1) for t in told if t + 1 not in told)
    nominal = {k: c.phase_ns + k * c.period_ns for k in range(len(listed))}
    late = [t - nominal[k] for k, t in enumerate(listed) if t is not None]
    assert all(0 <= x < c.period_ns for x in late)
    assert max(late) > c.period_ns // 2


def test_a_group_is_held_up_together(tmp_path: Path) -> None:
    flat = flat_of(tmp_path, "late all by 400ms at 2000 per 1h;")
    assert len({f.stream for f in flat.faults if f.stream}) == 1
    apart = flat_of(
        tmp_path, "late M.dm by 400ms at 2000 per 1h; late Ear by 400ms at 2000 per 1h;"
    )
    assert len({f.stream for f in apart.faults if f.stream}) == 2


@pytest.mark.parametrize(
    ("said", "inside"),
    [
        ("nan M.Fast at 1 per 1h;", True),
        ("late M.Fast by 500ms at 1 per 1h;", True),
        ("late M.dm by 5ms;", False),  # it has no `verify` block that says so
        ("scale p.wind by 0.5 at 1 per 1h;", True),
        ("scale p.wind by -1.0 at 1 per 1h;", True),
        ("scale p.wind by 1.01 at 1 per 1h;", False),
        ("bias p.pose.x by 0.01 at 1 per 1h;", False),
        ("silent p at 1 per 1h for 10ms;", False),
    ],
)
def test_it_is_said_which_assumption_is_kept(said: str, inside: bool, tmp_path: Path) -> None:
    flat = flat_of(tmp_path, said)
    assert {f.inside is not None for f in flat.faults if f.stream} == {inside}


def changed_cart(folder: Path, faults: str) -> Path:
    path = folder / "c.soter"
    text = CART.read_text(encoding="utf-8")
    path.write_text(text.replace("until 30s;", f"until 30s; faults {{ {faults} }}", 1))
    return path


def test_a_declared_lateness_is_inside_up_to_what_is_declared(tmp_path: Path) -> None:
    path = changed_cart(tmp_path, "late SafeCart.dm by 1ms; late SafeCart.Careful by 1001us;")
    flat = system_of(check_file(str(path)), "Protected")
    assert [f.inside is not None for f in flat.faults if f.stream] == [True, False]


@pytest.mark.long
def test_no_proof_and_no_set_is_about_faults(tmp_path: Path) -> None:
    source = changed_cart(tmp_path, "late all by 9ms; silent c at 900 per 1h;")
    report = load(source).verify(cert=tmp_path / "cert")
    assert report.verdict == "proved"
    assert any(
        "`faults` of system Protected" in a for a in assumption_texts(report.modules[0].assumptions)
    )
    again = recheck(tmp_path / "cert")
    assert again.accepted
    assert any("its `faults` go wrong" in said.text for said in again.not_covered)


def test_more_faults_can_be_put_into_a_system(tmp_path: Path) -> None:
    flat = flat_of(tmp_path, "")
    more = fault(
        kind="late", component=flat.component("M.dm").index, amount=(0, 4_000_000), probability=1.0
    )
    worse = with_faults(flat, [more], shuffled=True)
    runs = [
        NativeProgram(worse).run(3 * SECOND, 5, hash_trace=True),
        run_interpreted(worse, 3 * SECOND, 5, hash_trace=True),
    ]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert flat.faults == ()


def test_wrong_ones_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SoterError, match="V011"):
        flat_of(tmp_path, "nan M.Fast at -1 per 1h;")


def test_in_the_deployed_order_an_sc_waits_for_its_late_dm(tmp_path: Path) -> None:
    """Both are released at multiples of 50 ms; an SC that came first would not be enabled yet."""
    late = "late M.dm by [0ms, 40ms];"

    text = PROGRAM.replace("node Slow period 20ms phase 5ms", "node Slow period 50ms")
    (tmp_path / "q.soter").write_text(text.replace("FAULTS", f"faults {{ {late} }}"))
    flat = system_of(check_file(str(tmp_path / "q.soter")), "S")
    dm, sc = flat.component("M.dm"), flat.component("M.Slow")
    for k in range(60):
        times = [
            actual_release_ns(flat, [f for f in flat.faults if f.component == c.index], c, 3, k)
            for c in (dm, sc)
        ]
        assert times[0] == times[1]
    apart = flat_of(tmp_path, f"{late} order any;")
    assert [f.kind for f in apart.faults] == ["late"], "in any order nobody waits"
    native = NativeProgram(flat).run(5 * SECOND, 2, hash_trace=True)
    again = run_interpreted(flat, 5 * SECOND, 2, hash_trace=True)
    assert native.trace_sha256 == again.trace_sha256


def test_two_latenesses_of_one_component_are_judged_together(tmp_path: Path) -> None:
    twice = "late SafeCart.dm by 600us; late SafeCart.dm by 600us;"
    flat = system_of(check_file(str(changed_cart(tmp_path, twice))), "Protected")
    assert [f.inside for f in flat.faults if f.stream] == [None, None]


def test_a_node_whose_time_a_proof_takes_for_zero_is_outside(tmp_path: Path) -> None:
    """`Other` publishes what the plant reads beside the module: not declared, so not inside."""
    flat = flat_of(tmp_path, "late Ear by 1ms; late Other by 1ms;")
    assert [f.inside for f in flat.faults] == [None, None]


def test_a_sensor_speaks_at_its_first_release(tmp_path: Path) -> None:
    flat = flat_of(tmp_path, "silent p at 25 per 1s for 10ms;")
    for seed in range(10):
        states = run_interpreted(flat, 1_000_000, seed, keep_trace=True).require_trace()
        assert states["stamps"][0, flat.topic("pose").index] == 0


@pytest.mark.parametrize(
    ("said", "share"),
    [
        ("saturated M.Fast at 36 per 1h for 10s;", 0.1),
        ("saturated M.Fast at 360 per 1h for 10s;", 1.0),
        ("stuck M.Fast at 3 per 1h for 10min;", 0.5),
        ("silent M.Fast at 60 per 1h for 10s;", 1 / 6),
        ("nan M.Fast at 100 per 1s;", 1.0),
        ("nan M.Fast at 10 per 1s;", 0.1),
    ],
)
def test_it_happens_as_often_as_was_said(said: str, share: float, tmp_path: Path) -> None:
    flat = flat_of(tmp_path, said)
    (f,) = flat.faults
    period = flat.components[f.component].period_ns
    step = f.slot_ns or period
    there = [is_active(f, seed, k * step, period) for seed in range(20) for k in range(200)]
    assert sum(there) / len(there) == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize(
    "said",
    [
        "saturated M.Fast at 361 per 1h for 10s;",
        "silent M.Fast at 91 per 1h for 10s;",
        "late all by 1s at 1000 per 1h;",
        "nan M.Fast at 101 per 1s;",
        "skip M.dm at 20 per 1s;",
    ],
)
def test_what_cannot_be_so_often_is_refused(said: str, tmp_path: Path) -> None:
    with pytest.raises(SoterError, match="V011"):
        flat_of(tmp_path, said)


@pytest.mark.parametrize("by", ["-1ms", "3", "[1ms, 2]", "nobody"])
def test_a_lateness_that_is_none_is_an_error_in_words(by: str, tmp_path: Path) -> None:
    with pytest.raises(SoterError) as caught:
        flat_of(tmp_path, f"late M.dm by {by};")
    assert caught.value.diagnostics[0].code in {"V011", "S019", "T002", "N001", "C001"}


COUNTING = """soter 1;
topic made: int in [0, 1000000];
topic heard: int in [0, 1000000];
node N period 10ms phase 3ms {
  publishes made; TAKES
  var n: int = 0;
  step { n = n + 1; publish made = n; }
}
node Ear period 1ms { subscribes made; publishes heard; step { publish heard = made; } }
system S { node N; node Ear; until 10s; FAULTS }
"""


def counting(folder: Path, takes: str, faults: str) -> System:
    path = folder / "n.soter"
    text = COUNTING.replace("TAKES", takes)
    path.write_text(text.replace("FAULTS", f"faults {{ {faults} }}" if faults else ""))
    return system_of(check_file(str(path)), "S")


@pytest.mark.parametrize("by_ms", [1, 7, 10, 13, 40])
def test_a_node_that_always_overruns_is_one_that_takes_so_long(by_ms: int, tmp_path: Path) -> None:
    fault = counting(tmp_path, "", f"overrun N by {by_ms}ms at 100 per 1s;")
    said = counting(tmp_path, f"takes [{by_ms}ms, {by_ms}ms];", "")
    runs = [NativeProgram(x).run(3 * SECOND, 4, hash_trace=True) for x in (fault, said)]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert (
        runs[0].trace_sha256
        != run_interpreted(counting(tmp_path, "", ""), 3 * SECOND, 4, hash_trace=True).trace_sha256
    )


def expected(flat: System, seed: int, until: int) -> dict[int, int]:
    """When what N publishes counts, and which step that was: straight from semantics.md."""
    c = flat.component("N")
    low, high = c.takes_ns or (0, 0)
    longer = [f for f in flat.faults if f.kind == "overrun"]
    moved = [f for f in flat.faults if f.changes_releases]
    step_by_time, busy, steps = {}, -1, 0
    for k in range(until // c.period_ns + 1):
        t = actual_release_ns(flat, moved, c, seed, k)
        if t is None or t < busy:
            continue
        steps += 1
        busy = t + sum(int(f.amount[0]) for f in longer if is_active(f, seed, t, c.period_ns))
        busy += low + draw_bits(seed, "N.takes", k) % (high - low + 1)
        step_by_time[busy] = steps
    return {t: n for t, n in step_by_time.items() if t <= until}


@pytest.mark.parametrize(
    ("takes", "faults"),
    [
        ("takes [2ms, 5ms];", "late N by [0ms, 3ms, 9ms];"),
        ("", "overrun N by 4500us at 30 per 1s;"),
        ("", "overrun N by 10ms at 30 per 1s;"),
        ("", "overrun N by 25ms at 2 per 1s for 200ms;"),
        ("", "overrun N by 4ms at 30 per 1s; overrun N by 9ms at 30 per 1s;"),
        ("", "overrun N by 6ms at 50 per 1s; late N by [0ms, 9ms]; skip N at 10 per 1s;"),
        ("takes [4ms, 14ms];", "late N by 6ms; skip N at 10 per 1s;"),
        ("takes [10ms, 10ms];", "late N by 200ms at 900 per 1h;"),
        ("takes [1ms, 30ms];", "skip all at 10 per 1s; overrun N by 9ms at 30 per 1s;"),
    ],
)
def test_what_a_step_that_lasts_publishes_counts_so_much_later(
    takes: str, faults: str, tmp_path: Path
) -> None:
    flat = counting(tmp_path, takes, faults)
    made = flat.topic("made").index
    for seed in range(3):
        native = NativeProgram(flat).run(4 * SECOND, seed, keep_trace=True)
        states = native.require_trace()
        seen = dict(
            zip(states["stamps"][:, made].tolist(), states["topics"]["made"].tolist(), strict=True)
        )
        wanted = expected(flat, seed, 4 * SECOND)
        assert {t: n for t, n in seen.items() if t >= 0} == wanted
        assert wanted != {3_000_000 + 10_000_000 * k: k + 1 for k in range(400)}
        again = run_interpreted(flat, 4 * SECOND, seed, keep_trace=True)
        assert again.require_trace().tobytes() == states.tobytes()


PLANNED = """soter 1;
topic x: float in [0.0, 9.0] max_age 30ms;
topic goal: float in [0.0, 9.0] max_age 90ms;
topic u: float in [0.0, 9.0];
plant P period 10ms { reads u; drives x = z; state z: float = 1.0; next z = u; }
node Plan period 20ms { subscribes x; publishes goal; step { publish goal = x; } }
node Go period 10ms { subscribes goal; publishes u; step { publish u = goal; } }
node Stay period 10ms { subscribes goal; publishes u; step { publish u = 0.5; } }
rta M {
  ac Go; sc Stay; period 50ms;
  safe goal < 9.0;
  ttf goal > 5.0;
  safer goal < 3.0;
  verify { RESPONSE }
}
system S { p: P; module M; node Plan; until 1s; faults { FAULTS } }
"""


@pytest.mark.parametrize(
    ("response", "faults", "inside"),
    [
        ("response Plan 5ms;", "overrun Plan by 5ms at 1 per 1h;", [True]),
        ("response Plan 5ms;", "overrun Plan by 5001us at 1 per 1h;", [False]),
        ("response Plan 20ms;", "overrun Plan by 20ms at 1 per 1h;", [False]),
        ("", "overrun Plan by 1us at 1 per 1h;", [False]),
        (
            "response Plan 5ms;",
            "overrun Plan by 3ms at 1 per 1h; overrun Plan by 3ms at 1 per 1h;",
            [False, False],
        ),
        (
            "response Plan 15ms; late Plan 15ms;",
            "overrun Plan by 15ms at 1 per 1h; late Plan by 5ms;",
            [False, True],
        ),
        ("", "overrun M.Go by 900ms at 1 per 1h;", [True]),
    ],
)
def test_an_overrun_is_inside_up_to_the_declared_response(
    response: str, faults: str, inside: list[bool], tmp_path: Path
) -> None:
    path = tmp_path / "p.soter"
    path.write_text(PLANNED.replace("RESPONSE", response).replace("FAULTS", faults))
    flat = system_of(check_file(str(path)), "S")
    assert [f.inside is not None for f in flat.faults] == inside


@pytest.mark.parametrize(
    ("takes_ms", "late_ms", "inside"), [(8, 5, True), (8, 6, False), (15, 5, True), (16, 5, False)]
)
def test_a_node_that_takes_time_is_late_inside_while_no_release_is_lost(
    takes_ms: int, late_ms: int, inside: bool, tmp_path: Path
) -> None:
    text = PLANNED.replace("RESPONSE", "late Plan 5ms;")
    text = text.replace("publishes goal;", f"publishes goal; takes [1ms, {takes_ms}ms];")
    path = tmp_path / "p.soter"
    path.write_text(text.replace("FAULTS", f"late Plan by {late_ms}ms;"))
    flat = system_of(check_file(str(path)), "S")
    assert [f.inside is not None for f in flat.faults] == [inside]


@pytest.mark.parametrize(("there", "inside"), [("", False), ("late M.Go 4ms;", True)])
def test_an_ac_is_late_inside_where_every_induction_that_reads_it_says_so(
    there: str, inside: bool, tmp_path: Path
) -> None:
    other = f"""topic w: float in [-2.0, 2.0];
node Echo period 10ms {{ subscribes u; publishes w; step {{ publish w = u; }} }}
node Quiet period 10ms {{ publishes w; step {{ publish w = 0.0; }} }}
rta N {{
  ac Echo; sc Quiet; period 50ms;
  safe abs(u) <= 2.0; ttf abs(u) > 2.0; safer abs(u) <= 2.0;
  verify {{ induction; {there} }}
}}
system S"""
    text = PLANNED.replace("RESPONSE", "induction; late M.Go 4ms;").replace("system S", other)
    path = tmp_path / "p.soter"
    path.write_text(text.replace("module M;", "module M; module N;").replace("FAULTS", LATE_GO))
    flat = system_of(check_file(str(path)), "S")
    assert [f.inside is not None for f in flat.faults] == [inside]


LATE_GO = "late M.Go by 3ms;"


LOOKED = """soter 1;
topic x: float in [-9.0, 9.0] max_age 20ms;
topic u: float in [-1.0, 1.0];
topic told: float in [0.0, 10.0];
plant P period 5ms { reads u; drives x = p; state p: float; der p = u; }
node Go period 10ms { publishes u; step { publish u = 1.0; } }
node Back period 10ms { subscribes x; publishes u; step { publish u = x > 0.0 ? -1.0 : 0.0; } }
node Watch period 5ms { publishes told; step { publish told = margin(M); } }
node Plan period 10ms { publishes n; step { publish n = 1.0; } }
topic n: float;
rta M { ac Go; sc Back; period 20ms; safe x < 1.0; ttf x > 0.5; safer x < 0.2; }
system S { p: P; node Plan; node Watch; module M; until 1s; FAULTS }
"""


def test_what_a_margin_is_counted_from_is_found_without_faults(tmp_path: Path) -> None:
    """`held` of a node that overruns goes with the fault; what the DM saw stays."""
    path = tmp_path / "p.soter"
    both = []
    for faults in ("faults { overrun Plan by 4ms at 30 per 1s; }", ""):
        path.write_text(LOOKED.replace("FAULTS", faults))
        both.append(system_of(check_file(str(path)), "S"))
    faulty, plain = both
    (module,) = faulty.modules
    assert module.looked is not None
    assert {"Plan.held", "M.margin"} <= {t.name for t in faulty.topics if t.held}
    calm = faultless(faulty)
    assert [t.index for t in calm.topics] == list(range(len(plain.topics)))
    assert calm.modules[0].looked == plain.modules[0].looked
    assert [t.name for t in calm.topics] == [t.name for t in plain.topics]
    runs = [NativeProgram(x).run(SECOND, 4, hash_trace=True) for x in (calm, plain)]
    assert runs[0].trace_sha256 == runs[1].trace_sha256


def test_a_proof_holds_nothing_back_for_faults(tmp_path: Path) -> None:
    flat = counting(tmp_path, "", "overrun N by 4ms at 30 per 1s;")
    plain = counting(tmp_path, "", "")
    assert len(flat.topics) == len(plain.topics) + 1
    calm = faultless(flat)
    assert [t.name for t in calm.topics] == [t.name for t in plain.topics]
    runs = [NativeProgram(x).run(SECOND, 4, hash_trace=True) for x in (calm, plain)]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    both = faultless(counting(tmp_path, "takes [1ms, 2ms];", "overrun N by 4ms at 30 per 1s;"))
    assert [t.name for t in both.topics if t.held] == ["N.held"]
