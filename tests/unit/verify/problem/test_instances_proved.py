"""A module is proved with the parameters of its instance, and with the topics around it."""

from __future__ import annotations

import json
import re
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.certificate.reading.problem import read_facts
from soter.certificate.rechecker import recheck
from soter.certificate.report import NotRecheckedError
from soter.language.front_end import check_file, system_of
from soter.verify.problem.extract import extract
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

TEXT = """soter 1;
param A: float = 3.0;
param TOP: float = 3.0;
param WIND: float = 0.1;
param WALL: float = 2.0;
type Motion = { x: float, v: float };
topic motion: Motion max_age 20ms;
topic accel: float in [-TOP, TOP] = 0.0;
plant Cart period 10ms {
  reads accel;
  drives motion = { x: x, v: v };
  state x: float in [-0.1, 0.1];
  state v: float = 0.0;
  disturbance wind: float in [-WIND, WIND];
  der x = v;
  der v = accel + wind;
  measured motion.x within 0.01, motion.v within 0.02;
}
node Fast period 50ms {
  subscribes motion;
  publishes accel;
  step { publish accel = motion.v > 0.0 ? A : -A; }
}
node Careful period 50ms {
  subscribes motion;
  publishes accel;
  step { publish accel = law(motion); }
}
fun law(m: Motion): float { return clamp(-4.0 * m.x - 4.0 * m.v, -A, A); }
fun Stop(x: float, v: float, tau: float): float {
  let w = max(v, 0.0) + TOP * tau;
  return x + max(v, 0.0) * tau + 0.5 * TOP * tau * tau + w * w / (1.7 * A);
}
fun Fits(m: Motion, tau: float): bool {
  return Stop(m.x, m.v, tau) < WALL - 0.2 && Stop(-m.x, -m.v, tau) < WALL - 0.2 && abs(m.v) < 2.0;
}
rta SafeCart {
  ac Fast;
  sc Careful;
  period 50ms;
  safe abs(motion.x) < WALL;
  ttf !Fits(motion, 0.12);
  safer Fits(motion, 0.25);
  verify { grid motion.x in [-WALL, WALL] / 40, motion.v in [-2.5, 2.5] / 40; late sc 1ms, dm 1ms; }
}
"""
ONE = "system Track default { c: Cart; module SafeCart; }"
ABSTRACT = TEXT.replace("verify { ", "verify { abstracts c by q: Cart = c.truth; ")


def with_numbers(text: str, top: str, **others: str) -> str:
    """The text without parameters: `top` in the set of the topic, others everywhere."""
    text = re.sub(r"param .*\n", "", text).replace("[-TOP, TOP]", f"[-{top}, {top}]")
    for name, value in others.items():
        text = re.sub(rf"\b{name}\b", value, text)
    return text


def proved(path: Path, text: str, **options: Any) -> list[tuple[object, ...]]:
    """Of every module its verdicts and how many cells its sets have."""
    path.write_text(text)
    report = soter.load(path).verify(refute=False, **options)
    return [
        (
            {n: (f.verdict, f.method, f.text) for n, f in m.findings.items() if n != "DM"},
            m.shares,
        )
        for m in report.modules
    ]


@pytest.mark.parametrize(
    "text", [TEXT, ABSTRACT], ids=["beside its plant", "beside an abstraction"]
)
def test_a_module_is_proved_with_its_own_parameters_and_the_topics_around_it(
    text: str, tmp_path: Path
) -> None:
    own = "{ set TOP = 2.5, set A = 2.5, set WIND = 0.2, set WALL = 1.9 }"
    plant = "" if text is ABSTRACT else " { set WIND = 0.2 }"
    system = f"system Track default {{ c: Cart{plant}; module SafeCart {own}; }}"
    numbers = with_numbers(text + ONE, "3.0", TOP="2.5", A="2.5", WIND="0.2", WALL="1.9")
    one = proved(tmp_path / "one.soter", text + system, cert=tmp_path / "cert")
    assert one == proved(tmp_path / "one.soter", numbers)
    flat = system_of(check_file("t.soter", text + system), "Track")
    problem = extract(flat, flat.modules[0])
    bounds = {t.name: t.bounds[0] for t in problem.system.topics}
    assert bounds["accel"] is not None
    assert bounds["accel"].high == 3.0
    told = recheck(tmp_path / "cert")
    assert told.accepted, told


WIRED = """topic seen: Motion{values} max_age 20ms;
system Robot {{ c: Cart; module SafeCart; }}
system Track default {{ r: Robot {{ motion = seen }}; }}
"""


@all_rows(("values", "refused"), [("", False), (" in { x in [-9.0, 9.0] }", True)])
def test_a_module_is_rechecked_among_topics_like_those_that_fly(values: str, refused: bool) -> None:
    """What a plant publishes outside of a set stops it, and the proof would not know."""
    checked = check_file("t.soter", ABSTRACT + WIRED.format(values=values))
    flat = system_of(checked, "Track", {}, exact=False)
    with pytest.raises(NotRecheckedError, match="has another set") if refused else nullcontext():
        read_facts(flat, "r.SafeCart")


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(TEXT, id="beside its plant"),
        pytest.param(ABSTRACT, id="beside an abstraction", marks=pytest.mark.long),
    ],
)
@pytest.mark.long
def test_every_element_is_a_problem_of_its_own_and_so_says_its_certificate(
    text: str, tmp_path: Path
) -> None:
    fleet = (
        "system Robot { c: Cart; module SafeCart; }\n"
        "system Fleet default { for i in 0..2 { r[i]: Robot { set WALL = i == 0 ? 2.0 : 1.9 }; } }"
    )
    path = tmp_path / "fleet.soter"
    proofs = proved(path, text + fleet, cert=tmp_path / "cert", params={"r[1].A": 2.5})
    for i, (wall, a) in enumerate((("2.0", "3.0"), ("1.9", "2.5"))):
        numbers = with_numbers(text + ONE, "3.0", TOP="3.0", A=a, WIND="0.1", WALL=wall)
        assert proofs[i] == proved(tmp_path / "alone.soter", numbers)[0]
    told = recheck(tmp_path / "cert")
    assert told.accepted, told
    manifest = json.loads((tmp_path / "cert" / "manifest.json").read_text())
    params = manifest["params"]
    assert {n: float.fromhex(v) for n, v in params.items() if "." in n} == {
        "r[0].WALL": 2.0,
        "r[1].WALL": 1.9,
        "r[1].A": 2.5,
    }
