"""Reads from a data file that `soter identify` fitted its numbers to logs.

Purpose: `held_out_episodes` lets every verdict say what such numbers rest on.
Non-goals: the numbers (`loader.py`); whether logs are there, or the fit is right.
"""

from __future__ import annotations

from soter.language.load.named_files import parse_json


class DataError(Exception):
    """An error for a data file whose content is no value of the declared type, with the reason."""


IDENTIFIED = "$identified"
"""The key by which `soter identify` says in a data file what its numbers rest on."""


def held_out_episodes(raw: bytes) -> int | None:
    """Gives the number of held-out episodes on which a JSON data file rests; None for other files.

    Raises `DataError` if the file has the key `IDENTIFIED` without such a number.
    """
    if f'"{IDENTIFIED}"'.encode() not in raw:
        return None
    document = parse_json(raw.decode("utf-8-sig"))
    if not isinstance(document, dict) or IDENTIFIED not in document:
        return None
    facts = document[IDENTIFIED]
    n = facts.get("held_out") if isinstance(facts, dict) else None
    if type(n) is not int or n < 1:
        raise DataError(f'`"{IDENTIFIED}"` has no `"held_out"`, a whole number from 1 on')
    return n
