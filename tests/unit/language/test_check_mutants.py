"""The checker against programs that are a few tokens away from meaning something.

`SOTER_TEST_SCALE=200 pytest tests/unit/language/test_check_mutants.py` looks longer.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from generators.file_listing import files_in
from long_tests import examples
from soter.codegen.unit import generate
from soter.diagnostics.diagnostic import SoterError
from soter.diagnostics.render import render_all
from soter.language.front_end import CheckResult, check_file, system_of
from work import work_of

TESTS = Path(__file__).parents[2]
FOLDERS = ("correct", "dynamic_error", "static_error", "../examples/wall", "../examples/drone")
PATHS = [p for f in FOLDERS for p in files_in(TESTS / f, "*.soter")]
MUTANTS = examples(500)
CALLS_MAX = 20_000_000
"""Twenty times what a mutant takes; a constant may compute for as long as its budget."""

TOKEN = re.compile(r'"[^"\n]*"|//[^\n]*|\w+(?:\.\d\w*)?|[<>=!]=|&&|\|\||\.\.|\s+|.', re.DOTALL)
CANDIDATES = TESTS / "static_error" / "M027_candidates_beyond_the_set.soter"
ENUM_WITHOUT_CASES = TESTS / "static_error" / "T001_case_by_its_number.soter"
TOKENS = {p: TOKEN.findall(p.read_text(encoding="utf-8")) for p in PATHS}
TYPES = ["int", "float", "bool", "duration", "Vec3", "int in [0, 3]", "float[3]", "float[<=3]"]
NUMBERS = ["0", "1", "-1", "0.0", "1e308", "9223372036854775807", "99999999999999999999", "0ms"]
NUMBERS += ["10ms", "1h", "1ns", "100000", "3"]
WORDS = sorted({t for tokens in TOKENS.values() for t in tokens if t.isidentifier()})
OPERATIONS = ("delete", "double", "swap", "word", "name", "number", "type", "line", "foreign")

mutations = st.lists(
    st.tuples(st.sampled_from(OPERATIONS), st.integers(0, 10**6), st.integers(0, 10**6)),
    min_size=1,
    max_size=4,
)


def mutate(tokens: list[str], operation: str, i: int, j: int) -> list[str]:
    tokens = list(tokens)
    at = i % len(tokens)
    if operation == "delete":
        del tokens[at]
    elif operation == "double":
        tokens.insert(at, tokens[at])
    elif operation == "swap":
        other = j % len(tokens)
        tokens[at], tokens[other] = tokens[other], tokens[at]
    elif operation == "word":
        tokens[at] = WORDS[j % len(WORDS)]
    elif operation == "line":
        lines = "".join(tokens).split("\n")
        first = i % len(lines)
        lines[first : first + 1 + j % 3] = lines[j % len(lines) : j % len(lines) + j % 2]
        tokens = TOKEN.findall("\n".join(lines))
    elif operation == "foreign":
        lines = "".join(TOKENS[PATHS[j % len(PATHS)]]).split("\n")
        tokens.insert(at, "\n" + lines[i % len(lines)] + "\n")
    else:
        replace_one_like(tokens, operation, i, j)
    return tokens or [";"]


def replace_one_like(tokens: list[str], kind: str, i: int, j: int) -> None:
    """Replace a name by one of the program, a number or a type by another."""
    if kind == "number":
        places = [k for k, t in enumerate(tokens) if t[0].isdigit()]
        choices = NUMBERS + [tokens[k] for k in places]
    elif kind == "type":
        places = [k for k, t in enumerate(tokens) if t in TYPES]
        choices = TYPES
    else:
        places = [k for k, t in enumerate(tokens) if t.isidentifier()]
        choices = [tokens[k] for k in places]
    if places:
        tokens[places[i % len(places)]] = choices[j % len(choices)]


def check(path: Path, text: str) -> CheckResult:
    os.chdir(path.parent)
    checked, calls = work_of(lambda: check_file(path.name, text))
    assert calls <= CALLS_MAX
    return checked


def assert_sound(checked: CheckResult) -> None:
    """Whatever was found can be shown; without errors everything can be compiled."""
    for d in checked.diagnostics.items:
        for label in (*([d.primary] if d.primary else []), *d.secondary):
            assert 0 <= label.span.start <= label.span.end <= len(label.span.source.text)
    assert bool(render_all(checked.diagnostics.items)) == bool(checked.diagnostics.items)
    if checked.diagnostics.has_errors:
        return
    program = checked.program
    assert program is not None
    assert not program.incomplete
    assert not program.damaged
    draft = not any("." not in name for name in program.systems)
    for name in checked.systems:
        if draft:
            with suppress(SoterError):  # it may be there to be imported
                generate(system_of(checked, name))
        else:
            generate(system_of(checked, name))


@pytest.fixture(scope="module", autouse=True)
def _back_in_the_folder() -> object:
    before = Path.cwd()
    yield None
    os.chdir(before)


@settings(
    max_examples=MUTANTS,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
@given(st.sampled_from(PATHS), mutations)
@example(ENUM_WITHOUT_CASES, [("delete", 95, 0)])
@example(CANDIDATES, [("type", 1, 0)])
def test_a_mutant_is_checked_without_a_crash(
    path: Path, changes: list[tuple[str, int, int]]
) -> None:
    tokens = TOKENS[path]
    for operation, i, j in changes:
        tokens = mutate(tokens, operation, i, j)
    assert_sound(check(path, "".join(tokens)))


@pytest.mark.parametrize("path", PATHS, ids=lambda p: p.stem)
def test_the_programs_themselves_are_sound(path: Path) -> None:
    assert_sound(check(path, path.read_text(encoding="utf-8")))
