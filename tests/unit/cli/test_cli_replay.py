"""`soter replay`: what reproduces, what does not, and files that are damaged or mean harm."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

from generators.changed_modules import BASES
from generators.damaged_json import MISSING, damaged
from unit.cli.test_cli_test import CORRIDOR

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Soter = Callable[..., Any]
    Golden = Callable[[str, str], None]

WRONG: tuple[Any, ...] = (None, True, -1, 1.5, 10**30, "x", [], {}, MISSING)
TRACE = ".soter/corridor-Far.trace.json"


@pytest.fixture
def trace(soter: Soter, here: Path) -> Path:
    """A trace of the corridor, and the program beside it."""
    (here / "corridor.soter").write_text(CORRIDOR)
    assert soter("test", "corridor.soter", "--test", "Far").exit == 3
    return here / TRACE


def changed(trace: Path, **fields: object) -> None:
    """The trace with other fields."""
    document = json.loads(trace.read_text("utf-8"))
    trace.write_text(json.dumps({**document, **fields}), "utf-8")


def test_a_trace_reproduces_step_by_step(soter: Soter, trace: Path, golden: Golden) -> None:
    assert trace.exists()
    done = soter("replay", TRACE)
    assert done.exit == 0
    assert "REPRODUCED  always abs(robot.truth.at) <= END is violated at step" in done.out
    golden("cli/replay.txt", "\n".join(done.out.splitlines()[1:]))


def test_the_document_has_every_step(soter: Soter, trace: Path) -> None:
    document = soter("replay", str(trace), "--json").document
    assert document["reproduced"] is True
    assert document["kind"] == "trace"
    assert document["property"] == "always abs(robot.truth.at) <= END"
    steps = document["steps"]
    assert document["violated_at"] == steps[-1]["step"]
    assert steps[-1]["violated"] == [document["property"]]
    assert abs(steps[-1]["truth"]["robot"]["at"]) == 3
    assert steps[0]["kind"] == "start"
    assert any(s["choices"] and s["choices"][0]["value"] in (-1, 0, 1) for s in steps)


def test_pages_and_logs_are_written(soter: Soter, trace: Path, here: Path) -> None:
    done = soter("replay", str(trace), "--html", "far.html", "--mcap", "far.mcap", "--json")
    assert done.exit == 0
    assert (done.document["html"], done.document["mcap"]) == ("far.html", "far.mcap")
    assert "corridor" in (here / "far.html").read_text("utf-8")
    assert (here / "far.mcap").read_bytes().startswith(b"\x89MCAP")
    (here / "file").write_text("")
    done = soter("replay", str(trace), "--html", "file/far.html", "--json")
    assert done.exit == 1
    assert done.codes == ["D006"]
    assert done.document["reproduced"] is True


def test_it_is_found_from_another_folder(
    soter: Soter, trace: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "elsewhere").mkdir()
    monkeypatch.chdir(here / "elsewhere")
    assert soter("replay", str(trace)).exit == 0
    assert soter("replay", f"../{TRACE}").exit == 0


def test_a_page_of_a_replay_keeps_what_the_verdict_rests_on(
    soter: Soter, trace: Path, here: Path
) -> None:
    assert soter("replay", TRACE, "--report", "far.html").exit == 0
    page = (here / "far.html").read_text("utf-8")
    assert "nothing is said about times after the horizon, 120 ms" in page
    assert '<p class="kicker">corridor.soter · ' in page
    assert "No execution violates it in fewer steps" in page
    assert "Violated after 12 steps, at 30 ms." in page
    document = json.loads(trace.read_text("utf-8"))
    del document["assumptions"], document["not_shortest"]  # as older versions wrote it
    trace.write_text(json.dumps(document), "utf-8")
    assert soter("replay", TRACE, "--report", "far.html").exit == 0
    page = (here / "far.html").read_text("utf-8")
    assert "the output of <code>soter test</code> does" in page


def test_a_trace_that_was_moved_says_where_programs_are_looked_for(
    soter: Soter, trace: Path, here: Path
) -> None:
    (here / "elsewhere" / "deep").mkdir(parents=True)
    moved = here / "elsewhere" / "deep" / "moved.trace.json"
    trace.rename(moved)
    done = soter("replay", "elsewhere/deep/moved.trace.json")
    assert done.exit == 1
    assert "elsewhere/corridor.soter" in done.err
    assert "relative to its own place" in done.err
    assert "did you mean" not in done.err


def test_times_of_steps_that_are_not_allowed_have_readable_units(soter: Soter, trace: Path) -> None:
    steps = json.loads(trace.read_text("utf-8"))["steps"]
    steps[-1]["time_ns"] += 10_000_000
    changed(trace, steps=steps)
    said = soter("replay", TRACE).out
    assert "it can happen from 30 ms to 30 ms, not at 40 ms" in said


def test_a_trace_without_its_end_is_not_reproduced(soter: Soter, trace: Path) -> None:
    steps = json.loads(trace.read_text("utf-8"))["steps"]
    changed(trace, steps=steps[:-1])
    done = soter("replay", str(trace))
    assert done.exit == 3
    assert "NOT REPRODUCED" in done.out
    changed(trace, steps=[])
    assert soter("replay", str(trace), "--json").document["reproduced"] is False


def test_a_changed_order_is_not_reproduced(soter: Soter, trace: Path) -> None:
    steps = json.loads(trace.read_text("utf-8"))["steps"]
    changed(trace, steps=[*steps[:2], *steps[-1:], *steps[2:]])
    done = soter("replay", str(trace), "--json")
    assert done.exit == 3
    assert done.document["violated_at"] is None


def test_a_changed_program_is_another_one(soter: Soter, trace: Path, here: Path) -> None:
    (here / "corridor.soter").write_text(CORRIDOR + "// repaired\n")
    done = soter("replay", str(trace), "--json")
    assert done.exit == 1
    assert done.codes == ["D011"]
    (here / "corridor.soter").unlink()
    done = soter("replay", str(trace), "--json")
    assert done.exit == 1
    assert done.codes == ["D001"]


@pytest.mark.parametrize(
    ("fields", "exit_", "code"),
    [
        ({"test": "None"}, 1, "D010"),
        ({"params": {"NONE": 1}}, 1, "D010"),
        ({"params": {"END": "x"}}, 1, "D010"),
        ({"params": {"END": 7000}}, 1, None),
        ({"property": {"what": "timed", "index": 4, "text": "x"}}, 3, None),
        ({"property": {"what": "property", "index": 0, "text": "\x1b[31m"}}, 3, None),
        ({"skew_ns": 5_000_000}, 3, None),  # then it fails earlier: the trace goes on after that
        ({"horizon_ns": 0}, 1, "D010"),
        ({"horizon_ns": 10_000_000}, 3, None),
        ({"program": "/dev/null"}, 1, None),
        ({"program": "\0"}, 1, None),
        ({"program": "."}, 1, None),
        ({"seed": 2**64}, 1, "D010"),
    ],
)
def test_what_does_not_fit_the_program(
    soter: Soter, trace: Path, fields: dict[str, object], exit_: int, code: str | None
) -> None:
    changed(trace, **fields)
    done = soter("replay", str(trace), "--json")
    assert done.exit == exit_
    assert code is None or done.codes == [code]
    assert "\x1b" not in soter("replay", str(trace)).out


def test_other_files_are_no_traces(soter: Soter, here: Path) -> None:
    (here / "deep.json").write_text("[" * 200_000)
    for name in ("cart.soter", "nothing.json", ".", "deep.json", "/dev/zero"):
        done = soter("replay", name, "--json")
        assert (done.exit, done.codes) == (1, ["D010"])
    assert soter("replay", "--json").exit == 2


# ---------------------------------------------------------------- counterexamples of `soter verify`


@pytest.fixture
def counterexample(soter: Soter, here: Path) -> Path:
    (here / "tank.soter").write_text(BASES["tank"].changed("ttf is constant false"))
    assert soter("verify", "tank.soter").exit == 3
    return here / ".soter" / "tank-SafeTank.counterexample.json"


def test_a_counterexample_is_replayed_from_any_folder(
    soter: Soter, counterexample: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "elsewhere").mkdir()
    monkeypatch.chdir(here / "elsewhere")
    assert "REPRODUCED" in soter("replay", str(counterexample)).out


def test_counterexamples_of_proofs_are_replayed_too(
    soter: Soter, counterexample: Path, here: Path
) -> None:
    done = soter("replay", str(counterexample), "--json")
    assert done.exit == 0
    assert done.document["kind"] == "counterexample"
    assert done.document["steps"]
    assert "REPRODUCED" in soter("replay", str(counterexample)).out
    assert soter("replay", str(counterexample), "--mcap", "x.mcap", "--json").codes == ["U001"]
    text = counterexample.read_text("utf-8")
    sooner = json.loads(text)["time_ns"] - 10_000_000
    changed(counterexample, time_ns=sooner)
    assert soter("replay", str(counterexample)).exit == 3
    counterexample.write_text(text)
    program = here / "tank.soter"
    program.write_text(program.read_text() + "// changed\n")
    assert soter("replay", str(counterexample), "--json").codes == ["D011"]


def test_a_counterexample_shows_what_drove_each_instant(
    soter: Soter, counterexample: Path, here: Path
) -> None:
    """Commands, and what the adversary chose: without them nobody sees why the tank runs empty."""
    done = soter("replay", str(counterexample), "--report", "x.html", "--json")
    assert (done.exit, done.document["html"]) == (0, "x.html")
    last = done.document["steps"][-1]
    assert last["chosen"]["input.pump_chosen"] == -0.5
    shown = soter("replay", str(counterexample)).out
    for name in ("t.truth.h", "pump", "input.pump_chosen", "chosen t.leak"):
        assert name in shown
    same, head = (next(x for x in shown.splitlines() if x.startswith(w)) for w in ("alw", "time"))
    columns = zip(*(line.split() for line in shown.partition("─\n")[2].splitlines()), strict=True)
    assert all(len(set(column)) > 1 for column in columns)
    assert "chosen t.leak = " in same
    assert "t.truth.h" in head
    page = (here / "x.html").read_text("utf-8")
    assert "t.truth.h" in page
    assert "chosen t.leak" in page
    assert "leaves_safe" in page


def test_damaged_counterexamples_are_told_so(soter: Soter, counterexample: Path) -> None:
    """Anything in any place: reproduced or not, or a diagnostic; never a defect."""
    document = json.loads(counterexample.read_text("utf-8"))
    document["steps"] = []
    for place, wrong, changed_one in damaged(document, WRONG):
        counterexample.write_text(json.dumps(changed_one))
        done = soter("replay", str(counterexample), "--json")
        assert done.exit in (0, 1, 3), (place, wrong)


def test_a_trace_that_gives_a_name_twice(soter: Soter, trace: Path) -> None:
    text = trace.read_text()
    trace.write_text('{"seed": 7, ' + text.lstrip()[1:])
    done = soter("replay", str(trace), "--json")
    assert (done.exit, done.codes) == (1, ["D010"])
    assert "given twice" in done.err or "given twice" in str(done.document)
