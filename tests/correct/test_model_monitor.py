"""The model monitor: silent on what the model allows, loud when its bounds are halved.

Non-goals: what the drone does (`bench/drone/conformance.py`).
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.api import ENGINES, load
from soter.api.monitoring import log_explained
from soter.cli.main import main
from soter.language.model.types import leaves

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"

WORLD = """soter 1;
type Seen = { x: float, v: float };
topic seen: Seen max_age 20ms;
topic push: float in [-1.0, 1.0];
plant Flying period 10ms {
  reads push;
  drives seen = { x: x, v: v };
  state x: float;
  state v: float;
  disturbance wind: float in [-0.2, 0.2] hold 400ms;
  let gust = wind < 0.0 ? -0.2 : 0.2;
  der x = v;
  der v = 2.0 * push - v + gust;
  measured seen.x within 0.02, seen.v within 0.05;
}
plant Model period 10ms {
  reads push;
  drives seen = { x: x, v: v };
  state x: float;
  state v: float;
  disturbance d: float in [-WIND, WIND];
  der x = v;
  der v = LAG * (2.0 * push - v) + d;
  measured seen.x within 0.02, seen.v within 0.05;
}
const WIND: float = @WIND;
const LAG: float = @LAG;
node Fast period 20ms { subscribes seen; publishes push; step {
  publish push = clamp(1.0 - seen.x - seen.v, -1.0, 1.0); } }
node Slow period 20ms { subscribes seen; publishes push; step {
  publish push = clamp(-seen.x - seen.v, -1.0, 1.0); } }
rta Keeper {
  ac Fast;
  sc Slow;
  period 20ms;
  safe abs(seen.x) < 3.0;
  ttf abs(seen.x) > 2.0;
  safer abs(seen.x) < 1.5;
  verify {
    abstracts d by m: Model = d.truth;
    grid m.x in [-3.0, 3.0] / 60, m.v in [-3.0, 3.0] / 60;
  }
}
system Flight default { d: Flying; module Keeper; until 10s; }
"""

WATCHED = """soter 1;
import "world.soter" as world;
import "watch.soter" as w;
topic alarms: int;
node Count period 10ms { subscribes w.modelAlarm; publishes alarms; var n: int = 0; step {
  n = n + (w.modelAlarm ? 1 : 0);
  publish alarms = n;
} }
system Watched default {
  d: world.Flying; module world.Keeper; node w.ModelMonitor; node Count; until 10s;
}
"""


def world(folder: Path, wind: float = 0.2, lag: float = 1.0) -> Path:
    path = folder / "world.soter"
    path.write_text(WORLD.replace("@WIND", str(wind)).replace("@LAG", str(lag)))
    return path


@pytest.mark.parametrize("estimates", [False, True])
def test_what_the_model_allows_raises_no_alarm(tmp_path: Path, estimates: bool) -> None:
    program = load(world(tmp_path))
    for seed in range(4):
        (judged,) = program.monitor(seed=seed, estimates=estimates)
        assert judged.steps > 400
        assert judged.alarms == 0
        assert estimates or 0.9 < judged.share <= 1.0


@pytest.mark.parametrize("estimates", [False, True])
@pytest.mark.parametrize(("wind", "lag"), [(0.1, 1.0), (0.2, 2.0)])
def test_half_the_wind_or_half_the_lag_raises_an_alarm(
    tmp_path: Path,
    estimates: bool,
    wind: float,
    lag: float,
) -> None:
    (judged,) = load(world(tmp_path, wind, lag)).monitor(estimates=estimates)
    assert judged.alarms > 0
    assert judged.first_alarm_s is not None


def test_a_log_is_judged_like_the_run_it_is_of(tmp_path: Path) -> None:
    program = load(world(tmp_path, 0.1))
    log = tmp_path / "run.mcap"
    program.simulate(seed=5, log=log)
    for estimates in (False, True):
        assert program.monitor(log, estimates=estimates) == program.monitor(
            seed=5, estimates=estimates
        )


def test_the_command_exits_with_3_on_an_alarm(tmp_path: Path, capsys: Any) -> None:
    assert main(["monitor", str(world(tmp_path))]) == 0
    assert main(["monitor", str(world(tmp_path, 0.1))]) == 3
    assert "The model is false" in capsys.readouterr().out.replace("\n", " ")


def test_several_seeds_are_told_run_by_run_and_together(tmp_path: Path, capsys: Any) -> None:
    path = world(tmp_path, 0.199)
    assert main(["monitor", str(path), "--seed", "3..5", "--until", "2s", "--json"]) == 3
    (together,) = json.loads(capsys.readouterr().out)["modules"].values()
    runs = [load(path).monitor(seed=s, until=2)[0] for s in (3, 4, 5)]
    assert together["steps"] == sum(j.steps for j in runs)
    assert together["alarms"] == sum(j.alarms for j in runs)
    assert together["largest_share"] == max(j.share for j in runs)
    assert together["first_alarm_s"] == min(j.first_alarm_s for j in runs if j.first_alarm_s)
    assert main(["monitor", str(path), "--seed", "3..5", "--until", "2s"]) == 3
    rows = [x.split() for x in capsys.readouterr().out.splitlines() if "Keeper" in x]
    assert [r[0] for r in rows] == ["3", "4", "5", "all"]
    assert [int(r[3].replace(",", "")) for r in rows] == [
        *(j.alarms for j in runs),
        together["alarms"],
    ]


@pytest.mark.parametrize("seeds", ["5..3", "1..", "..2", "1..99999", "1...3", "a..b"])
def test_seeds_that_are_none_are_refused(tmp_path: Path, capsys: Any, seeds: str) -> None:
    assert main(["monitor", str(world(tmp_path)), "--seed", seeds]) == 2
    assert seeds.partition("..")[0] in capsys.readouterr().err


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("wind", [0.2, 0.1])
def test_the_emitted_node_says_on_line_what_the_monitor_says(
    tmp_path: Path, engine: str, wind: float
) -> None:
    load(world(tmp_path, wind)).emit_monitor(tmp_path / "watch.soter")
    (tmp_path / "watched.soter").write_text(WATCHED)
    program = load(tmp_path / "watched.soter")
    run = program.simulate(until=4, engine=engine)
    (judged,) = program.monitor(until=4, estimates=True)
    assert (int(run.final["topics"]["alarms"]) > 0) == (wind < 0.2)
    # the node's last step may still be on its way to the counter
    assert abs(int(run.final["topics"]["alarms"]) - judged.alarms) <= 1


@pytest.mark.parametrize(("wind", "cause"), [(0.2, "Nothing"), (0.1, "m_v")])
def test_the_emitted_node_names_the_state_that_raised_the_alarm(
    tmp_path: Path, wind: float, cause: str
) -> None:
    load(world(tmp_path, wind)).emit_monitor(tmp_path / "watch.soter")
    (tmp_path / "watched.soter").write_text(WATCHED)
    run = load(tmp_path / "watched.soter").simulate(until=4)
    names = "Nothing, m_x, m_v"
    assert f"type ModelCause = enum {{ {names} }};" in (tmp_path / "watch.soter").read_text()
    assert names.split(", ")[run.final["topics"]["w.modelCause"]] == cause


def test_the_table_names_the_states_of_alarms_on_estimates(tmp_path: Path, capsys: Any) -> None:
    assert main(["monitor", str(world(tmp_path, 0.1)), "--estimates"]) == 3
    (row,) = [x for x in capsys.readouterr().out.splitlines() if x.startswith("Keeper")]
    assert "m.v" in row


def emitted(folder: Path) -> Path:
    """A program with a monitor of `world.soter` as it stands; gives its path."""
    load(world(folder)).emit_monitor(folder / "watch.soter")
    (folder / "watched.soter").write_text(WATCHED)
    return folder / "watched.soter"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("WIND: float = 0.2", "WIND: float = 0.3"),
        ("LAG: float = 1.0", "LAG: float = 1.5"),
        ("seen.v within 0.05", "seen.v within 0.06"),
        ("plant Model period 10ms", "plant Model period 5ms"),
        ("Keeper", "Warden"),
        ("system Flight", "system Voyage"),
    ],
)
def test_a_monitor_of_another_model_is_refused(
    tmp_path: Path, capsys: Any, old: str, new: str
) -> None:
    program = emitted(tmp_path)
    assert load(program).ok
    for path in (tmp_path / "world.soter", program):
        path.write_text(path.read_text().replace(old, new))
    assert [d.code for d in load(program).diagnostics] == ["D022"]
    for command in ("check", "run", "verify"):
        assert main([command, str(program)]) == 1
        assert "error[D022]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "codes"),
    [
        ("WIND: float = 0.2", "set world.WIND = 0.1;", ["D022"]),
        ("LAG: float = 1.0", "set world.LAG = 2.0;", ["D022"]),
        ("WIND: float = 0.2", "set world.WIND = 0.2;", []),
        ("WIND: float = 0.2", "", []),
    ],
)
def test_a_system_whose_set_changes_the_model_is_warned_of_its_monitor(
    tmp_path: Path, old: str, new: str, codes: list[str]
) -> None:
    path = world(tmp_path)
    path.write_text(path.read_text().replace(f"const {old}", f"param {old}"))
    load(path).emit_monitor(tmp_path / "watch.soter")
    inner = WATCHED.replace("until 10s;", f"until 10s; {new}")
    (tmp_path / "watched.soter").write_text(inner)
    program = load(tmp_path / "watched.soter")
    assert program.ok
    assert [d.code for d in program.diagnostics if d.code == "D022"] == codes


def test_a_model_that_obeys_another_topic_is_another_model(tmp_path: Path) -> None:
    path = world(tmp_path)
    text = path.read_text().replace(
        "topic push:", "topic shove: float in [-1.0, 1.0];\ntopic push:"
    )
    text = text.replace("publishes push;", "publishes push, shove;")
    text = text.replace("publish push =", "publish shove = 0.5; publish push =")
    flying, _, model = text.partition("plant Model")
    flying = flying.replace("reads push;", "reads push, shove;")
    flying = flying.replace("- v + gust", "- v + gust + 0.0 * shove")
    path.write_text(f"{flying}plant Model{model}")
    load(path).emit_monitor(tmp_path / "watch.soter")
    (tmp_path / "watched.soter").write_text(WATCHED)
    assert load(tmp_path / "watched.soter").ok
    other = model.replace("reads push;", "reads shove;").replace("(2.0 * push", "(2.0 * shove")
    path.write_text(f"{flying}plant Model{other}")
    assert [d.code for d in load(tmp_path / "watched.soter").diagnostics] == ["D022"]


def test_the_help_against_a_stale_monitor_is_a_command_that_mends_it(tmp_path: Path) -> None:
    path = world(tmp_path)
    text = path.read_text().replace("type Seen", QUIET).replace("const WIND", "param WIND")
    text = text.replace("module Keeper;", "module Keeper; node Quiet;")
    path.write_text(text)
    watch = tmp_path / "watch.soter"
    load(path).emit_monitor(watch, params={"WIND": 0.25}, alarm="modelAlarm")
    (tmp_path / "guarded.soter").write_text(GUARDED)
    path.write_text(text.replace("LAG: float = 1.0", "LAG: float = 1.5"))
    (stale,) = load(tmp_path / "guarded.soter").diagnostics
    command = stale.helps[0].split("`")[1].split()
    assert command[0] == "soter"
    assert main(command[1:]) == 0
    assert load(tmp_path / "guarded.soter").ok
    made = watch.read_text()
    assert '"params": {"WIND": "0.25"}' in made
    assert "publishes watched.modelAlarm, modelCause;" in made


def test_a_monitor_is_of_its_model_whatever_else_the_program_says(tmp_path: Path) -> None:
    program = emitted(tmp_path)
    path = tmp_path / "world.soter"
    text = path.read_text().replace("1.0 - seen.x", "0.9 - seen.x").replace("> 2.0", "> 2.1")
    path.write_text("// as it was\n" * 3 + text)
    assert load(program).ok


def test_a_monitor_made_with_other_parameters_is_compared_under_them(tmp_path: Path) -> None:
    path = world(tmp_path)
    path.write_text(path.read_text().replace("const WIND", "param WIND"))
    load(path).emit_monitor(tmp_path / "watch.soter", params={"WIND": 0.3})
    (tmp_path / "watched.soter").write_text(WATCHED)
    assert load(tmp_path / "watched.soter").ok
    watch = tmp_path / "watch.soter"
    watch.write_text(watch.read_text().replace('{"WIND": 0.3}', "{}"))
    assert [d.code for d in load(tmp_path / "watched.soter").diagnostics] == ["D022"]


def test_a_parameter_of_an_import_is_found_wherever_else_it_is_imported(tmp_path: Path) -> None:
    (tmp_path / "air.soter").write_text("soter 1;\nparam WIND: float = 0.2;\n")
    path = world(tmp_path)
    text = path.read_text().replace("const WIND: float = 0.2;", "")
    text = text.replace("-WIND, WIND", "-air.WIND, air.WIND")
    path.write_text(text.replace("soter 1;", 'soter 1;\nimport "air.soter" as air;'))
    load(path).emit_monitor(tmp_path / "watch.soter", params={"air.WIND": 0.3})
    first = 'soter 1;\nimport "air.soter" as first;'
    (tmp_path / "watched.soter").write_text(WATCHED.replace("soter 1;", first))
    assert load(tmp_path / "watched.soter").ok


@pytest.mark.parametrize("record", ["", "// made of 5", '// made of {"model": 3}', "// made of ["])
def test_a_monitor_that_does_not_say_of_what_it_is_made_is_refused(
    tmp_path: Path, record: str
) -> None:
    program, watch = emitted(tmp_path), tmp_path / "watch.soter"
    lines = watch.read_text().splitlines()
    watch.write_text("\n".join(record if x.startswith("// made of") else x for x in lines))
    (wrong,) = load(program).diagnostics
    assert wrong.code == "D022"
    assert wrong.helps == (
        f"write it anew: `soter monitor {tmp_path / 'world.soter'} --emit {watch}`",
    )


def first_alarm_s(beyond: float, pull: float, errors: Floats) -> float | None:
    """When the boxes of v' = -pull v + d, |d| <= 0.2, are left by d = 0.2 + `beyond`.

    `errors` (steps,) in m/s, of estimates that are true within 0.05, a step of 10 ms each.
    """
    bound, error, h = 0.2, 0.05, 0.01
    decay = math.exp(-pull * h)
    gain = (1 - decay) / pull if pull else h
    v, low, high = 0.0, -math.inf, math.inf
    for k, e in enumerate(errors):
        low, high = max(low, v + e - error), min(high, v + e + error)
        if low > high + 1e-12:
            return k * h
        v = decay * v + gain * (bound + beyond)
        low, high = decay * low - gain * bound, decay * high + gain * bound
    return None


HEAD = re.compile(
    r"// m\.v: a disturbance d beyond its bound is told in (?P<factor>\S+) "
    r"(atanh\((?P<never>\S+) / d\)|/ d) s(; d of (?P=never) or less perhaps never)?\n"
)


@pytest.mark.parametrize("pull", [0.0, 1.0, 6.0])
def test_the_file_says_when_a_disturbance_is_told_whatever_the_errors(
    tmp_path: Path, pull: float
) -> None:
    path, model = world(tmp_path), "der v = LAG * (2.0 * push - v) + d;"
    assert model in path.read_text()
    pulled = f"der v = 2.0 * push - {pull} * v + d + 0.0 * LAG;"
    path.write_text(path.read_text().replace(model, pulled))
    load(path).emit_monitor(tmp_path / "watch.soter")
    head = HEAD.search((tmp_path / "watch.soter").read_text())
    assert head is not None
    factor, never = float(head["factor"]), float(head["never"] or 0.0)
    chance = np.random.default_rng(3)
    late = np.full(3000, -0.05)
    late[0] = 0.05
    for beyond in (never + 0.02, never + 0.2, never + 2.0):
        within = factor * math.atanh(never / beyond) if pull else factor / beyond
        # as long as an estimate that is too high is believed, then one that is too low
        turn = math.log1p(never / beyond) / pull if pull else 0.1 / beyond
        worst = np.where(np.arange(3000) < int(turn / 0.01), 0.05, -0.05)
        for errors in (worst, -worst, late, *chance.uniform(-0.05, 0.05, (5, 3000))):
            alarm = first_alarm_s(beyond, pull, errors)
            assert alarm is not None
            assert alarm <= within + 0.02
        assert first_alarm_s(beyond, pull, worst) == pytest.approx(within, abs=0.03), "no sooner"
    assert not pull or first_alarm_s(0.98 * never, pull, late) is None


QUIET = """topic modelAlarm: bool;
node Quiet period 10ms { publishes modelAlarm; step { publish modelAlarm = false; } }
type Seen"""
GUARDED = """soter 1;
import "world.soter" as world;
import "watch.soter" as w;
system Guarded { d: world.Flying; module world.Keeper; node w.ModelMonitor; until 10s; }
"""


@pytest.mark.parametrize("wind", [0.2, 0.1])
def test_an_alarm_counts_as_ttf_where_the_module_reads_it(tmp_path: Path, wind: float) -> None:
    path = world(tmp_path, wind)
    text = path.read_text().replace("type Seen", QUIET)
    text = text.replace("ttf abs(seen.x) > 2.0;", "ttf abs(seen.x) > 2.0 || modelAlarm;")
    path.write_text(
        text.replace("d: Flying; module Keeper;", "d: Flying; module Keeper; node Quiet;")
    )
    load(path).emit_monitor(tmp_path / "watch.soter", alarm="modelAlarm")
    (tmp_path / "guarded.soter").write_text(GUARDED)
    run = load(tmp_path / "guarded.soter").simulate()
    (module,) = run.modules.values()
    assert (module.switches_to_sc > 0) == (wind < 0.2)


def test_the_drone_stays_within_what_its_proof_assumes() -> None:
    (judged,) = load(DRONE / "motion_primitive.soter").monitor(seed=7)
    assert judged.alarms == 0
    assert 0.5 < judged.share < 1.0


@pytest.mark.long
def test_the_drone_with_a_quarter_of_the_wind_declared_raises_alarms(tmp_path: Path) -> None:
    for file in (f for f in DRONE.iterdir() if f.is_file()):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    main_file = tmp_path / "motion_primitive.soter"
    text = main_file.read_text()
    assert "city.TURN * iris.WIND + RESIDUAL" in text
    main_file.write_text(text.replace("TURN * iris.WIND", "TURN * 0.25 * iris.WIND"))
    program = load(main_file)
    assert sum(program.monitor(seed=seed)[0].alarms for seed in (3, 4, 5)) > 0


def mapping_of(program: Any, names: list[str]) -> dict[str, Any]:
    """Topics of a log under the names that Soter gives them, and no true states."""
    topics = {}
    for name in names:
        paths = [".".join(p) or "value" for p, _ in leaves(program.flat().topic(name).type)]
        topics[name] = {"channel": name, "fields": {p: p for p in paths}}
    return {"topics": topics}


@pytest.mark.parametrize(("wind", "lag"), [(0.2, 1.0), (0.1, 1.0), (0.2, 2.0)])
def test_what_was_measured_is_judged_alike_without_true_states(
    tmp_path: Path, wind: float, lag: float
) -> None:
    program, log = load(world(tmp_path, wind, lag)), tmp_path / "run.mcap"
    program.simulate(seed=5, log=log)
    mapping = mapping_of(program, ["seen", "push"])
    explanations = log_explained(program.flat, log, mapping)
    assert explanations == program.monitor(log, estimates=True)
    assert explanations[0].alarms == 0 or (wind, lag) != (0.2, 1.0)


@pytest.mark.long
def test_parameters_are_read_off_the_topics_where_there_are_no_true_states(tmp_path: Path) -> None:
    program, log = load(DRONE / "motion_primitive.soter"), tmp_path / "run.mcap"
    program.simulate(seed=5, until="6s", log=log)
    (told,) = program.monitor(log, estimates=True)
    mapping = mapping_of(program, ["tubeState", "control"])
    (explanation,) = log_explained(program.flat, log, mapping)
    assert (explanation.steps, explanation.alarms) == (told.steps, told.alarms)
    assert explanation.steps > 500


def test_a_log_without_commands_does_not_say_whether_the_model_explains_it(
    tmp_path: Path, capsys: Any
) -> None:
    path, log = world(tmp_path), tmp_path / "run.mcap"
    program = load(path)
    program.simulate(seed=5, log=log)
    mapping = tmp_path / "map.json"
    for names, code in ((["seen"], 1), (["seen", "push"], 0)):
        mapping.write_text(json.dumps(mapping_of(program, names)))
        arguments = ["monitor", str(path), str(log), "--map", str(mapping), "--estimates"]
        assert main(arguments) == code
    said = capsys.readouterr()
    assert "error[D017]" in said.err
    assert "missing: push" in said.err
    assert "judged on estimates" in said.out
