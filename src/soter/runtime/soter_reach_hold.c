/* One hold of a command: from an enclosure of the state to the next one.
 * Purpose: the law's reading (delay, jitter, errors), the step under it, tube and image.
 * Non-goals: grids; what is done with the images (soter_reach.c). */
#include "soter_reach_in.h"

#include <stddef.h>
#include <string.h>

/* Written for any number of axes and commands, and compiled for the usual ones. */
#if defined(__GNUC__)
#define ALWAYS static inline __attribute__((always_inline))
#else
#define ALWAYS static inline
#endif

/* All inputs over their whole ranges. */
void soter_reach_inputs(const soter_reach_group* g, soter_scratch* s) {
  for (int i = 0; i < SOTER_INPUTS; i++) {
    soter_set(&s->in[i], i, g->low[i], g->high[i]);
  }
}

/* The box [lo, hi] as the beginning of a chain. */
void soter_reach_start(const soter_reach_group* g, const double* lo, const double* hi,
                       soter_reach_chain* x) {
  memset(x->g, 0, sizeof x->g);
  memset(x->box, 0, sizeof x->box);
  x->holds = 0;
  for (int i = 0; i < g->axes; i++) {
    x->m[i] = lo[i] / 2 + hi[i] / 2;
    x->g[i][i] = soter_up(soter_most(hi[i] - x->m[i], x->m[i] - lo[i]));
    x->lo[i] = lo[i];
    x->hi[i] = hi[i];
  }
}

static double size_of(double lo, double hi) {
  return soter_most(fabs(lo), fabs(hi));
}

/* The interval hull of m + g eps + box, intersected with what stands in lo, hi. */
ALWAYS int hull(int n, soter_reach_chain* x) {
  for (int i = 0; i < n; i++) {
    double rad = x->box[i];
    for (int j = 0; j < n; j++) {
      rad += fabs(x->g[i][j]);
    }
    rad = rad * (1 + 8 * EPS) + EPS * fabs(x->m[i]);
    x->lo[i] = soter_most(x->lo[i], soter_down(x->m[i] - rad));
    x->hi[i] = soter_least(x->hi[i], soter_up(x->m[i] + rad));
    if (!(x->lo[i] <= x->hi[i] && size_of(x->lo[i], x->hi[i]) < 1e200)) {
      return 0;
    }
  }
  return 1;
}

/* Ranges of x' over a box of states and commands, from the linear model. */
ALWAYS void rates(int n, int commands, const soter_reach_model* m, const double* lo,
                  const double* hi, const double* ulo, const double* uhi, double* flo,
                  double* fhi) {
  for (int i = 0; i < n; i++) {
    double low = m->c[i], high = m->c[i], size = fabs(m->c[i]);
    for (int j = 0; j < n; j++) {
      const double p = m->a[i][j] * lo[j], q = m->a[i][j] * hi[j];
      low += soter_least(p, q);
      high += soter_most(p, q);
      size += soter_most(fabs(p), fabs(q));
    }
    for (int a = 0; a < commands; a++) {
      const double p = m->b[i][a] * ulo[a], q = m->b[i][a] * uhi[a];
      low += soter_least(p, q);
      high += soter_most(p, q);
      size += soter_most(fabs(p), fabs(q));
    }
    size = 16 * EPS * size + TINY;
    flo[i] = soter_down(low - m->w[i]) - size;
    fhi[i] = soter_up(high + m->w[i]) + size;
  }
}

/* Ranges of x' over [lo, hi] grown by everything that may happen where |integral e^A| <= dev. */
ALWAYS void rates_around(int n, int commands, const soter_reach_model* m, const double* dev,
                         const double* lo, const double* hi, const double* ulo, const double* uhi,
                         double* flo, double* fhi) {
  double wide_lo[AXES], wide_hi[AXES];
  rates(n, commands, m, lo, hi, ulo, uhi, flo, fhi);
  for (int i = 0; i < n; i++) {
    double d = 0;
    for (int j = 0; j < n; j++) {
      d += dev[AXES * i + j] * size_of(flo[j], fhi[j]);
    }
    d = d * (1 + 8 * EPS) + TINY;
    wide_lo[i] = soter_down(lo[i] - d);
    wide_hi[i] = soter_up(hi[i] + d);
  }
  rates(n, commands, m, wide_lo, wide_hi, ulo, uhi, flo, fhi);
}

/* Local flows: x' over an a-priori box that holds x over [from, to]; also leaves the box in `in`.
 */
static int picard(const soter_reach_group* g, soter_scratch* s, const double* lo, const double* hi,
                  const double* ulo, const double* uhi, double from, double to, double* flo,
                  double* fhi) {
  double blo[AXES], bhi[AXES];
  for (int i = 0; i < g->axes; i++) {
    blo[i] = lo[i];
    bhi[i] = hi[i];
  }
  for (int a = 0; a < g->commands; a++) {
    const int k = g->states + g->command[a];
    soter_range(&s->in[k], k, ulo[a], uhi[a]);
  }
  for (int round = 0; round < 12; round++) {
    int inside = 1;
    for (int i = 0; i < g->axes; i++) {
      if (!(blo[i] >= g->low[g->axis[i]] && bhi[i] <= g->high[g->axis[i]])) {
        return 0;
      }
      soter_range(&s->in[g->axis[i]], g->axis[i], blo[i], bhi[i]);
    }
    if (g->rate(s->in, g->param, s->out)) {
      return 0;
    }
    for (int i = 0; i < g->axes; i++) {
      const soter_form* f = &s->out[g->axis[i]];
      flo[i] = soter_down(f->lo - g->extra_w[i]);
      fhi[i] = soter_up(f->hi + g->extra_w[i]);
      if (!(size_of(flo[i], fhi[i]) < 1e200)) {
        return 0;
      }
      const double down = soter_up(soter_most(soter_most(0.0, -to * flo[i]), -from * fhi[i]));
      const double up = soter_up(soter_most(soter_most(0.0, to * fhi[i]), from * flo[i]));
      double low = soter_down(lo[i] - down), high = soter_up(hi[i] + up);
      if (from >= 0 && g->kept_low[i]) {
        low = soter_most(low, soter_least(lo[i], g->edges[i][0]));
      }
      if (from >= 0 && g->kept_high[i]) {
        high = soter_least(high, soter_most(hi[i], g->edges[i][g->cells[i]]));
      }
      if (low < blo[i] || high > bhi[i]) {
        inside = 0;
        blo[i] = soter_least(blo[i], soter_down(lo[i] - 1.25 * down));
        bhi[i] = soter_most(bhi[i], soter_up(hi[i] + 1.25 * up));
      }
    }
    if (from >= 0) {
      soter_reach_keep(g, blo, bhi);
    }
    if (inside && round > 0) {
      return 1;
    }
  }
  return 0;
}

/* Where the state may have been, relative to now, when the command about to act was read. */
static int drift(const soter_reach_group* g, soter_scratch* s, const soter_reach_chain* x,
                 double* low, double* high) {
  double ulo[COMMANDS], uhi[COMMANDS], flo[AXES], fhi[AXES];
  const double back = g->delay, ahead = x->holds == 0 ? 0.0 : 2 * g->jitter;
  for (int a = 0; a < g->commands; a++) {
    const int k = g->states + g->command[a];
    ulo[a] = g->low[k];
    uhi[a] = g->high[k];
    if (x->holds >= g->past && g->past <= SOTER_REACH_PAST) {
      ulo[a] = x->past_lo[0][a];
      uhi[a] = x->past_hi[0][a];
      for (int p = 1; p < g->past; p++) {
        ulo[a] = soter_least(ulo[a], x->past_lo[p][a]);
        uhi[a] = soter_most(uhi[a], x->past_hi[p][a]);
      }
    }
  }
  if (g->is_local) {
    if (!picard(g, s, x->lo, x->hi, ulo, uhi, -back, ahead, flo, fhi)) {
      return 0;
    }
  } else {
    double dev[AXES][AXES];
    for (int i = 0; i < g->axes; i++) {
      for (int j = 0; j < g->axes; j++) {
        dev[i][j] = soter_most(g->reach_fwd[i][j], g->reach_bwd[i][j]);
      }
    }
    rates_around(g->axes, g->commands, &g->model, &dev[0][0], x->lo, x->hi, ulo, uhi, flo, fhi);
  }
  for (int i = 0; i < g->axes; i++) {
    low[i] = soter_down(soter_least(0.0, soter_least(-back * fhi[i], ahead * flo[i])));
    high[i] = soter_up(soter_most(0.0, soter_most(-back * flo[i], ahead * fhi[i])));
  }
  return 1;
}

/* A form that depends on the own states (around the centres in s->in) as gain, centre, radius. */
typedef struct {
  double gain[AXES], c, r, lo, hi;
} line;

ALWAYS int line_of(int n, const soter_reach_group* g, const soter_scratch* s, const soter_form* f,
                   line* out) {
  double r = f->r, sum = 0, half;
  out->lo = f->lo;
  out->hi = f->hi;
  if (!(f->lo <= f->hi && size_of(f->lo, f->hi) < 1e200)) {
    return 0;
  }
  for (int k = 0; k < SOTER_INPUTS; k++) {
    r += fabs(f->g[k]);
  }
  for (int j = 0; j < n; j++) {
    const int k = g->axis[j];
    const double rad = s->in[k].g[k];
    out->gain[j] = 0;
    if (f->g[k] != 0 && rad > 0) {
      out->gain[j] = f->g[k] / rad;
      sum += fabs(f->g[k]);
    }
  }
  /* the own slopes were counted in r: take them out, less than was put in */
  out->r = soter_up((r - sum) + (SOTER_INPUTS + 8) * EPS * r);
  out->c = f->c;
  half = soter_up(soter_most(f->hi - (f->lo / 2 + f->hi / 2), (f->lo / 2 + f->hi / 2) - f->lo));
  if (!(out->r < half)) { /* the interval says more */
    memset(out->gain, 0, sizeof out->gain);
    out->c = f->lo / 2 + f->hi / 2;
    out->r = f->lo == f->hi ? 0 : half;
  }
  return 1;
}

/* The law (or the held command) over the state as it may be read. */
ALWAYS int commands(int n, int m, const soter_reach_group* g, soter_scratch* s,
                    const soter_reach_chain* x, const double* dlo, const double* dhi, line* u) {
  if (g->held_low != 0) {
    for (int a = 0; a < m; a++) {
      memset(&u[a], 0, sizeof u[a]);
      u[a].lo = g->held_low[g->command[a]];
      u[a].hi = g->held_high[g->command[a]];
      u[a].c = u[a].lo / 2 + u[a].hi / 2;
      u[a].r = u[a].lo == u[a].hi ? 0 : soter_up(soter_most(u[a].hi - u[a].c, u[a].c - u[a].lo));
    }
    return 1;
  }
  for (int i = 0; i < n; i++) {
    soter_range(&s->in[g->axis[i]], g->axis[i],
                dlo[i] == 0 ? x->lo[i] : soter_down(x->lo[i] + dlo[i]),
                dhi[i] == 0 ? x->hi[i] : soter_up(x->hi[i] + dhi[i]));
  }
  if (g->law(s->in, g->param, s->out)) {
    return 0;
  }
  for (int a = 0; a < m; a++) {
    if (!line_of(n, g, s, &s->out[g->command[a]], &u[a])) {
      return 0;
    }
  }
  return 1;
}

static int local_step(const soter_reach_group* g, soter_scratch* s, const soter_reach_chain* x,
                      const double* ulo, const double* uhi, const double* free_u, double h,
                      double early, soter_reach_model* model, soter_reach_step* step) {
  double flo[AXES], fhi[AXES];
  if (!picard(g, s, x->lo, x->hi, ulo, uhi, 0, h + 16 * EPS * g->period, flo, fhi) ||
      !soter_reach_model_of(g, s, model)) {
    return 0;
  }
  for (int i = 0; i < g->axes; i++) { /* commands that may change at any time are noise */
    for (int a = 0; a < g->commands; a++) {
      model->w[i] = soter_up(model->w[i] + soter_up(fabs(model->b[i][a]) * free_u[a]));
    }
  }
  return soter_reach_make_step(g, model, h, early, step);
}

/* Tube between two hulls, with x' in [flo, fhi] all the way. */
ALWAYS void between(int n, double h, const soter_reach_chain* x, const double* lo, const double* hi,
                    const double* flo, const double* fhi, soter_hold* out) {
  for (int i = 0; i < n; i++) {
    const double up = soter_up(h * soter_most(fhi[i], 0.0)),
                 down = soter_up(h * soter_most(-flo[i], 0.0));
    const double high = soter_least(soter_up(x->hi[i] + up), soter_up(hi[i] + down));
    const double low = soter_most(soter_down(x->lo[i] - down), soter_down(lo[i] - up));
    out->tube_hi[i] = soter_most(high, soter_most(x->hi[i], hi[i]));
    out->tube_lo[i] = soter_least(low, soter_least(x->lo[i], lo[i]));
  }
}

static void remember(const soter_reach_group* g, soter_reach_chain* x, const line* u) {
  memmove(x->past_lo[1], x->past_lo[0], sizeof x->past_lo - sizeof x->past_lo[0]);
  memmove(x->past_hi[1], x->past_hi[0], sizeof x->past_hi - sizeof x->past_hi[0]);
  for (int a = 0; a < g->commands; a++) {
    x->past_lo[0][a] = u[a].lo;
    x->past_hi[0][a] = u[a].hi;
  }
}

/* `from` without its commands. */
static void copy_state(soter_reach_chain* to, const soter_reach_chain* from) {
  memcpy(to, from, offsetof(soter_reach_chain, uc));
}

/* m, g, box of x after x -> M (x - from) + to + [-noise, noise], |entries of M| <= size. */
ALWAYS int advance(int n, soter_reach_chain* x, double M[AXES][AXES], double size[AXES][AXES],
                   const double* from, const double* to, const double* noise) {
  double m[AXES], gen[AXES][AXES], box[AXES];
  for (int i = 0; i < n; i++) {
    double s = to[i], slack = fabs(to[i]), b = 0;
    for (int j = 0; j < n; j++) {
      double row = x->box[j];
      s += M[i][j] * (x->m[j] - from[j]);
      b += fabs(M[i][j]) * x->box[j];
      for (int k = 0; k < n; k++) {
        row += fabs(x->g[j][k]);
      }
      slack += size[i][j] * (fabs(x->m[j]) + fabs(from[j]) + row);
    }
    for (int k = 0; k < n; k++) {
      double e = 0;
      for (int j = 0; j < n; j++) {
        e += M[i][j] * x->g[j][k];
      }
      gen[i][k] = e;
    }
    m[i] = s;
    box[i] = (b + noise[i]) * (1 + 16 * EPS) + 32 * EPS * slack + TINY;
  }
  for (int i = 0; i < n; i++) {
    x->m[i] = m[i];
    x->box[i] = box[i];
    for (int k = 0; k < n; k++) {
      x->g[i][k] = gen[i][k];
    }
  }
  return hull(n, x);
}

/* One step of a map from y, whose commands stand in `s`, and own states for the range of y. */
ALWAYS int map_step(int n, const soter_reach_group* g, soter_scratch* s, soter_reach_chain* y) {
  double M[AXES][AXES], size[AXES][AXES], from[AXES], to[AXES] = {0}, noise[AXES] = {0};
  line f;
  for (int i = 0; i < n; i++) {
    from[i] = s->in[g->axis[i]].c;
  }
  if (g->rate(s->in, g->param, s->out)) {
    return 0;
  }
  for (int i = 0; i < n; i++) {
    if (!line_of(n, g, s, &s->out[g->axis[i]], &f)) {
      return 0;
    }
    for (int j = 0; j < n; j++) {
      M[i][j] = f.gain[j];
      size[i][j] = fabs(f.gain[j]);
    }
    to[i] = f.c;
    noise[i] = f.r + g->extra_w[i];
    y->lo[i] = soter_down(f.lo - g->extra_w[i]);
    y->hi[i] = soter_up(f.hi + g->extra_w[i]);
  }
  return advance(n, y, M, size, from, to, noise);
}

/* The tube of a map: every state under the command but the last, which the image encloses. */
ALWAYS int hold_map(int n, int m, const soter_reach_group* g, soter_scratch* s,
                    soter_reach_chain* x, soter_hold* out) {
  static const double none[AXES] = {0, 0, 0, 0};
  line u[COMMANDS];
  soter_reach_chain y;
  copy_state(&y, x);
  for (int i = 0; i < n; i++) {
    soter_range(&s->in[g->axis[i]], g->axis[i], x->lo[i], x->hi[i]);
    out->tube_lo[i] = x->lo[i];
    out->tube_hi[i] = x->hi[i];
  }
  if (!commands(n, m, g, s, x, none, none, u)) {
    return 0;
  }
  for (int a = 0; a < m; a++) {
    const int k = g->states + g->command[a];
    if (g->held_low != 0) {
      soter_set(&s->in[k], k, u[a].lo, u[a].hi);
    } else { /* the symbols of the law's form are those of the inputs */
      s->in[k] = s->out[g->command[a]];
    }
  }
  if (!map_step(n, g, s, &y)) {
    return 0;
  }
  for (int k = 1; k < g->hold_steps; k++) { /* the law read the first state, not this one */
    for (int i = 0; i < n; i++) {
      soter_range(&s->in[g->axis[i]], g->axis[i], y.lo[i], y.hi[i]);
      out->tube_lo[i] = soter_least(out->tube_lo[i], y.lo[i]);
      out->tube_hi[i] = soter_most(out->tube_hi[i], y.hi[i]);
    }
    for (int a = 0; a < m && k == 1; a++) {
      const int c = g->states + g->command[a];
      soter_set(&s->in[c], c, u[a].lo, u[a].hi);
    }
    if (!map_step(n, g, s, &y)) {
      return 0;
    }
  }
  copy_state(x, &y);
  x->holds++;
  for (int i = 0; i < n; i++) {
    out->image_lo[i] = x->lo[i];
    out->image_hi[i] = x->hi[i];
  }
  return 1;
}

/* The command as centre, symbols of the cell and radius; what an earlier one adds to the state
 * where it may still act at the beginning. */
static void handover(const soter_reach_group* g, const soter_reach_step* step, soter_reach_chain* x,
                     const double uc[], double ug[][AXES], const double ur[], const line* u,
                     double* to, double* noise) {
  if (x->holds == 0 || g->jitter <= 0) {
    return;
  }
  for (int a = 0; a < g->commands; a++) {
    double low, high;
    double r = x->ur[a] + ur[a];
    const double c = x->uc[a] - uc[a];
    for (int j = 0; j < g->axes; j++) {
      r += fabs(x->ug[a][j] - ug[a][j]);
    }
    r = r * (1 + 16 * EPS) + 8 * EPS * (fabs(x->uc[a]) + fabs(uc[a])) + TINY;
    for (int j = 0; j < g->axes; j++) {
      r += 4 * EPS * (fabs(x->ug[a][j]) + fabs(ug[a][j]));
    }
    low = soter_most(c - r, soter_down(x->past_lo[0][a] - u[a].hi));
    high = soter_least(c + r, soter_up(x->past_hi[0][a] - u[a].lo));
    for (int i = 0; i < g->axes; i++) {
      const double p = step->move_lo[i][a] * low, q = step->move_lo[i][a] * high;
      const double v = step->move_hi[i][a] * low, w = step->move_hi[i][a] * high;
      const double lo = soter_least(soter_least(p, q), soter_least(v, w)),
                   hi = soter_most(soter_most(p, q), soter_most(v, w));
      const double mid = lo / 2 + hi / 2;
      to[i] += mid;
      noise[i] += soter_up(soter_most(hi - mid, mid - lo)) + 8 * EPS * (fabs(to[i]) + fabs(mid));
    }
  }
}

/* The next command may come any time within 2 j from y: the image grows by that much. */
ALWAYS int lingering(int n, int m, const soter_reach_group* g, soter_scratch* s,
                     const soter_reach_model* model, const line* u, const soter_reach_chain* y,
                     soter_hold* out) {
  const double late = 2 * g->jitter;
  double ulo[COMMANDS], uhi[COMMANDS], flo[AXES], fhi[AXES];
  for (int a = 0; a < m; a++) {
    ulo[a] = u[a].lo;
    uhi[a] = u[a].hi;
  }
  if (g->is_local) {
    if (!picard(g, s, y->lo, y->hi, ulo, uhi, 0, late, flo, fhi)) {
      return 0;
    }
  } else {
    rates_around(n, m, model, &g->reach_fwd[0][0], y->lo, y->hi, ulo, uhi, flo, fhi);
  }
  for (int i = 0; i < n; i++) {
    out->image_lo[i] = soter_down(y->lo[i] - soter_up(late * soter_most(0.0, -flo[i])));
    out->image_hi[i] = soter_up(y->hi[i] + soter_up(late * soter_most(0.0, fhi[i])));
  }
  soter_reach_keep(g, out->image_lo, out->image_hi);
  return 1;
}

/* Puts back the axes of x that did not move at all on the way to y. Rates that are not 0 over more
 * than rounding are not looked at again: most holds end here. */
ALWAYS void standing(int n, const soter_reach_group* g, soter_scratch* s,
                     const soter_reach_chain* x, const double* flo, const double* fhi,
                     const double* ulo, const double* uhi, soter_reach_chain* y, soter_hold* out) {
  double lo[AXES], hi[AXES], rate[AXES];
  unsigned may = 0, stands;
  for (int i = 0; i < n; i++) {
    lo[i] = soter_least(out->tube_lo[i], out->image_lo[i]);
    hi[i] = soter_most(out->tube_hi[i], out->image_hi[i]);
    rate[i] = size_of(flo[i], fhi[i]);
    may |= rate[i] <= g->dust[i] ? 1U << i : 0U;
  }
  if (may == 0 || g->is_map) {
    return;
  }
  stands = may & soter_reach_stands(g, s, lo, hi, rate, ulo, uhi);
  for (int i = 0; i < n; i++) {
    if (stands >> i & 1U) {
      y->m[i] = x->m[i];
      y->box[i] = x->box[i];
      memcpy(y->g[i], x->g[i], sizeof x->g[i]);
      y->lo[i] = out->image_lo[i] = out->tube_lo[i] = x->lo[i];
      y->hi[i] = out->image_hi[i] = out->tube_hi[i] = x->hi[i];
    }
  }
}

ALWAYS int hold_flow(int n, int m, const soter_reach_group* g, soter_scratch* s,
                     soter_reach_chain* x, soter_hold* out) {
  double dlo[AXES] = {0, 0, 0, 0}, dhi[AXES] = {0, 0, 0, 0}, ulo[COMMANDS], uhi[COMMANDS];
  double M[AXES][AXES], size[AXES][AXES], from[AXES], to[AXES] = {0}, noise[AXES] = {0}, flo[AXES],
                                                      fhi[AXES];
  double uc[COMMANDS], ug[COMMANDS][AXES], ur[COMMANDS];
  line u[COMMANDS];
  soter_reach_model local;
  soter_reach_step fresh;
  const soter_reach_model* model = &g->model;
  const soter_reach_step* step = x->holds == 0 ? &g->first : &g->later;
  soter_reach_chain y;
  if ((g->delay > 0 || g->jitter > 0) && !drift(g, s, x, dlo, dhi)) {
    return 0;
  }
  if (!commands(n, m, g, s, x, dlo, dhi, u)) {
    return 0;
  }
  for (int i = 0; i < n; i++) {
    from[i] = g->held_low != 0 ? x->m[i] : s->in[g->axis[i]].c;
  }
  for (int a = 0; a < m; a++) { /* u = c + gain (x + drift - from) */
    double r = u[a].r, size_u = fabs(u[a].c), w = 0;
    uc[a] = u[a].c;
    for (int j = 0; j < n; j++) {
      const double k = u[a].gain[j];
      const double half = dhi[j] / 2 - dlo[j] / 2, mid = dlo[j] / 2 + dhi[j] / 2;
      uc[a] += k * mid;
      r += fabs(k) * (half + 2 * EPS * (fabs(dlo[j]) + fabs(dhi[j])));
      size_u += fabs(k * mid);
    }
    r = r * (1 + 8 * EPS) + 8 * EPS * size_u;
    u[a].r = r == 0 ? 0 : r + TINY;
    u[a].c = uc[a];
    w = u[a].r;
    for (int j = 0; j < n; j++) { /* the same in the cell's symbols, for the handover */
      double slack = 0;
      uc[a] += u[a].gain[j] * (x->m[j] - from[j]);
      w += fabs(u[a].gain[j]) * x->box[j];
      slack = fabs(u[a].gain[j]) * (fabs(x->m[j]) + fabs(from[j]));
      ug[a][j] = 0;
      for (int l = 0; l < n; l++) {
        ug[a][j] += u[a].gain[l] * x->g[l][j];
        slack += fabs(u[a].gain[l] * x->g[l][j]);
      }
      w += 16 * EPS * slack;
    }
    ur[a] = w * (1 + 16 * EPS) + 16 * EPS * (size_u + fabs(uc[a])) + TINY;
    ulo[a] = u[a].lo;
    uhi[a] = u[a].hi;
    if (x->holds > 0 && g->jitter > 0) {
      ulo[a] = soter_least(ulo[a], x->past_lo[0][a]);
      uhi[a] = soter_most(uhi[a], x->past_hi[0][a]);
    }
  }
  if (g->is_local) {
    const double h = x->holds == 0 ? g->period - g->jitter : g->period;
    const double early = x->holds == 0 ? 0 : 2 * g->jitter;
    double free_u[COMMANDS] = {0};
    for (int a = 0; a < m && g->held_low != 0; a++) {
      free_u[a] = u[a].r;
      u[a].r = 0;
    }
    if (!local_step(g, s, x, ulo, uhi, free_u, h, early, &local, &fresh)) {
      return 0;
    }
    model = &local;
    step = &fresh;
  }
  for (int i = 0; i < n; i++) {
    double t = step->c[i], w = step->w[i] + step->c_r[i], slack = fabs(step->c[i]);
    for (int j = 0; j < n; j++) { /* phi (x - from) + phi from */
      M[i][j] = step->phi[i][j];
      size[i][j] = fabs(step->phi[i][j]);
      t += step->phi[i][j] * from[j];
      slack += fabs(step->phi[i][j] * from[j]);
      w += step->phi_r[i][j] * size_of(x->lo[j], x->hi[j]);
    }
    for (int a = 0; a < m; a++) {
      const double gamma = step->gamma[i][a];
      t += gamma * u[a].c;
      slack += fabs(gamma * u[a].c);
      w += fabs(gamma) * u[a].r + step->gamma_r[i][a] * size_of(u[a].lo, u[a].hi);
      for (int j = 0; j < n; j++) {
        M[i][j] += gamma * u[a].gain[j];
        size[i][j] += fabs(gamma * u[a].gain[j]);
      }
    }
    to[i] = t;
    noise[i] = w + 32 * EPS * slack;
  }
  handover(g, step, x, uc, ug, ur, u, to, noise);
  copy_state(&y, x);
  for (int i = 0; i < n; i++) {
    y.lo[i] = -HUGE_VAL;
    y.hi[i] = HUGE_VAL;
  }
  if (!advance(n, &y, M, size, from, to, noise)) {
    return 0;
  }
  soter_reach_keep(g, y.lo, y.hi);
  rates_around(n, m, model, &step->dev[0][0], x->lo, x->hi, ulo, uhi, flo, fhi);
  for (int i = 0; i < n; i++) {
    if (!(flo[i] > -1e300 && fhi[i] < 1e300)) {
      return 0;
    }
  }
  between(n, step->h, x, y.lo, y.hi, flo, fhi, out);
  memcpy(out->image_lo, y.lo, sizeof y.lo);
  memcpy(out->image_hi, y.hi, sizeof y.hi);
  if (g->jitter > 0 && !lingering(n, m, g, s, model, u, &y, out)) {
    return 0;
  }
  standing(n, g, s, x, flo, fhi, ulo, uhi, &y, out);
  copy_state(x, &y);
  x->holds++;
  if (g->delay > 0 || g->jitter > 0) {
    remember(g, x, u);
    memcpy(x->uc, uc, sizeof uc);
    memcpy(x->ug, ug, sizeof ug);
    memcpy(x->ur, ur, sizeof ur);
  }
  return 1;
}

/* Runs one more hold; 0 where nothing can be bounded. */
int soter_reach_hold(const soter_reach_group* g, soter_scratch* s, soter_reach_chain* x,
                     soter_hold* out) {
  const int n = g->axes, m = g->commands;
  if (m == 1 && n == 2) {
    return g->is_map ? hold_map(2, 1, g, s, x, out) : hold_flow(2, 1, g, s, x, out);
  }
  return g->is_map ? hold_map(n, m, g, s, x, out) : hold_flow(n, m, g, s, x, out);
}

/* Images and tubes of `holds` holds from a box, for tests and refutation: [hold][axis][lo, hi].
 * Returns how many could be bounded. */
int soter_reach_run(const soter_reach_group* g, const double* low, const double* high,
                    int32_t holds, double* images, double* tubes) {
  soter_scratch s;
  soter_reach_chain x;
  soter_hold h;
  soter_reach_inputs(g, &s);
  soter_reach_start(g, low, high, &x);
  for (int k = 0; k < holds; k++) {
    if (!soter_reach_hold(g, &s, &x, &h)) {
      return k;
    }
    for (int i = 0; i < g->axes; i++) {
      images[2 * (k * g->axes + i)] = h.image_lo[i];
      images[2 * (k * g->axes + i) + 1] = h.image_hi[i];
      tubes[2 * (k * g->axes + i)] = h.tube_lo[i];
      tubes[2 * (k * g->axes + i) + 1] = h.tube_hi[i];
    }
  }
  return holds;
}
