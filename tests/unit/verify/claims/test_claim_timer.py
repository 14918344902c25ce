"""A claim that begins says so, and how far a proof is then, whatever method proves it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from soter.diagnostics.current_phase import shares_to
from soter.verify.grid.case import STAGE, ClaimTimer
from soter.verify.verify_module import CLAIMS, STAGES


def test_a_claim_tells_where_it_begins_and_how_long_it_took() -> None:
    told: list[tuple[float, str]] = []
    case: Any = SimpleNamespace(problem=SimpleNamespace(name="M"), spent={})
    with shares_to(lambda *x: told.append(x)):
        for claim in ("P2a", "P3", "start", "P2b"):
            with ClaimTimer(case, claim):
                pass
    assert told == [(0.0, "safe"), (0.0, "tubes"), (0.0, "way")], "`start` takes no time"
    assert set(case.spent) == {"P2a", "P3", "start", "P2b"}


def test_claims_begin_at_stages_of_a_proof_and_later_ones_not_before_earlier_ones() -> None:
    at = [STAGES.index(STAGE[claim]) for claim in ("P2a", "P3", "ttf", "safer", "P2b")]
    assert at == sorted(at)
    assert {*CLAIMS, "P3"} >= set(STAGE)
