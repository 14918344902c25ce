"""What of SC or of the world is in the way is named where runs with that changed stay in C."""

from __future__ import annotations

import pytest

from unit.verify.diagnosis.tank_modules import changed, explained

LAW = "clamp(0.5 * (1.0 - level), -0.1, 0.1)"
LEAK = "leak: float in [0.0, 0.02]"
CALM, ALL = "that nothing disturbs", "in runs of the model: none leaves C within"


@pytest.mark.parametrize(
    ("changes", "said", "tried"),
    [
        (
            ((LAW, "clamp(0.5 * (level - 1.0), -0.1, 0.1)"),),
            "publishes `pump` with the other sign",
            ALL,
        ),
        (
            ((LAW, "clamp(0.5 * (level - 1.0), -0.1, 0.1)"), (LEAK, "leak: float in [-0.2, 0.2]")),
            "publishes `pump` with the other sign",
            CALM,
        ),
        (
            (
                (LAW, "clamp(0.5 * (1.0 - level), -0.01, 0.01)"),
                (LEAK, "leak: float in [0.0, 0.03]"),
            ),
            "whose `pump` is four times as strong (",
            ALL,
        ),
        (((LEAK, "leak: float in [-0.9, 0.9]"),), "`t.leak` a sixteenth as wide", ALL),
        ((("within 0.01", "within 0.9"),), "an error of `level` half as wide", ALL),
    ],
    ids=[
        "the sign",
        "the sign beside what is too much",
        "the strength",
        "the disturbance",
        "the error",
    ],
)
def test_what_is_in_the_way_is_named_with_how_much(
    changes: tuple[tuple[str, str], ...], said: str, tried: str
) -> None:
    hint = explained(changed(*changes, ("/ 320", "/ 32"))).findings["P2a"].hint
    assert said in hint
    assert tried in hint
    assert "(not tried)" not in hint


def test_a_wrong_sign_is_not_taken_for_too_much_strength() -> None:
    """Half as strong it leaves as surely, only later: runs are followed for long enough."""
    wrong = changed((LAW, "clamp(0.5 * (level - 1.0), -0.1, 0.1)"), ("/ 320", "/ 32"))
    hint = explained(wrong).findings["P2a"].hint
    assert hint.startswith("an SC that publishes `pump` with the other sign")
    assert "as strong" not in hint


def test_commands_that_act_too_late_are_named() -> None:
    quick = (LAW, "clamp(2.0 * (1.0 - level), -0.1, 0.1)")
    late = "late dm 0s, sc 0s; response dm 0s, sc 0s; acts within 15s;"
    hint = explained(changed(quick, ("/ 320;", f"/ 32; {late}"))).findings["P2a"].hint
    assert ALL in hint
    assert "commands that act sooner: SC answers states up to 15.1 s old" in hint


def test_where_nothing_that_is_tried_keeps_a_run_nothing_is_said_of_it() -> None:
    idle = changed((LAW, "0.0"), (LEAK, "leak: float in [0.2, 0.3]"), ("/ 320", "/ 32"))
    hint = explained(idle).findings["P2a"].hint
    assert hint
    assert "in runs of the model" not in hint


def test_an_sc_that_never_stops_is_told_to() -> None:
    """No sign or strength mends a law that is 0: the level falls by the mean leak for ever."""
    idle = explained(
        changed((LAW, "0.0"), (LEAK, "leak: float in [0.02, 0.03]"), ("/ 320", "/ 32"))
    )
    (cause,) = idle.findings["P2a"].causes
    assert "does not stop: after 200 s t.h still moves by -0.025 a second" in cause.text
    assert "an SC that stops, or that brings t.h back: it publishes `pump` = 0, whatever" in (
        idle.findings["P2a"].hint
    )


def test_an_sc_that_always_says_the_same_has_no_wrong_sign() -> None:
    full = explained(changed((LAW, "0.08"), ("/ 320", "/ 32"))).findings["P2a"].hint
    assert "sign" not in full
    assert "mirrored" not in full


def test_an_sc_that_rests_outside_is_told_what_of_it_keeps_runs_inside() -> None:
    away = (LAW, "clamp(0.5 * (level - 1.0), -0.1, 0.1)"), ("- leak;", "- leak - 0.05 * (h - 1.0);")
    p2a = explained(changed(*away, ("/ 320", "/ 32"))).findings["P2a"]
    hint = p2a.hint
    assert "comes to rest outside of C" in p2a.causes[0].text
    assert hint.startswith("an SC that publishes `pump` with the other sign")
