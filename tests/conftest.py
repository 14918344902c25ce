"""What all tests share: the `golden` fixture and its `--update-golden` switch.

Bytecode of everything that a test starts is kept below `build/`, whatever the environment says of
it, but not of files that tests make: the tree stays clean, and a later run compiles only what has
changed.
"""

from __future__ import annotations

import gc
import getpass
import os
import shutil
import signal
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from hypothesis import settings

if TYPE_CHECKING:
    import pytest

BYTECODE = Path(__file__).resolve().parents[1] / "build" / "bytecode"
sys.pycache_prefix = os.environ.get("PYTHONPYCACHEPREFIX") or str(BYTECODE)
os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Python tells sources apart by size and second of change: a test that writes its file anew may be
# quicker. A file where their bytecode's folder would be keeps it from being written.
TEMPORARY = Path(tempfile.gettempdir()).resolve()
if TEMPORARY in BYTECODE.parents:
    TEMPORARY /= f"pytest-of-{getpass.getuser()}"
NONE_OF_TEMPORARY = Path(sys.pycache_prefix, *TEMPORARY.parts[1:])
if BYTECODE in NONE_OF_TEMPORARY.parents:  # nothing is removed from a folder that somebody named
    shutil.rmtree(NONE_OF_TEMPORARY, ignore_errors=True)
if not NONE_OF_TEMPORARY.exists():
    NONE_OF_TEMPORARY.parent.mkdir(parents=True, exist_ok=True)
    NONE_OF_TEMPORARY.touch()

pytest_plugins = ("golden", "examples_changed", "long_tests", "tables", "changed_tests")

# `make test` hands its own settings to every `make` below it: a test's `make` starts afresh.
# readline, which pytest loads, leaves the size of a terminal to the workers.
for name in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL", "COLUMNS", "LINES"):
    os.environ.pop(name, None)
    os.unsetenv(name)

# A machine that pauses makes no example slow: no test has a deadline by the wall clock.
settings.register_profile("soter", deadline=None)
settings.load_profile("soter")

# What is ignored in a background job, or under `nohup`, would be by every process of a test, too;
# a signal that is handled is not.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda *_: None)


# Collecting makes no garbage worth looking for, and most tests little: the collector would go over
# every tree that a test builds again and again.
GARBAGE = (200_000, 20, 100)
gc.disable()


def pytest_collection_finish() -> None:
    """What was collected stays to the end: the garbage collector need not look at it again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(*GARBAGE)
    gc.enable()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write the golden files under tests/golden instead of comparing with them",
    )
