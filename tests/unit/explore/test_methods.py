"""One table of strategies, storages and reductions: the C and the documents say the same."""

from __future__ import annotations

import re
from pathlib import Path

from soter.api.program import Program
from soter.explore.methods import REDUCTIONS, STORAGES, STRATEGIES, constant

ROOT = Path(__file__).resolve().parents[3]
ENGINE = ROOT / "src" / "soter" / "explore" / "engine" / "c"
HEADER = ENGINE / "soter_explore.h"


def enum(name: str) -> list[str]:
    match = re.search(rf"typedef enum \{{([^}}]*)\}} {name};", HEADER.read_text(encoding="utf-8"))
    assert match is not None
    return re.findall(r"\bSOTER_\w+", match[1])


def test_the_c_has_a_constant_for_each() -> None:
    assert [constant(s) for s in STRATEGIES] == enum("soter_strategy")
    assert [constant(s) for s in STORAGES] == enum("soter_storage")


def test_the_engine_leads_each_strategy_to_its_own_search() -> None:
    door = (ENGINE / "soter_explore.c").read_text(encoding="utf-8")
    case_pairs = re.findall(r"case (SOTER_\w+):\s+(soter_search_\w+)\(s\);\s+return;", door)
    assert case_pairs == [(constant(s), f"soter_search_{s}") for s in STRATEGIES]


def test_the_schema_of_results_names_them_all() -> None:
    page = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    for what, names in (("strategy", STRATEGIES), ("storage", STORAGES), ("reduction", REDUCTIONS)):
        listed = ", ".join(f'"{n}"' for n in names)
        assert f'"{what}": {{ "enum": [{listed}] }}' in page


def test_the_page_about_python_names_them_all() -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    for what, names in (("strategy", STRATEGIES), ("storage", STORAGES), ("reduction", REDUCTIONS)):
        line = next(x for x in page.splitlines() if x.strip().startswith(f'{what}="'))
        assert all(name in line for name in names), what


def test_the_guide_and_the_docstring_name_every_strategy() -> None:
    page = (ROOT / "docs" / "find-the-bug.md").read_text(encoding="utf-8")
    for text in (page, Program.explore.__doc__ or ""):
        assert [s for s in STRATEGIES if not re.search(rf"\b{s}\b", text)] == []
