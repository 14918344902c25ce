"""What only SC reads: an "AC" verdict does not show that it is there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import soter
from soter.api import recheck
from soter.certificate.case_check import check_static_claims
from soter.certificate.reading.problem import read_facts
from soter.certificate.report import RejectedError
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of

if TYPE_CHECKING:
    from pathlib import Path

#: The DM sees `near`, which is there at once; SC sees `far`, of a node that publishes every 200 ms.
TEXT = """soter 1;
topic raw: float max_age 20ms;
topic near: float max_age 20ms;
topic far: float max_age 250ms;
topic u: float in [-1.0, 1.0];
plant Real period 10ms { reads u; drives raw = p; drives near = p; state p: float; der p = u; }
plant Model period 10ms {
  reads u; drives near = q; drives far = q; state q: float; der q = u;
}
node Far period 200ms phase 100ms { subscribes raw; publishes far; step { publish far = raw; } }
node Fast period 20ms { subscribes near; publishes u; step { publish u = 1.0; } }
node Slow period 20ms {
  subscribes far; publishes u; step { publish u = clamp(-0.3 * far, -1.0, 1.0); }
}
rta M { ac Fast; sc Slow; period 20ms;
  safe abs(near) < 3.0; ttf abs(near) > 1.0; safer abs(near) < 0.5;
  verify { abstracts r by m: Model = { q: r.truth.p }; grid near in [-3.0, 3.0] / 300; HORIZON } }
system S { r: Real; node Far; module M; }
"""


def test_the_horizon_covers_the_first_read_of_what_sc_alone_sees(tmp_path: Path) -> None:
    path = tmp_path / "blind.soter"
    path.write_text(TEXT.replace("HORIZON", ""))
    problem = soter.load(path).verify(cert=tmp_path / "cert", refute=False).modules[0].problem
    times = problem.times
    assert times.h_star == times.start > times.schedule.h_star
    assert "P1c" not in recheck(tmp_path / "cert").reason


def test_a_shorter_horizon_is_refused_by_both(tmp_path: Path) -> None:
    text = TEXT.replace("HORIZON", "horizon 60ms;")
    path = tmp_path / "short.soter"
    path.write_text(text)
    try:
        verdict = soter.load(path).verify(refute=False).modules[0].findings["P1c"].verdict
    except SoterError:
        verdict = "refused"
    assert verdict != "proved"
    checked = check_file(str(path))
    facts = read_facts(system_of(checked, None), "M")
    with pytest.raises(RejectedError, match=r"which the DM does not read|shorter than"):
        check_static_claims(facts, {"P1c": "assumed", "P2a": "proved"})
