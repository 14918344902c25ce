"""Constants of many numbers are printed in time that grows with them, not with their square."""

from __future__ import annotations

import time

from soter.codegen.c.printer import WIDTH, broken


def test_a_line_of_megabytes_is_broken_in_linear_time() -> None:
    line = "static const double x = { " + ", ".join(["0.1234567890123456"] * 200_000) + " };"
    began = time.process_time()
    parts = list(broken(line, 0))
    assert time.process_time() - began < 5.0, "a quadratic loop takes minutes"
    assert " ".join(part.strip() for part in parts) == line
    assert max(map(len, parts)) <= WIDTH + 1


def test_strings_and_indents_are_not_broken() -> None:
    text = '"' + "a b " * 60 + '"'
    line = f"  call(first, {text}, second, {text}, third);"
    parts = list(broken(line, 1))
    assert sum(text in part for part in parts) == 2
    assert "".join(part.strip() for part in parts).replace(" ", "") == line.replace(" ", "")
