"""Symbols that an ELF object needs from elsewhere.

Purpose: what `nm -u` prints, without needing `nm` (a machine may have its compiler as a Python
package).
Non-goals: everything else about ELF; only 64-bit little-endian files.
"""

from __future__ import annotations

import struct

SYMBOL_TABLE = 2
UNDEFINED = 0


def undefined_symbols(data: bytes) -> set[str]:
    """Names of the undefined symbols of a relocatable object."""
    assert data[:6] == b"\x7fELF\x02\x01", "a 64-bit little-endian ELF file"
    (sections_at,) = struct.unpack_from("<Q", data, 0x28)
    size, count = struct.unpack_from("<HH", data, 0x3A)
    sections = [
        struct.unpack_from("<IIQQQQIIQQ", data, sections_at + i * size) for i in range(count)
    ]
    symbols: set[str] = set()
    for _, kind, _, _, offset, length, link, _, _, entry in sections:
        if kind != SYMBOL_TABLE:
            continue
        names = sections[link][4]
        for at in range(offset + entry, offset + length, entry):  # the first symbol is none
            name, _, _, section = struct.unpack_from("<IBBH", data, at)
            if section == UNDEFINED:
                end = data.index(b"\0", names + name)
                symbols.add(data[names + name : end].decode())
    return symbols - {""}
