"""Predicates that fail: what is said of the grid's ends, and of `recover never`."""

from __future__ import annotations

from unit.verify.diagnosis.tank_modules import cause, changed, explained, kinds

TTF = "ttf level < 0.25 || level > 1.75;"
SAFER = "safer level > 0.4 && level < 1.6;"
SAFE = "safe level > 0.2 && level < 1.8;"


def test_an_end_that_is_one_of_safe_is_no_matter_of_the_grid() -> None:
    finding = explained(changed((TTF, "ttf level < 0.232 || level > 1.768;"))).findings["ttf"]
    assert finding.verdict == "undecided"
    assert not any("a longer axis" in text for text in (finding.hint, *finding.tried))


def test_where_ac_need_not_come_back_it_is_said_why_safer_is_asked_all_the_same() -> None:
    """`recover never` makes no proof of `safer` easier: the DM gives control where it holds."""
    wrong = (SAFER, "safer level > 0.2;"), (SAFE, "safe level > 0.2;")
    never = ("/ 320;", "/ 320; recover never;")
    for pairs in (wrong, (*wrong, never)):
        module_result = explained(changed(*pairs))
        assert module_result.findings["safer"].verdict == "undecided"
        assert ("asked_all_the_same" in kinds(module_result, "safer")) == (never in pairs)
        assert "asked_all_the_same" not in kinds(module_result, "ttf")
    why = cause(module_result, "safer", "asked_all_the_same").text
    assert "`recover never`" in why
    assert "wherever `safer` holds" in why
