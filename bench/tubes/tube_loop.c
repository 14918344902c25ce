/* A module that decides by tubes, against an adversary that knows everything.
 *
 * Purpose: `attack_fly`, closed loops of the compiled DM and SC in which every time, error and
 * disturbance is the adversary's, within the model of time (proof-flight.md); `attack_contain`,
 * fall-back runs as "Decisions by tubes" defines them, each instant compared with the tube that the
 * check computed; `attack_late`, how much earlier than needed the check says no.
 * Non-goals: which modules (tube_module.py), what is counted of them (attack.py).
 *
 * m.c is generated, shim.h is printed: states, commands and reads of a module as arrays.
 */

#include "soter.h"
#include "m.h"
#include "sizes.h"
#include "tube_trace.h"
#include "m.c"
#include "shim.h"

enum { ROOM = 16 };
enum { BY_TUBE, BY_POINT, ALWAYS_AC, BY_SAMPLES }; /* who decides */
typedef struct {
  int64_t tick, delta_dm, phase_dm, late_dm, response_dm, age_dm;
  int64_t delta_sc, phase_sc, late_sc, response_sc, age_sc, least, most;
  int64_t horizon, alpha, delay, jitter, switches, delta_ac, free, steps, any_for, within;
  double error[ROOM], u_low[ROOM], u_high[ROOM], w_low[ROOM], w_high[ROOM];
  double x_low[ROOM], x_high[ROOM], x_first[ROOM];
  double below[ROOM], above[ROOM], y_low[ROOM], y_high[ROOM];
} config;
typedef struct {
  int64_t runs, violated, holds, outside, looks, good, in_ac, in_all, early, late, dives, kinds;
  double least, off;
  uint64_t seed;
  int64_t at, where;
} told;

#include "tube_adversary.h"

/* ---------------------------------------------------------------- closed loops */

enum { FEW = 12, SAMPLED = 100 }; /* fall-back runs that are asked */

typedef struct {
  bool waits, runs;
  int64_t release, start, done;
} task;
typedef struct {
  double u[M], x[N], w[M + W + 1];
  double next[M][8];
  int64_t at[M][8];
  int count[M];
  bool of_sc[M], ac, verdict, armed, begun_in_sc;
  double command[M];
  task dm, sc;
  int64_t last_read, last_act[M];
  gate g;
  bool fault;
} loop;

/* What a reader sees: a state of [from, t], no older than what was read before, with errors. */
static void seen(const config *c, policy *p, loop *l, int64_t t, int64_t from, double *y) {
  from = from < l->last_read ? l->last_read : from;
  from = from < 0 ? 0 : from;
  int64_t s = t - pick(p, p->age, t - from, c->tick);
  l->last_read = s;
  double e[N];
  errors(c, p, e);
  const double *x = at_past(s / c->tick);
  for (int i = 0; i < N; i++) {
    y[i] = x[i] + e[i];
  }
}

/* A fault of the gate is seen, commands that are held are judged, or any are. */
static bool decided(const config *c, loop *l, const double *y, int64_t t) {
  if (l->fault || c->any_for < 0 || !l->ac) {
    return !l->fault && good(c, y, l->ac);
  }
  return commanded(y, &l->g, t);
}

/* It acts between L_min and L later, each component at its own time, in order. */
static void published(const config *c, policy *p, loop *l, int64_t t, const double *u) {
  for (int k = 0; k < M; k++) {
    int64_t acts = t + c->least + pick(p, p->late, c->most - c->least, c->tick);
    acts = acts < l->last_act[k] ? l->last_act[k] : acts;
    if (l->count[k] < 8) {
      l->next[k][l->count[k]] = u[k];
      l->at[k][l->count[k]++] = l->last_act[k] = acts;
    }
  }
}

/* AC publishes what it likes best of what the gate permits, or what it refuses. */
static void propose(const config *c, policy *p, loop *l, int64_t t) {
  double u[M], y[N];
  for (int k = 0; k < M; k++) {
    if (l->count[k] == 8) return;
  }
  wanted(c, p, l->x, t, u);
  for (int n = 0; n < 4; n++) {
    seen(c, p, l, t, t - c->age_dm, y);
    gate next = after(&l->g, u, t);
    if (commanded(y, &next, t)) {
      l->g = next;
      published(c, p, l, t, u);
      return;
    }
    for (int k = 0; k < M && p->error != GREEDY; k++) {
      u[k] = between(p, c->u_low[k], c->u_high[k], UNIFORM);
    }
  }
  l->fault = l->fault || draw(p) % 2;
}

static bool somebody(const config *c, policy *p, const double *x, const double *of_ac, int count);

static void look(const config *c, policy *p, loop *l, int64_t t, int how, told *o) {
  double y[N];
  seen(c, p, l, t, l->dm.release - c->age_dm, y);
  if (how == ALWAYS_AC) {
    l->verdict = true;
  } else if (how == BY_POINT) {
    l->verdict = point(c, y, l->u);
  } else if (how == BY_SAMPLES) { /* of the state itself: no estimate is as good */
    policy q = {.state = draw(p), .aim = p->aim};
    l->verdict = !somebody(c, &q, at_past(l->last_read / c->tick), l->u, FEW);
  } else {
    l->verdict = decided(c, l, y, t);
    for (int n = 0; n < 4 && !l->verdict && p->error == GREEDY; n++) { /* it wants AC to stay */
      double e[N];
      const double *x = at_past(l->last_read / c->tick);
      vertex_errors(c, p, e);
      for (int i = 0; i < N; i++) {
        y[i] = x[i] + e[i];
      }
      l->verdict = decided(c, l, y, t);
    }
  }
  l->fault = false;
  l->dm.runs = true;
  l->dm.waits = false;
  l->dm.done = t + pick(p, p->late, c->response_dm, c->tick);
  l->armed = l->armed || l->verdict;
  o->looks++;
  o->good += l->verdict;
}

static void trusted(const config *c, policy *p, loop *l, int64_t t, int how, told *o) {
  if (l->dm.runs && l->dm.done == t) {
    l->ac = l->verdict;
    l->dm.runs = false;
  }
  if (t >= c->phase_dm && (t - c->phase_dm) % c->delta_dm == 0) {
    l->dm = (task){.waits = true, .release = t, .start = t + pick(p, p->late, c->late_dm, c->tick)};
  }
  if (l->dm.waits && l->dm.start == t) {
    look(c, p, l, t, how, o);
    if (l->dm.done == t) {
      l->ac = l->verdict;
      l->dm.runs = false;
    }
  }
  if (t >= c->phase_sc && (t - c->phase_sc) % c->delta_sc == 0) {
    l->sc = (task){.waits = true, .release = t, .start = t + pick(p, p->late, c->late_sc, c->tick)};
  }
  bool waits = (l->dm.waits || l->dm.runs) && l->dm.release <= l->sc.release;
  if (l->sc.waits && t >= l->sc.start && !waits) {
    double y[N];
    seen(c, p, l, t, t - c->age_sc, y);
    if (p->error == GREEDY) {
      worst_read(c, p, at_past(l->last_read / c->tick), y);
    }
    law(y, l->command);
    l->begun_in_sc = !l->ac;
    l->sc.waits = false;
    l->sc.runs = true;
    l->sc.done = t + pick(p, p->late, c->response_sc, c->tick);
  }
  if (l->sc.runs && l->sc.done == t) {
    l->sc.runs = false;
    if (!l->ac && (l->begun_in_sc || draw(p) % 2)) {
      published(c, p, l, t, l->command);
      if (c->any_for >= 0) l->g = after(&l->g, l->command, l->sc.release);
    }
  }
}

static void actuate(const config *c, policy *p, loop *l, int64_t t) {
  for (int k = 0; k < M; k++) {
    if (l->ac && c->any_for < 0) {
      l->of_sc[k] = false;
      l->count[k] = 0;
    }
    while (l->count[k] > 0 && l->at[k][0] <= t) {
      l->u[k] = l->next[k][0];
      l->of_sc[k] = true;
      l->count[k]--;
      memmove(l->next[k], l->next[k] + 1, sizeof l->next[k] - sizeof l->next[k][0]);
      memmove(l->at[k], l->at[k] + 1, sizeof l->at[k] - sizeof l->at[k][0]);
    }
  }
  if (t % p->u_every == 0 && c->any_for >= 0) {
    if (l->ac) propose(c, p, l, t);
  } else if (t % p->u_every == 0) {
    double u[M];
    wanted(c, p, l->x, t, u);
    for (int k = 0; k < M; k++) {
      l->u[k] = l->of_sc[k] ? l->u[k] : u[k];
    }
  }
  if (t % p->w_every == 0) {
    winds(c, p, l->x, l->u, l->w);
  }
}

static void fly(const config *c, uint64_t seed, int64_t time, int how, told *o) {
  policy p = policy_of(c, seed, how != ALWAYS_AC);
  loop l = {.last_read = 0, .g = closed()};
  memcpy(l.u, l.g.held, sizeof l.u);
  if (!a_start(c, &p, l.x)) {
    return;
  }
  constant(c, &p);
  o->runs++;
  double least = INFINITY;
  int64_t at = 0, where = 0;
  for (int64_t t = 0; t < time; t += c->tick) {
    keep_past(t / c->tick, l.x);
    trusted(c, &p, &l, t, how, o);
    actuate(c, &p, &l, t);
    double m[AIMS];
    margins(l.x, m);
    for (int i = 0; i < AIMS && l.armed; i++) {
      if (!(m[i] >= least)) {
        least = m[i];
        at = t;
        where = i;
      }
    }
    if (least < -1e-7) {
      break;
    }
    o->in_all += l.armed;
    o->in_ac += l.armed && l.ac;
    moved(l.x, l.u, l.w, 1e-9 * (double)c->tick);
  }
  if (least < -1e-7) {
    o->violated++;
    o->kinds |= INT64_C(1) << where;
  }
  if (least < o->least) {
    o->least = least;
    o->seed = seed;
    o->at = at;
    o->where = where;
  }
}

/* `count` runs from `seed` on, of FLIGHT, or 60 decisions if these are longer; `how`: who decides. */
void attack_fly(const config *c, uint64_t seed, int64_t count, int64_t how, told *o) {
  memset(o, 0, sizeof *o);
  o->least = INFINITY;
  trace.on = false;
  int64_t time = FLIGHT < 60 * c->delta_dm ? 60 * c->delta_dm : FLIGHT;
  for (int64_t k = 0; k < count; k++) {
    fly(c, seed + (uint64_t)k, time, (int)how, o);
  }
}

/* ---------------------------------------------------------------- containment */

enum { EACH = 20, TRIES = 20 };

/* Tubes of good estimates, each with EACH fall-back runs; until `count` holds are compared. */
void attack_contain(const config *c, uint64_t seed, int64_t count, int64_t how, told *o) {
  (void)how;
  memset(o, 0, sizeof *o);
  o->least = INFINITY;
  o->off = -INFINITY;
  for (int64_t tries = 0; o->holds < count && tries < TRIES + count / 100; tries++) {
    policy p = policy_of(c, seed + (uint64_t)tries, false);
    double x[N];
    begin();
    if (!a_start(c, &p, x)) {
      continue;
    }
    trace.on = true;
    bool is_good = good(c, x, c->any_for < 0);
    trace.on = false;
    if (!is_good || trace.laws >= HOLDS_MAX) {
      continue;
    }
    o->good++;
    for (int k = 0; k < EACH; k++) {
      policy q = policy_of(c, draw(&p), false);
      q.shown = seed + (uint64_t)tries;
      constant(c, &q);
      double from[N];
      errors(c, &q, from);
      for (int i = 0; i < N; i++) {
        from[i] = x[i] - from[i];
      }
      fall_back(c, &q, from, x, true, o);
    }
  }
}

/* ---------------------------------------------------------------- too early */

enum { LOOKS = 200 };

/* Looks at which AC flies towards the danger, what tube and point say there, and what it commands. */
static int64_t dive(const config *c, policy *p, double (*x)[N], double (*of_ac)[M], bool *tube, bool *spot) {
  double at[N], u[M], w[M + W + 1];
  gate g = closed();
  if (!a_start(c, p, at)) {
    return 0;
  }
  p->ac = AIMED;
  p->wind = AIMED;
  p->aim = (int)(draw(p) % SAFES);
  constant(c, p);
  int64_t looks = 0;
  for (int64_t t = 0; looks < LOOKS; t += c->tick) {
    if (t % p->u_every == 0) {
      wanted(c, p, at, t, u);
      g = after(&g, u, t);
    }
    if (t % p->w_every == 0) {
      winds(c, p, at, u, w);
    }
    if (t % c->delta_dm == 0) {
      memcpy(x[looks], at, sizeof at);
      memcpy(of_ac[looks], u, sizeof u);
      tube[looks] = c->any_for < 0 ? good(c, at, true) : commanded(at, &g, t);
      spot[looks] = point(c, at, u);
      looks++;
    }
    if (margin(c, p, at) < 0.0) {
      return looks;
    }
    moved(at, u, w, 1e-9 * (double)c->tick);
  }
  return 0;
}

static bool somebody(const config *c, policy *p, const double *x, const double *of_ac, int count) {
  for (int k = 0; k < count; k++) {
    policy q = policy_of(c, draw(p), false);
    q.aim = p->aim;
    if (k % 2) {
      q.ac = q.wind = AIMED;
    }
    constant(c, &q);
    q.judged = c->any_for < 0 ? NULL : of_ac;
    told o = {.least = INFINITY};
    double from[N];
    memcpy(from, x, sizeof from);
    fall_back(c, &q, from, x, false, &o);
    if (o.violated) {
      return true;
    }
  }
  return false;
}

/* `count` dives: DM periods between the last good look and the last that SAMPLED adversaries
 * leave, summed, of the tube in `early` and of the point simulation in `late`. */
void attack_late(const config *c, uint64_t seed, int64_t count, int64_t how, told *o) {
  static double x[LOOKS][N], of_ac[LOOKS][M];
  static bool tube[LOOKS], spot[LOOKS];
  (void)how;
  memset(o, 0, sizeof *o);
  for (uint64_t n = 0; o->dives < count && n < 10 * (uint64_t)count; n++) {
    policy p = policy_of(c, seed + n, false);
    int64_t looks = dive(c, &p, x, of_ac, tube, spot), no = 0, spots = 0, last = 0;
    while (no < looks && tube[no]) {
      no++;
    }
    while (spots < looks && spot[spots]) {
      spots++;
    }
    if (looks == 0 || no == 0 || no == looks) {
      continue;
    }
    last = no > 0 ? no - 1 : 0;
    while (last < looks && !somebody(c, &p, x[last], of_ac[last], SAMPLED)) {
      last++;
    }
    o->dives++;
    o->early += last - no;
    o->late += last - spots;
    o->violated += last < no;
  }
}
