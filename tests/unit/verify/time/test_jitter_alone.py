"""`jitter` of who says no `wcet`: the thread is late by it, and a proof has to count with that.

Every execution of small threads is gone through, step by step by the definition (docs/timing.md):
start(k) = max(end(k - 1), t_k + j), end(k) = start(k) + c, 0 <= j <= J, 0 <= c <= C.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from generators.switch_threads import Step, ends_of, starts
from soter.api.check_report import timing_reports
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from collections.abc import Mapping

CASES = 160
TURNS = 3
PLANS = """soter 1;
type Plan = enum {{ Hover, Around, Through }};
topic candidate: Plan;
topic inForce: Plan;
node Any period {Any}us {{
  publishes candidate; {Any_says}
  step {{ publish candidate = choose Plan; }} }}
node Hold period {Hold}us {{
  publishes candidate; {Hold_says}
  step {{ publish candidate = Plan.Hover; }} }}
node Follower period {Follower}us phase {phase}us {{
  subscribes candidate; publishes inForce; {Follower_says}
  var plan: Plan;
  step {{ if age(candidate) > seconds(30ms) {{ plan = candidate; }} publish inForce = plan; }}
}}
rta P {{
  ac Any; sc Hold; period {dm}us; {dm_says}
  safe inForce != Plan.Through; ttf candidate == Plan.Through; safer candidate != Plan.Through;
  verify {{ induction; {verify} }}
}}
system S {{ node Follower; module P; until 1s; }}
"""
THREAD = ("dm", "Hold", "Follower", "Any")
"""In its order within an instant."""


def codes_of(text: str) -> list[str]:
    checked = check_file("plans.soter", text)
    assert checked.ok, checked.diagnostics.items
    flat = system_to_prove(checked, "S")
    try:
        extract(flat, flat.modules[0])
    except SoterError as error:
        return [d.code for d in error.diagnostics]
    return []


def text_of(
    every: Mapping[str, int], said: Mapping[str, str], phase: int = 0, verify: str = ""
) -> str:
    """A planner with these periods in us, and what its components say of their times."""
    says = {f"{n}_says": said.get(n, "") for n in THREAD}
    return PLANS.format(**every, **says, phase=phase, verify=verify)


TENS = {"dm": 20_000, "Hold": 10_000, "Any": 10_000, "Follower": 10_000}


def test_an_induction_counts_with_jitter_that_stands_alone() -> None:
    """The follower reads up to 6 ms late what was published up to 4 ms early: nothing of 30 ms."""
    late = {"Hold": "jitter 4ms;", "Follower": "jitter 6ms;"}
    assert codes_of(text_of(TENS, {})) == []
    assert codes_of(text_of(TENS, late)) == ["R033"]
    enough = "late sc 4ms, Follower 6ms, Any 6ms;"
    assert codes_of(text_of(TENS, late, verify=enough)) == []


@pytest.mark.parametrize("says", ["jitter 4ms;", "wcet 4ms;"])
def test_an_induction_counts_with_what_an_ac_elsewhere_says(says: str) -> None:
    says_it = "publishes candidate; \n  step { publish candidate = choose Plan; } }"
    here = f"node Any period 10000us {{\n  {says_it}"
    there = f'extern node Any period 10000us from "c:a.c:a" {{ publishes candidate; {says} }}'
    enough = text_of(TENS, {}, verify="late Any 4ms; response Any 4ms;")
    assert here in enough
    assert codes_of(text_of(TENS, {}).replace(here, there)) == ["R033"]
    assert codes_of(enough.replace(here, there)) == []


def test_the_table_of_check_says_who_has_no_wcet() -> None:
    checked = check_file("plans.soter", text_of(TENS, {"Follower": "jitter 6ms;"}))
    (timing,), diagnostics = timing_reports([system_to_prove(checked, "S")])
    assert timing.verdict == "undecided"
    assert set(timing.missing) == {"P.dm", "P.Hold", "P.Any", "Follower"}
    assert [d.code for d in diagnostics] == ["R033"]


def executions(thread: list[Step], module: dict[str, tuple[int, int]]) -> bool:
    """Whether J and R of `module` hold in every execution of some turns; all in ticks."""
    turn = max(s.every for s in thread)  # the periods of a family divide the greatest
    releases = sorted(
        (at, k) for k, s in enumerate(thread) for at in range(s.offset, TURNS * turn, s.every)
    )
    ends = {0}
    for at, k in releases:
        step = thread[k]
        begun = starts(step, at, ends)
        ends = ends_of(step, begun)
        late, response = module[step.name]
        allowed = at + late
        if step.name == "Hold":  # it may also wait for the verdict that is due
            dm = thread[0]
            due = at - (at - dm.offset) % dm.every
            allowed = max(allowed, due + sum(module["dm"]))
        if max(begun) > allowed or step.cost > response:
            return False
    return True


@pytest.mark.parametrize("seed", range(2))
def test_what_is_accepted_holds_in_every_execution_and_what_is_refused_in_not_all(
    seed: int,
) -> None:
    rng = random.Random(seed)  # noqa: S311
    accepted = refused = 0
    for _ in range(CASES // 2):
        sc = rng.choice((8, 12))
        every = {"dm": 24, "Hold": sc, "Any": sc, "Follower": rng.choice((8, 12, 24))}
        phase = rng.choice((0, 0, 1, 5))
        cost = {n: rng.choice((0, 0, 0, 1, 2)) for n in THREAD}
        hold = {n: rng.choice((0, 0, 1, 2, 3)) for n in THREAD}
        late = {n: rng.randint(0, 4) for n in THREAD}
        takes = {n: max(0, cost[n] + rng.choice((0, 0, 0, 1, -1))) for n in THREAD}
        names = {"dm": "dm", "Hold": "sc", "Any": "Any", "Follower": "Follower"}
        verify = "".join(
            f"{word} " + ", ".join(f"{names[n]} {us}us" for n, us in of.items()) + "; "
            for word, of in (("late", late), ("response", takes))
        )
        said = {
            n: (f"wcet {cost[n]}us; " if cost[n] else "")
            + (f"jitter {hold[n]}us;" if hold[n] else "")
            for n in THREAD
        }
        codes = codes_of(text_of(every, said, phase, verify))
        if not any(cost.values()) and not any(hold.values()):
            continue
        if not set(codes) <= {"R033"}:
            continue  # a deadline, or windows that overlap: not what is asked here
        offsets = {n: phase if n == "Follower" else 0 for n in THREAD}
        thread = [Step(n, every[n], offsets[n], cost[n], hold[n]) for n in THREAD]
        holds = executions(thread, {n: (late[n], takes[n]) for n in THREAD})
        assert holds == (not codes), (every, phase, said, verify)
        accepted, refused = accepted + holds, refused + (not holds)
    assert accepted > 4
    assert refused > 4
