"""Nodes between plant and module are followed: their age, their first step, what they leave out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from bench.recheck.small_modules import PROGRAMS

import soter
from soter.api import recheck
from soter.certificate.case_check import p1c_verdict
from soter.certificate.reading.module_facts import DiffersError
from soter.certificate.report import NotRecheckedError
from soter.certificate.scope import assumptions_of
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.reading.module_facts import Facts

MS = 1_000_000


def facts_of(folder: Path, *pairs: tuple[str, str]) -> Facts:
    text = PROGRAMS["flying"]
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    (folder / "small.soter").write_text(text)
    return small_proofs.facts_of(folder / "small.soter", "S", "M")


def test_times_of_nodes_on_the_way_count(tmp_path: Path) -> None:
    facts = facts_of(tmp_path)
    (read,) = facts.setting.by_sc
    (path,) = read.paths
    assert [n.name for n in path.clocks[1:]] == ["Estimate"]
    (effect,) = facts.setting.effects
    assert [n.name for n in effect.clocks] == ["Driver"]
    assert facts.times["A_ns"] == 30 * MS + path.longest_lag(0) == 32 * MS
    # SC waits 3 ms, takes 1; the driver steps by 5 and takes 1; 1 until it acts
    assert facts.times["j_ns"] == 7 * MS
    assert p1c_verdict(facts) == "proved"


def test_a_driver_without_times_runs_behind_sc(tmp_path: Path) -> None:
    facts = facts_of(tmp_path, (", Driver 0ms", ""), (", Driver 1ms", ""))
    (effect,) = facts.setting.effects
    assert not effect.clocks
    assert "in step Driver" in {a.key for a in assumptions_of(facts)}


def test_an_estimate_without_times_makes_p1c_assumed(tmp_path: Path) -> None:
    facts = facts_of(tmp_path, (", Estimate 1ms, Driver 1ms", ", Driver 1ms"))
    assert p1c_verdict(facts) == "assumed"
    assert "undeclared Estimate" in {a.key for a in assumptions_of(facts)}


def test_an_age_of_reads_that_periods_do_not_keep_is_refused(tmp_path: Path) -> None:
    facts = facts_of(tmp_path)
    oldest_ms = -(-max(facts.derived.stamps.values()) // 1_000_000)
    assert oldest_ms > 1
    aged = facts_of(tmp_path, ("verify {", f"verify {{ age {oldest_ms}ms;"))
    assert aged.derived == facts.derived
    with pytest.raises(DiffersError, match="R011"):
        facts_of(tmp_path, ("verify {", f"verify {{ age {oldest_ms - 1}ms;"))


def test_a_publisher_that_is_too_slow_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DiffersError, match="R011"):
        facts_of(tmp_path, ("node Estimate period 10ms", "node Estimate period 1s"))


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("{ publish x = raw; }", "{ if raw > 0.0 { publish x = raw; } }", "in every step"),
        ("{ publish force = u; }", "{ if u > 0.0 { publish force = u; } }", "in every step"),
        ("subscribes raw; publishes x; step { publish x = raw; }",
         "subscribes raw queue 2; publishes x; step { publish x = raw[0]; }", "a queue"),
        ("Estimate 1ms, Driver 0ms", "Estimate 10ms, Driver 0ms", "may not be over"),
    ],
)  # fmt: skip
def test_nodes_that_leave_out_values_are_not_rechecked(
    tmp_path: Path, old: str, new: str, why: str
) -> None:
    with pytest.raises(NotRecheckedError, match=why):
        facts_of(tmp_path, (old, new))


def test_a_step_that_faults_is_a_reason(tmp_path: Path) -> None:
    """Found by `bench/recheck/overstated.py`: it came out as an exception."""
    path = tmp_path / "small.soter"
    path.write_text(PROGRAMS["assumed"])
    soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    small_proofs.edit_program(
        tmp_path / "cert", ("step { publish u = clamp", "step { assert false; publish u = clamp")
    )
    report = recheck(tmp_path / "cert")
    assert not report.accepted
    small_proofs.edit_program(
        tmp_path / "cert", ("assert false;", "let zero = 0.0; assert 1.0 / zero > 0.0;")
    )
    report = recheck(tmp_path / "cert")
    assert not report.accepted
    assert "faults" in report.reason


LOG = """topic seen: int in [0, 9] = 0;
node Log period 50ms {
  subscribes SUBSCRIBED;
  publishes seen;
  step { publish seen = 1; }
}
node Slow"""


def beside(folder: Path, subscribed: str) -> Facts:
    """The plain module, and a node that listens to it and leads nowhere."""
    text = PROGRAMS["written"].replace("node Slow", LOG.replace("SUBSCRIBED", subscribed), 1)
    path = folder / "small.soter"
    path.write_text(text.replace("module M; until", "module M; node Log; until"))
    return small_proofs.facts_of(path, "S", "M")


@pytest.mark.parametrize("subscribed", ["u", "x", "u, x"])
def test_a_node_that_leads_nowhere_changes_no_time(tmp_path: Path, subscribed: str) -> None:
    plain = tmp_path / "plain.soter"
    plain.write_text(PROGRAMS["written"])
    facts, alone = beside(tmp_path, subscribed), small_proofs.facts_of(plain, "S", "M")
    assert not facts.ways.notes
    assert facts.times == alone.times
    assert assumptions_of(facts) == assumptions_of(alone)


@pytest.mark.parametrize("subscribed", ["u queue 3", "x queue 3", "u, x queue 3"])
def test_a_node_with_a_queue_is_not_followed(tmp_path: Path, subscribed: str) -> None:
    with pytest.raises(NotRecheckedError, match="reads a queue of"):
        beside(tmp_path, subscribed)


TWO = """soter 1;
topic x: float max_age 30ms;
topic y: float max_age 30ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant A period 10ms { reads u; drives x = q; state q: float; der q = u; }
plant B period 10ms { reads u; drives y = q; state q: float; der q = -u; }
node Fast period 50ms { subscribes x; publishes u; step { publish u = 1.0; } }
node Slow period 50ms {
  subscribes x, y; publishes u; step { publish u = clamp(-x - y, -1.0, 1.0); }
}
rta M {
  ac Fast; sc Slow; period 50ms;
  safe abs(x) < 3.0; ttf abs(x) > 2.0; safer abs(x) < 1.0;
  verify {
    abstracts d by m: A = { q: d.truth.q };
    abstracts e by n: B = { q: e.truth.q };
    grid x in [-3.0, 3.0] / 60; grid y in [-3.0, 3.0] / 60;
  }
}
system S { d: A; e: B; module M; }
"""


def test_a_topic_shows_the_plant_whose_abstraction_drives_it(tmp_path: Path) -> None:
    path = tmp_path / "two.soter"
    path.write_text(TWO)
    small_proofs.facts_of(path, "S", "M")
    path.write_text(TWO.replace("d: A; e: B;", "d: B; e: A;"))
    with pytest.raises(DiffersError, match="`x` is said to show `d`, which is not behind it"):
        small_proofs.facts_of(path, "S", "M")
