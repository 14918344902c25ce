"""`soter_publish` and `Interpreter.publish_input`: what is taken, refused, or absent."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pytest

from generators.engine_comparison import Subject, compile_library, subject
from generators.outside_input_driver import Outside
from soter.core.layout import encode_into, size_of, struct_of
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.model.system import environment_topics
from soter.semantics.configuration import AC, NEVER, SC
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import discrete_time_progress_step

if TYPE_CHECKING:
    from pathlib import Path

    from soter.language.model.types import Value

MS = 1_000_000
PROGRAM = """soter 1;
type Kind = enum { Near, Far };
type Seen = { close: bool, at: float, kind: Kind, few: int in [0, 9] };
input topic x: float in [-1.0, 1.0] max_age 15ms;
input topic seen: Seen in { at in [0.0, 5.3] };
type Mark = int in [0, 99];
input topic marks: Mark[<=3];
topic u: float in [-1.0, 1.0];
topic count: int in [0, 99];
node Ac period 10ms { subscribes x; publishes u; step { publish u = 1.0; } }
node Sc period 10ms { subscribes x; publishes u; step { publish u = -1.0; } }
rta M { ac Ac; sc Sc; period 10ms; safe true; ttf x > 0.5; safer x < 0.5; }
node Reader period 30ms phase 20ms {
  subscribes x queue 3; publishes count;
  step { publish count = x.len; }
}
node Watcher period 40ms { subscribes seen, marks; step { } }
extern node Camera period 40ms phase 5ms { subscribes x; publishes seen2; failsafe seen2 = 0.0; }
topic seen2: float;
system S { module M; node Reader; node Watcher; node Camera; input x every 10ms; until 1s; }
"""


class Engine(Protocol):
    """One of the two, driven from outside."""

    subject: Subject

    def publish(self, topic: int, value: Value, time_ns: int) -> int: ...

    def instant(self) -> None: ...

    def topic(self, index: int) -> Value: ...

    def stamp(self, index: int) -> int: ...

    def mode(self) -> int: ...


class Native(Outside):
    """C; the camera never answers."""

    def instant(self) -> None:
        waiting = super().instant()
        while waiting is not None:
            self.answer(waiting, int(FaultKind.EXTERN))
            waiting = super().instant()

    def stamp(self, index: int) -> int:
        return int(self.record["stamps"][index])

    def mode(self) -> int:
        return int(self.record["modules"][0]["mode"])


class Interpreted:
    """The reference interpreter; the camera never answers."""

    def __init__(self, s: Subject) -> None:
        self.subject = s
        self.it = Interpreter(s.system, s.seed, {"Camera": lambda _: 1 / 0})
        self.c = self.it.initial()

    def publish(self, topic: int, value: Value, time_ns: int) -> int:
        self.c, refused = self.it.publish_input(self.c, topic, value, time_ns)
        return refused or 0

    def instant(self) -> None:
        self.c = self.it.instant(self.c, choose_input=lambda _: ())

    def topic(self, index: int) -> Value:
        return self.c.Topics[index]

    def stamp(self, index: int) -> int:
        return self.c.stamps[index]

    def mode(self) -> int:
        mode: int = self.c.L[self.subject.system.modules[0].dm]
        return mode


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Subject, Path]:
    s = subject("outside", PROGRAM, 3, 10)
    return s, compile_library([s], tmp_path_factory.mktemp("outside"), "-O1")


@pytest.fixture(params=["c", "interpreter"])
def engine(made: tuple[Subject, Path], request: pytest.FixtureRequest) -> Engine:
    s, library = made
    return Native(library, s) if request.param == "c" else Interpreted(s)


def index(engine: Engine, name: str) -> int:
    return engine.subject.system.topic(name).index


X, SEEN, MARKS = "x", "seen", "marks"


def test_the_topics_of_the_environment_are_its_inputs_and_no_queue(
    made: tuple[Subject, Path],
) -> None:
    system = made[0].system
    assert [system.topics[i].name for i in environment_topics(system)] == [X, SEEN, MARKS]
    assert len(system.topics) == 7


def test_a_value_of_the_set_is_taken_with_its_time(engine: Engine) -> None:
    x = index(engine, X)
    assert engine.publish(x, 0.25, -3 * MS) == 0
    assert (engine.topic(x), engine.stamp(x)) == (0.25, -3 * MS)
    engine.instant()
    assert engine.publish(x, -1.0, 4 * MS) == 0
    assert (engine.topic(x), engine.stamp(x)) == (-1.0, 4 * MS)
    assert engine.publish(index(engine, SEEN), (True, 5.0, 1, 9), 5 * MS) == 0
    assert engine.topic(index(engine, SEEN)) == (True, 5.0, 1, 9)
    assert engine.publish(index(engine, MARKS), (7, 0), 5 * MS) == 0
    assert engine.topic(index(engine, MARKS)) == (7, 0)


def test_the_float32_of_an_end_is_that_end(engine: Engine) -> None:
    """5.3 is 5.300000190734863 there: messages of robots have such numbers."""
    assert engine.publish(index(engine, SEEN), (True, 5.300000190734863, 0, 0), 0) == 0
    assert engine.topic(index(engine, SEEN)) == (True, 5.3, 0, 0)
    further = (True, 5.300000667572021, 0, 0)
    assert engine.publish(index(engine, SEEN), further, 0) == FaultKind.RANGE
    assert engine.topic(index(engine, SEEN)) == (True, 5.3, 0, 0)


def test_inputs_are_drawn_by_the_virtual_driver_and_not_by_the_kernel(engine: Engine) -> None:
    engine.instant()
    engine.instant()
    assert (engine.topic(index(engine, X)), engine.stamp(index(engine, X))) == (0.0, NEVER)


@pytest.mark.parametrize(
    ("name", "value", "kind"),
    [
        (X, 1.5, FaultKind.RANGE),
        (X, float("nan"), FaultKind.NONFINITE),
        (X, float("inf"), FaultKind.NONFINITE),
        (SEEN, (True, 5.5, 0, 0), FaultKind.RANGE),
        (SEEN, (True, float("-inf"), 0, 0), FaultKind.NONFINITE),
        (SEEN, (True, 1.0, 2, 0), FaultKind.EXTERN),
        (SEEN, (True, 1.0, 0, 10), FaultKind.EXTERN),
        (SEEN, (True, float("nan"), 2, 0), FaultKind.EXTERN),
        (MARKS, (1, 100), FaultKind.EXTERN),
        ("u", 0.0, FaultKind.EXTERN),
        ("count", 0, FaultKind.EXTERN),
        ("Reader.x.queue", (), FaultKind.EXTERN),
    ],
)
def test_a_refused_value_leaves_everything_as_it_was(
    engine: Engine, name: str, value: Value, kind: FaultKind
) -> None:
    assert engine.publish(index(engine, X), 0.125, 0) == 0
    engine.instant()
    before = [(engine.topic(t.index), engine.stamp(t.index)) for t in engine.subject.system.topics]
    assert engine.publish(index(engine, name), value, 1 * MS) == kind
    after = [(engine.topic(t.index), engine.stamp(t.index)) for t in engine.subject.system.topics]
    assert after == before


@pytest.mark.parametrize(
    ("time_ns", "kind"),
    [(2 * MS, 0), (2 * MS - 1, FaultKind.EXTERN), (5 * MS, 0), (5 * MS + 1, FaultKind.EXTERN)],
)
def test_a_time_lies_between_the_stamp_and_the_next_instant(
    engine: Engine, time_ns: int, kind: int
) -> None:
    engine.instant()  # at 0; the next is that of the camera, at 5 ms
    assert engine.publish(index(engine, X), 0.5, 2 * MS) == 0
    assert engine.publish(index(engine, X), 0.75, time_ns) == kind
    assert engine.topic(index(engine, X)) == (0.5 if kind else 0.75)


def test_while_an_instant_waits_nothing_is_newer_than_now(made: tuple[Subject, Path]) -> None:
    s, library = made
    native = Outside(library, s)
    assert native.instant() is None
    camera = s.system.component("Camera").index
    assert native.instant() == camera
    interpreted = Interpreted(s)
    interpreted.instant()
    interpreted.c = discrete_time_progress_step(interpreted.it.machine, interpreted.c)
    assert (camera,) == interpreted.c.FN
    for engine in (native, interpreted):
        assert engine.publish(0, 0.5, 5 * MS + 1) == FaultKind.EXTERN
        assert engine.publish(0, 0.5, 5 * MS) == 0


def test_nor_in_an_instant_that_releases_nobody(tmp_path: Path) -> None:
    text = PROGRAM.replace("input x every 10ms", "input x every 3ms")
    s = subject("drawn", text, 3, 10)
    native = Outside(compile_library([s], tmp_path, "-O1"), s)
    interpreted = Interpreted(s)
    native.instant()
    interpreted.instant()
    native.progress()
    it = interpreted.it
    c = discrete_time_progress_step(it.machine, interpreted.c)
    assert (c.ct, c.FN) == (3 * MS, ())
    for time_ns, kind in ((3 * MS, 0), (3 * MS + 1, FaultKind.EXTERN)):
        assert native.publish(0, 0.5, time_ns) == kind
        _, refused = it.publish_input(c, 0, 0.5, time_ns, within=True)
        assert (refused or 0) == kind


def test_what_is_published_goes_into_the_queues(engine: Engine) -> None:
    x, queue = index(engine, X), index(engine, "Reader.x.queue")
    for k, value in enumerate((0.1, 0.2, 7.0, 0.3, 0.4)):
        engine.publish(x, value, k - 9)
        if k == 2:
            assert engine.topic(queue) == (0.1, 0.2)
    assert engine.topic(queue) == (0.2, 0.3, 0.4)
    for _ in range(4):  # at 0, 5, 10 and 20 ms
        engine.instant()
    assert engine.topic(index(engine, "count")) == 3
    assert engine.topic(queue) == ()


def test_where_nothing_comes_the_value_grows_old_and_the_dm_sees_it(engine: Engine) -> None:
    x = index(engine, X)
    engine.publish(x, 0.0, 0)
    modes = []
    for _ in range(4):  # at 0, 5, 10 and 20 ms
        engine.instant()
        modes.append(engine.mode())
    assert modes == [AC, AC, AC, SC]


def test_bytes_that_are_no_part_of_the_value_stay_zero_in_c(made: tuple[Subject, Path]) -> None:
    s, library = made
    native = Outside(library, s)
    topic = s.system.topic(SEEN)
    raw = bytearray(size_of(topic.type))
    encode_into(raw, 0, topic.type, (True, 1.0, 0, 3))
    clean = bytes(raw)
    padding = struct_of(topic.type).padding
    assert padding > 0
    raw[-padding:] = b"\xaa" * padding
    close = next(m for m in struct_of(topic.type).members if m.name == "close")
    raw[close.offset] = 2
    assert native.publish_bytes(topic.index, bytes(raw), 0) == 0
    at = s.layout.topic_offset(topic.index)
    assert native.state[at : at + len(raw)].tobytes() == clean


def test_there_is_no_topic_beyond_the_last(made: tuple[Subject, Path]) -> None:
    s, library = made
    native = Outside(library, s)
    before = np.array(native.state)
    assert native.publish_bytes(len(s.system.topics), bytes(8), 0) == FaultKind.EXTERN
    assert (native.state == before).all()


def test_a_topic_nobody_draws_is_an_input_all_the_same(made: tuple[Subject, Path]) -> None:
    system = replace(made[0].system, inputs=())
    assert environment_topics(system) == environment_topics(made[0].system)
