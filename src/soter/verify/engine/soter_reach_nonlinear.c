/* Flows that are not linear: ranges of x' over an a-priori box.
 * Purpose: soter_reach_picard, a box that holds x over some time, and x' there.
 * Non-goals: what a hold does with them (soter_reach_hold.c). */
#include "soter_reach_ball.h"

enum { ROUNDS = 12 };

/* x' over a box of states, under the commands in s; 0: it leaves the domain, or has no bound. */
static int rates_over(const soter_reach_group* g, soter_scratch* s, const double* lo,
                      const double* hi, double* flo, double* fhi) {
  for (int i = 0; i < g->axes; i++) {
    if (!(lo[i] >= g->low[g->axis[i]] && hi[i] <= g->high[g->axis[i]])) {
      return 0;
    }
    soter_range(&s->in[g->axis[i]], g->axis[i], lo[i], hi[i]);
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
  }
  return 1;
}

/* How far an axis gets within [from, to] at rates in [flo, fhi]: one product each, (1). */
static void find_excursion(double from, double to, double flo, double fhi, double* down,
                           double* up) {
  *down = soter_up(soter_most(soter_most(0.0, -to * flo), -from * fhi));
  *up = soter_up(soter_most(soter_most(0.0, to * fhi), from * flo));
}

/* 1: the box holds what comes of [lo, hi] at these rates. Else it grows, by a little more. */
static int grow_box_to_hold(const soter_reach_group* g, const double* lo, const double* hi,
                            double from, double to, const double* flo, const double* fhi,
                            double* blo, double* bhi) {
  int inside = 1;
  for (int i = 0; i < g->axes; i++) {
    double down, up, low, high;
    find_excursion(from, to, flo[i], fhi[i], &down, &up);
    low = soter_down(lo[i] - down);
    high = soter_up(hi[i] + up);
    if (from >= 0 && g->kept_low[i] == SOTER_REACH_KEPT) {
      low = soter_most(low, soter_least(lo[i], g->edges[i][0]));
    }
    if (from >= 0 && g->kept_high[i] == SOTER_REACH_KEPT) {
      high = soter_least(high, soter_most(hi[i], g->edges[i][g->cells[i]]));
    }
    SOTER_CHECK(low <= lo[i] && high >= hi[i]);
    if (low < blo[i] || high > bhi[i]) {
      inside = 0;
      blo[i] = soter_least(blo[i], soter_down(lo[i] - 1.25 * down));
      bhi[i] = soter_most(bhi[i], soter_up(hi[i] + 1.25 * up));
    }
  }
  if (from >= 0) {
    soter_reach_keep(g, blo, bhi);
  }
  return inside;
}

/* x' over an a-priori box that holds x over [from, to] under commands in [ulo, uhi]; also leaves
 * the box in s->in. 0: none was found. */
int soter_reach_picard(const soter_reach_group* g, soter_scratch* s, const double* lo,
                       const double* hi, const double* ulo, const double* uhi, double from,
                       double to, double* flo, double* fhi) {
  double blo[AXES], bhi[AXES];
  SOTER_CHECK(from <= 0 && to >= 0);
  for (int i = 0; i < g->axes; i++) {
    blo[i] = lo[i];
    bhi[i] = hi[i];
  }
  for (int a = 0; a < g->commands; a++) {
    const int k = g->states + g->command[a];
    soter_range(&s->in[k], k, ulo[a], uhi[a]);
  }
  for (int round = 0; round < ROUNDS; round++) {
    if (!rates_over(g, s, blo, bhi, flo, fhi)) {
      return 0;
    }
    if (grow_box_to_hold(g, lo, hi, from, to, flo, fhi, blo, bhi) && round > 0) {
      return 1;
    }
  }
  return 0;
}
