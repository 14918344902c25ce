"""Where SC would lead: the boxes of the check that flies, and the part that it fails by."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.api import Program
from soter.report.run.where_sc_leads import FAILED
from soter.simulate.run_observer import decided_rows
from soter.simulate.run_report import tube_pictures
from soter.simulate.tube_looks import GOOD, MOVES, REST, SAFE, _with_watched_function, compile_looks
from unit.verify.tubes.test_world_maps import BEFORE_A_WALL

if TYPE_CHECKING:
    import browser
    from soter.simulate.result import Run
    from soter.simulate.tube_looks import TubeLook, TubeLooks

EXAMPLES = Path(__file__).parents[3] / "examples"
FOLLOW = EXAMPLES / "evidence" / "follow.soter"
TEXT = FOLLOW.read_text(encoding="utf-8")
LATER_S = 1e-9
MOVE = (
    "(() => { const m = document.querySelector('figure.led input'); m.value = %d;"
    " m.dispatchEvent(new Event('input')); })()"
)


def flown(folder: Path, text: str = TEXT, until: str | None = None, seed: int = 1) -> Run:
    path = folder / "led.soter"
    path.write_text(text, encoding="utf-8")
    return Program(str(path)).simulate(until=until, seed=seed)


def looked(run: Run, looks: TubeLooks, *, judged: bool = False) -> list[tuple[int, TubeLook]]:
    """(row, look) of all of its decision module."""
    trace = run.require_trace()
    rows = np.flatnonzero(decided_rows(run.system, trace)[:, 0]).tolist()
    states = {r: (trace[r - 1].tobytes() if r else None, trace[r].tobytes()) for r in rows}
    return [(r, looks.follow_tube(0, *at, judged=judged)) for r, at in states.items()]


@pytest.mark.parametrize(
    "example",
    ["evidence/follow", "rest/lane", pytest.param("rest/bicycle", marks=pytest.mark.long)],
)
def test_it_says_what_the_decision_module_said(example: str) -> None:
    run = Program(str(EXAMPLES / f"{example}.soter")).simulate(until="12s")
    looks, own = compile_looks(run.system), run.require_trace()["modules"][:, 0]
    assert looks is not None
    judges = run.system.modules[0].shield is not None
    for row, led in looked(run, looks):
        assert (led.failed == GOOD) == bool(own["safer"][row])
        assert (led.boxes[-1, 0] == FAILED) == (led.failed != GOOD)
    for row, led in looked(run, looks, judged=True) if judges else ():
        assert (led.failed == GOOD) == (not own["ttf"][row])


def held(run: Run, looks: TubeLooks, plant: str, part: float = 1.0) -> tuple[int, int]:
    """States that a look speaks of, and those outside of this part of its boxes, by their middles.

    A look speaks until AC has control again behind the next one, or SC may be at rest.
    """
    trace, seen = run.require_trace(), looked(run, looks)
    times, mode = trace["header"]["ct"] / 1e9, trace["modules"]["mode"][:, 0]
    states = np.stack([trace[plant][name.split(".")[1]] for name in looks.names[0]], axis=1)
    (read,) = run.system.modules[0].inputs
    asked = outside = 0
    for k, (row, led) in enumerate(seen):
        boxes = led.boxes[led.boxes[:, 0] != FAILED]
        if not len(boxes):
            continue
        begin_s = trace["stamps"][row, read] / 1e9
        back = next((times[r] for r, _ in seen[k + 1 :] if mode[r]), times[-1])
        rows = np.flatnonzero((times >= begin_s) & (times <= back))
        after = times[rows] - begin_s
        rows, after = rows[after <= boxes[-1, 1]], after[after <= boxes[-1, 1]]
        middle, half = (0.5 * (boxes[:, 4::2] + s * boxes[:, 3::2]) for s in (1.0, -1.0))
        there = np.abs(states[rows][:, np.newaxis] - middle) <= part * half
        then = (boxes[:, 1] <= after[:, np.newaxis] + LATER_S) & (
            after[:, np.newaxis] <= boxes[:, 2] + LATER_S
        )
        asked += len(rows)
        outside += int((~(there.all(axis=2) & then).any(axis=1)).sum())
    return asked, outside


@pytest.mark.parametrize(
    ("path", "plant", "seed"),
    [("evidence/follow", "r", 1), ("evidence/follow", "r", 2), ("rest/cruise", "r", 1)],
)
def test_all_states_are_in_the_boxes_until_rest_where_sc_leads(
    path: str, plant: str, seed: int
) -> None:
    run = Program(str(EXAMPLES / f"{path}.soter")).simulate(until="30s", seed=seed)
    looks = compile_looks(run.system)
    assert looks is not None
    asked, outside = held(run, looks, plant)
    assert asked > 1000
    assert outside == 0
    assert held(run, looks, plant, 0.5)[1] > 0  # boxes that are half as wide would not do


def test_where_sc_leads_from_the_start_all_states_are_in_them(tmp_path: Path) -> None:
    text = TEXT.replace("module Follow;", "module Follow; force Follow sc;")
    run = flown(tmp_path, text, "6s")
    looks = compile_looks(run.system)
    assert looks is not None
    asked, outside = held(run, looks, "r")
    assert asked > 1000
    assert outside == 0


def test_sc_may_begin_anywhere_in_the_step_before(tmp_path: Path) -> None:
    run = flown(tmp_path, until="5s")
    looks = compile_looks(run.system)
    assert looks is not None
    for _, led in looked(run, looks):
        by_sc = led.boxes[:, 0] == 1.0
        before, after = led.boxes[~by_sc][-1], led.boxes[by_sc]
        overlaps = after[:-1, 2] - after[1:, 1]  # the next one begins when the one before may end
        assert len(overlaps) > 5
        assert np.allclose(overlaps, before[2] - before[1])


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("END: float = 400.0", "END: float = 60.0", SAFE),
        ("within 5s", "within 1s", REST),
        ("CREEP: float = 0.3", "CREEP: float = 0.9", MOVES),
    ],
)
def test_the_part_that_failed_is_named(tmp_path: Path, old: str, new: str, part: int) -> None:
    run = flown(tmp_path, TEXT.replace(old, new))
    looks = compile_looks(run.system)
    assert looks is not None
    failed = [led for _, led in looked(run, looks) if led.failed == part]
    assert failed
    told = looks.failure_words(looks.modules[0], failed[0])
    names = ("sight.v in",) if part == REST else ("sight.gap in", "sight.way in")
    assert all(name in told for name in names)
    assert ("sight.v" in told) == (part == REST)  # only what decides it is told


def test_a_takeover_tells_it_and_says_nothing_of_commands(tmp_path: Path) -> None:
    lost = [d for d in flown(tmp_path, until="14s").decisions if d.after == "SC"]
    assert lost
    for d in lost:
        assert d.words[0].endswith("from where SC is not led to rest")
        assert "is not shown: sight.gap in [" in d.words[1]
        assert "command" not in " ".join(d.words)


# ---------------------------------------------------------------- the page


def test_a_map_is_no_part_of_where_the_robot_is(tmp_path: Path) -> None:
    path = tmp_path / "wall.soter"
    path.write_text(BEFORE_A_WALL, encoding="utf-8")
    looks = compile_looks(Program(str(path)).simulate(until="1s").system)
    assert looks is not None
    assert looks.names == {0: ("sled.p", "sled.v")}


@pytest.mark.parametrize("of", [" {0}", "\n    {0}"])
@pytest.mark.parametrize("between", [", ", ",\n    "])
@pytest.mark.parametrize("brace", [" {", "\n{"])
def test_a_function_is_watched_wherever_its_lines_end(of: str, between: str, brace: str) -> None:
    name = "m_safe_fn"
    given = between.join(["const m_form *x", "soter_fault *fault"])
    text = f"SOTER_INLINE bool{of.format(name)}({given}){brace}\n  return true;\n}}\nint after;\n"
    watched = _with_watched_function(text, name, "", "led_safe(led_said, {0});")
    assert f"const bool led_said = {name}(x, fault);" in watched
    assert watched.index("led_safe(led_said, x)") < watched.index(f"#define {name} {name}_noted")


def pictured(page: Path) -> list[dict[str, Any]]:
    text = page.read_text(encoding="utf-8")
    found = re.findall(r'<figure class="led">.*?<script[^>]*>(.*?)</script>', text, re.DOTALL)
    return [json.loads(x) for x in found]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Path]:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    program = Program(str(FOLLOW))
    run = program.simulate(until="15s")
    return run, program.write_report(run, tmp_path_factory.mktemp("led") / "led.html")


def test_a_page_has_the_boxes_of_the_check_rounded_outwards(report: tuple[Run, Path]) -> None:
    run, page = report
    ((drawn,), (picture,)) = pictured(page), tube_pictures(run)
    scale = np.repeat(drawn["scale"], 2)
    assert len(drawn["looks"]) == len(picture.looks) > 100
    lost = {d.time_ns / 1e9 for d in run.decisions if d.after == "SC"}
    assert lost <= {x["t"] for x in drawn["looks"]}
    for shown, look in zip(drawn["looks"], picture.looks, strict=True):
        boxes = np.array(shown["boxes"], dtype=float)
        low, high = boxes[:, 3::2] / scale[::2], boxes[:, 4::2] / scale[::2]
        for kind, begin, end, *ends in np.clip(look.boxes, -1e9, 1e9).tolist():
            around = (
                (boxes[:, 0] == kind) & (boxes[:, 1] <= 1e3 * begin) & (1e3 * end <= boxes[:, 2])
            )
            inside = (low <= ends[::2]) & (ends[1::2] <= high)
            assert (around & inside.all(axis=1)).any()
        for upper in (False, True):  # and no wider than the last digit
            of = np.clip(look.boxes[:, 3 + upper :: 2], -1e9, 1e9)
            edge, page_edge = (of.max(0), high.max(0)) if upper else (of.min(0), low.min(0))
            assert (np.abs(edge - np.clip(page_edge, -1e9, 1e9)) <= 1.001 / scale[::2]).all()


def test_a_page_without_rest_has_none_of_it(tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    program = Program(str(EXAMPLES / "wall" / "cart.soter"))
    page = program.write_report(program.simulate(until="2s"), tmp_path / "cart.html")
    assert "figure.led" not in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("width", [420, 1300])
def test_each_look_is_drawn_where_the_slider_is_at_it(
    report: tuple[Run, Path], page: browser.Page, width: int
) -> None:
    (drawn,) = pictured(report[1])
    page.size(width, 900)
    page.open(report[1].as_uri())
    page.wait("document.querySelectorAll('figure.led svg').length === 4")
    for k, look in list(enumerate(drawn["looks"]))[::29]:
        page.value(MOVE % k)
        assert page.value("document.querySelector('figure.led .told').innerHTML").endswith(
            look["told"]
        )
        count = page.value("document.querySelectorAll('figure.led g rect').length")
        assert count == 4 * len(look["boxes"])
    assert page.value("document.documentElement.scrollWidth") <= width
    assert page.errors == []
