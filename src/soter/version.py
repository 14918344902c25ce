"""The version of Soter.

Purpose: what files and pages say they were made by.
Non-goals: versions of the language (`soter 1;`).
"""

from __future__ import annotations


def other_format(given: object, read: int) -> str:
    """Why a file of another format is not read, a clause; "" where it is of the one that is."""
    if given == read and type(given) is int:
        return ""
    if type(given) is not int:
        return "it does not say the version of its format"
    age = "an older" if given < read else "a newer"
    return f"its format is {given}, of {age} soter, and this one reads format {read}"


VERSION = "0.1.0"
