"""What is told of a trace: why it fails, what queues lose; its page."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.diagnostics.diagnostic import SoterError
from soter.explore.command import TraceHeader, explore_test
from soter.explore.replay import replay
from soter.explore.search_options import SearchOptions
from soter.explore.trace_page import trace_page
from soter.explore.trace_view import make_sequence_view
from soter.report.html import html_document
from soter.report.run.counterexample_page import SHOWN
from soter.report.run.timeline import chart_timeline
from soter.report.sequence_view import action_phrases, explanation
from soter.report.sequence_view import table_text as lines_of
from unit.explore.explored_programs import FAULTS, QUEUED, TESTED
from unit.explore.random_walks import system_of_text

if TYPE_CHECKING:
    from soter.explore.replay import Replayed
    from soter.report.run.record import Chart, ReportPage
    from soter.report.sequence_view import SequenceView

DROPPING = QUEUED.replace("queue 2 fault", "queue 2")
REPLACED = """soter 1;
topic x: int in [0, 9];
topic u: int in [0, 9];
topic log: int in [0, 9];
plant P period 10ms { reads u; drives x = at; state at: int in [0, 9] = 0; next at = u; }
extern node Clever period 10ms { subscribes x; publishes u; }
node Stay period 10ms { publishes u; step { publish u = 0; } }
node Wild period 10ms { publishes u; step { publish u = choose [0, 9]; } }
node Log period 10ms { subscribes x; publishes log; step { publish log = x; } }
rta M { ac Clever; sc Stay; period 10ms; safe x <= 9; ttf x > 8; safer true; }
rta Other { ac Clever; sc Stay; period 10ms; safe x <= 9; ttf x > 8; safer true; }
system S { p: P; node Log; module M; until 1s; }
test T { system S; replace Clever by Wild; horizon 50ms; always p.truth.at < 5; }
"""
SLOW = """soter 1;
topic a: bool;
node N period 20ms { publishes a; step { publish a = true; } }
system S { n: N; until 1s; }
test T { system S; overrun n by 15ms; horizon 15ms; eventually a within 10ms; }
"""

LATE = Path(__file__).parents[3] / "examples" / "testing" / "late_sc.soter"
WALK = """soter 1;
type E = enum { Left, Right };
topic at: float unit "m";
topic cmd: float in [-1.0, 1.0];
topic side: E;
plant Cart period 10ms { reads cmd; drives at = x; state x: float = 0.0; next x = x + cmd; }
node Walk period 10ms { publishes cmd, side; step {
  publish cmd = choose { -1.0, 1.0 };
  publish side = E.Left;
} }
system S { c: Cart; node Walk; until 10s; }
test Far { system S; horizon 1s; always c.truth.x <= 50.0; }
test Once { system S; horizon 50ms; always c.truth.x < 0.0; }
"""
HOSTILE = "\x1b[1m<script>alert(1)</script>\"'&amp;</style>`code`"


def found(source: str, test: str) -> Replayed:
    result = explore_test(
        system_of_text(source, test), SearchOptions(), TraceHeader("small.soter", {})
    )
    assert result.replayed is not None
    return result.replayed


def view(source: str, test: str) -> SequenceView:
    return make_sequence_view(found(source, test), "0")


def why(source: str, test: str) -> str:
    return explanation(view(source, test))


# ---------------------------------------------------------------- why


def test_a_missed_deadline_says_when_the_premise_held() -> None:
    said = why(TESTED, "Answers")
    assert "`alarm` held at 0 ms, and `seen > 0` did not hold in any observable" in said
    assert said.endswith("configuration from then on up to 10 ms.")


def test_what_never_came_says_until_when_it_was_waited_for() -> None:
    said = why(TESTED, "Sometime")
    assert said.endswith("`seen > 2` did not hold in any observable configuration up to 80 ms.")


def test_a_broken_invariant_says_which_half_fails() -> None:
    tested = TESTED.replace("skew 10ms; late", "skew 5ms; late")  # many fewer executions
    assert tested != TESTED
    said = why(tested, "Theorem")
    late = "the DM last said AC at" in said and "SC has not acted by" in said
    assert late or "`abs(cell) <= 3`, `safe` of `Keeper`, fails" in said
    forgotten = why(TESTED, "Forgotten")
    assert "the DM last said AC at" in forgotten
    assert "and SC has not acted by" in forgotten
    unsafe = tested.replace("safe abs(cell) <= 3;", "safe abs(cell) <= 1;")
    unsafe = unsafe.replace("ttf abs(cell) > 1;", "ttf abs(cell) > 0;")
    assert "`abs(cell) <= 1`, `safe` of `Keeper`, fails" in why(unsafe, "Theorem")


def test_a_fault_says_whose_it_is_and_where() -> None:
    seen = view(FAULTS.replace("int in [0, 100] = 0", "int = 9223372036854775806"), "Overflows")
    step = next(s for s in seen.steps if s.violates)
    assert "fault in c: overflow, small.soter:7" in action_phrases(step)
    assert "`c` faults (overflow, small.soter:7)" in explanation(seen)


def test_what_else_fails_stands_after_one_colon() -> None:
    both = TESTED.replace(
        "always abs(robot.truth.at) <= 2;",
        "always abs(robot.truth.at) <= 2; never abs(robot.truth.at) == 3;",
    )
    said = why(both, "Far")
    assert "is violated as well" in said
    assert said.count(":") == 1


# ---------------------------------------------------------------- queues


@pytest.mark.parametrize("policy", ["drop_oldest", "drop_newest", "fault"])
@pytest.mark.parametrize("test", ["Fits", "Slowly"])
def test_a_loss_is_told_at_the_step_that_filled_the_queue(policy: str, test: str) -> None:
    source = QUEUED.replace("queue 2 fault", f"queue 2 {policy}").replace(
        "if choose bool", "if true"
    )
    source = source.replace("always sum <= 3", "eventually sum > 90 within 70ms")
    steps = found(source, test).steps
    lost = 0
    for before, step in pairwise(steps):
        waiting = before.topics["slow.x.queue"]
        assert isinstance(waiting, list)
        full = "x" in step.published and len(waiting) == 2
        assert [(d.queue, d.policy) for d in step.dropped] == [("slow.x", policy)] * full
        lost += full
    assert lost


def test_a_loss_is_seen_in_the_table() -> None:
    source = DROPPING.replace("if choose bool { publish x = choose [1, 2]; }", "publish x = 1;")
    source = source.replace("always sum <= 3", "eventually sum > 2 within 70ms")
    seen = view(source, "Fits")
    said = "queue `slow.x` is full: the oldest is dropped"
    assert any(said in line for line in lines_of(seen))


def test_a_queue_is_no_topic_of_its_own() -> None:
    seen = view(DROPPING, "Slowly")
    assert seen.topics == ("x", "sum")
    assert [p.topic for p in seen.steps[0].published] == ["x", "sum"]


# ---------------------------------------------------------------- times


def test_an_overrun_says_how_long_it_took() -> None:
    seen = view(SLOW, "T")
    _, begun, effect = seen.steps
    assert (begun.kind, effect.kind) == ("overrun", "effect")
    assert begun.lasts_ns == effect.lasts_ns == effect.time_ns - begun.time_ns > 10**7
    after = effect.time_ns // 10**6
    assert action_phrases(begun) == [f"starts, takes effect {after} ms later"]
    assert action_phrases(effect) == [f"takes effect {after} ms after its start"]


def test_an_overrun_of_no_time_says_so() -> None:
    steps = view(TESTED, "Overruns").steps
    said = [action_phrases(s)[0] for s in steps if s.lasts_ns == 0]
    assert set(said) == {"starts", "takes effect, 0 ms later"}


def test_the_heading_is_short_and_does_not_repeat_the_property() -> None:
    seen = view(TESTED, "Far")
    assert "always" not in seen.verdict
    assert "ms." in seen.verdict


@pytest.mark.parametrize(
    ("second", "said"),
    [
        ("choose { 2, 3 }", ["choose { 2, 3 }: 3", "choose { 2, 3 }: 3"]),
        ("choose { 0, 3 }", ["n.choose: alternative 1 of 2", "n.choose: alternative 1 of 2"]),
        ("choose { 0, 1, 3 }", ["choose { 2, 3 }: 3", "choose { 0, 1, 3 }: 3"]),
    ],
)
def test_a_choice_is_told_in_its_words_where_no_other_one_could_be_meant(
    second: str, said: list[str]
) -> None:
    source = f"""soter 1;
topic a: int in [0, 9];
node N period 10ms {{ publishes a; step {{ publish a = choose {{ 2, 3 }} + {second}; }} }}
system S {{ n: N; until 1s; }}
test T {{ system S; horizon 10ms; always a < 6; }}
"""
    step = view(source, "T").steps[-1]
    assert list(action_phrases(step)) == said


# ---------------------------------------------------------------- which instance, which fault

FLEET = """soter 1;
topic n: int in [0, 9];
topic done: bool;
node C period 10ms {
  publishes n, done;
  guarantees n < 10;
  var k: int in [0, 9];
  step { k = min(k + choose [0, 1], 9); publish n = k; publish done = k > 2; }
}
system One { node C; }
system S { for i in 0..2 { r[i]: One; } }
test Leads { system S; horizon 60ms; for i in 0..2 { r[i].n > 0 leadsto r[i].done within 20ms; } }
test Comes { system S; horizon 60ms; for i in 1..2 { eventually r[i].done within 40ms; } }
test Divides { system S; horizon 60ms; for i in 0..2 { always 10 / (r[i].n - 3) != 100; } }
test Waits { system S; horizon 60ms; eventually 10 / (r[0].n - r[0].n) == 1 within 40ms; }
test First { system S; horizon 60ms; order deployed; never r[0].n == 2; }
test Last { system S; horizon 60ms; order deployed; never r[1].n == 2; }
"""


def test_a_property_of_a_loop_is_told_of_the_instance() -> None:
    for test, condition, premise in (
        ("Leads", "r[0].done", "`r[0].n > 0` held at"),
        ("Comes", "r[1].done", ""),
    ):
        said = why(FLEET, test)
        assert f"`{condition}` did not hold" in said
        assert premise in said
        assert "[i]" not in said


@pytest.mark.whole
def test_a_property_that_cannot_be_judged_says_what_goes_wrong() -> None:
    line = FLEET[: FLEET.index("test Divides")].count("\n") + 1
    assert f"judging it faults (divide, small.soter:{line})" in why(FLEET, "Divides")
    assert f"(judging it faulted at 0 ms: divide, small.soter:{line + 1})" in why(FLEET, "Waits")
    assert "judging it faults (divide, small.soter:6)" in why(
        FLEET.replace("n < 10;", "10 / (4 - n) < 11;"), "Last"
    )
    unsafe = TESTED.replace("safe abs(cell) <= 3;", "safe 10 / (cell - cell) <= 3;")
    assert "judging `safe` of `Keeper` faults (divide, " in why(unsafe, "Theorem")
    assert "faults" not in why(TESTED, "Far")


def test_who_only_lets_time_pass_is_not_blamed() -> None:
    first, last = (view(FLEET, test) for test in ("First", "Last"))
    assert first.steps[-1].lane == last.steps[-1].lane == "r[1].C"
    assert explanation(first).endswith(
        "`r[1].C`: it was false earlier in this instant already; a property is judged after the "
        "last step of an instant, which this is."
    )
    assert "already" not in explanation(last)


# ---------------------------------------------------------------- the page


def page_of(run: Replayed) -> ReportPage:
    return trace_page(run, make_sequence_view(run, "0"))


def chart_of(page: ReportPage) -> Chart:
    (chart,) = page.charts
    return chart


def figure_of(page: ReportPage) -> dict[str, Any]:
    return chart_timeline(
        chart_of(page), "chart-0", end_s=float(chart_of(page).time_s[-1])
    ).to_json()


@pytest.mark.parametrize("test", ["Far", "Once"])
def test_every_panel_and_the_words_mark_the_violated_instant(test: str) -> None:
    run = found(WALK, test)
    page, at_s = page_of(run), run.steps[-1].time_ns / 1e9
    figure = figure_of(page)
    panels = {t["yaxis"] for t in figure["data"] if t["mode"] == "lines"}
    marks = [t for t in figure["data"] if t["mode"] == "markers" and t["x"][0] == at_s]
    assert len(panels) == 2
    assert panels <= {t["yaxis"] for t in marks}
    last = {name: run.steps[-1].topics[name] for name in ("at", "cmd")}
    values = [y for t in marks if t["yaxis"] in panels for y in t["y"]]
    assert set(last.values()) <= set(values)
    (line,) = [s for s in figure["layout"]["shapes"] if s["x0"] == s["x1"] == at_s]
    assert (line["y0"], line["y1"]) == (0, 1)
    assert f"violated at {at_s:g} s" in [a["text"] for a in figure["layout"]["annotations"]]
    assert "Violated after" in page.headline
    assert f"The property fails in step {run.steps[-1].number}" in page.subtitle


def test_time_lines_of_a_long_run_open_where_it_is_violated() -> None:
    run = found(WALK, "Far")
    page, at_s = page_of(run), run.steps[-1].time_ns / 1e9
    low, high = figure_of(page)["layout"]["xaxis"]["range"]
    times = sorted({t for t in chart_of(page).time_s.tolist() if low <= t <= high})
    assert len(times) == SHOWN
    assert times[-1] == at_s < high < at_s + 0.1 * (at_s - low)
    assert chart_of(page).time_s[0] == 0 < low, "the whole run is there"
    assert any("double-click" in note for note in page.notes)


def test_a_violation_at_the_start_has_room_beside_it() -> None:
    page = page_of(found(WALK, "Once"))
    low, high = figure_of(page)["layout"]["xaxis"]["range"]
    assert low <= 0 < high
    assert not any("double-click" in note for note in page.notes)


def test_every_step_is_told_and_the_table_opens_at_the_one_that_violates() -> None:
    run = found(TESTED, "Far")
    (section,) = page_of(run).sections
    assert [row[0] for row in section.rows][1:] == [str(s.number) for s in run.steps[1:]]
    assert all(row[1] for row in section.rows), "each row has its time, also out of its table"
    assert section.opens == len(section.rows) - 1
    assert "✕ violated" in section.rows[-1][-1]
    document = html_document(page_of(run))
    (marked,) = re.findall(r"<tr class=here>.*?</tr>", document)
    assert "✕ violated" in marked


def test_modes_and_switches_are_those_of_the_replay() -> None:
    run = found(LATE.read_text("utf-8"), "Late")
    chart = chart_of(page_of(run))
    assert [(d.to, d.predicates["ttf"]) for d in chart.decisions] == [("AC", False), ("SC", True)]
    (band,) = chart.modes
    assert [bool(x) for x in band.in_control[[1, -1]]] == [True, False]


def test_a_trace_that_does_not_reproduce_marks_nothing() -> None:
    run = found(WALK, "Far")
    short = replay(replace(run.trace, steps=run.trace.steps[:-1]), run.system)
    page = page_of(short)
    assert "does not reproduce" in page.headline
    assert chart_of(page).violations == ()
    nothing = replay(replace(run.trace, steps=()), run.system)
    assert page_of(nothing).charts == ()
    assert "does not reproduce" in html_document(page_of(nothing))


def test_no_text_of_a_trace_becomes_markup() -> None:
    run = found(WALK, "Once")
    view = make_sequence_view(run, "0")
    hostile = replace(
        view,
        program=HOSTILE,
        test=HOSTILE,
        property_text=HOSTILE,
        verdict=HOSTILE,
        remark=HOSTILE,
        assumptions=(HOSTILE,),
        provenance={HOSTILE: HOSTILE},
        steps=tuple(replace(s, note=HOSTILE, lane=HOSTILE) for s in view.steps),
    )
    document = html_document(trace_page(run, hostile))
    assert "<script>alert" not in document
    assert "\x1b" not in document


def test_a_page_that_cannot_be_drawn_is_refused_before_the_search(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("soter.report.html.find_spec", lambda _: None)
    with pytest.raises(SoterError, match="D007"):
        soter.load(LATE).explore(
            output=tmp_path, html=True, progress=lambda _: pytest.fail("it searched")
        )
    assert not list(tmp_path.iterdir())
