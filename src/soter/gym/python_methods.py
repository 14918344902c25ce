"""Calls of a step without a foreign-function interface (`c/soter_gym_python.c`).

Purpose: `step_calls`: functions of no arguments that answer for the agent and for the plant of one
`soter_outside`. A tenth of a microsecond a call less than through cffi, of which a step has two.
Non-goals: any other call.
"""

from __future__ import annotations

import ctypes
import sys
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    Call = Callable[[], int]

NO_ARGUMENTS = 0x0004
"""METH_NOARGS."""


class _Method(ctypes.Structure):
    """PyMethodDef of the stable ABI."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("call", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


_METHODS: dict[int, _Method] = {}
"""By the address of the C function: Python reads it as long as there is a function of it."""


def step_calls(ffi: Any, lib: Any, outside: Any) -> tuple[Call, Call]:  # noqa: ANN401 - cffi
    """What answers for the agent, and for the plant; `outside` has to live as long as they do."""
    if sys.implementation.name != "cpython":
        return partial(lib.soter_outside_act, outside), partial(lib.soter_outside_move_on, outside)
    api = ctypes.pythonapi
    given = (ctypes.cast(f, ctypes.c_void_p) for f in (api.PyLong_FromLong, api.PyLong_AsVoidPtr))
    lib.soter_python_given(*(ffi.cast("void *", pointer.value) for pointer in given))
    own = int(ffi.cast("uintptr_t", outside))
    act, move = (
        _method(name, int(ffi.cast("uintptr_t", ffi.addressof(lib, name))), own)
        for name in ("soter_python_act", "soter_python_move")
    )
    return act, move


def _method(name: str, address: int, own: int) -> Call:
    """A function of Python whose C is at `address` and whose `self` is the int `own`."""
    method = _METHODS.get(address)
    if method is None:
        method = _METHODS[address] = _Method(name.encode(), address, NO_ARGUMENTS, None)
    new = ctypes.pythonapi.PyCFunction_NewEx
    new.restype = ctypes.py_object
    new.argtypes = (ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    made: Call = new(ctypes.addressof(method), own, None)
    return made
