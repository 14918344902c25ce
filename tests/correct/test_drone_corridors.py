"""Corridors in the authors' city: covered, refused with a reason, right by the referee."""

from __future__ import annotations

import random
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

import soter
from generators.drone_corridors import Room, exact, fault_of, room, uncovered, written
from generators.drone_covering import Onboard
from tables import all_rows

if TYPE_CHECKING:
    from generators.drone_corridors import Exact

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"
NAN, INF = float("nan"), float("inf")
STREET = [(2.0, 2.0, 2.0), (47.0, 2.0, 2.0), (47.0, 40.0, 3.0)]
"""A plan along the southern and the eastern street."""

Plan = list[tuple[float, float, float]]


@pytest.fixture(scope="module")
def onboard(tmp_path_factory: pytest.TempPathFactory) -> Onboard:
    return Onboard(DRONE, tmp_path_factory.mktemp("covering"))


@pytest.fixture(scope="module")
def referee(onboard: Onboard) -> tuple[Room, Exact]:
    known = onboard.constants
    a, b, c = (written(m) for m in known["MARGIN"])
    return room(known["city.RADIUS"], known["city.CEILING"]), (a, b, c)


@pytest.fixture(scope="module")
def program() -> soter.Program:
    return soter.load(DRONE / "boxes.soter")


@pytest.fixture(scope="module")
def covering() -> soter.Program:
    return soter.load(DRONE / "cover.soter")


def wandering(seed: int, count: int) -> list[Plan]:
    """Random walks, most of them through some building."""
    draw = random.Random(seed)  # noqa: S311 - draws, not secrets
    plans = []
    for _ in range(count):
        p = [draw.uniform(0.4, 49.6), draw.uniform(0.4, 49.6), draw.uniform(0.4, 5.6)]
        plan = [(p[0], p[1], p[2])]
        for _ in range(draw.randint(1, 8)):
            p = [
                min(max(x + draw.gauss(0.0, s), 0.4), top)
                for x, s, top in zip(p, (3.0, 3.0, 0.8), (49.6, 49.6, 5.6), strict=True)
            ]
            plan.append((p[0], p[1], p[2]))
        plans.append(plan)
    return plans


# ---------------------------------------------------------------- what is covered


def test_what_is_covered_is_right_by_the_referee(
    onboard: Onboard, referee: tuple[Room, Exact]
) -> None:
    plans = wandering(1, 1500)
    answers = onboard.cover(plans)
    covered = [(p, a) for p, a in zip(plans, answers, strict=True) if a.verdict == "Covered"]
    assert len(covered) > 300
    assert {fault_of(*referee, p, a.boxes) for p, a in covered} == {""}


def test_plans_that_end_and_turn_at_walls_of_the_inner_room_are_right_too(
    onboard: Onboard, referee: tuple[Room, Exact]
) -> None:
    faces = [
        sorted({x for s in onboard.constants["THICK"] for x in (s[0][k], s[1][k])})
        for k in range(3)
    ]
    draw = random.Random(2)  # noqa: S311 - draws, not secrets
    plans: list[Plan] = []
    for _ in range(1500):
        p = [draw.choice(f) for f in faces]
        q = [draw.choice([x, draw.choice(f)]) for x, f in zip(p, faces, strict=True)]
        plans.append([(p[0], p[1], p[2]), (q[0], q[1], q[2])])
    answers = onboard.cover(plans)
    covered = [(p, a) for p, a in zip(plans, answers, strict=True) if a.verdict == "Covered"]
    assert len(covered) > 50
    assert {fault_of(*referee, p, a.boxes) for p, a in covered} == {""}


def test_no_check_of_its_own_contradicts(onboard: Onboard) -> None:
    assert not any(a.verdict in {"Unsound", "fault"} for a in onboard.cover(wandering(3, 20_000)))


def test_the_same_plan_has_the_same_corridor_in_the_interpreter(
    onboard: Onboard, covering: soter.Program
) -> None:
    cover = covering.function("Cover")
    for plan in [STREET, *wandering(4, 12)]:
        answer = onboard.cover([plan])[0]
        told = cover([SimpleNamespace(x=x, y=y, z=z) for x, y, z in plan])
        assert told.verdict == answer.verdict
        boxes = [
            [*vars(b.low).values(), *vars(b.high).values(), *vars(b.aim).values()]
            for b in told.blocks
        ]
        assert boxes == answer.boxes.tolist()


def test_a_box_that_is_free_holds_no_point_that_collides(onboard: Onboard) -> None:
    collides_not = soter.load(DRONE / "city.soter").function("NoCollision")
    draw = random.Random(5)  # noqa: S311 - draws, not secrets
    boxes = [b for a in onboard.cover(wandering(6, 150)) for b in a.boxes]
    assert len(boxes) > 50
    for box in boxes:
        corner = [draw.choice([box[k], box[3 + k]]) for k in range(3)]
        inside = [draw.uniform(box[k], box[3 + k]) for k in range(3)]
        for x, y, z in (corner, inside):
            assert collides_not(SimpleNamespace(x=float(x), y=float(y), z=float(z)))


def test_a_box_that_only_touches_a_grown_building_is_not_free(program: soter.Program) -> None:
    free = program.function("Free")
    wall = program.constant("SOLID")[11]  # x from 28 to 29, y from 18 to 43

    def block(high: float) -> SimpleNamespace:
        low, top = {"x": 26.0, "y": 20.0, "z": 1.0}, {"x": high, "y": 22.0, "z": 2.0}
        corners = {k: SimpleNamespace(**v) for k, v in (("low", low), ("high", top), ("aim", low))}
        return SimpleNamespace(**corners)

    assert not free(block(wall.low[0]))
    assert free(block(wall.low[0] - 1e-14))
    assert not free(block(NAN))


def test_boxes_are_as_many_as_pieces_of_street_not_as_points(onboard: Onboard) -> None:
    along = [(2.0 + 1.5 * i, 2.0, 2.0) for i in range(31)]
    assert len(onboard.cover([along])[0].boxes) <= 6


# ---------------------------------------------------------------- what is refused


@all_rows(
    ("plan", "reason"),
    [
        ([], "Empty"),
        ([(2.0, 2.0, 2.0)], "Empty"),
        ([(2.0, 2.0, 2.0), (NAN, 2.0, 2.0)], "NotFinite"),
        ([(2.0, INF, 2.0), (2.0, 3.0, 2.0)], "NotFinite"),
        ([(2.0, 2.0, -INF), (2.0, 3.0, 2.0)], "NotFinite"),
        ([(2.0, 2.0, 2.0), (1e300, 2.0, 2.0)], "NotFinite"),
        ([(2.0, 2.0, 2.0), (60.0, 2.0, 2.0)], "OutsideMap"),
        ([(2.0, 2.0, 2.0), (2.0, 2.0, 6.5)], "OutsideMap"),
        ([(2.0, 2.0, 0.1), (2.0, 5.0, 2.0)], "OutsideMap"),
        ([(2.0, 2.0, 2.0), (35.0, 30.0, 2.0)], "InBuilding"),
        ([(47.0, 30.0, 2.0), (30.0, 45.0, 2.0)], "InBuilding"),
        ([(26.5, 20.6, 2.0), (33.0, 20.6, 2.0)], "InBuilding"),
        ([(12.6, 40.5, 3.9), (12.6, 41.5, 3.9)], "TooNarrow"),
        ([(2.0, 1.2, 2.0), (2.0, 40.0, 2.0)] * 4, "TooLong"),
    ],
)
def test_a_plan_that_cannot_be_flown_is_refused_with_its_reason(
    onboard: Onboard, plan: Plan, reason: str
) -> None:
    (answer,) = onboard.cover([plan])
    assert answer.verdict == reason
    assert len(answer.boxes) == 0


def test_points_that_come_twice_do_no_harm(onboard: Onboard, referee: tuple[Room, Exact]) -> None:
    twice = [p for p in STREET for _ in range(2)]
    once, again, hover = onboard.cover([STREET, twice, [STREET[0]] * 32])
    assert once.verdict == again.verdict == hover.verdict == "Covered"
    assert once.boxes.tolist() == again.boxes.tolist()
    assert len(hover.boxes) == 1
    assert fault_of(*referee, [STREET[0]] * 32, hover.boxes) == ""


def test_a_plan_for_somebody_else_is_refused(onboard: Onboard) -> None:
    def asked(plan: Plan, start: tuple[float, ...], goal: tuple[float, ...]) -> str:
        return onboard.cover([plan], [[start, goal]])[0].verdict

    assert asked(STREET, STREET[0], STREET[-1]) == "Covered"
    assert asked(STREET, (2.5, 2.0, 2.0), STREET[-1]) == "Elsewhere"
    assert asked(STREET, STREET[0], STREET[1]) == "Elsewhere"
    assert asked(STREET, STREET[0], (NAN, 0.0, 0.0)) == "Elsewhere"


# ---------------------------------------------------------------- from one corridor to the next


def test_a_plan_from_the_box_that_is_flown_in_follows_without_a_gap(
    referee: tuple[Room, Exact], program: soter.Program, covering: soter.Program
) -> None:
    spliced, departure = program.function("Spliced"), program.function("Departure")
    cover = covering.function("Cover")
    now = cover([vec(p) for p in STREET]).blocks[0]
    here = vec((24.0, now.low.y + 0.01, now.high.z - 0.01))  # beside two walls of its box
    start = departure(now, here)
    plan = [start, vec((25.0, 8.0, 2.0))]
    told = spliced(now, start, cover(plan))
    assert told.verdict == "Covered"
    boxes = [
        [*vars(b.low).values(), *vars(b.high).values(), *vars(b.aim).values()] for b in told.blocks
    ]
    path = [(here.x, here.y, here.z), (start.x, start.y, start.z), (25.0, 8.0, 2.0)]
    assert fault_of(*referee, path, boxes) == ""
    elsewhere = cover([vec(p) for p in [(47.0, 33.0, 2.0), (47.0, 38.0, 2.0)]])
    assert spliced(now, vec((47.0, 33.0, 2.0)), elsewhere).verdict == "Elsewhere"


# ---------------------------------------------------------------- the checks of checks


def test_what_is_checked_on_board_is_what_the_referee_checks(
    onboard: Onboard, referee: tuple[Room, Exact], program: soter.Program
) -> None:
    """Boxes with a face or an aim moved: sound on board exactly where the referee finds nothing."""
    sound = program.function("Sound")
    draw = random.Random(7)  # noqa: S311 - draws, not secrets
    told = []
    for answer in onboard.cover(wandering(8, 600)):
        if answer.verdict != "Covered":
            continue
        boxes = answer.boxes.copy()
        boxes[draw.randrange(len(boxes)), draw.randrange(9)] += draw.gauss(0.0, 1.0)
        aims = [*boxes[:, 6:9], boxes[-1, 6:9]]
        blocks = [
            SimpleNamespace(low=vec(b[0:3]), high=vec(b[3:6]), aim=vec(b[6:9])) for b in boxes
        ]
        told.append(sound(blocks))
        assert told[-1] == (fault_of(*referee, aims, boxes) == ""), boxes
    assert 40 < sum(told) < len(told) - 40


def vec(p: Any) -> SimpleNamespace:
    return SimpleNamespace(x=float(p[0]), y=float(p[1]), z=float(p[2]))


def test_the_referee_sees_every_fault(onboard: Onboard, referee: tuple[Room, Exact]) -> None:
    boxes = onboard.cover([STREET])[0].boxes
    assert len(boxes) > 1
    assert fault_of(*referee, STREET, boxes) == ""

    def changed(box: int, place: int, by: float) -> str:
        wrong = boxes.copy()
        wrong[box, place] += by
        return fault_of(*referee, STREET, wrong)

    assert "outside the map" in changed(0, 0, -1.0)
    assert "building" in changed(0, 4, 10.0)
    assert "aim" in changed(0, 6, -20.0)
    assert "not in the first box" in fault_of(*referee, [(47.0, 40.0, 3.0), *STREET], boxes)
    assert "not in the last box" in fault_of(*referee, [*STREET, STREET[0]], boxes)
    assert fault_of(*referee, STREET, boxes[1:]) != ""
    assert fault_of(*referee, STREET, []) != ""
    narrow = boxes.copy()
    narrow[0, 5] = narrow[0, 2] + 2.0
    assert fault_of(*referee, STREET, narrow) == "box 0 is too narrow"


def test_the_referee_wants_the_whole_path_in_order() -> None:
    def block(low: float, high: float) -> Any:
        ends = [exact((x, -1.0, -1.0)) for x in (low, high)]
        return SimpleNamespace(low=ends[0], high=exact((high, 1.0, 1.0)), aim=ends[1])

    path = [exact((0.0, 0.0, 0.0)), exact((4.0, 0.0, 0.0)), exact((1.0, 0.0, 0.0))]
    assert uncovered(path, [block(-1, 2), block(1, 5)]) == ""
    assert uncovered(path, [block(-1, 2), block(3, 5)]) != ""
    assert uncovered(path, [block(1, 5), block(-1, 2)]) != ""


# ---------------------------------------------------------------- a city that is wrong


def city_with(folder: Path, old: str, new: str) -> soter.Program:
    for name in ("boxes.soter", "city.soter", "utopia.json"):
        shutil.copy(DRONE / name, folder)
    text = (folder / "utopia.json").read_text(encoding="utf-8")
    assert old in text
    (folder / "utopia.json").write_text(text.replace(old, new, 1), encoding="utf-8")
    return soter.load(folder / "boxes.soter")


def only_message(program: soter.Program) -> tuple[str, str]:
    with pytest.raises(soter.SoterError) as caught:
        program.check()
    errors = [d for d in caught.value.diagnostics if d.code[0] != "W"]
    return errors[0].code, errors[0].message


def test_an_inverted_building_is_an_error(tmp_path: Path) -> None:
    program = city_with(tmp_path, '"x": 31.04,', '"x": 41.04,')
    code, message = only_message(program)
    assert code == "T020"
    assert "a building is inverted or empty" in message


def test_a_missing_building_is_an_error(tmp_path: Path) -> None:
    row = (DRONE / "utopia.json").read_text(encoding="utf-8").splitlines(keepends=True)[4]
    code, message = only_message(city_with(tmp_path, row, ""))
    assert code == "D004"
    assert "City" in message


def test_a_city_without_size_is_an_error(tmp_path: Path) -> None:
    code, message = only_message(city_with(tmp_path, '"x": 50.0', '"x": -50.0'))
    assert code == "T020"
    assert "size" in message


def test_buildings_that_overlap_are_none(tmp_path: Path) -> None:
    """Some of the authors' do; a corridor is free of all."""
    wider = city_with(tmp_path, '"x": 40.59, "y": 37.54', '"x": 41.59, "y": 37.54')
    wider.check()
    assert wider.function("Free") is not None


def test_the_alley_of_the_lap_is_wide_enough(onboard: Onboard) -> None:
    (answer,) = onboard.cover([[(13.2, 37.86, 2.2), (26.52, 37.86, 2.0)]])
    assert answer.verdict == "Covered"
