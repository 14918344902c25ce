"""`soter explain`: pages on a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.codes import all_codes, all_words
from soter.verify.claims.results import PROPERTIES

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    import pytest

    Soter = Callable[..., Any]


def test_a_page(soter: Soter) -> None:
    done = soter("explain", "s001")
    assert done.exit == 0
    assert done.out.startswith("# S001: ")
    assert soter("explain", "S001", "--json").document["code"] == "S001"


def test_a_page_in_colour(soter: Soter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    done = soter("explain", "S001")
    assert done.out.startswith("\x1b[1mS001: ")
    assert "```" not in done.out


def test_all_codes(soter: Soter) -> None:
    done = soter("explain")
    assert done.exit == 0
    assert len(done.out.splitlines()) == len(all_codes()) > 0
    assert [c["code"] for c in soter("explain", "--json").document["codes"]] == all_codes()


def test_an_unknown_code(soter: Soter) -> None:
    done = soter("explain", "S0001")
    assert done.exit == 1
    assert "did you mean" in done.err
    assert soter("explain", "\x1b[31m").exit == 1
    assert "\x1b" not in soter("explain", "\x1b[31m").err


CLI_CODES = [
    "D006",
    "D007",
    "D008",
    "I001",
    "U001",
    "U002",
    "U003",
    "U004",
    "U005",
    "U007",
    "X001",
    "X002",
    "X003",
    "X004",
    "X005",
    "X006",
    "X007",
    "X008",
]


def test_every_code_of_the_command_line_has_a_page(soter: Soter) -> None:
    for code in CLI_CODES:
        assert soter("explain", code).exit == 0, code


def test_the_words_of_a_verdict_have_pages_too(soter: Soter) -> None:
    known = [*all_codes(), *all_words()]
    for name in PROPERTIES:
        assert name in known
        assert soter("explain", name.upper(), "--json").document["code"] == name


def test_the_words_of_rest_have_pages_that_say_what_to_write_where_wind_pushes(
    soter: Soter,
) -> None:
    for word in ("rest", "moves", "within", "anchor"):
        said = soter("explain", word, "--json").document
        assert said["code"] == word
        assert "`rest" in said["page"]
    for word in ("rest", "moves", "anchor"):
        assert "wind" in soter("explain", word).out.lower()
    assert "anchor" in soter("explain", "ancor").err
