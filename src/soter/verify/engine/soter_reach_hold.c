/* One hold of a command: from an enclosure of the state to the next one.
 * Purpose: the law's reading (delay, jitter, errors), the flow under it, tube and image. Which
 * commands may act meanwhile is argued in docs/proof-sets.md, "Chains" and "Late commands".
 * Non-goals: grids; what is done with the images (soter_reach.c); maps (soter_reach_map.c); how
 * sums and products round (soter_reach_ball.h, which (1) to (4) refer to). */
#include "soter_reach_ball.h"

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
    SOTER_CHECK(lo[i] <= hi[i]);
    x->m[i] = lo[i] / 2 + hi[i] / 2;
    x->g[i][i] = soter_up(soter_most(hi[i] - x->m[i], x->m[i] - lo[i]));
    x->lo[i] = lo[i];
    x->hi[i] = hi[i];
  }
  x->from_low = soter_reach_at_low(g, lo);
  x->from_high = soter_reach_at_high(g, hi);
}

/* What stands while a command is held: how far the state may be off when it is read, the commands,
 * all that may act [lo, hi], and the commands as c + g eps + [-r, r] in the symbols of the chain.
 * Where each instant may answer another read, what is off c + gain (x - from) is in `anew`, not in
 * the r of `u`.
 */
typedef struct {
  double dlo[AXES], dhi[AXES];
  line u[COMMANDS];
  double lo[COMMANDS], hi[COMMANDS];
  double c[COMMANDS], g[COMMANDS][AXES], r[COMMANDS];
  double anew[COMMANDS];
} acting;

/* The commands that a read may lie under: those of the last holds, or any. */
static void earlier_commands(const soter_reach_group* g, const soter_reach_chain* x, double* ulo,
                             double* uhi) {
  const int known = x->holds >= g->past && g->past <= SOTER_REACH_PAST;
  SOTER_CHECK(g->past >= 1);
  for (int a = 0; a < g->commands; a++) {
    const int k = g->states + g->command[a];
    ulo[a] = known ? x->past_lo[0][a] : g->low[k];
    uhi[a] = known ? x->past_hi[0][a] : g->high[k];
    for (int p = 1; known && p < g->past; p++) {
      ulo[a] = soter_least(ulo[a], x->past_lo[p][a]);
      uhi[a] = soter_most(uhi[a], x->past_hi[p][a]);
    }
  }
}

/* Where the state may have been, relative to now, when the command about to act was read. The
 * delay and the jitter are not below the true ones, so that one product is off, (1). */
static int find_drift(const soter_reach_group* g, soter_scratch* s, const soter_reach_chain* x,
                      double* low, double* high) {
  double ulo[COMMANDS], uhi[COMMANDS], flo[AXES], fhi[AXES];
  const double later = x->holds == 0 ? 0.0 : 2 * g->jitter;
  const double back = g->delay, ahead = soter_most(later, g->swept);
  earlier_commands(g, x, ulo, uhi);
  if (g->is_local) {
    if (!soter_reach_picard(g, s, x->lo, x->hi, ulo, uhi, -back, ahead, flo, fhi)) {
      return 0;
    }
  } else {
    double dev[AXES][AXES];
    for (int i = 0; i < g->axes; i++) {
      for (int j = 0; j < g->axes; j++) {
        dev[i][j] = soter_most(g->reach_fwd[i][j], g->reach_bwd[i][j]);
      }
    }
    if (!rates_around(g->axes, g->commands, &g->model, &dev[0][0], x->lo, x->hi, ulo, uhi, flo,
                      fhi)) {
      return 0;
    }
  }
  for (int i = 0; i < g->axes; i++) {
    low[i] = soter_down(soter_least(0.0, soter_least(-back * fhi[i], ahead * flo[i])));
    high[i] = soter_up(soter_most(0.0, soter_most(-back * flo[i], ahead * fhi[i])));
    SOTER_CHECK(low[i] <= 0 && high[i] >= 0);
  }
  return 1;
}

/* u = c + gain (x + drift - from): the middle of the drift goes to c, its half to r. Returns the
 * |terms| of c. half and mid round by u (|dlo| + |dhi|) / 2 each, 4 u of which are added; c is a
 * sum of 1 + n terms, r one of 1 + n. Exact where nothing drifts: then r may stay 0. */
ENOUGH(drifted, 1 + AXES, 8);
ENOUGH(drifted_r, AXES + 3 + 2, 8);

ALWAYS double add_drift(int n, const double* dlo, const double* dhi, line* u) {
  ball b = {u->c, u->r, fabs(u->c)};
  int drifts = 0;
  for (int j = 0; j < n; j++) {
    const double k = u->gain[j];
    const double half = dhi[j] / 2 - dlo[j] / 2, mid = dlo[j] / 2 + dhi[j] / 2;
    ball_add(&b, k, mid);
    b.r += fabs(k) * (half + 2 * EPS * (fabs(dlo[j]) + fabs(dhi[j])));
    drifts = drifts || (k != 0 && half != 0);
  }
  b.r = b.r * (1 + 8 * EPS) + 8 * EPS * b.size;
  u->r = b.r == 0 && !drifts ? 0 : b.r + TINY;
  u->c = b.c;
  return b.size;
}

/* The same in the chain's symbols, where x = m + g eps + [-box, box]. c goes on as a sum: its next
 * terms round once more, for m - from, and every addition by u (size + |next terms|). An entry of g
 * is a sum of n products. Each product is counted in `slack`; r goes through a product and two sums
 * for every axis. */
ENOUGH(symbols, 1 + 1 + AXES, 16);
ENOUGH(symbols_g, AXES, 16);
ENOUGH(symbols_c, 1 + 2 * AXES, 16);
ENOUGH(symbols_r, 1 + 2 * AXES + 3, 16);

ALWAYS void into_symbols(int n, const soter_reach_chain* x, const double* from, const line* u,
                         double size, double* c, double* g, double* r) {
  double w = u->r;
  *c = u->c;
  for (int j = 0; j < n; j++) {
    double slack = fabs(u->gain[j]) * (fabs(x->m[j]) + fabs(from[j]));
    *c += u->gain[j] * (x->m[j] - from[j]);
    w += fabs(u->gain[j]) * x->box[j];
    g[j] = 0;
    for (int l = 0; l < n; l++) {
      g[j] += u->gain[l] * x->g[l][j];
      slack += fabs(u->gain[l] * x->g[l][j]);
    }
    w += 16 * EPS * slack;
  }
  *r = w * (1 + 16 * EPS) + 16 * EPS * (size + fabs(*c)) + TINY;
  SOTER_CHECK(!(*r < 0));
}

/* The commands of this hold, and where the law read. */
ALWAYS int read_commands(int n, int m, const soter_reach_group* g, soter_scratch* s,
                         const soter_reach_chain* x, acting* t, double* from) {
  memset(t->dlo, 0, sizeof t->dlo);
  memset(t->dhi, 0, sizeof t->dhi);
  if ((g->delay > 0 || g->jitter > 0) && !find_drift(g, s, x, t->dlo, t->dhi)) {
    return 0;
  }
  if (!read_law(n, m, g, s, x, t->dlo, t->dhi, t->u)) {
    return 0;
  }
  for (int i = 0; i < n; i++) {
    from[i] = g->held_low != 0 ? x->m[i] : s->in[g->axis[i]].c;
  }
  for (int a = 0; a < m; a++) {
    const double size = add_drift(n, t->dlo, t->dhi, &t->u[a]);
    into_symbols(n, x, from, &t->u[a], size, &t->c[a], t->g[a], &t->r[a]);
    t->lo[a] = t->u[a].lo;
    t->hi[a] = t->u[a].hi;
    if (x->holds > 0 && g->jitter > 0) { /* the last one may still act */
      t->lo[a] = soter_least(t->lo[a], x->past_lo[0][a]);
      t->hi[a] = soter_most(t->hi[a], x->past_hi[0][a]);
    }
    t->anew[a] = g->swept > 0 ? t->u[a].r : 0;
    t->u[a].r = g->swept > 0 ? 0 : t->u[a].r;
  }
  return 1;
}

/* Axes whose rates have one sign, but for rounding. */
static unsigned axes_one_way(const soter_reach_group* g, const double* flo, const double* fhi) {
  unsigned found = 0;
  for (int i = 0; i < g->axes; i++) {
    found |= flo[i] >= -g->dust[i] || fhi[i] <= g->dust[i] ? 1U << i : 0U;
  }
  return found;
}

/* A model and a step of its own, for flows that are not linear. A command that is held in place of
 * the law may change at any time: its radius is noise. The box is one over a little more time than
 * the step takes: soter_reach_make_step adds 8 EPS period. */
static int make_local_step(const soter_reach_group* g, soter_scratch* s, const soter_reach_chain* x,
                           acting* t, soter_reach_model* model, soter_reach_step* step,
                           unsigned* may) {
  const double h = x->holds == 0 ? g->period - g->jitter : g->period;
  const double early = x->holds == 0 ? 0 : 2 * g->jitter;
  double flo[AXES], fhi[AXES];
  if (!soter_reach_picard(g, s, x->lo, x->hi, t->lo, t->hi, 0, h + 16 * EPS * g->period, flo,
                          fhi) ||
      !soter_reach_model_of(g, s, model)) {
    return 0;
  }
  *may = axes_one_way(g, flo, fhi);
  for (int a = 0; a < g->commands; a++) {
    const double radius = g->held_low != 0 ? t->u[a].r : 0;
    for (int i = 0; i < g->axes; i++) {
      model->w[i] = soter_up(model->w[i] + soter_up(fabs(model->b[i][a]) * radius));
    }
    t->u[a].r -= radius;
  }
  return soter_reach_make_step(g, model, h, early, step);
}

/* x(h) = phi x + gamma u + c + [-w, w] as a motion from `from`: phi x = phi (x - from) + phi from.
 *
 * `to` is a sum of 1 + n + m terms. An entry of M is a sum of 1 + m terms, whose size TINY makes
 * larger than any product that underflows. noise goes through NOISE roundings: its first sum, n + m
 * more, that with the slack, and m in `add_handover`; a product counts where its sum comes later.
 */
ENOUGH(to, 1 + AXES + COMMANDS, 32);

ALWAYS void motion_of(int n, int m, const soter_reach_chain* x, const soter_reach_step* step,
                      const line* u, motion* t) {
  for (int i = 0; i < n; i++) {
    ball b = {step->c[i], step->w[i] + step->c_r[i], fabs(step->c[i])};
    for (int j = 0; j < n; j++) {
      t->M[i][j] = step->phi[i][j];
      t->size[i][j] = fabs(step->phi[i][j]) + TINY;
      ball_add(&b, step->phi[i][j], t->from[j]);
      b.r += step->phi_r[i][j] * size_of(x->lo[j], x->hi[j]);
    }
    for (int a = 0; a < m; a++) {
      const double gamma = step->gamma[i][a];
      ball_add(&b, gamma, u[a].c);
      b.r += fabs(gamma) * u[a].r + step->gamma_r[i][a] * size_of(u[a].lo, u[a].hi);
      for (int j = 0; j < n; j++) {
        const double p = gamma * u[a].gain[j];
        t->M[i][j] += p;
        t->size[i][j] += fabs(p);
      }
    }
    t->to[i] = b.c;
    t->noise[i] = b.r + 32 * EPS * b.size;
  }
}

/* What the last command is off from this one, while it may still act: [low, high].
 *
 * r: a sum of 2 + n, of which differences round once more, (2). The difference of the centres and
 * c - r, c + r round by u (2 |c| + r): 16 u of the centres and one rounding of r are for it. */
ENOUGH(left_over, 1 + AXES + 1 + 2 + AXES + 2, 16);

ALWAYS void add_difference(int n, const soter_reach_chain* x, const acting* t, int a, double* low,
                           double* high) {
  const double c = x->uc[a] - t->c[a];
  double r = x->ur[a] + t->r[a];
  for (int j = 0; j < n; j++) {
    r += fabs(x->ug[a][j] - t->g[a][j]);
  }
  r = r * (1 + 16 * EPS) + 8 * EPS * (fabs(x->uc[a]) + fabs(t->c[a])) + TINY;
  for (int j = 0; j < n; j++) {
    r += 4 * EPS * (fabs(x->ug[a][j]) + fabs(t->g[a][j]));
  }
  *low = soter_most(c - r, soter_down(x->past_lo[0][a] - t->u[a].hi));
  *high = soter_least(c + r, soter_up(x->past_hi[0][a] - t->u[a].lo));
}

/* What an earlier command adds to the motion where it may still act at the beginning.
 *
 * [lo, hi] are products, off by u (|mid| + rad); rad = max(hi - mid, mid - lo) is rounded by (1);
 * `to` grows by a sum. 16 u (|to| + |mid|) is added for the centre; u rad, for the products, is the
 * one rounding that `advance` leaves over. */
static void add_handover(const soter_reach_group* g, const soter_reach_step* step,
                         const soter_reach_chain* x, const acting* t, motion* to) {
  if (x->holds == 0 || g->jitter <= 0) {
    return;
  }
  for (int a = 0; a < g->commands; a++) {
    double low, high;
    add_difference(g->axes, x, t, a, &low, &high);
    for (int i = 0; i < g->axes; i++) {
      const double p = step->move_lo[i][a] * low, q = step->move_lo[i][a] * high;
      const double v = step->move_hi[i][a] * low, w = step->move_hi[i][a] * high;
      const double lo = soter_least(soter_least(p, q), soter_least(v, w)),
                   hi = soter_most(soter_most(p, q), soter_most(v, w));
      const double mid = lo / 2 + hi / 2;
      to->to[i] += mid;
      to->noise[i] +=
          soter_up(soter_most(hi - mid, mid - lo)) + 8 * EPS * (fabs(to->to[i]) + fabs(mid));
    }
  }
}

/* Where each instant may answer another read: |e^(As)| |b| `anew` is integrated. For the rest,
 * c + gain (x - from) as of the beginning of the hold, the radius of gamma was taken with [lo, hi],
 * which it may be outside of by `anew`. */
static void find_new_answers(const soter_reach_group* g, const soter_reach_model* m,
                             const soter_reach_step* step, const acting* t, motion* to) {
  for (int i = 0; i < g->axes && g->swept > 0; i++) {
    for (int j = 0; j < g->axes; j++) {
      double off = 0;
      for (int a = 0; a < g->commands; a++) {
        off = soter_up(off + soter_up(fabs(m->b[j][a]) * t->anew[a]));
      }
      to->noise[i] = soter_up(to->noise[i] + soter_up(step->dev[i][j] * off));
    }
    for (int a = 0; a < g->commands; a++) {
      to->noise[i] = soter_up(to->noise[i] + soter_up(step->gamma_r[i][a] * t->anew[a]));
    }
    SOTER_CHECK(!(to->noise[i] < 0));
  }
}

/* Tube between two hulls, with x' in [flo, fhi] all the way. */
ALWAYS void enclose_between(int n, double h, const soter_reach_chain* x, const double* lo,
                            const double* hi, const double* flo, const double* fhi,
                            soter_hold* out) {
  for (int i = 0; i < n; i++) {
    const double up = soter_up(h * soter_most(fhi[i], 0.0)),
                 down = soter_up(h * soter_most(-flo[i], 0.0));
    const double high = soter_least(soter_up(x->hi[i] + up), soter_up(hi[i] + down));
    const double low = soter_most(soter_down(x->lo[i] - down), soter_down(lo[i] - up));
    out->tube_hi[i] = soter_most(high, soter_most(x->hi[i], hi[i]));
    out->tube_lo[i] = soter_least(low, soter_least(x->lo[i], lo[i]));
    SOTER_CHECK(out->tube_lo[i] <= lo[i] && out->tube_hi[i] >= hi[i]);
  }
}

static void remember_command(const soter_reach_group* g, soter_reach_chain* x, const acting* t) {
  memmove(x->past_lo[1], x->past_lo[0], sizeof x->past_lo - sizeof x->past_lo[0]);
  memmove(x->past_hi[1], x->past_hi[0], sizeof x->past_hi - sizeof x->past_hi[0]);
  for (int a = 0; a < g->commands; a++) {
    SOTER_CHECK(t->u[a].lo <= t->u[a].hi);
    x->past_lo[0][a] = t->u[a].lo;
    x->past_hi[0][a] = t->u[a].hi;
    x->uc[a] = t->c[a];
    x->ur[a] = t->r[a];
    memcpy(x->ug[a], t->g[a], sizeof x->ug[a]);
  }
}

/* The next command may come any time within 2 j from y: the image grows by that much. */
ALWAYS int find_lingering(int n, int m, const soter_reach_group* g, soter_scratch* s,
                          const soter_reach_model* model, const line* u, const soter_reach_chain* y,
                          soter_hold* out) {
  const double late = 2 * g->jitter;
  double ulo[COMMANDS], uhi[COMMANDS], flo[AXES], fhi[AXES];
  for (int a = 0; a < m; a++) {
    ulo[a] = u[a].lo;
    uhi[a] = u[a].hi;
  }
  if (g->is_local
          ? !soter_reach_picard(g, s, y->lo, y->hi, ulo, uhi, 0, late, flo, fhi)
          : !rates_around(n, m, model, &g->reach_fwd[0][0], y->lo, y->hi, ulo, uhi, flo, fhi)) {
    return 0;
  }
  for (int i = 0; i < n; i++) {
    out->image_lo[i] = soter_down(y->lo[i] - soter_up(late * soter_most(0.0, -flo[i])));
    out->image_hi[i] = soter_up(y->hi[i] + soter_up(late * soter_most(0.0, fhi[i])));
  }
  soter_reach_keep(g, out->image_lo, out->image_hi);
  return 1;
}

/* Cuts axis i of the hold where it rises, or falls, from x. */
ALWAYS void cut_axis(int i, unsigned rises, unsigned falls, const soter_reach_chain* x,
                     soter_reach_chain* y, soter_hold* out) {
  const double lo = rises >> i & 1U ? x->lo[i] : -HUGE_VAL;
  const double hi = falls >> i & 1U ? x->hi[i] : HUGE_VAL;
  y->lo[i] = soter_most(y->lo[i], lo);
  out->image_lo[i] = soter_most(out->image_lo[i], lo);
  out->tube_lo[i] = soter_most(out->tube_lo[i], lo);
  y->hi[i] = soter_least(y->hi[i], hi);
  out->image_hi[i] = soter_least(out->image_hi[i], hi);
  out->tube_hi[i] = soter_least(out->tube_hi[i], hi);
}

/* Puts back the axes of x that did not move at all on the way to y, and the ends of those that went
 * one way only. `may`: axes that may do so, in a flow that is not linear. Of a linear one just
 * rates that are 0 but for rounding are looked at again: most holds end here. */
ALWAYS void keep_standing(int n, const soter_reach_group* g, soter_scratch* s,
                          const soter_reach_chain* x, const double* flo, const double* fhi,
                          const double* ulo, const double* uhi, unsigned may, soter_reach_chain* y,
                          soter_hold* out) {
  double lo[AXES], hi[AXES], rate[AXES];
  unsigned rises, falls;
  for (int i = 0; i < n; i++) {
    lo[i] = soter_least(out->tube_lo[i], out->image_lo[i]);
    hi[i] = soter_most(out->tube_hi[i], out->image_hi[i]);
    rate[i] = size_of(flo[i], fhi[i]);
    may |= rate[i] <= g->dust[i] ? 1U << i : 0U;
  }
  if (may == 0) {
    return;
  }
  soter_reach_stands(g, s, lo, hi, rate, ulo, uhi, &rises, &falls);
  for (int i = 0; i < n; i++) {
    if (!(may >> i & 1U) || !(g->is_local || (rises & falls) >> i & 1U)) {
      continue;
    }
    cut_axis(i, rises, falls, x, y, out);
    if ((rises & falls) >> i & 1U) {
      y->m[i] = x->m[i];
      y->box[i] = x->box[i];
      memcpy(y->g[i], x->g[i], sizeof x->g[i]);
      y->lo[i] = out->image_lo[i] = out->tube_lo[i] = x->lo[i];
      y->hi[i] = out->image_hi[i] = out->tube_hi[i] = x->hi[i];
    }
  }
}

/* Where x is at the end of the step: y. */
ALWAYS int move_chain(int n, int m, const soter_reach_group* g, const soter_reach_step* step,
                      const soter_reach_model* model, const soter_reach_chain* x, const acting* t,
                      motion* to, soter_reach_chain* y) {
  motion_of(n, m, x, step, t->u, to);
  add_handover(g, step, x, t, to);
  find_new_answers(g, model, step, t, to);
  soter_copy_state(y, x);
  for (int i = 0; i < n; i++) {
    y->lo[i] = -HUGE_VAL;
    y->hi[i] = HUGE_VAL;
  }
  if (!advance(n, y, to)) {
    return 0;
  }
  soter_reach_keep(g, y->lo, y->hi);
  return 1;
}

ALWAYS int hold_flow(int n, int m, const soter_reach_group* g, soter_scratch* s,
                     soter_reach_chain* x, soter_hold* out) {
  double flo[AXES], fhi[AXES];
  unsigned may = 0;
  acting t;
  motion to;
  soter_reach_model local;
  soter_reach_step fresh;
  const soter_reach_model* model = g->is_local ? &local : &g->model;
  const soter_reach_step* step = g->is_local ? &fresh : x->holds == 0 ? &g->first : &g->later;
  soter_reach_chain y;
  if (!read_commands(n, m, g, s, x, &t, to.from) ||
      (g->is_local && !make_local_step(g, s, x, &t, &local, &fresh, &may)) ||
      !move_chain(n, m, g, step, model, x, &t, &to, &y) ||
      !rates_around(n, m, model, &step->dev[0][0], x->lo, x->hi, t.lo, t.hi, flo, fhi)) {
    return 0;
  }
  enclose_between(n, step->h, x, y.lo, y.hi, flo, fhi, out);
  memcpy(out->image_lo, y.lo, sizeof y.lo);
  memcpy(out->image_hi, y.hi, sizeof y.hi);
  if (g->jitter > 0 && !find_lingering(n, m, g, s, model, t.u, &y, out)) {
    return 0;
  }
  keep_standing(n, g, s, x, flo, fhi, t.lo, t.hi, may, &y, out);
  soter_reach_to_ends(g, x->from_low, x->from_high, out->tube_lo, out->tube_hi);
  soter_reach_to_ends(g, x->from_low, x->from_high, out->image_lo, out->image_hi);
  soter_copy_state(x, &y);
  x->holds++;
  if (g->delay > 0 || g->jitter > 0) {
    remember_command(g, x, &t);
  }
  return 1;
}

/* Runs one more hold; 0 where nothing can be bounded. */
int soter_reach_hold(const soter_reach_group* g, soter_scratch* s, soter_reach_chain* x,
                     soter_hold* out) {
  SOTER_CHECK(g->axes >= 1 && g->axes <= AXES && g->commands >= 0 && g->commands <= COMMANDS);
  if (g->is_map) {
    return soter_reach_hold_map(g, s, x, out);
  }
  if (g->commands == 1 && g->axes == 2) {
    return hold_flow(2, 1, g, s, x, out);
  }
  if (g->commands == 1 && g->axes == 3) {
    return hold_flow(3, 1, g, s, x, out);
  }
  return hold_flow(g->axes, g->commands, g, s, x, out);
}
