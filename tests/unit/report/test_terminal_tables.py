"""Tables and time lines for a terminal."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.report.tables import Styled, display_width, mode_timeline, table

HEADERS = ("arm", "lap", "violations", "φ_safer")
ROWS = (
    ("AC alone", "10.6 s", Styled("2", "bad"), "—"),
    ("RTA-protected", "12.6 s", Styled("0", "good"), True),
)


def test_columns_line_up_and_numbers_are_flush_right() -> None:
    assert table(HEADERS, ROWS).split("\n") == [
        "arm               lap  violations  φ_safer",
        "─────────────  ──────  ──────────  ───────",
        "AC alone       10.6 s           2  —",
        "RTA-protected  12.6 s           0  yes",
    ]


def test_colour_changes_no_width() -> None:
    plain, coloured = table(HEADERS, ROWS), table(HEADERS, ROWS, color=True)
    assert "\x1b" not in plain
    assert "\x1b[31m2\x1b[0m" in coloured
    assert "\x1b[32m0\x1b[0m" in coloured
    stripped = coloured
    for code in ("0", "1", "2", "31", "32"):
        stripped = stripped.replace(f"\x1b[{code}m", "")
    assert stripped == plain


def test_floats_are_short_and_texts_are_kept() -> None:
    body = table(("v",), ((1 / 3,), (12,), ("12.50",))).split("\n")[2:]
    assert body == ["0.3333", "    12", " 12.50"]


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="2 entries expected, found 1"):
        table(("a", "b"), (("x",),))


def test_a_table_without_rows_has_a_head() -> None:
    assert table(("a",), ()) == "a\n─"


def test_wide_and_combining_characters_count_as_they_show() -> None:
    assert display_width("φ_safe") == 6
    assert display_width("漢字") == 4
    assert display_width("e\N{COMBINING ACUTE ACCENT}") == 1


def line(*stretches: tuple[str, float], width: int = 20, ascii_only: bool = False) -> str:
    """Draw a time line of stretches at 1 kHz."""
    modes = np.concatenate([np.full(round(s * 1000), who == "AC") for who, s in stretches])
    time_s = np.linspace(0.0, 10.0, len(modes))
    return mode_timeline(time_s, modes, width, ascii_only=ascii_only)


def test_a_time_line_names_its_stretches() -> None:
    assert line(("SC", 2), ("AC", 5), ("SC", 2), ("AC", 1)) == "▏SC▕████AC████▏SC▕██"
    assert line(("SC", 2), ("AC", 5), ("SC", 2), ("AC", 1), ascii_only=True) == (
        "[SC]====AC====[SC]=="
    )


def test_one_controller_fills_the_line() -> None:
    assert line(("AC", 1), width=10) == "████AC████"
    assert line(("SC", 1), width=10) == "▏   SC   ▕"


def test_a_short_takeover_never_disappears() -> None:
    assert line(("AC", 5), ("SC", 0.05), ("AC", 5)).count("│") == 1
    assert line(("AC", 5), ("SC", 0.05), ("AC", 5), ascii_only=True).count("|") == 1


def test_nothing_gives_nothing() -> None:
    assert mode_timeline(np.empty(0), np.empty(0, dtype=bool)) == ""
    assert line(("AC", 1), width=0) == ""


def test_an_instant_is_a_line_too() -> None:
    assert mode_timeline(np.asarray([3.0]), np.asarray([True]), 6) == "██AC██"


@given(st.lists(st.booleans(), min_size=1, max_size=200), st.integers(1, 100))
def test_a_time_line_is_as_wide_as_asked(modes: list[bool], width: int) -> None:
    time_s = np.linspace(0.0, 10.0, len(modes))
    for ascii_only in (True, False):
        drawn = mode_timeline(time_s, np.asarray(modes), width, ascii_only=ascii_only)
        assert display_width(drawn) == width
