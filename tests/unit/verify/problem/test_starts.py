"""What flies starts among the states that are proved, by the map of its abstraction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.api import load
from soter.certificate.rechecker import recheck
from soter.language.evaluate.abstraction_start import start_behind
from soter.language.front_end import check_file, system_of
from soter.verify.problem.assumption import texts

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
    assumed = [a for a in texts(module.assumptions) if "behaves like" in a]
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
    assert start_behind(flat, module, module.symbol.verify.abstracts[0]) == (0.5,)


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
    monkeypatch.setattr(inputs, "start_behind", lambda *_: None)
    (module,) = load(path).verify(cert=tmp_path / "cert", refute=False).modules
    assert str(module.findings["start"].verdict) == "proved"
    recheck_report = recheck(tmp_path / "cert")
    assert not recheck_report.accepted
    assert "initial state" in recheck_report.reason
