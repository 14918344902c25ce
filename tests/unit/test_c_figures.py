"""Functions of the C stay short and simple: a rough count over the text."""

from __future__ import annotations

import re
from pathlib import Path

from generators.file_listing import files_below

SOTER = Path(__file__).resolve().parents[2] / "src" / "soter"
BEGIN = re.compile(r"^[A-Za-z_][^;={}]*?\b([a-z_0-9]+)\([^;{}]*\) \{$", re.MULTILINE)
BRANCH = re.compile(r"\b(?:if|for|while|case)\b|&&|\|\||\?")
NOT_CODE = re.compile(r'/\*.*?\*/|"(?:[^"\\\n]|\\.)*"', re.DOTALL)
CHECK = re.compile(r"\bSOTER_CHECK\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\);")
LONGEST = 70
SIMPLE = 10
NOT_SIMPLE = 8


def functions(text: str) -> list[tuple[str, int, int]]:
    """Name, lines and cyclomatic complexity of each; assertions do not branch."""
    figures = []
    blank = NOT_CODE.sub(lambda m: "\n" * m.group().count("\n"), text)
    for begin in BEGIN.finditer(blank):
        end = blank.index("\n}\n", begin.end())
        body = blank[begin.start() : end]
        branches = BRANCH.findall(CHECK.sub("", body))
        figures.append((begin.group(1), body.count("\n") + 2, 1 + len(branches)))
    return figures


def all_functions() -> list[tuple[str, str, int, int]]:
    return [
        (path.name, *figures)
        for path in files_below(SOTER, "*.[ch]")
        for figures in functions(path.read_text(encoding="utf-8"))
    ]


def test_the_count_knows_branches_comments_and_assertions() -> None:
    text = """static int f(int a,
             int b) {
  /* if && */
  SOTER_CHECK(a > 0 && (b > 0 || a));
  if (a && b) {
    return a ? 1 : 2;
  }
  return 0;
}
"""
    assert functions(text) == [("f", 9, 4)]


def test_no_function_of_the_c_is_long() -> None:
    figures = all_functions()
    assert len(figures) > 400
    assert [f for f in figures if f[2] > LONGEST] == []


def test_few_functions_of_the_c_have_many_branches() -> None:
    figures = [f for f in all_functions() if f[3] > SIMPLE]
    assert len(figures) <= NOT_SIMPLE, figures
