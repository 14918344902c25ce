"""The command as a process: pipes, signals, full disks, and the robot of `soter new`."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

import processes
from json_documents import problems_of
from processes import PIPE, started

ROOT = Path(__file__).resolve().parents[2]
CART = ROOT / "examples" / "wall" / "cart.soter"
SOTER = (sys.executable, "-m", "soter.cli.main")


@pytest.fixture
def here(tmp_path: Path) -> Path:
    shutil.copy(CART, tmp_path / "cart.soter")
    return tmp_path


def soter(here: Path, *arguments: str, **options: Any) -> processes.Done:
    command = [*SOTER, *arguments]
    done = processes.run(command, cwd=here, capture_output=True, text=True, **options)
    assert "Traceback" not in done.stderr
    return done


def test_the_installed_command() -> None:
    command = Path(sys.executable).with_name("soter")
    if not command.exists():
        pytest.skip("soter is not installed as a command here")
    done = processes.run([command, "--version"], capture_output=True, text=True, check=False)
    assert done.stdout.startswith("soter ")


def test_exit_codes(here: Path) -> None:
    (here / "bad.soter").write_text("soter 1;\nconst A: int = true;\n")
    assert soter(here, "check", "cart.soter").returncode == 0
    assert soter(here, "check", "bad.soter").returncode == 1
    assert soter(here, "check").returncode == 2
    assert soter(here, "run", "cart.soter", "--system", "Unprotected").returncode == 3


# ---------------------------------------------------------------- pipes and disks


@pytest.mark.parametrize("arguments", [("explain",), ("run", "cart.soter", "--json"), ("--help",)])
def test_a_reader_that_leaves_early(here: Path, arguments: tuple[str, ...]) -> None:
    read, write = os.pipe()
    command = [*SOTER, *arguments]
    with started(command, cwd=here, stdout=write, stderr=PIPE, text=True) as process:
        os.close(write)
        os.close(read)
        _, err = process.communicate(timeout=processes.TIMEOUT_S)
    assert err == ""
    assert process.returncode == 0


@pytest.mark.parametrize("option", [(), ("--json",)])
def test_a_full_disk_behind_standard_output(here: Path, option: tuple[str, ...]) -> None:
    with Path("/dev/full").open("w") as full:
        done = processes.run(
            [*SOTER, "check", "cart.soter", *option],
            cwd=here,
            stdout=full,
            stderr=PIPE,
            text=True,
        )
    assert done.returncode == 1
    assert done.stderr == "soter: cannot write to standard output: no space left on device\n"


PRINTING_C = """
#include "robot.h"
#include <stdio.h>
int chatty(const robot_Learned_in *in, robot_Learned_out *out) {
  (void)in;
  printf("C says so\\n");
  out->u = 0.0;
  out->has_u = 1;
  return 0;
}
"""
ROBOT = """
soter 1;
topic u: float in [-1.0, 1.0];
extern node Learned period 20ms { publishes u; failsafe u = 0.0; }
system S { node Learned; until 1s; always abs(u) < 2.0; }
"""


@pytest.fixture
def robot(here: Path) -> Path:
    (here / "robot.soter").write_text(ROBOT)
    (here / "chatty.c").write_text(PRINTING_C)
    (here / "policy.py").write_text(
        "import os, sys, time\nfrom pathlib import Path\n"
        "def chatty(inputs):\n    print('Python says so')\n    os.write(1, b'raw\\n')\n"
        "    return 0.0\n"
        "def slow(inputs):\n    Path('called').touch()\n    time.sleep(0.01)\n    return 0.0\n"
        "def hangs(inputs):\n    Path('called').touch()\n"
        "    while True:\n        time.sleep(0.1)\n"
        "def leaves(inputs):\n    sys.exit(7)\n"
    )
    return here


@pytest.mark.parametrize("binding", ["c:chatty.c:chatty", "python:policy.py:chatty"])
@pytest.mark.parametrize("engine", ["native", "interp"])
def test_one_document_whatever_externs_print(robot: Path, binding: str, engine: str) -> None:
    done = soter(
        robot, "run", "robot.soter", "--bind", f"Learned={binding}", "--json", "--engine", engine
    )
    document = json.loads(done.stdout)
    assert problems_of(document) == []
    assert document["exit"] == done.returncode == 0
    assert "says so" in done.stderr


def test_an_extern_cannot_end_the_process(robot: Path) -> None:
    done = soter(robot, "run", "robot.soter", "--bind", "Learned=python:policy.py:leaves")
    assert done.returncode == 3, "a trusted node that fails is latched"
    assert "SystemExit: 7" in done.stdout


# ---------------------------------------------------------------- Ctrl-C


def test_a_proof_whose_enclosures_are_being_compiled_stops(here: Path) -> None:
    compiler = here / "slow"
    compiler.write_text(
        f'#!/bin/sh\ncase "$*" in *enclosures.c*) touch {here}/called; exec sleep 1000;; esac\n'
        'exec cc "$@"\n'
    )
    compiler.chmod(0o755)
    slowly = {**os.environ, "SOTER_CC": str(compiler), "SOTER_CACHE": str(here / "cache")}
    command = [*SOTER, "verify", "cart.soter"]
    with started(command, cwd=here, env=slowly, stdout=PIPE, stderr=PIPE, text=True) as process:
        processes.until((here / "called").exists, process)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=processes.TIMEOUT_S)
    assert "Traceback" not in err
    assert process.returncode == 130


def interrupted(
    here: Path, *arguments: str, by: signal.Signals = signal.SIGINT
) -> tuple[int, str, str]:
    """Start a run that takes for ever and press Ctrl-C, when it calls its extern or computes."""
    command = [*SOTER, "run", *arguments]
    with started(command, cwd=here, stdout=PIPE, stderr=PIPE, text=True) as process:
        if "--bind" in arguments:
            processes.until((here / "called").exists, process)
        else:
            processes.computed(process, 1.5)
        process.send_signal(by)
        out, err = process.communicate(timeout=processes.TIMEOUT_S)
    assert "Traceback" not in err
    return process.returncode, out, err


@pytest.mark.parametrize("policy", ["slow", "hangs"])
@pytest.mark.parametrize("engine", ["native", "interp"])
def test_ctrl_c_shows_what_was_reached(robot: Path, policy: str, engine: str) -> None:
    code, out, _ = interrupted(
        robot,
        "robot.soter",
        "--until",
        "9h",
        "--bind",
        f"Learned=python:policy.py:{policy}",
        "--engine",
        engine,
    )
    assert code == 130
    assert out.splitlines()[1].startswith("INTERRUPTED  stopped at ")


def test_ctrl_c_in_compiled_code_gives_the_document(here: Path) -> None:
    code, out, _ = interrupted(here, "cart.soter", "--until", "20000h", "--json")
    document = json.loads(out)
    assert problems_of(document) == []
    assert code == document["exit"] == 130
    assert document["interrupted"]
    assert 0 < document["duration_s"] < document["until_s"]


# ---------------------------------------------------------------- the robot of `soter new`


@pytest.mark.pages
def test_the_next_steps_of_a_new_robot_all_work(here: Path) -> None:
    steps = json.loads(soter(here, "new", "rover", "--json").stdout)["commands"]
    expected = {"--system Unguarded": 3}
    for step in steps:
        words = step.split()
        command = [sys.executable, *words[1:]] if words[0] == "python" else [*SOTER, *words[1:]]
        done = processes.run(command, cwd=here, capture_output=True, text=True, check=False)
        wanted = next((c for part, c in expected.items() if part in step), 0)
        assert done.returncode == wanted, f"{step}\n{done.stdout}{done.stderr}"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    done = processes.run(command, cwd=here / "rover", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


# ---------------------------------------------------------------- fast enough


def test_checking_the_cart_loads_nothing_slow(here: Path) -> None:
    """0.4 s is the contract for the drone; NumPy alone takes a third of that."""
    code = (
        "import sys; from soter.cli.main import main; sys.argv = ['soter', 'check', 'cart.soter']\n"
        "code = main()\n"
        "slow = {'numpy', 'z3', 'cffi', 'mcap', 'jinja2'} & {*sys.modules}\n"
        "sys.exit(f'{slow}' if slow else code)"
    )
    done = processes.run([sys.executable, "-c", code], cwd=here, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
