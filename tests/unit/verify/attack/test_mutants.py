"""Changed modules: none is proved, each is refuted by a run that the interpreter repeats."""

from __future__ import annotations

import pytest

from generators.changed_modules import BASES
from soter.language.front_end import check_file, system_of
from soter.verify.counterexample import Counterexample, replay_choices
from soter.verify.problem.extract import extract
from soter.verify.verify_module import verify_module

CHOSEN = (
    ("tank", "ttf is constant false", ("P3", "ttf")),
    ("tank", "safer is constant true", ("P3", "safer")),
    ("tank", "SC with the wrong sign", ("P2a",)),
    ("tank", "horizon in the wrong unit", ("P3", "ttf")),
    ("tank", "SC weaker than the leak", ("P2a",)),
    ("tank", "SC rests where safer never holds", ("P2b",)),
    ("tank", "ttf forgets the lower end", ("P3", "ttf")),
    ("lift", "2 Delta became Delta: one step too few", ("P3", "ttf")),
)


@pytest.mark.parametrize(("base", "mutant", "doubted"), CHOSEN)
def test_a_mutant_is_refuted(base: str, mutant: str, doubted: tuple[str, ...]) -> None:
    checked = check_file(f"{base}.soter", BASES[base].changed(mutant))
    flat = system_of(checked, "Protected")
    problem = extract(flat, flat.modules[0])
    result = verify_module(problem)
    assert result.verdict == "refuted"
    for name in doubted:
        assert result.findings[name].verdict != "proved", name
    runs = [
        f.counterexample
        for f in result.findings.values()
        if f.verdict == "refuted" and isinstance(f.counterexample, Counterexample)
    ]
    assert runs
    assert all(replay_choices(run, problem.system) is not None for run in runs)
    assert "stays in SC" in str(runs[0]) or "leaves `safe`" in str(runs[0])


@pytest.mark.parametrize("base", ["tank", "lift"])
def test_the_module_as_it_is_is_proved(base: str) -> None:
    flat = system_of(check_file(f"{base}.soter", BASES[base].text), "Protected")
    result = verify_module(extract(flat, flat.modules[0]))
    assert {n: f.verdict for n, f in result.findings.items() if not f.holds} == {}
