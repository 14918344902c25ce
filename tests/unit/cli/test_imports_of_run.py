"""`soter run` of what was run before imports no parser of C, and no room that it leaves be."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

import processes

ROOT = Path(__file__).resolve().parents[3]
CART = "examples/wall/cart.soter"
RUN = """
import contextlib, io, json, sys
from soter.cli.main import main
with contextlib.redirect_stdout(io.StringIO()):
    code = main(["run", *sys.argv[1:]])
print(json.dumps([code, sorted(sys.modules)]))
"""
OTHERS = ("campaign", "certificate", "explore", "gym", "monitor", "remote", "targets")


def modules_of_run(cache: Path, *options: str) -> tuple[int, set[str]]:
    """The exit code of a run, and what its process has imported at the end."""
    done = processes.run(
        [sys.executable, "-c", RUN, CART, *options],
        cwd=ROOT,
        env={**os.environ, "SOTER_CACHE": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    code, modules = json.loads(done.stdout)
    return code, set(modules)


def test_a_run_of_what_is_compiled_parses_no_c(tmp_path: Path) -> None:
    first = modules_of_run(tmp_path)
    again = modules_of_run(tmp_path)
    assert first[0] == again[0] == 0
    assert "pycparser" in first[1], "this is what is not to happen again"
    assert not {"cffi", "pycparser"} & again[1]


def test_a_run_imports_nothing_of_rooms_that_it_does_not_use(tmp_path: Path) -> None:
    _, modules = modules_of_run(tmp_path)
    assert not {m for m in modules for room in OTHERS if m.startswith(f"soter.{room}")}
    assert "soter.simulate.real_time" not in modules


SPINS = """
import os, sys
from soter.cli.main import main
main(["cache", "--json"])
assert "numpy" not in sys.modules
print(os.environ["OPENBLAS_THREAD_TIMEOUT"], file=sys.stderr)
"""


@pytest.mark.parametrize(("given", "used"), [({}, "20"), ({"OPENBLAS_THREAD_TIMEOUT": "7"}, "7")])
def test_threads_of_numpys_blas_are_told_to_sleep_soon_unless_somebody_says_otherwise(
    given: dict[str, str], used: str
) -> None:
    others = {k: v for k, v in os.environ.items() if not k.startswith("OPENBLAS")}
    done = processes.run(
        [sys.executable, "-c", SPINS],
        cwd=ROOT,
        env={**others, **given},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr.split() == [used]
