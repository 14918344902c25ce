"""One table of methods, one record of options: the C, all callers and the pages say the same."""

from __future__ import annotations

import ast
import re
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.api.program import Program
from soter.cli.main import command_parser
from soter.diagnostics.command_records import make_record, options_of
from soter.diagnostics.diagnostic import SoterError
from soter.explore.search_options import (
    REDUCTIONS,
    STORAGES,
    STRATEGIES,
    SearchKeywords,
    SearchOptions,
    c_constant,
)
from soter.simulate.run_options import RunKeywords, RunOptions

if TYPE_CHECKING:
    from argparse import ArgumentParser

ROOT = Path(__file__).resolve().parents[3]
ENGINE = ROOT / "src" / "soter" / "explore" / "engine" / "c"
HEADER = ENGINE / "soter_explore.h"


def enum(name: str) -> list[str]:
    match = re.search(rf"typedef enum \{{([^}}]*)\}} {name};", HEADER.read_text(encoding="utf-8"))
    assert match is not None
    return re.findall(r"\bSOTER_\w+", match[1])


def test_the_c_has_a_constant_for_each() -> None:
    assert [c_constant(s) for s in STRATEGIES] == enum("soter_strategy")
    assert [c_constant(s) for s in STORAGES] == enum("soter_storage")


def test_the_engine_leads_each_strategy_to_its_own_search() -> None:
    door = (ENGINE / "soter_explore.c").read_text(encoding="utf-8")
    case_pairs = re.findall(r"case (SOTER_\w+):\s+(soter_search_\w+)\(s\);\s+return;", door)
    assert case_pairs == [(c_constant(s), f"soter_search_{s}") for s in STRATEGIES]


def test_the_schema_of_results_names_them_all() -> None:
    schema = (ROOT / "docs" / "schemas" / "test.json").read_text(encoding="utf-8")
    for what, names in (("strategy", STRATEGIES), ("storage", STORAGES), ("reduction", REDUCTIONS)):
        listed = ", ".join(f'"{n}"' for n in names)
        assert f'"{what}": {{ "enum": [{listed}] }}' in schema


CHOSEN = {"test", "system", "until", "seed"}
"""What the page gives another value than the default."""
RECORDS = [
    (SearchOptions, SearchKeywords, Program.explore, command_parser("test")),
    (RunOptions, RunKeywords, Program.simulate, command_parser("run")),
]


@pytest.mark.parametrize(("record", "method"), [(r[0], r[2]) for r in RECORDS])
def test_the_page_about_python_says_what_the_options_say(record: type, method: Any) -> None:
    """Names in their order, defaults and words of a call in the page are the record's."""
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    shown = re.search(rf"\.{method.__name__}\(\n((?:    \w+=.*\n)+)\)", page)
    assert shown is not None
    lines = re.findall(r"^    (\w+)=(.*),  # (.*)$", shown[1], re.MULTILINE)
    options = options_of(record, keyword=True)
    assert [(n, words) for n, _, words in lines] == [(n, o.meaning) for n, o in options.items()]
    for name, value, _ in lines:
        assert name in CHOSEN or ast.literal_eval(value) == options[name].default, name


@pytest.mark.parametrize(("record", "keywords", "method", "parser"), RECORDS)
def test_keywords_and_command_line_are_those_of_the_record(
    record: type, keywords: Any, method: Any, parser: ArgumentParser
) -> None:
    named = options_of(record, keyword=True)
    assert set(signature(method).parameters) == {"self", *named}
    own = method.__code__.co_varnames[: method.__code__.co_argcount]
    assert {*own, *keywords.__annotations__} == {"self", *named}
    flags = {s: a.dest for a in parser._actions for s in a.option_strings}
    options = options_of(record).items()
    ours = {s: n for n, o in options for s in o.flags.split() if s.startswith("-")}
    assert ours.items() <= flags.items()
    assert set(flags) - set(ours) <= {"--json", "-h", "--help", "--set", "--bind", "--format"}


def test_the_options_that_the_guide_compares_are_there() -> None:
    page = (ROOT / "docs" / "find-the-bug.md").read_text(encoding="utf-8")
    by_flag = {o.flags.split()[0]: o.kind for o in options_of(SearchOptions).values() if o.flags}
    rows = re.findall(r"^\| `(--[\w-]+) (\w+)` \|", page, re.MULTILINE)
    assert len(rows) == 4
    for flag, value in rows:
        kind = by_flag[flag]
        assert kind.text == "whole" or kind.fits(value)


@pytest.mark.parametrize(
    ("given", "allowed"),
    [
        ({"threads": 17}, "a whole number from 1 to 16"),
        ({"runs": True}, "a whole number from 1 to 2^63"),
        ({"minimise": -1}, "seconds, from 0 (do not) to 1,000,000,000"),
        ({"time": 0}, "seconds, more than 0 and at most 1,000,000,000"),
        ({"storage": "none"}, "exact or fingerprint"),
        ({"memory": "1k"}, "write it as 512M or 2G; 1M at least"),
    ],
)
def test_a_value_outside_is_refused_with_its_range(given: dict[str, Any], allowed: str) -> None:
    with pytest.raises(SoterError) as error:
        make_record(SearchOptions, given)
    (problem,) = error.value.diagnostics
    ((name, value),) = given.items()
    assert (problem.code, problem.message) == ("U001", f"`{name}` cannot be `{value}`")
    assert problem.helps == (allowed,)


def test_what_nobody_may_ask_for_is_no_keyword() -> None:
    for name in ("stratgy", "keep", "plainly"):
        with pytest.raises(TypeError, match=name):
            make_record(SearchOptions, {name: 1})


def test_a_keyword_of_a_version_before_is_refused_with_what_to_do() -> None:
    for name in ("checkpoint", "checkpoint_every", "resume"):
        with pytest.raises(SoterError) as error:
            make_record(SearchOptions, {name: "save"})
        (problem,) = error.value.diagnostics
        assert (problem.code, len(problem.helps)) == ("U001", 1)


def test_the_guide_and_the_docstring_name_every_strategy() -> None:
    page = (ROOT / "docs" / "find-the-bug.md").read_text(encoding="utf-8")
    for text in (page, Program.explore.__doc__ or ""):
        assert [s for s in STRATEGIES if not re.search(rf"\b{s}\b", text)] == []
