"""One question for several tools: whether a car that rolls out on a bend meets a box.

Purpose: the car of rtreach_f1tenth (kinematic bicycle, its constants), twenty boxes, an estimate
with its error, a horizon; `PROGRAM`, the same as a Soter program; `nearest`, how near the first box
may stand until a tool says no.
Non-goals: the tools (`peers.py`, `immrax_car.py`). Nothing of Soter is imported, as interpreters of
others read it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

CA, CM, CH, LENGTH = 1.9569, 0.0342, -37.1967, 0.45
"""Of the car: 1/s, m/s a unit of throttle, the throttle that is none, m between the axles."""
STEER, SPEED, HORIZON_S = 0.2, 2.4, 1.75
"""rad; m/s; what it needs until it is slower than 0.1 m/s."""
ERRORS = (0.05, 0.05, 0.1, 0.02)
"""Of x, y, speed, heading."""
HALF = (0.25, 0.15)
"""Of the car, m: half of its length and half of its width; it is not turned with the car."""
ROLLS_ON = 0.06
"""How far it gets, m, in any direction, once it is slower than 0.1 m/s: 0.1 / CA, rounded up."""
WALL = (0.0, 0.26, -9.0, 9.0)
BOXES = (WALL, *((2.0 + k, 2.26 + k, 3.0 + k % 5, 3.26 + k % 5) for k in range(19)))
"""Low and high x, low and high y; the car comes towards the first one."""

_BOXES = ", ".join(f"{{ x0: {a}, x1: {b}, y0: {c}, y1: {d} }}" for a, b, c, d in BOXES)
_ESTIMATE = ("pose.x", "pose.y", "pose.v", "pose.heading")
_MEASURED = ", ".join(f"{n} within {e}" for n, e in zip(_ESTIMATE, ERRORS, strict=True))
PROGRAM = f"""soter 1;
type Pose = {{ x: float, y: float, v: float, heading: float }};
type Box = {{ x0: float, x1: float, y0: float, y1: float }};
const BOXES: Box[{len(BOXES)}] = [{_BOXES}];
topic pose: Pose in {{ v in [-1.0, 4.0], heading in [-100.0, 100.0] }} max_age 1ms;
topic throttle: float in [{CH}, {CH}] = {CH};
fun clear(p: Pose): bool {{
  var free = true;
  for b in BOXES {{
    let along = max(b.x0 - {HALF[0]} - p.x, p.x - b.x1 - {HALF[0]});
    let across = max(b.y0 - {HALF[1]} - p.y, p.y - b.y1 - {HALF[1]});
    free = free && max(along, across) > 0.0;
  }}
  return free;
}}
node Go period 50ms {{ publishes throttle; step {{ publish throttle = {CH}; }} }}
node Roll period 50ms {{ publishes throttle; step {{ publish throttle = {CH}; }} }}
rta Clear {{
  ac Go;
  sc Roll;
  period 50ms;
  safe clear(pose);
  rest abs(pose.v) < 0.1
      moves pose.x by {ROLLS_ON}, pose.y by {ROLLS_ON}, pose.heading by 0.1 within 2s;
}}
plant Car period 10ms {{
  reads throttle;
  drives pose = {{ x: x, y: y, v: v, heading: heading }};
  state x: float = -10.0;
  state y: float = 0.0;
  state v: float = 0.0;
  state heading: float = 0.0;
  der x = v * cos(heading);
  der y = v * sin(heading);
  der v = -{CA} * v + {CA * CM} * (throttle - {CH});
  der heading = v / {LENGTH} * tan({STEER});
  measured {_MEASURED};
}}
system Alone default {{ c: Car; module Clear; until 10s; }}
"""


def grown() -> list[tuple[float, ...]]:
    """The boxes with what the car rolls on, for tools that end at the horizon."""
    return [(a - ROLLS_ON, b + ROLLS_ON, c - ROLLS_ON, d + ROLLS_ON) for a, b, c, d in BOXES]


def nearest(clear: Callable[[Sequence[float]], bool]) -> float:
    """How far the estimate stands before the first box when `clear` last says yes, in metres."""
    far, near = -10.0, 0.0
    for _ in range(40):
        x = 0.5 * (far + near)
        far, near = (x, near) if clear((x, 0.0, SPEED, 0.0)) else (far, x)
    return WALL[0] - far
