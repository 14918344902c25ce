"""How much of a log a verdict speaks of: all of it to the last record, and never of nothing.

Non-goals: what is decided (`tests/correct/test_real_logs.py`), damaged files.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra `logs` is not installed")

from generators.robot_logs import (
    CART,
    KINDS,
    MS,
    T0,
    TYPED,
    Recorded,
    flight,
    odometry,
    written,
)
from json_documents import problems_of
from soter.api import load
from soter.cli.main import main
from soter.cli.terminal.log_judgement import NOT_READ, NOTHING, verdict_line
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from soter.monitor.log_judgement import LogJudgement, ModuleOfLog

SECOND = 1000 * MS
OTHER = "/elsewhere"


def judged(log: Path, **motion: Any) -> LogJudgement:
    """The cart's module on a log of any kind."""
    given: dict[str, Any] = {"topics": {"motion": {**TYPED, **motion}}}
    if log.suffix == ".csv":
        given["time"] = {"from": "t", "unit": "ns"}
    return load(CART).judge_log(log, given, system="Protected")


def module_of(log: Path, **motion: Any) -> ModuleOfLog:
    (module,) = judged(log, **motion).modules
    return module


def elsewhere(*times_ns: int) -> list[Recorded]:
    """What another channel recorded, which nobody maps."""
    return [Recorded(T0 + t, odometry(T0 + t, 99.0, 99.0), OTHER) for t in times_ns]


def blinded(m: Recorded) -> Recorded:
    return replace(m, content=odometry(m.arrival_ns - MS, math.nan, 0.1))


def early(m: Recorded) -> Recorded:
    """Stamped by a clock that is an hour behind."""
    return replace(m, content=odometry(m.arrival_ns - 3600 * SECOND, 0.1, 0.1))


def ahead(m: Recorded) -> Recorded:
    return replace(m, content=odometry(m.arrival_ns + 3600 * SECOND, 0.1, 0.1))


# ---------------------------------------------------------------- the end


@pytest.mark.parametrize("name", KINDS)
def test_a_channel_that_falls_silent_is_too_old_until_another_ends(
    tmp_path: Path, name: str
) -> None:
    silent = [*flight(40), *elsewhere(0, 500 * MS, 1500 * MS)]
    judgement = judged(written(tmp_path, name, silent))
    (module,) = judgement.modules
    assert judgement.to_s == 1.5
    assert (module.steps, module.stale) == (31, 22), "the last message came at 0.390 s"
    assert (module.changes[-1].time_s, module.changes[-1].to) == (0.45, "SC")
    assert 0.0 < module.judged_share < 0.3


@all_rows("spoilt", [blinded, early, ahead])
@all_rows("name", ["flight.csv", "cdr.mcap", "protobuf.mcap", "lz4.bag", "ros2_message"])
def test_a_sensor_that_dies_for_good_is_too_old_until_its_log_ends(
    tmp_path: Path, name: str, spoilt: Callable[[Recorded], Recorded]
) -> None:
    whole = flight(100)
    middle = [spoilt(m) if 40 <= k < 95 else m for k, m in enumerate(whole)]
    end = [spoilt(m) if k >= 40 else m for k, m in enumerate(whole)]
    at_the_end = module_of(written(tmp_path, name, end))
    (tmp_path / "middle").mkdir()
    in_the_middle = module_of(written(tmp_path / "middle", name, middle))
    assert at_the_end.steps == in_the_middle.steps == 20
    assert at_the_end.changes == in_the_middle.changes[: len(at_the_end.changes)]
    assert [(c.time_s, c.to) for c in at_the_end.changes] == [(0.0, "AC"), (0.45, "SC")]
    assert (at_the_end.stale, at_the_end.judged) == (11, True)


def test_what_began_before_the_first_usable_sample_counts_as_not_judged(tmp_path: Path) -> None:
    begun = [blinded(m) if k < 50 else m for k, m in enumerate(flight(100))]
    module = module_of(written(tmp_path, "cdr.mcap", begun))
    assert (module.waiting, module.steps, module.judged_steps) == (10, 10, 10)
    earlier = module_of(written(tmp_path, "plain.bag", [*elsewhere(-500 * MS), *flight(50)]))
    assert (earlier.waiting, earlier.steps, earlier.judged_share) == (10, 10, 0.5)


@pytest.mark.parametrize("name", ["json.mcap", "ros2_plain"])
def test_of_a_choice_of_rows_the_log_ends_with_the_last_that_counts(
    tmp_path: Path, name: str
) -> None:
    both = [*flight(40), *(blinded(m) for m in flight(80)[40:]), *elsewhere(9 * SECOND)]
    log = written(tmp_path, name, both)
    given = {"topics": {"motion": TYPED}, "where": {"header.frame_id": "odom"}}
    judgement = load(CART).judge_log(log, given, system="Protected")
    assert judgement.to_s == 0.79, "what another channel has may be of another flight"
    assert 0.5 < judgement.modules[0].judged_share < 0.6
    told = "to the last row that counts, 8.210 s before the file ends"
    assert told in verdict_line(judgement.modules[0])
    assert any(n.startswith("other channels go on for 8.21 s;") for n in judgement.notes)


@pytest.mark.parametrize("name", ["json.mcap", "ros2_plain", "plain.bag"])
@pytest.mark.parametrize("far_ns", [-T0 + 1, 10**18])
def test_a_channel_of_another_clock_neither_begins_nor_ends_the_log(
    tmp_path: Path, name: str, far_ns: int
) -> None:
    far_ns = min(far_ns, 2 * 10**9 * SECOND - T0)  # a bag of ROS 1 has seconds of 32 bits
    both = sorted([*flight(40), *elsewhere(far_ns, 600 * MS)], key=lambda m: m.arrival_ns)
    judgement = judged(written(tmp_path, name, both))
    assert judgement.to_s == 0.6, "the other record of that channel ends it"
    side = "before" if far_ns < 0 else "after"
    (note,) = judgement.notes
    assert note.startswith("1 messages of `/elsewhere`, up to ")
    assert f"s {side} the rest, have another clock" in note


def test_a_time_from_the_messages_ends_as_much_later_as_the_log_does(tmp_path: Path) -> None:
    seconds = [replace(m, content=odometry(k * SECOND, 0.1, 0.1)) for k, m in enumerate(flight(9))]
    log = written(tmp_path, "json.mcap", [*seconds, *elsewhere(SECOND)])
    topics = {"motion": {"channel": TYPED["channel"], "fields": TYPED["fields"]}}
    time = {"from": "header.stamp.sec", "unit": "s"}
    judgement = load(CART).judge_log(log, {"topics": topics, "time": time}, system="Protected")
    assert judgement.to_s == pytest.approx(8.0 + 0.92), "0.92 s after the ninth message"


@all_rows("name", ["flight.csv", "cdr.mcap", "plain.bag"])
@all_rows(("at", "x"), [(22, 50.0), (3, 50.0), (39, 50.0), (22, 1e9)])
def test_a_sample_outside_that_no_step_reads_counts(
    tmp_path: Path, name: str, at: int, x: float
) -> None:
    """The DM steps at 0, 50 ms, ..., where it reads every fifth sample."""
    now = T0 + at * 10 * MS
    once = [*flight(40)]
    once[at] = replace(once[at], content=odometry(now - MS, x, 0.1))
    module = module_of(written(tmp_path, name, once))
    assert (module.outside, module.outside_late, module.violated) == (0, 1, True)


def test_a_sample_outside_that_the_gate_refuses_counts(judge: Any) -> None:
    rows = SOME.replace("1.0,0.1,0.1", "1.0,900.0,0.1")
    code, document, told = judge(rows, text_set="topic a: float in [-5.0, 5.0]")
    left = document["log"]["modules"]["Left"]
    assert (code, left["outside"], left["outside_late"]) == (3, 0, 1)
    assert document["log"]["refused"]["a"]["samples"] == 1
    assert "the gate refused or no step read" in told


def test_a_read_outside_after_the_last_step_counts(tmp_path: Path) -> None:
    """The DM steps every 50 ms; 0.36 s is after its last step."""
    last = [*flight(36), Recorded(T0 + 360 * MS, odometry(T0 + 359 * MS, 50.0, 0.1))]
    module = module_of(written(tmp_path, "cdr.mcap", last))
    assert (module.outside, module.outside_late, module.violated) == (0, 1, True)
    assert module.first_outside_s == 0.36
    assert not module_of(written(tmp_path, "bz2.bag", flight(37))).violated


# ---------------------------------------------------------------- nothing, and a part

TWO = """soter 1;
topic a: float max_age 1s; topic b: float max_age 1s; topic c: float;
input topic button: bool max_age 2s;
topic u: float in [-1.0, 1.0]; topic w: float in [-1.0, 1.0];
plant P period 10ms { drives a = x; drives b = x; drives c = x; state x: float; }
node Sum period 10ms { subscribes a, b; publishes c; step { publish c = a + b; } }
node One period 10ms { publishes u; step { publish u = 0.0; } }
node Two period 10ms { publishes u; step { publish u = 0.5; } }
node Three period 10ms { publishes w; step { publish w = 0.0; } }
node Four period 10ms { publishes w; step { publish w = 0.5; } }
rta Left { ac One; sc Two; period 100ms; safe SAFE; ttf a > 1.0; safer a < 0.5; }
rta Right { ac Three; sc Four; period 100ms; safe b < 2.0; ttf b > 1.0; safer b < 0.5; BACK }
system S { p: P; module Left; module Right; }
"""


@pytest.fixture
def judge(tmp_path: Path, capsys: Any) -> Callable[..., Any]:
    """Exit code, document and text of the command, on rows of a CSV."""

    def command(
        rows: str, names: Sequence[str] = ("a", "b"), *more: str, safe: str = "a < 2.0", **kind: Any
    ) -> Any:
        program, log = tmp_path / "two.soter", tmp_path / "log.csv"
        text = TWO.replace("drives c = x; ", "") if kind.get("sum") else TWO
        text = text if kind.get("sum") else text.replace("\nnode Sum", "\n// node Sum")
        text = text.replace("p: P;", "p: P; node Sum;") if kind.get("sum") else text
        program.write_text(text.replace("SAFE", safe).replace("BACK", kind.get("back", "")))
        if "text_set" in kind:
            program.write_text(program.read_text().replace("topic a: float", kind["text_set"], 1))
        log.write_text(rows)
        topics = {n: {"fields": {"value": n}, **kind.get(n, {})} for n in names}
        given = tmp_path / "map.json"
        given.write_text(json.dumps({"time": {"from": "t"}, "topics": topics}))
        arguments = ["monitor", str(program), str(log), "--map", str(given), *more]
        code = main(arguments)
        told = capsys.readouterr().out
        assert main([*arguments, "--json"]) == code
        document = json.loads(capsys.readouterr().out)
        assert problems_of(document) == []
        return code, document, told

    return command


STAMPED = {"a": {"stamp": {"from": "s", "unit": "s"}}}
SOME = "t,a,b\n" + "".join(f"{k / 10},0.1,0.1\n" for k in range(20))


def test_a_module_of_which_every_read_came_too_late_is_not_passed(judge: Any) -> None:
    rows = "t,s,a,b\n" + "".join(f"{1000 + k},{k + 1},5.0,0.1\n" for k in range(20))
    code, document, told = judge(rows, **STAMPED)
    modules = document["log"]["modules"]
    assert (code, modules["Left"]["judged"], modules["Right"]["judged"]) == (4, False, True)
    assert modules["Left"]["decided"], "which says whether the log has the topics"
    assert (modules["Left"]["outside"], modules["Left"]["outside_late"]) == (0, 191)
    assert document["log"]["far_stamps"]["a"] == {"samples": 20, "offset_s": -999, "length_s": 19}
    assert "20 stamps of a (`s`) are further from the log's clock" in told
    assert "up to 999.000 s before it" in told
    assert "Left: nothing was judged, and that is no verdict: every read of its DM" in told
    assert f"191 {NOT_READ} lay outside `safe`" in told


@pytest.mark.parametrize(
    ("rows", "names", "safe", "why"),
    [
        (SOME.replace("0.1,0.1\n", ",0.1\n", 19), ("a", "b"), "a < 2.0", "the log ends before"),
        (SOME, ("a", "b"), "c < 2.0", "`safe` reads c"),
        (SOME, ("a", "b"), "float(1 / int(a - a)) < 2.0", "or it faulted"),
    ],
)
def test_other_ways_of_judging_nothing_are_told_with_their_reason(
    judge: Any, rows: str, names: Any, safe: str, why: str
) -> None:
    rows = rows.replace("1.9,0.1,0.1", "1.95,0.1,0.1")  # after the last step
    code, document, told = judge(rows, names, safe=safe)
    modules = document["log"]["modules"]
    assert (code, modules["Left"]["judged"], modules["Right"]["judged"]) == (4, False, True)
    (line,) = [t for t in told.splitlines() if t.startswith("Left: nothing was judged")]
    assert why in line


def test_a_read_outside_of_another_module_is_said_first(judge: Any) -> None:
    rows = SOME.replace("t,a,b", "t,a,b").replace(",0.1,0.1", ",,5.0").replace("0.0,,", "0.0,5.0,")
    code, document, _ = judge(rows)
    modules = document["log"]["modules"]
    assert (code, modules["Right"]["outside"]) == (3, 20)


def test_formats_for_ci_say_that_nothing_was_judged(
    judge: Any, tmp_path: Path, capsys: Any
) -> None:
    rows = "t,s,a,b\n" + "".join(f"{1000 + k},{k + 1},0.0,0.1\n" for k in range(20))
    page = tmp_path / "page.html"
    judge(rows, ("a", "b"), "--report", str(page), **STAMPED)
    assert "Left: nothing was judged" in page.read_text()
    arguments = ["monitor", *(str(tmp_path / n) for n in ("two.soter", "log.csv"))]
    arguments += ["--map", str(tmp_path / "map.json"), "--format"]
    assert main([*arguments, "junit"]) == 4
    suites = ET.fromstring(capsys.readouterr().out)  # noqa: S314 - of this very process
    assert (suites.get("errors"), suites.get("failures")) == ("1", "0")
    (error,) = suites.iter("error")
    assert "nothing was judged" in str(error.get("message"))
    assert "999.000 s before it" in str(error.text)
    assert main([*arguments, "sarif"]) == 4
    results = json.loads(capsys.readouterr().out)["runs"][0]["results"]
    assert [r["level"] for r in results if r["ruleId"] == "monitor"] == ["error"]
    assert main([*arguments, "github"]) == 4
    assert "::error title=soter%3A monitor" in capsys.readouterr().out


def test_a_part_is_said_with_its_share_and_what_came_late_in_it_counts(judge: Any) -> None:
    inside = "t,s,a,b\n" + "".join(
        f"{10 + k / 10},{10 + k / 10 if k < 10 else 11 + k / 1000},0.1,0.1\n" for k in range(40)
    )
    code, document, told = judge(inside, **STAMPED)
    left = document["log"]["modules"]["Left"]
    assert (code, left["judged"], left["outside_late"]) == (0, True, 0)
    assert 0.0 < left["judged_share"] < 1.0
    assert f"judged in {left['judged_share']:.1%} of the log" in told.splitlines()[2]
    outside = inside.replace("039,0.1,", "039,9.9,")  # the last
    code, document, told = judge(outside, **STAMPED)
    assert code == 3
    assert document["log"]["modules"]["Left"]["outside_late"] > 0


def test_a_module_begins_when_its_own_reads_are_there(judge: Any) -> None:
    """Before, all began with the last topic of all: what was outside until then nobody saw."""
    rows = "t,a,b\n" + "".join(
        f"{k / 10},{5.0 if k < 15 else 0.1},{'' if k < 19 else 0.1}\n" for k in range(40)
    )
    code, document, _ = judge(rows)
    modules = document["log"]["modules"]
    assert (code, modules["Left"]["outside"]) == (3, 15)
    assert (modules["Left"]["waiting"], modules["Right"]["waiting"]) == (0, 19)


def test_a_node_begins_when_all_that_reaches_it_is_there(judge: Any) -> None:
    rows = "t,a,b\n" + "".join(f"{k / 10},0.1,{'' if k < 20 else 5.0}\n" for k in range(40))
    code, document, _ = judge(rows, safe="c < 2.0", sum=True)
    left = document["log"]["modules"]["Left"]
    assert document["log"]["nodes"] == ["Sum"]
    assert (code, left["steps"], left["first_outside_s"]) == (3, 40, 2.1)
    assert left["judged_share"] == pytest.approx(19 / 40), "until then nobody knew `c`"


def test_reads_without_an_age_are_named_with_how_old_they_became(judge: Any) -> None:
    rows = "t,a,b,c\n0.0,0.1,0.1,0.1\n" + "".join(f"{k / 10},0.1,0.1,\n" for k in range(1, 31))
    code, document, _ = judge(rows, ("a", "b", "c"), safe="c < 2.0")
    told = "`c` has no `max_age`: its reads count however old, here up to 3 s"
    assert (code, told in document["log"]["assumptions"]) == (0, True)


# ---------------------------------------------------------------- the model monitor


@pytest.mark.parametrize("seeds", ["1", "1..3"])
def test_a_run_without_a_step_is_not_explained(seeds: str, capsys: Any) -> None:
    arguments = ["monitor", str(CART), "--system", "Protected", "--until", "1ms", "--seed", seeds]
    assert main(arguments) == 4
    assert "SafeCart: nothing was judged, and that is no verdict" in capsys.readouterr().out
    assert main([*arguments, "--json"]) == 4
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    assert document["modules"]["SafeCart"]["judged"] is False


@pytest.mark.parametrize(
    ("late_s", "silent_after", "code", "share"),
    [(0.0, 201, 0, 1.0), (0.0, 100, 0, 0.5), (900.0, 201, 4, 0.0), (0.0, 1, 4, 0.0)],
)
def test_estimates_are_judged_for_the_share_that_is_told(
    tmp_path: Path, capsys: Any, late_s: float, silent_after: int, code: int, share: float
) -> None:
    log, given = tmp_path / "drive.csv", tmp_path / "map.json"
    rows = [
        f"{1000 + k / 200},{1000 + k / 200 - late_s},{0.0025 * k if k < silent_after else ''},0.5,0"
        for k in range(201)
    ]
    log.write_text("t,s,x,u,a\n" + "\n".join(rows))
    stamp = {"from": "s", "unit": "s"}
    topics = {
        "position": {"fields": {"value": "x"}, "stamp": stamp},
        "speed": {"fields": {"value": "u"}, "stamp": "arrival"},
    }
    given.write_text(json.dumps({"system": "Track", "time": {"from": "t"}, "topics": topics}))
    shuttle = CART.parent / "shuttle.soter"
    arguments = ["monitor", str(shuttle), str(log), "--map", str(given), "--estimates"]
    assert main([*arguments, "--json"]) == code
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    module = document["modules"]["Guard"]
    assert module["judged_share"] == pytest.approx(share, abs=0.02)
    assert module["judged"] is (code == 0)
    assert any("further from the log's clock" in n for n in module["notes"]) == (late_s > 0.0)
    assert main(arguments) == code
    head = capsys.readouterr().out.splitlines()[0]
    assert ("of the log" in head) == (share < 1.0)


# ---------------------------------------------------------------- what the mapping says


def test_a_module_that_a_log_leaves_undecided_is_an_error_beside_those_that_are_judged(
    judge: Any, tmp_path: Path, capsys: Any
) -> None:
    code, document, told = judge(SOME, names=("b",))
    undecided = [n for n, m in document["log"]["modules"].items() if not m["decided"]]
    assert (code, undecided) == (4, ["Left"])
    assert f"Left: {NOTHING}: its DM reads a (" in told.split("module  judged")[0]
    assert judge(SOME, ("b",), "--module", "Right")[0] == 0, "who asks of one is told of one"
    arguments = ["monitor", str(tmp_path / "two.soter"), str(tmp_path / "log.csv")]
    arguments += ["--map", str(tmp_path / "map.json")]
    assert main([*arguments, "--format", "junit"]) == 4
    suite = ET.fromstring(capsys.readouterr().out)  # noqa: S314 - our own
    cases = {c.get("name"): c.find("error") is not None for c in suite.iter("testcase")}
    assert cases == {"Left": True, "Right": False}
    main([*arguments, "--report", str(tmp_path / "page.html")])
    assert f"Left: {NOTHING}" in (tmp_path / "page.html").read_text()


def test_a_press_that_the_log_has_not_is_named_with_what_follows(judge: Any) -> None:
    code, document, told = judge(SOME, back="returns after button;")
    right = document["log"]["modules"]["Right"]
    assert (code, right["judged"], right["press_missing"]) == (0, True, ["button (an input)"])
    assert (right["ac_share"], right["first_switch_s"]) == (None, None)
    assert "the log does not give button (an input)" in told
    assert document["log"]["modules"]["Left"]["press_missing"] == []
    pressed = SOME.replace("t,a,b", "t,a,b,button").replace("0.1\n", "0.1,\n")
    for at, value in (("0.3", "0"), ("0.5", "1.0")):
        pressed = pressed.replace(f"\n{at},0.1,0.1,", f"\n{at},0.1,0.1,{value}")
    code, document, told = judge(pressed, ("a", "b", "button"), back="returns after button;")
    right = document["log"]["modules"]["Right"]
    assert (code, right["press_missing"], right["waiting"]) == (0, [], 0)
    assert [(c["time_s"], c["to"]) for c in right["changes"]] == [(0.5, "AC")]


def test_whole_numbers_and_truths_may_be_written_as_decimals(tmp_path: Path) -> None:
    from soter.diagnostics.diagnostic import SoterError

    program, log = tmp_path / "p.soter", tmp_path / "log.csv"
    program.write_text(
        "soter 1; topic n: int in [0, 10]; topic on: bool; topic u: float in [-1.0, 1.0];"
        "plant P period 10ms { drives n = 1; drives on = true; state x: float; }"
        "node A period 10ms { publishes u; step { publish u = 0.0; } }"
        "node B period 10ms { publishes u; step { publish u = 0.5; } }"
        "rta M { ac A; sc B; period 100ms; safe n < 9; ttf n > 5 || !on; safer n < 3 && on; }"
        "system S { p: P; module M; }"
    )
    topics = {n: {"fields": {"value": n}} for n in ("n", "on")}

    def values(n: str, on: str) -> Any:
        log.write_text(f"t,n,on\n0,{n},{on}\n1,{n},{on}\n")
        return load(program).judge_log(log, {"time": {"from": "t"}, "topics": topics})

    for n, on in (("2", "1"), ("2.0", "1.0"), ("2e0", "TRUE"), ("0.2e1", "1.")):
        assert values(n, on).modules[0].ac == 11, (n, on)
    assert values("-0.0", "0.0").modules[0].ttf == 11
    for n, on in (("2.5", "1"), ("2", "0.5"), ("2", "2.0"), ("1e999999999", "1"), ("2", "nan")):
        with pytest.raises(SoterError) as error:
            values(n, on)
        assert error.value.diagnostics[0].code == "D016", (n, on)


@pytest.mark.parametrize(
    "name", ["flight.csv", "json.mcap", "ros1.mcap", "plain.bag", "ros2_plain"]
)
def test_a_topic_may_choose_its_messages(tmp_path: Path, name: str) -> None:
    """Two robots on one channel; before, a choice had to be true of every channel."""
    two = [
        Recorded(T0 + k * 10 * MS, odometry(T0 + k * 10 * MS - MS, x, 0.1, frame))
        for k in range(80)
        for x, frame in ([(0.01 * k, "one")] if k % 2 else [(70.0, "two")])
    ]
    log = written(tmp_path, name, two)
    assert module_of(log).violated
    chosen = judged(log, where={"header.frame_id": "one"})
    assert (chosen.samples["motion"], chosen.left_out) == (40, {})
    assert not chosen.modules[0].violated


def test_a_choice_of_no_message_is_told(tmp_path: Path) -> None:
    from generators.robot_logs import refused

    log = written(tmp_path, "json.mcap")
    told = refused(log, where={"header.frame_id": "nobody"})
    assert "no row of it has all of `motion` and header.frame_id = nobody" in told
    assert "has no `header.colour`" in refused(log, where={"header.colour": "red"})
    assert "`where` of `motion` is no table" in refused(log, "D015", where=3)


def test_an_error_of_nothing_measured_is_none(tmp_path: Path, capsys: Any) -> None:
    log, given = tmp_path / "a.csv", tmp_path / "map.json"
    log.write_text("t,x\n0.0,0.1\n0.1,0.1\n")
    fields = {"x": "x", "v": {"slope": "x", "window": "10s"}}
    topics = {"motion": {"fields": fields, "between": "linear"}}
    given.write_text(json.dumps({"time": {"from": "t"}, "topics": topics}))
    arguments = ["monitor", str(CART), str(log), "--map", str(given), "--system", "Protected"]
    main([*arguments, "--json"])
    document = json.loads(capsys.readouterr().out)
    assert problems_of(document) == []
    errors = {d["name"]: d["error"] for d in document["log"]["derived"]}
    assert errors["motion.v"] is None
    main(arguments)
    assert "motion.v  none, none, none" in capsys.readouterr().out
