"""Refutations: found natively, counted only where the interpreter, given the choices, agrees."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

import json_documents
from generators.changed_modules import BASES
from soter.language.front_end import check_file, system_of
from soter.semantics.adverse_draws import AdverseDraws
from soter.semantics.externs import UnboundExternError
from soter.verify.attacked_system import DRAWN, OWN, NotAttackableError, attacked_system
from soter.verify.counterexample import (
    CYCLE,
    LEAVES,
    read_counterexample,
    replay_choices,
    run_that_leaves,
    write_counterexample,
)
from soter.verify.problem.verification_system import verification_system_of
from soter.verify.refute import search_leaving_run, search_run_without_return

if TYPE_CHECKING:
    from pathlib import Path

    from generators.changed_modules import Base
    from soter.language.model.system import System


def sound(base: Base) -> System:
    return system_of(check_file(f"{base.name}.soter", base.text), "Protected")


def mutant(base_name: str, name: str) -> tuple[Base, System]:
    base = BASES[base_name]
    return base, system_of(check_file(f"{base_name}.soter", base.changed(name)), "Protected")


@pytest.mark.parametrize(
    ("base", "name"),
    [
        ("cart", "SC with the wrong sign"),
        ("cart", "horizon of zero in ttf, no margin"),
        ("cart", "SC hovers: it only brakes"),
        ("tank", "safer is constant true"),
        ("tank", "SC weaker than the leak"),
        ("pendulum", "ttf takes degrees for radians"),
        ("lift", "2 Delta became Delta: one step too few"),
    ],
)
def test_a_bad_module_is_refuted(base: str, name: str) -> None:
    chosen, system = mutant(base, name)
    counterexample = search_leaving_run(system, chosen.module, 20.0).found
    assert counterexample is not None
    assert counterexample.shows == LEAVES
    again = replay_choices(counterexample, system)
    assert again is not None
    assert again.time_ns == counterexample.time_ns
    assert replay_choices(counterexample, sound(chosen)) is None, (
        "the sound module survives the same run"
    )


@pytest.mark.parametrize("base", BASES.values(), ids=list(BASES))
def test_a_sound_module_is_not(base: Base) -> None:
    system = sound(base)
    search = search_leaving_run(system, base.module, 0.5)
    assert search.found is None
    assert search.runs > 100
    assert search_run_without_return(system, base.module, 0.3).found is None


def test_a_dm_that_never_returns_is_refuted() -> None:
    base, system = mutant("tank", "SC rests where safer never holds")
    assert search_leaving_run(system, base.module, 0.5).found is None
    counterexample = search_run_without_return(system, base.module, 20.0).found
    assert counterexample is not None
    assert counterexample.shows == CYCLE
    assert counterexample.cycle_ns is not None
    assert all(len(chosen) == 1 for chosen in counterexample.choices.values())
    assert replay_choices(counterexample, system) is not None
    assert (
        replay_choices(replace(counterexample, cycle_ns=counterexample.cycle_ns + 1), system)
        is None
    )
    later = {**counterexample.choices, "t.leak": [*counterexample.choices["t.leak"], (10**6, 0.0)]}
    assert replay_choices(replace(counterexample, choices=later), system) is None, (
        "choices that change one day"
    )
    early = replace(counterexample, time_ns=counterexample.cycle_ns)
    assert replay_choices(early, system) is None, "at the start the state does not repeat itself"
    assert replay_choices(counterexample, sound(base)) is None


def test_a_file_says_it_all(tmp_path: Path) -> None:
    base, system = mutant("tank", "ttf is constant false")
    counterexample = search_leaving_run(system, base.module, 20.0).found
    assert counterexample is not None
    path = write_counterexample(counterexample, tmp_path / "deep" / "x.json")
    read = read_counterexample(path)
    assert read == counterexample
    schema = json_documents.SCHEMAS["counterexample.json"]
    assert list(json_documents._check(schema, json.loads(path.read_text()), "")) == []
    document = json.loads(path.read_text())
    document["choices"]["t.leak"][0][1] = 0.11  # more leak than the program declares
    path.write_text(json.dumps(document))
    assert replay_choices(read_counterexample(path), system) is None
    del document["choices"]["t.leak"]
    path.write_text(json.dumps(document))
    assert replay_choices(read_counterexample(path), system) is None
    path.write_text(json.dumps({**document, "schema": 9}))
    with pytest.raises(ValueError, match="of a newer soter"):
        read_counterexample(path)


def test_choices_that_do_no_harm_refute_nothing() -> None:
    base, system = mutant("tank", "ttf is constant false")
    counterexample = search_leaving_run(system, base.module, 20.0).found
    assert counterexample is not None
    still = {stream: [(0, 0.0)] for stream in counterexample.choices}
    assert replay_choices(replace(counterexample, choices=still), system) is None
    assert (
        replay_choices(replace(counterexample, time_ns=counterexample.time_ns - 1), system) is None
    )


STILL = """soter 1;
topic level: float max_age 20ms;
topic pump: float in [-1.0, 1.0] = 0.0;
plant Tank period 10ms {
  reads pump;
  drives level = h;
  state h: float = START;
  der h = 0.0 * pump;
  measured level within 0.5;
}
node A period 10ms { publishes pump; step { publish pump = 1.0; } }
node S period 10ms { publishes pump; step { publish pump = 0.0; } }
rta M { ac A; sc S; period 10ms; safe level < 1.0; ttf level > 2.0; safer level < 2.0; }
system P { t: Tank; module M; until 1s; }
"""


@pytest.mark.parametrize(("start", "unsafe"), [(0.9, False), (1.1, True)])
def test_safe_is_judged_on_the_truth(start: float, unsafe: bool) -> None:
    system = system_of(check_file("still.soter", STILL.replace("START", str(start))), "P")
    assert (search_leaving_run(system, "M", 0.5).found is not None) == unsafe


def test_a_faulting_safe_is_no_refutation() -> None:
    text = STILL.replace("START", "0.5").replace(
        "safe level < 1.0", "safe 1.0 / (level - 0.5) < 1.0"
    )
    system = system_of(check_file("still.soter", text), "P")
    assert search_leaving_run(system, "M", 0.5).found is None


def test_the_given_system_stays_as_it_is() -> None:
    base = BASES["cart"]
    system = sound(base)
    before = (system.topics, system.components, system.inputs, system.properties)
    variant = attacked_system(system, 0)
    assert (system.topics, system.components, system.inputs, system.properties) == before
    assert len(variant.topics) == len(system.topics) + 2
    assert [p.text for p in variant.properties] == ["safe, on the true state"]


BESIDE = """
topic fan: float in [-1.0, 1.0] = 0.0;
node A2 period 10ms { publishes fan; step { publish fan = 1.0; } }
node S2 period 10ms { publishes fan; step { publish fan = 0.0; } }
rta N { ac A2; sc S2; period 10ms; safe level < 9.0; ttf level > 8.0; safer level < 7.0; }
"""


def test_a_controller_may_read_the_mode_of_a_module_that_is_left_out() -> None:
    text = STILL.replace("START", "1.1").replace(
        "publish pump = 1.0;", "publish pump = mode(N) == Mode.AC ? 1.0 : 0.5;"
    )
    text = text.replace("system P {", BESIDE + "system P {").replace(
        "module M;", "module M; module N;"
    )
    flat = system_of(check_file("two.soter", text), "P")
    module = next(m for m in flat.modules if m.name == "M")
    system = verification_system_of(flat, module).system
    with pytest.raises(UnboundExternError):  # its own code cannot be run: it is left to the draws
        run_that_leaves(attacked_system(system, 0, OWN), AdverseDraws(1), 100_000_000)
    counterexample = search_leaving_run(system, "M", 0.5).found
    assert counterexample is not None
    assert counterexample.controller == DRAWN


def test_what_no_plant_drives_cannot_be_judged() -> None:
    text = STILL.replace("START", "0.5").replace(
        "topic level", "input topic other: float;\ntopic level"
    )
    text = text.replace("safe level < 1.0", "safe other < 1.0")
    system = system_of(check_file("still.soter", text), "P")
    with pytest.raises(NotAttackableError, match="no plant drives `other`"):
        attacked_system(system, 0)
    assert "no plant drives" in search_leaving_run(system, "M", 0.5).hindrance
