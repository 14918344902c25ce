"""Texts from outside, made harmless to look at.

Purpose: what an extern, a file or a name says never moves a terminal's cursor or colours it.
Non-goals: HTML, cutting to a width.
"""

from __future__ import annotations


def visible(text: str) -> str:
    r"""Return a text on one line in which every character shows: `\x1b` for an escape."""
    return "".join(char if char.isprintable() else _escaped(char) for char in text)


def _escaped(char: str) -> str:
    return char.encode("unicode_escape").decode("ascii")
