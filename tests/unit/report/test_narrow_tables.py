"""Tables on narrow and on plain terminals."""

from __future__ import annotations

import io

import pytest

from soter.cli.terminal.console import PLAIN, Console, plain_text
from soter.report.tables import Styled, display_width, table

HEAD = ("property", "verdict", "time", "how")
ROWS = [
    ("P1a", "proved", "0 ms", "SC every 10 ms, DM every 50 ms"),
    ("DM", "proved", "4.1 s", "the compiled DM switches as it should: " + "many words " * 12),
]


@pytest.mark.parametrize("width", [40, 60, 80, 100])
def test_no_line_is_wider_than_the_terminal_and_no_word_is_lost(width: int) -> None:
    lines = table(HEAD, ROWS, width=width).splitlines()
    assert max(map(display_width, lines)) <= width
    assert " ".join(lines).split().count("many") == 12
    assert table(HEAD, ROWS, width=1000) == table(HEAD, ROWS)


def test_numbers_and_no_break_spaces_stay_whole() -> None:
    rows = [("1,234.5 ms", Styled("m\u00a0=\u00a02, m\u00a0=\u00a03", "good"))]
    text = table(("a time", "levels that go back"), rows, width=20)
    assert "1,234.5 ms" in text
    assert text.count("m = 2,") == text.count("m = 3") == 1
    assert max(map(len, text.splitlines())) <= 20


def test_what_cannot_be_broken_stays_wide() -> None:
    assert "x" * 50 in table(("a",), [("x" * 50,)], width=20)


def test_colour_takes_no_columns() -> None:
    plain = table(HEAD, ROWS, width=60)
    painted = table(HEAD, [[Styled(str(c), "good") for c in r] for r in ROWS], width=60, color=True)
    assert len(painted.splitlines()) == len(plain.splitlines())
    assert "\x1b[32m" in painted


def test_an_encoding_without_boxes_gets_plain_characters() -> None:
    raw = io.BytesIO()
    out = io.TextIOWrapper(raw, encoding="ascii")
    with Console(json=False) as console:
        console.out = out
        out.reconfigure(errors="soter.plain")
        console.say(table(("a\u2192b", "\u0394"), [("1 \u00b5s", "\u4e16")]))
        console.flush()
    assert raw.getvalue().decode("ascii").split() == ["a->b", "Delta", "----", "--", "1", "us", "?"]
    assert all(plain.isascii() for plain in PLAIN.values())


class Terminal(io.StringIO):
    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("term", "plain"), [("dumb", True), ("vt100", True), ("xterm", False)])
def test_a_terminal_that_draws_no_boxes(
    monkeypatch: pytest.MonkeyPatch, term: str, plain: bool
) -> None:
    monkeypatch.setenv("TERM", term)
    out = Terminal()
    monkeypatch.setattr("sys.stdout", out)
    with Console(json=False) as console:
        console.say(table(("a",), [("b",)]))
        assert console.ascii_only is plain
    assert ("\u2500" in out.getvalue()) is not plain
    assert plain_text("K \u00b7 R \u2264 2") == "K * R <= 2"


def test_columns_count_where_a_person_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    with Console(json=False) as console:
        console._shown_on = io.StringIO()
        assert console.width is None, "nobody knows how wide a file is"
        console._shown_on = Terminal()
        assert console.width is not None
        monkeypatch.setenv("COLUMNS", "80")
        console._shown_on = io.StringIO()
        assert console.width == 80
