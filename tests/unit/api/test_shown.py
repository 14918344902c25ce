"""What a newcomer sees in a script and in a notebook."""

from __future__ import annotations

import os
import re
import sys
from html import unescape
from pathlib import Path

import pytest

import browser
import soter
from processes import run
from unit.verify.diagnosis.tank_modules import TANK

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
FRAME_MB = 2.5
"""Of a report in a notebook, drawing library included."""


def ended(folder: Path, text: str, **more: str) -> str:
    (folder / "mine.py").write_text(text)
    done = run(
        (sys.executable, "mine.py"),
        cwd=folder,
        env={**os.environ, **more},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    told: str = done.stderr
    return told


def test_a_mistake_that_nobody_catches_is_short(tmp_path: Path) -> None:
    told = ended(tmp_path, 'import soter\nsoter.load("nope.soter").simulate()\n')
    assert "Traceback" not in told
    assert "api/program.py" not in told
    assert 'mine.py", line 2' in told
    assert "error[D001]: cannot find `nope.soter`" in told
    assert len(told.splitlines()) <= 4


def test_everything_is_shown_when_asked_for(tmp_path: Path) -> None:
    text = 'import soter\nsoter.load("nope.soter").simulate()\n'
    assert "Traceback" in ended(tmp_path, text, SOTER_TRACEBACK="1")


def test_other_mistakes_and_other_hooks_stay_as_they_are(tmp_path: Path) -> None:
    assert "Traceback" in ended(tmp_path, "import soter\nsoter.load\n1 / 0\n")
    text = "import sys\nsys.excepthook = lambda *a: print('mine', file=sys.stderr)\nimport soter\n"
    assert ended(tmp_path, text + "soter.load('nope.soter').check()\n") == "mine\n"


def test_a_notebook_shows_the_same(tmp_path: Path) -> None:
    with pytest.raises(soter.SoterError) as caught:
        soter.load(tmp_path / "nope.soter").check()
    lines = caught.value._render_traceback_()  # type: ignore[attr-defined]
    assert any("error[D001]" in line for line in lines)
    assert not any("api/program.py" in line for line in lines)


def test_results_show_themselves_in_a_notebook() -> None:
    program = soter.load(CART)
    check, quiet, broken = (
        r._repr_html_()
        for r in (
            program.check(),
            program.simulate(until=1.0),
            program.simulate("Unprotected", until=10.0),
        )
    )
    assert "<td>SafeCart</td>" in check
    assert "<th>AC share</th>" in quiet
    assert "<li>" not in quiet
    assert "<li>" in broken
    assert "&lt;" not in quiet.split("<table>")[0]


FRAME = re.compile(r'<iframe srcdoc="(.*?)" sandbox="allow-scripts"', re.DOTALL)


def in_frame(html: str) -> str:
    """What a frame in a notebook shows, if there is just one."""
    (frame,) = FRAME.findall(html)
    return unescape(frame)


@pytest.mark.long
def test_a_notebook_shows_the_report_of_a_proof_inline(tmp_path: Path) -> None:
    (tmp_path / "tank.soter").write_text(TANK)
    report = soter.load(tmp_path / "tank.soter").verify()
    page = tmp_path / "page.html"
    soter.load(tmp_path / "tank.soter").verify(report=page)
    numbers = re.compile(r"[\d.]+")  # among them times by the clock
    assert numbers.sub("", in_frame(report._repr_html_())) == numbers.sub("", page.read_text())


def test_a_run_without_a_whole_trace_is_a_table_only() -> None:
    program = soter.load(CART)
    for trace in (False, ["motion"]):
        html = program.simulate(until=1.0, trace=trace)._repr_html_()
        assert "<td>SafeCart</td>" in html
        assert "<iframe" not in html


def test_a_notebook_shows_the_report_of_a_run_inline_and_it_draws(tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="the extra `report` is not installed")
    html = soter.load(CART).simulate(until=10.0)._repr_html_()
    assert len(html) < FRAME_MB * 1e6
    if browser.chromium() is None:
        pytest.skip("no chromium on this machine")
    shown = "document.querySelectorAll('#figure-chart-0 .main-svg').length > 0"
    (tmp_path / "frame.html").write_text(in_frame(html), encoding="utf-8")
    (tmp_path / "notebook.html").write_text(f"<!DOCTYPE html><body>{html}", encoding="utf-8")
    with browser.page() as page:
        page.open((tmp_path / "frame.html").as_uri())
        page.wait(shown)
        page.open((tmp_path / "notebook.html").as_uri())
        page.wait("document.querySelector('iframe') !== null")
        page.wait("document.readyState === 'complete'")
        assert page.errors == []
        assert {r.split(":")[0] for r in page.requests} <= {"file", "data", "blob", "about"}
