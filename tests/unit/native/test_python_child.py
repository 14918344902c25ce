"""Python that Soter starts imports nothing from the current folder, which may be a stranger's."""

from __future__ import annotations

import os
import re
import sys
from typing import TYPE_CHECKING

import pytest

import processes
from soter.campaign import release_lateness
from soter.diagnostics.diagnostic import SoterError
from soter.native.compiler import module_command, python_command
from unit.test_house_figures import ROOT, SOURCES

if TYPE_CHECKING:
    from pathlib import Path

NAMES = ("soter", "ctypes", "os", "re", "typing", "runpy", "numpy", "pickle", "json", "ziglang")
CANARY = "open('ran', 'a').write(__file__)\n"
"""A module that says that it was executed."""


@pytest.fixture
def strange(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder: somebody's, with modules that are called as Python's own."""
    monkeypatch.chdir(tmp_path)
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(CANARY)
        (tmp_path / name).mkdir()
        for part in ("__init__", "__main__", "simulate"):
            (tmp_path / name / f"{part}.py").write_text(CANARY)
    return tmp_path


IMPORTS = "import runpy, ctypes, json, numpy, typing, os, re, pickle, soter.simulate; "


@pytest.mark.parametrize("safe", ["", "1"])
def test_a_child_imports_nothing_from_the_current_folder(strange: Path, safe: str) -> None:
    code = f"{IMPORTS}print(sys.argv[1:], soter.__file__)"
    environment = {**os.environ, "PYTHONSAFEPATH": safe}
    done = processes.run(python_command(code, "a", "-m"), capture_output=True, env=environment)
    assert done.returncode == 0, done.stderr
    said = done.stdout.decode()
    assert said.startswith("['a', '-m']")
    assert str(ROOT / "src") in said
    assert not (strange / "ran").exists()


def test_a_module_is_run_as_python_runs_it(strange: Path) -> None:
    done = processes.run(module_command("soter", "--version"), capture_output=True)
    assert (done.returncode, done.stdout[:6]) == (0, b"soter ")
    assert not (strange / "ran").exists()
    done = processes.run([sys.executable, "-c", IMPORTS], capture_output=True)
    assert (strange / "ran").exists()  # so that the canaries are alive


def test_python_m_soter_itself_leaves_the_current_folder_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What Python imports before it comes to Soter is Python's; what commands import is ours."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "numpy.py").write_text(CANARY)
    (tmp_path / "json.py").write_text(CANARY)
    words = [sys.executable, "-m", "soter", "check", "none.soter", "--json"]
    done = processes.run(words, capture_output=True)
    assert done.returncode == 1, done.stderr
    assert not (tmp_path / "ran").exists()


PYTHON = re.compile(r"sys\.(_base_)?executable")
PROCESSES = re.compile(r"\b(Popen|subprocess\.run|posix_spawn|os\.(exec|spawn|system|popen))\w*\(")


def told(pattern: re.Pattern[str]) -> set[str]:
    """The files of Soter in whose code, not in whose words, something is found."""
    found = set()
    for path in SOURCES:
        text = re.sub(r'""".*?"""', "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        if pattern.search(text):
            found.add(str(path.relative_to(ROOT / "src" / "soter")))
    return found


def test_nothing_else_in_soter_starts_python() -> None:
    assert told(PYTHON) == {
        "native/compiler.py",
        "version.py",  # which prints it, in the line that installs
    }


def test_every_way_to_start_a_process_is_known() -> None:
    assert told(PROCESSES) == {
        "campaign/release_lateness.py",  # Python
        "simulate/real_time.py",  # the program that was compiled
        "native/compiler.py",  # Python, for the version of ziglang; compilers, make, nm
        "playground/write.py",  # npm
    }


# ---------------------------------------------------------------- lateness under load


def test_lateness_is_measured_beside_processes_that_run(strange: Path) -> None:
    assert release_lateness.measure_lateness(seconds=0.05).releases == 5
    assert not (strange / "ran").exists()


@pytest.mark.parametrize(
    "code",
    ["raise SystemExit(1)", "import os; os.write(1, b'!')", "import os; os.abort()"],
)
def test_lateness_without_load_is_refused(code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(release_lateness, "BUSY", code)
    with pytest.raises(SoterError) as caught:
        release_lateness.measure_lateness(seconds=0.6)
    assert "have ended" in caught.value.diagnostics[0].notes[0]


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", "[" * 100_000, '{"quantiles_ns": [1]}', '{"quantiles_ns": {"a": 1}, "x": 1}',
     '{"quantiles_ns": ["a", "b"], "releases": 1, "period_ns": 1, "busy_processes": 1, "cores": 1}',
     '{"quantiles_ns": [1, 1e9], "releases": 1, "period_ns": 1, "busy_processes": 1, "cores": 1}'],
)  # fmt: skip
def test_a_lateness_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "c-lateness.json").write_text(text)
    with pytest.raises(SoterError, match="it is no lateness"):
        release_lateness.stored_lateness(tmp_path / "c-lateness.json", 0.1)
