"""What the playground's page asks: the same answers as the command line gives, without NumPy."""

from __future__ import annotations

import io
import json
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

import processes
import soter
from soter.playground.session import PlaygroundSession, check, explain, layout, start
from soter.playground.write import ROOMS, own_examples, soter_archive

ROOT = Path(__file__).resolve().parents[3]
CART = (ROOT / "examples" / "wall" / "cart.soter").read_text(encoding="utf-8")


def finished(session: PlaygroundSession) -> list[dict[str, Any]]:
    """Every answer until the run is done."""
    answers: list[dict[str, Any]] = []
    while not answers or not answers[-1]["done"]:
        answers.append(json.loads(session.advance(0.01)))
    return answers


@pytest.mark.whole
def test_a_run_is_that_of_the_command_line() -> None:
    session = start("cart.soter", CART, "Protected", 3)
    assert isinstance(session, PlaygroundSession)
    parts = finished(session)
    assert len(parts) > 1
    run = soter.load(ROOT / "examples" / "wall" / "cart.soter").simulate(seed=3)
    events = [e for p in parts for e in p["events"]]
    expected = [(c.time_ns / 1e9, c.to) for c in run.changes]
    assert [(e["time_s"], e["what"][-2:]) for e in events] == expected
    about = json.loads(session.about())
    names = [s["name"] for s in about["signals"]]
    time_s, modes, values = parts[-1]["rows"][-1]
    assert time_s == 30.0
    last = dict(zip(names, values, strict=True))
    assert run.trace is not None
    assert last["c.x"] == run.trace["c"]["x"][-1]
    assert last["accel"] == run.trace["topics"]["accel"][-1]
    assert modes == [int(run.trace["modules"]["mode"][-1, 0])]
    assert next(s for s in about["signals"] if s["name"] == "c.x") == {
        "name": "c.x", "unit": "m", "limits": [-10.0, 10.0],
    }  # fmt: skip


@pytest.mark.whole
def test_a_violation_is_told_once() -> None:
    session = start("cart.soter", CART, "Unprotected")
    assert isinstance(session, PlaygroundSession)
    parts = finished(session)
    bad = [e for p in parts for e in p["events"] if e["bad"]]
    assert [e["why"] for e in bad] == ["violated"]
    assert "Clear(c.truth)" in bad[0]["what"]
    assert parts[-1]["violations"] > 0


def test_a_check_says_what_is_wrong_and_where() -> None:
    answer = json.loads(check("cart.soter", CART.replace("sc Careful;", "sc Carefull;")))
    assert not answer["ok"]
    assert answer["diagnostics"][0]["code"] == "N001"
    assert "Carefull" in answer["text"]
    sound = json.loads(check("cart.soter", CART))
    assert sound["systems"] == ["Protected", "Unprotected"]
    assert sound["default"] == "Protected"
    assert sound["svg"].startswith("<svg")


def test_what_cannot_run_says_why() -> None:
    wrong = start("cart.soter", CART.replace("0.0;", "true;", 1))
    assert isinstance(wrong, str)
    assert "error[" in wrong
    extern = CART.replace("node Fast period 10ms {", "extern node Fast period 10ms {")
    i, j = extern.index("  step {"), extern.index("// Safe:")
    told = start("cart.soter", extern[:i] + "}\n" + extern[j:])
    assert isinstance(told, str)
    assert "X001" in told
    assert "SafeCart.Fast" in told


def test_a_module_whose_predicates_are_computed_is_not_passed_over() -> None:
    lines = [x for x in CART.split("\n") if not x.strip().startswith(("ttf ", "safer "))]
    session = start("cart.soter", "\n".join(lines))
    assert isinstance(session, PlaygroundSession)
    (note,) = json.loads(session.about())["notes"]
    assert "SafeCart" in note
    assert not any(e for p in finished(session) for e in p["events"])


def test_texts_are_laid_out_and_codes_explained() -> None:
    done = json.loads(layout("a.soter", "soter 1;\nnode  A period 1ms{step{}}"))
    assert done == {"ok": True, "program": "soter 1;\nnode A period 1ms { step { } }\n", "text": ""}
    broken = json.loads(layout("a.soter", "soter 1;\nnode {"))
    assert (broken["ok"], broken["program"]) == (False, "soter 1;\nnode {")
    assert "error[S" in broken["text"]
    assert json.loads(explain("p1a"))["page"].startswith("# P1a")
    assert "no code" in json.loads(explain("Q99"))["page"]


def test_the_rooms_in_the_page_are_enough_and_need_no_numpy(tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    zipfile.ZipFile(io.BytesIO(soter_archive(own_examples()))).extractall(whole)
    code = (
        "import sys\n"
        f"sys.path[:] = [{str(whole)!r}, *(p for p in sys.path if 'site-packages' not in p)]\n"
        "import json, soter\nimport soter.playground.session as s\n"
        "text = open(sys.argv[1]).read()\n"
        "assert json.loads(s.check('cart.soter', text))['ok']\n"
        "run = s.start('cart.soter', text)\n"
        "run.advance(0.05); s.explain('P1a'); s.layout('a', text)\n"
        "print(soter.__file__, *sorted({'numpy', 'cffi'} & set(sys.modules)))\n"
    )
    done = processes.run(
        [sys.executable, "-S", "-c", code, str(ROOT / "examples/wall/cart.soter")],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [f"{whole}/soter/__init__.py"]
    assert "recheck" not in ROOMS


def test_the_cart_of_the_page_is_the_example() -> None:
    assert own_examples() == {"cart.soter": CART}


def test_pyodide_that_is_not_there_is_named(tmp_path: Path) -> None:
    line = [sys.executable, "-m", "soter.playground", "-o", str(tmp_path), "--pyodide"]
    for given in (tmp_path, tmp_path / "none.tgz"):
        done = processes.run([*line, str(given)], stderr=processes.PIPE, text=True)
        assert done.returncode == 1
        assert "error[D006]" in done.stderr
    assert list(tmp_path.iterdir()) == []
