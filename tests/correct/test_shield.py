"""Shields (docs/evidence.md, A shield): commands are judged before they act, and silence is, too.

Purpose: both engines do the same with hostile controllers; no command that may act is outside of
what the table permits; `safe` is kept; a near-optimal AC keeps control; wrong tables are told.
Non-goals: the theorem (docs/proof-flight.md, A gate that looks at commands).
"""

from __future__ import annotations

import random
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from soter.language.evaluate.arithmetic import FaultKind
from soter.verify.deploy import shield_tables
from soter.verify.grid import estimate_sets
from soter.verify.problem import extract

if TYPE_CHECKING:
    from collections.abc import Callable

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "wall" / "shield.soter"
COARSE = ("] / 200, motion.v in [-8.0, 8.0] / 160", "] / 80, motion.v in [-8.0, 8.0] / 64")
LAW = "publish accel = clamp(8.0 * (fast - motion.v), -A, A);"
COMMANDS = {
    "pushes at the wall": "publish accel = A;",
    "to and fro": "publish accel = floor(time * 7.0) % 2.0 < 0.5 ? A : -A;",
    "mild, then silent": "if time < 2.0 { publish accel = 0.8; }",
    "full, then silent": "if time < 0.6 { publish accel = A; }",
    "at the last moment": "if motion.x > 5.0 { publish accel = A; } else { publish accel = 0.5; }",
    "now and then": "if floor(time * 13.0) % 3.0 < 0.5 { publish accel = 2.0 * sin(9.0 * time); }",
    "outside of its set": "publish accel = time > 1.0 ? 5.0 : 1.0;",
}
COMMANDS = {k: v.replace("% 2.0", "- 2.0 * floor(time * 3.5)") for k, v in COMMANDS.items()}
COMMANDS["now and then"] = (
    "if sin(40.0 * time) > 0.3 { publish accel = clamp(3.0 * sin(9.0 * time), -A, A); }"
)


def written(folder: Path, step: str = LAW, *more: tuple[str, str]) -> Path:
    """The example with other commands of AC, on a coarse grid."""
    text = EXAMPLE.read_text("utf-8")
    for old, new in (COARSE, (LAW, step), *more):
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "shield.soter"
    path.write_text(text, "utf-8")
    return path


@pytest.mark.parametrize("step", COMMANDS.values(), ids=COMMANDS.keys())
def test_both_engines_judge_alike_and_nothing_is_hit(step: str, tmp_path: Path) -> None:
    program = soter.load(written(tmp_path, step))
    for seed in (1, 2):
        runs = [
            program.simulate(system="Track", seed=seed, until="12s", engine=e)
            for e in ("interp", "native")
        ]
        assert runs[0].trace_sha256 == runs[1].trace_sha256
        assert not runs[1].violations
        assert np.abs(runs[1].truth("c")["x"]).max() < 10.0


def test_a_command_that_is_refused_is_a_gate_fault_of_its_own_kind(tmp_path: Path) -> None:
    program = soter.load(written(tmp_path, COMMANDS["pushes at the wall"]))
    run = program.simulate(system="Track", seed=1, until="12s")
    assert run.modules["Shielded"].gate_faults > 0
    driver = next(c.index for c in run.system.components if c.name == "Shielded.Driver")
    assert run.final["components"][driver]["last_fault"] == FaultKind.SHIELD


def test_a_driver_that_brakes_late_keeps_control() -> None:
    program = soter.load(EXAMPLE)
    shares = {
        s: program.simulate(system=s, seed=3, until="30s").modules[m].ac_share
        for s, m in (("Track", "Shielded"), ("StateAlone", "ByState"))
    }
    assert shares["Track"] == 1.0
    assert shares["StateAlone"] < 0.95


def test_what_may_act_is_always_permitted(tmp_path: Path) -> None:
    """A reader of its own: the hull of commands of the last W = 21 ms, against the table."""
    program = soter.load(written(tmp_path, COMMANDS["to and fro"]))
    tables = tables_of(program)
    run = program.simulate(system="Track", seed=5, until="12s")
    at_ns = run.require_trace()["header"]["ct"].astype(np.int64)
    accel, x, v = run.array("accel"), run.array("motion.x"), run.array("motion.v")
    in_ac = run.mode("Shielded")
    edges = [np.array(e) for e in tables.edges]
    checked = 0
    for k in np.flatnonzero(at_ns % 50_000_000 == 0):
        if not in_ac[k] or not k:
            continue
        recent = accel[(at_ns >= at_ns[k] - 21_000_000) & (at_ns < at_ns[k])]
        first = np.searchsorted(at_ns, at_ns[k] - 21_000_000, side="right") - 1
        recent = np.append(recent, accel[first])
        cells = np.clip(np.floor((recent + 3.0) / 6.0 * 8), 0, 7).astype(int)
        where = tuple(
            int(np.searchsorted(e, value)) - 1 for e, value in zip(edges, (x[k], v[k]), strict=True)
        )
        assert tables.commands.tops[where][cells.min()] > cells.max()
        checked += 1
    assert checked > 50


def tables_of(program: soter.Program) -> Any:
    """What the DM of the shielded module holds."""
    from soter.verify.deploy import missing_predicates

    kept: list[Any] = []
    put = missing_predicates.install_predicates

    def noted(flat: Any, module: Any, problem: Any, tables: Any) -> None:
        kept.extend(tables)
        put(flat, module, problem, tables)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(missing_predicates, "install_predicates", noted)
        program.simulate(system="Track", until="50ms")
    return kept[0]


# ---------------------------------------------------------------- proofs


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A cart that is moved by its speed: a table that is shown in a moment."""
    path = tmp_path / "small.soter"
    path.write_text(SMALL, "utf-8")
    return path


SMALL = """soter 1;
topic at: float max_age 20ms;
topic speed: float in [-1.0, 1.0];
node Any period 10ms { publishes speed; step { publish speed = sin(5.0 * time); } }
node Back period 10ms {
  subscribes at;
  publishes speed;
  step { publish speed = clamp(-2.0 * at, -1.0, 1.0); }
}
plant Cart period 5ms {
  reads speed;
  drives at = x;
  state x: float;
  disturbance slip: float in [-0.1, 0.1];
  der x = speed + slip;
  measured at within 0.01;
}
rta Keep {
  ac Any;
  sc Back;
  period 50ms;
  safe at < 2.0 && at > -3.0;
  shield 4;
  verify { grid at in [-3.0, 2.0] / 250; late dm 1ms, sc 1ms; acts within 2ms; }
}
system S { c: Cart; module Keep; until 5s; always c.truth.x < 2.0; }
"""


def test_a_shield_is_proved_and_rechecked(small: Path, tmp_path: Path) -> None:
    report = soter.load(small).verify(cert=tmp_path / "cert")
    assert report["Keep"].verdict == "proved", report["Keep"]
    assert soter.recheck(tmp_path / "cert").accepted


def test_what_goes_wrong_in_runs_is_no_matter_of_the_proof(small: Path) -> None:
    text = small.read_text("utf-8").replace(
        "until 5s;", "until 5s;\n  faults { skip Keep.Any at 60 per 1h; }"
    )
    small.write_text(text, "utf-8")
    report = soter.load(small).verify(refute=False)
    assert report["Keep"].findings["DM"].verdict == "proved"


def test_a_controller_that_overruns_is_not_judged_when_it_publishes(small: Path) -> None:
    text = small.read_text("utf-8").replace(
        "until 5s;", "until 5s;\n  faults { overrun Keep.Any by 35ms at 60 per 1h for 1s; }"
    )
    small.write_text(text, "utf-8")
    with pytest.raises(soter.SoterError, match="M027"):
        soter.load(small).simulate()


def longer(tops: Any, n: int) -> None:
    """Every range of commands goes on for two cells."""
    for i in range(n):
        some = tops[..., i] > i
        tops[some, i] = np.minimum(n, tops[some, i] + 2)


def everywhere(tops: Any, n: int) -> None:
    tops[...] = n


def moved(tops: Any, n: int) -> None:
    """What is permitted some cells further back."""
    del n
    tops[6:] = tops[:-6].copy()


@pytest.mark.parametrize("wrong", [longer, everywhere, moved])
def test_a_table_that_permits_too_much_is_rejected(
    wrong: Callable[[Any, int], None],
    small: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    find = estimate_sets.find_permitted_commands

    def damaged(case: Any, proof: Any, engine: Any, part: Any, anywhere: Any) -> None:
        find(case, proof, engine, part, anywhere)
        wrong(part.tops, part.tops.shape[-1])

    monkeypatch.setattr(estimate_sets, "find_permitted_commands", damaged)
    soter.load(small).verify(cert=tmp_path / "cert")
    assert not soter.recheck(tmp_path / "cert").accepted


def test_a_dm_that_forgets_what_was_held_is_refuted(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The compiled DM is tried with each pair of cells, one held and one that was."""
    ends = shield_tables.ShieldWriter.ends_function

    def forgetful(self: Any) -> Any:
        cells, self.cells = self.cells, 1
        fun = ends(self)
        self.cells = cells
        return fun

    monkeypatch.setattr(shield_tables.ShieldWriter, "ends_function", forgetful)
    assert soter.load(small).verify(refute=False)["Keep"].findings["DM"].verdict == "refuted"


def test_a_group_that_two_commands_move_is_not_proved(tmp_path: Path) -> None:
    text = (
        SMALL.replace("publishes speed;", "publishes speed, turn;")
        .replace("{ publish speed", "{ publish turn = 0.0; publish speed")
        .replace("topic speed", "topic turn: float in [-0.1, 0.1];\ntopic speed")
        .replace("reads speed", "reads speed, turn")
        .replace("der x = speed", "der x = speed + turn")
    )
    path = tmp_path / "two.soter"
    path.write_text(text, "utf-8")
    finding = soter.load(path).verify(refute=False)["Keep"].findings["ttf"]
    assert finding.verdict == "undecided"


def test_a_topic_without_an_age_is_not_proved(tmp_path: Path) -> None:
    path = tmp_path / "ageless.soter"
    path.write_text(SMALL.replace("topic at: float max_age 20ms;", "topic at: float;"), "utf-8")
    with pytest.raises(soter.SoterError, match="R011"):
        soter.load(path).verify(refute=False)


# ---------------------------------------------------------------- plants that move in steps

STEPS = (
    SMALL.replace("period 10ms", "period 100ms")
    .replace("period 50ms", "period 100ms")
    .replace("plant Cart period 5ms", "plant Cart period 100ms")
    .replace("max_age 20ms", "max_age 50ms")
    .replace("in [-0.1, 0.1]", "in [-0.005, 0.005]")
    .replace("der x = speed + slip", "next x = x + 0.1 * speed + slip")
    .replace(" late dm 1ms, sc 1ms; acts within 2ms;", "")
)


def test_a_shield_of_a_map_is_proved_and_rechecked_and_judges_one_command(tmp_path: Path) -> None:
    """A command that was replaced in this instant moves the plant no more."""
    path = tmp_path / "steps.soter"
    late = "speed = clamp(4.0 * (1.88 - at), -0.4, 0.4)"  # to the wall, but it brakes
    text = STEPS.replace("{ publishes speed;", "{ subscribes at; publishes speed;")
    path.write_text(text.replace("speed = sin(5.0 * time)", late), "utf-8")
    program = soter.load(path)
    report = program.verify(cert=tmp_path / "cert")
    assert report["Keep"].verdict == "proved", report["Keep"]
    assert soter.recheck(tmp_path / "cert").accepted
    runs = [program.simulate(seed=1, until="60s", engine=e) for e in ("interp", "native")]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    assert not runs[1].violations
    share = runs[1].modules["Keep"].ac_share
    assert share > 0.99
    path.write_text(path.read_text("utf-8").replace("shield 4;", ""), "utf-8")
    assert soter.load(path).simulate(seed=1, until="60s").modules["Keep"].ac_share < share


@pytest.mark.parametrize("wrong", [everywhere, moved])
def test_a_table_of_a_map_that_permits_too_much_is_rejected(
    wrong: Callable[[Any, int], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    find = estimate_sets.find_permitted_commands

    def damaged(case: Any, proof: Any, engine: Any, part: Any, anywhere: Any) -> None:
        find(case, proof, engine, part, anywhere)
        wrong(part.tops, part.tops.shape[-1])

    path = tmp_path / "steps.soter"
    path.write_text(STEPS, "utf-8")
    monkeypatch.setattr(estimate_sets, "find_permitted_commands", damaged)
    soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert not soter.recheck(tmp_path / "cert").accepted


def test_an_ac_between_the_steps_of_its_plant_is_refused_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which of the commands of a step moves the plant nobody says."""
    path = tmp_path / "between.soter"
    path.write_text(STEPS.replace("node Any period 100ms", "node Any period 50ms"), "utf-8")
    with pytest.raises(soter.SoterError, match="R007"):
        soter.load(path).verify(refute=False)
    monkeypatch.setattr(extract, "_ac_runs_between_steps", lambda _: False)
    assert soter.load(path).verify(cert=tmp_path / "cert", refute=False)["Keep"].verdict == "proved"
    assert "between the steps" in soter.recheck(tmp_path / "cert").reason


# ---------------------------------------------------------------- with a latch

LATCHED = (
    SMALL.replace("node Any", "input topic button: bool max_age 400ms;\nnode Any")
    .replace("shield 4;", "shield 4;\n  returns after button;")
    .replace("until 5s;", "input button every 70ms;\n  until 20s;")
    .replace("sin(5.0 * time)", "1.0")
)


def test_a_shield_with_a_latch_is_proved_and_rechecked(tmp_path: Path) -> None:
    path = tmp_path / "latched.soter"
    path.write_text(LATCHED, "utf-8")
    report = soter.load(path).verify(cert=tmp_path / "cert")
    assert report["Keep"].verdict == "proved", report["Keep"]
    assert soter.recheck(tmp_path / "cert").accepted
    path.write_text(LATCHED.replace("returns after button", "returns never"), "utf-8")
    findings = soter.load(path).verify(refute=False)["Keep"].findings
    assert findings["DM"].verdict == findings["ttf"].verdict == "proved"
    assert findings["P2b"].verdict == "assumed"


@pytest.mark.parametrize("seed", range(4))
def test_what_a_shield_refused_stays_refused_until_somebody_acknowledges(
    seed: int, tmp_path: Path
) -> None:
    """AC pushes at the wall: each refusal costs it control, and only a new press gives it back."""
    path = tmp_path / "latched.soter"
    path.write_text(LATCHED, "utf-8")
    program = soter.load(path)
    runs = [program.simulate(seed=seed, engine=e) for e in ("interp", "native")]
    assert runs[0].trace_sha256 == runs[1].trace_sha256
    run = runs[1]
    assert not run.violations
    assert run.modules["Keep"].gate_faults
    button, in_ac = run.array("button"), run.mode("Keep")
    starts = np.flatnonzero(in_ac[1:] & ~in_ac[:-1]) + 1
    ends = np.flatnonzero(~in_ac[1:] & in_ac[:-1]) + 1
    assert len(starts) > 2
    for start, taken in zip(starts, (0, *ends), strict=False):
        edges = np.flatnonzero(button[taken + 1 : start + 1] > button[taken:start])
        assert len(edges), "nobody pressed since control was taken"
    alone = tmp_path / "alone.soter"
    alone.write_text(LATCHED.replace("\n  returns after button;", ""), "utf-8")
    free = soter.load(alone).simulate(seed=seed)
    assert free.modules["Keep"].ac_share > run.modules["Keep"].ac_share


def test_a_shield_with_a_latch_that_nobody_opens_never_lets_ac_begin(tmp_path: Path) -> None:
    path = tmp_path / "latched.soter"
    path.write_text(LATCHED.replace("input button every 70ms;", ""), "utf-8")
    run = soter.load(path).simulate(seed=1)
    assert run.modules["Keep"].ac_share == 0.0


@pytest.mark.long
def test_random_drivers_hit_nothing(tmp_path: Path) -> None:
    """Commands for random times, silence, nonsense: 60 drivers, 60 s each."""
    chance = random.Random(7)  # noqa: S311 - inputs of a test
    path = written(tmp_path, "@")
    text = path.read_text("utf-8")
    for k in range(60):
        a, b, c = (round(chance.uniform(1.0, 60.0), 3) for _ in range(3))
        level = round(chance.uniform(0.5, 3.5), 3)
        step = (
            f"if sin({a} * time) > {round(chance.uniform(-1.0, 0.6), 3)} {{"
            f" publish accel = {level} * sin({b} * time + motion.v * {c}); }}"
        )
        path.write_text(text.replace("@", step), "utf-8")
        run = soter.load(path).simulate(system="Track", seed=k, until="60s")
        assert not run.violations, step


def test_check_tells_of_a_shield_whose_group_two_commands_move(tmp_path: Path) -> None:
    path = tmp_path / "two.soter"
    turning = (
        SMALL.replace("topic speed: float in [-1.0, 1.0]", "topic speed: Vec3 in [-1.0, 1.0]")
        .replace("publish speed = sin(5.0 * time)", "publish speed = vec3(1.0, 0.0, 0.0)")
        .replace(
            "publish speed = clamp(-2.0 * at, -1.0, 1.0)", "publish speed = vec3(-at, 0.0, 0.0)"
        )
        .replace("der x = speed", "der x = speed.x")
    )
    path.write_text(turning, "utf-8")
    assert "W033" not in [d.code for d in soter.load(path).check().warnings]
    path.write_text(turning.replace("der x = speed.x", "der x = speed.x + sin(speed.y)"), "utf-8")
    assert [d.code for d in soter.load(path).check().warnings] == ["W033"]
