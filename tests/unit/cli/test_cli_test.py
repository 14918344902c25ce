"""`soter test`: verdicts, what was covered, traces, exit codes, and the JSON document."""

from __future__ import annotations

import json
import re
import signal
import sys
import threading
import time
from _thread import interrupt_main
from dataclasses import replace
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

import processes
from json_documents import SCHEMAS, _check
from soter.cli.terminal.command_line import duration_s
from soter.explore.search_options import STRATEGIES

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]
    Golden = Callable[[str, str], None]

CORRIDOR = """soter 1;
param END: int = 2 in [1, 9];
type Move = int in [-1, 1];
topic cell: int in [-9, 9];
topic move: Move;
plant Corridor period 10ms {
  reads move; drives cell = at;
  state at: int in [-9, 9] = 0;
  next at = max(-9, min(at + move, 9));
}
node Bold period 10ms {
  publishes move;
  step { publish move = choose { 0, 1, -1 }; }
}
node Home period 20ms {
  subscribes cell; publishes move;
  step {
    if cell > 8 { publish move = 0; }
    else { publish move = cell > 0 ? -1 : cell < 0 ? 1 : 0; }
  }
}
rta Keeper {
  ac Bold; sc Home; period 30ms;
  safe abs(cell) <= 9; ttf abs(cell) > 1; safer cell == 0;
}
system S { robot: Corridor; module Keeper; until 200ms; }
test Far { system S; horizon 120ms; always abs(robot.truth.at) <= END; }
test Near { system S; horizon 60ms; always abs(robot.truth.at) <= 9; }
"""
FLOATS = """soter 1;
topic pos: float;
plant Point period 10ms {
  drives pos = x; state x: float = 0.0; disturbance wind: float in [-1.0, 1.0]; der x = wind;
}
system S { p: Point; until 100ms; }
test Drifts { system S; horizon 30ms; always p.truth.x < 1.0; }
"""


@pytest.fixture
def corridor(here: Path) -> str:
    (here / "corridor.soter").write_text(CORRIDOR)
    return "corridor.soter"


def steady(text: str) -> str:
    """Without what depends on the machine, the day, and how the engine goes about it."""
    text = re.sub(r"^[0-9,]+ states, .*", "FIGURES", text, flags=re.MULTILINE)
    return re.sub(r"\b[0-9a-f]{12}\b", "HASH", text)


# ---------------------------------------------------------------- verdicts and exits


def test_a_violation_comes_with_its_trace(soter: Soter, corridor: str, golden: Golden) -> None:
    done = soter("test", corridor, "--test", "Far")
    assert done.exit == 3
    assert "Far  VIOLATED  always abs(robot.truth.at) <= END" in done.out
    assert "✕ violated" in done.out
    golden("cli/test_violated.txt", steady(done.out))


def test_a_clean_test_says_what_was_covered_and_what_was_not(
    soter: Soter, corridor: str, golden: Golden
) -> None:
    done = soter("test", corridor, "--test", "Near")
    assert done.exit == 0
    assert "EXHAUSTED AND CLEAN" in done.out
    assert "never  Keeper.Home, corridor.soter:18:5, where the condition holds" in done.out
    golden("cli/test_clean.txt", steady(done.out))


def test_the_worst_test_decides(soter: Soter, corridor: str) -> None:
    done = soter("test", corridor, "--json")
    assert done.exit == 3
    far, near = done.document["tests"]
    assert (far["name"], far["verdict"]) == ("Far", "violated")
    assert (near["name"], near["verdict"]) == ("Near", "exhausted")
    assert done.document["verdict"] == "violated"
    assert near["trace"] is near["violated"] is near["minimal"] is None
    assert near["coverage"]["modes"] == {"reached": 2, "total": 2, "unreached": []}
    assert near["memory"]["packed_bits"] > 0
    assert near["memory"]["bytes_per_state"] > 0


def test_a_bound_is_no_verdict(soter: Soter, corridor: str) -> None:
    done = soter("test", corridor, "--test", "Near", "--max-states", "20", "--json")
    assert done.exit == 4
    assert done.document["tests"][0]["bound"] == "states"
    done = soter("test", corridor, "--test", "Near", "--strategy", "random", "--runs", "50")
    assert done.exit == 4
    assert "BOUND REACHED  no violation was found; executions drawn by random" in done.out


def test_a_sampled_continuum_is_never_exhausted(soter: Soter, here: Path) -> None:
    (here / "floats.soter").write_text(FLOATS)
    done = soter("test", "floats.soter", "--json")
    assert done.exit == 4
    (test,) = done.document["tests"]
    assert (test["verdict"], test["bound"]) == ("bound", "sampled")
    assert any("p.wind" in text for text in test["assumptions"])


def test_what_a_verdict_rests_on_follows_from_how_it_was_found(soter: Soter, corridor: str) -> None:
    plain = soter("test", corridor, "--test", "Near", "--json").document["tests"][0]
    assert not any("fingerprint" in text for text in plain["assumptions"])
    assert any("skew 0" in text for text in plain["assumptions"])
    hashed = soter(
        "test", corridor, "--test", "Near", "--storage", "fingerprint", "--skew", "10ms", "--json"
    ).document["tests"][0]
    assert any("fingerprint" in text for text in hashed["assumptions"])
    assert any("within 10 ms" in text for text in hashed["assumptions"])
    assert hashed["states"] > plain["states"]


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_strategy_finds_it_and_the_trace_is_the_shortest(
    soter: Soter, corridor: str, strategy: str
) -> None:
    done = soter("test", corridor, "--test", "Far", "--strategy", strategy, "--json")
    assert done.exit == 3
    (test,) = done.document["tests"]
    assert test["minimal"] is True
    shortest = soter("test", corridor, "--test", "Far", "--reduction", "none", "--json")
    assert test["steps"] == shortest.document["tests"][0]["steps"]


def test_parameters_and_times_may_be_set(soter: Soter, corridor: str) -> None:
    assert soter("test", corridor, "--test", "Far", "--set", "END=9").exit == 0
    assert soter("test", corridor, "--test", "Far", "--horizon", "20ms").exit == 0


# ---------------------------------------------------------------- the trace


def test_the_trace_is_a_file_that_keeps_to_its_schema(
    soter: Soter, corridor: str, here: Path
) -> None:
    done = soter("test", corridor, "--test", "Far", "--set", "END=1", "--html", "-o", "out")
    assert done.exit == 3
    document = json.loads((here / "out" / "corridor-Far.trace.json").read_text("utf-8"))
    assert list(_check(SCHEMAS["trace.json"], document, "")) == []
    assert document["program"] == "../corridor.soter"
    assert document["params"] == {"END": 1}
    assert document["minimal"] is True
    taken = [c["value"] for s in document["steps"] for c in s["choices"] if c["pick"]]
    assert taken[0] in (1, -1)
    assert "<html" in (here / "out" / "corridor-Far.html").read_text("utf-8")
    assert soter("replay", "out/corridor-Far.trace.json").exit == 0


def test_what_the_interpreter_does_not_see_is_a_defect_of_soter(
    soter: Soter, corridor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from soter.explore.engine import search

    honest = search.Search.find_shortest_trace

    def lies(self: Any, *given: Any) -> Any:
        least = honest(self, *given)
        return replace(least, steps=least.steps[:-1])

    monkeypatch.setattr(search.Search, "find_shortest_trace", lies)
    done = soter("test", corridor, "--test", "Far", "--json")
    assert done.exit == 70
    assert done.codes == ["I001"]
    assert "tests" not in done.document


def test_a_trace_that_could_not_be_made_minimal_says_so(
    soter: Soter, corridor: str, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop_before_the_least(monkeypatch, status="memory")
    done = soter("test", corridor, "--test", "Far", "--report")
    assert done.exit == 3
    said = (
        "Perhaps not the shortest execution: the search for it needs more memory than was allowed"
    )
    assert said in done.out
    replayed = soter("replay", ".soter/corridor-Far.trace.json")
    assert replayed.exit == 0
    assert said in replayed.out
    page = (here / ".soter" / "corridor-Far.html").read_text("utf-8")
    assert said in page


def stop_before_the_least(monkeypatch: pytest.MonkeyPatch, **how: object) -> None:
    """Searches for the least trace end like that."""
    from soter.explore.engine import search

    monkeypatch.setattr(
        search.Search,
        "find_shortest_trace",
        lambda _, outcome, *__: replace(outcome, steps=(), **how),
    )


def test_ctrl_c_while_the_shortest_is_looked_for_keeps_the_trace(
    soter: Soter, corridor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop_before_the_least(monkeypatch, status="stopped", stopped="interrupted")
    done = soter("test", corridor, "--json")
    assert done.exit == 130
    (test,) = done.document["tests"]
    assert (test["verdict"], test["minimal"]) == ("violated", False)
    assert test["not_shortest"] == "the search for it was interrupted"
    assert done.document["not_started"] == ["Near"]
    said = soter("test", corridor).out
    assert re.search(r"^  Far   VIOLATED  +always abs", said, re.MULTILINE)
    assert re.search(r"^  Near  NOT STARTED$", said, re.MULTILINE)


def test_a_violation_without_a_trace_is_not_lost(
    soter: Soter, corridor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from soter.explore.engine import search

    honest = search.Search.run
    monkeypatch.setattr(search.Search, "run", lambda self, *_: replace(honest(self), steps=()))
    stop_before_the_least(monkeypatch, status="memory")
    done = soter("test", corridor, "--test", "Far", "--json")
    assert done.exit == 3
    (test,) = done.document["tests"]
    assert (test["verdict"], test["bound"]) == ("violated", None)
    assert test["violated"] == "always abs(robot.truth.at) <= END"
    assert test["trace"] is test["minimal"] is None
    sentence = (
        "found by the compiled steps, not replayed: no execution of it can be shown, as it needs "
        "more memory than was allowed: more --memory or a shorter --horizon may show one"
    )
    assert test["unshown"] == sentence
    said = soter("test", corridor, "--test", "Far")
    assert said.exit == 3
    assert f"Far  VIOLATED  always abs(robot.truth.at) <= END\n{sentence}\n" in said.out


def test_all_properties_that_can_be_violated_are_told(soter: Soter, here: Path) -> None:
    (here / "two.soter").write_text(TWO, "utf-8")
    done = soter("test", "two.soter", "--all", "--html")
    assert done.exit == 3
    assert "also  VIOLATED  never x == 2" in done.out
    assert (
        "3 properties violated; the search for violations of others ended without one" in done.out
    )
    assert (here / ".soter" / "two-T-2.html").is_file()
    assert soter("replay", ".soter/two-T-2.trace.json").exit == 0
    (test,) = soter("test", "two.soter", "--all", "--json").document["tests"]
    assert (
        list(
            _check(SCHEMAS["test.json"], soter("test", "two.soter", "--all", "--json").document, "")
        )
        == []
    )
    assert test["violated"] == "never x == 1"
    assert test["violated_there"] == ["never x == 1", "never x < 2 && x > 0"]
    assert {o["violated"] for o in test["others"]} == {"never x == 2", "never x < 2 && x > 0"}
    assert all(o["minimal"] for o in test["others"])
    assert test["others_bound"] is None
    (alone,) = soter("test", "two.soter", "--json").document["tests"]
    assert alone["others"] == []


TWO = """soter 1;
topic x: int in [0, 3];
node Picks period 10ms { publishes x; step { publish x = choose [0, 2]; } }
system S { picks: Picks; until 1s; }
test T { system S; horizon 20ms; never x == 1; never x == 2; never x < 2 && x > 0; }
"""


def test_who_does_not_want_the_shortest_trace_gets_the_one_that_was_found(
    soter: Soter, corridor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from soter.explore.engine import search

    monkeypatch.delattr(search.Search, "find_shortest_trace")
    command = ("test", corridor, "--test", "Far", "--minimise", "0", "--strategy", "falsify")
    done = soter(*command)
    assert done.exit == 3
    assert "it was not looked for (--minimise 0); falsify met this one first;" in done.out
    assert "shortest trace" not in done.out
    (test,) = soter(*command, "--json").document["tests"]
    assert (test["minimal"], test["minimise_s"]) == (False, 0.0)


def test_the_time_for_the_shortest_trace_is_told_apart(soter: Soter, corridor: str) -> None:
    (test,) = soter("test", corridor, "--test", "Far", "--json").document["tests"]
    assert test["minimise_s"] > 0.0
    assert test["not_shortest"] is None
    assert re.search(r"[0-9] s, shortest trace [0-9.]+ s,", soter("test", corridor).out)


def test_many_tests_end_with_a_line_each(soter: Soter, corridor: str) -> None:
    *_, head, far, near = soter("test", corridor).out.splitlines()
    assert head == "all tests"
    assert far.split()[:2] == ["Far", "VIOLATED"]
    assert near == "  Near  EXHAUSTED AND CLEAN"
    assert "all tests" not in soter("test", corridor, "--test", "Near").out


def test_times_in_messages_have_readable_units(soter: Soter, corridor: str) -> None:
    done = soter("test", corridor, "--test", "Near", "--horizon", "90000s")
    assert done.exit == 1
    assert "a horizon of 25 h can never be exhausted" in done.err


@pytest.mark.parametrize(
    ("reduction", "ran", "said"),
    [
        ("all", 1, "1 thread of 16 asked for: its first steps were all that"),
        ("none", 16, "16 threads"),
    ],
)
def test_the_threads_told_are_those_that_ran(
    soter: Soter, corridor: str, reduction: str, ran: int, said: str
) -> None:
    how = ("--threads", "16", "--reduction", reduction)
    command = ("test", corridor, "--test", "Far", *how)
    assert said in soter(*command).out
    (told,) = soter(*command, "--json").document["tests"]
    assert (told["threads"], told["threads_asked"]) == (ran, 16)
    assert (told["threads_fewer"] or "").startswith(said.partition(": ")[2])
    assert soter(*command[:4], "--threads", "17").exit == 2
    (told,) = soter("test", corridor, "--test", "Far", "--json").document["tests"]
    assert (told["threads"], told["threads_asked"], told["threads_fewer"]) == (1, 1, None)


# ---------------------------------------------------------------- mistakes and interruptions


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("--test", "Nothing"), "U010"),
        (("--strategy", "guess"), "U001"),
        (("--storage", "none"), "U001"),
        (("--reduction", "some"), "U001"),
        (("--memory", "much"), "U001"),
        (("--memory", "12"), "U001"),
        (("--threads", "0"), "U001"),
        (("--threads", "x"), "U003"),
        (("--runs", "0"), "U001"),
        (("--max-states", "-1"), "U003"),
        (("--skew", "5"), "U001"),
        (("--horizon", "0s"), "U001"),
        (("--set", "NONE=1"), "U004"),
        (("--seed", "-1"), "U003"),
        (("--minimise", "-1"), "U001"),
        (("--minimise", "nan"), "U001"),
        (("--minimise", "long"), "U003"),
        (("--time", "0"), "U001"),
        (("--time", "nan"), "U001"),
        (("--time", "long"), "U003"),
        (("--time", "0s"), "U001"),
        (("--time", "10parsec"), "U003"),
        (("--max-states", "0"), "U003"),
        (("--test", "Far", "--test", "Nothing"), "U010"),
    ],
)
def test_mistakes_of_the_command_line(
    soter: Soter, corridor: str, arguments: tuple[str, ...], code: str
) -> None:
    done = soter("test", corridor, *arguments, "--json")
    assert done.exit == 2
    assert done.codes == [code]


def test_a_time_has_a_unit_or_is_in_seconds(soter: Soter, corridor: str) -> None:
    given = ("1h", "1.5min", "60", "0.25", "250ms")
    assert [duration_s(text) for text in given] == [3600.0, 90.0, 60.0, 0.25, 0.25]
    assert soter("test", corridor, "--test", "Near", "--time", "1h").exit == 0
    done = soter("test", corridor, "--time", "long")
    assert "write seconds, or a number with its unit" in done.err


def test_several_tests_may_be_chosen(soter: Soter, corridor: str) -> None:
    (here_,) = soter("test", corridor, "--test", "Near", "--json").document["tests"]
    both = soter("test", corridor, "--test", "Near", "--test", "Far", "--json").document["tests"]
    again = soter("test", corridor, "--test", "Near", "--test", "Near", "--json")
    assert here_["name"] == "Near"
    assert [t["name"] for t in both] == ["Far", "Near"], "in the order of the file"
    assert len(again.document["tests"]) == 1


def test_options_of_a_version_before_are_refused_with_what_to_do(
    soter: Soter, corridor: str
) -> None:
    for words in (("--checkpoint", "d"), ("--checkpoint-every=5",), ("--resume", "d", "--json")):
        done = soter("test", corridor, *words)
        flag = words[0].partition("=")[0]
        told = done.out if "--json" in words else done.err
        assert (done.exit, told.count("U001")) == (2, 1)
        assert f"`{flag}` is gone" in told
        assert "give one what it needs at once (--memory, --time)" in told


@pytest.mark.parametrize("strategy", ["random", "falsify"])
def test_what_sampling_does_not_cover_is_said_of_its_strategy(
    soter: Soter, corridor: str, strategy: str
) -> None:
    done = soter("test", corridor, "--test", "Near", "--strategy", strategy, "--runs", "5")
    assert f"executions drawn by {strategy} never cover everything" in done.out


def test_two_conditions_of_one_line_have_their_columns(soter: Soter, here: Path) -> None:
    text = CORRIDOR.replace("if cell > 8 {", "if cell > 8 && 100 / cell > 50 {")
    (here / "corridor.soter").write_text(text, encoding="utf-8")
    done = soter("test", "corridor.soter", "--test", "Near", "--json")
    never = done.document["tests"][0]["coverage"]["branches"]["unreached"]
    assert len(never) == len(set(never)) == 2, never


def test_who_is_late_is_left_out_of_who_is_not(soter: Soter, here: Path) -> None:
    text = CORRIDOR.replace("horizon 60ms;", "horizon 60ms; late Home by 5ms;")
    (here / "corridor.soter").write_text(text, encoding="utf-8")
    options = ("test", "corridor.soter", "--test", "Near", "--reduction", "all")
    at = "steps happen at their release, but for those that are told below, in every order within"
    assert at in soter(*options).out
    within = "every step happens within 2 ms of its release, but for those that are told below"
    assert within in soter(*options, "--skew", "2ms").out
    assert "told below" not in soter(*options[:2], "--test", "Far").out


def test_a_file_without_tests_has_nothing_to_explore(soter: Soter) -> None:
    done = soter("test", "cart.soter", "--json")
    assert done.exit == 2
    assert done.codes == ["U010"]


def test_a_wrong_program_has_diagnostics(soter: Soter, here: Path) -> None:
    (here / "wrong.soter").write_text(CORRIDOR.replace("robot.truth.at", "robot.truth.nowhere"))
    done = soter("test", "wrong.soter", "--json")
    assert done.exit == 1
    assert done.codes
    assert soter("test", "missing.soter", "--json").exit == 1


def test_a_folder_that_cannot_be_written(soter: Soter, corridor: str, here: Path) -> None:
    (here / "file").write_text("")
    done = soter("test", corridor, "--test", "Far", "-o", "file", "--json")
    assert done.exit == 1
    assert done.codes == ["D006"]


def test_an_interruption_prints_what_was_covered(soter: Soter, corridor: str) -> None:
    def press() -> None:
        enough = time.process_time() + 2.0  # of this process: it explores by then
        while time.process_time() < enough:
            time.sleep(0.02)
        interrupt_main()

    arguments = ("--strategy", "random", "--runs", "4000000000", "--test", "Near", "--json")
    soter("test", corridor, "--strategy", "random", "--runs", "1", "--test", "Near")  # compiles
    threading.Thread(target=press).start()
    done = soter("test", corridor, *arguments)
    assert done.exit == 130
    (test,) = done.document["tests"]
    assert done.document["interrupted"] is True
    assert (test["verdict"], test["bound"]) == ("bound", "interrupted")
    assert test["transitions"] > 0
    assert test["coverage"]["actors"]["reached"] == test["coverage"]["actors"]["total"]


def test_the_verdicts_are_written_as_junit_xml(soter: Soter, here: Path) -> None:
    text = CORRIDOR + "test Idle { system S; horizon 60ms; }\n"
    (here / "corridor.soter").write_text(text, encoding="utf-8")
    done = soter("test", "corridor.soter", "--junit", "out/results.xml")
    assert done.exit == 3
    (suite,) = ET.parse(here / "out" / "results.xml").getroot()  # noqa: S314 - our own
    assert [suite.get(k) for k in ("tests", "failures", "errors")] == ["3", "1", "1"]
    far, near, idle = suite
    assert [(c.get("name"), c[0].tag) for c in (far, near, idle)] == [
        ("Far", "failure"),
        ("Near", "system-out"),
        ("Idle", "error"),
    ]
    assert far[0].get("message") == "always abs(robot.truth.at) <= END"
    assert idle[0].get("type") == "unjudged"
    assert "junit  out/results.xml" in done.out


@pytest.mark.parametrize(
    ("text", "options", "codes"),
    [
        (CORRIDOR.replace("END; }", "END; never nowhere == 1; }"), (), ["N001"]),
        (CORRIDOR.replace("(at + move", "(att + move").replace("at) <= 9", "t) <= 9"), (),
         ["N001", "N004"]),
        (CORRIDOR, ("--test", "Nothing"), ["U010"]),
    ],
)  # fmt: skip
def test_what_keeps_tests_from_being_explored_takes_the_place_of_an_earlier_xml(
    soter: Soter, here: Path, text: str, options: tuple[str, ...], codes: list[str]
) -> None:
    (here / "corridor.soter").write_text(text, encoding="utf-8")
    (here / "results.xml").write_text("an earlier one", encoding="utf-8")
    done = soter("test", "corridor.soter", "--junit", "results.xml", *options, "--json")
    assert done.codes == codes
    (suite,) = ET.parse(here / "results.xml").getroot()  # noqa: S314 - our own
    count = str(len(codes))
    assert [suite.get(k) for k in ("tests", "failures", "errors")] == [count, "0", count]
    assert [(c.get("name"), c[0].tag, c[0].get("type")) for c in suite] == [
        (code, "error", code) for code in codes
    ]
    assert [c[0].get("message") for c in suite] == [
        d["message"] for d in done.document["diagnostics"]
    ]


def test_a_junit_file_that_cannot_be_written_is_a_diagnostic(soter: Soter, here: Path) -> None:
    (here / "corridor.soter").write_text(CORRIDOR, encoding="utf-8")
    (here / "there").write_text("", encoding="utf-8")
    done = soter("test", "corridor.soter", "--junit", "there/results.xml", "--json")
    assert done.exit == 1
    assert done.codes == ["D006"]


# ---------------------------------------------------------------- whoever ends it


WIDE = """soter 1;
topic n: int in [0, 3];
node Wide period 10ms { publishes n; step { var s: int = 0;
"""
WIDE += "if choose bool { s = min(s + 1, 3); }\n" * 70
WIDE += """publish n = s; } }
system S { w: Wide; until 100ms; }
test First { system S; horizon 20ms; always n <= 3; }
test Second { system S; horizon 20ms; always n <= 3; }
"""


@pytest.fixture
def wide(here: Path, soter: Soter) -> str:
    (here / "wide.soter").write_text(WIDE)
    soter("test", "wide.soter", "--time", "0.1")  # compiles
    return "wide.soter"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_whatever_signal_ends_it_what_was_covered_is_printed(
    wide: str, here: Path, number: signal.Signals
) -> None:
    command = [sys.executable, "-m", "soter.cli.main", "test", wide, "--json"]
    with processes.started(command, cwd=here, stdout=processes.PIPE, text=True) as running:
        processes.computed(running, 1.5)
        running.send_signal(number)
        out, _ = running.communicate(timeout=processes.TIMEOUT_S)
    assert running.returncode == 130
    document = json.loads(out)
    assert document["interrupted"] is True
    assert document["not_started"] == ["Second"]
    (test,) = document["tests"]
    assert (test["verdict"], test["bound"]) == ("bound", "interrupted")
    assert test["states"] > 0
    assert test["coverage"]["actors"]["reached"] == 1


def test_a_signal_while_the_second_test_is_compiled_keeps_the_first(
    soter: Soter, corridor: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from soter.explore.engine import search

    honest, made = search.Search.__init__, []

    def compile_(self: Any, *args: Any) -> None:
        made.append(self)
        if len(made) > 1:
            signal.raise_signal(signal.SIGTERM)
        honest(self, *args)

    monkeypatch.setattr(search.Search, "__init__", compile_)
    done = soter("test", corridor, "--json")
    assert done.exit == 130
    assert [t["name"] for t in done.document["tests"]] == ["Far"]
    assert done.document["not_started"] == ["Near"]


def test_the_time_of_a_search_is_a_bound_of_its_own(soter: Soter, wide: str) -> None:
    done = soter("test", wide, "--time", "0.3", "--json")
    assert done.exit == 4
    assert [t["bound"] for t in done.document["tests"]] == ["time", "time"]
    said = soter("test", wide, "--time", "0.3", "--test", "First").out
    assert "no violation was found; the time that was allowed is over (--time)" in said


def test_the_memory_is_told_with_the_frontier(soter: Soter, corridor: str) -> None:
    (test,) = soter("test", corridor, "--test", "Near", "--json").document["tests"]
    memory = test["memory"]
    assert memory["total_bytes"] >= memory["table_bytes"] + memory["frontier_bytes"] > 0
