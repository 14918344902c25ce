"""The page of an exploration shows what was known when, and what the run did."""

from __future__ import annotations

import base64
import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import browser
import processes

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples" / "exploration"
SCRIPT, PAPER = EXAMPLE / "replay.py", EXAMPLE / "paper.soter"
OWN = ("replay", "exploration_page", "exploration_record", "sketch")
SEED, UNTIL_S = 3, 8

SHOW = """(() => {
  const when = document.getElementById("when");
  when.value = %g;
  when.dispatchEvent(new Event("input"));
  return document.getElementById("reading").textContent;
})()"""
"""Moves the slider; gives what the page says then."""
LIKE_THE_CORNER = """(() => {
  const map = document.getElementById("map");
  const all = map.getContext("2d").getImageData(0, 0, map.width, map.height).data;
  const pixels = new Uint32Array(all.buffer);
  const corner = pixels[3 * map.width + 3];
  return pixels.filter((p) => p === corner).length / pixels.length;
})()"""
"""Which part of the map has the colour of a corner, which stays unknown."""


@pytest.fixture(scope="module")
def example() -> Iterator[Any]:
    """The example's own modules can be imported; gives that of the page."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(EXAMPLE))
        import exploration_page

        yield exploration_page
    for name in OWN:
        sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def explored(example: Any) -> Any:
    import exploration_record

    import soter

    assert example is not None
    program = soter.load(str(PAPER))
    return exploration_record.fly(program, "Paper", seed=SEED, until=f"{UNTIL_S}s")


@pytest.fixture(scope="module")
def page(example: Any, explored: Any) -> str:
    text: str = example.page(explored, "the command")
    return text


@pytest.fixture(scope="module")
def given(page: str) -> dict[str, Any]:
    """What the page's script is given."""
    found = re.search(r'id="explored">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def known_ms(given: dict[str, Any]) -> Any:
    return np.frombuffer(base64.b64decode(given["known"]), dtype="<u4")


# ---------------------------------------------------------------- what was known when


def test_at_every_instant_the_page_knows_the_cells_that_the_vehicle_knew(
    explored: Any, given: dict[str, Any]
) -> None:
    run = explored.program.simulate(
        "Paper", seed=SEED, until=f"{UNTIL_S}s", trace=["mapper.known"], sha256=False
    )
    times_ms = np.round(1000 * run.time_s()).astype(np.int64)
    known = run.topic("mapper.known") != 0
    assert known[0].sum() < known[-1].sum()
    for t, cells in zip(times_ms, known, strict=True):
        assert np.array_equal(known_ms(given) <= t, cells)


def test_the_share_at_the_end_is_that_of_the_last_map(explored: Any, page: str) -> None:
    cells = int((explored.last("known") != 0).sum())
    assert 0 < cells < 14400
    assert f"{cells} of 14400 cells, {100 * cells / 14400:.1f} %" in page
    assert explored.share_known(np.array([float(UNTIL_S)])) == cells / 14400


def test_a_map_that_forgets_is_noticed(example: Any) -> None:
    import exploration_record

    assert example is not None
    state = np.dtype([("header", [("ct", "<i8")]), ("topics", [("mapper.known", "u1", (2,))])])
    rows = np.zeros(3, dtype=state)
    rows["header"]["ct"] = [0, 5_000_000, 10_000_000]
    for known, forgotten in (
        ([[0, 1], [0, 1], [1, 1]], False),
        ([[0, 1], [0, 0], [1, 1]], True),
    ):
        rows["topics"]["mapper.known"] = known
        watch = exploration_record.Watch({"known": "mapper.known"}, 2)
        watch._see_cells(rows)
        assert watch.forgotten is forgotten
        assert watch.known_ms.tolist() == [10, 0]


# ---------------------------------------------------------------- what the run did


def test_every_takeover_and_hand_back_is_on_the_page(
    explored: Any, page: str, given: dict[str, Any]
) -> None:
    module = explored.run.modules["SafeMotionPrimitive"]
    to = [d[1] for d in given["decisions"]]
    assert module.switches_to_sc > 0
    assert to.count("SC") == module.switches_to_sc
    assert to.count("AC") == module.switches_to_ac
    for what, count in (
        ("takeovers by SC", module.switches_to_sc),
        ("hand-backs to AC", module.switches_to_ac),
        ("violations", explored.run.violations),
    ):
        assert f'<th scope="row">{what}</th><td><strong>{count}</strong>' in page


def test_the_vehicle_is_drawn_in_the_box_in_force(explored: Any, given: dict[str, Any]) -> None:
    assert len(explored.flown) > 1
    assert explored.run.violations == 0
    since = [b.time_s for b in explored.flown]
    box = np.concatenate([b.corners for b in explored.flown])
    in_force = box[np.searchsorted(since, explored.time_s, side="right") - 1]
    assert (explored.position >= in_force[:, :2]).all()
    assert (explored.position <= in_force[:, 2:]).all()
    for time_s, _, x, y in given["decisions"]:
        a, b, c, d = next(b for t, (b,) in reversed(given["flown"]) if t <= time_s)
        assert a <= x <= c
        assert b <= y <= d


def test_goals_are_numbered_and_those_not_reached_are_named(
    explored: Any, page: str, given: dict[str, Any]
) -> None:
    assert len(given["goals"]) == 10
    times, numbers = zip(*given["next"], strict=True)
    assert list(numbers) == list(range(len(numbers)))
    assert list(times) == sorted(times)
    reached = explored.last("tour")["reached"]
    assert 0 < reached.sum() < 10
    missing = ", ".join(str(k + 1) for k in range(10) if not reached[k])
    assert f"{reached.sum()} of 10; not {missing}" in page


def test_the_page_names_what_the_mapper_assumes(page: str) -> None:
    header = (EXAMPLE / "mapper.soter").read_text(encoding="utf-8").replace("\n// ", " ")
    found = re.search(r"Ranges within ERROR_RANGE[^<]*", page)
    assert found is not None
    told = found[0][1:]
    assert told in header
    assert told.endswith("nothing that moves.")


# ---------------------------------------------------------------- the files


def test_the_page_needs_no_network_and_its_script_tells_what_the_run_did(
    explored: Any, page: str, tmp_path: Path
) -> None:
    assert "http" not in page.replace("http-equiv", "")
    if browser.chromium() is None:
        pytest.skip("no chromium on this machine")
    file = tmp_path / "page.html"
    file.write_text(page, encoding="utf-8")
    with browser.page() as shown:
        shown.open(file.as_uri())
        shown.wait("document.readyState === 'complete' && typeof exploredAt !== 'undefined'")
        told = "Array.from({length: 81}, (_, k) => exploredAt(k / 10))"
        shares = shown.value(f"{told}.map((now) => now.known)")
        decisions = shown.value(f"{told}.map((now) => now.decisions)")
        assert shown.value("getComputedStyle(document.querySelector('.still')).display") == "none"
        assert shown.value(SHOW % 2.5).startswith(f"2.5 s · {100 * shares[25]:.1f} % known · ")
        unknown = []
        for t in (0, UNTIL_S):
            shown.value(SHOW % t)
            unknown.append(shown.value(LIKE_THE_CORNER))
        assert {r.split(":")[0] for r in shown.requests} == {"file"}
        assert shown.errors == []
    times_s = np.arange(81) / 10
    assert shares == sorted(shares)
    assert shares[0] < shares[-1]
    assert shares == pytest.approx(explored.share_known(times_s).tolist())
    assert decisions == [sum(d.time_s <= t + 1e-6 for d in explored.decisions()) for t in times_s]
    assert unknown[0] - unknown[1] == pytest.approx(shares[-1] - shares[0], rel=0.05)


def test_without_javascript_the_page_shows_the_end(example: Any, explored: Any, page: str) -> None:
    assert example.still(explored) in page
    assert "JavaScript replays the run" in page


def test_the_picture_is_a_drawing_of_its_own(example: Any, explored: Any) -> None:
    picture = example.picture(explored)
    root = ET.fromstring(picture)  # noqa: S314 - written above
    svg = "{http://www.w3.org/2000/svg}"
    style = next(root.iter(f"{svg}style")).text or ""
    for name in set(re.findall(r"var\((--[a-z0-9-]+)\)", picture)):
        assert f"{name}:" in style
    texts = root.iter(f"{svg}text")
    goals = [t.text for t in texts if "paint-order" in t.get("style", "")]
    assert goals == [str(k) for k in range(1, 11)]
    assert len(picture) < 200_000


def test_the_command_writes_both_files(
    example: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    import replay

    assert example is not None
    file, picture = tmp_path / "new" / "page.html", tmp_path / "picture.svg"
    line = ["replay.py", "--file", str(PAPER), "--until", "1s", "-o", str(file)]
    monkeypatch.setattr(sys, "argv", [*line, "--svg", str(picture)])
    with pytest.raises(SystemExit) as stopped:
        replay.main()
    assert stopped.value.code == 0
    assert f"wrote {file}, {picture}" in capsys.readouterr().out
    assert "What this rests on" in file.read_text(encoding="utf-8")
    assert picture.read_text(encoding="utf-8").startswith("<svg ")


@pytest.mark.parametrize(
    ("line", "code", "message"),
    [
        (["--until", "0"], 1, "error[U001]: `until` cannot be `0`"),
        (["--system", "Nope"], 1, "error[U002]: there is no system `Nope`"),
        (["--file", "nowhere.soter"], 1, "error[D001]: cannot find `nowhere.soter`"),
        (["--file", "examples/wall/cart.soter"], 2, "explores nothing: it has no topic known"),
    ],
)
def test_what_cannot_be_flown_is_refused_in_words(
    line: list[str], code: int, message: str, tmp_path: Path
) -> None:
    file = tmp_path / "page.html"
    done = processes.run(
        [sys.executable, str(SCRIPT), *line, "-o", str(file)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    assert message in done.stderr
    assert not file.exists()
