"""Small programs with tests that go wrong soon, in every way there is."""

from __future__ import annotations

TESTED = """
soter 1;
type Move = int in [-1, 1];
topic cell: int in [-9, 9] max_age 25ms;
topic move: Move in [-1, 1];
input topic wish: Move in [-1, 1];
input topic alarm: bool;
topic seen: int in [0, 100];
plant Corridor period 10ms {
  reads move; drives cell = at;
  state at: int in [-9, 9] = 0;
  next at = max(-9, min(at + move, 9));
}
node Bold period 10ms {
  subscribes cell, wish; publishes move;
  step { publish move = choose { wish, 1, 1 }; }
}
node Home period 20ms {
  subscribes cell; publishes move;
  step {
    if cell > 0 { publish move = -1; }
    elseif cell < 0 { publish move = 1; }
    else { publish move = 0; }
  }
}
node Watch period 20ms {
  subscribes alarm; publishes seen;
  var count: int in [0, 100] = 0;
  step { if alarm { count = count + 1; } publish seen = count; }
}
rta Keeper {
  ac Bold; sc Home; period 30ms;
  safe abs(cell) <= 3; ttf abs(cell) > 1; safer cell == 0;
}
system S {
  robot: Corridor; module Keeper; watch: Watch;
  input wish every 20ms;
  input alarm in { false, true } every 30ms;
  until 200ms;
}
rta Keeps {
  ac Bold; sc Home; period 30ms;
  safe abs(cell) <= 9; ttf cell > 1; safer cell == 0;
}
system Wide { robot: Corridor; Keeper: Keeps; until 300ms; }
test Far { system S; horizon 120ms; always abs(robot.truth.at) <= 2; }
test Skewed { system S; skew 5ms; horizon 100ms; never robot.truth.at > 3; }
test Theorem {
  system S; skew 10ms; late Keeper.Home by 30ms; horizon 150ms; always invariant(Keeper);
}
test Skips {
  system S; skip Keeper.dm at most 2; skip watch; horizon 120ms;
  always abs(robot.truth.at) <= 3;
}
test Overruns {
  system S; overrun Keeper.Home by 25ms; overrun watch by 10ms; horizon 150ms;
  always robot.truth.at < 4;
}
test Answers { system S; skew 5ms; horizon 150ms; alarm leadsto seen > 0 within 10ms; }
test Sometime { system S; horizon 100ms; eventually seen > 2 within 80ms; }
test AtLast { system S; horizon 60ms; eventually seen > 1 within 60ms; }
test BeyondTheEnd { system S; horizon 60ms; alarm leadsto seen > 90 within 40ms; }
test Forgotten {
  system Wide; late Keeper.Home by 80ms; horizon 240ms; always invariant(Keeper);
}
"""

FAULTS = """
soter 1;
topic x: int in [0, 5];
node Counter period 10ms {
  publishes x;
  var n: int in [0, 100] = 0;
  step { n = n + choose [0, 2]; publish x = n; }
}
system S { c: Counter; until 100ms; }
test Overflows { system S; horizon 100ms; always x <= 5; }
"""

STARTS = """
soter 1;
topic pos: float;
topic u: float in [-1.0, 1.0] = 0.0;
plant Point period 10ms {
  reads u; drives pos = x;
  state x: float in [-1.0, 2.0];
  disturbance wind: float in [0.0, 3.0];
  der x = u + wind;
  measured pos within 0.5;
}
node Stay period 20ms { subscribes pos; publishes u; step { publish u = -clamp(pos, -1.0, 1.0); } }
system S { p: Point; n: Stay; until 100ms; }
test Drifts { system S; horizon 60ms; always p.truth.x < 2.01; }
"""

CONTRACTS = """
soter 1;
topic x: int in [0, 9];
topic y: int in [0, 20];
node Source period 10ms { publishes x; step { publish x = choose [0, 4]; } }
node Adder period 20ms {
  subscribes x; publishes y;
  assumes x <= 3; guarantees y <= 4;
  step { publish y = x + choose [0, 2]; }
}
system S { source: Source; adder: Adder; until 100ms; }
test Kept { system S; skew 5ms; horizon 60ms; always y <= 9; }
"""

QUEUED = """
soter 1;
topic x: int in [0, 9];
topic sum: int in [0, 99];
node Source period 10ms { publishes x; step { if choose bool { publish x = choose [1, 2]; } } }
node Slow period 20ms {
  subscribes x queue 2 fault; publishes sum;
  step { var s = 0; for v in x { s = s + v; } publish sum = s; }
}
system S { source: Source; slow: Slow; until 100ms; }
test Fits { system S; late slow by 20ms; horizon 80ms; always sum <= 3; }
test Slowly { system S; overrun slow by 15ms; horizon 80ms; always sum <= 3; }
"""
SEVERAL = """
soter 1;
topic x: int in [0, 9];
topic sum: int in [0, 99];
node Source period 10ms {
  publishes x[<=2];
  step { publish x = choose [1, 2]; if choose bool { publish x = 3; } }
}
node Slow period 30ms {
  subscribes x queue 4 drop_newest; publishes sum;
  step { var s = 0; for v in x { s = s + v; } publish sum = s; }
}
node Wild period 10ms {
  publishes x[<=2];
  step { publish x = 1; publish x = 2; if choose bool { publish x = 3; } }
}
system S { source: Source; slow: Slow; until 100ms; }
test Many { system S; horizon 80ms; always sum < 9; }
test Fewer { system S; horizon 80ms; always sum <= 11; }
test Faults { system S; replace source by Wild; horizon 20ms; always true; }
"""
