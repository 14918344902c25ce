"""Runs a compiled program on a state, by the functions of `runtime/soter.h`.

Purpose: a `Library` has a Python method for each function of that header. States and traces are
numpy arrays of bytes.
Non-goals: compiling (`shared_library.py`), decoding (`core/layout.py`), answering externs
(`simulate/`).
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any

from soter.native.c_interface import address, declarations, interface, open_library
from soter.native.cache import SOTER

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from soter.core.layout import Bytes


class RunStatus(IntEnum):
    """The reason why `soter_run` returned."""

    END = 0
    EXTERN = 1
    FULL = 2


def kernel_interface() -> Any:  # noqa: ANN401 - cffi has no types
    """The cffi object with the declarations of `runtime/soter.h`."""
    return interface(declarations(SOTER / "runtime" / "soter.h"))


class Library:
    """One compiled program that is loaded; its states belong to the caller."""

    def __init__(
        self, path: Path, prefix: str, state_size: int, owners: Mapping[str, str] | None = None
    ) -> None:
        self.ffi = kernel_interface()
        self.lib = open_library(self.ffi, path, owners)
        self._program = address(self.ffi, path, f"{prefix}_program", "const soter_program *")
        self.state_size = state_size

    def new_state(self, seed: int) -> Bytes:
        """A new state, (state_size,) bytes, at the start of a run with this seed."""
        import numpy as np  # noqa: PLC0415 - channels of a robot need none of it

        state = np.zeros(self.state_size, dtype=np.uint8)
        self.lib.soter_start(self._program, self._pointer(state), seed & (2**64 - 1))
        return state

    def _pointer(self, array: Bytes) -> Any:  # noqa: ANN401 - a cdata pointer
        return self.ffi.cast("void *", array.ctypes.data)

    def run_until(
        self, state: Bytes, until_ns: int, trace: Bytes | None = None
    ) -> tuple[RunStatus, int, int]:
        """Runs all instants up to `until_ns`; writes their states to `trace`, (room, state_size).

        Gives the status, the number of written states, and the component that waits for an answer.
        """
        room = 0 if trace is None else len(trace)
        target = self.ffi.NULL if trace is None else self._pointer(trace)
        written, due = self.ffi.new("size_t *"), self.ffi.new("uint32_t *")  # threads share `self`
        status = self.lib.soter_run(
            self._program, self._pointer(state), until_ns, target, room, written, due
        )
        return RunStatus(status), int(written[0]), int(due[0])

    def next_instant_ns(self, state: Bytes) -> int:
        """The time of the next instant in ns; `state` (state_size,)."""
        return int(self.lib.soter_next_instant(self._program, self._pointer(state)))

    def publish(self, state: Bytes, topic: int, value: bytes, time_ns: int) -> int:
        """Sets a topic to a value measured at `time_ns`; gives 0 or the fault; `state` (bytes,)."""
        pointer = self.ffi.cast("void *", self.ffi.from_buffer(value))
        return int(
            self.lib.soter_publish(self._program, self._pointer(state), topic, pointer, time_ns)
        )

    def answer_extern(self, state: Bytes, component: int, fault: int, answer: bytes | None) -> None:
        """Ends the extern step that waits, with its answer or a fault; `state` (state_size,)."""
        data = self.ffi.NULL if answer is None else self.ffi.from_buffer(answer)
        self.lib.soter_answer(
            self._program, self._pointer(state), component, fault, self.ffi.cast("void *", data)
        )
