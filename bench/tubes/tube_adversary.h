/* Everything that the definitions leave open, against the module.
 *
 * Purpose: the policy of a run (commands of AC, disturbances, errors, ages, times), starts, the
 * point simulation, and fall-back runs.
 * Non-goals: closed loops and what is counted (tube_loop.c).
 */

#ifndef TUBE_ADVERSARY_H
#define TUBE_ADVERSARY_H

#define FLIGHT INT64_C(6000000000)
#define LOOK_AHEAD 2.0 /* s */
enum { UNIFORM, ENDS, CONSTANT, AIMED, HONEST, GREEDY = AIMED };
enum { NONE, MOST, ANY_TIME, EITHER };
enum { PAST = 8192 };

typedef struct {
  uint64_t state, shown;
  int ac, wind, error, age, late, aim;
  int64_t u_every, w_every, honest_until;
  double u[M], w[W + 1], e[N];
  const double *judged; /* the command that acts until any of U may; NULL: any does */
} policy;

static double past[PAST][N];
static void keep_past(int64_t tick, const double *x) { memcpy(past[tick % PAST], x, sizeof past[0]); }
static const double *at_past(int64_t tick) { return past[tick % PAST]; }

static uint64_t draw(policy *p) {
  uint64_t z = (p->state += UINT64_C(0x9e3779b97f4a7c15));
  z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
  z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
  return z ^ (z >> 31);
}
static double share(policy *p) { return (double)(draw(p) >> 11) * 0x1p-53; }
static double between(policy *p, double low, double high, int kind) {
  return kind == UNIFORM ? low + share(p) * (high - low) : draw(p) % 2 ? high : low;
}
/* A time of [0, most]. */
static int64_t pick(policy *p, int kind, int64_t most, int64_t tick) {
  if (most <= 0 || kind == NONE) {
    return 0;
  }
  if (kind == MOST || (kind == EITHER && draw(p) % 2)) {
    return most;
  }
  return kind == EITHER ? 0 : (int64_t)(draw(p) % (uint64_t)(most / tick + 1)) * tick;
}

static policy policy_of(const config *c, uint64_t seed, bool honest) {
  policy p = {.state = seed, .shown = seed};
  p.ac = (int)(draw(&p) % (honest ? 5 : 4));
  p.wind = (int)(draw(&p) % 4);
  p.error = (int)(draw(&p) % 4);
  p.age = (int)(draw(&p) % 4);
  p.late = (int)(draw(&p) % 4);
  p.aim = (int)(draw(&p) % (AIMS + 1)) - 1;
  const int64_t every[] = {c->tick, c->delta_dm / 2, c->delta_dm, 4 * c->delta_dm, 10 * c->delta_dm};
  p.u_every = every[draw(&p) % 5] / c->tick * c->tick;
  p.w_every = every[draw(&p) % 5] / c->tick * c->tick;
  if (p.ac == AIMED || p.wind == AIMED) { /* each looks ahead */
    p.u_every = p.u_every < c->delta_dm / 2 ? c->delta_dm / 2 / c->tick * c->tick : p.u_every;
    p.w_every = p.w_every < c->delta_dm / 2 ? c->delta_dm / 2 / c->tick * c->tick : p.w_every;
  }
  p.u_every = p.u_every < c->tick ? c->tick : p.u_every;
  p.w_every = p.w_every < c->tick ? c->tick : p.w_every;
  p.honest_until = p.ac == HONEST ? (int64_t)(draw(&p) % FLIGHT) : 0;
  return p;
}

/* What it never changes, drawn. */
static void constant(const config *c, policy *p) {
  for (int k = 0; k < M; k++) {
    p->u[k] = between(p, c->u_low[k], c->u_high[k], ENDS);
  }
  for (int k = 0; k < W; k++) {
    p->w[k] = between(p, c->w_low[k], c->w_high[k], ENDS);
  }
  for (int i = 0; i < N; i++) {
    p->e[i] = between(p, -c->error[i], c->error[i], ENDS);
  }
}

/* ---------------------------------------------------------------- the plant, SC, the check */

static void moved(double *x, const double *u, const double *w, double h) {
  double a[N], b[N], d[N], e[N], y[N];
  rates(x, u, w, a);
  for (int i = 0; i < N; i++) y[i] = x[i] + 0.5 * h * a[i];
  rates(y, u, w, b);
  for (int i = 0; i < N; i++) y[i] = x[i] + 0.5 * h * b[i];
  rates(y, u, w, d);
  for (int i = 0; i < N; i++) y[i] = x[i] + h * d[i];
  rates(y, u, w, e);
  for (int i = 0; i < N; i++) x[i] += h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * d[i] + e[i]);
}

/* SC has kept what it has, or anything else that it may have kept. */
static void keeps(policy *p) {
  int kind = KEPT_AT[0] == NULL ? 0 : (int)(draw(p) % 3);
  for (int k = 0; kind > 0 && KEPT_AT[k] != NULL; k++) {
    *KEPT_AT[k] = between(p, KEPT_ENDS[k][0], KEPT_ENDS[k][1], kind == 1 ? UNIFORM : ENDS);
  }
}

static void law(const double *y, double *u) {
  observe(y, 0, 0);
  if (answer(u)) {
    for (int k = 0; k < M; k++) u[k] = NAN; /* condition 3 says that it answers */
  }
}

static bool good(const config *c, const double *y, bool ac) {
  (void)c;
  observe(y, 0, 0);
  return decide(ac);
}

/* What the gate of a module with a shield knows: what is held, and until when others were. */
typedef struct {
  double held[M], until[TIMES];
} gate;

static gate closed(void) {
  gate g;
  begin();
  held(g.held);
  for (int k = 0; k < TIMES; k++) g.until[k] = -1e18;
  return g;
}
static gate after(const gate *g, const double *u, int64_t t) {
  gate next = *g;
  replaced(next.until, g->held, t);
  memcpy(next.held, u, sizeof next.held);
  return next;
}
/* Whether what may act is judged to be good, in mode AC. */
static bool commanded(const double *y, const gate *g, int64_t t) {
  observe(y, t, t);
  behind_gate(g->held, g->until);
  return decide(true);
}

/* How far what is aimed at holds. */
static double margin(const config *c, const policy *p, const double *x) {
  (void)c;
  double m[AIMS], least = INFINITY;
  margins(x, m);
  for (int i = 0; i < AIMS; i++) {
    least = p->aim < 0 || p->aim == i ? fmin(least, m[i]) : least;
  }
  return least;
}

/* The least margin with `u` for a while, then SC, under `w`: in steps that are large. */
static double ahead(const config *c, const policy *p, const double *from, const double *u, const double *w) {
  double x[N], v[M], least = INFINITY, h = 1e-9 * (double)c->delta_sc / 2.0;
  int held = (int)((c->delta_dm + c->horizon) / c->delta_sc), all = (int)(LOOK_AHEAD / h) / 2;
  memcpy(x, from, sizeof x);
  memcpy(v, u, sizeof v);
  for (int n = 0; n < all; n++) {
    if (n >= held) {
      law(x, v);
    }
    for (int k = 0; k < 2; k++) {
      double d[N];
      rates(x, v, w, d);
      for (int i = 0; i < N; i++) x[i] += h * d[i];
    }
    least = fmin(least, margin(c, p, x));
  }
  return least + 1e-3 * margin(c, p, x);
}

/* ---------------------------------------------------------------- choices */

static void wanted(const config *c, policy *p, const double *x, int64_t t, double *u) {
  int kind = p->ac == HONEST && t >= p->honest_until ? AIMED : p->ac;
  if (kind == HONEST) {
    observe(x, t, t);
    wishes(u);
    return;
  }
  if (kind == AIMED) {
    double best = INFINITY, v[M], middle[W + 1];
    for (int k = 0; k < W; k++) middle[k] = 0.5 * (c->w_low[k] + c->w_high[k]);
    for (int s = 0; s < 1 << M; s++) {
      for (int k = 0; k < M; k++) v[k] = s >> k & 1 ? c->u_high[k] : c->u_low[k];
      double m = ahead(c, p, x, v, middle);
      if (m < best) {
        best = m;
        memcpy(u, v, sizeof v);
      }
    }
    return;
  }
  for (int k = 0; k < M; k++) {
    u[k] = kind == CONSTANT ? p->u[k] : between(p, c->u_low[k], c->u_high[k], kind);
  }
}

static void winds(const config *c, policy *p, const double *x, const double *u, double *w) {
  for (int k = 0; k < W; k++) {
    w[k] = p->wind == CONSTANT ? p->w[k] : between(p, c->w_low[k], c->w_high[k], p->wind == UNIFORM ? UNIFORM : ENDS);
  }
  for (int k = 0; k < W && p->wind == AIMED; k++) {
    w[k] = c->w_low[k];
    double low = ahead(c, p, x, u, w);
    w[k] = c->w_high[k];
    w[k] = ahead(c, p, x, u, w) < low ? c->w_high[k] : c->w_low[k];
  }
}

static void vertex_errors(const config *c, policy *p, double *e) {
  for (int i = 0; i < N; i++) e[i] = between(p, -c->error[i], c->error[i], ENDS);
}

static void errors(const config *c, policy *p, double *e) {
  vertex_errors(c, p, e);
  for (int i = 0; i < N; i++) {
    e[i] = p->error == CONSTANT ? p->e[i] : p->error == UNIFORM ? between(p, -c->error[i], c->error[i], UNIFORM) : e[i];
  }
}

/* The read, at the ends of its errors, whose answer harms most. */
static void worst_read(const config *c, policy *p, const double *x, double *y) {
  double w[W + 1], best = INFINITY, found[N];
  for (int k = 0; k < W; k++) w[k] = 0.5 * (c->w_low[k] + c->w_high[k]);
  for (int n = 0; n < 4; n++) {
    double e[N], seen[N], u[M];
    vertex_errors(c, p, e);
    for (int i = 0; i < N; i++) seen[i] = x[i] + e[i];
    law(seen, u);
    double m = ahead(c, p, x, u, w);
    if (m < best) {
      best = m;
      memcpy(found, seen, sizeof found);
    }
  }
  memcpy(y, found, sizeof found);
}

/* ---------------------------------------------------------------- starts, the point simulation */

/* A state of C that is good; most often near one that is not. */
static bool a_start(const config *c, policy *p, double *x) {
  double bad[N];
  bool any = false, edge = draw(p) % 4 != 0;
  for (int n = 0; n < 40 && (any || n < 25); n++) {
    double y[N], m[AIMS], least = INFINITY;
    for (int i = 0; i < N; i++) {
      double low = c->x_low[i], high = c->x_high[i];
      y[i] = draw(p) % 4 ? between(p, low, high, UNIFORM) : c->x_first[i];
    }
    margins(y, m);
    for (int i = 0; i < AIMS; i++) least = fmin(least, m[i]);
    if (least > 0.0 && good(c, y, c->any_for < 0)) {
      memcpy(x, y, sizeof y);
      any = true;
    } else {
      memcpy(bad, y, sizeof y);
      edge = edge && n < 39;
    }
    if (any && n > 4) {
      break;
    }
  }
  for (int n = 0; any && edge && n < 12; n++) {
    double y[N];
    for (int i = 0; i < N; i++) y[i] = 0.5 * (x[i] + bad[i]);
    memcpy(good(c, y, c->any_for < 0) ? x : bad, y, sizeof y);
  }
  return any;
}

/* What most use: SC followed from the estimate, without errors, delays and disturbances. */
static bool point(const config *c, const double *y, const double *held) {
  double x[N], u[M], w[W + 1], h = 1e-9 * (double)c->delta_sc / 4.0;
  memcpy(x, y, sizeof x);
  memcpy(u, held, sizeof u);
  for (int k = 0; k < W; k++) w[k] = 0.5 * (c->w_low[k] + c->w_high[k]);
  for (int64_t n = -c->horizon / c->delta_sc; n <= c->switches; n++) {
    if (n >= 0) {
      law(x, u);
    }
    double m[AIMS];
    for (int k = 0; k < 4; k++) {
      margins(x, m);
      for (int i = 0; i < AIMS; i++) {
        if (!(m[i] >= 0.0)) return false;
      }
      moved(x, u, w, h);
    }
    if (n >= 0 && resting(x) > 0.0) {
      return true;
    }
  }
  return false;
}

#include "fall_back.h"

#endif
