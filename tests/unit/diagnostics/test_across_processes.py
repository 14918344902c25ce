"""A diagnostic that is raised in another process arrives as it left."""

from __future__ import annotations

import multiprocessing
import pickle
import sys
import traceback

import pytest

import processes
from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError, Source, Span

SOURCE = Source("a.soter", "soter 1;\nconst A: float = 1;\n")
ERROR = SoterError(
    (
        Diagnostic("D006", "cannot write", helps=("name another folder",)),
        Diagnostic("D008", "in the way", Label(Span(SOURCE, 9, 14), "here")),
    )
)


def fail(_: int) -> None:
    raise ERROR


def same(error: SoterError) -> bool:
    """Sources are compared by what they hold."""
    first, second = error.diagnostics
    assert second.primary is not None
    span = second.primary.span
    return (
        (str(error), first) == (str(ERROR), ERROR.diagnostics[0])
        and (second.code, second.primary.text, span.start) == ("D008", "here", 9)
        and (span.source.name, span.source.text) == ("a.soter", SOURCE.text)
    )


def test_it_is_the_same_after_pickling() -> None:
    assert same(pickle.loads(pickle.dumps(ERROR)))  # noqa: S301 - our own


def test_it_comes_out_of_a_pool() -> None:
    with multiprocessing.get_context("fork").Pool(1) as pool, pytest.raises(SoterError) as excinfo:
        pool.map_async(fail, [0]).get(timeout=processes.TIMEOUT_S)  # it used to wait for ever
    assert same(excinfo.value)


@pytest.mark.skipif(sys.version_info < (3, 11), reason="tracebacks have notes since Python 3.11")
def test_its_traceback_shows_what_helps() -> None:
    for error in (ERROR, pickle.loads(pickle.dumps(ERROR))):  # noqa: S301 - our own
        lines = traceback.format_exception_only(error)
        assert "".join(lines[1:]) == "help: name another folder\n"
