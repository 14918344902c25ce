"""Messages of MAVLink as values of topics, in C: the bits that pymavlink decodes.

Non-goals: how messages come (`tests/correct/test_mavlink.py`), what a mapping may say
(`tests/unit/mapping/`, `tests/unit/cli/`).
"""

from __future__ import annotations

import math
import random
import shutil
import struct
from typing import Any

import pytest

pytest.importorskip("pymavlink", reason="the extra `robots` is not installed")

from pymavlink.dialects.v20 import common as mavlink

import processes
from soter.api import load
from soter.core.steps import lower
from soter.mapping.read_mapping import make_log_map
from soter.native.compiler import MEANING
from soter.targets.mavlink_package import mavlink_package

PROGRAM = """soter 1;
type Place = { x: float unit "m", y: float unit "m", z: float unit "m" };
type Attitude = { w: float, x: float, turn: float unit "deg/s" };
type Battery = {
  first: float unit "V", third: float unit "V", current: float unit "A", left: int
};
type Beat = { mode: int, armed: int };
topic place: Place;
topic attitude: Attitude;
topic battery: Battery;
topic beat: Beat;
topic far: float unit "m";
topic off: float unit "m";
topic out: Place in { x in [-9.0, 9.0], y in [-9.0, 9.0], z in [-9.0, 9.0] }
  = { x: 0.0, y: 0.0, z: 0.0 };
plant P period 10ms {
  reads out;
  drives place = { x: x, y: x, z: x };
  drives attitude = { w: x, x: x, turn: x };
  drives battery = { first: x, third: x, current: x, left: 1 };
  drives beat = { mode: 1, armed: 1 };
  drives far = x;
  drives off = x;
  state x: float = 0.0;
  der x = out.x;
}
node N period 10ms {
  subscribes place, attitude, battery, beat, far, off; publishes out; step { publish out = place; }
}
system S default { p: P; node N; until 1s; }
system W deploys S {
  external topic place every 10ms; external topic attitude every 10ms;
  external topic battery every 10ms; external topic beat every 10ms; external topic far every 10ms;
  external topic off every 10ms;
  external topic out; node N;
}
"""
MAPPING = {
    "mavlink": {"url": "udpin://127.0.0.1:14540"},
    "topics": {
        "place": {"type": "mavlink/LOCAL_POSITION_NED", "frame": "NED",
                  "fields": {"value": ["x", "y", "z"]}},
        "attitude": {"type": "mavlink/ODOMETRY", "set": {"frame_id": 1},
                     "fields": {"w": "q.0", "x": "q.1", "turn": "rollspeed"}},
        "battery": {"type": "mavlink/BATTERY_STATUS", "stamp": "arrival",
                    "fields": {"first": "voltages.0", "third": "voltages.2",
                               "current": "current_battery", "left": "battery_remaining"}},
        "beat": {"type": "mavlink/HEARTBEAT",
                 "fields": {"mode": "custom_mode", "armed": "base_mode"}},
        "far": {"type": "mavlink/DISTANCE_SENSOR",
                "fields": {"value": {"from": "current_distance", "scale": 1.5, "offset": -0.1}}},
        "off": {"type": "mavlink/GPS_RAW_INT", "fields": {"value": "h_acc"}},
        "out": {"type": "mavlink/SET_POSITION_TARGET_LOCAL_NED", "frame": "NED",
                "set": {"type_mask": 0xDF8, "coordinate_frame": 1},
                "fields": {"value": ["x", "y", "z"]}},
    },
}  # fmt: skip
MAIN = """
#define main bridge_main
#include "%(name)s_bridge.c"
#undef main
#include <stdio.h>
int soter_mavlink_main(const soter_mavlink_system* s, int count, char** words) {
  mavlink_message_t parsed, m;
  mavlink_status_t status, unused;
  union { double numbers[16]; int64_t words[16]; } value;
  int byte;
  (void)count;
  (void)words;
  memset(&status, 0, sizeof status);
  while ((byte = getchar()) != EOF) {
    if (mavlink_frame_char_buffer(&parsed, &status, (uint8_t)byte, &m, &unused) != 1) {
      continue;
    }
    for (size_t k = 0; k < s->ins; k++) {
      if (s->in[k].id == m.msgid) {
        memset(&value, 0, sizeof value);
        const bool fine = s->in[k].convert(&m, &value);
        printf("%%s %%d %%d %%lld", s->in[k].name, s->in[k].fits(&m), fine,
               (long long)s->in[k].stamp(&m));
        for (size_t w = 0; w < s->in[k].size / 8; w++) {
          printf(" %%016llx", (unsigned long long)value.words[w]);
        }
        printf("\\n");
      }
    }
  }
  mavlink_status_t sending;
  uint8_t bytes[300];
  memset(&sending, 0, sizeof sending);
  const soter_mavlink_envelope e = {s->own, s->sources[0], &sending, INT64_C(12345678901234)};
  const double out[3] = {1.1, -2.2, 3.3};
  s->out[0].convert(out, &e, &m);
  const size_t many = mavlink_msg_to_send_buffer(bytes, &m);
  for (size_t k = 0; k < many; k++) {
    printf("%%02x", bytes[k]);
  }
  printf("\\n");
  return 0;
}
int main(void) { return bridge_main(0, 0); }
"""


@pytest.fixture(scope="module")
def converted(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Frames to what the generated C makes of them."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler here")
    folder = tmp_path_factory.mktemp("c")
    (folder / "p.soter").write_text(PROGRAM)
    program = load(folder / "p.soter")
    assert program.ok, program.diagnostics
    system = program.flat("W")
    package = mavlink_package(system, lower(system), folder / "out", make_log_map(MAPPING, system))
    package.write()
    name = next((folder / "out" / "src").glob("*_bridge.c")).stem.removesuffix("_bridge")
    (folder / "main.c").write_text(MAIN % {"name": name})
    words = ["cc", "-std=c99", "-Wall", "-Wextra", "-Werror", *MEANING, "-D_GNU_SOURCE"]
    words += [f"-I{folder}/out/trusted", f"-I{folder}/out/src", "-isystem", f"{folder}/out/mavlink"]
    words += ["-o", str(folder / "main"), str(folder / "main.c")]
    done = processes.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr

    def run(messages: list[Any], version: int = 2) -> list[list[str]]:
        link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        frames = b"".join(bytes(m.pack(link, force_mavlink1=version == 1)) for m in messages)
        (folder / "frames").write_bytes(frames)
        with (folder / "frames").open("rb") as stream:
            told = processes.run(
                [str(folder / "main")], stdin=stream, capture_output=True, check=True
            )
        return [line.split() for line in told.stdout.decode().splitlines()]

    return run


def bits(*values: float) -> list[str]:
    """As the C prints them: whole numbers as they lie in memory, too."""
    words = [struct.pack("<d", v) if isinstance(v, float) else struct.pack("<q", v) for v in values]
    return [f"{int.from_bytes(w, 'little'):016x}" for w in words]


def float32(draw: random.Random) -> float:
    """Any, of every size, and sometimes none."""
    if draw.random() < 0.1:
        return draw.choice([0.0, -0.0, math.inf, -math.inf, 1e-42, 3.4e38])
    word = struct.pack("<I", draw.getrandbits(32))
    value = float(struct.unpack("<f", word)[0])
    return 1.0 if math.isnan(value) else value


def sent_and_read(message: Any) -> Any:
    """What pymavlink decodes of a frame."""
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return mavlink.MAVLink(None).decode(bytearray(message.pack(link)))


def test_positions_have_the_bits_that_pymavlink_decodes(converted: Any) -> None:
    draw = random.Random(1)  # noqa: S311 - any floats
    messages = [
        mavlink.MAVLink_local_position_ned_message(
            draw.getrandbits(32), *(float32(draw) for _ in range(6))
        )
        for _ in range(300)
    ]
    rows = converted(messages)[:-1]
    assert len(rows) == 300
    for row, m in zip(rows, map(sent_and_read, messages), strict=True):
        assert row[:4] == ["place", "1", "1", str(m.time_boot_ms * 10**6)]
        assert row[4:] == bits(m.y, m.x, -1.0 * m.z)


def odometry(frame: int, turn: float, usec: int) -> Any:
    zeros = [0.0] * 21
    return mavlink.MAVLink_odometry_message(
        usec, frame, 8, 0, 0, 0, [0.5, -0.25, 0, 0], 0, 0, 0, turn, 0, 0, zeros, zeros
    )


def test_units_constants_and_arrays_are_those_of_the_mapping(converted: Any) -> None:
    rows = converted([odometry(1, 0.75, 10**12 + 7), odometry(12, 0.75, 5)])
    factor = 1.0 / (math.pi / 180.0)
    expected = ["attitude", "1", "1", str((10**12 + 7) * 1000), *bits(0.5, -0.25, factor * 0.75)]
    assert rows[0] == expected
    assert rows[1][1] == "0"  # of another frame


def battery(first: int, third: int, current: int, left: int) -> Any:
    volts = [first, 3700, third, *([65535] * 7)]
    return mavlink.MAVLink_battery_status_message(0, 0, 0, 2500, volts, current, 0, 0, left)


def test_integers_are_scaled_from_their_unit(converted: Any) -> None:
    (row, _) = converted([battery(12345, 4100, -250, 83)])
    assert row[:4] == ["battery", "1", "1", "-1"]
    assert row[4:] == bits(0.001 * 12345.0, 0.001 * 4100.0, 0.01 * -250.0, 83)


@pytest.mark.parametrize(
    "values", [(65535, 4100, -250, 83), (12345, 65535, 5, 83), (12345, 4100, -1, 83), (1, 2, 3, -1)]
)
def test_a_number_that_means_not_known_is_no_value(converted: Any, values: Any) -> None:
    (row, _) = converted([battery(*values)])
    assert row[:3] == ["battery", "1", "0"]


def gps(h_acc: int) -> Any:
    return mavlink.MAVLink_gps_raw_int_message(
        5, 3, 0, 0, 0, 65535, 65535, 65535, 65535, 255, h_acc=h_acc
    )


def test_an_extension_is_no_value_in_mavlink_1_and_an_omitted_zero_is_0_in_mavlink_2(
    converted: Any,
) -> None:
    """Bytes of zero at the end of a frame are left out in version 2, as the standard says."""
    (known, zero, _) = converted([gps(1500), gps(0)])
    assert known == ["off", "1", "1", "5000", *bits(1.5)]
    assert zero[2:] == ["1", "5000", *bits(0.0)]
    place = mavlink.MAVLink_local_position_ned_message(7, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
    (old, whole, _) = converted([gps(1500), place], version=1)
    assert old[:3] == ["off", "1", "0"]
    assert whole == ["place", "1", "1", str(7 * 10**6), *bits(2.0, 1.0, -3.0)]


def test_modes_are_whole_numbers(converted: Any) -> None:
    (row, _) = converted([mavlink.MAVLink_heartbeat_message(2, 12, 193, 6 << 16, 4, 3)])
    assert row[4:] == bits(6 << 16, 193)


def test_scale_and_offset_come_after_the_unit(converted: Any) -> None:
    sensor = mavlink.MAVLink_distance_sensor_message(1000, 1, 500, 123, 0, 0, 0, 0)
    (row, _) = converted([sensor])
    assert row[3:] == [str(1000 * 10**6), *bits((1.5 * 0.01) * 123.0 + -0.1)]


def test_a_set_point_is_what_pymavlink_reads(converted: Any) -> None:
    (row,) = converted([])
    m = mavlink.MAVLink(None).decode(bytearray.fromhex(row[0]))
    assert m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    assert (m.get_srcSystem(), m.get_srcComponent()) == (1, 191)
    assert (m.target_system, m.target_component) == (1, 1)
    assert (m.type_mask, m.coordinate_frame) == (0xDF8, 1)
    assert m.time_boot_ms == 12345678901234 // 10**6 % 2**32
    rounded = [struct.unpack("<f", struct.pack("<f", v))[0] for v in (-2.2, 1.1, -3.3)]
    assert [m.x, m.y, m.z] == rounded
    assert [m.vx, m.yaw, m.afx] == [0.0, 0.0, 0.0]
