"""Texts of the operating system in words that a diagnostic can show.

Purpose: `reason` puts the system's refusal of a file or process into words; `utf8_text` gives a
file name as UTF-8.
Non-goals: which file it was, which whoever reports it says.
"""

from __future__ import annotations


def reason(error: OSError) -> str:
    """Why the system refused, as text in lower case without number and path."""
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


def utf8_text(name: str) -> str:
    r"""A file name of the system as UTF-8 text: bytes that are none as `\xe9`."""
    if name.isascii():
        return name
    return "".join(c if not "\ud800" <= c <= "\udfff" else f"\\x{ord(c) & 0xFF:02x}" for c in name)
