/* Linear enclosures of flows: A, B, c, W from forms, and the solution formula in intervals.
 * Purpose: soter_reach_linearize, and steps of x' in A x + B u + c + W.
 * Non-goals: sets; anything about nonlinear remainders beyond putting them into W. */
#include "soter_reach_internal.h"

#include <math.h>
#include <string.h>

typedef struct {
  double lo, hi;
} range;

typedef struct {
  range e[AXES][AXES];
} square;

static range sum(range a, range b) {
  SOTER_CHECK(!(a.lo > a.hi) && !(b.lo > b.hi));
  range r = {soter_down(a.lo + b.lo), soter_up(a.hi + b.hi)};
  return r;
}

static range product_of(range a, range b) {
  range r = {0, 0};
  SOTER_CHECK(!(a.lo > a.hi) && !(b.lo > b.hi));
  if ((a.lo != 0 || a.hi != 0) && (b.lo != 0 || b.hi != 0)) {
    const double p = a.lo * b.lo, q = a.lo * b.hi, s = a.hi * b.lo, t = a.hi * b.hi;
    r.lo = soter_down(soter_least(soter_least(p, q), soter_least(s, t)));
    r.hi = soter_up(soter_most(soter_most(p, q), soter_most(s, t)));
  }
  return r;
}

static range exactly(double x) {
  range r = {x, x};
  return r;
}

static range over(range a, double k) { /* k a positive integer */
  SOTER_CHECK(k >= 1);
  range r = {soter_down(a.lo / k), soter_up(a.hi / k)};
  if (a.lo == 0 && a.hi == 0) {
    r.lo = r.hi = 0;
  }
  return r;
}

static double greatest_size(range a) {
  return fmax(fabs(a.lo), fabs(a.hi));
}

static square product(int n, const square* a, const square* b) {
  square r;
  for (int i = 0; i < n; i++) {
    for (int j = 0; j < n; j++) {
      range s = exactly(0);
      for (int k = 0; k < n; k++) {
        const range t = product_of(a->e[i][k], b->e[k][j]);
        if (t.lo != 0 || t.hi != 0) {
          s = s.lo == 0 && s.hi == 0 ? t : sum(s, t);
        }
      }
      r.e[i][j] = s;
    }
  }
  return r;
}

static void add_to(int n, square* a, const square* b) {
  for (int i = 0; i < n; i++) {
    for (int j = 0; j < n; j++) {
      const range t = b->e[i][j];
      if (t.lo != 0 || t.hi != 0) {
        a->e[i][j] = a->e[i][j].lo == 0 && a->e[i][j].hi == 0 ? t : sum(a->e[i][j], t);
      }
    }
  }
}

static void widen(int n, square* a, double by) {
  SOTER_CHECK(by >= 0);
  for (int i = 0; i < n; i++) {
    for (int j = 0; j < n; j++) {
      a->e[i][j].lo = soter_down(a->e[i][j].lo - by);
      a->e[i][j].hi = soter_up(a->e[i][j].hi + by);
    }
  }
}

static square unit(int n) {
  square r;
  memset(&r, 0, sizeof r);
  for (int i = 0; i < n; i++) {
    r.e[i][i] = exactly(1);
  }
  return r;
}

enum { TERMS = 16 };

/* So many terms that the rest is below 2^-64. It is below theta^(k+1) / (k+1)! / (1 - theta), at
 * most 2 theta^(k+1) / (k+1)! for theta <= 1/2; with 16 terms that is 2^-64 at theta = 1/2. (Below
 * 1.2 of it, rather: that is far more than the two roundings a term of which soter_up makes good
 * one and a half.) */
static int terms_for(double theta, double* rest) {
  int k = 0;
  SOTER_CHECK(theta >= 0 && theta <= 0.5);
  *rest = 2;
  while (k < 2 || (k <= TERMS && *rest > 0x1p-64)) {
    k++;
    *rest = soter_up(*rest * theta / k);
  }
  return k - 1;
}

/* A as a square; the largest sum of a row of |A|. */
static double norm_of(int n, const double* a, square* am) {
  double norm = 0;
  memset(am, 0, sizeof *am);
  for (int i = 0; i < n; i++) {
    double row = 0;
    for (int j = 0; j < n; j++) {
      am->e[i][j] = exactly(a[AXES * i + j]);
      row = soter_up(row + fabs(a[AXES * i + j]));
    }
    norm = fmax(norm, row);
  }
  return norm;
}

/* power = power A f, part = power g; whether that is 0. */
static int next_power(int n, const square* am, range f, range g, square* power, square* part) {
  int nothing = 1;
  *power = product(n, power, am);
  for (int i = 0; i < n; i++) {
    for (int j = 0; j < n; j++) {
      power->e[i][j] = product_of(power->e[i][j], f);
      part->e[i][j] = product_of(power->e[i][j], g);
      nothing = nothing && power->e[i][j].lo == 0 && power->e[i][j].hi == 0;
    }
  }
  return nothing;
}

/* The same as below by the series, where |A| s <= theta <= 1/2. */
static void sum_series(int n, const square* am, range s, double theta, square* phi,
                       square* integral) {
  double rest;
  square power = unit(n), part;
  int nilpotent = 0;
  const int terms = terms_for(theta, &rest);
  range by = s; /* s / k */
  *phi = unit(n);
  memset(integral, 0, sizeof *integral);
  for (int i = 0; i < n; i++) {
    integral->e[i][i] = s;
  }
  for (int k = 1; k <= terms && !nilpotent; k++) { /* power = (A s)^k / k! */
    const range then = over(s, k + 1);
    nilpotent = next_power(n, am, by, then, &power, &part);
    by = then;
    add_to(n, phi, &power);
    add_to(n, integral, &part);
  }
  if (!nilpotent) {
    widen(n, phi, rest);
    widen(n, integral, soter_up(rest * s.hi));
  }
}

/* e^(A s) and its integral over [0, s], for s in `h` (h >= 0); false: too large to bound. */
static int exponential(int n, const double* a, range h, square* phi, square* integral) {
  square am;
  int doublings = 0;
  range s = h;
  double theta = soter_up(norm_of(n, a, &am) * h.hi);
  SOTER_CHECK(h.lo <= h.hi && h.hi >= 0);
  if (!(theta < 64)) {
    return 0;
  }
  while (theta > 0.5) { /* halving is exact */
    theta /= 2;
    s.lo /= 2;
    s.hi /= 2;
    doublings++;
  }
  sum_series(n, &am, s, theta, phi, integral);
  for (; doublings > 0; doublings--) {
    square more = product(n, phi, integral);
    add_to(n, integral, &more);
    *phi = product(n, phi, phi);
  }
  return 1;
}

/* Row i of m times column c of v. */
static range row_times(int n, const square* m, int i, const double* v, int c) {
  range r = exactly(0);
  for (int k = 0; k < n; k++) {
    if (v[COMMANDS * k + c] != 0) {
      r = sum(r, product_of(m->e[i][k], exactly(v[COMMANDS * k + c])));
    }
  }
  return r;
}

/* Whether what has this hull keeps its sign (but for 1e-290): then the integral of its size is the
 * size of its integral. */
static int one_sign(range hull) {
  return hull.lo >= -1e-290 || hull.hi <= 1e-290;
}

enum { PIECES = 16 };

/* e^(As) v for s in a piece of length d, whose e^(As) is `at`: adds to the bounds and to the hull,
 * which begins with the first piece. */
static void add_piece(int n, const square* at, double d, int is_first, int columns, const double* v,
                      double total[AXES][COMMANDS], range hull[AXES][COMMANDS]) {
  for (int i = 0; i < n; i++) {
    for (int c = 0; c < columns; c++) {
      const range r = row_times(n, at, i, v, c);
      total[i][c] = soter_up(total[i][c] + soter_up(d * greatest_size(r)));
      if (is_first) {
        hull[i][c] = r;
      } else {
        hull[i][c].lo = fmin(hull[i][c].lo, r.lo);
        hull[i][c].hi = fmax(hull[i][c].hi, r.hi);
      }
    }
  }
}

/* The bounds where nothing changes its sign; `whole` is the integral of e^(As), over h. */
static void cut_totals(int n, const square* whole, double h, int columns, const double* v,
                       double total[AXES][COMMANDS], range hull[AXES][COMMANDS]) {
  for (int i = 0; i < n; i++) {
    for (int c = 0; c < columns; c++) {
      if (one_sign(hull[i][c])) {
        const double value = greatest_size(row_times(n, whole, i, v, c));
        total[i][c] = fmin(total[i][c], soter_up(value + 2e-290 * h));
      }
    }
  }
}

/* Upper bounds of the integral over [from, from + h] of |e^(As) v|, column by column, and the hull
 * of e^(As) v there. */
static int absolute(int n, const double* a, double from, range span_of, int columns,
                    const double* v, int pieces, double total[AXES][COMMANDS],
                    range hull[AXES][COMMANDS]) {
  const double h = span_of.hi;
  square whole, all, start, begin, part, rest, at;
  const double d = soter_up(h / pieces);
  const range span = {0, d};
  SOTER_CHECK(pieces >= 1 && columns <= COMMANDS && h >= 0);
  memset(hull, 0, sizeof(range) * AXES * COMMANDS);
  if (!exponential(n, a, span, &part, &rest) || !exponential(n, a, span_of, &whole, &all) ||
      !exponential(n, a, exactly(from), &start, &rest)) {
    return 0;
  }
  memset(total, 0, sizeof(double) * AXES * COMMANDS);
  for (int q = 0; q < pieces; q++) {
    range s = {soter_down(d * q * (1 - 8 * EPS)), soter_up(d * q)};
    if (q == 0) {
      s = exactly(0);
    }
    if (!exponential(n, a, s, &begin, &rest)) {
      return 0;
    }
    at = product(n, &start, &begin);
    at = product(n, &at, &part);
    add_piece(n, &at, d, q == 0, columns, v, total, hull);
  }
  whole = product(n, &start, &all);
  cut_totals(n, &whole, h, columns, v, total, hull);
  return 1;
}

int soter_reach_dev(const soter_reach_group* g, const soter_reach_model* m, double h, int backwards,
                    double dev[AXES][AXES]) {
  double a[AXES][AXES], one[AXES][COMMANDS], total[AXES][COMMANDS];
  range hull[AXES][COMMANDS];
  memset(one, 0, sizeof one);
  for (int i = 0; i < g->axes; i++) {
    one[i][i] = 1;
    for (int j = 0; j < g->axes; j++) {
      a[i][j] = backwards ? -m->a[i][j] : m->a[i][j];
    }
  }
  if (!absolute(g->axes, &a[0][0], 0, exactly(h), g->axes, &one[0][0], g->is_local ? 1 : PIECES,
                total, hull)) {
    return 0;
  }
  for (int i = 0; i < g->axes; i++) {
    for (int j = 0; j < g->axes; j++) {
      dev[i][j] = total[i][j];
    }
  }
  return 1;
}

/* A time that is h but for the rounding of numbers as large as `period`. */
static range moment(double h, double period) {
  range r = {fmax(0.0, h - 8 * EPS * period), h + 8 * EPS * period};
  return r;
}

/* The same over [0, h] in one piece, where e^(As) over all of it and its integral are at hand. */
static void dev_in_one(int n, double h, const square* over_all, const square* integral,
                       double dev[AXES][AXES]) {
  for (int i = 0; i < n; i++) {
    for (int j = 0; j < n; j++) {
      const range r = over_all->e[i][j];
      dev[i][j] = soter_up(h * greatest_size(r));
      if (one_sign(r)) {
        dev[i][j] = fmin(dev[i][j], soter_up(greatest_size(integral->e[i][j]) + 2e-290 * h));
      }
    }
  }
}

/* The hull of e^(As) b over [from, to], for every command's column b, in one piece. */
static int hull_in_one(int n, int commands, const soter_reach_model* m, double from, double to,
                       range hull[AXES][COMMANDS]) {
  square start, part, ignored;
  const range span = {0, soter_up(to - from)};
  if (!exponential(n, &m->a[0][0], exactly(from), &start, &ignored) ||
      !exponential(n, &m->a[0][0], span, &part, &ignored)) {
    return 0;
  }
  part = product(n, &start, &part);
  for (int i = 0; i < n; i++) {
    for (int c = 0; c < commands; c++) {
      hull[i][c] = row_times(n, &part, i, &m->b[0][0], c);
    }
  }
  return 1;
}

/* What the early part of the step, over which the previous command may act, does with a command. */
static int add_early(const soter_reach_group* g, const soter_reach_model* m, range time,
                     double early, soter_reach_step* out) {
  const int n = g->axes;
  double total[AXES][COMMANDS];
  range hull[AXES][COMMANDS];
  const double from = fmax(0.0, soter_down(time.lo - early));
  const range length = exactly(soter_up(time.hi - from));
  if (g->is_local ? !hull_in_one(n, g->commands, m, from, time.hi, hull)
                  : !absolute(n, &m->a[0][0], from, length, g->commands, &m->b[0][0], PIECES, total,
                              hull)) {
    return 0;
  }
  for (int i = 0; i < n; i++) {
    for (int a = 0; a < g->commands; a++) {
      out->move_lo[i][a] = fmin(0.0, soter_down(early * hull[i][a].lo));
      out->move_hi[i][a] = fmax(0.0, soter_up(early * hull[i][a].hi));
    }
  }
  return 1;
}

/* The integral of |e^(As)| over the step, in one piece or in several. */
static int step_dev(const soter_reach_group* g, const soter_reach_model* m, double h,
                    const square* integral, soter_reach_step* out) {
  square all, ignored;
  const range span = {0, h};
  if (!g->is_local) {
    return soter_reach_dev(g, m, h, 0, out->dev);
  }
  if (!exponential(g->axes, &m->a[0][0], span, &all, &ignored)) {
    return 0;
  }
  dev_in_one(g->axes, h, &all, integral, out->dev);
  return 1;
}

/* One step of length h; `early`: the previous command may act over that long at its beginning. */
int soter_reach_make_step(const soter_reach_group* g, const soter_reach_model* m, double h,
                          double early, soter_reach_step* out) {
  square phi, integral;
  const int n = g->axes;
  const range time = moment(h, fmax(h, g->period));
  memset(out, 0, sizeof *out);
  out->h = time.hi;
  if (!exponential(n, &m->a[0][0], time, &phi, &integral) ||
      !step_dev(g, m, time.hi, &integral, out)) {
    return 0;
  }
  for (int i = 0; i < n; i++) {
    range c = exactly(0);
    double w = 0;
    for (int j = 0; j < n; j++) {
      soter_centre(phi.e[i][j].lo, phi.e[i][j].hi, &out->phi[i][j], &out->phi_r[i][j]);
      c = sum(c, product_of(integral.e[i][j], exactly(m->c[j])));
      w = soter_up(w + soter_up(out->dev[i][j] * m->w[j]));
    }
    for (int a = 0; a < g->commands; a++) {
      const range b = row_times(n, &integral, i, &m->b[0][0], a);
      soter_centre(b.lo, b.hi, &out->gamma[i][a], &out->gamma_r[i][a]);
    }
    soter_centre(c.lo, c.hi, &out->c[i], &out->c_r[i]);
    out->w[i] = w;
  }
  return early <= 0 || add_early(g, m, time, early, out);
}

/* Where the model keeps what input k does to axis i; 0: nowhere, it is noise. */
static double* slot_of(const soter_reach_group* g, soter_reach_model* m, int i, int k) {
  for (int j = 0; j < g->axes; j++) {
    if (g->axis[j] == k) {
      return &m->a[i][j];
    }
  }
  for (int a = 0; a < g->commands; a++) {
    if (g->states + g->command[a] == k) {
      return &m->b[i][a];
    }
  }
  return 0;
}

/* Row i from the form of its rate, f = f.c + sum g eps with eps = (x - c) / rad.
 *
 * |g - coefficient rad| <= u |g|. c goes through a product and a difference for each input: each
 * product is off by u of itself, the differences by u of what they come to, at most SOTER_INPUTS u
 * size. Both are taken twice, and more. */
static void row_of_model(const soter_reach_group* g, const soter_scratch* s, int i,
                         soter_reach_model* m) {
  const soter_form* f = &s->out[g->axis[i]];
  double w = f->r, size = fabs(f->c), c = f->c;
  int moved = 0;
  for (int k = 0; k < SOTER_INPUTS; k++) {
    const soter_form* x = &s->in[k];
    double* const slot = f->g[k] != 0 ? slot_of(g, m, i, k) : 0;
    const double coefficient = slot != 0 ? soter_slope(f->g[k], x->g[k]) : 0;
    if (f->g[k] == 0) {
      continue;
    }
    if (coefficient == 0) {
      w = soter_up(w + fabs(f->g[k]));
      continue;
    }
    *slot = coefficient;
    c -= coefficient * x->c;
    moved = moved || x->c != 0;
    size += fabs(f->g[k]) + fabs(coefficient * x->c);
    if (x->r > 0) {
      w = soter_up(w + soter_up(fabs(coefficient) * x->r));
    }
    w = soter_up(w + EPS * (fabs(f->g[k]) + (SOTER_INPUTS + 2) * fabs(coefficient * x->c)));
  }
  if (moved) {
    w = soter_up(w + (SOTER_INPUTS + 2) * EPS * size);
  }
  m->c[i] = c;
  m->w[i] = soter_up(w + g->extra_w[i]);
}

/* The model of `rate` over what stands in `in`; `with` commands: the controls' ranges. */
int soter_reach_model_of(const soter_reach_group* g, soter_scratch* s, soter_reach_model* m) {
  if (g->rate(s->in, g->param, s->out)) {
    return 0;
  }
  memset(m, 0, sizeof *m);
  for (int i = 0; i < g->axes; i++) {
    row_of_model(g, s, i, m);
    SOTER_CHECK(!(m->w[i] < 0));
    if (!(m->w[i] < 1e300)) {
      return 0;
    }
  }
  return 1;
}

/* Whether control k may move the group, whose rates over everything stand in s->out. */
static int command_moves(const soter_reach_group* g, const soter_scratch* s, int k) {
  int found = g->is_local || g->is_map;
  for (int i = 0; i < g->axes; i++) {
    found = found || s->out[g->axis[i]].g[g->states + k] != 0;
  }
  return found;
}

/* Finds the commands that move the group and its model over [low, high] of all inputs. */
int soter_reach_linearize(soter_reach_group* g, const double* low, const double* high) {
  soter_scratch s;
  for (int i = 0; i < SOTER_INPUTS; i++) {
    soter_set(&s.in[i], i, low[i], high[i]);
  }
  g->commands = 0;
  if (g->rate(s.in, g->param, s.out)) {
    return 0;
  }
  for (int k = 0; k < g->controls; k++) {
    if (command_moves(g, &s, k)) {
      if (g->commands == COMMANDS) {
        return 0;
      }
      g->command[g->commands++] = k;
    }
  }
  return g->is_map || soter_reach_model_of(g, &s, &g->model);
}

/* Steps of the chain from the model. */
int soter_reach_prepare(soter_reach_group* g) {
  if (g->is_map || g->is_local) {
    return 1;
  }
  return soter_reach_make_step(g, &g->model, g->period - g->jitter, 0, &g->first) &&
         soter_reach_make_step(g, &g->model, g->period, 2 * g->jitter, &g->later) &&
         soter_reach_dev(g, &g->model, soter_up(soter_most(2 * g->jitter, g->swept)), 0,
                         g->reach_fwd) &&
         soter_reach_dev(g, &g->model, soter_up(g->delay), 1, g->reach_bwd);
}

/* The middles of all commands move the centre: their drive; their radii are noise. */
static void drive_of(const soter_reach_group* g, range drive[AXES], double rad[COMMANDS]) {
  const soter_reach_model* m = &g->model;
  double mid[COMMANDS];
  for (int a = 0; a < g->commands; a++) {
    const double lo = g->low[g->states + g->command[a]], hi = g->high[g->states + g->command[a]];
    mid[a] = lo / 2 + hi / 2;
    rad[a] = soter_up(soter_most(hi - mid[a], mid[a] - lo));
  }
  for (int i = 0; i < g->axes; i++) {
    drive[i] = exactly(m->c[i]);
    for (int a = 0; a < g->commands; a++) {
      drive[i] = sum(drive[i], product_of(exactly(m->b[i][a]), exactly(mid[a])));
    }
  }
}

/* Every instant from `begin` to `end`. */
static int segment_of(const soter_reach_group* g, range begin, range end, const range drive[AXES],
                      const double rad[COMMANDS], soter_reach_segment* s) {
  const soter_reach_model* m = &g->model;
  const int n = g->axes;
  double total[AXES][COMMANDS];
  range hull[AXES][COMMANDS];
  soter_reach_step step;
  square at, part, integral, ignored;
  const range length = {0, soter_up(end.hi - begin.lo)}, when = {begin.lo, end.hi};
  if (!exponential(n, &m->a[0][0], begin, &at, &ignored) ||
      !exponential(n, &m->a[0][0], length, &part, &ignored) ||
      !exponential(n, &m->a[0][0], when, &ignored, &integral) ||
      !soter_reach_make_step(g, m, end.hi, 0, &step) ||
      !absolute(n, &m->a[0][0], 0, exactly(end.hi), g->commands, &m->b[0][0], PIECES, total,
                hull)) {
    return 0;
  }
  at = product(n, &at, &part);
  for (int i = 0; i < n; i++) {
    range c = exactly(0);
    double w = step.w[i];
    for (int j = 0; j < n; j++) {
      s->phi_lo[i][j] = at.e[i][j].lo;
      s->phi_hi[i][j] = at.e[i][j].hi;
      c = sum(c, product_of(integral.e[i][j], drive[j]));
    }
    for (int a = 0; a < g->commands; a++) {
      w = soter_up(w + soter_up(total[i][a] * rad[a]));
    }
    s->lo[i] = soter_down(c.lo - w);
    s->hi[i] = soter_up(c.hi + w);
    SOTER_CHECK(!(s->lo[i] > s->hi[i]));
  }
  return 1;
}

/* All runs over [0, t] under U, from the model: the middle of U moves the centre, its radius is
 * noise, for u may change at any time. Noise only grows: that of the segment's end serves all. */
int soter_reach_tube_prepare(const soter_reach_group* g, double t, int32_t segments,
                             soter_reach_tube* out) {
  double rad[COMMANDS];
  range drive[AXES];
  if (segments < 1 || segments > SOTER_REACH_SEGMENTS) {
    return 0;
  }
  out->segments = segments;
  drive_of(g, drive, rad);
  for (int k = 0; k < segments; k++) {
    const range begin = moment(t * k / segments, t), end = moment(t * (k + 1) / segments, t);
    if (!segment_of(g, begin, end, drive, rad, &out->at[k])) {
      return 0;
    }
  }
  return 1;
}
