"""Modules replaced by their contracts: what the whole violates is found where one of them runs.

Judged by the brute-force enumerator, over random programs with two modules that read each other.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from generators.brute_force import TooLargeError
from generators.contract_programs import VARIANTS, contracted
from generators.explorer_agreement import compared, enumerated
from long_tests import examples, seeds
from soter.language.elaborate.passes import stand_ins
from soter.language.model import typed

if TYPE_CHECKING:
    from generators.brute_force import Broken

CHUNKS = 4
PROGRAMS = examples(20)
COMPARED = examples(2)
"""Programs on which the explorer is compared with the enumerator, a variant."""
MOST = 3_000
TELLING = (46, 40, 42, 44)
"""Programs with something to hide, one a chunk."""
WRONG = (46, 88)
"""Programs that an abstraction which leaves out a value gets wrong."""


def violated(seed: int) -> dict[tuple[str, bool], set[Broken]] | None:
    """What each variant violates, with the property asked and without; None: it is too large."""
    program = contracted(seed)
    violations = {}
    for name in VARIANTS:
        for asked in (False, True):
            try:
                of = enumerated(seed, program.variant(name, asked=asked), MOST).found
            except TooLargeError:
                return None
            violations[name, asked] = set(of.least)
    return violations


def hidden(seed: int) -> tuple[list[str], bool]:
    """What the abstractions of a program hide, and whether there was anything to hide."""
    violations = violated(seed)
    if violations is None:
        return [], False
    kept = not violations["M", False] and not violations["N", False]
    some = []
    if violations["concrete", False] and kept:
        some.append("a contract that the whole breaks is kept by each module alone")
    if kept and violations["concrete", True]:
        some += [
            f"the property is not violated with {name} as it is"
            for name in VARIANTS
            if not violations[name, True]
        ]
    return some, bool(violations["concrete", True])


@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.random
def test_what_the_whole_violates_is_found_one_module_at_a_time(chunk: int) -> None:
    told = 0
    for seed in [*seeds(chunk, PROGRAMS, CHUNKS), *TELLING[chunk::CHUNKS]]:
        some, tells = hidden(seed)
        told += tells
        assert not some, "\n".join([*some, contracted(seed).variant("concrete", asked=True)])
    assert told


def test_an_abstraction_that_leaves_out_a_value_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = stand_ins._choice_of_all

    def fewer(*about: object) -> tuple[typed.TypedExpr, int]:
        value, count = whole(*about)  # type: ignore[arg-type]
        assert isinstance(value, typed.TypedChoose)
        return replace(value, count=value.count - 1), count

    monkeypatch.setattr(stand_ins, "_choice_of_all", fewer)
    assert all(hidden(seed)[0] for seed in WRONG)


@pytest.mark.parametrize("variant", [pytest.param("M", marks=pytest.mark.long), "neither"])
@pytest.mark.long
def test_explorer_and_enumerator_agree_on_what_stands_for_modules(variant: str) -> None:
    seen = 0
    for seed in seeds(20 + 5 * COMPARED):
        try:
            s = enumerated(seed, contracted(seed).variant(variant, asked=True), MOST)
        except TooLargeError:
            continue
        told = compared(s, ("-O0",))
        assert not told.complaints, "\n".join([*told.complaints, "", f"program {seed}:", s.text])
        seen += 1
        if seen == COMPARED:
            return
    assert seen
