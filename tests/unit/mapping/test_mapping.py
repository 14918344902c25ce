"""What a mapping says of messages: it is turned into names, scales and offsets, or refused.

Non-goals: mappings without types (`tests/unit/monitor/test_foreign_logs.py`), logs.
"""

from __future__ import annotations

import copy
import math
import re
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from soter.mapping.frames import turn_between
from soter.mapping.message_types import StampSource
from soter.mapping.read_mapping import make_log_map, read_mapping
from soter.mapping.topic_mapping import SignalSource
from soter.mapping.units import UNITS, factor_between
from tables import all_rows

if TYPE_CHECKING:
    from soter.mapping.topic_mapping import TopicMap

PROGRAM = """soter 1;
type Gear = enum { LOW, HIGH };
type Vector = { x: float, y: float, z: float };
type Flight = {
  at: Vector unit "m", speed: float[3] unit "m/s", turn: float unit "deg/s", plain: float
};
type Pair = { a: float, b: float };
topic flight: Flight;
topic wind: Vector; topic pair: Pair;
topic gear: Gear; topic on: bool;
topic count: int in [0, 9];
topic force: float unit "furlong";
topic push: float in [-1.0, 1.0];
plant P period 10ms {
  drives wind = { x: x, y: 0.0, z: 0.0 };
  drives gear = Gear.LOW; drives on = true;
  drives count = 0;
  drives force = 0.0;
  drives pair = { a: x, b: x };
  drives flight = { at: { x: x, y: x, z: x }, speed: [x, x, x], turn: x, plain: x };
  state x: float;
}
node A period 10ms { publishes push; step { publish push = 0.0; } }
node B period 10ms { publishes push; step { publish push = 0.0; } }
rta M { ac A; sc B; period 100ms; safe wind.x < 9.0; ttf wind.x > 5.0; safer wind.x < 4.0; }
system S { p: P; module M; }
"""
ODOMETRY = {"channel": "/odom", "type": "nav_msgs/Odometry"}
FLIGHT: dict[str, Any] = {
    **ODOMETRY,
    "fields": {
        "at": ["pose.pose.position.x", "pose.pose.position.y", "pose.pose.position.z"],
        "speed": ["twist.twist.linear.x", "twist.twist.linear.y", "twist.twist.linear.z"],
        "turn": "twist.twist.angular.z",
        "plain": "twist.twist.angular.z",
    },
}


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> Any:
    path = tmp_path_factory.mktemp("program") / "p.soter"
    path.write_text(PROGRAM)
    program = load(path)
    assert program.ok, program.diagnostics
    return program.flat()


def read(system: Any, topic: str, given: Any, folder: Path | None = None, **top: Any) -> TopicMap:
    (made,) = make_log_map(
        {**top, "topics": {topic: given}}, system, file=folder and folder / "map.toml"
    ).topics
    return made


def test_a_mistake_is_told_with_its_file(system: Any, tmp_path: Path) -> None:
    file = tmp_path / "map.toml"
    with pytest.raises(SoterError) as error:
        make_log_map({"topics": {}, "frame": "UP"}, system, file=file)
    assert {d.notes for d in error.value.diagnostics} == {(f"in the mapping `{file}`",)}


def told(system: Any, given: Any, folder: Path | None = None) -> list[str]:
    with pytest.raises(SoterError) as error:
        make_log_map(given, system, file=folder and folder / "map.toml")
    assert {d.code for d in error.value.diagnostics} == {"D015"}
    return [d.message for d in error.value.diagnostics]


def signals(made: TopicMap) -> dict[str, tuple[str, float, float]]:
    leaves = {".".join(p): leaf for p, leaf in made.leaves.items()}
    assert all(isinstance(leaf, SignalSource) for leaf in leaves.values())
    return {p: (leaf.name, leaf.scale, leaf.offset) for p, leaf in leaves.items()}  # type: ignore[union-attr]


# ---------------------------------------------------------------- frames and vectors


@pytest.mark.parametrize(
    ("frame", "program", "turned"),
    [
        ("ENU", "ENU", (("a", 1.0), ("b", 1.0), ("c", 1.0))),
        ("NED", "ENU", (("b", 1.0), ("a", 1.0), ("c", -1.0))),
        ("ENU", "NED", (("b", 1.0), ("a", 1.0), ("c", -1.0))),
        ("NED", "NED", (("a", 1.0), ("b", 1.0), ("c", 1.0))),
        ("FLU", "ENU", (("a", 1.0), ("b", 1.0), ("c", 1.0))),
        ("FRD", "ENU", (("a", 1.0), ("b", -1.0), ("c", -1.0))),
        ("FLU", "NED", (("a", 1.0), ("b", -1.0), ("c", -1.0))),
        ("FRD", "NED", (("a", 1.0), ("b", 1.0), ("c", 1.0))),
    ],
)
def test_a_vector_is_turned_from_the_frame_of_its_topic_into_the_programs(
    system: Any, frame: str, program: str, turned: tuple[tuple[str, float], ...]
) -> None:
    given = {"frame": frame, "fields": {"value": ["a", "b", "c"]}}
    made = read(system, "wind", given, frame=program)
    assert tuple((n, s) for n, s, _ in signals(made).values()) == turned


TWIST = {"type": "geometry_msgs/Twist"}
LINEAR = ["linear.x", "linear.y", "linear.z"]
KNOWN_FRAMES: list[tuple[str, dict[str, Any], str]] = [
    ("ENU", {"channel": "/mavros/odom_ned", "fields": {"value": ["a", "b", "c"]}}, "NED"),
    ("ENU", {"frame_id": "map_ned", "fields": {"value": ["a", "b", "c"]}}, "NED"),
    ("ENU", {"channel": "vehicle_local_position", "fields": {"value": ["x", "y", "z"]}}, "NED"),
    ("ENU", {"channel": "vehicle_local_position_0.csv", "fields": {"value": list("xyz")}}, "NED"),
    ("ENU", {"channel": "LOCAL_POSITION_NED", "fields": {"value": ["x", "y", "z"]}}, "NED"),
    ("ENU", {"channel": "XKF1", "fields": {"value": ["VN", "VE", "VD"]}}, "NED"),
    ("ENU", {"fields": {"value": ["north", "east", "down"]}}, "NED"),
    ("ENU", {"fields": {"value": {"from": ["n", "e", "pos_down"], "unit": "mm"}}}, "NED"),
    ("ENU", {"fields": {"value": ["north_m", "east_m", "down_m"]}}, "NED"),
    ("ENU", {"fields": {"value": ["vel_n_m_s", "vel_e_m_s", "vel_d_m_s"]}}, "NED"),
    ("ENU", {"channel": "sensor_combined", "fields": {"value": ["g.0", "g.1", "g.2"]}}, "FRD"),
    ("ENU", {"channel": "/imu_frd/data", "fields": {"value": ["a", "b", "c"]}}, "FRD"),
    ("NED", {**TWIST, "fields": {"value": LINEAR}}, "ENU"),
]
"""Of the program, what the mapping says of a topic, and the frame that this is known to have."""


@all_rows(("program", "given", "known"), KNOWN_FRAMES)
def test_a_vector_whose_frame_is_known_and_another_says_which_is_meant(
    system: Any, program: str, given: dict[str, Any], known: str
) -> None:
    (message,) = told(system, {"topics": {"wind": given}, "frame": program})
    assert f"is in {known}, the program in {program}: " in message
    for frame in (known, program):
        assert f'`frame = "{frame}"`' in message
        assert read(system, "wind", {**given, "frame": frame}, frame=program)
    other = {"ENU": "NED", "NED": "ENU"}[program]
    assert read(system, "wind", given, frame=other), "a program in that frame says nothing more"


@all_rows(
    "given",
    [
        {"fields": {"value": ["a", "b", "c"]}},
        {"fields": {"value": ["x_d", "y_d", "z_d"]}},
        {"channel": "/opened", "fields": {"value": ["planned", "b", "c"]}},
        {"channel": "/camera_down/pd", "fields": {"value": ["down", "b", "touchdown"]}},
        {"channel": "GPS_NED", "fields": {"value": ["lat", "lon", "alt"]}},
        {"channel": "ned", "fields": {"x": "a", "y": "b", "z": "c"}},
        {**TWIST, "fields": {"value": LINEAR}},
    ],
)
def test_a_vector_whose_frame_nobody_knows_is_taken_as_it_is(system: Any, given: Any) -> None:
    made = read(system, "wind", given)
    assert [s for _, s, _ in signals(made).values()] == [1.0] * 3


def test_turning_there_and_back_is_nothing() -> None:
    for given, program in [("NED", "ENU"), ("FRD", "ENU")]:
        once = turn_between(given, program)
        twice = [(once[component][0], sign * once[component][1]) for component, sign in once]
        assert twice == [(0, 1.0), (1, 1.0), (2, 1.0)]


def test_a_vector_without_a_frame_is_taken_as_it_is_and_may_have_a_unit(system: Any) -> None:
    given = {"fields": {"value": {"from": ["a", "b", "c"], "unit": "mm", "scale": 2}}}
    assert signals(read(system, "wind", given)) == {
        n: (c, 0.002, 0.0) for n, c in [("x", "a"), ("y", "b"), ("z", "c")]
    }


def test_a_record_and_an_array_of_three_floats_are_vectors(system: Any) -> None:
    made = signals(read(system, "flight", {**FLIGHT, "frame": "NED"}))
    assert made["at.x"] == ("pose.pose.position.y", 1.0, 0.0)
    assert made["at.z"] == ("pose.pose.position.z", -1.0, 0.0)
    assert made["speed.[2]"] == ("twist.twist.linear.z", -1.0, 0.0)


# ---------------------------------------------------------------- units


def test_a_number_is_turned_from_its_unit_into_that_of_the_program(system: Any) -> None:
    made = signals(read(system, "flight", FLIGHT))
    assert made["at.x"][1] == 1.0
    assert made["turn"][1] == pytest.approx(180.0 / math.pi)  # rad/s, and the program has deg/s
    assert made["plain"][1] == 1.0  # a program without a unit counts in SI


def test_si_in_a_program_in_si_changes_nothing() -> None:
    for unit, factor in UNITS.items():
        assert factor_between(unit, "") == factor
        assert factor_between(unit, unit) == 1.0
    assert factor_between("mm", "m") == UNITS["mm"]
    assert factor_between("km/h", "m/s") == 1.0 / 3.6
    assert factor_between("m", "m/s") is None
    assert factor_between("m", "furlong") is None


# ---------------------------------------------------------------- messages


@pytest.mark.parametrize(
    ("given", "stamp"),
    [
        ({}, StampSource("header.stamp")),
        ({"stamp": "arrival"}, None),
        ({"stamp": "header.stamp"}, StampSource("header.stamp")),
        (
            {"stamp": {"from": "header.seq", "unit": "us"}},
            StampSource("header.seq", "number", Fraction(1000)),
        ),
        ({"type": None, "stamp": "t"}, StampSource("t")),
        ({"type": None}, None),
        ({"type": "geometry_msgs/Twist"}, None),
    ],
)
def test_the_stamp_is_what_the_mapping_says_or_that_of_the_header(
    system: Any, given: Any, stamp: StampSource | None
) -> None:
    fields = {"value": ["twist.twist.linear.x", "twist.twist.linear.y", "twist.twist.linear.z"]}
    if given.get("type"):
        fields = {"value": ["linear.x", "linear.y", "linear.z"]}
    topic = {**ODOMETRY, "fields": fields, **given}
    made = read(system, "wind", {k: v for k, v in topic.items() if v is not None})
    assert made.stamp == stamp


def test_what_a_topic_says_of_its_messages_is_kept(system: Any) -> None:
    given = {
        "channel": "/wind",
        "type": "geometry_msgs/msg/Vector3Stamped",
        "publisher": "/ekf",
        "frame_id": "odom",
        "fields": {"value": ["vector.x", "vector.y", "vector.z"]},
        "set": {"header.frame_id": "base_link"},
    }
    made = read(system, "wind", given)
    assert made.message is not None
    assert (made.message.ros1, made.channel) == ("geometry_msgs/Vector3Stamped", "/wind")
    assert (made.publisher, made.frame_id) == ("/ekf", "odom")
    assert made.constants == {"header.frame_id": "base_link"}


def test_ones_own_messages_are_read_from_beside_the_mapping(system: Any, tmp_path: Path) -> None:
    (tmp_path / "msg").mkdir()
    (tmp_path / "msg" / "Foo.msg").write_text("std_msgs/Header header\nfloat32[] gusts\n")
    given = {
        "messages": {"my_msgs/Foo": "msg/Foo.msg"},
        "topics": {
            "wind": {
                "type": "my_msgs/Foo",
                "fields": {"x": "gusts.0", "y": "gusts.1", "z": {"constant": 0.0}},
            }
        },
    }
    (made,) = make_log_map(given, system, file=tmp_path / "map.toml").topics
    assert made.optional == {"gusts.0", "gusts.1"}
    assert made.stamp == StampSource("header.stamp")


def test_truths_numbers_and_texts_come_from_fields_of_their_kinds(system: Any) -> None:
    for topic, type_, field in [
        ("on", "std_msgs/Bool", "data"),
        ("on", "std_msgs/UInt8", "data"),
        ("count", "std_msgs/Int32", "data"),
        ("gear", "std_msgs/String", "data"),
        ("push", "std_msgs/Float32", "data"),
        ("push", "std_msgs/Int64", "data"),
    ]:
        made = read(system, topic, {"type": type_, "fields": {"value": field}})
        assert made.names == [field]


# ---------------------------------------------------------------- mistakes

P = "pose.pose.position."
WRONG: list[tuple[str, Any, str]] = [
    ("wind", {"type": "nav_msgs/Odom"}, "`type` of `wind` is `nav_msgs/Odom`, which is not known"),
    ("wind", {"type": 3}, "`type` of `wind` is no name"),
    ("wind", {"frame": "RFU"}, "`frame` of `wind` is 'RFU': there are ENU, NED, FLU, FRD"),
    ("wind", {"frame": ["ENU"]}, "`frame` of `wind` is ['ENU']"),
    ("wind", {"frame": "NED", "fields": {"x": "a", "y": "b", "z": "c"}}, "turns nothing"),
    ("wind", {"fields": {"value": ["a", "b"]}}, "needs the names of three fields"),
    ("wind", {"fields": {"value": ["a", "b", 3]}}, "needs the names of three fields"),
    ("wind", {"fields": {"value": ["a", "b", "a"]}}, "names a field twice"),
    ("wind", {"fields": {"value": "a"}}, "needs the names of three fields"),
    ("wind", {"fields": {"value": {"from": ["a", "b", "c"], "offset": 1}}}, "says `offset`"),
    ("wind", {"fields": {"value": {"constant": 1.0}}}, "says `constant`"),
    ("wind", {"fields": {"value": ["a", "b", "c"], "x": "d"}}, "`wind.x` is given twice"),
    (
        "pair",
        {"fields": {"value": ["a", "b", "c"]}},
        "three floats here: name each of its fields, `pair.",
    ),
    ("wind", {"fields": {"x": ["a"], "y": "b", "z": "c"}}, "neither the name of a column"),
    (
        "flight",
        {
            **FLIGHT,
            "fields": {**FLIGHT["fields"], "turn": {"from": "a", "unit": "m"}},
            "type": None,
        },
        "`flight.turn` is in `deg/s`, an angular speed, and `a` is in `m`, a length",
    ),
    (
        "flight",
        {**FLIGHT, "fields": {**FLIGHT["fields"], "turn": P + "x"}},
        "`flight.turn` is in `deg/s`, an angular speed, and `pose.pose.position.x` is in `m`",
    ),
    (
        "flight",
        {**FLIGHT, "fields": {**FLIGHT["fields"], "plain": {"from": P + "x", "unit": "mm"}}},
        "`flight.plain` is read in `mm`, and `pose.pose.position.x` of nav_msgs/Odometry is in `m`",
    ),
    ("force", {"fields": {"value": {"from": "a", "unit": "N"}}}, "is in `furlong`, and `a` is in"),
    (
        "wind",
        {**ODOMETRY, "fields": {"value": [P + "x", P + "y", P + "up"]}},
        "`wind.z`: `pose.pose.position` of nav_msgs/Odometry has no `up`",
    ),
    ("push", {**ODOMETRY, "fields": {"value": "child_frame_id"}}, "nav_msgs/Odometry is `string`"),
    ("push", {**ODOMETRY, "fields": {"value": "header.stamp"}}, "nav_msgs/Odometry is `time`"),
    ("push", {**ODOMETRY, "fields": {"value": "pose.covariance"}}, "is a list"),
    ("push", {**ODOMETRY, "fields": {"value": "pose.covariance.010"}}, "is written as `10`"),
    (
        "push",
        {"fields": {"value": {"from": "a", "scale": 1e-323, "unit": "mm"}}},
        "times its unit, is 0.0",
    ),
    ("wind", {"type": "geometry_msgs/Point32", "set": {"x": 1e39}}, "which takes no 1e+39"),
    ("wind", {"type": "geometry_msgs/Point", "set": {"x": 10**400}}, "which takes no 1000"),
    ("push", {"type": "std_msgs/Bool", "fields": {"value": "data"}}, "std_msgs/Bool is `bool`"),
    ("on", {"type": "std_msgs/Int32", "fields": {"value": "data"}}, "std_msgs/Int32 is `int32`"),
    ("count", {"type": "std_msgs/Float64", "fields": {"value": "data"}}, "is `float64`"),
    ("gear", {"type": "std_msgs/UInt8", "fields": {"value": "data"}}, "is `uint8`"),
    ("wind", {"stamp": 3}, '`stamp` of `wind` is a field, a table or "arrival", not 3'),
    ("wind", {"stamp": {"from": "t"}}, "`stamp` of `wind` is in `None`: there are s, ms, us, ns"),
    ("wind", {"stamp": {"unit": "s"}}, "`stamp` of `wind` needs `from`"),
    ("wind", {"stamp": {"from": "t", "unit": "s", "scale": 2}}, "says `scale`"),
    ("wind", {**ODOMETRY, "stamp": "header.stomp"}, "did you mean `stamp`?"),
    ("wind", {**ODOMETRY, "stamp": "header.seq"}, "a number: say its unit"),
    ("wind", {**ODOMETRY, "stamp": "child_frame_id"}, "is `string`, no time"),
    ("wind", {**ODOMETRY, "stamp": {"from": "header.stamp", "unit": "s"}}, "no number that has"),
    ("wind", {"frame_id": 3}, "`frame_id` of `wind` is no name"),
    ("wind", {"type": "geometry_msgs/Twist", "frame_id": "odom"}, "needs a header"),
    ("wind", {"publisher": ["/ekf"]}, "`publisher` of `wind` is no name"),
    ("wind", {"set": 3}, "`set` of `wind` is no table"),
    ("wind", {"set": {"a": [1]}}, "is a text, a truth or a finite number"),
    ("wind", {"set": {"a": math.nan}}, "is a text, a truth or a finite number"),
    ("wind", {"set": {"a": math.inf}}, "is a text, a truth or a finite number"),
    ("wind", {**ODOMETRY, "set": {"header.frame": "map"}}, "did you mean `frame_id`?"),
    ("wind", {**ODOMETRY, "set": {"header.frame_id": 3}}, "which takes no 3"),
    ("wind", {**ODOMETRY, "set": {"header.seq": -1}}, "which takes no -1"),
    ("wind", {**ODOMETRY, "set": {"header.seq": True}}, "which takes no True"),
    ("wind", {"type": "sensor_msgs/LaserScan", "set": {"ranges.0": 1.0}}, "may not be there"),
    ("wind", {"fields": {"value": ["a", "b", "c"]}, "set": {"a": 1}}, "which its fields have, too"),
    ("wind", {"clip": 1}, "`clip` of `wind` is true or false, not 1"),
    ("wind", {"gap": 0.3}, "`gap` of `wind` is 0.3 of what? It needs a unit"),
    ("wind", {"gap": "0.3"}, "write a number with its unit"),
    ("wind", {"gap": 10**400}, "`gap` of `wind`"),
    (
        "flight",
        {"fields": {"turn": {"slope": "at.x", "window": 1}}},
        "is 1 of what? It needs a unit",
    ),
    (
        "wind",
        {"fields": {"value": {"from": ["a", "b", "c"], "scale": 10**400}}},
        "no finite number",
    ),
    ("push", {"fields": {"value": {"constant": 10**400}}}, "`constant`"),
    ("push", {"fields": {"value": {"constant": "1e99999999"}}}, "`constant`"),
    ("wind", {"fields": {"value": {"from": ["a", "b", "c"], "clip": True}}}, "says `clip`"),
]


@all_rows(("topic", "given", "text"), WRONG)
def test_a_mistake_is_refused_in_words(system: Any, topic: str, given: Any, text: str) -> None:
    topics = {topic: {k: v for k, v in given.items() if v is not None}}
    assert any(text in message for message in told(system, {"topics": topics}))


@pytest.mark.parametrize(
    ("top", "text"),
    [
        ({"frame": "FLU"}, "`frame` of the mapping is ENU or NED, not 'FLU'"),
        ({"frame": 3}, "not 3"),
        ({"messages": {"my_msgs/Foo": "none.msg"}}, "`none.msg` of `my_msgs/Foo` cannot be read"),
        ({"messages": {"my_msgs/Foo": 3}}, "is no name of a file"),
        ({"messages": {"my_msgs/Foo": "."}}, "cannot be read: it is a folder"),
        ({"messages": {"Foo": "good.msg"}}, "no name of a type"),
        ({"messages": {"my_msgs/Foo": "bad.msg"}}, "is no `.msg`"),
        ({"messages": {"my_msgs/Foo": "binary.msg"}}, "it is not UTF-8"),
        ({"messages": 3}, "`messages` of the mapping is no table"),
    ],
)
def test_a_mistake_of_the_whole_mapping_is_refused_in_words(
    system: Any, tmp_path: Path, top: Any, text: str
) -> None:
    (tmp_path / "good.msg").write_text("float64 x\n")
    (tmp_path / "bad.msg").write_text("x\n")
    (tmp_path / "binary.msg").write_bytes(b"\xff\xfe")
    given = {**top, "topics": {"wind": {"fields": {"value": ["a", "b", "c"]}}}}
    assert any(text in message for message in told(system, given, tmp_path))


def test_all_mistakes_are_told_at_once(system: Any) -> None:
    wrong = copy.deepcopy(FLIGHT)
    wrong["fields"]["turn"] = "twist.twist.angular.w"
    wrong["stamp"], wrong["frame"], wrong["set"] = "header.seq", "RFU", {"x": 1}
    assert len(told(system, {"topics": {"flight": wrong}, "frame": "XYZ"})) == 5


def test_a_slope_has_the_unit_of_a_rate(system: Any) -> None:
    fields = {**FLIGHT["fields"], "turn": {"slope": "at.x", "window": "1s"}}
    given = {"topics": {"flight": {**FLIGHT, "fields": fields}}}
    (message,) = told(system, given)
    assert "`flight.turn` is in `deg/s`, no slope of `flight.at.x`, in `m`" in message


def test_without_the_package_a_type_says_how_to_install_it(
    system: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from soter.mapping import message_types

    monkeypatch.setattr(message_types, "find_spec", lambda _: None)
    with pytest.raises(SoterError) as error:
        read(system, "flight", FLIGHT)
    (problem,) = error.value.diagnostics
    assert problem.code == "D007"
    assert "pip install 'soter-rta[logs]'" in problem.helps[0]
    assert read(system, "wind", {"fields": {"value": ["a", "b", "c"]}}).message is None


# ---------------------------------------------------------------- the page

PAGE_PROGRAM = """soter 1;
type Vector = { x: float, y: float, z: float };
type Motion = { p: Vector unit "m", v: Vector unit "m/s", gust: float };
topic motion: Motion;
topic command: float unit "m/s" in [-1.0, 1.0];
plant P period 10ms {
  drives motion = { p: { x: x, y: x, z: x }, v: { x: x, y: x, z: x }, gust: x };
  state x: float;
}
node A period 10ms { publishes command; step { publish command = 0.0; } }
node B period 10ms { publishes command; step { publish command = 0.0; } }
rta M { ac A; sc B; period 100ms;
  safe motion.p.x < 9.0; ttf motion.p.x > 5.0; safer motion.p.x < 4.0; }
system Protected { p: P; module M; }
"""


def test_the_mapping_of_the_page_is_one(tmp_path: Path) -> None:
    pytest.importorskip("tomllib", reason="TOML needs Python 3.11")
    page = (Path(__file__).resolve().parents[3] / "docs" / "mapping.md").read_text("utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "p.soter").write_text(PAGE_PROGRAM)
    (tmp_path / "msg").mkdir()
    (tmp_path / "msg" / "Gust.msg").write_text("float64 speed\n")
    (tmp_path / "map.toml").write_text(blocks[0])
    system = load(tmp_path / "p.soter").flat()
    given = read_mapping(tmp_path / "map.toml")
    motion, command = make_log_map(given, system, file=tmp_path / "map.toml").topics
    assert motion.leaves["p", "z"] == SignalSource("pose.pose.position.z", -1.0)
    assert command.constants == {"header.frame_id": "base_link"}
    (stamps,) = (b for b in blocks if b.startswith("stamp ="))
    (of_logs,) = (b for b in blocks if b.startswith("[time]"))
    for said in (*stamps.splitlines(), of_logs):
        (tmp_path / "part.toml").write_text(said)
        assert read_mapping(tmp_path / "part.toml")


@all_rows("unit", UNITS)
def test_the_page_names_every_unit(unit: str) -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "mapping.md").read_text("utf-8")
    (units,) = re.findall(r"is that of the message: (.*?)\. The number", page, re.DOTALL)
    assert unit in re.split(r",\s+", units)
