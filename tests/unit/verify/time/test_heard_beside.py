"""Nodes before a module that listen to what its proof knows nothing of: told, not followed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import soter
from soter.verify.problem.problem import assumption_texts

if TYPE_CHECKING:
    from pathlib import Path

    from soter.verify.claims.results import VerifyReport

PROGRAM = """soter 1;
topic seen: float max_age 20ms;
topic x: float max_age 11ms;
topic u: float in [-1.0, 1.0];
topic level: float max_age 100ms;
topic valve: float in [0.0, 1.0];
topic plan: float;
topic offer: float in [-1.0, 1.0];

plant Real period 10ms {{ reads u; drives seen = p; state p: float; der p = u; }}
plant Model period 10ms {{ reads u; drives x = q; state q: float; der q = u; }}
plant Tank period 100ms {{ reads valve; drives level = h; state h: float = 1.0; der h = -0.1 * h; }}
node Filter period 10ms phase 5ms {{
  subscribes seen, plan;
  publishes x;
  step {{ publish x = seen + 0.0 * plan; }}
}}
node Planner period 100ms {{
  subscribes {heard};
  publishes plan;
  step {{ publish plan = {said}; }}
}}
node Fill period 100ms {{
  subscribes level;
  publishes valve, offer;
  step {{ publish valve = clamp(level, 0.0, 1.0); publish offer = 0.0; }}
}}
node Shut period 100ms {{
  publishes valve, offer;
  step {{ publish valve = 0.0; publish offer = 0.0; }}
}}
node Fast period 10ms {{
  subscribes x;
  publishes u;
  step {{ publish u = clamp(2.0 - x, -1.0, 1.0); }}
}}
node Slow period 10ms {{
  subscribes x;
  publishes u;
  step {{ publish u = clamp(-x, -1.0, 1.0); }}
}}
rta Keep {{
  ac Fast;
  sc Slow;
  period 10ms;
  safe abs(x) < 3.0;
  ttf abs(x) > 2.0;
  safer abs(x) < 1.0;
  verify {{
    abstracts r by m: Model = {{ q: r.truth.p }};
    grid x in [-3.0, 3.0] / 120;
    late dm 0ms, sc 0ms, Filter 0ms{too};
    response dm 0ms, sc 0ms, Filter 0ms{too};
    acts within 0ms;
  }}
}}
rta Level {{
  ac Fill;
  sc Shut;
  period 100ms;
  safe level < 9.0;
  ttf level > 5.0;
  safer level < 4.0;
}}
system S {{
  r: Real;
  t: Tank;
  node Planner;
  node Filter;
  module Keep;
  module Level;
}}
"""


def verified(tmp_path: Path, heard: str, said: str, name: str = "p") -> VerifyReport:
    path = tmp_path / f"{name}.soter"
    too = ", Planner 0ms" if "seen" in heard else ""  # else its times count for nothing: R017
    path.write_text(PROGRAM.format(heard=heard, said=said, too=too), encoding="utf-8")
    return soter.load(path).verify("Keep", refute=False, cert=tmp_path / name)


@pytest.mark.parametrize(
    ("heard", "said", "who"),
    [
        ("level", "level", {"t"}),
        ("offer", "offer", {"Level.Fill", "Level.Shut"}),
        ("level, offer", "level + offer", {"t", "Level.Fill", "Level.Shut"}),
    ],
)
def test_what_is_heard_beside_is_told_and_adds_no_age(
    tmp_path: Path, heard: str, said: str, who: set[str]
) -> None:
    report = verified(tmp_path, heard, said)
    (module,) = report.modules
    assert module.verdict == "proved"
    told = [a for a in assumption_texts(module.assumptions) if "knows nothing" in a]
    assert {a.partition(",")[0] for a in told} == who
    recheck_report = soter.recheck(tmp_path / "p")
    assert recheck_report.accepted
    again = [
        a.text for m in recheck_report.modules for a in m.assumptions if "knows nothing" in a.text
    ]
    assert {a.partition(",")[0] for a in again} == who


@pytest.mark.long
def test_the_plant_of_the_proof_is_followed_through_whoever_hears_it(tmp_path: Path) -> None:
    """100 ms through `Planner` are more than a horizon of 20 ms less has room for."""
    alone = verified(tmp_path, "level", "level", "alone").modules[0].problem.times.h_star
    through = verified(tmp_path, "seen", "seen", "through").modules[0].problem.times.h_star
    assert through >= alone + 90_000_000


def test_a_topic_that_only_others_publish_shows_nothing(tmp_path: Path) -> None:
    path = tmp_path / "p.soter"
    text = PROGRAM.format(heard="offer", said="offer", too="").replace("seen + 0.0 * plan", "plan")
    path.write_text(text.replace("subscribes seen, plan", "subscribes plan"), encoding="utf-8")
    with pytest.raises(soter.SoterError, match="R017"):
        soter.load(path).verify("Keep", refute=False)
