"""From a flattened test to a result: the same search, seen from Python."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import soter
from generators.brute_force import BruteForce
from soter.api.exploring import with_skew_and_horizon
from soter.diagnostics.command_records import bytes_of, make_record
from soter.explore.command import TraceHeader, UnreproducedError, explore_test
from soter.explore.replay import replay
from soter.explore.search_options import SearchOptions
from soter.explore.trace import read_document, trace_from_document
from unit.explore.explored_programs import CONTRACTS, FAULTS, QUEUED, STARTS, TESTED
from unit.explore.random_walks import system_of_text

if TYPE_CHECKING:
    from soter.explore.results import TestResult
    from soter.explore.search_options import SearchProgress

TOLD = TraceHeader("small.soter", {})
WIDE = "soter 1;\n" + "".join(
    f"topic x{i}: int in [0, 3];\n"
    f"node N{i} period 10ms {{ publishes x{i}; step {{ publish x{i} = choose [0, 3]; }} }}\n"
    for i in range(8)
)
WIDE += f"system S {{ {' '.join(f'n{i}: N{i};' for i in range(8))} until 10ms; }}\n"
WIDE += (
    f"test Sum {{ system S; horizon 10ms; always {' + '.join(f'x{i}' for i in range(8))} < 24; }}"
)


def explored(text: str, test: str, **options: object) -> TestResult:
    return explore_test(
        system_of_text(text, test),
        replace(SearchOptions(), **options),  # type: ignore[arg-type]
        TOLD,
    )


@pytest.mark.parametrize(
    ("text", "test"),
    [
        (TESTED, "Far"),
        (TESTED, "Skewed"),
        (TESTED, "Theorem"),
        (TESTED, "Answers"),
        (FAULTS, "Overflows"),
        (STARTS, "Drifts"),
        (CONTRACTS, "Kept"),
        (QUEUED, "Fits"),
        (TESTED, "Skips"),
        (TESTED, "Overruns"),
        (TESTED, "Sometime"),
    ],
)
def test_every_violation_is_replayed_and_has_a_step_of_its_own(text: str, test: str) -> None:
    test_result = explored(text, test)
    assert test_result.verdict == "violated"
    assert test_result.replayed is not None
    assert test_result.replayed.reproduced
    assert test_result.minimal
    assert replay(test_result.replayed.trace, test_result.system).reproduced


def test_the_trace_is_as_short_as_the_enumerator_says() -> None:
    for text, test in ((FAULTS, "Overflows"), (CONTRACTS, "Kept"), (QUEUED, "Fits")):
        test_result = explored(text, test)
        assert test_result.replayed is not None
        moves = [s for s in test_result.replayed.trace.steps if s.kind != "start"]
        assert len(moves) == BruteForce(test_result.system).run(2_000_000).shortest


def test_what_the_interpreter_does_not_see_is_not_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from soter.explore.engine import search

    honest = search.Search.find_shortest_trace

    def lies(self: search.Search, outcome: search.Found, patience_s: float) -> search.Found:
        least = honest(self, outcome, patience_s)
        return replace(least, steps=(*least.steps, least.steps[-1]))

    monkeypatch.setattr(search.Search, "find_shortest_trace", lies)
    with pytest.raises(UnreproducedError, match="does not reproduce") as error:
        explored(FAULTS, "Overflows")
    assert error.value.trace.test == "Overflows"


def test_a_trace_is_kept_when_the_shortest_one_takes_too_long() -> None:
    test_result = explored(WIDE, "Sum", minimise=0.15)
    assert test_result.verdict == "violated"
    assert not test_result.minimal
    assert test_result.least_bound == "patience"
    assert (
        test_result.not_shortest
        == "the search for it took longer than its part of 0.15 s (--minimise)"
    )
    assert 0.07 < test_result.minimise_s < 5.0
    assert test_result.replayed is not None
    assert test_result.replayed.reproduced
    assert not test_result.interrupted


def test_the_way_to_a_violation_is_not_cut_by_the_bound_on_states() -> None:
    free = explored(WIDE, "Sum", minimise=0.0)
    for more in (0, 1, 100):
        test_result = explored(WIDE, "Sum", minimise=0.0, max_states=free.states + more)
        assert test_result.verdict == "violated"
        assert test_result.replayed is not None


def test_ctrl_c_while_a_trace_is_looked_for_does_not_go_on_minimising(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from soter.explore.engine import search

    honest = search.Search.run

    def cut(self: search.Search) -> search.Found:
        return replace(honest(self), stopped="interrupted", steps=())

    monkeypatch.setattr(search.Search, "run", cut)
    monkeypatch.delattr(search.Search, "find_shortest_trace")
    test_result = explored(FAULTS, "Overflows")
    assert (test_result.verdict, test_result.bound, test_result.unshown) == (
        "violated",
        None,
        "interrupted",
    )
    assert test_result.broken is not None
    assert test_result.interrupted


@pytest.mark.parametrize(
    ("how", "why", "help_"),
    [
        ({}, "memory", "--memory"),
        ({"stopped": "time"}, "time", "--time"),
        ({"depth": 65_536}, "length", "--horizon"),
        ({"apart": True}, "part", "--reduction ample"),
    ],
)
def test_a_violation_that_no_execution_shows_is_one(
    how: dict[str, object], why: str, help_: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from soter.explore.engine import search

    honest = search.Search.run

    def cut(self: search.Search) -> search.Found:
        return replace(honest(self), steps=(), **how)  # type: ignore[arg-type]

    monkeypatch.setattr(search.Search, "run", cut)
    test_result = explored(FAULTS, "Overflows", minimise=0.0)
    assert (test_result.verdict, test_result.unshown, test_result.interrupted) == (
        "violated",
        why,
        False,
    )
    assert test_result.not_shown.startswith(
        "found by the compiled steps, not replayed: no execution"
    )
    assert help_ in test_result.not_shown


def test_whoever_interrupts_the_replay_still_gets_the_violation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("soter.explore.command.replay", pressed)
    test_result = explored(FAULTS, "Overflows")
    assert (test_result.verdict, test_result.unshown) == ("violated", "interrupted")
    assert test_result.interrupted


def test_values_count_as_reached_where_they_are_the_default() -> None:
    text = FAULTS.replace("topic x: int in [0, 5];", "topic x: int in [0, 5] = 4;")
    never = explored(text.replace("choose [0, 2]", "1"), "Overflows").coverage.values.unreached
    assert never == ("x = 0",)
    only = explored(text.replace("choose [0, 2]", "5"), "Overflows").coverage.values.unreached
    assert "x = 4" not in only
    assert "x = 3" in only


def test_other_times_make_another_test() -> None:
    system = system_of_text(TESTED, "Far")
    other = with_skew_and_horizon(system, 5_000_000, 30_000_000)
    assert other.test is not None
    assert (other.test.skew_ns, other.test.horizon_ns) == (5_000_000, 30_000_000)
    assert system.test is not None
    assert system.test.skew_ns == 0
    for skew, horizon in ((-1, None), (None, 0), (2**63, None)):
        with pytest.raises(soter.SoterError, match="U001"):
            with_skew_and_horizon(system, skew, horizon)


def test_sizes_are_read_as_people_write_them() -> None:
    assert bytes_of("512M") == bytes_of("0.5G") == bytes_of("512 MB") == 2**29
    assert bytes_of(12) == bytes_of("12") == 12
    assert bytes_of("x") is bytes_of("-1") is bytes_of("1" * 400) is bytes_of(True) is None
    with pytest.raises(soter.SoterError) as error:
        make_record(
            SearchOptions,
            {
                "strategy": "x",
                "storage": "y",
                "reduction": "z",
                "threads": 0,
                "memory": "1k",
                "max_states": -1,
                "runs": 0,
                "seed": 2**64,
            },
        )
    assert len(error.value.diagnostics) == 8


def test_from_a_program_in_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "small.soter").write_text(TESTED)
    monkeypatch.chdir(tmp_path)
    looked: list[SearchProgress] = []
    report = soter.load("small.soter").explore("Far", progress=looked.append, html=True)
    assert report.verdict == "violated"
    assert repr(report) == "<soter.ExploreReport small.soter: Far violated>"
    trace = report["Far"].trace
    assert trace == Path(".soter/small-Far.trace.json")
    assert trace_from_document(read_document(trace), trace).steps
    assert (tmp_path / ".soter" / "small-Far.html").is_file()
    again = soter.replay(trace)
    assert again.reproduced
    with pytest.raises(KeyError):
        report["None"]
    nothing = soter.load("small.soter").explore("Far", output=None)
    assert nothing["Far"].trace is None
    assert nothing["Far"].replayed is not None
