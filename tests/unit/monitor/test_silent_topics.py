"""What a verdict about a log rests on in the end: sensors that fall silent, wherever they stand.

Non-goals: topics with a `max_age` that the DM reads itself (`test_what_was_judged.py`).
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("numpy")

from json_documents import problems_of
from soter.cli.main import main

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

PROGRAM = """soter 1;
topic raw: float{of_raw}; topic half: float; topic seen: float{of_seen};
topic u: float in [-1.0, 1.0];
plant P period 10ms {{ drives raw = x; state x: float; }}
{nodes}
node One period 10ms {{ publishes u; step {{ publish u = 0.0; }} }}
node Two period 10ms {{ publishes u; step {{ publish u = 0.5; }} }}
rta Left {{ ac One; sc Two; period 100ms; safe {safe}; ttf {ttf} > 1.0; safer {ttf} < 0.5; }}
system S {{ p: P; module Left; {parts} }}
"""
ONE = "node A period 50ms { subscribes raw; publishes seen; step { publish seen = raw; } }"
CHAIN = """node A period 50ms { subscribes raw; publishes half; step { publish half = raw; } }
node B period 100ms { subscribes half; publishes seen; step { publish seen = half; } }"""
MEMORY = """node A period 50ms {
  subscribes raw, half; publishes seen; step { publish seen = 0.5 * half + 0.5 * raw; } }
node B period 50ms { subscribes seen; publishes half; step { publish half = seen; } }"""
ONCE = """node A period 50ms {
  subscribes raw; publishes seen; var last: float = -1.0;
  step { if raw != last { publish seen = raw; last = raw; } } }"""
EVERY_MS, LENGTH_MS, DIES_MS = 50, 4000, 1000
Rows = list[tuple[float, str]]


def rows(spoil: Callable[[int], bool], dead: str = "", every_ms: int = EVERY_MS) -> Rows:
    """Time (s) and cell of the sensor; another column goes on to the end."""
    values = ((t, f"{0.1 + t * 1e-6}") for t in range(0, LENGTH_MS + 1, every_ms))
    return [(t / 1e3, dead if spoil(t) else v) for t, v in values]


@pytest.fixture
def judge(tmp_path: Path, capsys: Any) -> Callable[..., Any]:
    """Exit code, what the document says of the module, and the text."""

    def command(
        given: Rows,
        nodes: str = ONE,
        *,
        of_raw: str = " max_age 200ms",
        of_seen: str = " max_age 1s",
        safe: str = "seen < 2.0",
        ttf: str = "seen",
        program: str = PROGRAM,
    ) -> Any:
        path, log, mapping = tmp_path / "p.soter", tmp_path / "log.csv", tmp_path / "map.json"
        named = [line.split()[1] for line in nodes.splitlines() if line.startswith("node")]
        parts = " ".join(f"node {n};" for n in named)
        path.write_text(
            program.format(
                of_raw=of_raw, of_seen=of_seen, nodes=nodes, safe=safe, ttf=ttf, parts=parts
            )
        )
        log.write_text("t,raw\n" + "".join(f"{t},{v}\n" for t, v in given))
        topics = {"raw": {"fields": {"value": "raw"}}}
        mapping.write_text(json.dumps({"time": {"from": "t"}, "topics": topics}))
        arguments = ["monitor", str(path), str(log), "--map", str(mapping)]
        code = main(arguments)
        told = capsys.readouterr().out
        assert main([*arguments, "--json"]) == code
        document = json.loads(capsys.readouterr().out)
        assert problems_of(document) == []
        return code, document["log"]["modules"]["Left"], told

    return command


@pytest.mark.parametrize("nodes", [ONE, CHAIN, MEMORY])
@pytest.mark.parametrize("dead", ["", "nan", "1e999"])
def test_a_dead_sensor_behind_nodes_of_the_program_is_not_judged(
    judge: Any, nodes: str, dead: str
) -> None:
    code, left, told = judge(rows(lambda t: t >= DIES_MS, dead), nodes)
    assert (code, left["judged"], left["stale"]) == (0, True, 0), "what the DM reads is young"
    assert 0.25 < left["judged_share"] < 0.34
    assert left["silent"] == pytest.approx(41 * (1 - left["judged_share"]), abs=2.1)
    assert left["last_heard"] == {"raw": 0.95}
    assert "Left: none of " in told
    assert "of the log, nothing was heard of `raw` after 0.950 s" in told


@pytest.mark.parametrize("nodes", [ONE, CHAIN, MEMORY])
def test_after_a_gap_what_is_heard_counts_again(judge: Any, nodes: str) -> None:
    """Also of nodes that read what they published while nothing was heard."""
    code, left, told = judge(rows(lambda t: 1000 <= t < 3000), nodes)
    assert (code, left["last_heard"]) == (0, {})
    assert 0.5 < left["judged_share"] < 0.6
    assert "nothing was heard" not in told


def test_a_node_that_says_nothing_more_hides_no_dead_sensor(judge: Any) -> None:
    code, left, _ = judge(rows(lambda t: t >= DIES_MS), ONCE, of_seen="")
    assert (code, left["last_heard"]) == (0, {"raw": 0.95})
    assert left["judged_share"] < 0.34


def test_a_sensor_that_was_outside_when_it_died_is_a_violation_as_before(judge: Any) -> None:
    given = [(t, "5.0" if v and t > 0.8 else v) for t, v in rows(lambda t: t >= DIES_MS)]
    code, left, _ = judge(given)
    assert (code, left["first_outside_s"]) == (3, 0.9)
    assert left["outside_late"] > 20, "reads that rest on what died are counted apart"


def test_of_a_node_it_counts_what_it_read_when_it_stepped(judge: Any) -> None:
    """Samples come every 200 ms, are there for 100 ms, and the node reads each as it comes."""
    nodes = ONE.replace("50ms", "200ms")
    code, left, _ = judge(
        rows(lambda _: False, every_ms=200), nodes, of_raw=" max_age 100ms", of_seen=" max_age 1s"
    )
    assert (code, left["judged_share"]) == (0, pytest.approx(40 / 41))


# ---------------------------------------------------------------- no `max_age`

DIRECT: dict[str, Any] = {"nodes": "", "of_raw": "", "safe": "raw < 2.0", "ttf": "raw"}


@pytest.mark.parametrize("dead", ["", "nan", "1e999"])
def test_a_measured_topic_without_an_age_that_dies_is_not_judged(judge: Any, dead: str) -> None:
    code, left, told = judge(rows(lambda t: t >= DIES_MS, dead), **DIRECT)
    assert (code, left["judged"], left["stale"]) == (0, True, 0)
    assert left["judged_share"] == pytest.approx(15 / 41), "ten of its periods behind 0.95 s"
    assert left["last_heard"] == {"raw": 0.95}
    assert "nothing was heard of `raw` after 0.950 s" in told


def test_dead_in_the_last_hundredth_it_is_judged_as_far_as_it_was_heard(judge: Any) -> None:
    given = rows(lambda t: t >= 0.99 * LENGTH_MS - 600, "")
    code, left, told = judge(given, **DIRECT)
    assert (code, left["last_heard"]) == (0, {"raw": 3.35})
    assert 0.9 < left["judged_share"] < 1.0
    assert "`raw` after 3.350 s" in told


def test_one_sample_is_no_flight(judge: Any) -> None:
    code, left, told = judge(rows(lambda t: t > 0), **DIRECT)
    assert (code, left["last_heard"]) == (0, {"raw": 0.0})
    assert left["judged_share"] == pytest.approx(11 / 41), "ten steps of the DM"
    assert "nothing was heard of `raw` after 0.000 s" in told


def test_slow_samples_are_judged_to_the_end(judge: Any) -> None:
    """It may be slower than the program says, and then stands among the assumptions."""
    code, left, told = judge(rows(lambda t: t % 1000 != 0), **DIRECT)
    assert (code, left["judged_share"], left["last_heard"]) == (0, 1.0, {})
    assert "`raw` has no `max_age`: its reads count however old, here up to 900 ms" in told


def test_a_predicate_that_looks_at_the_age_itself_has_judged_it(judge: Any) -> None:
    given = {**DIRECT, "ttf": "raw + age(raw)"}
    code, left, _ = judge(rows(lambda t: t >= DIES_MS), **given)
    assert (code, left["judged_share"]) == (0, 1.0)
    assert left["last_heard"] == {"raw": 0.95}, "and it is named all the same"
    assert left["changes"][-1]["to"] == "SC"


def test_an_input_that_is_set_once_counts_and_is_named_where_it_was_said_again_and_again(
    judge: Any,
) -> None:
    """A goal is not published again; nobody knows whether a joystick lets go or is dead."""
    program = PROGRAM.replace("topic raw", "input topic raw").replace("drives raw = x; ", "")
    once = judge(rows(lambda t: t > 0), **DIRECT, program=program)[1]
    assert (once["judged_share"], once["last_heard"]) == (1.0, {})
    code, often, told = judge(rows(lambda t: t >= DIES_MS), **DIRECT, program=program)
    assert (code, often["judged_share"], often["last_heard"]) == (0, 1.0, {"raw": 0.95})
    assert "nothing was heard of `raw` after 0.950 s" in told


def test_where_nothing_was_young_enough_nothing_is_judged(judge: Any) -> None:
    """Samples come every 300 ms, each too old for what the node may read 200 ms later."""
    nodes = ONE.replace("period 50ms", "period 300ms phase 250ms")
    code, left, told = judge(rows(lambda t: t % 300 != 0), nodes)
    assert (code, left["judged"]) == (4, False)
    assert "what its reads rest on was too old, or silent" in told


def test_a_verdict_is_said_of_all_of_a_log_too_and_only_then_is_its_page_green(
    judge: Any, tmp_path: Path, capsys: Any
) -> None:
    page = tmp_path / "page.html"
    again = ["monitor", *(str(tmp_path / n) for n in ("p.soter", "log.csv"))]
    again += ["--map", str(tmp_path / "map.json"), "--report", str(page)]
    _, left, told = judge(rows(lambda _: False), **DIRECT)
    assert (left["judged_share"], told.splitlines()[2]) == (
        1.0,
        "Left: none of 41 reads lay outside `safe`",
    )
    assert main(again) == 0
    assert '<p class="verdict good">' in page.read_text()
    assert judge(rows(lambda t: t >= DIES_MS), **DIRECT)[0] == 0
    assert main(again) == 0
    assert '<p class="verdict ">' in page.read_text(), "a part is no reason for green"
    capsys.readouterr()
