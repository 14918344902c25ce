"""Execution times that a program declares, against the times that its proof counts with.

The prover (R033, R034) and the re-checker read them on their own; here they have to agree.
"""

from __future__ import annotations

import random
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from bench.recheck.small_modules import PROGRAMS

import soter
from long_tests import examples, seed_of
from soter.api import recheck
from soter.api.check_report import timing_reports
from soter.certificate.reading.module_facts import DiffersError
from soter.certificate.report import NotRecheckedError
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import assumption_texts
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Mapping

CORRIDOR = Path(__file__).parents[4] / "examples" / "drone" / "corridor.soter"
DRAWS = examples(60)
DECLARED = {
    "Estimate": "node Estimate period 10ms {",
    "Driver": "node Driver period 5ms {",
    "Slow": "node Slow period 50ms {",
    "Fast": "node Fast period 50ms {",
    "M": "rta M {",
}
FITS = {
    "Estimate": (300, 100),
    "Driver": (200, 50),
    "Slow": (499, 0),
    "Fast": (1, 0),
    "M": (100, 200),
}
"""Node -> wcet and jitter in us."""
GIVEN = (
    "    late dm 2ms, sc 1ms, Estimate 2ms, Driver 2ms;\n"
    "    response dm 1ms, sc 1ms, Estimate 1ms, Driver 1ms;\n"
)
SAID = (
    "    late dm 2ms, sc 1ms, Estimate 4ms, Driver 3800us;\n"
    "    response dm 1ms, sc 1ms, Estimate 1ms, Driver 1ms;\n"
)


def text(times: Mapping[str, tuple[int, int]], *more: str, verify: str = GIVEN) -> str:
    """The small program that flies, with execution times; `more`: other nodes of its system."""
    source = PROGRAMS["flying"]
    for name, (wcet, jitter) in times.items():
        assert DECLARED[name] in source
        source = source.replace(
            DECLARED[name], f"{DECLARED[name]} wcet {wcet}us; jitter {jitter}us;"
        )
    names = [m.partition("node ")[2].split()[0] for m in more]
    source = source.replace("system S", "\n".join(more) + "\nsystem S", 1)
    source = source.replace("module M;", "module M; " + " ".join(f"node {n};" for n in names), 1)
    start = source.index("    late dm")
    return source[:start] + verify + source[source.index("    acts within") :]


def said(folder: Path, program: str) -> list[str]:
    """The codes that the prover has for it."""
    path = folder / "timed.soter"
    path.write_text(program)
    checked = check_file(str(path))
    assert checked.ok, checked.diagnostics.items
    flat = system_to_prove(checked, "S")
    try:
        extract(flat, flat.modules[0])
    except SoterError as error:
        return [d.code for d in error.diagnostics]
    return []


def rechecked(folder: Path, program: str) -> str:
    """What the re-checker has against its times, or nothing."""
    path = folder / "timed.soter"
    path.write_text(program)
    try:
        small_proofs.facts_of(path, "S", "M")
    except DiffersError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(("period", "refused"), [("10ms", False), ("9999us", True)])
def test_a_thread_is_gone_through_for_as_many_releases_as_is_said(
    tmp_path: Path, period: str, refused: bool
) -> None:
    """With a period that fits to no other one all of them begin together every 17 minutes."""
    odd = f"node Odd period {period} {{ publishes odd; wcet 1us; step {{ publish odd = 1.0; }} }}"
    program = text(FITS, odd).replace("topic u:", "topic odd: float;\ntopic u:", 1)
    with pytest.raises(NotRecheckedError, match="too many") if refused else nullcontext():
        assert rechecked(tmp_path, program) == ""


def test_times_that_fit_are_part_of_a_proof_and_its_certificate_is_accepted(
    tmp_path: Path,
) -> None:
    path = tmp_path / "small.soter"
    path.write_text(text(FITS))
    verify_report = soter.load(path).verify(refute=False, cert=tmp_path / "cert")
    assert any(
        "`wcet` and `jitter` hold" in a
        for a in assumption_texts(verify_report.modules[0].assumptions)
    )
    report = recheck(tmp_path / "cert")
    assert report.accepted, report.reason


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("M", (100, 2001)),  # starts later than `late dm` allows
        ("M", (1001, 200)),  # takes longer than `response dm`
        ("Slow", (1001, 0)),
        ("Estimate", (1001, 0)),
        ("Driver", (1001, 0)),
        ("Slow", (400, 3101)),  # later than `late sc`, and than the verdict is waited for
    ],
)
def test_times_that_do_not_are_refused_by_both(
    name: str, times: tuple[int, int], tmp_path: Path
) -> None:
    program = text({**FITS, name: times})
    assert said(tmp_path, program) == ["R033"]
    assert rechecked(tmp_path, program) != ""


def test_the_longest_wait_for_the_verdict_is_no_lateness_of_sc(tmp_path: Path) -> None:
    """`late sc 1ms`, and `late dm 2ms; response dm 1ms`: SC may start 3 ms after its release."""
    program = text({**FITS, "M": (1000, 2000)}, verify=SAID)
    assert said(tmp_path, program) == []
    assert rechecked(tmp_path, program) == ""


def test_what_the_proof_does_not_look_at_holds_it_up_all_the_same(tmp_path: Path) -> None:
    body = "publishes unused; wcet 5500us; step { publish unused = 1.0; }"
    blocker = f"node Blocker period 40ms phase 7ms {{ {body} }}"
    topic = "topic unused: float;\n"
    program = text(FITS, blocker).replace("topic raw", topic + "topic raw", 1)
    assert said(tmp_path, program) == ["R033"]
    assert "may start" in rechecked(tmp_path, program)


def test_a_deadline_of_a_node_that_the_proof_does_not_look_at_counts_too(tmp_path: Path) -> None:
    long = "publishes unused; wcet 4ms; step { publish unused = 1.0; }"
    often = "publishes often; wcet 10us; step { publish often = 1.0; }"
    program = text(
        FITS,
        f"node Blocker period 50ms phase 7ms {{ {long} }}",
        f"node Often period {{}} {{ {often} }}",
    ).replace("topic raw", "topic unused: float;\ntopic often: float;\ntopic raw", 1)
    for period, codes in (("5ms", []), ("2ms", ["R034"])):
        tried = program.replace("node Often period {}", f"node Often period {period}")
        assert said(tmp_path, tried) == codes
        assert ("released again" in rechecked(tmp_path, tried)) == bool(codes)


def test_a_thread_with_too_much_to_do_is_refused_by_both(tmp_path: Path) -> None:
    program = text({**FITS, "Driver": (4900, 0)})
    assert said(tmp_path, program) == ["R034"]
    assert rechecked(tmp_path, program) != ""


def test_who_has_no_wcet_is_named_and_counted_as_nothing(tmp_path: Path) -> None:
    path = tmp_path / "small.soter"
    path.write_text(text({n: t for n, t in FITS.items() if n != "Estimate"}))
    checked = check_file(str(path))
    flat = system_to_prove(checked, "S")
    rests = assumption_texts(extract(flat, flat.modules[0]).assumptions)
    assert any("no `wcet` is said of Estimate" in a for a in rests)
    assert "Estimate" in small_proofs.facts_of(path, "S", "M").thread


def test_an_extern_node_costs_the_thread_nothing_until_it_is_inline(tmp_path: Path) -> None:
    watch = "extern node Watch period 10ms { subscribes x; wcet 5ms; }"
    program = text(FITS, watch)
    assert said(tmp_path, program) == []
    assert rechecked(tmp_path, program) == ""
    inline = program.replace("node Watch; node Driver;", "node Watch; node Driver; inline Watch;")
    assert inline != program
    assert said(tmp_path, inline) == ["R034"]
    assert rechecked(tmp_path, inline) != ""


IN_STEP = "    late dm 2ms, sc 1ms, Estimate 2ms;\n    response dm 1ms, sc 1ms, Estimate 1ms;\n"


@pytest.mark.parametrize(
    ("driver", "between", "fits"),
    [
        ((200, 0), "", True),  # 499 us of SC, 1 of AC, 300 of Estimate, 200: `response sc 1ms`
        ((201, 0), "", False),
        ((200, 800), "", True),  # its release may be waited for: 800 us, from the instant on
        ((200, 801), "", False),
        ((100, 0), "wcet 100us;", True),
        ((100, 0), "wcet 101us;", False),
        ((100, 0), "wcet 100us; jitter 800us;", True),
        ((100, 0), "wcet 100us; jitter 801us;", False),
    ],
)
def test_what_a_node_behind_sc_takes_counts_as_its_response(
    driver: tuple[int, int], between: str, fits: bool, tmp_path: Path
) -> None:
    program = text({**FITS, "Driver": driver}, verify=IN_STEP)
    if between:
        body = f"publishes unused; {between} step {{ publish unused = 1.0; }}"
        node = f"node Between period 10ms {{ {body} }}"
        program = program.replace("topic raw", f"topic unused: float;\n{node}\ntopic raw", 1)
        program = program.replace("node Driver; }", "node Between; node Driver; }")
        assert "node Between;" in program
    assert said(tmp_path, program) == ([] if fits else ["R033"])
    assert (rechecked(tmp_path, program) == "") == fits


def test_of_a_module_with_views_it_is_said_once_where_its_times_stand() -> None:
    checked = check_file(str(CORRIDOR))
    flat = system_to_prove(checked, None)
    for c in flat.components:
        c.wcet_ns = 80_000 if c.in_thread else None
    (timing,), untimely = timing_reports([flat])
    (problem,) = untimely
    assert problem.code == "R033"
    assert "SC may take 480 us from its start" in problem.notes[0]
    assert problem.primary is not None
    assert problem.primary.span.text.startswith("verify {")
    assert [s.verdict for s in timing.switches] == ["undecided"]  # the proof counts with others


PLANS = """soter 1;
type Plan = enum {{ Hover, Around, Through }};
topic candidate: Plan;
topic inForce: Plan;
fun good(p: Plan): bool {{ return p != Plan.Through; }}
node Any period 10ms {{
  publishes candidate;
  wcet 50us;
  step {{ publish candidate = choose Plan; }}
}}
node Hold period 10ms {{
  publishes candidate;
  wcet 100us;
  step {{ publish candidate = Plan.Hover; }}
}}
node Follower period 10ms {{
  subscribes candidate;
  publishes inForce;
  wcet 200us;
  var plan: Plan;
  step {{
    if age(candidate) > seconds(30ms) {{ plan = candidate; }}
    publish inForce = plan;
  }}
}}
rta Planner {{
  ac Any;
  sc Hold;
  period 20ms;
  wcet 50us;
  safe good(inForce);
  ttf !good(candidate);
  safer good(candidate);
  verify {{ induction; lemma good(candidate) || age(candidate) <= seconds(30ms); {times} }}
}}
system S default {{ node Follower; module Planner; until 1s; }}
"""


@pytest.mark.parametrize(
    ("times", "fits"),
    [
        ("", False),
        (
            "response dm 50us, sc 100us, Any 50us, Follower 200us; late Any 350us, Follower 150us;",
            True,
        ),
        (
            "response dm 50us, sc 100us, Any 50us, Follower 200us; late Any 350us, Follower 149us;",
            False,
        ),
        (
            "response dm 50us, sc 99us, Any 50us, Follower 200us; late Any 350us, Follower 150us;",
            False,
        ),
        (
            "response dm 50us, sc 100us, Any 50us, Follower 200us; late Any 349us, Follower 150us;",
            False,
        ),
        ("response sc 100us, Follower 200us; late sc 50us, Follower 150us;", False),
    ],
)
def test_an_induction_counts_with_times_that_the_thread_keeps(
    times: str, fits: bool, tmp_path: Path
) -> None:
    assert said(tmp_path, PLANS.format(times=times)) == ([] if fits else ["R033"])


@pytest.mark.random
def test_prover_and_rechecker_agree_on_random_threads(tmp_path: Path) -> None:
    rng = random.Random(seed_of(20261122))  # noqa: S311
    refused = 0
    for _ in range(DRAWS):
        longest = {"Fast": 99}
        times = {
            n: (rng.randint(1, longest.get(n, 900)), rng.choice((0, rng.randint(0, 900))))
            for n in FITS
        }
        late = {n: rng.randint(0, 4000) for n in ("dm", "sc", "Estimate", "Driver")}
        owner = {"dm": "M", "sc": "Slow"}
        takes = {n: times[owner.get(n, n)][0] + rng.choice((0, 0, 0, -1, 50)) for n in late}
        verify = "".join(
            f"    {word} " + ", ".join(f"{n} {us}us" for n, us in of.items()) + ";\n"
            for word, of in (("late", late), ("response", takes))
        )
        program = text(times, verify=verify)
        codes, differs = said(tmp_path, program), rechecked(tmp_path, program)
        if not set(codes) <= {"R033", "R034"}:
            continue  # not about the thread: R015, R017 or R018, in the words of either
        assert bool(codes) == bool(differs), (codes, differs, program)
        refused += bool(codes)
    assert DRAWS // 10 <= refused <= DRAWS - DRAWS // 10
