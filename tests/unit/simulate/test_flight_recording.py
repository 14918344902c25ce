"""Recordings of deployed programs: read as they are, or told, or refused; never taken for more."""

from __future__ import annotations

import hashlib
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import soter
from generators.c_packages import CART
from soter.core.layout import NEVER, state_layout
from soter.report.mcap_reading import log_messages
from soter.targets.posix_package import FIRST_LINE, flight_head

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt

    from soter.api import Program

    Records = npt.NDArray[Any]

UNTIL = "400ms"
SEED = 5


@pytest.fixture(scope="module")
def cart() -> Program:
    return soter.load(CART)


@pytest.fixture(scope="module")
def flown(cart: Program) -> Records:
    """The records of a run in which nobody was late."""
    run = cart.simulate(until=UNTIL, seed=SEED)
    trace = run.require_trace()
    record = np.dtype(
        [
            ("number", "<u8"),
            *((name, "<i8") for name in ("ct", "wake", "done", "raw", "counts", "late", "looked")),
            ("state", "u1", (trace.dtype.itemsize,)),
        ]
    )
    made = np.zeros(len(trace), dtype=record)
    made["number"] = np.arange(len(trace))
    made["ct"] = trace["header"]["ct"]
    made["state"] = np.ascontiguousarray(trace).view(np.uint8).reshape(len(trace), -1)
    decided = made["ct"] % run.system.modules[0].period_ns == 0
    made["late"], made["looked"] = (np.where(decided, x, NEVER) for x in (7_000, 9_000))
    return made


def head(cart: Program, **other: str) -> bytes:
    system = cart.flat(None, {})
    layout = state_layout(system)
    lines = {**flight_head(system, layout), "seed": str(SEED), **other}
    return "".join([f"{FIRST_LINE}\n", *(f"{k}={v}\n" for k, v in lines.items()), "\n"]).encode()


def end(data: bytes, instants: int) -> bytes:
    return f"end {instants:020} {hashlib.sha256(data).hexdigest()}\n".encode()


def recording(cart: Program, records: Records, instants: int | None = None) -> bytes:
    data = head(cart) + records.tobytes()
    return data + end(data, len(records) if instants is None else instants)


def told(cart: Program, tmp_path: Path, data: bytes) -> soter.Run:
    path = tmp_path / "flight.rec"
    path.write_bytes(data)
    return cart.simulate(recorded=path, log=tmp_path / "told.mcap")


def refused(cart: Program, tmp_path: Path, data: bytes) -> tuple[str, str]:
    with pytest.raises(soter.SoterError) as caught:
        told(cart, tmp_path, data)
    return caught.value.diagnostics[0].code, caught.value.diagnostics[0].message


def test_a_recording_tells_the_run_that_it_is_of(
    cart: Program, flown: Records, tmp_path: Path
) -> None:
    """All that the log says, but what only a clock knows."""
    run = cart.simulate(until=UNTIL, seed=SEED, log=tmp_path / "run.mcap")
    other = told(cart, tmp_path, recording(cart, flown))
    assert (other.trace_sha256, other.cut, other.seed) == (run.trace_sha256, "", SEED)
    assert [c.time_ns for c in other.changes] == [c.time_ns for c in run.changes] != []
    own, recorded = (list(log_messages(tmp_path / f"{name}.mcap")) for name in ("run", "told"))
    looks = [m for _, channel, m in recorded if channel == "soter/decisions"]
    assert looks
    assert {(m.pop("late_ns"), m.pop("done_ns")) for m in looks} == {(7_000, 9_000)}
    assert recorded == own


def test_a_recording_that_was_cut_is_told_up_to_there(
    cart: Program, flown: Records, tmp_path: Path
) -> None:
    data, begin, size = recording(cart, flown), len(head(cart)), flown.dtype.itemsize
    for length in (begin, begin + size - 1, begin + 7 * size, begin + 7 * size + 50, len(data) - 1):
        run = told(cart, tmp_path, data[:length])
        assert run.instants == min((length - begin) // size, len(flown))
        assert "its end is missing" in run.cut
        cut: list[str] = []
        list(log_messages(tmp_path / "told.mcap", cut.append)) if run.instants else cut.append(
            run.cut
        )
        assert cut == [run.cut]


def test_a_recording_with_instants_missing_is_read_up_to_them(
    cart: Program, flown: Records, tmp_path: Path
) -> None:
    """What a decision module read before its step is in the state of the instant before."""
    gap = np.delete(flown, [11, 12])
    run = told(cart, tmp_path, recording(cart, gap, len(flown)))
    assert (run.instants, run.cut.split(" missing")[0]) == (11, "2 instants are")
    run = told(cart, tmp_path, recording(cart, flown[:-1], len(flown)))
    assert (run.instants, run.cut.split(" missing")[0]) == (len(flown) - 1, "1 instant is")


def test_what_contradicts_itself_is_refused(cart: Program, flown: Records, tmp_path: Path) -> None:
    swapped = flown.copy()
    swapped[[4, 5]] = flown[[5, 4]]
    renumbered = swapped.copy()
    renumbered["number"] = flown["number"]
    twice = np.insert(flown, 9, flown[3])
    other = flown.copy()
    other["ct"][6] += 1
    bit = bytearray(recording(cart, flown))
    bit[len(bit) // 2] ^= 1
    for data in (
        *(recording(cart, x) for x in (renumbered, twice, other)),
        recording(cart, flown, len(flown) - 1),
        bytes(bit),
    ):
        code, text = refused(cart, tmp_path, data)
        assert (code, "it is damaged" in text) == ("D006", True)
    assert told(cart, tmp_path, recording(cart, swapped)).instants == 4


@pytest.mark.parametrize(
    ("other", "named"),
    [
        ({"program_sha256": "0" * 64}, "program_sha256 was 000"),
        ({"system": "Unprotected"}, "system was Unprotected in it, and is Protected here"),
        ({"layout": "x"}, "layout was x"),
        ({"param GAIN": "3"}, "GAIN was 3 in it, and is the default here"),
    ],
)
def test_a_recording_of_something_else_is_refused(
    cart: Program, flown: Records, tmp_path: Path, other: dict[str, str], named: str
) -> None:
    data = head(cart, **other) + flown.tobytes()
    code, text = refused(cart, tmp_path, data + end(data, len(flown)))
    assert (code, named in text) == ("D023", True)


@pytest.mark.parametrize("data", [b"", b"\n\n", b"soter recording 2\nseed=1\n\n", b"\x89MCAP0\r\n"])
def test_what_is_no_recording_is_refused(cart: Program, tmp_path: Path, data: bytes) -> None:
    assert refused(cart, tmp_path, data)[0] == "D006"


def test_a_flight_that_is_over_has_no_other_end(cart: Program) -> None:
    for more in ({"until": "1s"}, {"real_time": True}):
        with pytest.raises(soter.SoterError) as caught:
            cart.simulate(recorded="flight.rec", **more)
        assert caught.value.diagnostics[0].code == "U001"


def test_what_a_sensor_said_stands_in_the_log_when_it_came(tmp_path: Path) -> None:
    """Its stamps are of measurements, between instants."""
    vehicle = soter.load(CART.with_name("stop_vehicle.soter"))
    run = vehicle.simulate(system="Vehicle", until="500ms")
    trace = run.require_trace().copy()
    topic = next(t for t in run.system.topics if t.driver == "input")
    came = np.arange(3, len(trace), 2)
    for row in came:
        trace["topics"][topic.name][row:] = row
        trace["stamps"][row:, topic.index] = int(trace["header"]["ct"][row]) - 1_234_567
    run.trace = trace
    log = vehicle.write_log(run, tmp_path / "vehicle.mcap")
    said = [(t, m["value"]) for t, channel, m in log_messages(log) if channel == topic.name]
    assert said[0][0] == trace["header"]["ct"][0]
    assert said[1:] == [(int(trace["header"]["ct"][row]), row) for row in came]


LISTS = """soter 1;
topic path: float[<=4];
node A period 10ms { publishes path; step { publish path = [1.0, 2.0]; } }
system S { node A; until 100ms; }
"""


def test_a_state_that_is_none_is_refused_where_no_hash_speaks_for_it(tmp_path: Path) -> None:
    source = tmp_path / "lists.soter"
    source.write_text(LISTS)
    lists = soter.load(source)
    run = lists.simulate()
    states = run.require_trace().copy()
    states["topics"]["path"]["len"][5] = 5
    head_lines = {**flight_head(run.system, run.layout), "seed": "1"}
    lines = [FIRST_LINE, *(f"{k}={v}" for k, v in head_lines.items()), "", ""]
    beside = [(n, *states["header"]["ct"][[n]], 0, 0, 0, 0, 0, 0) for n in range(len(states))]
    records = [struct.pack("<8q", *b) + s.tobytes() for b, s in zip(beside, states, strict=True)]
    code, text = refused(lists, tmp_path, "\n".join(lines).encode() + b"".join(records))
    assert (code, "a length of 5" in text) == ("D006", True)
