"""The libraries of C that Python opens, with cffi in its ABI mode.

Purpose: this is the only module that uses cffi. It reads declarations from the C headers, so that
Python and C cannot disagree.
Non-goals: compiling (`shared_library.py`); what a library's functions mean.
"""

from __future__ import annotations

import ctypes
import re
from functools import lru_cache
from runpy import run_path
from typing import TYPE_CHECKING, Any

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.language.evaluate.arithmetic import require_default_float_rules
from soter.native.cache import cached_folder, digest

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
INLINE = re.compile(r"^SOTER_INLINE.*?^\}$", re.DOTALL | re.MULTILINE)
CPLUSPLUS = re.compile(r"^#ifdef __cplusplus$.*?^#endif$", re.DOTALL | re.MULTILINE)
DIRECTIVE = re.compile(r"^[ \t]*#(?:.*\\\n)*.*$", re.MULTILINE)
NUMBER = re.compile(r"^#define ([A-Z_]+) (\d+)U?$")
TABLES = "interface.py"

_opened: list[Any] = []
"""Every opened library: cffi closes one without references, even if its functions have some."""


def declarations(header: Path) -> str:
    """The types, functions and numbers that a header of Soter declares, without inline functions.

    Included headers are not read: pass their declarations to `interface` first.
    """

    def kept_directive(match: re.Match[str]) -> str:
        number = NUMBER.match(match.group(0).rstrip())
        return f"#define {number.group(1)} {number.group(2)}" if number else ""

    text = COMMENT.sub("", header.read_text(encoding="utf-8"))
    return DIRECTIVE.sub(kept_directive, INLINE.sub("", CPLUSPLUS.sub("", text)))


@lru_cache(maxsize=64)
def interface(*declared: str) -> Any:  # noqa: ANN401 - cffi has no types
    """The cffi object for these declarations, parsed once for each sequence of texts.

    cffi's tables are cached, as parsing takes longer than most runs. Raises SoterError X006 if the
    cache cannot be used.
    """
    import _cffi_backend  # noqa: PLC0415 - only compiled runs need it

    def make_tables(work: Path) -> None:
        from cffi import FFI, recompiler  # noqa: PLC0415 - only the first time

        ffi = FFI()
        for text in declared:
            ffi.cdef(text)
        recompiler.make_py_source(ffi, "soter_interface", str(work / TABLES))

    content = digest(("cffi", _cffi_backend.__version__, *declared))
    return run_path(str(cached_folder("interface", content, (TABLES,), make_tables) / TABLES))[
        "ffi"
    ]


def open_library(
    ffi: Any,  # noqa: ANN401 - cffi has no types
    path: Path,
    owners: Mapping[str, str] | None = None,
) -> Any:  # noqa: ANN401 - the same
    """Loads a library; raises SoterError X004 if it calls a function that is missing.

    Raises SoterError X012 if this thread has other floating-point settings than the library
    assumes. `owners` maps each linked function to the C file that should define it.
    """
    require_default_float_rules()
    try:
        library = ffi.dlopen(str(path))
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
    _opened.append(library)
    return library


def address(ffi: Any, path: Path, symbol: str, type_: str) -> Any:  # noqa: ANN401 - cdata
    """The address of a constant in a library, as a cffi pointer of type `type_`."""
    constant = ctypes.c_char.in_dll(ctypes.CDLL(str(path)), symbol)
    return ffi.cast(type_, ctypes.addressof(constant))
