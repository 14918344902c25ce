"""Calls of a step without a foreign-function interface (`c/soter_gym_python.c`).

Purpose: `step_calls`: functions of an array that answer for the agent and for the plant of one
`soter_outside`. C reads the array where it lies: of the two calls of a step, each takes a
third of a microsecond less than a copy by NumPy and a call by cffi.
Non-goals: any other call.
"""

from __future__ import annotations

import ctypes
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    Call = Callable[[Any], int]

ONE_ARGUMENT = 0x0008
"""METH_O."""
NO_NUMBERS = -3
"""`SOTER_NO_NUMBERS`: what was given is no array that C reads as it is; nothing was done."""
NEEDED = {
    "int_of": "PyLong_FromLong",
    "address_of": "PyLong_AsVoidPtr",
    "buffer_of": "PyObject_GetBuffer",
    "buffer_release": "PyBuffer_Release",
    "clear_error": "PyErr_Clear",
}
"""`soter_python`: the functions of Python that C calls."""


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
    """What answers for the agent, and for the plant; `outside` has to live as long as they do.

    Each takes an array with one axis, of float32 or float64, and gives who is due, or a negative
    number as `soter_gym.h` has them: NO_NUMBERS for anything else, which then has no effect.
    """
    if sys.implementation.name != "cpython":
        return refuse, refuse
    given = {
        name: ffi.cast("void *", ctypes.cast(getattr(ctypes.pythonapi, f), ctypes.c_void_p).value)
        for name, f in NEEDED.items()
    }
    lib.soter_python_given(ffi.new("soter_python *", given))
    own = int(ffi.cast("uintptr_t", outside))
    act, move = (
        _method(name, int(ffi.cast("uintptr_t", ffi.addressof(lib, name))), own)
        for name in ("soter_python_act", "soter_python_move")
    )
    return act, move


def refuse(_: object) -> int:
    """No array is read as it is."""
    return NO_NUMBERS


def _method(name: str, address: int, own: int) -> Call:
    """A function of Python whose C is at `address` and whose `self` is the int `own`."""
    method = _METHODS.get(address)
    if method is None:
        method = _METHODS[address] = _Method(name.encode(), address, ONE_ARGUMENT, None)
    new = ctypes.pythonapi.PyCFunction_NewEx
    new.restype = ctypes.py_object
    new.argtypes = (ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    made: Call = new(ctypes.addressof(method), own, None)
    return made
