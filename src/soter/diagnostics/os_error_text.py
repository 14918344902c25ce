"""Why the system refused, in words.

Purpose: the same few words wherever a file, a folder or a process cannot be had.
Non-goals: which file it was: whoever asked for it says.
"""

from __future__ import annotations


def reason(error: OSError) -> str:
    """Say why the system refused, in lower case, without the number and the path."""
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]
