"""The pages docs/python.md and docs/externs.md say the truth: their examples run."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

import soter
from soter.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
FENCED = re.compile(r"^```(?P<info>[^\n]*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page: str, info: str) -> list[str]:
    text = (DOCS / page).read_text(encoding="utf-8")
    return [m["text"] for m in FENCED.finditer(text) if m["info"] == info]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.pages
def test_the_python_page_runs_from_top_to_bottom(here: Path) -> None:
    for example in ("wall/cart.soter", "testing/late_sc.soter"):
        shutil.copy(ROOT / "examples" / example, here)
    assert main(["new", "robot"]) == 0
    for name in ("robot.soter", "policy.py"):
        shutil.copy(here / "robot" / name, here)
    names: dict[str, object] = {}
    page_blocks = blocks("python.md", "python")
    assert len(page_blocks) > 6
    for number, text in enumerate(page_blocks):
        exec(compile(text, f"docs/python.md, block {number + 1}", "exec"), names)  # noqa: S102


def test_every_argument_of_explore_is_on_the_page() -> None:
    page = (DOCS / "python.md").read_text(encoding="utf-8")
    code = soter.Program.explore.__code__
    arguments = code.co_varnames[1 : code.co_argcount + code.co_kwonlyargcount]
    assert [a for a in arguments if f"    {a}=" not in page.partition("## Test")[2]] == []


@pytest.fixture
def probe(here: Path) -> soter.Program:
    text = (DOCS / "externs.md").read_text(encoding="utf-8")
    for match in FENCED.finditer(text):
        name = re.search(r" file=(\S+)", match["info"])
        if name:
            (here / name[1]).write_text(match["text"])
    return soter.load("probe.soter")


@pytest.mark.parametrize("engine", ["native", "interp"])
def test_the_externs_of_the_page_do_the_same(probe: soter.Program, engine: str) -> None:
    assert probe.diagnostics == probe.check().warnings == ()
    python = probe.simulate(engine=engine)
    assert (python.violations, python.extern_failures, python.notes) == (0, {}, [])
    linked = probe.bind("Pilot", "c:pilot.c:pilot_step").simulate(engine=engine)
    assert linked.trace_sha256 == python.trace_sha256


def test_the_header_of_the_page_is_where_it_says(probe: soter.Program, here: Path) -> None:
    probe.bind("Pilot", "c:pilot.c:pilot_step").build("c", "out")
    assert "probe_Pilot_in" in (here / "out" / "probe.h").read_text()


def test_every_argument_of_simulate_is_on_the_page() -> None:
    page = (DOCS / "python.md").read_text(encoding="utf-8")
    code = soter.Program.simulate.__code__
    arguments = code.co_varnames[1 : code.co_argcount + code.co_kwonlyargcount]
    assert [a for a in arguments if f"    {a}=" not in page] == []
