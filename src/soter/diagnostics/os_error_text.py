"""Why the system refused, in words.

Purpose: the same few words wherever a file, a folder or a process cannot be had.
Non-goals: which file it was: whoever asked for it says.
"""

from __future__ import annotations


def reason(error: OSError) -> str:
    """Say why the system refused, in lower case, without the number and the path."""
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


def utf8_text(name: str) -> str:
    r"""A name of the system as UTF-8 can say it: bytes that are none as `\xe9`."""
    if name.isascii():
        return name
    return "".join(c if not "\ud800" <= c <= "\udfff" else f"\\x{ord(c) & 0xFF:02x}" for c in name)
