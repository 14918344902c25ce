"""Two modules of which one looks at the mode of the other, in one dimension each.

Purpose: texts of which some are proved and some must not be: on a grid, and by induction.
Non-goals: proving them.
"""

from __future__ import annotations

KEEP_Y = """topic y: float in [-4.0, 4.0] max_age 20ms;
topic w: float in [-1.0, 1.0];
plant Y period 10ms { reads w; drives y = p; state p: float; der p = w; }
node FastY period 20ms { publishes w; step { publish w = 1.0; } }
node SlowY period 20ms {
  subscribes y; publishes w; step { publish w = clamp(-2.0 * y, -1.0, 1.0); }
}
rta KeepY {
  ac FastY; sc SlowY; period 20ms;
  safe abs(y) < 2.0; ttf abs(y) > 1.6; safer abs(y) < 1.3;
  verify { grid y in [-2.0, 2.0] / 100; }
}
"""
"""Whose mode is looked at."""

TTF = "ttf abs(x) > 1.6;"
SAFER = "safer abs(x) < 1.3;"
LAW = "clamp(-2.0 * x, -1.0, 1.0)"
GRID = f"""soter 1;
topic x: float in [-4.0, 4.0] max_age 20ms;
topic u: float in [-1.0, 1.0];
{KEEP_Y}
plant X period 10ms {{ reads u; drives x = p; state p: float; der p = u; }}
node FastX period 20ms {{ publishes u; step {{ publish u = 1.0; }} }}
node SlowX period 20ms {{ subscribes x; publishes u; step {{ publish u = {LAW}; }} }}
rta KeepX {{
  ac FastX; sc SlowX; period 20ms;
  safe abs(x) < 2.0;
  {TTF}
  {SAFER}
  verify {{ grid x in [-2.0, 2.0] / 100; }}
}}
system S {{
  a: X; b: Y; module KeepX; module KeepY; until 20s; always abs(a.truth.p) < 2.0;
}}
"""
"""Nobody looks at anybody; changes make it so."""

OR = (TTF, "ttf abs(x) > 1.6 || mode(KeepY) == Mode.SC;")
AND = (SAFER, "safer abs(x) < 1.3 && mode(KeepY) == Mode.AC;")
SLOWER = (LAW, f"mode(KeepY) == Mode.SC ? clamp(-1.0 * x, -0.5, 0.5) : {LAW}")
BACK_OF_Y = ("safer abs(y) < 1.3;", "safer abs(y) < 1.3 && mode(KeepX) == Mode.AC;")
TAKEN_OF_Y = ("ttf abs(y) > 1.6;", "ttf abs(y) > 1.6 || mode(KeepX) == Mode.SC;")

TURN = f"""soter 1;
type Pair = {{ p: float, q: float }};
topic z: Pair max_age 5ms;
topic u: Pair in [-2.0, 2.0];
{KEEP_Y}
plant Z period 10ms {{
  reads u; drives z = {{ p: p, q: q }};
  state p: float; state q: float; next p = u.p; next q = u.q;
}}
node FastZ period 10ms {{ publishes u; step {{ publish u = {{ p: 1.0, q: 1.0 }}; }} }}
node TurnZ period 10ms {{
  subscribes z; publishes u;
  step {{
    let long = WHICH;
    publish u = {{
      p: clamp((long ? 1.8 : 0.45) * z.q, -2.0, 2.0),
      q: clamp((long ? -0.45 : -1.8) * z.p, -2.0, 2.0)
    }};
  }}
}}
rta KeepZ {{
  ac FastZ; sc TurnZ; period 10ms;
  safe abs(z.p) < 1.95 && abs(z.q) < 1.95;
  ttf true; safer false;
  verify {{ grid z.p in [-1.95, 1.95] / 39, z.q in [-1.95, 1.95] / 39; }}
}}
system S {{ a: Z; b: Y; module KeepY; module KeepZ; until 2s; }}
"""
"""Either law keeps `safe`: two steps of one of them multiply by -0.81, one of each by -3.24."""

ALONG = """soter 1;
topic x: float in [-9.0, 9.0] max_age 5ms;
topic y: float in [-9.0, 9.0] max_age 5ms;
topic u: float in [-1.0, 1.0];
topic w: float in [0.0, 2.0];
plant X period 10ms { reads u, w; drives x = p; state p: float = 0.02; next p = p + 0.1 * (u + w); }
plant Y period 10ms { reads w; drives y = p; state p: float; next p = w; }
node FastX period 10ms { publishes u; step { publish u = 1.0; } }
node SlowX period 10ms { publishes u; step { publish u = -1.0; } }
node FastY period 10ms { publishes w; step { publish w = 2.0; } }
node SlowY period 10ms { publishes w; step { publish w = 0.0; } }
rta KeepX {
  ac FastX; sc SlowX; period 10ms;
  safe x < 2.0; ttf x > 1.65; safer x < 0.5;
  verify { grid x in [-9.0, 2.0] / 110; }
}
rta KeepY {
  ac FastY; sc SlowY; period 10ms;
  safe y < 3.0; ttf mode(KeepX) == Mode.SC || y > 2.5; safer y < 2.5 && mode(KeepX) == Mode.AC;
  verify { grid y in [-1.0, 3.0] / 40; }
}
system S { a: X; b: Y; FIRST until 10s; always a.truth.p < 2.0; }
"""
"""Y pushes X, and lets go where X is in SC: at once, or one instant too late."""

PLANS = f"""soter 1;
const SETTLED: duration = 30ms;
type Plan = enum {{ Hover, Around, ThroughBuilding }};
topic candidate: Plan;
topic inForce: Plan;
{KEEP_Y}
fun PhiPlan(p: Plan): bool {{ return p != Plan.ThroughBuilding; }}
node RRTStar period 10ms {{
  publishes candidate;
  step {{ if choose bool {{ publish candidate = choose Plan; }} }}
}}
node HoverPlan period 10ms {{ publishes candidate; step {{ publish candidate = Plan.Hover; }} }}
node Follower period 10ms {{
  subscribes candidate; publishes inForce; var plan: Plan;
  step {{
    if age(candidate) > seconds(SETTLED) {{ plan = candidate; }}
    publish inForce = plan;
  }}
}}
rta SafePlanner {{
  ac RRTStar; sc HoverPlan; period 20ms;
  safe PhiPlan(inForce);
  ttf !PhiPlan(candidate);
  safer PhiPlan(candidate);
  verify {{ induction; }}
}}
system Planning default {{
  b: Y; module KeepY; node Follower; module SafePlanner; until 160ms;
}}
"""
"""The same for what nodes publish."""

PLAN_OR = ("ttf !PhiPlan(candidate);", "ttf !PhiPlan(candidate) || mode(KeepY) == Mode.SC;")
PLAN_AND = ("safer PhiPlan(candidate);", "safer PhiPlan(candidate) && mode(KeepY) == Mode.AC;")


def changed(text: str, *changes: tuple[str, str]) -> str:
    """A text with these changes, each of which has to be one."""
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text
