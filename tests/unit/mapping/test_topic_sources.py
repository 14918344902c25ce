"""Several sources of one topic: what a mapping may say of them, and how old the topic may get.

The bound of docs/mapping.md, "Several sources", against every pattern of arrivals on a small grid.
Non-goals: the same rule in C++ (`tests/unit/targets/test_sources_in_a_bridge.py`), ROS
(`tests/correct/test_ros_two_sensors.py`).
"""

from __future__ import annotations

import itertools
import random
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rosbags", reason="the extra `logs` is not installed")

from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from soter.mapping.read_mapping import make_log_map, read_mapping
from soter.mapping.topic_mapping import SourcePromise, SourceTurns
from soter.mapping.topic_mapping_parser import problems_of_early_turns
from soter.targets.bridge_base import bridged_topics, maps_by_topic, promise_notes
from soter.targets.ros_packages import TOPIC
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "ros"
Samples = list[tuple[int, int, int]]
"""(arrival, rank, stamp) of each."""

# ---------------------------------------------------------------- how old the topic may get


def judged(promises: Sequence[SourcePromise], samples: Samples) -> list[tuple[int, int, int]]:
    """Those that are taken."""
    turns = SourceTurns([p.after_ns for p in promises])
    return [s for s in sorted(samples) if turns.judge(s[1], s[2]) == "taken"]


def ages(
    promises: Sequence[SourcePromise], samples: Samples, until: int
) -> tuple[list[int | None], list[tuple[int, int]]]:
    """By source the greatest age of the topic while the source kept its promise, None: it never
    did; and what was taken, as (rank, stamp). Looked at just before what arrives at a time counts.
    """
    turns = SourceTurns([p.after_ns for p in promises])
    heard: list[int | None] = [None] * len(promises)
    taken: list[tuple[int, int]] = []
    worst: list[int | None] = [None] * len(promises)
    todo = sorted(samples)
    for now in range(until + 1):
        for p in promises:
            newest = heard[p.rank]
            if newest is not None and now - newest <= p.own_age_max_ns:
                age = now - max(stamp for _, stamp in taken)
                worst[p.rank] = max(age, worst[p.rank] or 0)
        while todo and todo[0][0] == now:
            _, rank, stamp = todo.pop(0)
            heard[rank] = max(s for s in (stamp, heard[rank]) if s is not None)
            if turns.judge(rank, stamp) == "taken":
                taken.append((rank, stamp))
    return worst, taken


def within_bound(promises: Sequence[SourcePromise], worst: list[int | None]) -> bool:
    return all(a is None or a <= p.age_max_ns for a, p in zip(worst, promises, strict=True))


def patterns(rank: int, ticks: int, delay: int) -> list[Samples]:
    """Every way in which a source may measure at some of the ticks, each sample so late at most."""
    choices: list[int | None] = [None, *range(delay + 1)]
    return [
        [(at + late, rank, at) for at, late in enumerate(chosen, 1) if late is not None]
        for chosen in itertools.product(choices, repeat=ticks)
    ]


SMALL = [  # every, delayed of both; after of the second
    ((1, 0), (1, 0), 1),
    ((1, 0), (1, 1), 1),
    ((2, 0), (1, 0), 2),
    ((1, 1), (1, 0), 2),
    ((1, 1), (1, 1), 1),  # less than the first may be late: it is no worse, though refused
    ((1, 0), (2, 0), 2),
]


@pytest.mark.parametrize(("first", "second", "after"), SMALL)
def test_no_pattern_of_arrivals_makes_the_topic_older_and_one_makes_it_so_old(
    first: tuple[int, int], second: tuple[int, int], after: int
) -> None:
    promises = (SourcePromise(0, *first), SourcePromise(1, *second, after_ns=after))
    ticks = 5 if max(first[1], second[1]) else 6
    worst = [0, 0]
    for a in patterns(0, ticks, first[1]):
        for b in patterns(1, ticks, second[1]):
            seen, taken = ages(promises, a + b, ticks + 2)
            assert within_bound(promises, seen), (a, b, seen)
            assert [s for _, s in taken] == sorted({s for _, s in taken}), "back in measuring time"
            worst = [max(x, y or 0) for x, y in zip(worst, seen, strict=True)]
    assert worst == [p.age_max_ns for p in promises]


def drawn(draw: random.Random, p: SourcePromise, until: int) -> Samples:
    """A source that keeps its promise for a while, falls silent, comes back, late or not."""
    samples, at, good = [], 0, True
    while at < until:
        at += draw.randint(1, p.every_ns if good else 5 * p.every_ns)
        late = draw.randint(0, p.delayed_ns if good else 3 * p.delayed_ns + 2)
        samples.append((at + late, p.rank, at))
        good = good != (draw.random() < 0.15)
    return samples


def test_three_sources_at_random_keep_the_bound_of_each_that_keeps_its_promise() -> None:
    draw = random.Random(5)  # noqa: S311 - patterns
    reached = [0, 0, 0]
    for _ in range(1500):
        given = [(draw.randint(1, 4), draw.randint(0, 3), draw.randint(1, 9)) for _ in range(3)]
        promises = [
            SourcePromise(k, every, late, after_ns=after if k else 0)
            for k, (every, late, after) in enumerate(given)
        ]
        samples = [s for p in promises for s in drawn(draw, p, 60)]
        worst, _ = ages(promises, samples, 60)
        assert within_bound(promises, worst), (promises, samples, worst)
        for p in promises:
            reached[p.rank] += worst[p.rank] == p.age_max_ns
    assert min(reached) > 5, f"the bound was hardly ever reached: {reached}"


def test_the_second_waits_as_long_as_the_first_keeps_its_promise() -> None:
    draw = random.Random(6)  # noqa: S311 - patterns
    for _ in range(300):
        every, late = draw.randint(1, 5), draw.randint(0, 4)
        promises = (SourcePromise(0, every, late), SourcePromise(1, 1, 0, after_ns=every + late))
        at, samples = 0, [(t, 1, t) for t in range(1, 60)]
        while at < 60:
            at += draw.randint(1, every)
            samples.append((at + draw.randint(0, late), 0, at))
        since = min(arrival for arrival, rank, _ in samples if rank == 0)
        taken = judged(promises, samples)
        assert {rank for arrival, rank, _ in taken if arrival > since} == {0}


def taken_early(promises: Sequence[SourcePromise], samples: Samples) -> Samples:
    """What is taken, as it arrives, while a source before its own keeps its promise."""
    turns = SourceTurns([p.after_ns for p in promises])
    heard = [float("-inf")] * len(promises)
    early = []
    for now, at_once in itertools.groupby(sorted(samples), key=lambda s: s[0]):
        keeping = [p.rank for p in promises if now - heard[p.rank] <= p.own_age_max_ns]
        for sample in at_once:
            _, rank, stamp = sample
            heard[rank] = max(stamp, heard[rank])
            if turns.judge(rank, stamp) == "taken" and keeping and keeping[0] < rank:
                early.append(sample)
    return early


LATE = [((1, 0), (1, 1)), ((1, 1), (1, 0))]


@pytest.mark.parametrize(
    ("first", "second", "ticks"),
    [
        *((*pair, 5) for pair in [((1, 0), (1, 0)), ((1, 0), (2, 0)), ((2, 0), (1, 0))]),
        *((*pair, 4) for pair in LATE),
        *(pytest.param(*pair, 5, marks=pytest.mark.long) for pair in LATE),
    ],
)
def test_three_sources_are_refused_where_a_pattern_makes_one_take_over_too_early(
    first: tuple[int, int], second: tuple[int, int], ticks: int
) -> None:
    """The second may be silent for its `after` and keep its promise: the third waits for both."""
    before = (SourcePromise(0, *first), SourcePromise(1, *second, after_ns=sum(first)))
    everything = [
        *(patterns(p.rank, ticks, p.delayed_ns) for p in before),
        patterns(2, ticks, 0),
    ]
    arrivals = [a + b + c for a, b, c in itertools.product(*everything)]
    refused = []
    for after in range(1, before[1].age_max_ns + 2):
        promises = (*before, SourcePromise(2, 1, 0, after_ns=after))
        refused.append(bool(list(problems_of_early_turns("t", promises))))
        assert refused[-1] is any(taken_early(promises, samples) for samples in arrivals)
    assert refused[-3:] == [True, False, False], "from the second's `age_max_ns` on"


def test_no_source_takes_over_too_early_from_any_of_several_at_random() -> None:
    draw = random.Random(7)  # noqa: S311 - patterns
    reached = 0
    for _ in range(600):
        promises = [SourcePromise(0, draw.randint(1, 4), draw.randint(0, 3))]
        for rank in range(1, draw.randint(3, 5)):
            after = max(p.age_max_ns for p in promises)
            given = draw.randint(1, 4), draw.randint(0, 3)
            promises.append(SourcePromise(rank, *given, after_ns=after))
        assert not list(problems_of_early_turns("t", promises))
        samples = [s for p in promises for s in drawn(draw, p, 60)]
        assert not taken_early(promises, samples), (promises, samples)
        last = promises[-1]
        less = [*promises[:-1], SourcePromise(last.rank, 1, 0, after_ns=last.after_ns - 1)]
        often = [s for s in samples if s[1] != last.rank]
        reached += bool(taken_early(less, often + [(t, last.rank, t) for t in range(1, 60)]))
    assert reached > 5, f"a nanosecond less hardly ever was too little: {reached}"


def test_the_first_is_read_again_as_soon_as_it_says_something_newer() -> None:
    """It is slower than the second: what it says is older than what was taken, for a while."""
    promises = (SourcePromise(0, 10, 40), SourcePromise(1, 10, 5, after_ns=50))
    first = [(at + 40, 0, at) for at in (*range(0, 100, 10), *range(400, 600, 10))]
    second = [(at + 5, 1, at) for at in range(3, 600, 10)]
    taken = judged(promises, first + second)
    ranks = [rank for rank, _ in itertools.groupby(taken, key=lambda s: s[1])]
    assert ranks == [1, 0, 1, 0]  # the first sample of all is the second's
    last = [s for s in taken if s[1] == 1][-1]
    back = next(s for s in taken if s[1] == 0 and s[0] > 400)
    assert last[0] < 440 <= back[0] <= last[2] + promises[0].own_age_max_ns + 1


# ---------------------------------------------------------------- what a mapping may say


ODOMETRY: dict[str, Any] = {
    "channel": "/odom",
    "type": "nav_msgs/Odometry",
    "fields": {"value": "pose.pose.position.x"},
    "every": "10ms",
    "delayed": "5ms",
    "measured": {"value": 0.05},
}
CAMERA: dict[str, Any] = {**ODOMETRY, "channel": "/camera/odom", "after": "15ms"}
REST: dict[str, Any] = {
    "wish": {"channel": "/wish", "type": "std_msgs/Float64", "fields": {"value": "data"}},
    "speed": {
        "channel": "/cmd_vel",
        "type": "geometry_msgs/Twist",
        "fields": {"value": "linear.x"},
    },
}


@pytest.fixture(scope="module")
def vehicle() -> Any:
    return load(EXAMPLES / "shuttle_ros.soter").flat("Vehicle")


def changed(source: dict[str, Any], **entries: Any) -> dict[str, Any]:
    """The source with other entries; None takes one away."""
    return {k: v for k, v in {**source, **entries}.items() if v is not None}


def built(vehicle: Any, position: Any, **rest: Any) -> Any:
    mapping = make_log_map({"topics": {"position": position, **REST, **rest}}, vehicle)
    return bridged_topics(vehicle, mapping, "ROS", TOPIC)


def refused(vehicle: Any, position: Any, **rest: Any) -> list[str]:
    with pytest.raises(SoterError) as error:
        built(vehicle, position, **rest)
    assert {d.code for d in error.value.diagnostics} == {"D015"}
    return [d.message for d in error.value.diagnostics]


def two(first: dict[str, Any] | None = None, second: dict[str, Any] | None = None) -> Any:
    return {"sources": [changed(ODOMETRY, **(first or {})), changed(CAMERA, **(second or {}))]}


def test_two_sources_that_fit_are_told_with_their_figures(vehicle: Any) -> None:
    mapped = built(vehicle, two())
    assert [m.channel for m in mapped[:2]] == ["/odom", "/camera/odom"]
    (told,) = promise_notes(vehicle, mapped)
    assert told == (
        "position: /odom at most 15 ms old, within 0.05; /camera/odom at most 15 ms old, within "
        "0.05; at a takeover at most 30 ms old, of 40 ms (every 20 ms, delayed 20 ms)"
    )


def test_the_example_fits_its_program(vehicle: Any) -> None:
    given = read_mapping(EXAMPLES / "shuttle_ros_two_sensors.toml")
    mapped = bridged_topics(vehicle, make_log_map(given, vehicle), "ROS", TOPIC)
    assert "at a takeover at most 37 ms old" in promise_notes(vehicle, mapped)[0]


LASER = {**CAMERA, "channel": "/laser/odom", "every": "1ms", "after": "16ms"}
WRONG = [
    ({"sources": {}}, "is no list of tables"),
    ({"sources": [ODOMETRY, "x"]}, "is no list of tables"),
    ({"sources": [ODOMETRY]}, "are 2 to 8, not 1"),
    ({"sources": [ODOMETRY] * 9}, "are 2 to 8, not 9"),
    ({**two(), "channel": "/odom"}, "says `channel`: there are sources"),
    (two({"between": "linear"}), "`position.sources.1` says `between`"),
    (two({"set": {"child_frame_id": "x"}}), "`position.sources.1` says `set`"),
    (changed(ODOMETRY, delayed=None, measured=None), "says `every`"),
    (two({"every": None}), "`position.sources.1` needs a `every`"),
    (two({"every": "0ms"}), "no time above 0"),
    (two({"delayed": "5 parsecs"}), "`delayed` of `position.sources.1`"),
    (two({"after": "15ms"}), "the first source takes over from nobody"),
    (two(None, {"after": None}), "`position.sources.2` needs a `after`"),
    (two(None, {"after": "14ms"}), "may be 15 ms old while it keeps its promise"),
    ({"sources": [ODOMETRY, changed(CAMERA, every="12ms"), LASER]}, "may be 32 ms old while"),
    (two(None, {"channel": "/odom"}), "are one channel"),
    (two(None, {"channel": None}), "has no `channel`"),
    (two(None, {"channel": "/cmd_vel"}), "share `/cmd_vel`"),
    (two(None, {"type": None}), "`position.sources.2` has no stamp"),
    (two(None, {"stamp": "arrival"}), "`position.sources.2` has no stamp"),
    (two(None, {"fields": {"value": {"constant": 1.0}}}), "it measures nothing"),
    (two(None, {"fields": {"value": {"slope": "value", "window": "1s"}}}), "slope"),
    (two(None, {"fields": {"value": "pose.x"}}), "pose"),
    (two(None, {"fields": {"value": "twist.twist.linear.x"}}), "m/s"),
    (two(None, {"measured": 0.05}), "`measured` of `position.sources.2` is no table"),
    (two(None, {"measured": {"x": 0.05}}), "no float of the topic is `x`"),
    (two(None, {"measured": {"value": -0.05}}), "is no error"),
    (two(None, {"measured": {"value": float("nan")}}), "is no error"),
    (two(None, {"measured": {"value": True}}), "is no error"),
    (two(None, {"measured": {"value": 0.06}}), "from /camera/odom is within 0.06"),
    (two({"measured": None}), "from /odom does not say how exact it is"),
    (two({"every": "36ms"}, {"after": "41ms"}), "41 ms old with /odom alone (every 36 ms"),
    (two(None, {"after": "26ms"}), "41 ms old with /camera/odom when it takes over (after 26 ms"),
    (two(None, {"every": "21ms"}), "the system declares 40 ms (every 20 ms, delayed 20 ms)"),
]


@all_rows(("position", "said"), WRONG, ids=[said for _, said in WRONG])
def test_sources_that_do_not_fit_are_d015(vehicle: Any, position: Any, said: str) -> None:
    assert said in " ".join(refused(vehicle, position))


def test_a_takeover_may_use_all_that_the_system_declares(vehicle: Any) -> None:
    assert len(built(vehicle, two(None, {"after": "25ms"}))) == 4


def test_what_goes_out_has_no_sources(vehicle: Any) -> None:
    fields = {"type": "geometry_msgs/TwistStamped", "fields": {"value": "twist.linear.x"}}
    speed = two({**fields, "channel": "/a"}, {**fields, "channel": "/b"})
    assert "`speed` goes out: it has no `sources`" in refused(vehicle, ODOMETRY_ALONE, speed=speed)


ODOMETRY_ALONE = changed(ODOMETRY, every=None, delayed=None, measured=None)


def test_a_topic_of_which_nothing_is_declared_compares_nothing(vehicle: Any) -> None:
    fields = {"type": "geometry_msgs/TwistStamped", "fields": {"value": "twist.linear.x"}}
    wish = two({**fields, "channel": "/a", "every": "9s"}, {**fields, "channel": "/b"})
    wish["sources"][1]["after"] = "10s"
    mapped = built(vehicle, ODOMETRY_ALONE, wish=wish)
    assert promise_notes(vehicle, mapped)[0].endswith("at most 10.015 s old, nothing declared")


def test_a_plant_that_moves_in_steps_has_one_sensor(tmp_path: Path) -> None:
    program = tmp_path / "steps.soter"
    text = (EXAMPLES / "shuttle_ros.soter").read_text()
    program.write_text(text.replace("der x = speed;", "next x = x + 0.005 * speed;"))
    vehicle = load(program).flat("Vehicle")
    assert "shows a plant that moves in steps" in refused(vehicle, two())[0]
    assert len(built(vehicle, ODOMETRY_ALONE)) == 3


@pytest.mark.parametrize("middleware", ["DDS", "MAVLink"])
def test_other_bridges_say_that_they_read_one(vehicle: Any, middleware: str) -> None:
    with pytest.raises(SoterError, match=f"has several `sources`: .* that of {middleware}"):
        maps_by_topic(built(vehicle, two()), middleware)
    assert len(maps_by_topic(built(vehicle, ODOMETRY_ALONE), middleware)) == 3


def test_errors_may_be_said_of_a_part_of_a_topic(tmp_path: Path) -> None:
    program = tmp_path / "p.soter"
    program.write_text("""soter 1;
type V = { x: float, y: float };
topic t: { p: V, n: int, q: float };
plant P period 10ms {
  drives t = { p: { x: x, y: x }, n: 0, q: x };
  state x: float;
}
system S { p: P; until 1s; }
""")
    fields = {"p.x": "a", "p.y": "b", "n": "c", "q": "d"}
    source = {"stamp": "s", "fields": fields, "every": "1s", "measured": {"p": 0.5, "q": 1}}
    other = {**source, "after": "1s", "measured": {"value": 2.0}}
    given = {"topics": {"t": {"sources": [source, other]}}}
    first, second = make_log_map(given, load(program).flat()).topics
    assert first.promise is not None
    assert second.promise is not None
    assert first.promise.errors == {("p", "x"): 0.5, ("p", "y"): 0.5, ("q",): 1.0}
    assert set(second.promise.errors.values()) == {2.0}
