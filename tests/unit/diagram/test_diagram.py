"""Diagrams: everything of a system is there, once, with its arrows, and nothing covers anything."""

from __future__ import annotations

import random
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

from soter.diagram.layered_layout import Link, Spot, lay_out
from soter.diagram.svg import draw_graph, picture
from soter.diagram.system_graph import DiagramBox, DiagramGraph, boxes_in, graph_of
from soter.language.front_end import check_file, system_of
from tables import all_rows

if TYPE_CHECKING:
    from soter.language.model.system import System

ROOT = Path(__file__).resolve().parents[3]
PROGRAMS = (
    "wall/cart",
    "wall/cart_firmware",
    "testing/three_modules",
    "testing/queue_overflow",
    "gallery/two_robots",
    "mountain_car/cliff",
    "drone/surveillance",
)
SVG = "{http://www.w3.org/2000/svg}"
PICTURES = {"cart": "wall/cart", "surveillance": "drone/surveillance"}


def parsed(svg: str) -> ET.Element:
    return ET.fromstring(svg)  # noqa: S314 - of what was just drawn


@cache
def flat(name: str) -> System:
    """A system of an example, which pictures only read."""
    checked = check_file(str(ROOT / "examples" / f"{name}.soter"))
    default = checked.default_system()
    return system_of(checked, default.name if default else next(iter(checked.systems)))


@pytest.fixture(params=PROGRAMS)
def system(request: pytest.FixtureRequest) -> System:
    return flat(request.param)


def flows(system: System) -> set[tuple[str, str, str]]:
    """Every (component, "reads" or "writes", topic), by name, read off the program itself."""
    edges = set()
    for c in system.components:
        if c.plant is not None:
            read = [c.scope.topics[t] for t in c.plant.reads]
            written = [c.scope.topics[t] for t, _ in c.plant.drives]
        elif c.node is not None:
            read = [c.scope.topics[s.topic] for s in c.node.subscribes]
            written = [c.scope.topics[t] for t in c.node.publishes]
        else:
            assert c.module is not None
            read, written = list(system.modules[c.module].inputs), []
        for i in read:
            queue = system.topics[i].queue_of
            edges.add((c.name, "reads", system.topics[i if queue is None else queue].name))
        edges |= {(c.name, "writes", system.topics[i].name) for i in written}
    return edges


def drawn_flows(graph: DiagramGraph) -> set[tuple[str, str, str]]:
    """The same, read off the arrows; an arrow at a frame is one at everything inside it."""
    inside: dict[str, tuple[DiagramBox, ...]] = {}

    def note(part: object) -> None:
        inside[part.key] = boxes_in(part)  # type: ignore[attr-defined, arg-type]
        for inner in getattr(part, "inside", ()):
            note(inner)

    for part in graph.parts:
        note(part)
    edges = set()
    for arrow in graph.arrows:
        into = arrow.source.startswith("t:")
        topic, other = (arrow.source, arrow.target) if into else (arrow.target, arrow.source)
        for box in inside[topic][0].names:
            for cell in inside[other]:
                if into or cell.kind != "dm":
                    edges.add((cell.names[0], "reads" if into else "writes", box))
    return edges


def test_every_component_and_every_flow_is_drawn_and_no_other(system: System) -> None:
    graph = graph_of(system)
    boxes = [cell for part in graph.parts for cell in boxes_in(part)]
    components = [n for c in boxes if c.kind not in {"topic", "input"} for n in c.names]
    assert sorted(components) == sorted(c.name for c in system.components)
    assert drawn_flows(graph) == flows(system)


def test_every_name_and_period_is_text_of_the_picture(system: System) -> None:
    root = parsed(picture(system))
    texts = [t.text for t in root.iter(f"{SVG}text")]
    for module in system.modules:
        assert any(t and t.startswith(module.name) for t in texts), module.name
    for component in system.components:
        name = component.name.rpartition(".")[2]
        assert component.role == "dm" or name in texts or component.name in texts, component.name
    marked = {n for g in root.iter() for n in g.get("data-component", "").split()}
    assert marked == {c.name for c in system.components}


def test_boxes_of_a_picture_do_not_cover_each_other(system: System) -> None:
    root = parsed(picture(system))
    legends = [e for e in root.iter() if e.get("class") == "legend"]
    hidden = {id(e) for legend in legends for e in legend.iter()}
    frames = [e for e in root.iter() if e.get("class") == "frame"]
    hidden |= {id(e) for f in frames for g in f.findall(f"{SVG}g") for e in g.iter()}
    places = [
        [float(rect.get(k, "0")) for k in ("x", "y", "width", "height")]
        for rect in root.iter(f"{SVG}rect")
        if id(rect) not in hidden and rect.get("class") != "back"
    ]
    assert len(places) > 2
    for i, (x, y, w, h) in enumerate(places):
        for left, top, wide, high in places[i + 1 :]:
            apart = x + w <= left or left + wide <= x or y + h <= top or top + high <= y
            assert apart, (places[i], (left, top, wide, high))


@all_rows("seed", range(20))
def test_arrows_of_any_graph_run_from_box_to_box_layer_by_layer(seed: int) -> None:
    chance = random.Random(seed)  # noqa: S311 - not for secrets
    count = chance.randint(1, 14)
    sizes = [(chance.uniform(20, 200), chance.uniform(20, 90)) for _ in range(count)]
    links = [
        Link(a, sizes[a][0] / 2, b, sizes[b][0] / 2, (str(a), str(b)))
        for a in range(count)
        for b in range(count)
        if chance.random() < 0.2
    ]
    first = frozenset(i for i in range(count) if chance.random() < 0.2)
    layout = lay_out(sizes, links, first)
    for layer in layout.layers:
        for one, other in pairwise(layer):
            assert one.x + one.width <= other.x + 1e-6
    spots = [s for layer in layout.layers for s in layer]
    assert sorted(s.box for s in spots if s.box is not None) == list(range(count))
    following: dict[Spot, set[Spot]] = {}
    for p in layout.pieces:
        assert p.below.layer == p.above.layer + 1
        start, end = (p.below, p.above) if p.up else (p.above, p.below)
        following.setdefault(start, set()).add(end)
    for link in links:
        if link.source != link.target:
            ways = [s for s in spots if s.box == link.source]
            reached: set[int | None] = set()
            while ways:
                for spot in following.get(ways.pop(), ()):
                    reached.add(spot.box)
                    ways += [spot] if spot.box is None else []
            assert link.target in reached


def test_arrows_go_down_where_there_is_no_circle() -> None:
    sizes = [(50.0, 20.0)] * 6
    links = [Link(a, 25.0, b, 25.0, ("", "")) for a in range(6) for b in range(a + 1, 6)]
    layout = lay_out(sizes, links, frozenset({0}))
    assert not any(p.up for p in layout.pieces)
    circle = [*links, Link(5, 25.0, 0, 25.0, ("", ""))]
    assert any(p.up for p in lay_out(sizes, circle, frozenset({0})).pieces)


def test_names_cannot_leave_their_text() -> None:
    graph = DiagramGraph(
        "<script>", (DiagramBox('t:"><b>', "topic", ("<b>&",), "", ('"><b>',)),), ()
    )
    root = parsed(draw_graph(graph))
    assert [e.tag for e in root.iter() if e.tag.endswith(("script", "}b"))] == []


@pytest.mark.parametrize("name", PICTURES)
def test_the_pictures_of_the_docs_are_those_of_the_programs(name: str) -> None:
    """Once out of date: soter show examples/PROGRAM.soter -o docs/img/NAME.svg."""
    shown = (ROOT / "docs" / "img" / f"{name}.svg").read_text(encoding="utf-8")
    assert shown == picture(flat(PICTURES[name]))


def test_arrows_of_another_colour_are_in_the_legend_where_there_are_any(system: System) -> None:
    svg = picture(system)
    upwards = 'class="wire up" data-from' in svg
    assert (">leads upwards<" in svg) == upwards
