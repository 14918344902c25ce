"""A normalised observation that predicates read as if it were the state is named."""

from __future__ import annotations

from unit.verify.diagnosis.tank_modules import cause, changed, explained, kinds

COARSE = (("[0.2, 1.8] / 320", "[0.2, 1.8] / 40"),)
SCALED = (("drives level = h;", "drives level = h / 10.0;"), ("grid level", "grid t.h"))


def test_predicates_in_other_units_than_the_topic_are_told_what_they_read() -> None:
    whole = (("safe level > 0.2 && level < 1.8;", "safe level > -0.2 && level < 1.8;"),)
    module_result = explained(
        changed(*COARSE, *SCALED, *whole, ("level < 0.25 ||", "level < -0.15 ||"))
    )
    assert module_result.verdict != "proved"
    named = [n for n, f in module_result.findings.items() if "scaled" in kinds(module_result, n)]
    assert named
    why = cause(module_result, named[0], "scaled")
    assert "it reads `level`, driven as `h / 10.0`" in why.text
    assert "divide in the controller" in module_result.findings[named[0]].hint


def test_a_scaled_topic_with_predicates_in_its_own_units_is_not_doubted() -> None:
    """Everything is a tenth: what fails, fails for another reason."""
    tenth = (
        ("safe level > 0.2 && level < 1.8;", "safe level > 0.02 && level < 0.18;"),
        ("ttf level < 0.25 || level > 1.75;", "ttf level < 0.0201 || level > 0.1799;"),
        ("safer level > 0.4 && level < 1.6;", "safer level > 0.04 && level < 0.16;"),
        ("0.5 * (1.0 - level)", "5.0 * (0.1 - level)"),
        ("measured level within 0.01;", "measured level within 0.001;"),
    )
    module_result = explained(changed(*COARSE, *SCALED, *tenth))
    assert module_result.verdict != "proved"
    assert not any("scaled" in kinds(module_result, n) for n in module_result.findings)


def test_states_that_are_driven_as_they_are_are_not_doubted() -> None:
    open_ = (("safe level > 0.2 && level < 1.8;", "safe level > -9.0 && level < 9.0;"),)
    module_result = explained(changed(*COARSE, *open_, ("level < 0.25 ||", "level < 0.2001 ||")))
    assert module_result.verdict != "proved"
    assert not any("scaled" in kinds(module_result, n) for n in module_result.findings)
