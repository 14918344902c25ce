"""A planner whose plans are lists of floats: nothing of what it computes is exact to a solver.

Purpose: the text that tests of inductions change.
Non-goals: making sense as a planner.
"""

OPAQUE = """soter 1;
type Way = { ends: float[<=4], n: int in [0, 9] };
topic candidate: Way in { ends in [0.0, 1.0], n in [0, 9] };
topic asked: int in [0, 9] = 1;
topic inForce: Way;
fun good(w: Way): bool {
  var most = 0.0;
  for i in 0..100 { most = max(most, i < w.ends.len ? w.ends[i] : 0.0); }
  return most < 0.5;
}
fun made(n: int): Way {
  var w: Way;
  for i in 0..100 { if i < n { push w.ends, 1.0 / float(n - i); } }
  return w;
}
fun fits(w: Way, n: int): bool { return good(w) && w.n == n; }
node Any period 20ms {
  publishes candidate;
  step { if choose bool { publish candidate = made(3); } }
}
node Errand period 400ms { publishes asked; step { publish asked = choose { 1, 2, 3 }; } }
node Safe period 20ms {
  subscribes asked;
  publishes candidate;
  var told: int in [-1, 9] = -1;
  var waited: int in [0, 5];
  on takeover { told = -1; }
  step {
    waited = waited < 5 ? waited + 1 : waited;
    if in_control && (told != asked || waited == 5) {
      publish candidate = made(asked);
      told = asked;
      waited = 0;
    }
  }
}
node Follower period 20ms {
  subscribes candidate;
  publishes inForce;
  var now: Way;
  step {
    if age(candidate) > seconds(50ms) && good(candidate) { now = candidate; }
    publish inForce = now;
  }
}
rta Planner {
  ac Any;
  sc Safe;
  period 20ms;
  safe inForce.n == 0 || good(inForce);
  ttf !good(candidate);
  safer fits(candidate, asked);
  verify {
    induction;
    recover within 1s;
    progress fits(made(asked), asked);
  }
}
system S default { node Errand; node Follower; module Planner; until 1s; }
"""
