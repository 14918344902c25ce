"""A cart between two walls, wherever they are: a module that is proved one wall at a time."""

from __future__ import annotations

SAFE = "safe left.room >= 0.0 && right.room >= 0.0;"
TTF = "ttf !(Fits(left, 0.05) && Fits(right, 0.05));"
SAFER = "safer Fits(left, 0.08) && Fits(right, 0.08);"
LAW = """if along.high < MARGIN { gap = along.high - MARGIN; }
    elseif along.low < MARGIN { gap = MARGIN - along.low; }"""
SET = "grid {name}.r in [0.02, 4.02] / 100 open to 60.0, {name}.w in [-2.4, 2.4] / 96;"
VIEWS = f"""view left {{
      abstracts d by seen: Left = {{ r: d.truth.x - LOW, w: -d.truth.v }};
      {SET.format(name="seen")}
    }}
    view right {{
      abstracts d by seen: Right = {{ r: HIGH - d.truth.x, w: d.truth.v }};
      {SET.format(name="seen")}
    }}"""
TEXT = """soter 1;
const U: float = 3.0;
const MARGIN: float = 0.6;
const NEAR: float = 1.2;
const SIZE: float = 1.4;
const LOW: float = -3.0;
const HIGH: float = 5.0;

type Wall = {{ room: float, toward: float }};
type Along = {{ low: float, high: float, w: float }};
type Motion = {{ x: float, v: float }};
topic motion: Motion max_age 10ms;
topic left: Wall in {{ room in [-100.0, 100.0], toward in [-9.0, 9.0] }} max_age 11ms;
topic right: Wall in {{ room in [-100.0, 100.0], toward in [-9.0, 9.0] }} max_age 11ms;
topic along: Along in {{
  low in [-9.0, 9.0], high in [-9.0, 9.0], w in [-9.0, 9.0]
}} max_age 11ms;
topic push: float in [-U, U];

fun Fits(m: Wall, tau: float): bool {{
  let later = max(m.toward + U * tau, 0.0);
  return m.room >= max((m.toward + 0.5 * U * tau) * tau, 0.0) + later * later / 4.0 + 0.15
      && abs(m.toward) + U * tau <= 2.2;
}}

plant Cart period 10ms {{
  reads push;
  drives motion = {{ x: x, v: v }};
  state x: float;
  state v: float;
  der x = v;
  der v = push;
}}

plant Left period 10ms {{
  reads push;
  drives left = {{ room: r, toward: w }};
  drives along = {{ low: min(r, NEAR), high: max(SIZE - r, -NEAR) + NEAR, w: -w }};
  state r: float = 3.0;
  state w: float;
  der r = -w;
  der w = -push;
  measured along.high within NEAR;
}}

plant Right period 10ms {{
  reads push;
  drives right = {{ room: r, toward: w }};
  drives along = {{ low: max(SIZE - r, -NEAR) + NEAR, high: min(r, NEAR), w: w }};
  state r: float = 3.0;
  state w: float;
  der r = -w;
  der w = push;
  measured along.low within NEAR;
}}

node Estimator period 10ms {{
  subscribes motion;
  publishes left, right, along;
  step {{
    publish left = {{ room: motion.x - LOW, toward: -motion.v }};
    publish right = {{ room: HIGH - motion.x, toward: motion.v }};
    publish along = {{
      low: clamp(motion.x - LOW, -NEAR, NEAR), high: clamp(HIGH - motion.x, -NEAR, NEAR),
      w: motion.v
    }};
  }}
}}

node Fast period 10ms {{
  subscribes along;
  publishes push;
  step {{ publish push = along.w >= 0.0 ? U : -U; }}
}}

node Slow period 10ms {{
  subscribes along;
  publishes push;
  step {{
    var gap = 0.0;
    {law}
    publish push = clamp(6.0 * (clamp(2.0 * gap, -0.5, 0.5) - along.w), -U, U);
  }}
}}

rta Keep {{
  ac Fast;
  sc Slow;
  period 10ms;
  {safe}
  {ttf}
  {safer}
  verify {{
    horizon 50ms;
    late dm 500us, sc 500us, Estimator 500us;
    response dm 200us, sc 200us, Estimator 200us;
    acts within 0ms;
    {views}
  }}
}}
system S default {{
  d: Cart;
  node Estimator;
  module Keep;
  until 10s;
  always abs(d.truth.x - 1.0) <= 4.0;
}}
"""


def program(
    *, safe: str = SAFE, ttf: str = TTF, safer: str = SAFER, law: str = LAW, views: str = VIEWS
) -> str:
    """The program with other parts."""
    return TEXT.format(safe=safe, ttf=ttf, safer=safer, law=law, views=views)
