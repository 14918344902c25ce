"""What a step reads and writes: the explorer's reduction and the frame of a proof rest on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_walks import cells_of_publication, walk, written_names

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.core import CoreSystem
    from soter.language.model.system import System

    Lowered = Callable[[str], tuple[System, CoreSystem]]

PROGRAM = """
input topic x: float in [-9.0, 9.0] max_age 50ms;
topic u: float in [-1.0, 1.0]; topic out: float; topic rest: float; topic log: float[<=3];
node Ac period 10ms { subscribes x; publishes u; step { publish u = 0.0; } }
node Sc period 10ms { subscribes x; publishes u; step { publish u = 0.0; } }
rta M { ac Ac; sc Sc; period 20ms; safe true; ttf x > 1.0; safer age(x) < 0.005; }
fun helper(a: float): float { return a * 2.0; }
node Busy period 10ms {
  subscribes x, u; publishes out, rest;
  var seen: int; var kept: float; var touched: float[<=3];
  step {
    if mode(M) == Mode.AC { publish rest = kept; }
    for i in 0..2 { if helper(u) > float(i) { push touched, age(x); } }
    publish out = 1.0;
  }
}
node Late period 10ms { subscribes out queue 2 fault; publishes log; step { publish log = []; } }
system S { module M; node Busy; node Late; until 1s; }
"""


def topics(system: System, cells: set[core.Cell]) -> set[str]:
    return {system.topics[c.owner].name for c in cells if c.kind == "topic"}


def of(system_pair: tuple[System, CoreSystem], name: str) -> core.NodeStep:
    system, lowered = system_pair
    return lowered.nodes[system.component(name).index]


def test_a_node_reads_its_locals_and_what_it_mentions_in_any_branch(lowered: Lowered) -> None:
    system_pair = lowered(PROGRAM)
    step = of(system_pair, "Busy")
    reads = step.footprint.reads
    assert topics(system_pair[0], reads) == {"u"}
    assert {c.name for c in reads if c.kind == "local"} == {"seen", "kept", "touched"}
    assert step.footprint.modes == {0}
    assert {system_pair[0].topics[i].name for i in step.footprint.stamps} == {"x", "out", "rest"}


def test_a_node_writes_the_locals_it_sets_and_all_it_publishes_with_its_queues(
    lowered: Lowered,
) -> None:
    system_pair = lowered(PROGRAM)
    writes = of(system_pair, "Busy").footprint.writes
    assert {c.name for c in writes if c.kind == "local"} == {"touched"}
    queue = next(t for t in system_pair[0].topics if t.queue_of is not None)
    assert topics(system_pair[0], writes) == {"out", "rest", queue.name}
    out = system_pair[0].topic("out").index
    assert [c.owner for c in cells_of_publication(system_pair[0], out)] == [out, queue.index]


def test_the_reader_of_a_queue_reads_and_empties_it_and_sees_its_loss(lowered: Lowered) -> None:
    system_pair = lowered(PROGRAM)
    system, step = system_pair[0], of(system_pair, "Late")
    queue = next(t for t in system.topics if t.queue_of is not None)
    cell = core.Cell("topic", queue.index, queue.name)
    assert cell in step.footprint.reads & step.footprint.writes
    assert queue.index in step.footprint.stamps


def test_a_predicate_has_the_stamps_and_topics_of_its_expression(lowered: Lowered) -> None:
    system, made = lowered(PROGRAM)
    x = system.topic("x").index
    (decision,) = made.decisions
    assert topics(system, decision.ttf.footprint.reads) == {"x"}
    assert decision.ttf.footprint.stamps == set()
    assert decision.safer.footprint.reads == set()
    assert decision.safer.footprint.stamps == {x}


def test_names_that_are_assigned_pushed_to_or_aged_are_written(lowered: Lowered) -> None:
    _, made = lowered(
        """topic y: int;
        node N period 10ms {
          publishes y; var a: int; var b: int[<=2]; var c: int;
          step {
            let d = fair choose [1, 2];
            if c > 0 { a = d; } else { push b, 1; }
            publish y = a;
          }
        }
        system S { node N; until 1s; }"""
    )
    step = made.nodes[0]
    written = {x.cell.name for x in step.locals if x.written}
    assert written == {x.cell.name for x in step.locals} - {"c"}
    assert {x.name for x in step.locals if x.written} <= written_names(step.body)


def test_walk_comes_by_every_expression_in_order(lowered: Lowered) -> None:
    system_pair = lowered(PROGRAM)
    body = of(system_pair, "Busy").body
    nodes = list(walk(body))
    published = [n.output for n in nodes if isinstance(n, core.Publish)]
    assert published == [1, 0]
    facts = [n.fact for n in nodes if isinstance(n, core.Fact)]
    assert facts == ["mode", "age"]
    assert sum(isinstance(n, core.Call) for n in nodes) == 1
    assert {n.span for n in nodes if isinstance(n, core.Stmt)} >= {s.span for s in body}
