"""The roadmap of the authors' city: from everywhere, and no wrong file is believed."""

from __future__ import annotations

import importlib
import json
import random
import re
import shutil
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import soter
from generators.drone_corridors import fault_of, room, written
from generators.drone_covering import Onboard

if TYPE_CHECKING:
    from collections.abc import Callable

DRONE = Path(__file__).resolve().parents[2] / "examples" / "drone"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Any:
    """examples/drone/roadmap.py."""
    monkeypatch.syspath_prepend(str(DRONE))
    return importlib.import_module("roadmap")


@pytest.fixture(scope="module")
def onboard(tmp_path_factory: pytest.TempPathFactory) -> Onboard:
    return Onboard(DRONE, tmp_path_factory.mktemp("covering"))


def document() -> dict[str, Any]:
    roadmap: dict[str, Any] = json.loads((DRONE / "roadmap.json").read_text(encoding="utf-8"))
    return roadmap


@pytest.mark.long
def test_the_script_writes_the_file_that_is_shipped(
    script: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(script, "OUT", tmp_path / "roadmap.json")
    script.main()
    assert (tmp_path / "roadmap.json").read_bytes() == (DRONE / "roadmap.json").read_bytes()


def test_from_every_place_of_the_inner_room_a_node_is_in_sight(script: Any) -> None:
    """The box around each cell and some node has no wall in it; comparisons are exact."""
    room = script.inner_room()
    nodes = [(n["x"], n["y"], n["z"]) for n in document()["nodes"]]
    cells = script.cells_of(room)
    assert len(cells) > 500
    assert all(any(room.shares_a_box(c, n) for n in nodes) for c in cells)


def test_the_cells_are_the_whole_inner_room(script: Any) -> None:
    room = script.inner_room()
    cells = script.cells_of(room)
    draw = random.Random(1)  # noqa: S311 - draws, not secrets
    for _ in range(3000):
        p = [draw.uniform(a, b) for a, b in zip(*room.inner, strict=True)]
        free = not any(all(w[0][k] < p[k] < w[1][k] for k in range(3)) for w in room.walls)
        within = any(all(c[0][k] <= p[k] <= c[1][k] for k in range(3)) for c in cells)
        assert free == within


def pieces_by_faces(cells: Any) -> dict[int, int]:
    """Of each cell its piece of the room, by cells that share a face."""
    piece: dict[int, int] = {}
    for first in range(len(cells)):
        if first in piece:
            continue
        piece[first], wait = first, deque([first])
        while wait:
            (a, b) = cells[wait.popleft()]
            for j, (c, d) in enumerate(cells):
                if j not in piece:
                    shared = [min(b[k], d[k]) - max(a[k], c[k]) for k in range(3)]
                    if min(shared) >= 0.0 and sum(s > 0.0 for s in shared) >= 2:
                        piece[j] = first
                        wait.append(j)
    return piece


PAGE = (DRONE.parents[1] / "docs" / "surveillance.md").read_text(encoding="utf-8")
MARGINS = re.findall(r"^\| (\d\.\d\d) \| one \| (\d)", PAGE, re.MULTILINE)


@pytest.mark.pages
def test_other_margins_leave_the_pieces_that_the_page_says(
    script: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The table of docs/surveillance.md, every row and both columns."""
    boxes = (DRONE / "boxes.soter").read_text(encoding="utf-8")
    for name in ("city.soter", "utopia.json"):
        shutil.copy(DRONE / name, tmp_path)
    monkeypatch.setattr(script, "HERE", tmp_path)

    def pieces(horizontal: str, vertical: str) -> int:
        text = boxes.replace("MARGIN_H: float = 0.785", f"MARGIN_H: float = {horizontal}")
        text = text.replace("MARGIN_V: float = 1.10", f"MARGIN_V: float = {vertical}")
        (tmp_path / "boxes.soter").write_text(text, encoding="utf-8")
        return len(set(pieces_by_faces(script.cells_of(script.inner_room())).values()))

    assert len(MARGINS) == 4
    found = {h: (pieces(h, "1.14"), pieces(h, "1.20")) for h, _ in MARGINS}
    assert found == {h: (1, int(n)) for h, n in MARGINS}


def test_every_node_leads_to_every_other_in_its_piece_of_the_room(script: Any) -> None:
    """Pieces by cells, not by the edges of the roadmap."""
    cells = script.cells_of(script.inner_room())
    piece = pieces_by_faces(cells)
    roadmap = document()
    nodes = [(n["x"], n["y"], n["z"]) for n in roadmap["nodes"]]
    of = [
        next(
            piece[i]
            for i, (low, high) in enumerate(cells)
            if all(low[k] <= p[k] <= high[k] for k in range(3))
        )
        for p in nodes
    ]
    for i, row in enumerate(roadmap["hop"]):
        assert [h >= 0 for h in row] == [of[i] == of[j] for j in range(len(nodes))]


def test_every_way_is_covered_and_right_by_the_referee(onboard: Onboard, script: Any) -> None:
    known = onboard.constants
    a, b, c = (written(m) for m in known["MARGIN"])
    margin = (a, b, c)
    exact = room(known["city.RADIUS"], known["city.CEILING"])
    inner = script.inner_room()
    draw = random.Random(2)  # noqa: S311 - draws, not secrets
    ends: list[Any] = []
    while len(ends) < 800:
        p = tuple(draw.uniform(a, b) for a, b in zip(*inner.inner, strict=True))
        if inner.shares_a_box((p, p), p):
            ends.append(p)
    pairs = list(zip(ends[::2], ends[1::2], strict=True))
    routes = onboard.route(pairs)
    asked = [p for p, r in zip(pairs, routes, strict=True) if len(r.plan)]
    plans = [r.plan.tolist() for r in routes if len(r.plan)]
    assert len(plans) > 250
    for plan, answer in zip(plans, onboard.cover(plans, asked), strict=True):
        assert answer.verdict == "Covered"
        assert len(answer.boxes) <= len(plan) - 1
        assert fault_of(exact, margin, plan, answer.boxes) == ""


def test_where_the_vehicle_cannot_be_there_is_no_way(onboard: Onboard) -> None:
    free = (2.0, 2.0, 2.0)
    hopeless = [(35.0, 30.0, 2.0), (-5.0, 0.0, 2.0), (float("nan"), 2.0, 2.0), (1e300, 2.0, 2.0)]
    for p in hopeless:
        assert all(len(r.plan) == 0 for r in onboard.route([(free, p), (p, free)]))


def no_edge(roadmap: dict[str, Any]) -> None:
    a = roadmap["hop"][0]
    beside = {e["b"] for e in roadmap["edges"] if e["a"] == 0} | {
        e["a"] for e in roadmap["edges"] if e["b"] == 0
    }
    j = next(j for j in range(1, len(a)) if a[j] > 0)
    a[j] = next(k for k in range(1, len(a)) if k not in beside and k != j)


def goes_round(roadmap: dict[str, Any]) -> None:
    e = roadmap["edges"][0]
    hop = roadmap["hop"]
    j = next(
        j
        for j in range(len(hop))
        if hop[e["a"]][j] == e["b"] and hop[e["b"]][j] not in (-1, e["b"])
    )
    hop[e["b"]][j] = e["a"]


def into_a_building(roadmap: dict[str, Any]) -> None:
    roadmap["nodes"][0] = {"x": 35.0, "y": 30.0, "z": 2.0}


def edge_through_a_wall(roadmap: dict[str, Any]) -> None:
    nodes = roadmap["nodes"]
    low = [i for i in range(len(nodes)) if nodes[i]["z"] < 3.0]  # below the tops of the walls
    west = min(low, key=lambda i: nodes[i]["x"])
    east = max(low, key=lambda i: nodes[i]["x"])
    roadmap["edges"].append({"a": west, "b": east})


def a_row_less(roadmap: dict[str, Any]) -> None:
    roadmap["hops"].pop()


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (no_edge, "a next hop is no edge"),
        (goes_round, "hops are not counted down"),
        (into_a_building, "a node is too near to a wall"),
        (edge_through_a_wall, "the box around an edge is not free"),
        (a_row_less, "a row for each node"),
    ],
)
def test_a_wrong_file_is_an_error_of_the_compiler(
    tmp_path: Path, damage: Callable[[dict[str, Any]], None], words: str
) -> None:
    for path in DRONE.iterdir():
        if path.suffix in {".soter", ".json"}:
            shutil.copy(path, tmp_path)
    roadmap = document()
    damage(roadmap)
    (tmp_path / "roadmap.json").write_text(json.dumps(roadmap), encoding="utf-8")
    with pytest.raises(soter.SoterError) as caught:
        soter.load(tmp_path / "roadmap.soter").check()
    assert words in caught.value.diagnostics[0].message
