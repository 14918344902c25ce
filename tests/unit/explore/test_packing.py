"""Configurations packed and read back: nothing that decides the future is lost or mixed."""

from __future__ import annotations

import random
import struct
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from generators.explorer_configurations import (
    asking_stream,
    packed_bits,
    replay,
    stored_configurations,
    unpack_bits,
)
from soter.core.layout import NEVER
from soter.explore.engine.explorer_library import Engine, EngineSettings, RawChoice, RawStep
from soter.language.front_end import check_file, system_of_test
from unit.explore.random_configurations import ConfigurationMaker

if TYPE_CHECKING:
    import numpy.typing as npt

    from unit.explore.random_configurations import Field

    Configuration = npt.NDArray[np.uint8]

PROGRAMS = Path(__file__).parent / "programs"
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
SUBJECTS = (
    (PROGRAMS / "rich.soter", "Late"),
    (EXAMPLES / "testing" / "two_modules.soter", "BothStayInside"),
)
BIRTH = RawStep(-1, 4, -1, -1, ())


def engine_of(path: Path, test: str) -> Engine:
    return Engine(system_of_test(check_file(str(path)), test))


@pytest.fixture(scope="module", params=SUBJECTS, ids=[test for _, test in SUBJECTS])
def engine(request: pytest.FixtureRequest) -> Engine:
    path, test = request.param
    return engine_of(path, test)


@pytest.fixture(scope="module")
def rich() -> Engine:
    return engine_of(*SUBJECTS[0])


def born(engine: Engine) -> Configuration:
    return np.array(replay(engine, [BIRTH])[2][0])


def made(engine: Engine, fields: list[Field]) -> Configuration:
    configuration = born(engine)
    for f in fields:
        f.put(configuration, f.value)
    return configuration


def test_a_configuration_comes_back_as_it_was(engine: Engine) -> None:
    maker, scratch = ConfigurationMaker(engine, 1), born(engine)
    for _ in range(300):
        fields = maker.fields(maker.time())
        words = packed_bits(engine, made(engine, fields))
        unpack_bits(engine, words, scratch)
        for f in fields:
            assert repr(f.get(scratch)) == repr(f.value), f.name
        assert (packed_bits(engine, scratch) == words).all()


def test_configurations_that_differ_in_one_field_pack_differently(engine: Engine) -> None:
    maker, differed = ConfigurationMaker(engine, 2), set()
    for _ in range(30):
        fields = maker.fields(maker.time())
        configuration = made(engine, fields)
        words = packed_bits(engine, configuration)
        for f in fields:
            value = f.others()
            if repr(value) == repr(f.value):
                continue
            f.put(configuration, value)
            assert (packed_bits(engine, configuration) != words).any(), f.name
            f.put(configuration, f.value)
            differed.add(f.name)
        assert (packed_bits(engine, configuration) == words).all()
    assert {f.name for f in fields} - {"now"} <= {*differed, *constant(fields)}


def constant(fields: list[Field]) -> set[str]:
    """Names of fields that always have the same value in these tests."""
    return {f.name for f in fields if f.name.startswith("mask")}


def test_equal_configurations_at_different_times_have_different_words(engine: Engine) -> None:
    tick = engine.plan.tick_ns
    configuration = born(engine)
    at = ConfigurationMaker(engine, 3).layout.size
    seen = {packed_bits(engine, configuration).tobytes()}
    for k in range(engine.plan.horizon_ns // tick):
        struct.pack_into("<q", configuration.data, at, k * tick)
        seen.add(packed_bits(engine, configuration).tobytes())
    assert len(seen) == engine.plan.horizon_ns // tick + 1


def test_the_configuration_before_the_first_step_comes_back(engine: Engine) -> None:
    configuration = born(engine)
    again = made(engine, ConfigurationMaker(engine, 4).fields(engine.plan.tick_ns))
    unpack_bits(engine, packed_bits(engine, configuration), again)
    assert struct.unpack_from("<q", again.data, 0)[0] == -1
    assert (packed_bits(engine, again) == packed_bits(engine, configuration)).all()


def test_no_packed_configuration_is_all_zeros(engine: Engine) -> None:
    assert int(packed_bits(engine, np.zeros(engine.configuration_size, dtype=np.uint8))[0]) & 1 == 1


def test_what_nobody_reads_is_left_out(rich: Engine) -> None:
    configuration = born(rich)
    words = packed_bits(rich, configuration)
    unread = next(t for t in rich.system.topics if t.name == "unread")
    at = ConfigurationMaker(rich, 5).layout.topic_offset(unread.index)
    struct.pack_into("<d", configuration.data, at, 4.5)
    assert (packed_bits(rich, configuration) == words).all()


def test_a_topic_that_is_too_old_is_like_one_that_never_was(rich: Engine) -> None:
    topic = next(t for t in rich.system.topics if t.name == "at")
    assert topic.max_age_ns == 25_000_000
    maker = ConfigurationMaker(rich, 6)
    configuration = made(rich, maker.fields(50_000_000))
    at = maker.layout.stamp_offset + 8 * topic.index
    packed = {}
    for age in (20_000_000, 25_000_000, 30_000_000, 45_000_000):
        struct.pack_into("<q", configuration.data, at, 50_000_000 - age)
        packed[age] = packed_bits(rich, configuration).tobytes()
    struct.pack_into("<q", configuration.data, at, NEVER)
    never = packed_bits(rich, configuration).tobytes()
    assert packed[30_000_000] == packed[45_000_000] == never
    assert len({packed[20_000_000], packed[25_000_000], never}) == 3


def test_what_a_finished_step_once_held_does_not_matter(rich: Engine) -> None:
    maker = ConfigurationMaker(rich, 7)
    configuration = made(rich, maker.fields(30_000_000))
    number = next(i for i, a in enumerate(rich.actors) if a.overrun_ns)
    at = int(rich.model.actor[number].held)
    struct.pack_into("<q", configuration.data, at, -1)
    words = packed_bits(rich, configuration)
    struct.pack_into("<Q", configuration.data, at + 8, 0)
    configuration[at + 16] ^= 1
    assert (packed_bits(rich, configuration) == words).all()


def test_an_invariant_is_judged_for_two_periods_of_its_module(rich: Engine) -> None:
    kinds = {int(rich.model.timed[i].kind): rich.model.timed[i] for i in range(3)}
    assert int(kinds[2].within_ns) == 40_000_000
    assert int(kinds[1].within_ns) == 30_000_000


def test_every_stored_configuration_comes_back(engine: Engine) -> None:
    engine.explore(EngineSettings(max_states=5_000, keep=True))
    configurations = stored_configurations(engine)
    assert len(configurations) > 1_000
    scratch = born(engine)
    packed = set()
    for configuration in configurations:
        words = packed_bits(engine, configuration)
        unpack_bits(engine, words, scratch)
        assert (packed_bits(engine, scratch) == words).all()
        packed.add(words.tobytes())
    assert len(packed) == len(configurations)
    engine.close()


def candidates(engine: Engine, configuration: Configuration, at: int) -> list[RawStep]:
    """Steps that may come next, and many that may not; `at`: where the schedule is."""
    tick = engine.plan.tick_ns
    (now,) = struct.unpack_from("<q", configuration.data, at)
    done_at = at + 8 + 8 * int(engine.model.timeds) + 8 * len(engine.system.modules)
    done = struct.unpack_from(f"<{len(engine.actors)}I", configuration.data, done_at)
    steps = []
    for i, a in enumerate(engine.actors):
        release = a.phase_ns + done[i] * a.period_ns
        kinds = [2 if a.overrun_ns else 0] + ([1] if a.skips else [])
        for kind in kinds:
            asked = kind == 0 and a.name in {"input.hue", "Keep.AnyMove"}
            for pick in range(3 if asked else 1):
                choices = (RawChoice(asking_stream(a.name), 3, pick),) if asked else ()
                first = max(release, now)
                steps += [
                    RawStep(i, kind, release, time, choices)
                    for time in range(first, release + a.window_ns + 1, tick)
                ]
        if a.overrun_ns:
            (since,) = struct.unpack_from("<q", configuration.data, int(engine.model.actor[i].held))
            ends = range(max(since, now), since + a.overrun_ns + 1, tick) if since >= 0 else ()
            steps += [RawStep(i, 3, since, time, ()) for time in ends]
    return steps


def test_every_configuration_of_an_execution_comes_back_with_skips_and_overruns(
    rich: Engine,
) -> None:
    maker, draw, scratch = ConfigurationMaker(rich, 8), random.Random(8), born(rich)  # noqa: S311
    at, kinds = maker.layout.size, dict.fromkeys(range(4), 0)
    for _ in range(12):
        steps = [BIRTH]
        for _ in range(25):
            configuration = replay(rich, steps)[2][-1]
            some = candidates(rich, configuration, at)
            draw.shuffle(some)
            step = next((s for s in some if replay(rich, [*steps, s])[0] == len(steps) + 1), None)
            if step is None:
                break
            kinds[step.kind] += 1
            steps.append(step)
            configuration = replay(rich, steps)[2][-1]
            words = packed_bits(rich, configuration)
            unpack_bits(rich, words, scratch)
            (now,) = struct.unpack_from("<q", configuration.data, at)
            for f in maker.fields(now):
                if not f.name.startswith(("held", "mask", "stamp")):
                    assert repr(f.get(scratch)) == repr(f.get(configuration)), (f.name, len(steps))
            assert (packed_bits(rich, scratch) == words).all()
    assert all(n > 3 for n in kinds.values()), kinds
