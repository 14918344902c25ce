"""What flies starts among the states that are proved, by the map of its abstraction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.api import load
from soter.certificate.reading.problem import read_facts
from soter.certificate.rechecker import recheck
from soter.language.elaborate.views_for_proofs import start_of_proof_plant
from soter.language.front_end import check_file, system_of, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import assumption_texts

if TYPE_CHECKING:
    from pathlib import Path

TEXT = """\
soter 1;
topic x: float in [-4.0, 4.0] max_age 20ms;
topic u: float in [-1.0, 1.0];
topic offset: float = {offset};
param START: float = 0.0;
plant Body period 10ms {{
  reads u; drives x = p; state p: float = {start}; der p = u;
}}
plant Model period 10ms {{ reads u; drives x = p; state p: float = {model}; der p = u; }}
node Fast period 20ms {{ publishes u; step {{ publish u = 1.0; }} }}
node Slow period 20ms {{
  subscribes x; publishes u; step {{ publish u = clamp(-2.0 * x, -1.0, 1.0); }}
}}
node Far period 1s {{ publishes offset; step {{ publish offset = {offset}; }} }}
rta Keep {{
  ac Fast; sc Slow; period 20ms;
  safe abs(x) < 2.0; ttf abs(x) > 1.6; safer abs(x) < 1.3;
  verify {{ abstracts a by m: Model = {{ p: {map} }}; grid m.p in [-2.0, 2.0] / 100; }}
}}
system S {{ a: Body; module Keep; node Far; until 1s; }}
"""


def text(
    start: str = "0.0", model: str = "0.0", map_: str = "a.truth.p", offset: str = "0.0"
) -> str:
    return TEXT.format(start=start, model=model, map=map_, offset=offset)


def verdict(tmp_path: Path, text: str, **params: object) -> tuple[str, list[str]]:
    path = tmp_path / "p.soter"
    path.write_text(text)
    (module,) = load(path).verify(refute=False, params=params).modules
    assumed = [a for a in assumption_texts(module.assumptions) if "behaves like" in a]
    return str(module.findings["start"].verdict), assumed


@pytest.mark.parametrize(
    ("start", "model", "map_", "expected"),
    [
        ("0.0", "0.0", "a.truth.p", "proved"),
        ("1.0", "0.0", "a.truth.p", "proved"),
        ("3.5", "0.0", "a.truth.p", "undecided"),
        ("-3.5", "0.0", "a.truth.p", "undecided"),
        ("0.0", "3.5", "a.truth.p", "undecided"),
        ("1.0", "0.0", "3.5 * a.truth.p", "undecided"),
        ("START", "0.0", "a.truth.p", "proved"),
    ],
)
def test_both_starts_have_to_be_among_those_proved(
    start: str, model: str, map_: str, expected: str, tmp_path: Path
) -> None:
    start_verdict, assumed = verdict(tmp_path, text(start, model, map_))
    assert start_verdict == expected
    assert assumed[0].endswith("from the start of a on")


@pytest.mark.long
def test_a_parameter_that_moves_the_start_counts(tmp_path: Path) -> None:
    assert verdict(tmp_path, text("START"), START=1.0)[0] == "proved"
    assert verdict(tmp_path, text("START"), START=3.5)[0] == "undecided"


def test_a_topic_of_the_map_has_its_default_then(tmp_path: Path) -> None:
    mapped = text("0.0", "0.0", "a.truth.p + offset", "0.5")
    path = tmp_path / "p.soter"
    path.write_text(mapped)
    flat = system_of(check_file(str(path)), "S")
    (module,) = flat.modules
    assert start_of_proof_plant(flat, module, module.symbol.verify.abstracts[0]) == (0.5,)


@pytest.mark.long
def test_of_a_start_that_is_drawn_nothing_is_said(tmp_path: Path) -> None:
    drawn = text().replace(
        "state p: float = 0.0; der p = u;\n}", "state p: float in [0.0, 3.5]; der p = u;\n}"
    )
    start_verdict, assumed = verdict(tmp_path, drawn)
    assert start_verdict == "proved"
    assert assumed[0].endswith("from the initial states of m on")


def test_the_re_checker_sees_it_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A prover that forgets where the vehicle starts is caught."""
    from soter.verify.problem import inputs

    path = tmp_path / "p.soter"
    path.write_text(text("3.5"))
    monkeypatch.setattr(inputs, "start_of_proof_plant", lambda *_: None)
    (module,) = load(path).verify(cert=tmp_path / "cert", refute=False).modules
    assert str(module.findings["start"].verdict) == "proved"
    recheck_report = recheck(tmp_path / "cert")
    assert not recheck_report.accepted
    assert "initial state" in recheck_report.reason


# ---------------------------------------------------------------- parameters

FLOWN = """\
soter 1;
type Plan = enum {{ A, B, C }};
type Way = {{ to: Plan, laps: int in [0, 2] }};
type Seen = {{ narrow: bool, x: float }};
topic place: float max_age 20ms;
topic asked: {of} = {asked};
topic seen: Seen max_age 20ms;
topic u: float in [-1.0, 1.0];
plant Body period 10ms {{ reads u; drives place = p; state p: float = {start}; der p = u; }}
plant Tube period 10ms {{
  reads u; drives seen = {{ narrow: narrow(which), x: p }};
  state which: {of} = {own};
  state p: float = 0.0;
  der p = u;
}}
fun narrow(asked: {of}): bool {{ return {seen}; }}
fun room(m: Seen): float {{ return m.narrow ? 1.0 : 2.0; }}
node Asks period 1s {{ publishes asked; step {{ publish asked = {asked}; }} }}
node Sees period 10ms {{
  subscribes place, asked; publishes seen;
  step {{ publish seen = {{ narrow: narrow(asked), x: place }}; }}
}}
node Fast period 20ms {{ publishes u; step {{ publish u = 1.0; }} }}
node Slow period 20ms {{
  subscribes seen; publishes u; step {{ publish u = clamp(-2.0 * seen.x, -1.0, 1.0); }}
}}
rta Keep {{
  ac Fast; sc Slow; period 20ms;
  safe abs(seen.x) < room(seen);
  ttf abs(seen.x) > room(seen) - 0.4; safer abs(seen.x) < room(seen) - 0.7;
  verify {{
    abstracts a by m: Tube = {{ which: asked, p: a.truth.p }};
    grid m.p in [-2.0, 2.0] / 40;
  }}
}}
system S {{ a: Body; node Asks; node Sees; module Keep; until 1s; }}
"""
"""What is asked decides how much room there is; it is asked before anything is published."""
KINDS = {
    "enum": {"of": "Plan", "own": "Plan.A", "asked": "Plan.B", "seen": "asked == Plan.B"},
    "bool": {"of": "bool", "own": "false", "asked": "true", "seen": "asked"},
    "int": {"of": "int in [0, 2]", "own": "0", "asked": "2", "seen": "asked == 2"},
    "record": {
        "of": "Way",
        "own": "{ to: Plan.A, laps: 1 }",
        "asked": "{ to: Plan.A, laps: 2 }",
        "seen": "asked.laps == 2",
    },
}
STARTS = {"enum": ((0, 1),), "bool": ((0, 1),), "int": ((0, 2),), "record": ((0,), (1, 2))}


def flown(kind: str, start: str = "1.5") -> str:
    return FLOWN.format(start=start, **KINDS[kind])


@pytest.mark.parametrize("kind", KINDS)
def test_parameters_start_where_the_map_puts_them(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "p.soter"
    path.write_text(flown(kind))
    checked = check_file(str(path))
    flat = system_to_prove(checked, "S")
    assert extract(flat, flat.modules[0]).parameter_starts == STARTS[kind]
    found = [p.begins for p in read_facts(flat, "Keep").parameters]
    assert tuple(tuple(sorted(set(begins))) for begins in found) == STARTS[kind]


@pytest.mark.parametrize(("start", "expected"), [("1.5", "undecided"), ("0.1", "proved")])
def test_the_start_lies_among_the_sets_of_the_parameters_that_fly(
    tmp_path: Path, start: str, expected: str
) -> None:
    """Declared is a wide tube, in which 1.5 is fine; flown is a narrow one."""
    assert verdict(tmp_path, flown("enum", start))[0] == expected


def test_the_re_checker_sees_the_start_of_parameters_by_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from soter.verify.problem.problem import Problem

    path = tmp_path / "p.soter"
    path.write_text(flown("enum"))
    monkeypatch.setattr(Problem, "may_start_with", lambda _, values: values == (0,))
    (module,) = load(path).verify(cert=tmp_path / "cert", refute=False).modules
    assert str(module.findings["start"].verdict) == "proved"
    recheck_report = recheck(tmp_path / "cert")
    assert not recheck_report.accepted
    assert "initial state" in recheck_report.reason
