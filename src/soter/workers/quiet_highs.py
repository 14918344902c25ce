"""HiGHS, the solver of linear programs, without what it prints.

Purpose: `new_highs` makes a solver for one thread that writes nothing to standard output.
Non-goals: what is asked of it.
"""

from __future__ import annotations

import os
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

STDOUT = 1


def new_highs() -> Any:  # noqa: ANN401 - an untyped module
    """A solver without a problem; ImportError where `highspy` is not installed."""
    import highspy  # noqa: PLC0415 - an extra

    with _no_standard_output():
        solver = highspy.Highs()  # type: ignore[no-untyped-call, unused-ignore]
    solver.setOptionValue("output_flag", False)
    solver.setOptionValue("threads", 1)
    return solver


@contextmanager
def _no_standard_output() -> Iterator[None]:
    """Let the constructor print its version where nobody reads: it is made before its options.

    HiGHS 1.16 writes to the descriptor, so Python's `sys.stdout` cannot hold it back.
    """
    sys.stdout.flush()
    try:
        kept = os.dup(STDOUT)
    except OSError:  # the process has no standard output
        yield
        return
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, STDOUT)
        os.close(nowhere)
        yield
    finally:
        os.dup2(kept, STDOUT)
        os.close(kept)
