"""What `make test` leaves to `make test-long`, and to `make test-real-time`.

Purpose: tests marked `long`, and lines of tables beyond those of `quick_lines.py`, run with
`pytest --long`, with an `-m` that speaks of them, or where one is named (`FILE::TEST`); what is
left out is told when a run begins and when it ends. Tests marked `real_time`, which a machine that
is busy elsewhere may fail, run only with `-m real_time` or where one is named. `examples` is how
many programs a random test draws: more in a long run. `some`: of a long table the first lines.
Enclosures that a test compiles in its own process are optimised as shipped in a long run, else
compiled quickly.
Non-goals: which tests are long; the marker stands beside them.
"""

from __future__ import annotations

import os
from collections import Counter
from typing import TYPE_CHECKING, Any

import pytest

from quick_lines import QUICK

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from _pytest.terminal import TerminalReporter

COMMAND = "make test-long"
REAL_TIME = "make test-real-time"
_LEFT_OUT = "tests left out"
_asked = {"long": False}
_left_out: Counter[str] = Counter()


def examples(variable: str, *, quick: int, long: int) -> int:
    """How many examples a random test tries: what the environment says, if it says anything."""
    told = os.environ.get(variable)
    return int(told) if told else (long if _asked["long"] else quick)


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
        if not _asked["long"]:
            patch.setattr("soter.reach.enclose.engine_library.UNIT_LEVEL", "-O1")
        yield


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--long",
        action="store_true",
        help="the tests marked `long` as well, and more examples of the random ones",
    )


def pytest_configure(config: pytest.Config) -> None:
    _asked["long"] = bool(config.getoption("--long"))


def _wanted(config: pytest.Config, marker: str) -> bool:
    named = any("::" in argument for argument in config.args)
    long = marker == "long" and config.getoption("--long")
    return bool(long or marker in config.option.markexpr or named)


def pytest_report_header(config: pytest.Config) -> list[str]:
    long = f"{'all' if _wanted(config, 'long') else 'left out'}, {COMMAND} runs everything"
    if config.getoption("--long"):
        long = "all, and more examples of the random ones"
    real_time = "all" if _wanted(config, "real_time") else f"left out, {REAL_TIME} runs them"
    return [f"long tests: {long}", f"real-time tests: {real_time}"]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    lines: Counter[str] = Counter()
    left_out: list[pytest.Item] = []
    quick: list[pytest.Item] = []
    for item in items:
        name, _, _ = item.nodeid.partition("[")
        file, _, test = name.removeprefix("tests/").partition("::test_")
        lines[name] += 1
        beyond = lines[name] > QUICK.get(file, {}).get(test, lines[name])
        markers = {"long": beyond, "real_time": False}
        markers = {m: own or item.get_closest_marker(m) is not None for m, own in markers.items()}
        why = [m for m, is_so in markers.items() if is_so and not _wanted(config, m)]
        _left_out.update(why[-1:])
        (left_out if why else quick).append(item)
    if left_out:
        items[:] = quick
        config.hook.pytest_deselected(items=left_out)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A worker of xdist, which is another process, tells the one that reports."""
    told: dict[str, Any] | None = getattr(session.config, "workeroutput", None)
    if told is not None:
        told[_LEFT_OUT] = dict(_left_out)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    told = getattr(node, "workeroutput", {}).get(_LEFT_OUT, {})
    _left_out.update({m: max(count - _left_out[m], 0) for m, count in told.items()})


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    if _left_out["long"]:
        terminalreporter.write_line(
            f"long tests left out: {_left_out['long']}, and the random ones drew fewer programs;"
            f" `{COMMAND}` runs everything",
            yellow=True,
        )
    if _left_out["real_time"]:
        terminalreporter.write_line(
            f"real-time tests left out: {_left_out['real_time']}; `{REAL_TIME}` runs them",
            yellow=True,
        )
