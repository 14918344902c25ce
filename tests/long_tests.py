"""What `make test` leaves to `make test-all` and `make test-real-time`.

Purpose: tests marked `long`, tests and lines of tables that `durations.py` has no room for, and
tests marked `pages`, which do what a page of the documents does, run with `pytest --all`, with an
`-m` that speaks of them, or where one is named (`FILE::TEST`); `pytest --rest` runs them alone.
Tests marked `real_time`, which a machine that is busy elsewhere may fail, run only with `-m
real_time` or where one is named. What is left out is told when a run begins and when it ends.
`examples` is how many programs a random test draws: $SOTER_TEST_SCALE times as many. `seeds` and
`seed_of` are which: others for every $SOTER_TEST_SEED. `some`: of a long table the first lines.
`--write-durations` measures what is run. Enclosures that a test compiles in its own process are
compiled quickly, not as shipped.
Non-goals: which tests are long; the marker stands beside them.
"""

from __future__ import annotations

import os
from collections import Counter
from typing import TYPE_CHECKING, Any

import pytest

import durations

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from _pytest.terminal import TerminalReporter

COMMAND = "make test-all"
SCALE, SEED = "SOTER_TEST_SCALE", "SOTER_TEST_SEED"
REAL_TIME = "make test-real-time"
MARKERS = ("long", "pages", "real_time")
"""What may leave a test out; of several the last one counts."""
_LEFT_OUT, _COUNTS, _MEASURED = "tests left out", "lines of tests", "seconds of tests"
_left_out: Counter[str] = Counter()
_counts: dict[str, dict[str, int]] = {}
_lines: dict[str, tuple[str, str, int]] = {}
_marked: set[str] = set()
_measured: dict[str, dict[str, dict[int, float]]] = {}


def examples(count: int) -> int:
    """How many examples a random test tries: `count` at a scale of 1, and at least one."""
    return max(1, round(count * float(os.environ.get(SCALE, "1"))))


def seed_of(number: int) -> int:
    """The seed of a random example."""
    return number + int(os.environ.get(SEED, "0"))


def seeds(*bounds: int) -> range:
    """The seeds of the examples in `range(*bounds)`."""
    numbers = range(*bounds)
    return range(seed_of(numbers.start), seed_of(numbers.stop), numbers.step)


def some(these: Iterable[Any], quick: int) -> list[Any]:
    """What a test is tried on: the first ones always, the others in a long run.

    A tuple is one value for each name.
    """
    rows = [x if isinstance(x, tuple) else (x,) for x in these]
    beyond = [pytest.param(*row, marks=pytest.mark.long) for row in rows[quick:]]
    return [*(pytest.param(*row) for row in rows[:quick]), *beyond]


@pytest.fixture(scope="session", autouse=True)
def _enclosures_are_compiled_quickly() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("soter.verify.enclose.compiled_enclosures.UNIT_LEVEL", "-O1")
        yield


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--all",
        action="store_true",
        help="long tests and those of pages as well, every test but those of real time",
    )
    parser.addoption(
        "--rest",
        action="store_true",
        help="what a run without options leaves out, alone: with it, it is --all",
    )
    parser.addoption(
        "--write-durations",
        action="store_true",
        help=f"enter what the tests take into {durations.FILE.name}",
    )


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("--write-durations"):
        if any("::" in argument for argument in config.args):
            raise pytest.UsageError("--write-durations measures whole files")
        config.pluginmanager.register(durations.Measuring(), "measuring")


def _wanted(config: pytest.Config, marker: str) -> bool:
    named = any("::" in argument for argument in config.args)
    all_of_them = config.getoption("--all") or config.getoption("--rest")
    asked = marker != "real_time" and all_of_them
    return bool(asked or marker in config.option.markexpr or named)


def pytest_report_header(config: pytest.Config) -> list[str]:
    def told(marker: str, command: str) -> str:
        return "all" if _wanted(config, marker) else f"left out, {command} runs them"

    drawn = " ".join(f"{name}={os.environ[name]}" for name in (SCALE, SEED) if name in os.environ)
    return [
        f"long tests: {told('long', COMMAND)}",
        f"pages: {told('pages', COMMAND)}",
        f"real-time tests: {told('real_time', REAL_TIME)}",
        f"random tests: {drawn or 'the same examples every time, make soak draws fresh ones'}",
    ]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    _count(items)
    known = durations.read()
    left_out: list[pytest.Item] = []
    wanted: list[pytest.Item] = []
    for item in items:
        file, test, line = _lines[item.nodeid]
        marks = {mark.name for mark in item.iter_markers()}
        has = marks.intersection(MARKERS)
        room = durations.quick_lines(known.get(file, {}), test, _counts[file][test])
        if "whole" not in marks and line >= room:
            has.add("long")
        why = [m for m in MARKERS if m in has and not _wanted(config, m)]
        _left_out.update(why[-1:])
        ran_before = config.getoption("--rest") and not has
        (left_out if why or ran_before else wanted).append(item)
    if left_out:
        items[:] = wanted
        config.hook.pytest_deselected(items=left_out)


def _count(items: list[pytest.Item]) -> None:
    """Which line of which test each item is."""
    for item in items:
        name, _, _ = item.nodeid.partition("[")
        file, _, test = name.removeprefix("tests/").partition("::test_")
        tests = _counts.setdefault(file, {})
        _lines[item.nodeid] = (file, test, tests.get(test, 0))
        tests[test] = tests.get(test, 0) + 1
        if any(mark.name in MARKERS for mark in item.iter_markers()):
            _marked.add(item.nodeid)


def _take_stock(config: pytest.Config) -> None:
    """What was measured in this process, by file, test and line, of tests that a marker leaves."""
    measuring = config.pluginmanager.get_plugin("measuring")
    if measuring is None or not _lines:  # workers of xdist have collected, and tell
        return
    left = {_lines[node][:2] for node in _lines.keys() - _marked}
    for file, tests in _counts.items():
        _counts[file] = {test: count for test, count in tests.items() if (file, test) in left}
    for node in measuring.tests.keys() - _marked:
        file, test, line = _lines[node]
        _measured.setdefault(file, {}).setdefault(test, {})[line] = measuring.tests[node]
    for path, seconds in measuring.shared.items():
        file = path.removeprefix("tests/")
        if file in _measured:
            _counts[file][durations.SHARED] = 1
            _measured[file][durations.SHARED] = {0: seconds}


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A worker of xdist, which is another process, tells the one that reports."""
    _take_stock(session.config)
    told: dict[str, Any] | None = getattr(session.config, "workeroutput", None)
    if told is not None:
        told.update({_LEFT_OUT: dict(_left_out), _COUNTS: _counts, _MEASURED: _measured})
    elif session.config.getoption("--write-durations"):
        known = durations.entered(durations.read(), _measured, _counts)
        durations.FILE.write_text(durations.text(known), encoding="utf-8")


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """The files of a worker are its own: `--dist loadfile`."""
    output = getattr(node, "workeroutput", {})
    told = output.get(_LEFT_OUT, {})
    _left_out.update({m: max(count - _left_out[m], 0) for m, count in told.items()})
    for file, counts in output.get(_COUNTS, {}).items():
        _counts.setdefault(file, {}).update(counts)
    for file, tests in output.get(_MEASURED, {}).items():
        for test, lines in tests.items():
            _measured.setdefault(file, {}).setdefault(test, {}).update(lines)


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    for marker, which in (("long", "long tests"), ("pages", "tests of pages")):
        if _left_out[marker]:
            terminalreporter.write_line(
                f"{which} left out: {_left_out[marker]}; `{COMMAND}` runs them", yellow=True
            )
    if _left_out["real_time"]:
        terminalreporter.write_line(
            f"real-time tests left out: {_left_out['real_time']}; `{REAL_TIME}` runs them",
            yellow=True,
        )
