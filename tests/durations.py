"""What tests cost, as it was measured, and how many lines of a table a quick run takes.

Purpose: `durations.json` has the CPU seconds of each line of a test, in the order of its table: its
own, and those of processes that were waited for. Tests of less than `TOLD_S` are not told; null is
where nothing was measured, neither of this line nor of those after it. A quick run takes the first
line of a test if it costs at most `FIRST_S`, and as many more, in order, as fit into `BUDGET_S` or
cost nothing (0.0); all of them where the test is marked `whole`, or the file does not know it. What
tests of a file share (fixtures of its module) stands beside them, under `SHARED`: none of them is
quick where that is more than `SHARED_S`. Fixtures of the session are nobody's: whichever file comes
first makes them. Tests that a marker leaves out (`long`, `pages`, `real_time`) are not told.
`pytest --write-durations` enters what it runs; `make durations` runs all of it.
Non-goals: time by the clock, which others have a part in; which tests are long by their nature:
the marker `long` stands beside them.
"""

from __future__ import annotations

import json
import resource
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping

Lines = list[float | None]
Known = dict[str, dict[str, Lines]]
"""File below tests/ -> the name of a test, without `test_` -> seconds of its lines."""

FILE = Path(__file__).with_suffix(".json")
BUDGET_S = 0.5
"""What one test, with all its lines, may take of a quick run; its first line alone:"""
FIRST_S = 0.75
SHARED_S = 4.0
"""What tests of a file may share in a quick run."""
TOTAL_S = 300.0
"""What all tests that are told may take of a quick run, and what they share."""
TOLD_S = BUDGET_S
"""What is less leaves nothing out."""
SHARED = ""
SKIPPED = 0.0
"""What is entered of a test that was skipped, unless another machine has measured it."""


def read() -> Known:
    """What was measured."""
    known: Known = json.loads(FILE.read_text(encoding="utf-8"))
    return known


def quick_lines(tests: Mapping[str, Lines], name: str, count: int) -> int:
    """How many of the `count` lines of a test a quick run takes; `tests`: what its file has."""
    if (tests.get(SHARED, [0.0])[0] or 0.0) > SHARED_S:
        return 0
    seconds = 0.0
    for taken, line in enumerate(tests.get(name, [])[:count]):
        seconds += line or 0.0
        if (taken and line is None) or (line and seconds > (BUDGET_S if taken else FIRST_S)):
            return taken
    return count


def entered(
    known: Known,
    measured: Mapping[str, Mapping[str, Mapping[int, float]]],
    counts: Mapping[str, Mapping[str, int]],
) -> Known:
    """`known` with what was measured.

    `measured`: file -> test -> line -> seconds; `counts`: how many lines each test has of the files
    that were collected. Tests of such a file that are gone, or cheap, are told no more.
    """
    result = {file: tests for file, tests in known.items() if file not in counts}
    for file, tests in counts.items():
        told: dict[str, Lines] = {}
        for name, count in tests.items():
            before = known.get(file, {}).get(name, [])
            found = measured.get(file, {}).get(name, {})
            lines: Lines = []
            for k in range(count):
                was = before[k] if k < len(before) else None
                skipped = was is not None and found.get(k) == SKIPPED
                lines.append(was if skipped or k not in found else round(found[k], 1))
                if lines[-1] is None:
                    break
            cut = len(before) > 1 and None in lines
            if cut or sum(x or 0.0 for x in lines) >= TOLD_S:
                told[name] = lines
        if told:
            result[file] = told
    return result


def text(known: Known) -> str:
    """The file: a line for each test."""
    files = []
    for file, tests in sorted(known.items()):
        rows = [f"  {json.dumps(name)}: {json.dumps(tests[name])}" for name in sorted(tests)]
        files.append(f"{json.dumps(file)}: {{\n" + ",\n".join(rows) + "\n}")
    return "{\n" + ",\n".join(files) + "\n}\n"


# ---------------------------------------------------------------- measuring


def cpu_s() -> float:
    """What this process has had of the processors, and those that it waited for."""
    own = resource.getrusage(resource.RUSAGE_SELF)
    others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime


class Measuring:
    """A plugin: what each test takes, by its node, and each file's shared fixtures."""

    def __init__(self) -> None:
        self.tests: dict[str, float] = {}
        self.shared: dict[str, float] = defaultdict(float)
        self._within = self._skipped = False
        self._file, self._shared_s = "", 0.0

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._skipped = self._skipped or report.skipped

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        begin, self._shared_s, self._skipped = cpu_s(), 0.0, False
        self._file = item.nodeid.partition("::")[0]
        self.shared[self._file] += 0.0
        result = yield
        took_s = cpu_s() - begin - self._shared_s
        self.tests[item.nodeid] = SKIPPED if self._skipped else took_s
        return result

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_fixture_setup(
        self, fixturedef: pytest.FixtureDef[Any]
    ) -> Generator[None, object, object]:
        if fixturedef.scope == "function" or self._within:
            return (yield)
        begin, self._within = cpu_s(), True
        try:
            return (yield)
        finally:
            self._within, took_s = False, cpu_s() - begin
            self._shared_s += took_s
            if fixturedef.scope != "session":
                self.shared[self._file] += took_s
