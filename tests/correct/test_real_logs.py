"""Logs of somebody else: their decisions are those of the program, and nothing is lost in silence.

Non-goals: what a mapping may say (`tests/unit/monitor/test_foreign_logs.py`), the whole set of legs
(`bench/drone/real_logs.py`).
"""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from json_documents import problems_of
from soter.api import load
from soter.cli.main import main
from soter.diagnostics.diagnostic import SoterError
from soter.language.model.types import IntType, leaves
from soter.monitor.derived_signals import window_slopes

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.monitor.log_judgement import LogJudgement, ModuleOfLog

pytest.importorskip("mcap", reason="the extra `logs` is not installed")

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CART = EXAMPLES / "wall" / "cart.soter"
DRONE = EXAMPLES / "drone"
PX4_LOG, PX4_MAP = DRONE / "px4_goto.csv.gz", DRONE / "px4_goto.toml"
REPLAYED = [
    ("wall/cart.soter", ["motion"], []),
    ("drone/motion_primitive.soter", ["tubeState"], []),
    ("drone/motion_primitive.soter", ["iris.localPosition", "iris.reference"], ["Mission"]),
    ("drone/goto.soter", ["iris.localPosition", "leg"], []),
]


def whole(system: System, names: list[str]) -> Any:
    """A mapping of topics to channels and fields of the same names."""
    topics = {}
    for name in names:
        paths = [".".join(p) or "value" for p, _ in leaves(system.topic(name).type)]
        topics[name] = {"channel": name, "fields": {p: p for p in paths}}
    return {"topics": topics}


def columns(system: System, names: list[str]) -> Any:
    """The same for a CSV, whose columns have the topic's name in front."""
    given = whole(system, names)
    for name, topic in given["topics"].items():
        topic["fields"] = {p: f"{name}.{p}" for p in topic["fields"]}
    return {**given, "time": {"from": "t", "unit": "ns"}}


def as_csv(log: Path, names: list[str]) -> Path:
    """The messages of a log, an instant a row; a channel that was silent leaves its cells empty."""
    from mcap.reader import make_reader

    rows: dict[int, dict[str, Any]] = {}
    with log.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=names):
            row = rows.setdefault(message.log_time, {})
            for path, value in flat(json.loads(message.data)):
                row[f"{channel.topic}.{path}"] = value
    head = ["t", *dict.fromkeys(k for row in rows.values() for k in row)]
    csv_path = log.with_suffix(".csv")
    with csv_path.open("w", newline="") as file:
        writer = csv.DictWriter(file, head)
        writer.writeheader()
        writer.writerows({"t": t, **row} for t, row in rows.items())
    return csv_path


def flat(value: Any, path: str = "") -> Any:
    if isinstance(value, dict):
        for name, part in value.items():
            yield from flat(part, f"{path}.{name}" if path else name)
    else:
        yield path, value


def decided(judged: LogJudgement, module: str) -> ModuleOfLog:
    return next(m for m in judged.modules if m.module == module)


# ---------------------------------------------------------------- the same decisions


@pytest.mark.parametrize(("file", "names", "nodes"), REPLAYED)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_run_read_as_a_foreign_log_is_decided_as_it_was(
    tmp_path: Path, file: str, names: list[str], nodes: list[str], seed: int
) -> None:
    program = load(EXAMPLES / file)
    log = tmp_path / "run.mcap"
    run = program.simulate(seed=seed, until="12s", log=log)
    judged = program.judge_log(log, whole(run.system, names))
    assert list(judged.nodes) == nodes
    (module,) = run.modules.values()
    assert module.gate_faults == 0
    told = [(c.time_ns / 1e9, c.after, c.reason) for c in run.decisions]
    before = [change for change in told if change[0] < judged.from_s]
    told = [(judged.from_s, *change[1:]) for change in before[-1:]] + told[len(before) :]
    assert judged.from_s <= 0.02, "all was published by then"
    (module_of_log,) = judged.modules
    assert [(c.time_s, c.to, c.reason) for c in module_of_log.changes] == told
    assert told, "a run without a change says little"
    assert module_of_log.steps > 200


@pytest.mark.parametrize(("file", "names", "nodes"), REPLAYED)
def test_a_csv_says_the_same_as_the_mcap_it_was_made_of(
    tmp_path: Path, file: str, names: list[str], nodes: list[str]
) -> None:
    del nodes
    program = load(EXAMPLES / file)
    log = tmp_path / "run.mcap"
    program.simulate(seed=4, until="8s", log=log)
    one = program.judge_log(log, whole(program.flat(), names))
    other = program.judge_log(as_csv(log, names), columns(program.flat(), names))
    assert one.modules == other.modules
    assert (one.from_s, one.to_s, one.samples) == (other.from_s, other.to_s, other.samples)


# ---------------------------------------------------------------- foreign numbers


def track(path: Path, rows: list[list[object]], head: list[str]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([head, *rows])
    return path


def cart_rows(n: int = 200) -> list[list[object]]:
    """t in s, x in m, v in m/s: towards the wall and on."""
    return [[k / 50, 0.0005 * k * k, 0.05 * k] for k in range(n)]


CART_MAP: dict[str, Any] = {
    "system": "Protected",
    "time": {"from": "t"},
    "topics": {"motion": {"fields": {"x": "x", "v": "v"}}},
}


def test_other_units_signs_and_clocks_say_the_same(tmp_path: Path) -> None:
    rows = cart_rows()
    program = load(CART)
    plain = program.judge_log(track(tmp_path / "a.csv", rows, ["t", "x", "v"]), CART_MAP)
    other = [[int(t * 1000) + 1_700_000_000_000, 2000.0 - 1000 * x, -3.6 * v] for t, x, v in rows]  # type: ignore[operator]
    fields = {
        "x": {"from": "down", "unit": "mm", "scale": -1.0, "offset": 2.0},
        "v": {"from": "kmh", "unit": "km/h", "scale": -1.0},
    }
    mapping = {**CART_MAP, "time": {"from": "ms", "unit": "ms"}}
    mapping["topics"] = {"motion": {"fields": fields}}
    changed = program.judge_log(track(tmp_path / "b.csv", other, ["ms", "down", "kmh"]), mapping)
    (a,), (b,) = plain.modules, changed.modules
    assert [(c.time_s, c.to) for c in a.changes] == [(c.time_s, c.to) for c in b.changes]
    assert a.margin is not None
    assert b.margin is not None
    assert a.margin.distance == pytest.approx(b.margin.distance, abs=1e-9)
    assert a.switches, "it comes too near"


def test_a_velocity_from_positions_is_within_its_stated_error(tmp_path: Path) -> None:
    rows = [[k / 10, 0.5 * (k / 10) ** 2 + 0.01 * ((-1) ** k)] for k in range(60)]
    fields = {"x": "x", "v": {"slope": "x", "window": "0.6s"}}
    mapping = {**CART_MAP, "topics": {"motion": {"fields": fields, "between": "linear"}}}
    judged = load(CART).judge_log(track(tmp_path / "a.csv", rows, ["t", "x"]), mapping)
    names = {d.name for d in judged.derived}
    assert names == {"motion.v", "motion.x"}
    (slope,) = (d for d in judged.derived if "slope" in d.how)
    assert slope.error is not None
    assert 0.0 < slope.error[0] <= slope.error[1] <= slope.error[2] < 0.5
    assert any("derived" in text for text in judged.assumptions)


def test_nothing_that_comes_later_counts(tmp_path: Path) -> None:
    """A log that ends earlier is judged the same up to its end: a monitor knows the past only."""
    times = [k / 10 for k in range(80)]
    places = [4.0 + 4.5 * math.sin(k / 4) + 0.2 * math.sin(2.1 * k) for k in range(80)]
    rows: list[list[object]] = [[t, x] for t, x in zip(times, places, strict=True)]
    fields = {"x": "x", "v": {"slope": "x", "window": "0.4s"}}
    mapping = {**CART_MAP, "topics": {"motion": {"fields": fields, "between": "linear"}}}
    program = load(CART)

    def judged(count: int) -> list[tuple[float, str, str]]:
        log = track(tmp_path / "a.csv", rows[:count], ["t", "x"])
        (module,) = program.judge_log(log, mapping).modules
        return [(c.time_s, c.to, c.reason) for c in module.changes]

    whole = judged(len(rows))
    assert len(whole) > 8
    for count in range(10, len(rows)):
        assert judged(count) == [c for c in whole if c[0] <= times[count - 1] + 1e-9], count


@pytest.mark.parametrize("window_s", [0.1, 0.4, 1.0])
def test_a_slope_is_that_of_the_samples_up_to_now(window_s: float) -> None:
    times = np.cumsum(np.where(np.arange(60) % 7, 0.1, 0.23))
    curve = 3.0 - 2.0 * times + 0.7 * times**2
    slope_values = window_slopes(times, curve, window_s)
    assert math.isnan(slope_values[0]), "one sample has no slope"
    assert slope_values[1] == pytest.approx((curve[1] - curve[0]) / (times[1] - times[0]))
    assert slope_values[2:] == pytest.approx(-2.0 + 1.4 * times[2:], abs=1e-9), (
        "exact of a parabola"
    )
    for k in range(3, 60):
        assert window_slopes(times[:k], curve[:k], window_s)[-1] == slope_values[k - 1]


def test_reads_too_old_or_refused_or_empty_end_with_sc(tmp_path: Path) -> None:
    rows = cart_rows(40)
    cells: list[list[object]] = [list(r) for r in rows]
    for k in range(10, 14):
        cells[k][1] = ""
    cells[20][2] = "nan"
    program = load(CART)
    path = track(tmp_path / "a.csv", cells, ["t", "x", "v"])
    judged = program.judge_log(path, CART_MAP)
    count, first = judged.left_out["motion"]
    assert (count, first) == (5, "line 12: no finite number for `motion.x`")
    (module,) = judged.modules
    assert module.stale > 0
    assert any(c.to == "SC" and "older than" in c.reason for c in module.changes)


def test_in_a_gap_nothing_is_made_up(tmp_path: Path) -> None:
    rows = [r for k, r in enumerate(cart_rows(60)) if not 20 <= k < 40]
    path = track(tmp_path / "a.csv", rows, ["t", "x", "v"])
    program = load(CART)
    stale = []
    for gap in ("0.1s", "1s"):
        topics = {"motion": {**CART_MAP["topics"]["motion"], "between": "linear", "gap": gap}}
        (module,) = program.judge_log(path, {**CART_MAP, "topics": topics}).modules
        stale.append((module.stale, [c.to for c in module.changes]))
    assert stale == [(6, ["AC", "SC", "AC"]), (0, ["AC"])]


def test_a_log_that_begins_in_flight_is_not_judged_by_what_a_program_begins_with(
    tmp_path: Path,
) -> None:
    program = load(DRONE / "motion_primitive.soter")
    fields: dict[str, Any] = {}
    for path, t in leaves(program.flat().topic("tubeState").type):
        fields[".".join(path)] = {"constant": 1 if isinstance(t, IntType) else 0.0}
    fields["p.x"] = "x"
    log = track(tmp_path / "a.csv", [[k / 100, 5.0] for k in range(50)], ["t", "x"])
    mapping = {"time": {"from": "t"}, "topics": {"tubeState": {"fields": fields}}}
    (module,) = program.judge_log(log, mapping).modules
    assert (module.steps, module.ac) == (49, 49), "the first sample is read one step later"
    assert [(c.time_s, c.to) for c in module.changes] == [(0.01, "AC")]


def test_a_value_outside_its_topics_set_is_refused_as_the_gate_would(tmp_path: Path) -> None:
    path = tmp_path / "narrow.soter"
    path.write_text(
        CART.read_text().replace(
            "topic motion: Motion max",
            "topic motion: Motion in { x in [-10.0, 10.0], v in [-1.0, 1.0] } max",
        )
    )
    program = load(path)
    assert program.ok, program.diagnostics
    judged = program.judge_log(track(tmp_path / "a.csv", cart_rows(), ["t", "x", "v"]), CART_MAP)
    count, first = judged.refused["motion"]
    assert count == 179
    assert "0.420 s" in first
    assert "not in [-1.0, 1.0]" in first


def test_a_log_of_which_every_sample_is_refused_judges_nothing(tmp_path: Path) -> None:
    path = tmp_path / "narrow.soter"
    narrow = (
        "topic motion: Motion in { x in [-1.0, 1.0], v in [7.0, 9.0] } = { x: 0.0, v: 7.0 } max"
    )
    path.write_text(CART.read_text().replace("topic motion: Motion max", narrow))
    program = load(path)
    assert program.ok, program.diagnostics
    log = track(tmp_path / "a.csv", cart_rows(90), ["t", "x", "v"])
    judged = program.judge_log(log, CART_MAP)
    (module,) = judged.modules
    assert (module.decided, module.judged, module.steps, module.waiting) == (True, False, 0, 36)
    count, first = judged.refused["motion"]
    assert (count, first[:7]) == (90, "0.000 s")


# ---------------------------------------------------------------- the command


def command(capsys: Any, *arguments: object) -> tuple[int, str]:
    code = main(["monitor", *map(str, arguments)])
    said = capsys.readouterr()
    return code, said.out + said.err


def test_the_command_names_what_is_missing_and_what_that_leaves_open(capsys: Any) -> None:
    code, said = command(
        capsys, DRONE / "motion_primitive.soter", PX4_LOG, "--map", positions(), "--where", "set=2",
        "--where", "leg=0",
    )  # fmt: skip
    assert code == 1
    assert "error[D017]: the log does not decide module `SafeMotionPrimitive`" in said
    assert "missing: control (which the controllers of" in said


def positions() -> Path:
    """The mapping without the leg, as a file."""
    text = PX4_MAP.read_text()
    mapping_path = Path("positions.toml")
    mapping_path.write_text(text[: text.index("[topics.leg]")])
    return mapping_path


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


TWO = """soter 1;
topic a: float; topic b: float; topic u: float in [-1.0, 1.0]; topic w: float in [-1.0, 1.0];
plant P period 10ms { drives a = x; drives b = x; state x: float; }
node One period 10ms { publishes u; step { publish u = 0.0; } }
node Two period 10ms { publishes u; step { publish u = 0.5; } }
node Three period 10ms { publishes w; step { publish w = 0.0; } }
node Four period 10ms { publishes w; step { publish w = 0.5; } }
rta Left { ac One; sc Two; period 10ms; safe a < 2.0; ttf a > 1.0; safer a < 0.5; }
rta Right { ac Three; sc Four; period 10ms; safe b < 2.0; ttf b > 1.0 || mode(Left) == Mode.SC; safer b < 0.5; }
system S { p: P; module Left; module Right; }
"""  # noqa: E501


def test_what_can_be_decided_is_although_another_module_cannot(tmp_path: Path, capsys: Any) -> None:
    program = tmp_path / "two.soter"
    program.write_text(TWO)
    log = track(tmp_path / "a.csv", [[k / 10, k / 20] for k in range(30)], ["t", "a"])
    mapping = tmp_path / "map.json"
    mapping.write_text(
        json.dumps({"time": {"from": "t"}, "topics": {"a": {"fields": {"value": "a"}}}})
    )
    code, said = command(capsys, program, log, "--map", mapping)
    assert code == 4, "of one of two modules nothing was judged"
    assert "warning[D017]: the log does not decide module `Right`" in said
    assert "missing: b (which plant `p` drives)" in said
    code = main(["monitor", str(program), str(log), "--map", str(mapping), "--json"])
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    modules = document["log"]["modules"]
    assert (modules["Left"]["decided"], modules["Right"]["decided"]) == (True, False)
    assert modules["Left"]["first_switch_s"] == 2.1
    assert modules["Right"]["missing"] == ["b (which plant `p` drives)"]


def test_a_forced_module_is_judged_as_if_it_decided(tmp_path: Path) -> None:
    log = track(tmp_path / "a.csv", cart_rows(), ["t", "x", "v"])
    program = load(CART)
    free = program.judge_log(log, CART_MAP)
    forced = program.judge_log(log, CART_MAP, system="Unprotected")
    assert free.modules == forced.modules
    assert not any("forces" in text for text in free.assumptions)
    assert any("forces the mode of `SafeCart`" in text for text in forced.assumptions)


ESTIMATOR = """soter 1;
topic raw: float; topic pose: float; topic good: bool; topic u: float in [-1.0, 1.0];
plant P period 10ms { drives raw = x; state x: float; }
node Filter period 10ms {
  subscribes raw;
  publishes pose, good;
  step { publish pose = 2.0 * raw; publish good = raw < 1.0; }
}
node One period 10ms { publishes u; step { publish u = 0.0; } }
node Two period 10ms { publishes u; step { publish u = 0.5; } }
rta M { ac One; sc Two; period 10ms; safe pose < 9.0; ttf pose > 5.0 || !good; safer pose < 4.0; }
system S { p: P; node Filter; module M; }
"""


def test_a_node_does_not_speak_against_what_the_log_has_of_it(tmp_path: Path) -> None:
    path = tmp_path / "estimator.soter"
    path.write_text(ESTIMATOR)
    program = load(path)
    log = track(tmp_path / "a.csv", [[k / 10, k / 20] for k in range(30)], ["t", "x"])
    mapping: dict[str, Any] = {
        "time": {"from": "t"},
        "topics": {"raw": {"fields": {"value": "x"}}},
    }
    judged = program.judge_log(log, mapping)
    assert judged.nodes == ("Filter",)
    assert judged.modules[0].first_switch_s == 2.01, "the node is heard one step later"
    mapping["topics"]["pose"] = {"fields": {"value": {"from": "x", "scale": 2.0}}}
    with pytest.raises(SoterError) as error:
        program.judge_log(log, mapping)
    (problem,) = error.value.diagnostics
    assert problem.notes == (
        "missing: good (which `Filter` publishes, of which the log has other topics)",
    )


def test_the_faults_of_a_system_are_not_put_into_a_log(tmp_path: Path) -> None:
    rows: list[list[object]] = [[k / 10, k / 20] for k in range(30)]
    log = track(tmp_path / "a.csv", rows, ["t", "x"])
    mapping = {"time": {"from": "t"}, "topics": {"raw": {"fields": {"value": "x"}}}}
    judgements = []
    faults = "faults { silent Filter.pose at 800 per 1h for 1s; late M.dm by 90ms at 3600 per 1h; }"
    for more in ("", faults):
        path = tmp_path / "estimator.soter"
        path.write_text(ESTIMATOR.replace("module M; }", f"module M; {more} }}"))
        program = load(path)
        assert program.ok, program.diagnostics
        judgements.append(program.judge_log(log, mapping).modules)
    assert judgements[0] == judgements[1]


def test_a_module_that_reads_the_mode_of_an_undecided_one_is_undecided(tmp_path: Path) -> None:
    path = tmp_path / "two.soter"
    path.write_text(TWO)
    log = track(tmp_path / "a.csv", [[k / 10, k / 20] for k in range(30)], ["t", "b"])
    mapping = {"time": {"from": "t"}, "topics": {"b": {"fields": {"value": "b"}}}}
    with pytest.raises(SoterError) as error:
        load(path).judge_log(log, mapping)
    left, right = error.value.diagnostics
    assert (left.code, right.code) == ("D017", "D017")
    assert left.notes == ("missing: a (which plant `p` drives)",)
    assert right.notes == ("missing: Left (whose mode it reads)",)


def test_reads_outside_of_safe_exit_with_3(tmp_path: Path, capsys: Any) -> None:
    mapping = tmp_path / "map.json"
    mapping.write_text(json.dumps(CART_MAP))
    inside = track(tmp_path / "a.csv", cart_rows(), ["t", "x", "v"])
    assert command(capsys, CART, inside, "--map", mapping)[0] == 3
    short = track(tmp_path / "b.csv", cart_rows(40), ["t", "x", "v"])
    assert command(capsys, CART, short, "--map", mapping)[0] == 0


FLAGS = """soter 1;
topic on: bool max_age 1s; topic u: float in [-1.0, 1.0];
plant P period 10ms { drives on = true; state x: float; }
node One period 10ms { publishes u; step { publish u = 0.0; } }
node Two period 10ms { publishes u; step { publish u = 0.5; } }
rta M { ac One; sc Two; period 10ms; safe on; ttf !on; safer on; }
system S { p: P; module M; }
"""


def test_what_compares_no_numbers_has_no_distance(tmp_path: Path, capsys: Any) -> None:
    program, mapping = tmp_path / "flags.soter", tmp_path / "map.json"
    program.write_text(FLAGS)
    fields = {"value": "on"}
    mapping.write_text(json.dumps({"time": {"from": "t"}, "topics": {"on": {"fields": fields}}}))
    log = track(tmp_path / "a.csv", [[0, "true"], [0.5, "FALSE"], [0.9, 1]], ["t", "on"])
    assert main(["monitor", str(program), str(log), "--map", str(mapping), "--json"]) == 3
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    module = document["log"]["modules"]["M"]
    assert [c["time_s"] for c in module["changes"]] == [0.0, 0.5, 0.9]
    assert module["margin"] == {"distance": None, "time_s": 0.5, "bound": ""}
    code, said = command(capsys, program, log, "--map", mapping)
    assert (code, "inf" in said) == (3, False)


def mcap_of(path: Path, messages: list[tuple[int, str, bytes]], encoding: str = "json") -> Path:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer: Any = Writer(file)
        writer.start()
        channels: dict[str, int] = {}
        for time_ns, channel, data in messages:
            if channel not in channels:
                schema = writer.register_schema(channel, "jsonschema", b"{}")
                channels[channel] = writer.register_channel(channel, encoding, schema)
            writer.add_message(channels[channel], time_ns, data, time_ns)
        writer.finish()
    return path


def test_an_mcap_of_somebody_else_is_read_by_its_fields(tmp_path: Path) -> None:
    program = load(CART)
    fields = {"x": "pose.at.0", "v": {"from": "pose.speed", "unit": "cm/s"}}
    mapping = {
        "system": "Protected",
        "time": {"from": "clock", "unit": "ms"},
        "topics": {"motion": {"channel": "/odom", "fields": fields}},
    }
    rows = cart_rows()
    messages = []
    for k, (t, x, v) in enumerate(rows):
        body = {"clock": 1000 * t, "pose": {"at": [x, 0], "speed": 100 * v}}  # type: ignore[operator]
        messages.append((10**9 + k * 20_000_000, "/odom", json.dumps(body).encode()))
        messages.append((10**9 + k * 20_000_000, "/other", b"not json"))
    judged = program.judge_log(mcap_of(tmp_path / "a.mcap", messages), mapping)
    plain = program.judge_log(track(tmp_path / "a.csv", rows, ["t", "x", "v"]), CART_MAP)
    (a,), (b,) = judged.modules, plain.modules
    assert [(c.time_s, c.to) for c in a.changes] == [(c.time_s, c.to) for c in b.changes]


@pytest.mark.parametrize(
    ("data", "encoding", "channel", "told"),
    [
        (b"{}", "cbor", "/odom", "messages of `/odom` are `cbor`, not json"),
        (b"{}", "json", "/odom", "message 1 of `/odom` has no `x`"),
        (b"{", "json", "/odom", "cannot be used"),
        (b"{}", "json", "/odmo", "no message that counts stands on `/odom`"),
    ],
)
def test_an_mcap_that_does_not_fit_is_refused_with_its_message(
    tmp_path: Path, data: bytes, encoding: str, channel: str, told: str
) -> None:
    log = mcap_of(tmp_path / "a.mcap", [(0, channel, data)], encoding)
    mapping = {"topics": {"motion": {"channel": "/odom", "fields": {"x": "x", "v": "v"}}}}
    with pytest.raises(SoterError) as error:
        load(CART).judge_log(log, mapping, system="Protected")
    (problem,) = error.value.diagnostics
    assert problem.code == "D016"
    assert told in problem.message
