"""A plugin of pytest that notes which refusals of a proof or a certificate each test reaches.

    REFUSALS=FILE python -m pytest -p bench.house.reached_refusals ...

Purpose: what the re-checker refuses with (`RejectedError` and its like), and what `verify` reports
(`Diagnostics.error`), notes from which line it was called and its text. Processes that a test forks
append to the same file. `read` gives by test what a run noted.
Non-goals: which refusals there are, and which test each has (`tests/unit/test_refusals.py`).
"""

from __future__ import annotations

import json
import os
import sys
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.certificate.reading.folder import NotACertificateError
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.diagnostics.diagnostic import Diagnostics

if TYPE_CHECKING:
    from collections.abc import Callable

    import pytest

Noted = set[tuple[str, int, str]]
"""The file and the line of each call, and the text."""
NOTES = "REFUSALS"
_running = {"test": ""}


def _noting(plain: Callable[..., Any]) -> Callable[..., Any]:
    notes = Path(os.environ[NOTES])

    @wraps(plain)
    def noted(*args: Any, **named: Any) -> Any:  # noqa: ANN401 - as what it stands for
        caller = sys._getframe(1)  # noqa: SLF001 - who refuses
        text = " ".join(map(str, args[1:3]))
        line = [_running["test"], caller.f_code.co_filename, caller.f_lineno, text]
        with notes.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        return plain(*args, **named)

    return noted


def pytest_configure() -> None:
    for refusal in (NotACertificateError, NotRecheckedError, RejectedError):
        refusal.__init__ = _noting(refusal.__init__)  # type: ignore[method-assign]
    Diagnostics.error = _noting(Diagnostics.error)  # type: ignore[method-assign]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """All rows of a test are one."""
    _running["test"] = item.nodeid.partition("[")[0]


def read(notes: Path) -> dict[str, Noted]:
    """What each test noted, by its name."""
    by_test: dict[str, Noted] = {}
    for line in notes.read_text(encoding="utf-8").splitlines():
        test, file, number, text = json.loads(line)
        by_test.setdefault(test, set()).add((file, number, text))
    return by_test
