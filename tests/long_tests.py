"""What `make test` leaves to `make test-long`.

Purpose: tests marked `long`, and lines of tables beyond those of `quick_lines.py`, run with
`pytest --long`, with an `-m` that speaks of them, or where one is named (`FILE::TEST`); what is
left out is told when a run begins and when it ends. `examples` is how many programs a random test
draws: more in a long run. `some`: of a long table the first lines. Enclosures that a test compiles
in its own process are optimised as shipped in a long run, else compiled quickly.
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
_LEFT_OUT = "long tests left out"
_asked = {"long": False}
_left_out: set[int] = set()


def examples(variable: str, *, quick: int, long: int) -> int:
    """How many examples a random test tries: what the environment says, if it says anything."""
    told = os.environ.get(variable)
    return int(told) if told else (long if _asked["long"] else quick)


def some(these: Iterable[Any], quick: int) -> list[Any]:
    """What a test is tried on: the first ones always, the others in a long run."""
    return [
        x if k < quick else pytest.param(x, marks=pytest.mark.long) for k, x in enumerate(these)
    ]


@pytest.fixture(scope="session", autouse=True)
def _enclosures_are_compiled_quickly() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        if not _asked["long"]:
            patch.setattr("soter.reach.enclose.library.UNIT_LEVEL", "-O1")
        yield


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--long",
        action="store_true",
        help="the tests marked `long` as well, and more examples of the random ones",
    )


def pytest_configure(config: pytest.Config) -> None:
    _asked["long"] = bool(config.getoption("--long"))


def _wanted(config: pytest.Config) -> bool:
    named = any("::" in argument for argument in config.args)
    return bool(config.getoption("--long") or "long" in config.option.markexpr or named)


def pytest_report_header(config: pytest.Config) -> str:
    if config.getoption("--long"):
        return "long tests: all, and more examples of the random ones"
    return f"long tests: {'all' if _wanted(config) else 'left out'}, {COMMAND} runs everything"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if _wanted(config):
        return
    lines: Counter[str] = Counter()
    long: list[pytest.Item] = []
    quick: list[pytest.Item] = []
    for item in items:
        name, _, _ = item.nodeid.partition("[")
        file, _, test = name.removeprefix("tests/").partition("::test_")
        lines[name] += 1
        left_out = lines[name] > QUICK.get(file, {}).get(test, lines[name])
        (long if left_out or item.get_closest_marker("long") else quick).append(item)
    if long:
        items[:] = quick
        config.hook.pytest_deselected(items=long)
        _left_out.add(len(long))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """A worker of xdist, which is another process, tells the one that reports."""
    told: dict[str, Any] | None = getattr(session.config, "workeroutput", None)
    if told is not None:
        told[_LEFT_OUT] = max(_left_out, default=0)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    _left_out.add(getattr(node, "workeroutput", {}).get(_LEFT_OUT, 0))


@pytest.hookimpl(trylast=True)
def pytest_terminal_summary(terminalreporter: TerminalReporter) -> None:
    count = max(_left_out, default=0)
    if count:
        terminalreporter.write_line(
            f"long tests left out: {count}, and the random ones drew fewer programs;"
            f" `{COMMAND}` runs everything",
            yellow=True,
        )
