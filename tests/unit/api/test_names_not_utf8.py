"""Names that are not UTF-8, given to the Python API: refused before any work, as commands do it.

Non-goals: the command line (`tests/unit/cli/test_cli_hostile.py`).
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.api import load
from soter.diagnostics.diagnostic import SoterError
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.api import Program

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
BAD = os.fsdecode(b"name\xff")
TABLE: dict[str, Any] = {
    "time": {"from": "t"},
    "topics": {"motion": {"fields": {"x": "x", "v": "v"}}},
}

CALLS: dict[str, Callable[[Program, Path], object]] = {
    "a log of somebody else": lambda p, d: p.judge_log(d / f"{BAD}.csv", TABLE),
    "a mapping": lambda p, d: p.judge_log(d / "log.csv", d / f"{BAD}.toml"),
    "a log of a run": lambda p, d: p.monitor(d / f"{BAD}.mcap"),
    "a log to write": lambda p, d: p.simulate(until="1s", log=d / f"{BAD}.mcap"),
    "the report of a run": lambda p, d: p.simulate(until="1s", report=d / f"{BAD}.html"),
    "a report of a run that ended": lambda p, d: p.write_report(
        p.simulate(until="1s", trace=True), d / f"{BAD}.html"
    ),
    "the log of a run that ended": lambda p, d: p.write_log(
        p.simulate(until="1s", trace=True), d / f"{BAD}.mcap"
    ),
    "the report of a proof": lambda p, d: p.verify(report=d / f"{BAD}.html"),
    "a certificate": lambda p, d: p.verify(cert=d / BAD),
    "advice": lambda p, d: p.advise(report=d / f"{BAD}.html"),
    "a folder of flights": lambda p, d: p.campaign(flights=1, output=d / BAD),
    "a package": lambda p, d: p.build("c", d / BAD),
    "a safety case": lambda p, d: p.assure(d / BAD),
    "a certificate of a case": lambda p, d: p.assure(d / "case", cert=d / BAD),
    "a monitor": lambda p, d: p.emit_monitor(d / f"{BAD}.soter"),
}


@all_rows("what", CALLS)
def test_a_name_that_is_not_utf8_is_refused_with_a_code(tmp_path: Path, what: str) -> None:
    program = load(shutil.copy(CART, tmp_path / "cart.soter"))
    with pytest.raises(SoterError) as error:
        CALLS[what](program, tmp_path)
    (problem,) = error.value.diagnostics
    assert problem.code == "U003"
    assert "name\\xff" in problem.message
    str(error.value).encode()
    assert [path.name for path in tmp_path.iterdir()] == ["cart.soter"], "nothing was written"


def test_a_folder_above_is_no_matter(tmp_path: Path) -> None:
    """As long as nobody names it."""
    folder = tmp_path / BAD
    folder.mkdir()
    shutil.copy(CART, folder / "cart.soter")
    (folder / "log.csv").write_text("t,x,v\n0,0.1,0.1\n1,0.1,0.1\n")
    before = Path.cwd()
    os.chdir(folder)
    try:
        found = load("cart.soter").judge_log("log.csv", TABLE, system="Protected")
    finally:
        os.chdir(before)
    assert found.samples == {"motion": 2}
