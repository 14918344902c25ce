"""`soter run`: what it prints, what it writes, and who answers the externs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from mcap.reader import make_reader

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    Soter = Callable[..., Any]
    Golden = Callable[[str, str], None]


def steady(text: str) -> str:
    """A summary without the times of this machine and without hashes."""
    return re.sub(r"[0-9a-f]{64}", "HASH", re.sub(r"native, .*?\)", "native, TIME", text))


def test_the_summary_of_a_safe_run(
    soter: Soter, golden: Golden, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "soter.api.running.stored_verdicts", lambda _: {}
    )  # of another test, in the cache
    golden("cli/run_safe.txt", steady(soter("run", "cart.soter").out))


def test_the_summary_of_a_violated_run(soter: Soter, golden: Golden) -> None:
    golden(
        "cli/run_violated.txt", steady(soter("run", "cart.soter", "--system", "Unprotected").out)
    )


def test_the_summary_of_a_run_with_a_failing_extern(
    soter: Soter, robot: Path, golden: Golden
) -> None:
    assert robot.exists()
    done = soter("run", "robot.soter", "--bind", "Learned=python:recovery.py:raises")
    assert done.exit == 0
    golden("cli/run_extern_fails.txt", steady(done.out))


def test_a_drawn_order_stands_among_what_went_wrong_as_outside(soter: Soter) -> None:
    text = Path("cart.soter").read_text(encoding="utf-8")
    until = "  until 30s;\n"
    assert until in text
    faulty = text.replace(until, until + "  faults { order any; late SafeCart.dm by 1ms; }\n", 1)
    Path("drawn.soter").write_text(faulty, encoding="utf-8")
    rows = [x.split() for x in soter("run", "drawn.soter").out.splitlines() if "order any" in x]
    assert ["order", "any", "every", "instant", "outside"] in rows


def test_colour_is_for_terminals(soter: Soter, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "\x1b" not in soter("run", "cart.soter").out
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert "\x1b[1;32mno violation in this run" in soter("run", "cart.soter").out
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in soter("run", "cart.soter").out


def test_the_document_of_a_run(soter: Soter) -> None:
    document = soter("run", "cart.soter", "--json").document
    assert document["violations"] == 0
    assert document["duration_s"] == document["until_s"] == 30.0
    assert document["final"]["c.truth"].keys() == {"x", "v"}
    assert document["modules"]["SafeCart"]["switches_to_sc"] == 3
    first = document["mode_changes"][0]
    assert (first["time_s"], first["mode"], first["predicates"]["safer"]) == (0.0, "AC", True)


def test_the_document_of_a_violated_run(soter: Soter) -> None:
    document = soter("run", "cart.soter", "--system", "Unprotected", "--json").document
    (violation,) = document["violation_list"]
    assert violation["what"] == "always Clear(c.truth)"
    assert (violation["count"], violation["time_s"]) == (2, 2.635)
    assert violation["file"] == "cart.soter"
    assert document["violations"] == 2


def test_engines_seeds_and_lengths(soter: Soter) -> None:
    arguments = ("run", "cart.soter", "--until", "1500ms", "--seed", "9", "--json")
    native = soter(*arguments).document
    interpreted = soter(*arguments, "--engine", "interp").document
    assert native["until_s"] == 1.5
    assert native["trace_sha256"] == interpreted["trace_sha256"]
    other = soter("run", "cart.soter", "--until", "1500ms", "--json").document
    assert other["trace_sha256"] != native["trace_sha256"]


# ---------------------------------------------------------------- files


def test_a_log_is_read_by_the_stock_tools(soter: Soter, here: Path) -> None:
    assert soter("run", "cart.soter", "--log", "out.mcap", "--until", "3s").exit == 0
    with (here / "out.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        topics = {c.topic for c in summary.channels.values()}
        (about,) = [m for m in reader.iter_metadata() if m.name == "soter"]
    assert topics == {"soter/modes", "soter/decisions", "motion", "goal", "accel", "c.truth"}
    assert about.metadata["system"] == "Protected"
    assert about.metadata["seed"] == "1"


def test_logs_and_reports_without_a_path_go_to_the_folder(soter: Soter, here: Path) -> None:
    done = soter("run", "cart.soter", "--log", "--report", "-o", "kept", "--until", "1s")
    assert done.exit == 0
    names = {p.name for p in (here / "kept").iterdir()}
    names.remove(next(n for n in names if n.startswith("soter-plotly-")))
    assert names == {"cart-Protected-1.mcap", "cart-Protected-1.html"}
    alone = soter("run", "cart.soter", "--report", "a/b.html", "--self-contained", "--until", "1s")
    assert alone.exit == 0
    assert [p.name for p in (here / "a").iterdir()] == ["b.html"]
    assert "kept/cart-Protected-1.html" in done.out
    document = soter("run", "cart.soter", "--log", "--until", "1s", "--json").document
    assert document["log"] == ".soter/cart-Protected-1.mcap"


@pytest.mark.parametrize("option", ["--log", "--report"])
@pytest.mark.parametrize("path", [".", "cart.soter/x", "/dev/full"])
def test_a_path_that_cannot_be_written(soter: Soter, option: str, path: str) -> None:
    done = soter("run", "cart.soter", "--until", "1s", option, path, "--json")
    assert done.exit == 1
    assert done.codes == ["D006"]
    said = done.document["diagnostics"][0]["message"]
    assert path.lstrip("/") in said, "which file it was"


def test_log_and_report_need_two_paths(soter: Soter) -> None:
    done = soter("run", "cart.soter", "--log", "same", "--report", "same")
    assert done.exit == 2


def test_a_run_paced_against_the_clock(soter: Soter) -> None:
    for engine in ("native", "interp"):
        done = soter(
            "run", "cart.soter", "--until", "300ms", "--real-time", "--json", "--engine", engine
        )
        document = done.document
        assert document["wall_s"] >= 0.29
        assert document["lag_s_max"] >= 0.0


# ---------------------------------------------------------------- parameters


def test_parameters_of_every_type(soter: Soter, robot: Path) -> None:
    assert robot.exists()
    sets = ["LIMIT=0.8", "EVERY=50ms", "COUNT=-3", "LOUD=true"]
    done = soter(
        "run",
        "robot.soter",
        "--bind",
        "Learned=python:recovery.py:good",
        "--json",
        *(word for s in sets for word in ("--set", s)),
    )
    assert done.document["params"] == {
        "LIMIT": 0.8,
        "EVERY": 0.05,
        "COUNT": -3,
        "LOUD": True,
    }


@pytest.mark.parametrize(
    ("setting", "exit_code", "code"),
    [
        ("LIMIT=fast", 2, "U001"),
        ("LIMIT=nan", 2, "U001"),
        ("LIMIT=1e999", 2, "U001"),
        ("LIMIT=" + "9" * 5000, 2, "U001"),
        ("EVERY=20", 2, "U001"),
        ("COUNT=1.5", 2, "U001"),
        ("COUNT=99999999999999999999", 2, "U001"),
        ("LOUD=yes", 2, "U001"),
        ("LIMT=1", 2, "U004"),
        ("LIMIT=11", 1, "V007"),
        ("EVERY=1s", 1, "V007"),
    ],
)
def test_parameters_that_cannot_be(
    soter: Soter, robot: Path, setting: str, exit_code: int, code: str
) -> None:
    assert robot.exists()
    done = soter("run", "robot.soter", "--set", setting, "--json")
    assert done.exit == exit_code
    assert code in done.codes
    assert soter("check", "robot.soter", "--set", setting).exit == exit_code


# ---------------------------------------------------------------- externs


def test_an_unbound_extern(soter: Soter, robot: Path) -> None:
    assert robot.exists()
    for engine in ("native", "interp"):
        done = soter("run", "robot.soter", "--engine", engine, "--json")
        assert done.exit == 1
        assert done.codes == ["X001"]


@pytest.mark.parametrize("name", ["Guard.Learned", "Learned"])
@pytest.mark.parametrize("engine", ["native", "interp"])
def test_python_and_c_do_the_same_on_both_engines(
    soter: Soter, robot: Path, name: str, engine: str
) -> None:
    assert robot.exists()
    hashes = {
        soter(
            "run", "robot.soter", "--engine", engine, "--json", "--bind", f"{name}={what}"
        ).document["trace_sha256"]
        for what in ("python:recovery.py:good", "c:policy.c:policy_step")
    }
    assert len(hashes) == 1


FAILING = [
    ("raises", "extern", "ValueError: boom (recovery.py:13)"),
    ("shape", "extern", "its answer has the wrong shape"),
    ("leaves", "extern", "SystemExit: 3 (recovery.py:29)"),
    ("interrupts", "extern", "KeyboardInterrupt"),
    ("nan", "nonfinite", "`u` would be nan"),
    ("beyond", "range", "`u` would be 1.5, not in [-1.0, 1.0]"),
]


@pytest.mark.parametrize(("policy", "kind", "said"), FAILING)
@pytest.mark.parametrize("engine", ["native", "interp"])
def test_nothing_an_extern_does_gets_out(
    soter: Soter, robot: Path, policy: str, kind: str, said: str, engine: str
) -> None:
    assert robot.exists()
    done = soter(
        "run",
        "robot.soter",
        "--bind",
        f"Learned=python:recovery.py:{policy}",
        "--json",
        "--engine",
        engine,
    )
    assert done.exit == 0
    document = done.document
    assert document["faults"]["Guard.Learned"]["last"] == kind
    assert document["modules"]["Guard"]["gate_faults"] == 101
    assert document["extern_failures"].get("Guard.Learned", "").startswith(said)


@pytest.mark.parametrize("engine", ["native", "interp"])
def test_what_an_extern_prints_is_not_in_the_document(
    soter: Soter, robot: Path, engine: str
) -> None:
    assert robot.exists()
    done = soter(
        "run",
        "robot.soter",
        "--bind",
        "Learned=python:recovery.py:prints",
        "--json",
        "--engine",
        engine,
    )
    assert done.document["exit"] == 0
    assert "chatter" in done.err


@pytest.mark.whole
def test_a_class_is_made_and_reset_for_every_run(soter: Soter, robot: Path) -> None:
    assert robot.exists()
    done = soter("run", "robot.soter", "--bind", "Learned=python:recovery.py:Counting", "--json")
    assert done.document["modules"]["Guard"]["gate_faults"] == 0


@pytest.mark.parametrize(
    ("binding", "exit_code", "code"),
    [
        ("Learned=recovery.py", 2, "U001"),
        ("Learned=ruby:a.rb:step", 2, "U001"),
        ("Learned=python:recovery.py:", 2, "U001"),
        ("Learned=python:nowhere.py:step", 1, "X003"),
        ("Learned=python:.:step", 1, "X003"),
        pytest.param("Learned=python:recovery.py:god", 1, "X002", marks=pytest.mark.whole),
        ("Learned=python:recovery.py:number", 1, "X002"),
        pytest.param("Learned=python:recovery.py:Unmade", 1, "X003", marks=pytest.mark.whole),
        pytest.param("Learned=python:recovery.py:Stubborn", 1, "X003", marks=pytest.mark.whole),
        ("Learned=python:policy.c:step", 1, "X003"),
        ("Learned=c:nowhere.c:step", 1, "X003"),
        ("Learned=c:policy.c:stepp", 1, "X004"),
        ("Learned=c:recovery.py:step", 1, "X004"),
        ("Lerned=python:recovery.py:good", 2, "U005"),
        ("Stay=python:recovery.py:good", 2, "U005"),
    ],
)
def test_bindings_that_cannot_be(
    soter: Soter, robot: Path, binding: str, exit_code: int, code: str
) -> None:
    assert robot.exists()
    done = soter("run", "robot.soter", "--bind", binding, "--json")
    assert done.exit == exit_code
    assert done.codes == [code]


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("1 / 0", marks=pytest.mark.whole),
        "def step(:",
        "import sys; sys.exit(4)",
        "import nothing_of_this_name",
        "\0",
    ],
)
def test_a_file_that_cannot_be_loaded(soter: Soter, robot: Path, here: Path, text: str) -> None:
    assert robot.exists()
    (here / "broken.py").write_text(text)
    done = soter("run", "robot.soter", "--bind", "Learned=python:broken.py:step", "--json")
    assert done.exit == 1
    assert done.codes == ["X003"]


FUNCTION = """
soter 1;
topic y: float in [0.0, 100.0];
extern fun square(x: float): float from "python:square.py:square";
node N period 10ms { publishes y; var t: float; step { t = t + 0.1; publish y = square(t); } }
system S { node N; until 50ms; always y < 50.0; }
"""


def test_an_extern_function_in_python_is_for_the_interpreter(soter: Soter, here: Path) -> None:
    (here / "f.soter").write_text(FUNCTION)
    (here / "square.py").write_text("def square(x):\n    return x * x\n")
    done = soter("run", "f.soter", "--json")
    assert (done.exit, done.codes) == (1, ["X007"])
    assert any("--engine interp" in h for h in done.document["diagnostics"][0]["helps"])
    document = soter("run", "f.soter", "--engine", "interp", "--json").document
    assert document["final"]["y"] == pytest.approx(0.36)


def test_an_extern_function_in_c_is_for_both_engines(soter: Soter, here: Path) -> None:
    (here / "f.soter").write_text(FUNCTION)
    (here / "square.c").write_text('#include "f.h"\ndouble square(double x) { return x * x; }\n')
    bind = ("--bind", "square=c:square.c:square", "--json")
    native = soter("run", "f.soter", *bind).document
    interpreted = soter("run", "f.soter", "--engine", "interp", *bind).document
    assert native["final"]["y"] == pytest.approx(0.36)
    assert native["trace_sha256"] == interpreted["trace_sha256"]


PLANT = """
soter 1;
topic u: float in [-1.0, 1.0];
topic x: float;
extern plant Sim period 10ms { reads u; state p: float = 1.0; drives x = p; }
node N period 10ms { subscribes x; publishes u; step { publish u = clamp(-x, -1.0, 1.0); } }
system S { sim: Sim; node N; until 1s; always abs(x) < 2.0; }
"""


def test_an_extern_plant(soter: Soter, here: Path) -> None:
    (here / "p.soter").write_text(PLANT)
    (here / "sim.py").write_text(
        "def step(inputs):\n    return {'p': inputs.state.p + 0.01 * inputs.u}\n"
    )
    bind = ("--bind", "sim=python:sim.py:step", "--json")
    native = soter("run", "p.soter", *bind).document
    interpreted = soter("run", "p.soter", "--engine", "interp", *bind).document
    assert native["final"]["sim.truth"]["p"] < 0.5
    assert native["trace_sha256"] == interpreted["trace_sha256"]
    assert soter("run", "p.soter", "--bind", "sim=c:policy.c:step", "--json").codes == ["X003"]
    (here / "sim.c").write_text("")
    assert soter("run", "p.soter", "--bind", "sim=c:sim.c:step", "--json").codes == ["X008"]
