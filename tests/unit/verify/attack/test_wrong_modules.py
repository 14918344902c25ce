"""Wrong modules that were once proved: none is now, unless what is wrong with it is printed.

Purpose: a few of `bench/wrong_modules`, one or two of each kind that was proved before, with the
demonstration that they are wrong; and the right modules that they are made from.
"""

from __future__ import annotations

import re

import pytest
from bench.rows import edited
from bench.wrong_modules.base import BASES, RING, Base
from bench.wrong_modules.verdicts import (
    NAMED,
    PROVED,
    REFUSED,
    SHOWN,
    UNDECIDED,
    WRONG,
    call,
    demonstrated,
    judged,
)

BY_NAME = {w.name: w for w in WRONG}
ONCE_PROVED = (
    ("a mode of 30 rad/s, the DM 25 ms late", {UNDECIDED}),
    ("start: the DM is 300 ms late", {UNDECIDED, REFUSED}),
    ("SC steps before the estimator: the default pulls it out", {UNDECIDED}),
    ("SC divides by the default", {UNDECIDED}),
    ("an estimator every second behind `max_age 10ms`", {REFUSED}),
    ("a fresh stamp on an old sample, after the first sample", {UNDECIDED, REFUSED}),
    ("a plant whose sensor may drop out", {NAMED}),
    ("a low-pass filter of 0.6 s", {NAMED}),
    ("SC guarantees less force than it uses", {NAMED, REFUSED, UNDECIDED}),
    ("another plant: the wires crossed", {NAMED, UNDECIDED}),
    ("forced to AC", {NAMED, UNDECIDED}),
    ("the plant's gain", {NAMED}),
    ("`ttf true`", {NAMED, UNDECIDED}),
    ("a second node behind the actuator's, every 700 ms", {REFUSED, UNDECIDED}),
    ("another module estimates, every three seconds", {REFUSED, UNDECIDED}),
    ("an estimator that publishes in a branch that time closes", {REFUSED, UNDECIDED}),
)


@pytest.mark.parametrize(("name", "answers"), ONCE_PROVED, ids=[n for n, _ in ONCE_PROVED])
def test_a_wrong_module_that_was_once_proved_is_not(name: str, answers: set[str]) -> None:
    wrong = BY_NAME[name]
    answer, _, printed = judged(wrong)
    assert answer in answers, printed
    if wrong.shown is not None:
        assert demonstrated(wrong.shown, wrong.text) == SHOWN


PROVED_LONGEST = ("`ttf` holds wherever `safer` does", "another estimator of the same name")


@pytest.mark.parametrize("name", PROVED_LONGEST)
def test_a_wrong_module_is_not_proved_without_a_word(name: str) -> None:
    assert judged(BY_NAME[name])[0] != PROVED


@pytest.mark.parametrize("base", BASES, ids=[b.name for b in BASES])
def test_the_right_modules_that_they_are_made_from_are_proved(base: Base) -> None:
    said = call(base.text, ("verify", "--no-refute"))
    assert said.exit == 0, said.text
    # on `ring` AC has control on a third of a percent: rightly said
    patterns = (
        *BY_NAME["forced to AC"].named,
        *(() if base is RING else BY_NAME["`ttf true`"].named),
    )
    assert not any(re.search(p, said.report) for p in patterns), said.report
    assert call(base.text, ("run",)).exit == 0


def test_every_edit_of_every_wrong_module_fits_and_names_are_unique() -> None:
    assert len(BY_NAME) == len(WRONG) >= 150
    for wrong in WRONG:
        assert wrong.text != wrong.base.text
        if wrong.shown is not None:
            edited(wrong.text, wrong.shown.edits)


def test_naming_counts_in_the_report_only_not_in_warnings() -> None:
    # the program warns about `Scope`, which reads nothing; no assumption needs to speak of it
    wrong = BY_NAME["a dead reckoning that never looks"]
    said = call(wrong.text, ("verify", "--no-refute"))
    assert "warning" in said.text
    assert "warning" not in said.report
    assert PROVED not in judged(wrong)[0] or "Scope" not in said.report
