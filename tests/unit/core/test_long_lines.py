"""Constants of many numbers are printed by work that grows with them, not with their square."""

from __future__ import annotations

from soter.codegen.c_printer import WIDTH, wrapped_lines
from work import work_of

CALLS_PER_CHARACTER = 1
"""At most; a line that is looked at from its beginning for each of its parts takes thousands."""


def test_a_line_of_megabytes_is_broken_by_linear_work() -> None:
    line = "static const double x = { " + ", ".join(["0.1234567890123456"] * 200_000) + " };"
    parts, calls = work_of(lambda: list(wrapped_lines(line, 0)))
    assert calls <= CALLS_PER_CHARACTER * len(line)
    assert " ".join(part.strip() for part in parts) == line
    assert max(map(len, parts)) <= WIDTH + 1


def test_strings_and_indents_are_not_broken() -> None:
    text = '"' + "a b " * 60 + '"'
    line = f"  call(first, {text}, second, {text}, third);"
    parts = list(wrapped_lines(line, 1))
    assert sum(text in part for part in parts) == 2
    assert "".join(part.strip() for part in parts).replace(" ", "") == line.replace(" ", "")
