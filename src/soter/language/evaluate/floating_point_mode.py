"""Checks that this thread computes doubles by IEEE rules, and restores its settings.

Purpose: every engine computes with the processor's floats, whose rounding is a setting that any
library of the process may change. Loading one that was built with `-ffast-math` or `-Ofast` is
enough: from then on numbers below 2e-308 are zero, and a violation may go unnoticed.
Non-goals: flags and a package (`runtime/soter_self_test.c`); other threads, which have their own.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress

from soter.diagnostics.diagnostic import Diagnostic, SoterError

ONE, HALF_STEP, ODD = 1.0, 2.0**-53, 1.0 + 2.0**-52
LEAST_NORMAL, HALF = 2.0**-1022, 0.5
ENVIRONMENT_BYTES = 512
"""A buffer of this size holds the `fenv_t` of any C library."""


def changed() -> str:
    """What is wrong with this thread's floats, in words; "" if nothing is."""
    if ONE + HALF_STEP != ONE or ODD + HALF_STEP == ODD or -ONE - HALF_STEP != -ONE:
        return "sums are not rounded to the nearest double"
    if not LEAST_NORMAL * HALF > 0.0:
        return "numbers below 2e-308 are taken for zero"
    return ""


def require_plain() -> None:
    """Raises SoterError X012 if this thread's floats do not follow the default IEEE rules."""
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
    """Restores the floating-point settings of the module's load if they are changed now."""
    if _PLAIN is not None and changed():
        _PLAIN[0].fesetenv(_PLAIN[1])


def _kept() -> tuple[ctypes.CDLL, ctypes.Array[ctypes.c_char]] | None:
    """The C library and its present environment; None if that is not plain or cannot be read."""
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        kept = ctypes.create_string_buffer(ENVIRONMENT_BYTES)
        if not changed() and library.fegetenv(kept) == 0 and library.fesetenv(kept) == 0:
            return library, kept
    return None


_PLAIN = _kept()
