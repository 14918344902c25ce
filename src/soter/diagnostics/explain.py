"""The page of every code: `soter explain CODE`.

Purpose: find a page by its code, its title, and the codes that look like a mistyped one.
Non-goals: the pages themselves (`pages/*.md`), showing them on a terminal (`cli/`).
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from soter.diagnostics.similar_names import closest

_PAGES = Path(__file__).parent / "pages"


def all_codes() -> list[str]:
    """Every code that has a page, letters first, numbers in order."""
    return sorted(_by_folded().values(), key=lambda code: (code.rstrip("0123456789"), code))


def all_words() -> list[str]:
    """What no diagnostic is: subjects of verdicts (`ttf`, `start`, ...), and words of `rest`."""
    return sorted(_words().values())


def named(code: str) -> str | None:
    """A code or word as it is written, from any letter case; None where there is no page."""
    folded = code.strip().casefold()
    return _by_folded().get(folded) or _words().get(folded)


def explain(code: str) -> str | None:
    """The Markdown page of a code or word in any letter case, None where there is none."""
    known = named(code)
    return _page(known) if known is not None else None


def title(code: str) -> str | None:
    """What stands behind `# CODE:` on the first line of the page."""
    page = explain(code)
    if page is None:
        return None
    first = page.split("\n", 1)[0]
    return first.partition(":")[2].strip()


def suggestions(code: str) -> list[str]:
    """Codes that look like an unknown one, best first."""
    known = {**_by_folded(), **_words()}
    near = closest(code.strip().casefold()[:20], known, 0.5, 3)
    return [known[folded] for folded in near]


@cache
def _by_folded() -> dict[str, str]:
    return {path.stem.casefold(): path.stem for path in _PAGES.glob("*.md")}


@cache
def _words() -> dict[str, str]:
    return {path.stem.casefold(): path.stem for path in (_PAGES / "words").glob("*.md")}


@cache
def _page(code: str) -> str:
    folder = _PAGES / "words" if code in _words().values() else _PAGES
    return (folder / f"{code}.md").read_text(encoding="utf-8")
