"""A policy in Python against programs in C: bit for bit, and on a robot that runs."""

from __future__ import annotations

import random
import re
import shutil
import struct
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import processes
import soter
import soter.remote
from generators.c_packages import make
from generators.channel_programs import ended, going, soon
from generators.outside_input_driver import some_value
from generators.random_names import Namer
from generators.random_types import TypeMaker, text_of
from generators.seeded_choices import Seeded
from soter.codegen.c_names import field_name
from soter.core.layout import encode_into, size_of
from soter.language.model.types import FLOAT, INT_MIN, ArrayType, FloatType, ListType, RecordType
from soter.language.model.values import to_python
from soter.native.compiler import WARNINGS, find_compiler
from soter.remote.channel import Channel
from soter.targets.firmware_interface import described_type
from soter.targets.world_interface import number_of_layout

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.system import Topic
    from soter.language.model.types import Type, Value

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver is for Linux")
ROOT = Path(__file__).resolve().parents[2]
REMOTE = ROOT / "examples" / "wall" / "remote.soter"
POLICY = ROOT / "examples" / "wall" / "remote_policy.py"
TOPICS = 8
NUMBER_OF_A_FLOAT = number_of_layout(described_type(FLOAT))
FORGIVING = ("--misses", "1000000", "--late", "1000000")

# ---------------------------------------------------------------- Python against C, leaf by leaf


def program_of(seed: int) -> str:
    """A program whose topics, of random types, all come from outside."""
    choose = Seeded(seed)
    names = Namer(choose, 20)
    maker = TypeMaker(choose, names)
    maker.declare()
    topics: list[str] = []
    while len(topics) < TOPICS:
        t = maker.any(3)
        topics.append(f"input topic t{len(topics)}: {text_of(t)};")
    lines = ["soter 1;", *maker.declarations, *topics]
    read = ", ".join(f"t{k}" for k in range(TOPICS))
    lines.append(f"node Idle period 10ms {{ subscribes {read}; step {{}} }}")
    outside = " ".join(f"external topic t{k};" for k in range(TOPICS))
    return "\n".join([*lines, f"system Robot {{ {outside} node Idle; }}"])


def places(t: Type, value: Value, at: str) -> Iterator[tuple[str, int, bool]]:
    """Each number of a value as C reaches it, its bits, and whether it is a float."""
    if isinstance(t, RecordType):
        for (name, f), part in zip(t.fields, value, strict=True):
            yield from places(f, part, f"{at}.{field_name(name)}")
    elif isinstance(t, (ArrayType, ListType)):
        if isinstance(t, ListType):
            yield f"{at}.len", len(value), False
        inner = "at" if isinstance(t, ArrayType) else "items"
        for k, part in enumerate(value):
            yield from places(t.element, part, f"{at}.{inner}[{k}]")
    elif isinstance(t, FloatType):
        yield at, struct.unpack("<q", struct.pack("<d", value))[0], True
    else:
        yield at, int(value), False


def told(place: str, _: int, is_float: bool) -> str:
    return f"  tell({'of_double' if is_float else '(int64_t)'}({place}));\n"


def given(place: str, number: int, is_float: bool) -> str:
    constant = f"INT64_C({number})" if number > INT_MIN else "INT64_MIN"
    return f"  {place} = {f'to_double({constant})' if is_float else constant};\n"


def exchange(topic: Topic, kind: str, said: Value, answer: Value) -> str:
    """A function that tells every number of `said` and writes `answer`."""
    name = f"t{topic.index}"
    return f"""\
static int {name}(const char* folder) {{
  soter_outside channel;
  {kind} v;
  int64_t stamp = 0;
  const char* const wrong = robot_open_{name}(&channel, folder);
  if (wrong != NULL) {{ (void)printf("{name}: %s\\n", wrong); return 1; }}
  channel.number = 0; /* opened to write: read what is there all the same */
  if (!soter_outside_read(&channel, &stamp, &v, NULL)) {{ (void)printf("none\\n"); return 1; }}
  tell(stamp);
{"".join(told(*place) for place in places(topic.type, said, "v"))}
  memset(&v, 0, sizeof v);
{"".join(given(*place) for place in places(topic.type, answer, "v"))}
  soter_outside_write(&channel, stamp + 1, &v);
  return 0;
}}
"""


def source(header: str, topics: Sequence[Topic], said: list[Value], answers: list[Value]) -> str:
    """The whole program; `header`: the openers of the package."""
    kinds = dict(re.findall(r"/\* (t\d+): a `(\w+)`", header))
    parts = zip(topics, said, answers, strict=True)
    functions = "".join(exchange(t, kinds[t.name], value, answer) for t, value, answer in parts)
    calls = " || ".join(f"t{k}(arguments[1]) != 0" for k in range(TOPICS))
    return f"""\
#include "robot_channels.h"
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
int64_t of_double(double x);
double to_double(int64_t n);
int64_t of_double(double x) {{ int64_t n; memcpy(&n, &x, sizeof n); return n; }}
double to_double(int64_t n) {{ double x; memcpy(&x, &n, sizeof x); return x; }}
static void tell(int64_t n) {{ (void)printf("%" PRId64 "\\n", n); }}
{functions}
int main(int count, char** arguments) {{ return count != 2 || {calls} ? 1 : 0; }}
"""


@pytest.mark.parametrize("seed", range(4))
def test_values_of_every_type_are_the_same_in_python_and_in_c(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "robot.soter"
    path.write_text(program_of(seed))
    program = soter.load(path)
    program.build("posix", tmp_path / "out")
    system = program.declared("Robot")
    topics = system.topics[:TOPICS]
    chance = random.Random(seed)  # noqa: S311 - values, not secrets
    said, answers = ([some_value(t.type, t.bounds, chance) for t in topics] for _ in range(2))
    header = (tmp_path / "out" / "robot_channels.h").read_text()
    (tmp_path / "out" / "other.c").write_text(source(header, topics, said, answers))
    compiled(tmp_path / "out")
    channels = tmp_path / "channels"
    channels.mkdir()
    with soter.remote.connect(tmp_path / "out", channels=channels) as robot:
        stamps = []
        for topic, value in zip(topics, said, strict=True):
            stamps.append(time.monotonic_ns())
            action = to_python(topic.type, value, record=dict)
            robot.publish(topic.name, action, measured=stamps[-1])
        command = [tmp_path / "out" / "other", channels]
        refused = processes.run(command, capture_output=True, text=True)
        assert "it has a writer already" in refused.stdout
    done = processes.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    expected = []
    for topic, value, stamp in zip(topics, said, stamps, strict=True):
        expected += [stamp, *(n for _, n, _ in places(topic.type, value, ""))]
    assert [int(line) for line in done.stdout.split()] == expected
    with soter.remote.connect(tmp_path / "out", channels=channels) as robot:
        for topic, answer, stamp in zip(topics, answers, stamps, strict=True):
            reading = robot.read(topic.name)
            assert reading is not None
            assert reading.stamp == stamp + 1
            assert image(robot.topics[topic.name], reading.value) == exact(topic, answer)


def image(topic: soter.remote.topics.Topic, value: object) -> bytes:
    return topic.image(value, clip=False)


def exact(topic: Topic, value: Value) -> bytes:
    whole = bytearray(size_of(topic.type))
    encode_into(whole, 0, topic.type, value)
    return bytes(whole)


def compiled(folder: Path) -> None:
    own = [*WARNINGS, "-std=c99", "-I.", "-o", "other"]
    parts = ["other.c", "soter_outside.c", "soter_channel.c", "soter_posix_check.c"]
    command = [*find_compiler().command, *own, *parts]
    done = processes.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


# ---------------------------------------------------------------- the page


@contextmanager
def measuring(channels: Path) -> Iterator[None]:
    """Somebody who measures positions, again and again, until the block is left."""
    ended = threading.Event()

    def measure() -> None:
        with soter.remote.connect(REMOTE, system="Vehicle", channels=channels) as robot:
            x = 9.0
            while not ended.wait(0.002):
                x = x + 0.01 if x < 9.5 else 9.0
                robot.publish("position", x)

    thread = threading.Thread(target=measure)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def test_the_page_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(REMOTE, tmp_path)
    (tmp_path / "channels").mkdir()
    speed = Channel(tmp_path / "channels", "speed", NUMBER_OF_A_FLOAT, 8, writes=True)
    speed.write(time.monotonic_ns(), struct.pack("<d", 0.5))
    page = (ROOT / "docs" / "remote.md").read_text(encoding="utf-8")
    page_blocks = re.findall(r"^```python\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert len(page_blocks) == 4
    names: dict[str, object] = {"np": np, "soter": soter, "time": time}
    with measuring(tmp_path / "channels"):
        for number, text in enumerate(page_blocks):
            exec(compile(text, f"docs/remote.md, block {number + 1}", "exec"), names)  # noqa: S102


def test_plants_beside_a_robot_share_its_folder(programs: Programs, tmp_path: Path) -> None:
    for program in (programs.trusted, programs.world, programs.trusted):
        briefly = ("--until", "0.01", "--wait", "0", *FORGIVING)
        command: list[str | Path] = [program, "--channels", tmp_path, *briefly]
        done = processes.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


# ---------------------------------------------------------------- a robot that runs


@dataclass(frozen=True)
class Programs:
    """The trusted part, its actuators, the world around them."""

    trusted: Path
    actuator: Path
    world: Path


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Programs:
    folder = tmp_path_factory.mktemp("remote")
    for system in ("Vehicle", "World"):
        soter.load(REMOTE).build("posix", folder / system, system)
        done = make(folder / system, "CFLAGS=-O2 -Werror")
        assert done.returncode == 0, done.stdout + done.stderr
    trusted = folder / "Vehicle" / "remote"
    return Programs(trusted, trusted.with_name("remote_actuator"), folder / "World" / "remote")


@pytest.mark.real_time
def test_a_policy_drives_dies_and_is_started_again(programs: Programs, tmp_path: Path) -> None:
    package = programs.trusted.parent

    def policy(*options: str) -> list[str | Path]:
        return [sys.executable, POLICY, package, tmp_path, *options]

    with (
        going(programs.world, tmp_path, *FORGIVING),
        going(programs.actuator, tmp_path),
        soter.remote.connect(package, channels=tmp_path) as robot,
    ):

        def far() -> bool:
            reading = robot.read("position")
            return reading is not None and abs(reading.value) > 1.0

        def back() -> bool:
            reading = robot.read("position")
            return reading is not None and abs(reading.value) < 0.4

        with going(programs.trusted, tmp_path, *FORGIVING) as trusted:
            for options in ((), ("--chunks",)):
                with processes.started(policy(*options)) as process:
                    soon(far)  # SC alone stays in the middle
                    process.kill()
                    process.wait()
                soon(back)  # its wish grew old
            report = ended(trusted)
    assert report["violations"] == 0
    wish = report["topics"]["wish"]
    assert wish["taken"] > 0
    assert (wish["refused"], wish["future"], wish["bad"]) == (0, 0, 0)


@pytest.mark.real_time
def test_a_policy_that_says_nothing_new_is_no_policy(programs: Programs, tmp_path: Path) -> None:
    with (
        going(programs.world, tmp_path, *FORGIVING),
        going(programs.actuator, tmp_path),
        going(programs.trusted, tmp_path, *FORGIVING),
        soter.remote.connect(programs.trusted.parent, channels=tmp_path) as robot,
    ):
        old = time.monotonic_ns()
        for number, observation in enumerate(robot.every("position", timeout="60s")):
            robot.publish("wish", 1.0, measured=old)
            assert abs(observation["position"]) < 1.0, "who speaks of long ago never drives"
            if number == 200:
                break
