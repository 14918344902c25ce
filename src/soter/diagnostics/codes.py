"""The codes of diagnostics, and the page of each: `soter explain CODE`.

Purpose: a code that does not exist does not type-check. `explain` finds a page by its code, its
title, and the codes that look like a mistyped one.
Non-goals: the pages themselves (`pages/*.md`), showing them on a terminal (`cli/`).
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Literal, TypeAlias

from soter.diagnostics.similar_names import closest

Code: TypeAlias = Literal[
    "C001", "C002", "C003", "C004", "C005", "C006", "C007",
    "D001", "D002", "D004", "D005", "D006", "D007", "D008", "D009", "D010", "D011", "D015",
    "D016", "D017", "D018", "D019", "D020", "D021", "D022", "D023",
    "P1a", "P1b", "P1c", "P2a", "P2b", "P3",
    "E001", "E002", "E003", "E004", "E005", "E006", "E007", "E008", "E009", "E010", "E011",
    "E012", "E013", "E014", "E015", "E016", "E017", "E018", "E019", "E020",
    "I001",
    "L001", "L002", "L003", "L004", "L005", "L006", "L007", "L008",
    "M001", "M002", "M003", "M004", "M005", "M006", "M007", "M009", "M010", "M011", "M012",
    "M013", "M014", "M015", "M016", "M017", "M018", "M020", "M021", "M022", "M023",
    "M024", "M025", "M026", "M027", "M028", "M029", "M030",
    "N001", "N002", "N003", "N004", "N006",
    "R001", "R002", "R003", "R004", "R005", "R006", "R007", "R008", "R009", "R010", "R011",
    "R012", "R014", "R015", "R016", "R017", "R018", "R019", "R023", "R030", "R031",
    "R032", "R033", "R034",
    "S001", "S002", "S003", "S004", "S005", "S006", "S007", "S008", "S009", "S010", "S011",
    "S012", "S013", "S014", "S015", "S016", "S017", "S018", "S019", "S020", "S021", "S022",
    "S023", "S024", "S025", "S026",
    "T001", "T002", "T003", "T004", "T005", "T006", "T007", "T008", "T009", "T010", "T011",
    "T012", "T013", "T014", "T015", "T016", "T017", "T018", "T019", "T020", "T021", "T030",
    "U001", "U002", "U003", "U004", "U005", "U007", "U008", "U009", "U010", "U011", "U012",
    "V001", "V002", "V003", "V004", "V005", "V006", "V007", "V008", "V009", "V010", "V011",
    "W001", "W004", "W006", "W007", "W008", "W010", "W011", "W012", "W013", "W014", "W015",
    "W016", "W017", "W018", "W019", "W021", "W022", "W023", "W024", "W025", "W026", "W027",
    "W028", "W030", "W032", "W033", "W034", "W035", "W036", "W037",
    "X001", "X002", "X003", "X004", "X005", "X006", "X007", "X008", "X009", "X010", "X011",
    "X012", "X013", "X014", "X015", "X016", "X017",
]  # fmt: skip


_PAGES = Path(__file__).parent / "pages"


def all_codes() -> list[str]:
    """Every code that has a page, sorted by letters, then by number."""
    return sorted(_codes_by_folded().values(), key=lambda code: (code.rstrip("0123456789"), code))


def all_words() -> list[str]:
    """The words that have a page: subjects of verdicts (`ttf`, `start`) and words of `rest`."""
    return sorted(_words_by_folded().values())


def known_code(code: str) -> str | None:
    """A code or word in the spelling of its page, from any letter case; None if it has no page."""
    folded = code.strip().casefold()
    return _codes_by_folded().get(folded) or _words_by_folded().get(folded)


def explain(code: str) -> str | None:
    """The Markdown page of a code or word, in any letter case; None if it has none."""
    known = known_code(code)
    return _read_page(known) if known is not None else None


def title(code: str) -> str | None:
    """The title of a code's page, which follows `# CODE:` on the first line; None if no page."""
    page = explain(code)
    return None if page is None else page.split("\n", 1)[0].partition(":")[2].strip()


def similar_codes(code: str) -> list[str]:
    """Codes with a spelling similar to an unknown one; the most similar comes first."""
    known = {**_codes_by_folded(), **_words_by_folded()}
    near = closest(code.strip().casefold()[:20], known, 0.5, 3)
    return [known[folded] for folded in near]


@cache
def _codes_by_folded() -> dict[str, str]:
    return {path.stem.casefold(): path.stem for path in _PAGES.glob("*.md")}


@cache
def _words_by_folded() -> dict[str, str]:
    return {path.stem.casefold(): path.stem for path in (_PAGES / "words").glob("*.md")}


@cache
def _read_page(code: str) -> str:
    folder = _PAGES / "words" if code in _words_by_folded().values() else _PAGES
    page = (folder / f"{code}.md").read_text(encoding="utf-8")
    return _EXAMPLE.sub(_example_as_diff, page)


_EXAMPLE = re.compile(r"^```soter,wrong\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def _example_as_diff(example: re.Match[str]) -> str:
    """An example as a difference: `-` before wrong lines, and `+` before right lines.

    In the file, a line `code // a -> b` has b in place of a, `code // leave out` is removed, and
    `// and: code` is an added line. Without any of these, the example stays as it is.
    """
    lines: list[str] = []
    for line in example[1].splitlines():
        code, _, remedy = line.partition("  // ")
        old, arrow, new = remedy.partition(" -> ")
        if arrow:
            lines += [f"- {code}", f"+ {code.replace(old, new)}"]
        elif remedy == "leave out":
            lines.append(f"- {code}")
        elif line.lstrip().startswith("// and: "):
            lines.append("+ " + line.replace("// and: ", "", 1))
        else:
            lines.append(f"  {line}".rstrip())
    if not any(line[:1] in "-+" for line in lines if line):
        return example[0]
    return "\n".join(["```diff", *lines, "```"])
