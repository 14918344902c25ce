"""A program in somebody's own loop: what is taken, what is run, what is told, in C and in C++."""

from __future__ import annotations

import math
import random
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest

import processes
import soter
from generators.c_packages import EXAMPLES, make, package
from long_tests import examples, seeds
from processes import PIPE
from soter.api.deploy.building import stack_bound
from soter.core.layout import state_layout
from soter.language.evaluate.arithmetic import FaultKind
from soter.native.compiler import MEANING, WARNINGS, find_compiler
from soter.native.shared_library import CHECK_FAILED
from soter.native.stack_bound import SILENT
from soter.semantics.configuration import NEVER
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import next_instant
from soter.simulate.run import state_bytes
from tables import all_rows

CART = EXAMPLES / "wall" / "cart_firmware.soter"
SHUTTLE = EXAMPLES / "wall" / "shuttle_firmware.soter"
FILES = Path(__file__).parent / "files"
SCRIPT = FILES / "firmware_script.c"
LIBRARY = 256
"""Bytes that `memset` and `strcmp` may take."""
LOOPS = examples(12)
MS = 1_000_000
RAN, BEHIND, LATE, TIME_BACKWARDS, UNHEARD, LATCHED, REFUSED = 1, 2, 4, 8, 16, 32, 64
STALE = 256
TAKEN, NOT_FINITE, NOT_IN_SET, OLDER, FROM_FUTURE, BACKWARDS, NOT_STARTED = 0, 1, 2, 4, 5, 6, 7
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Werror")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package of the cart in the world, and its library."""
    folder = tmp_path_factory.mktemp("firmware") / "cart_c"
    soter.load(CART).build("c", folder)
    done = make(folder, "lib", f"CFLAGS=-O2 {' '.join(WARNINGS)}")
    assert done.returncode == 0, done.stderr
    return folder


def linked(built: Path, compiler: list[str], source: Path, *flags: str) -> Path:
    """A main of one's own with the library of the package."""
    target = built / f"{source.stem}_{'_'.join(Path(compiler[-1]).parts[-1:])}"
    words = [
        *compiler,
        *flags,
        *STRICT,
        f"-I{built}",
        str(source),
        str(CHECK_FAILED),
        str(built / "libcart_firmware.a"),
    ]
    done = processes.run(
        [*words, "-lm", "-pthread", "-o", str(target)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return target


def compilers(*names: str) -> list[str]:
    available = [n for n in names if shutil.which(n)]
    return available or [pytest.param("", marks=pytest.mark.skip(reason="none is here"))]  # type: ignore[list-item]


# ---------------------------------------------------------------- told line by line


@dataclass
class Step:
    """What a step said, and what could be read then."""

    said: int
    state: str
    accel: float
    ever: bool
    stamp: int
    mode: int
    next: int
    lateness: int
    late_steps: int
    behind_steps: int


class Told:
    """The program, told a list of lines at once."""

    def __init__(self, built: Path) -> None:
        self.own = linked(built, list(find_compiler().command), SCRIPT, "-std=c99", *MEANING)

    def __call__(self, *lines: str) -> list[int | str | Step]:
        text = "\n".join(lines) + "\n"
        with processes.started([self.own], stdin=PIPE, stdout=PIPE, text=True) as process:
            out, _ = process.communicate(text)
        assert process.returncode == 0
        return [_answer(x) for x in out.splitlines()]


def _answer(line: str) -> int | str | Step:
    words = line.split()
    if len(words) == 10:
        said, state, accel, ever, *rest = words
        return Step(int(said), state, float.fromhex(accel), ever == "1", *map(int, rest))
    return int(line) if line.isdigit() else line


@pytest.fixture(scope="module")
def told(built: Path) -> Told:
    return Told(built)


def steps(answers: list[int | str | Step]) -> list[Step]:
    return [a for a in answers if isinstance(a, Step)]


def ticks(first: int, count: int, origin: int = 0, x: float = 0.0) -> list[str]:
    """A loop that is on time: a reading and a step every 5 ms."""
    lines = []
    for k in range(first, first + count):
        now = origin + k * 5 * MS
        lines += [f"motion {x} 0.0 {now} {now}", f"step {now}"]
    return lines


def test_nothing_is_run_or_taken_before_a_start_or_after_one_that_was_refused(told: Told) -> None:
    unstarted, taken = told("step 0", "motion 0 0 0 0")
    assert isinstance(unstarted, Step)
    assert unstarted.said == REFUSED
    assert taken == NOT_STARTED
    words, after = told("older 0", "step 0")
    assert "another layout" in str(words)
    assert isinstance(after, Step)
    assert after.said == REFUSED


def test_a_value_is_taken_or_refused_with_the_reason(told: Told) -> None:
    lines = [
        "start 1000",
        "motion nan 0 1000 1000",
        "motion 0 inf 1000 1000",
        "goal 51 1000 1000",
        "goal 5 1001 1000",
        "goal 5 1000 999",
        "goal 5 900 1000",
        "goal 6 899 1000",
        "goal 7 900 1000",
    ]
    wanted = [NOT_FINITE, NOT_FINITE, NOT_IN_SET, FROM_FUTURE, BACKWARDS, TAKEN, OLDER, TAKEN]
    assert told(*lines) == ["started", *wanted]


def test_time_never_goes_backwards_and_nothing_is_run_then(told: Told) -> None:
    answers = told("start 0", "motion 0 0 0 0", "step 10000000", "step 9999999", "step 10000000")
    first, back, same = steps(answers)
    assert first.said & RAN
    assert back.said == TIME_BACKWARDS
    assert back.state == same.state == first.state
    assert not same.said & RAN


def test_a_late_loop_is_told_and_every_instant_is_run(told: Told) -> None:
    on_time = steps(told("start 0", "motion 0 0 0 0", *[f"step {k * 10 * MS}" for k in range(4)]))
    late = steps(told("start 0", "motion 0 0 0 0", "step 0", f"step {30 * MS + 2 * MS}"))
    assert [s.said & (LATE | BEHIND) for s in on_time] == [0, 0, 0, 0]
    assert late[1].said & BEHIND
    assert late[1].said & LATE, "SC may be 1 ms late"
    assert late[1].state == on_time[3].state, "the same instants, in the same order"
    assert late[1].lateness == 22 * MS
    assert (late[1].late_steps, late[1].behind_steps) == (1, 1)
    in_time = steps(told("start 0", "motion 0 0 0 0", "step 1000000", f"step {10 * MS + MS}"))
    assert [s.said & LATE for s in in_time] == [0, 0], "1 ms is what the module declares"
    too_late = steps(told("start 0", "motion 0 0 0 0", "step 0", f"step {10 * MS + MS + 1}"))
    assert too_late[1].said & LATE


def test_what_was_never_published_is_told_and_stale(told: Told) -> None:
    (first,) = steps(told("start 0", "goal 9 0 0", "step 0"))
    assert first.said & UNHEARD
    assert first.mode == 0, "absent is stale: AC gets no control"
    (heard,) = steps(told("start 0", "goal 9 0 0", "motion 0 0 0 0", "step 0"))
    assert not heard.said & UNHEARD
    assert heard.mode == 1


@pytest.mark.parametrize("trouble", ["nan", "nothing", "outside"])
def test_two_bad_ticks_of_a_sensor_cost_control_at_most_and_latch_nothing(
    told: Told, trouble: str
) -> None:
    """Three DM periods of silence: SC takes over; AC is back at the first fresh look after it."""
    lines = ["start 0", "goal 0 0 0", *ticks(0, 20)]
    for k in range(20, 60):
        now = k * 5 * MS
        if trouble == "nan":
            lines.append(f"motion nan 0.0 {now} {now}")
        elif trouble == "outside":
            lines.append(f"motion 0.0 -inf {now} {now}")
        lines.append(f"step {now}")
    lines += ticks(60, 40)
    records = steps(told(*lines))
    assert [records[k].mode for k in (19, 20, 59)] == [1, 1, 0], "stale after 20 ms, seen in 50 ms"
    assert {s.mode for s in records[60:]} == {1}, "the DM of 300 ms finds it fresh"
    assert not any(s.said & (LATCHED | LATE | BEHIND) for s in records)
    old = [k for k, s in enumerate(records) if s.said & STALE]
    assert old == list(range(24, 60, 2)), "SC's steps from 120 ms on, 25 ms after the last value"
    short = ["start 0", "goal 0 0 0", *ticks(0, 20)]
    for k in (20, 21):
        now = k * 5 * MS
        short += [f"motion nan 0.0 {now} {now}"] if trouble == "nan" else []
        short.append(f"step {now}")
    two = steps(told(*short, *ticks(22, 40)))
    assert {s.mode for s in two} == {1}, "two ticks are younger than `max_age`"
    assert not any(s.said & LATCHED for s in two)


@pytest.mark.parametrize(("measured", "stale"), [(0, 0), (-1, STALE)])
def test_what_is_as_old_as_it_may_be_is_not_stale(told: Told, measured: int, stale: int) -> None:
    lines = ["start 0", "goal 0 0 0", f"motion 0.0 0.0 {measured} 0"]
    first, second, third = steps(told(*lines, "step 0", f"step {10 * MS}", f"step {20 * MS}"))
    assert (first.said & STALE, second.said & STALE, third.said & STALE) == (0, 0, stale)


# ---------------------------------------------------------------- a long time


def test_a_thousand_million_ticks_later_every_instant_is_where_it_belongs(told: Told) -> None:
    """10^9 periods of 10 ms, 115 days: jumped over, then stepped; the calendar is exact."""
    by = 1_000_000_000 * 10 * MS
    origin = 77
    near = [f"start {origin}", *ticks(0, 12, origin)]
    far = [f"start {origin}", f"jump {by}", *ticks(0, 12, origin + by)]
    for a, b in zip(steps(told(*near)), steps(told(*far)), strict=True):
        assert (b.said, b.accel, b.mode) == (a.said, a.accel, a.mode)
        assert b.next - a.next == by
        assert b.stamp - a.stamp == by
        assert b.lateness == a.lateness == 0


# ---------------------------------------------------------------- against the interpreter


class Model:
    """The interface over the reference interpreter, written from docs/semantics.md."""

    def __init__(self, origin: int) -> None:
        self.system = soter.load(CART).flat()
        self.names = {t.name.rpartition(".")[2]: t.index for t in self.system.topics}
        self.interpreter = Interpreter(self.system, seed=1)
        self.c = self.interpreter.initial()
        self.record = self.interpreter.record()
        self.origin, self.now = origin, origin
        self.stale = False

    def publish(self, topic: str, value: object, measured: int, now: int) -> int:
        if now < self.now:
            return BACKWARDS
        self.now = now
        if measured > now:
            return FROM_FUTURE
        index = self.names[topic]
        at = min(measured - self.origin, next_instant(self.interpreter.machine, self.c))
        if at < self.c.stamps[index]:
            return OLDER
        self.c, refused = self.interpreter.publish_input(self.c, index, value, at)
        kinds = {FaultKind.NONFINITE: NOT_FINITE, FaultKind.RANGE: NOT_IN_SET}
        return TAKEN if refused is None else kinds[refused]

    def step(self, now: int) -> str | None:
        """The state as bytes; None where time went backwards."""
        if now < self.now:
            return None
        self.now = now
        self.stale = False
        while (at := next_instant(self.interpreter.machine, self.c)) <= now - self.origin:
            stamp = self.c.stamps[self.names["motion"]]
            self.stale |= at % (10 * MS) == 0 and stamp != NEVER and at - stamp > 20 * MS
            self.c = self.interpreter.instant(self.c, choose_input=lambda _: (), record=self.record)
        layout = state_layout(self.system)
        return state_bytes(self.system, layout, self.c, self.record, 1).hex()


def script(seed: int) -> list[tuple[str, tuple[float, ...], int, int]]:
    """A loop that is late, hurried, confused about time and lied to."""
    rng = random.Random(seed)  # noqa: S311 - not a secret
    now, calls = rng.choice([0, 5, -(10**15), 10**15]), []
    origin = now
    for _ in range(120):
        now += rng.choice([0, MS, 5 * MS, 5 * MS, 5 * MS + 1, 12 * MS, 37 * MS])
        told = now - rng.choice([0, 0, 0, 0, 0, 0, 0, 3])
        measured = told + rng.choice([0, 0, 0, -1, -MS, -9 * MS, -80 * MS, 1])
        kind = rng.choice(["motion", "motion", "goal", "step", "step"])
        wild = rng.random() < 0.1
        x = rng.choice([math.nan, math.inf, 1e300]) if wild else rng.uniform(-9.5, 9.5)
        values = (x, rng.uniform(-7, 7)) if kind == "motion" else (x,)
        calls.append((kind, values, measured, told))
    return [("start", (), origin, origin), *calls]


@all_rows("seed", seeds(LOOPS))
@pytest.mark.random
def test_a_loop_gives_the_states_of_the_reference_interpreter(told: Told, seed: int) -> None:
    lines: list[str] = []
    wanted: list[int | str | None] = []
    old: list[bool] = []
    model = Model(0)
    for kind, values, measured, now in script(seed):
        if kind == "start":
            model = Model(now)
            lines.append(f"start {now}")
            wanted.append("started")
        elif kind == "step":
            lines.append(f"step {now}")
            wanted.append(model.step(now))
            old.append(wanted[-1] is not None and model.stale)
        else:
            value = values if kind == "motion" else values[0]
            lines.append(f"{kind} {' '.join(map(repr, values))} {measured} {now}")
            wanted.append(model.publish(kind, value, measured, now))
    answers = told(*lines)
    assert len(answers) == len(wanted)
    for line, got, want in zip(lines, answers, wanted, strict=True):
        if isinstance(got, Step):
            assert (None if got.said == TIME_BACKWARDS else got.state) == want, line
        else:
            assert got == want, line
    assert [bool(got.said & STALE) for got in answers if isinstance(got, Step)] == old


# ---------------------------------------------------------------- stack


@pytest.mark.parametrize("name", compilers("gcc", "clang"))
def test_the_stack_that_is_used_is_within_the_bound_and_not_far_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv("SOTER_CC", name)
    find_compiler.cache_clear()
    try:
        made = soter.load(CART).build("c", tmp_path / "cart_c")
        bound = stack_bound(made)
        assert make(tmp_path / "cart_c", "lib").returncode == 0
    finally:
        find_compiler.cache_clear()
    target = tmp_path / "stack"
    words = [name, "-O1", "-w", f"-I{tmp_path / 'cart_c'}", str(FILES / "firmware_stack.c")]
    words += [
        str(CHECK_FAILED),
        str(tmp_path / "cart_c" / "libcart_firmware.a"),
        "-lm",
        "-Wl,-z,now",
        "-o",
        str(target),
    ]
    assert processes.run(words, capture_output=True, text=True).returncode == 0
    used = int(processes.run([target], capture_output=True, text=True).stdout)
    assert bound.bytes is not None, bound.why
    assert set(bound.not_counted) <= {"memset", "strcmp", "memcpy", "sqrt"}
    assert used <= bound.bytes + LIBRARY, "what libc needs comes on top"
    assert used > bound.bytes // 4, "the bound is of the same code"


def test_the_trusted_drone_needs_no_more_than_eight_kibibytes(tmp_path: Path) -> None:
    made = soter.load(EXAMPLES / "drone" / "motion_primitive.soter").build("c", tmp_path / "out")
    bound = stack_bound(made)
    if bound.why == SILENT:
        pytest.skip(bound.why)
    assert bound.bytes is not None, bound.why
    assert bound.bytes <= 8 * 1024


# ---------------------------------------------------------------- the page


def test_the_page_names_what_there_is(tmp_path: Path) -> None:
    page = (EXAMPLES.parent / "docs" / "deploy.md").read_text(encoding="utf-8")
    names = (
        "Vehicle_firmware.h",
        "soter_firmware.h",
        "soter.h",
        "soter_check.h",
        "shuttle_firmware.h",
    )
    package(SHUTTLE, tmp_path)
    headers = "".join((tmp_path / name).read_text() for name in names)
    there = set(re.findall(r"\w+", headers)) | {"SOTER_CC"}
    told = set(re.findall(r"\b(?:Vehicle|SOTER)_\w+", page)) - {"Vehicle_firmware"}
    assert len(told) > 15
    assert told <= there
    bits = set(re.findall(r"^#define (SOTER_\w+) \d+U", headers, re.MULTILINE))
    said = (tmp_path / names[1]).read_text()
    refusals = set(re.findall(r"^  (SOTER_\w+) = \d", said, re.MULTILINE))
    every = (bits | refusals) - {"SOTER_ENABLED", "SOTER_TAKEOVER", "SOTER_FIRST", "SOTER_TAKEN"}
    assert every - told == set(), "every word that may come back stands on the page"
    for name in re.findall(r"v\.(loop|state)\.(\w+)", page):
        assert f" {name[1]};" in headers or f" {name[1]}[" in headers


def test_the_page_shows_the_system_of_the_example() -> None:
    page = (EXAMPLES.parent / "docs" / "deploy.md").read_text(encoding="utf-8")
    shown = re.search(r"^```\n(import .*?)^```", page, re.MULTILINE | re.DOTALL)
    assert shown is not None
    assert shown[1] in SHUTTLE.read_text(encoding="utf-8")
