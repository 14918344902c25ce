"""Seeded bugs in the shipped examples: which text of which program becomes what.

Purpose: `MUTANTS`, each a mistake somebody could make in a design of `examples/testing/`;
`CONTINUOUS`, the same for plants over floats; `HARMLESS`, changes that look like mistakes and
violate nothing, with the reason. `mutants.py` looks for them.
Non-goals: finding them; mutants of Soter itself (its tests).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


@dataclass(frozen=True)
class Subject:
    """A test of a shipped example. Files are below `examples/`.

    `changed`: the file that mutants change, where it is not the test's own. `strategy`, `runs`,
    `horizon`: as for `soter test`; None and 0: what the test says, what the strategy needs.
    """

    file: str
    test: str
    changed: str = ""
    strategy: str = "bfs"
    runs: int = 10_000
    horizon: str | None = None

    @property
    def where(self) -> str:
        """The file to change."""
        return self.changed or self.file


@dataclass(frozen=True)
class Mutant:
    """`old` occurs once in the file. `why` says of a harmless change why it is harmless."""

    subject: Subject
    kind: str
    old: str
    new: str
    why: str = ""


Change = tuple[str, str, str]
"""Kind, old text, new text."""


def _all(of: dict[Subject, tuple[Change, ...]]) -> Iterator[Mutant]:
    for subject, changes in of.items():
        for kind, old, new in changes:
            yield Mutant(subject, kind, old, new)


TWO = Subject("testing/two_modules.soter", "BothStayInside")
ON_TIME = Subject("testing/late_sc_on_time.soter", "OnTime", "testing/late_sc.soter")
REPAIRED = Subject("testing/late_sc_repaired.soter", "Late")
STALE = Subject("testing/stale_topic.soter", "MissedBeats")
GATE = Subject("testing/gate.soter", "Garbage")
QUEUE = Subject("testing/queue_overflow.soter", "NothingIsMissed")
PLANNER = Subject("testing/planner.soter", "AnyPlan")
BATTERY = Subject("testing/battery.soter", "AnyMission")
STAYS = Subject("testing/takeover.soter", "StaysInside")
RETURNS = Subject("testing/takeover.soter", "ComesBack")
CART = Subject("wall/cart_test.soter", "AnyCommand", "wall/cart.soter")
CART_TEST = Subject("wall/cart_test.soter", "AnyCommand")
CAR = Subject("mountain_car/cliff_test.soter", "AnyThrottleForAWhile")
CAR_HEAD = "  replace BangBang by AnyThrottle;\n  horizon 8s"
DRONE = Subject(
    "drone/motion_primitive_test.soter",
    "AnyCorner",
    "drone/motion_primitive.soter",
    strategy="random",
    runs=20,
    horizon="2s",
)

HOME = "cell > 0 ? -1 : cell < 0 ? 1 : 0"
LATE = "late Protection.Brake by 30ms"
STOPS = "motion.v >= 0 ? -1 : 0"
LOOKS = "ttf Rest(motion, LOOK) > WALL;"
BRAKING = "  for i in 0..FAST {\n    v = max(v - 1, 0);\n    x = x + v;\n  }\n"
SPEEDING = "      v = min(v + 1, FAST);\n"
TEST_HEAD = "horizon 240ms;\n  always invariant(Protection);\n}\n\ntest OnTime"
CART_TTF = "ttf Room(motion, 0.12) < 0.0 || abs(motion.v) > FAST;"

MUTANTS: tuple[Mutant, ...] = tuple(
    _all(
        {
            # look-ahead H* = A + Δ + δ = 6 ticks
            TWO: (
                ("look-ahead Δ for 2Δ", "param NEAR: int = 1", "param NEAR: int = 3"),
                ("no look-ahead", "param NEAR: int = 1", "param NEAR: int = 7"),
                ("one wall forgotten", "ttf abs(cell) > NEAR", "ttf cell > NEAR"),
                ("wrong comparison", "ttf abs(cell) > NEAR", "ttf abs(cell) < NEAR"),
                ("ttf forgotten", "ttf abs(cell) > NEAR", "ttf false"),
                ("no hysteresis", "safer cell == 0", "safer true"),
                ("SC with a wrong sign", HOME, "cell > 0 ? 1 : cell < 0 ? -1 : 0"),
                (
                    "AC's last command stays",
                    f"publish move = {HOME};",
                    "if cell == 0 { publish move = 0; }",
                ),
                ("Δ doubled, thresholds kept", "period 30ms;", "period 60ms;"),
                ("vehicle faster than the model", "min(at + move,", "min(at + 2 * move,"),
                (
                    "lost mode: AC is never left",
                    "  right: Lane;\n  until",
                    "  right: Lane;\n  force left.Keeper ac;\n  until",
                ),
            ),
            # the vehicle of the paper's crash, on time: LOOK = H* = 6 ticks
            ON_TIME: (
                ("age A forgotten", "const LOOK: int = 6", "const LOOK: int = 5"),
                ("DM after SC: δ forgotten", "const LOOK: int = 6", "const LOOK: int = 4"),
                ("look-ahead Δ for 2Δ", "const LOOK: int = 6", "const LOOK: int = 3"),
                ("no look-ahead", "const LOOK: int = 6", "const LOOK: int = 0"),
                ("SC slower than designed", "node Brake period 20ms", "node Brake period 30ms"),
                ("DM slower than designed", "period 30ms;\n  safe", "period 40ms;\n  safe"),
                ("safer bolder than ttf", "const AGAIN: int = LOOK + 3", "const AGAIN: int = 3"),
                ("off by one", LOOKS, "ttf Rest(motion, LOOK) > WALL + 1;"),
                ("braking distance forgotten", BRAKING, ""),
                ("AC taken for no worse than now", SPEEDING, ""),
                ("SC stops braking early", STOPS, "motion.v > 1 ? -1 : 0"),
                ("SC coasts", STOPS, "0"),
                ("ttf is what safe is not", LOOKS, "ttf motion.x > WALL;"),
            ),
            # SC up to 30 ms late: LOOK = H* = 8 ticks
            REPAIRED: (
                ("lateness not fully counted", "const LOOK: int = 8", "const LOOK: int = 7"),
                ("lateness J forgotten", "const LOOK: int = 8", "const LOOK: int = 5"),
                ("SC slower than Δ - J", "node Brake period 10ms", "node Brake period 20ms"),
                ("SC later than designed", LATE, "late Protection.Brake by 40ms"),
                ("SC loses releases", LATE, "skip Protection.Brake at most 4"),
                ("DM late instead of SC", LATE, "late Protection.dm by 30ms"),
                ("SC overruns", LATE, "overrun Protection.Brake by 40ms"),
                ("skew beyond the design", TEST_HEAD, f"skew 20ms;\n  {TEST_HEAD}"),
            ),
            STALE: (
                ("stale topic believed", "max_age 20ms", "max_age 1s"),
                ("no max_age", "estimate: Cell max_age 20ms", "estimate: Cell"),
                ("longer gaps than SC survives", "Estimator at most 2", "Estimator at most 12"),
                ("look-ahead without the age", "const NEAR: int = 2", "const NEAR: int = 4"),
                ("no hysteresis", "safer estimate == 0", "safer true"),
                (
                    "estimator off by a factor",
                    "publish estimate = seen;",
                    "publish estimate = seen / 2;",
                ),
            ),
            GATE: (
                ("gate off", "topic move: Asked in [-1, 1]", "topic move: Asked in [-3, 3]"),
                ("look-ahead too short", "const NEAR: int = 2", "const NEAR: int = 4"),
                ("SC outside its set", "cell < 0 ? 1 : 0", "cell < 0 ? 2 : 0"),
                ("SC slower than designed", "node Home period 10ms", "node Home period 30ms"),
                ("no hysteresis", "safer cell == 0", "safer true"),
            ),
            QUEUE: (
                ("queue overflow", "queue 4 drop_oldest", "queue 3 drop_oldest"),
                ("last value only", "queue 4 drop_oldest", "queue 1 drop_oldest"),
                ("queue overflow, newest lost", "queue 4 drop_oldest", "queue 3 drop_newest"),
                ("queue overflow is a fault", "queue 3 fault", "queue 2 fault"),
                ("slow reader", "node Pilot period 30ms", "node Pilot period 40ms"),
                ("slow reader, fault", "node Recorder period 20ms", "node Recorder period 30ms"),
                ("wrong comparison", "r == Report.LowBattery {", "r == Report.Gust {"),
                ("alarm taken back", "        low = true;", "        low = !low;"),
                ("guarantee broken", "lights = landing || gusts > 1", "lights = gusts > 1"),
            ),
            PLANNER: (
                ("plan adopted before DM had its say", "duration = 30ms", "duration = 20ms"),
                ("plan adopted at once", "duration = 30ms", "duration = 0ms"),
                ("SC slower than designed", "HoverPlan period 10ms", "HoverPlan period 20ms"),
                ("DM slower than designed", "period 20ms;", "period 30ms;"),
                (
                    "DM watches the plan in force",
                    "ttf !PhiPlan(candidate)",
                    "ttf !PhiPlan(inForce)",
                ),
                (
                    "lost mode: AC is never left",
                    "module SafePlanner;\n",
                    "module SafePlanner;\n  force SafePlanner ac;\n",
                ),
            ),
            BATTERY: (
                ("reserve one short", "const RESERVE: int = 12", "const RESERVE: int = 11"),
                ("time to land forgotten in part", "RESERVE: int = 12", "RESERVE: int = 8"),
                ("progress not guaranteed", "fair choose { -1, 0 }", "choose { -1, 0 }"),
                (
                    "lost command: overwritten before it is read",
                    "node MotionPrimitive period 20ms",
                    "node MotionPrimitive period 10ms",
                ),
                ("no hysteresis", "safer vehicle.charge == FULL", "safer true"),
                ("hungrier than the model", "max(charge - 1, 0)", "max(charge - 2, 0)"),
                (
                    "SC does not land",
                    "step { publish mission = Mission.Land; }",
                    "step { publish mission = Mission.Fly; }",
                ),
            ),
            STAYS: (
                ("look-ahead too short", "const NEAR: int = 2", "const NEAR: int = 4"),
                ("no hysteresis", "safer abs(cell) <= 1", "safer true"),
                ("SC with a wrong sign", "side > 0 ? -side : 0", "side > 0 ? side : 0"),
                ("DM slower than designed", "period 30ms;", "period 60ms;"),
                (
                    "lost mode: AC is never left",
                    "module Keeper;\n",
                    "module Keeper;\n  force Keeper ac;\n",
                ),
            ),
            RETURNS: (
                ("SC remembers the last time", "    known = false;\n", ""),
                ("lost mode: SC is never left", "safer abs(cell) <= 1", "safer abs(cell) < 0"),
                ("SC knows one side", "cell > 0 ? 1 : cell < 0 ? -1 : 0", "cell > 0 ? 1 : 0"),
            ),
        }
    )
)

CONTINUOUS: tuple[Mutant, ...] = tuple(
    _all(
        {
            CART: (
                ("ttf is what safe is not", CART_TTF, "ttf !Clear(motion);"),
                ("look-ahead forgotten", CART_TTF, "ttf Room(motion, 0.0) < 0.0;"),
                (
                    "SC with a wrong sign",
                    "-2.0 * motion.x - 3.0 * motion.v",
                    "2.0 * motion.x + 3.0 * motion.v",
                ),
                (
                    "one wall forgotten",
                    "return min(WALL - m.x - Need(m.v, tau), ",
                    "return max(0.0, ",
                ),
            ),
            CART_TEST: (
                (
                    "lost mode: AC is never left",
                    "c: Rushing;\n  module cart.SafeCart;\n",
                    "c: Rushing;\n  module cart.SafeCart;\n  force SafeCart ac;\n",
                ),
            ),
            CAR: (
                (
                    "lost mode: AC is never left",
                    "module cliff.SafeCar;",
                    "module cliff.SafeCar;\n  force SafeCar ac;",
                ),
                ("throttle reversed", "v + cliff.POWER", "v - cliff.POWER"),
                ("stronger than the model", "v + cliff.POWER", "v + 3.0 * cliff.POWER"),
                ("slope flatter than the model", "- cliff.SLOPE", "- 0.2 * cliff.SLOPE"),
                ("SC late", CAR_HEAD, f"  late SafeCar.SafeCarSC by 2s;\n{CAR_HEAD}"),
                (
                    "SC loses releases",
                    CAR_HEAD,
                    f"  skip SafeCar.SafeCarSC at most 4;\n{CAR_HEAD}",
                ),
                ("DM loses releases", CAR_HEAD, f"  skip SafeCar.dm at most 4;\n{CAR_HEAD}"),
                ("starts where nothing helps", "state v: float = -0.02", "state v: float = -0.05"),
            ),
            DRONE: (("ttf forgotten", "ttf TTF2D_MPr(tubeState);", "ttf false;"),),
        }
    )
)

HARMLESS = (
    Mutant(
        TWO,
        "SC knows one side",
        HOME,
        "cell > 0 ? -1 : 0",
        "on the other side SC stands still, which is safe; nobody asks here that AC comes back",
    ),
    Mutant(
        STALE,
        "longer gaps than designed",
        "Estimator at most 2",
        "Estimator at most 6",
        "DM takes over after 20 ms all the same, and going home blindly for 60 ms stays inside",
    ),
    Mutant(
        PLANNER,
        "returns while the candidate is bad",
        "safer PhiPlan(candidate)",
        "safer true",
        "SC has replaced the candidate before DM looks again",
    ),
    Mutant(
        PLANNER,
        "SC proposes a bad plan",
        "publish candidate = Plan.Hover",
        "publish candidate = Plan.ThroughBuilding",
        "SC publishes every 10 ms, so that its plan never gets old enough to be adopted",
    ),
)
