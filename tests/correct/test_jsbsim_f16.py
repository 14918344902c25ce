"""JSBSim's F-16 before the module of examples/rest/dive.soter: a pilot who never pulls up."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("jsbsim", reason="the extra `simulators` is not installed")
pytest.importorskip("gymnasium", reason="the extra `learn` is not installed")

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from bench.tubes import dives  # noqa: E402
from bench.tubes.jsbsim_f16 import Jet, Pilot  # noqa: E402

from soter.gym.safety_warnings import SafetyWarning  # noqa: E402

pytestmark = pytest.mark.long

AIMS = next(s for s in range(4, 100) if Pilot.WAYS[s % len(Pilot.WAYS)] == "aims")


def test_who_aims_at_the_ground_hits_it_alone_and_not_with_the_module() -> None:
    assert dives.alone(Jet(), AIMS).hit
    flown = dives.protected(dives.behind_module(), AIMS)
    assert not flown.hit
    assert flown.takeovers > 0
    assert not flown.alarms


def test_bounds_that_are_too_small_are_an_alarm(tmp_path: Path) -> None:
    text = dives.PROGRAM.read_text(encoding="utf-8")
    small = tmp_path / "small.soter"
    small.write_text(text.replace("[-11.0, 11.0]", "[-0.5, 0.5]"), encoding="utf-8")
    assert small.read_text() != text
    with pytest.warns(SafetyWarning, match="is outside of the proof"):
        assert dives.protected(dives.behind_module(small), AIMS).alarms
