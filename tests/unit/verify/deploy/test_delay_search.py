"""`soter advise --delay`: the search stays between what was proved and what was not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import soter
from soter.cli.main import main
from soter.language.front_end import check_file, system_of
from soter.verify import period_advice as delay_search
from soter.verify.period_advice import CLOSE, FIRST, TRIES_MAX, largest_delay

CART = "examples/wall/cart.soter"
DECLARED_NS, SC_NS = 1_000_000, 10_000_000


@given(bound_ns=st.integers(DECLARED_NS, 400 * SC_NS))
def test_what_is_told_lies_within_a_tenth_of_the_bound(bound_ns: int) -> None:
    flat = system_of(check_file(CART), None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            delay_search,
            "_failing_claim_in_words",
            lambda *at: "" if at[-1] <= bound_ns else "P2a: no",
        )
        advice = largest_delay(flat, flat.modules[0])
    largest, refused = advice.largest_ns, advice.refused_ns
    assert len(advice.why_not) <= TRIES_MAX
    assert largest is not None
    assert largest <= bound_ns
    if refused is None:
        assert len(advice.why_not) == TRIES_MAX
    elif len(advice.why_not) < TRIES_MAX:
        assert refused > bound_ns
        assert refused - largest <= 2 * CLOSE * max(largest, FIRST * SC_NS)
        assert "P2a: no" in advice.summary


def test_a_module_that_is_not_proved_as_it_is_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        delay_search, "_failing_claim_in_words", lambda *_: "P2b undecided: no way back"
    )
    flat = system_of(check_file(CART), None)
    advice = largest_delay(flat, flat.modules[0])
    assert advice.largest_ns is None
    assert advice.summary.startswith("not proved with `acts within 1ms` as declared: P2b")
    assert list(advice.why_not) == [DECLARED_NS]


@pytest.mark.parametrize("why", ["", "P2a: no"])
def test_the_least_time_stands_beside_what_was_proved_with_it(
    monkeypatch: pytest.MonkeyPatch, why: str
) -> None:
    """With `acts within 1ms` alone j is longer, and nobody verified that."""
    monkeypatch.setattr(delay_search, "_failing_claim_in_words", lambda *_: why)
    monkeypatch.setattr(delay_search, "TRIES_MAX", 1)
    text = Path(CART).read_text(encoding="utf-8")
    told = text.replace("acts within 1ms", "acts within 300us to 1ms")
    assert told != text
    flat = system_of(check_file("cart.soter", told), None)
    assert "`acts within 300us to 1ms`" in largest_delay(flat, flat.modules[0]).summary


def test_times_that_the_theorem_does_not_cover_are_not_proved() -> None:
    flat = system_of(check_file(CART), None)
    text = Path(CART).read_text(encoding="utf-8")
    lawful = text.replace("safer ", "failsafe accel = 0.0;\n  safer ", 1)
    flat = system_of(check_file("cart.soter", lawful), None)
    why = delay_search._failing_claim_in_words(flat, flat.modules[0], SC_NS)
    assert why.startswith("R015: SC may act 13 ms late")


@pytest.mark.long
def test_verify_proves_what_is_told_and_no_more(
    open_cart: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["advise", str(open_cart), "--delay", "--json"]) == 0
    (delay,) = json.loads(capsys.readouterr().out)["delays"].values()
    text = open_cart.read_text(encoding="utf-8")
    assert text.count("acts within 1ms") == 1
    for acts_s, proved in ((delay["largest_s"], True), (delay["refused_s"], False)):
        told = text.replace("acts within 1ms", f"acts within {round(acts_s * 1e9)}ns")
        open_cart.write_text(told, encoding="utf-8")
        try:
            (module,) = soter.load(open_cart).verify(refute=False).modules
            verdict = module.verdict
        except soter.SoterError:
            verdict = "not covered"
        assert (verdict == "proved") == proved
