"""Which values a topic takes from a policy, and what stands in channels.json."""

from __future__ import annotations

import copy
import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from generators.damaged_json import MISSING, damaged
from generators.random_names import Namer
from generators.random_types import TypeMaker
from generators.seeded_choices import Seeded
from soter.diagnostics.diagnostic import SoterError
from soter.remote.channels_json import _parsed_type, find_topics, parse_channels
from soter.targets.firmware_interface import described_type
from soter.targets.world_interface import number_of_layout
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.remote.topics import Topic, Topics

POSE = {"x": 1.0, "y": -2.0}
WIDE = {"at": POSE, "kind": "Far", "ok": True, "n": 3}


@pytest.fixture(scope="session")
def topics(document: dict[str, Any]) -> Topics:
    return parse_channels(document, "here")


def code_of(call: Callable[[], object]) -> tuple[str, str]:
    with pytest.raises(SoterError) as caught:
        call()
    (problem,) = caught.value.diagnostics
    return problem.code, problem.message


# ---------------------------------------------------------------- values


@all_rows(
    ("topic", "given", "back"),
    [
        ("wish", 0.25, 0.25),
        ("wish", -0.0, -0.0),
        ("wish", np.float32(0.5), 0.5),
        ("wish", np.array([0.5]), 0.5),
        ("wish", [0.5], 0.5),
        ("wish", 1, 1.0),
        ("goal", POSE, POSE),
        ("goal", np.array([1.0, -2.0]), POSE),
        ("wide", WIDE, WIDE),
        ("few", [], []),
        ("few", [0.5], [0.5]),
        ("arm", np.array([0.0, 1.0, -2.0], dtype=np.float32), [0.0, 1.0, -2.0]),
    ],
)
def test_values_come_back_as_they_were(
    topics: Topics, topic: str, given: object, back: object
) -> None:
    found = topics.topic_named(topic)
    read = found.value(found.image(given, clip=False))
    read = read.tolist() if isinstance(read, np.ndarray) else read
    assert (read, type(read)) == (back, type(back))
    assert not isinstance(back, float) or math.copysign(1, read) == math.copysign(1, back)


@all_rows(
    ("topic", "given", "words"),
    [
        ("wish", math.nan, "wish: nan is no finite number"),
        ("wish", math.inf, "wish: inf is no finite number"),
        ("wish", 1.0000001, "wish: 1.0000001 is not in [-1.0, 1.0]"),
        ("wish", [0.1, 0.2], "wish: expected a number, found a sequence of 2"),
        ("wish", "fast", "wish: expected a number, found 'fast'"),
        ("wish", None, "wish: expected a number, found None"),
        ("arm", [0.0, 1.0], "arm: expected 3 elements"),
        ("arm", [0.0, 1.0, 2.5], "arm[2]: 2.5 is not in [-2.0, 2.0]"),
        ("arm", [0.0, math.nan, 0.0], "arm[1]: nan"),
        ("arm", np.zeros((3, 1)), "arm[0]: expected a number"),
        ("goal", {"x": 1.0}, "goal: field `y` is missing"),
        ("goal", {**POSE, "z": 0.0}, "goal: there is no field `z`"),
        ("goal", {"x": math.inf, "y": 0.0}, "goal.x: inf"),
        ("wide", {**WIDE, "kind": "Gone"}, "wide.kind: expected one of 'Near', 'Far'"),
        ("wide", {**WIDE, "ok": 1}, "wide.ok: expected a bool"),
        ("wide", {**WIDE, "n": 3.0}, "wide.n: expected an int"),
        ("wide", {**WIDE, "n": 7}, "wide.n: 7 is not in [0, 5]"),
        ("wide", {**WIDE, "n": 10**30}, "wide.n"),
        ("few", [0.1, 0.2, 0.3], "few: at most 2 elements"),
        ("few", [0.1, 1.5], "few[1]: 1.5 is not in [0.0, 1.0]"),
    ],
)
def test_what_the_topic_cannot_take_is_told_with_its_place(
    topics: Topics, topic: str, given: object, words: str
) -> None:
    code, message = code_of(lambda: topics.topic_named(topic).image(given, clip=False))
    assert code == "U012"
    assert message.startswith(words), message


@pytest.mark.parametrize(
    ("topic", "given", "back"),
    [
        ("wish", 3.0, 1.0),
        ("wish", -3, -1.0),
        ("wish", 0.3, 0.3),
        ("arm", [9.0, 0.0, -9.0], [2.0, 0.0, -2.0]),
        ("wide", {**WIDE, "n": 100}, {**WIDE, "n": 5}),
        ("wide", {**WIDE, "n": -100}, {**WIDE, "n": 0}),
        ("few", [5.0], [1.0]),
    ],
)
def test_clipping_puts_numbers_at_the_ends_of_the_set(
    topics: Topics, topic: str, given: object, back: object
) -> None:
    found = topics.topic_named(topic)
    read = found.value(found.image(given, clip=True))
    assert (read.tolist() if isinstance(read, np.ndarray) else read) == back


@pytest.mark.parametrize("given", [math.nan, math.inf, "fast", [0.1, 0.2]])
def test_clipping_makes_no_value_of_what_is_none(topics: Topics, given: object) -> None:
    code, _ = code_of(lambda: topics.topic_named("wish").image(given, clip=True))
    assert code == "U012"


def test_bytes_that_are_no_value_are_told(topics: Topics) -> None:
    few, wide = topics.topic_named("few"), topics.topic_named("wide")
    for topic in (few, wide):
        code, message = code_of(lambda t=topic: t.value(b"\xff" * t.size))  # type: ignore[misc]
        assert code == "X013"
        assert topic.channel in message


# ---------------------------------------------------------------- which topic


def test_a_topic_goes_by_its_name_and_a_wrong_one_is_told_with_what_is_like_it(
    topics: Topics,
) -> None:
    assert topics.writable_topic("wish").name == "wish"
    assert code_of(lambda: topics.topic_named("wsh")) == (
        "U001",
        "system `Robot` has no channel `wsh`: did you mean `wish`?",
    )
    code, message = code_of(lambda: topics.writable_topic("speed"))
    assert code == "U001"
    assert message.startswith("`speed` is published by the robot itself; open to others: `pos")


# ---------------------------------------------------------------- channels.json


@all_rows("seed", range(40))
def test_a_type_is_read_back_from_its_description(seed: int) -> None:
    choose = Seeded(seed)
    maker = TypeMaker(choose, Namer(choose, 20))
    maker.declare()
    for t in [maker.any(3) for _ in range(20)]:
        layout = described_type(t)
        again = described_type(_parsed_type(json.loads(json.dumps(layout))))
        assert again == layout
        assert number_of_layout(again) == number_of_layout(layout)


def test_a_damaged_description_is_no_description(document: dict[str, Any]) -> None:
    tried = 0
    for place, value, copied in damaged(document, (MISSING, None, [], {}, "x", -1, True)):
        if place[-1] in ("system", "name", "channel", "published", "max_age_ns"):
            continue  # texts and times as they may be
        if value == _at(document, place) or (place, value) == (("topics", 0), MISSING):
            continue
        if "set" in place[:-1] and value in (None, -1):
            continue  # another set, and a set
        tried += 1
        with pytest.raises(SoterError) as caught:
            pytest.fail(f"{place}: {value} makes {parse_channels(copied, 'it').all}")
        assert [d.code for d in caught.value.diagnostics] == ["X013"], (place, value)
    assert tried > 50


def _at(document: Any, place: tuple[Any, ...]) -> object:
    for part in place:
        document = document[part]
    found: object = document
    return found


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is no channels.json"),
        ("[]", "is no channels.json"),
        ('{"schema": 99}', "is no channels.json"),
        ("[" * 100_000, "is no channels.json"),
        ('{"schema": 1, "system": "S", "topics": []}', "no `external topic` is declared"),
    ],
)
def test_a_file_that_is_no_description_is_told(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "channels.json").write_text(text)
    code, message = code_of(lambda: find_topics(tmp_path, None))
    assert code == "X013"
    assert words in message


def test_a_package_without_channels_says_what_writes_them(tmp_path: Path) -> None:
    code, message = code_of(lambda: find_topics(tmp_path, None))
    assert (code, "`soter build --target posix` writes it" in message) == ("X013", True)


def test_a_package_of_another_system_is_told(tmp_path: Path, document: dict[str, Any]) -> None:
    (tmp_path / "trusted").mkdir()
    (tmp_path / "trusted" / "channels.json").write_text(json.dumps(document))
    assert find_topics(tmp_path, "Robot").system == "Robot"
    code, message = code_of(lambda: find_topics(tmp_path, "Track"))
    assert (code, "is about system `Robot`, not `Track`" in message) == ("X013", True)


def test_a_system_with_its_plants_inside_has_no_channels(program: Path) -> None:
    code, message = code_of(lambda: find_topics(program, "Track"))
    assert (code, "no `external topic`" in message) == ("X013", True)
    assert code_of(lambda: find_topics(program, "Rbt"))[0] == "U002"


def test_sets_hold_the_range_of_the_type(document: dict[str, Any]) -> None:
    changed = copy.deepcopy(document)
    wide = next(t for t in changed["topics"] if t["name"] == "wide")
    assert wide["set"] == [None, None, None, None, [0, 5]]
    made: Topic = parse_channels(changed, "here").topic_named("wide")
    assert made.ends[-1] == (0, 5)
