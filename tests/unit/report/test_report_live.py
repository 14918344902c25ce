"""A run replayed on the diagram of its program: what a person sees is what the trace holds."""

from __future__ import annotations

import json
import random
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from soter.report.run.live_diagram import Live, Values, live_json
from soter.report.templates import packed

if TYPE_CHECKING:
    import browser

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
CART = EXAMPLES / "wall" / "cart.soter"
STACK = EXAMPLES / "drone" / "surveillance.soter"
LATE = EXAMPLES / "testing" / "late_sc.soter"
PAGE_KB = 300
MOVE = (
    "(() => { const m = document.getElementById('moment'); m.value = %r;"
    " m.dispatchEvent(new Event('input')); })()"
)
READY = "document.readyState === 'complete' && document.querySelector('.player') !== null"
"""The page's scripts have run, too."""
SHOWN = "[...document.querySelectorAll('[data-value=\"%s\"]')].map((e) => e.textContent)"
STEPPING = "[...document.querySelectorAll('.step')].map((e) => e.dataset.component)"
LIT = "[...document.querySelectorAll('.on')].map((e) => e.dataset.component)"


def unpacked(value: Any) -> list[float | None]:
    """As `assets/packed.js` does it."""
    if not isinstance(value, dict):
        return list(value)
    total, values = 0, []
    for step in value["d"]:
        total += step or 0
        values.append(None if step is None else total / 10 ** value["e"])
    return values


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Path, Path]:
    """A run of the cart, its report, and its log on the diagram."""
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    pytest.importorskip("mcap", reason="the extra `logs` is not installed")
    folder = tmp_path_factory.mktemp("live")
    program = soter.load(CART)
    run = program.simulate(until="10s")
    log = folder / "cart.mcap"
    program.simulate(until="10s", log=log)
    page = program.diagram().write_replay(log, folder / "log.html")
    return run, program.write_report(run, folder / "run.html"), page


@pytest.mark.parametrize("which", [1, 2], ids=["report", "log"])
def test_boxes_hold_what_the_trace_holds_at_that_moment(
    cart: tuple[Any, Path, Path], page: browser.Page, which: int
) -> None:
    run = cart[0]
    page.size(420, 900)
    page.open(cart[which].as_uri())
    page.wait(READY)
    times, trace = run.trace["header"]["ct"], run.trace
    rng = random.Random(7)  # noqa: S311 - which moments
    for row in [0, *(rng.randrange(len(times)) for _ in range(40))]:
        page.value(MOVE % (int(times[row]) / 1e9))
        accel, x = trace["topics"]["accel"][row], trace["c"]["x"][row]
        assert page.value(SHOWN % "accel") == [written(accel, "m/s^2")]
        (shown,) = page.value(SHOWN % "truth:c.x")
        assert float(shown.split()[1]) == pytest.approx(x, abs=0.6e-3 if which == 2 else 0.02)
        m = trace["modules"][row, 0]
        holder = "SafeCart.Fast" if m["mode"] else "SafeCart.Careful"
        assert page.value(LIT) == [holder]
        words = [w for w in ("ttf", "safer", "stale") if m[w]]
        assert page.value(SHOWN % "saw:SafeCart") == [" ".join(words) or "no ttf"]
    assert page.value("document.documentElement.scrollWidth") <= 420
    assert {r.split(":")[0] for r in page.requests} <= {"file", "data", "blob"}
    assert page.errors == []


def written(value: float, unit: str) -> str:
    return f"{value:.3f} {unit}".replace("-", "\N{MINUS SIGN}")


def test_who_steps_at_an_instant_lights_up_and_buttons_go_from_one_to_the_next(
    cart: tuple[Any, Path, Path], page: browser.Page
) -> None:
    page.open(cart[2].as_uri())
    page.wait(READY)
    page.value(MOVE % 1.0)
    everybody = ["c", "SafeCart.Fast", "SafeCart.dm", "SafeCart.Careful"]
    assert sorted(page.value(STEPPING)) == sorted(everybody)
    page.value("document.querySelector('.next').click()")
    assert page.value("document.querySelector('output').textContent") == "1.005 s"
    assert page.value(STEPPING) == ["c"]
    page.value("document.querySelector('.next').click()")
    assert sorted(page.value(STEPPING)) == ["SafeCart.Careful", "SafeCart.Fast", "c"]
    page.value("document.querySelector('.back').click()")
    assert page.value("document.querySelector('output').textContent") == "1.005 s"
    page.value(MOVE % 1.002)
    assert page.value(STEPPING) == []


def test_it_plays_to_the_end_and_stops(cart: tuple[Any, Path, Path], page: browser.Page) -> None:
    page.open(cart[2].as_uri())
    page.wait(READY)
    page.value("document.querySelector('.player select').value = '10'")
    page.value("document.querySelector('.play').click()")
    page.wait("Number(document.getElementById('moment').value) > 0.5")
    assert page.value("document.querySelector('.play').getAttribute('aria-label')") == "pause"
    page.wait("document.querySelector('output').textContent === '10.000 s'")
    page.wait("document.querySelector('.play').getAttribute('aria-label') === 'play'")


@pytest.mark.parametrize(("program", "until"), [(CART, "30s"), (STACK, "60s")])
def test_a_page_with_a_replay_stays_light(program: Path, until: str, tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    loaded = soter.load(program)
    path = loaded.write_report(loaded.simulate(until=until), tmp_path / "page.html")
    live = re.search(r'id="live">(.*?)</script>', path.read_text(), re.DOTALL)
    assert live is not None
    assert json.loads(live.group(1))["values"]
    assert path.stat().st_size <= PAGE_KB * 1000


def test_a_topic_that_is_called_like_a_state_keeps_its_own_numbers() -> None:
    time_s = np.array([0.0, 1.0])
    truth = Values("truth:car.x", "x", ("car.x",), time_s, (np.array([1.0, 2.0]),))
    topic = Values("car.x", "", ("car.x",), time_s, (np.array([3.0, 4.0]),))
    rows: Any = live_json(Live(1.0, (truth, topic), (), ()), {"car.x": (0, 0)})["values"]
    assert [row["v"][0] for row in rows] == [[1.0, 2.0], [3.0, 4.0]]


def test_packed_lists_are_the_same_doubles() -> None:
    rng = random.Random(5)  # noqa: S311 - which lists
    for _ in range(200):
        digits, size = rng.randrange(7), 10 ** rng.randrange(6)
        given = [
            None if rng.random() < 0.05 else round(rng.uniform(-size, size), digits) + 0.0
            for _ in range(60)
        ]
        short = packed(given)
        assert isinstance(short, dict)
        assert unpacked(short) == given
    for whole in ([1.0] * 50, ["a"] * 60, [True] * 60, [1e-20, 1.0] * 30, [float("inf")] * 60):
        assert packed(whole) is whole


def test_rows_that_change_often_stand_on_a_grid_and_others_keep_every_change() -> None:
    time_s = np.arange(10_000) / 1000.0
    quick = Values("q", "", ("q",), time_s, (np.sin(time_s),))
    slow = Values("s", "", ("s",), time_s, ((time_s >= 4.321).astype(float),), words=("no", "yes"))
    drawn = {"else": (0, 0)}
    live_document = live_json(Live(9.999, (quick, slow), (), ()), drawn)
    rows: Any = live_document["values"]
    assert unpacked(rows[1]["t"]) == [0.0, 4.321]
    assert unpacked(rows[1]["v"][0]) == [0.0, 1.0]
    grid = unpacked(live_document["grid"])
    assert "t" not in rows[0]
    held = unpacked(rows[0]["v"][0])
    assert len(held) == len(grid) >= 100
    for t, value in zip(grid, held, strict=True):
        assert t is not None
        assert value == pytest.approx(np.sin(np.floor((t + 5e-5) * 1000) / 1000), abs=1e-3)
