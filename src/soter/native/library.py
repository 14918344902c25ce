"""A loaded program: the kernel's functions on a state in memory.

Purpose: the thinnest Python face of `soter.h`; states and traces are numpy arrays of bytes.
Non-goals: decoding (`lower/layout.py`), answering externs (`simulate/`).
"""

from __future__ import annotations

from enum import IntEnum
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import numpy.typing as npt

    Bytes = npt.NDArray[np.uint8]

DECLARATIONS = """
typedef struct soter_program soter_program;
void soter_start(const soter_program *p, void *state, uint64_t seed);
int64_t soter_next_instant(const soter_program *p, const void *state);
int soter_instant(const soter_program *p, void *state, uint32_t *due);
void soter_answer(const soter_program *p, void *state, uint32_t component, int fault,
                  const void *answer);
int soter_run(const soter_program *p, void *state, int64_t until_ns, void *trace,
              size_t room, size_t *written, uint32_t *due);
"""


class RunStatus(IntEnum):
    """Why `soter_run` came back."""

    END = 0
    EXTERN = 1
    FULL = 2


@lru_cache(maxsize=1)
def _ffi() -> Any:  # noqa: ANN401 - cffi has no types for this
    from cffi import FFI  # noqa: PLC0415 - only native runs pay for it

    ffi = FFI()
    ffi.cdef(DECLARATIONS)
    return ffi


def opened(
    ffi: Any,  # noqa: ANN401 - cffi has no types for this
    path: Path,
    owners: Mapping[str, str] | None = None,
) -> Any:  # noqa: ANN401 - the same
    """The library; SoterError X004 where a function it needs is nowhere.

    `owners`: the C file in which each linked function was to be found.
    """
    try:
        return ffi.dlopen(str(path))
    except OSError as error:
        _, _, missing = str(error).partition("undefined symbol: ")
        if missing:
            symbol = missing.split()[0].rstrip(".")
            file = (owners or {}).get(symbol)
            message = (
                f"`{file}` has no function `{symbol}`"
                if file
                else f"no C file of this program has the function `{symbol}`"
            )
            helps: tuple[str, ...] = (
                "is its name right in `c:file.c:name`, and is it not static?",
            )
        else:
            message, helps = f"the compiled program cannot be loaded: {error}", ()
        raise SoterError((Diagnostic("X004", message, helps=helps),)) from error


class Library:
    """One compiled program; holds no state of its own."""

    def __init__(
        self, path: Path, prefix: str, state_size: int, owners: Mapping[str, str] | None = None
    ) -> None:
        self.ffi = _ffi()
        self.lib = opened(self.ffi, path, owners)
        symbols = self.ffi.cast("void *", 0)
        del symbols
        self._program = _address(self.ffi, path, f"{prefix}_program")
        self.state_size = state_size
        self._written = self.ffi.new("size_t *")
        self._due = self.ffi.new("uint32_t *")

    def new_state(self, seed: int) -> Bytes:
        """A fresh state, started."""
        state = np.zeros(self.state_size, dtype=np.uint8)
        self.lib.soter_start(self._program, self._pointer(state), seed & (2**64 - 1))
        return state

    def _pointer(self, array: Bytes) -> Any:  # noqa: ANN401 - a cdata pointer
        return self.ffi.cast("void *", array.ctypes.data)

    def run(
        self, state: Bytes, until_ns: int, trace: Bytes | None = None
    ) -> tuple[RunStatus, int, int]:
        """Run instants up to `until_ns`; `trace` has shape (room, state_size).

        Returns the status, how many states were written, and the extern component that is due.
        """
        room = 0 if trace is None else len(trace)
        target = self.ffi.NULL if trace is None else self._pointer(trace)
        status = self.lib.soter_run(
            self._program, self._pointer(state), until_ns, target, room, self._written, self._due
        )
        return RunStatus(status), int(self._written[0]), int(self._due[0])

    def next_instant(self, state: Bytes) -> int:
        """Time of the next instant in ns."""
        return int(self.lib.soter_next_instant(self._program, self._pointer(state)))

    def answer(self, state: Bytes, component: int, fault: int, answer: bytes | None) -> None:
        """Give the answer for the extern step that is due."""
        data = self.ffi.NULL if answer is None else self.ffi.from_buffer(answer)
        self.lib.soter_answer(
            self._program, self._pointer(state), component, fault, self.ffi.cast("void *", data)
        )


def _address(ffi: Any, path: Path, symbol: str) -> Any:  # noqa: ANN401 - cdata
    own = type(ffi)()
    own.cdef(f"extern const char {symbol}[];")
    lib = own.dlopen(str(path))
    return ffi.cast("const soter_program *", own.cast("uintptr_t", own.addressof(lib, symbol)))
