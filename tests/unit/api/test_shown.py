"""What a newcomer sees in a script and in a notebook."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

import soter
from processes import run

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"


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
