"""Flights that take their steps together are, to the last bit, those that are flown alone."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import processes
from generators.straight_programs import program
from long_tests import examples
from soter.campaign import batch_flights, compiled_unit
from soter.campaign.batch_flights import ENGINE, Fleet
from soter.campaign.compiled_unit import generate_measured
from soter.codegen.function_context import Frame
from soter.language.front_end import check_file, system_of
from soter.native.build import RUNTIME
from soter.native.compiler import STRICT, find
from soter.native.vector_instructions import VECTORS, vector_flags
from soter.simulate.run import run_interpreted

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.core.core import CoreSystem
    from soter.language.model.system import System

SECOND = 10**9
LARGE_VALUES = Path(__file__).resolve().parents[2] / "correct" / "large_values.soter"
HERE = VECTORS[VECTORS.index(vector_flags()) :] if vector_flags() else ()
"""Vectors that this machine has."""
PROGRAMS = examples("SOTER_LANE_PROGRAMS", quick=12, long=200)
MOVED = """faults {
    late Guard.dm by 2ms; late Guard.Calm by 2ms;
    skip Shape at 9000 per 1h for 40ms;
  }"""
DISTURBED = """faults {
    nan Guard.Bold at 20000 per 1h for 100ms;
    silent Shape at 9000 per 1h for 40ms;
  }"""


def whole(folder: Path, number: int, faults: str = "") -> System:
    file = folder / f"straight_{number}.soter"
    file.write_text(program(number, faults), encoding="utf-8")
    return system_of(check_file(str(file)), "Whole")


def parts_with_lanes(system: System) -> int:
    """How many steps and DMs of a system have lanes."""
    source = generate_measured(system).source
    tables = re.findall(r"_lanes_(?:step|decide)\[\] = \{(.*?)\n\};", source, re.DOTALL)
    return sum(len(re.findall(r"\w_lanes\b", table)) for table in tables)


@pytest.mark.parametrize("number", range(PROGRAMS))
def test_flights_together_are_flights_alone(number: int, tmp_path: Path) -> None:
    system = whole(tmp_path, number, ("", MOVED, DISTURBED)[number % 3])
    assert parts_with_lanes(system) >= (3 if number % 3 == 2 else 5)
    horizon_ns = SECOND if number % 4 == 3 else 0
    fleet = Fleet(system, 3 * SECOND, ("-O1", "-O3")[number % 2], horizon_ns=horizon_ns)
    together = fleet.fly(range(9), first_seed=number)
    assert together == [fleet.fly([k], first_seed=number)[0] for k in range(9)]
    assert together[1].violations == run_interpreted(system, 3 * SECOND, number + 1).violations


@pytest.mark.parametrize(
    "stored", ["d.s", "topics.made.a", "topics.command.x", "topics.counted.total"]
)
def test_steps_are_taken_together(
    stored: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Lanes that store something wrong are seen, so they are not left out."""

    def wrong(system: System, core: CoreSystem | None = None) -> Unit:
        unit = generate_measured(system, core)
        put = rf"(SOTER_LANE_PUT(?:_INT)?\(\w+,\s+{re.escape(stored)},\s+)([^,;]*?)(\)?[,;])"
        more = "1" if stored.endswith("total") else "0.125"
        source, count = re.subn(put, rf"\1(\2) + {more}\3", unit.source)
        assert count
        return replace(unit, source=source)

    monkeypatch.setattr(compiled_unit, "generate_measured", wrong)
    fleet = Fleet(whole(tmp_path, 1), 3 * SECOND, "-O1")
    together = fleet.fly(range(8), first_seed=1)
    assert all(together[k] != fleet.fly([k], first_seed=1)[0] for k in range(8))


AIMED = """soter 1;
input topic wind: float in [-3.0, 3.0];
topic told: float;
topic tally: int in [0, 3] = 0;
type Rung = { n: int in [0, 9] };
topic rung: Rung in { n in [0, 2] };
topic u: float in [0.0, 3.0];
node Swings period 10ms {  // what a branch goes by is changed on either side of it
  subscribes wind;
  publishes told;
  var m: float;
  var same: float;
  step {
    if m < wind { m = m + 1.0; same = same + wind; } else { m = m - 1.5; }
    if m > 0.0 && wind > 0.0 { if m > 1.0 { m = -m; } else { same = 0.0; } }
    if wind > 1.0 {  // large enough to be skipped where it is 1.0 or less in all worlds
      same = (same + 1.0) / 2.0 + (same + 2.0) / 3.0 + (same + 3.0) / 4.0 + (same + 4.0) / 5.0;
      same = same - floor(same) + wind * wind * wind - wind / 2.0 - wind * wind / 8.0;
    }
    publish told = same;
  }
}
node Counts period 10ms {  // each world writes elsewhere, some nowhere
  subscribes wind;
  publishes tally;
  assumes wind < 2.5;
  guarantees tally < 3;
  var n: int in [0, 3];
  var cells: float[4];
  step {
    if wind > 0.0 { cells[n] = wind; } elseif cells[n] > 1.0 { n = (n + 1) % 4; }
    publish tally = n;
  }
}
node Keeps period 10ms {  // a list is changed where the wind is strong
  subscribes wind;
  var seen: float[<=3];
  var sum: float;
  step {
    let k = wind > 0.0 ? 1 : 0;
    if wind > 2.0 { seen = [wind, sum]; }
    for s in seen { sum = sum / 2.0 + s; }
    if seen.len > 1 { sum = sum + seen[k] / 4.0; }
  }
}
node Grows period 10ms {  // to infinity, and to what is no number
  subscribes wind;
  var huge: float = 1.0;
  var none: float;
  step { huge = huge * (wind > 0.0 ? 1e3 : 10.0); none = huge - huge; }
}
node Ends period 10ms {  // some worlds latch: an index that all of them have is outside
  subscribes wind;
  var cells: float[4];
  step { for i in 0..5 { if wind > 2.99 { cells[i] = wind; } } }
}
node Climbs period 10ms {  // and here what is published may not be
  subscribes wind;
  publishes rung;
  var n: int in [0, 9];
  step {
    if wind > 2.96 { n = n + 1; }
    publish rung = { n: n };
  }
}
node Gentle period 10ms { publishes u; guarantees u < 1.0; step { publish u = 0.5; } }
node Rough period 10ms { publishes u; step { publish u = 2.0; } }
rta Switched { ac Gentle; sc Rough; period 10ms; safe u < 3.0; ttf wind > 2.0; safer wind < 1.0; }
system Aimed default {
  module Switched;
  node Swings; node Counts; node Keeps; node Grows; node Ends; node Climbs;
  input wind every 10ms;
  until 3s;
  never told > 5.0;
}
"""


def test_each_world_takes_its_own_side(tmp_path: Path) -> None:
    file = tmp_path / "aimed.soter"
    file.write_text(AIMED, encoding="utf-8")
    system = system_of(check_file(str(file)), "Aimed")
    assert parts_with_lanes(system) == 10
    fleet = Fleet(system, 3 * SECOND, "-O1")
    together = fleet.fly(range(8), first_seed=1)
    assert together == [fleet.fly([k], first_seed=1)[0] for k in range(8)]
    for name in ("Ends", "Climbs"):
        assert 0 < sum(f"{name} latched" in f.broken for f in together) < 8
    assert all(f.disengagements[0] for f in together)


def test_on_any_vectors_flights_are_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = whole(tmp_path, 1)
    flights = [Fleet(system, 3 * SECOND, "-O1").fly(range(9), first_seed=1)]
    for flags in (*HERE, ()):
        monkeypatch.setattr(batch_flights, "vector_flags", lambda flags=flags: flags)
        flights.append(Fleet(system, 3 * SECOND, "-O1").fly(range(9), first_seed=1))
    assert all(f == flights[0] for f in flights)


def test_little_room_for_events_is_none_for_a_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = whole(tmp_path, 11)
    flights = Fleet(system, 3 * SECOND, "-O1", horizon_ns=SECOND).fly(range(9), first_seed=1)
    assert sum(sum(f.disengagements) for f in flights) > 20
    assert sum(sum(f.saves + f.precautions) for f in flights) >= 9
    monkeypatch.setattr(batch_flights, "ROOM", 16)
    again = Fleet(system, 3 * SECOND, "-O1", horizon_ns=SECOND)
    assert again.fly(range(9), first_seed=1) == flights


FAULTS = """faults {
    bias Wider.wide.cost by 1.5 at 20000 per 1h for 40ms;
    stuck Wider.wide.a[3] at 15000 per 1h for 60ms;
    silent Keeper at 20000 per 1h for 40ms;
  }"""


@pytest.mark.parametrize("faults", ["", FAULTS])
@pytest.mark.parametrize("large", [0, 64])
def test_locals_that_are_changed_in_place_end_as_copies_do(
    large: int, faults: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("soter.codegen.c.types.LARGE", large)
    file = tmp_path / "large_values.soter"
    text = LARGE_VALUES.read_text(encoding="utf-8")
    file.write_text(text.replace("always sum", f"{faults}\n  always sum"), encoding="utf-8")
    system = system_of(check_file(str(file)), "Large")
    assert "_changed = true" in generate_measured(system).source
    flights = Fleet(system, 2 * SECOND, "-O1").fly(range(6), first_seed=4)
    assert len({f.digest for f in flights}) == 6
    monkeypatch.setattr(Frame, "in_place", lambda *_: frozenset())
    assert "_changed = true" not in generate_measured(system).source
    assert Fleet(system, 2 * SECOND, "-O1").fly(range(6), first_seed=4) == flights


OPERATIONS = """
#include "soter_lanes.h"
#include <stdio.h>
#include <string.h>
static const double xs[] = {0.0, -0.0, 1.0, -1.5, 2.5, -2.5, 1e300, -1e300, 4e-320, 0.1, 1e16,
    4503599627370497.5, INFINITY, -INFINITY, NAN, -NAN};
enum { COUNT = sizeof xs / sizeof *xs };
static int wrong;
static void same(const char* what, double a, double b) {
  if (memcmp(&a, &b, sizeof a) != 0 && !(a != a && b != b)) {
    wrong += printf("%s: %.17g is not %.17g\\n", what, a, b);
  }
}
static const int64_t whole[] = {0, 1, -1, 2, -3, 7, 100, INT64_MAX, INT64_MIN, INT64_MAX - 1,
    INT64_MIN + 1, 3037000500, -3037000500, 1LL << 62, (1LL << 53) + 1};
enum { WHOLE = sizeof whole / sizeof *whole };
/* A lane gives what the number gives; it is bad where that faults and the mask is set. */
static int as_number(const char* what, soter_lane_int made, soter_lane_bool mask,
    soter_lane_bool bad, int lane, int64_t number, soter_fault fault) {
  const bool told = mask[lane] != 0 && fault != SOTER_OK;
  const bool right = made[lane] == number && bad[lane] == (told ? -1 : 0);
  return right ? 0 : printf("%s: %lld, %lld is not %lld, %d\\n", what, (long long)made[lane],
      (long long)bad[lane], (long long)number, (int)fault) > 0;
}
#define IN_EACH(what, lanes, number)                                               \
  do {                                                                             \
    soter_lane_bool found = {0, 0, 0, 0};                                          \
    soter_lane_bool* const bad = &found;                                           \
    const soter_lane_int made = lanes;                                             \
    for (int l = 0; l < SOTER_LANES; l++) {                                        \
      soter_fault status = SOTER_OK;                                               \
      soter_fault* const fault = &status;                                          \
      const int64_t one = number;                                                  \
      count += as_number(what, made, mask, found, l, one, status);                 \
      (void)fault;                                                                 \
    }                                                                              \
    (void)bad;                                                                     \
  } while (0)
static int whole_numbers(void) {
  int count = 0;
  for (int i = 0; i < WHOLE; i++) {
    for (int k = 0; k < WHOLE; k++) {
      const int64_t a = whole[i], b = whole[k];
      const soter_lane_int x = {a, 5, b, a}, y = {b, a, a, b};
      const soter_lane_bool mask = {-1, -1, -(i & 1), -(k & 1)};
      IN_EACH("add", soter_lane_add(x, y, mask, bad), soter_add(x[l], y[l], fault));
      IN_EACH("sub", soter_lane_sub(x, y, mask, bad), soter_sub(x[l], y[l], fault));
      IN_EACH("mul", soter_lane_mul(x, y, mask, bad), soter_mul(x[l], y[l], fault));
      IN_EACH("div", soter_lane_div(x, y, mask, bad), soter_div(x[l], y[l], fault));
      IN_EACH("mod", soter_lane_mod(x, y, mask, bad), soter_mod(x[l], y[l], fault));
      IN_EACH("neg", soter_lane_neg(x, mask, bad), soter_neg(x[l], fault));
      IN_EACH("abs", soter_lane_abs_int(x, mask, bad), soter_abs(x[l], fault));
      IN_EACH("narrow", soter_lane_narrow(x, -3, b, mask, bad), soter_narrow(x[l], -3, b, fault));
      IN_EACH("index", soter_lane_index(x, y, mask, bad), soter_index(x[l], y[l], fault));
      IN_EACH("min", soter_lane_min_int(x, y), soter_min_int(x[l], y[l]));
      IN_EACH("max", soter_lane_max_int(x, y), soter_max_int(x[l], y[l]));
      IN_EACH("select", soter_lane_select_int(mask, x, y), mask[l] ? x[l] : y[l]);
      const soter_lane_bool outside = soter_lane_outside_int(x, b, a);
      for (int l = 0; l < SOTER_LANES; l++) {
        soter_fault fault = SOTER_OK;
        soter_check_int(x[l], b, a, &fault);
        count += (outside[l] != 0) != (fault != SOTER_OK);
        same("to_float", soter_lane_to_float(x)[l], (double)x[l]);
        same("seconds", soter_lane_seconds(x)[l], soter_seconds(x[l]));
      }
    }
  }
  for (int i = 0; i + 3 < COUNT; i++) {
    const soter_lane_float x = {xs[i], xs[i + 1], xs[i + 2], 9223372036854774784.0};
    const soter_lane_bool mask = {-1, 0, -1, -1};
    IN_EACH("to_int", soter_lane_to_int(x, mask, bad), soter_to_int(x[l], fault));
  }
  return count;
}
int main(void) {
  for (int i = 0; i < COUNT; i++) {
    for (int k = 0; k < COUNT; k++) {
      const double a = xs[i], b = xs[k];
      const soter_lane_float x = {1.0, a, 2.0, b}, y = {b, b, a, a};
      for (int l = 0; l < SOTER_LANES; l++) {
        same("min", soter_lane_min(x, y)[l], soter_min(x[l], y[l]));
        same("max", soter_lane_max(x, y)[l], soter_max(x[l], y[l]));
        same("sqrt", soter_lane_sqrt(x)[l], sqrt(x[l]));
        same("floor", soter_lane_floor(x)[l], floor(x[l]));
        same("abs", soter_lane_abs(x)[l], fabs(x[l]));
        same("negative", (-x)[l], -x[l]);
        same("select", soter_lane_select((soter_lane_bool)(x < y), x, y)[l],
            x[l] < y[l] ? x[l] : y[l]);
        soter_fault fault = SOTER_OK;
        soter_check_finite(x[l], &fault);
        wrong += (soter_lane_not_finite(x)[l] != 0) != (fault != SOTER_OK);
        fault = SOTER_OK;
        soter_check_float(x[l], a, b, &fault);
        const soter_lane_bool bad = soter_lane_not_finite(x) | soter_lane_outside(x, a, b);
        wrong += (bad[l] != 0) != (fault != SOTER_OK);
        const double once = soter_lane_canonical(x)[l], twice = soter_canonical(x[l]);
        wrong += memcmp(&once, &twice, sizeof once) != 0;
      }
    }
  }
  for (uint64_t n = 0; n < 100000; n++) {
    soter_lane_bits keys;
    soter_header h[SOTER_LANES];
    for (int l = 0; l < SOTER_LANES; l++) {
      keys[l] = h[l].seed_key = soter_mix(n * SOTER_LANES + (uint64_t)l);
    }
    const uint64_t stream = soter_mix(~n);
    const int64_t index = (int64_t)(n * n) - 7;
    const soter_lane_float drawn = soter_lane_draw(keys, stream, index, -0.3, 0.7);
    for (int l = 0; l < SOTER_LANES; l++) {
      same("draw", drawn[l], soter_draw(&h[l], stream, index, -0.3, 0.7));
    }
  }
  wrong += whole_numbers();
  return wrong != 0;
}
"""


@pytest.mark.parametrize("vectors", [*HERE, ()])
@pytest.mark.parametrize("optimise", ["-O0", "-O3"])
def test_an_operation_on_a_lane_is_that_on_a_number(
    optimise: str, vectors: tuple[str, ...], tmp_path: Path
) -> None:
    source, built = tmp_path / "operations.c", tmp_path / "operations"
    source.write_text(OPERATIONS, encoding="utf-8")
    folders = (f"-I{RUNTIME}", f"-I{ENGINE[0].parent}")
    flags = (*STRICT, "-fno-trapping-math", optimise, *vectors, *folders)
    processes.run([*find().command, *flags, "-o", built, source, "-lm"], check=True)
    done = processes.run([built], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")
