"""Whether this thread computes with doubles as programs mean it, and what puts that back.

Purpose: every engine computes with the processor's floats, whose rounding is a setting that any
library of the process may change. Loading one that was built with `-ffast-math` or `-Ofast` is
enough: from then on numbers below 2e-308 are zero, and a violation may be none.
Non-goals: flags and a package (`runtime/soter_self_test.c`); other threads, which have their own.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress

from soter.diagnostics.diagnostic import Diagnostic, SoterError

ONE, HALF_STEP, ODD = 1.0, 2.0**-53, 1.0 + 2.0**-52
LEAST_NORMAL, HALF = 2.0**-1022, 0.5
ENVIRONMENT_BYTES = 512
"""More than a `fenv_t` of any C library has."""


def changed() -> str:
    """What is wrong, in words; empty where nothing is."""
    if ONE + HALF_STEP != ONE or ODD + HALF_STEP == ODD or -ONE - HALF_STEP != -ONE:
        return "sums are not rounded to the nearest double"
    if not LEAST_NORMAL * HALF > 0.0:
        return "numbers below 2e-308 are taken for zero"
    return ""


def require_plain() -> None:
    """SoterError X012 where this thread does not compute as programs mean it."""
    wrong = changed()
    if wrong:
        raise SoterError(
            (
                Diagnostic(
                    "X012",
                    f"this process does not compute as programs mean it: {wrong}",
                    notes=("what it computed since then is not what the program means",),
                    helps=("look for libraries built with `-Ofast`, and for `fesetround`",),
                ),
            )
        )


def put_back() -> None:
    """Undo what the thread changed since this module was loaded, where that was plain."""
    if _PLAIN is not None and changed():
        _PLAIN[0].fesetenv(_PLAIN[1])


def _kept() -> tuple[ctypes.CDLL, ctypes.Array[ctypes.c_char]] | None:
    """The C library and its floating-point environment; None without one worth keeping."""
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        kept = ctypes.create_string_buffer(ENVIRONMENT_BYTES)
        if not changed() and library.fegetenv(kept) == 0 and library.fesetenv(kept) == 0:
            return library, kept
    return None


_PLAIN = _kept()
