"""What all tests share: the `golden` fixture and its `--update-golden` switch."""

from __future__ import annotations

import os
import signal
from typing import TYPE_CHECKING

from hypothesis import settings

if TYPE_CHECKING:
    import pytest

pytest_plugins = ("golden", "examples_changed", "long_tests")

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


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-golden",
        action="store_true",
        help="write the golden files under tests/golden instead of comparing with them",
    )
