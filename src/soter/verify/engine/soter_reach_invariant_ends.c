/* What does not move: ends of the grid that the plant keeps, ends that are none, and states that
 * stand still, or go one way only.
 * Purpose: the two places where rounding outward would turn a closed cell into a larger one.
 * docs/proof-sets.md argues the same in "Views, and open ends" and "Axes without ends".
 * Non-goals: finding the ends that are kept (verify/grid/group_model.py).
 *
 * Ends. g->kept_low[i] says that x_i' >= 0 wherever x_i lies in a strip below the lowest edge e,
 * everything else in its range. A run that is at e or above then never gets below: were x_i(t) < e,
 * let s be the last instant before t with x_i(s) = e; just after s the run is in the strip, so that
 * x_i cannot fall. No uniqueness of solutions is needed. Hence an enclosure of such a run may be
 * cut at e. (Runs followed backwards, for what was read, are not cut.)
 *
 * No ends. g->kept_high[i] == SOTER_REACH_UNBOUNDED says that the last cell of the axis holds all
 * that lies beyond, and that no rate and no law reads x_i. Then, of two runs that differ in nothing
 * but x_i(0), x_i differs by the same amount for ever. Enclosures are computed from the cell with
 * its breakpoint e, and are not cut: they hold the runs that began in it. A run that began beyond
 * is one of these, moved up: at every instant it is in a cell between theirs and the last one. So
 * what is enclosed of a cell that touches e goes up to e (soter_reach_to_ends), and only where
 * cells are told is what lies beyond the last breakpoint taken for the last cell.
 *
 * Standing. Let a box hold all states of a run over some time. If x_i' is exactly 0 for every state
 * of the box and every command that may act meanwhile, x_i does not change: what was in a closed
 * cell is in it. Enclosures say 0 exactly where a sum of zeros or a product with zero makes it so.
 * One way: if x_i' >= 0 all over that box, x_i does not fall below where it was, and the lower end
 * of the cell stays; if x_i' <= 0, the upper end. Both together is standing. Of a linear flow only
 * standing counts, and the box is grown by what the stages of the simulator's scheme may leave it:
 * its steps add multiples of rates in that box. Of others the scheme is assumed (g->scheme is 0).
 */
#include "soter_reach_internal.h"

/* Cuts an enclosure of a run that began in the grid. */
void soter_reach_keep(const soter_reach_group* g, double* lo, double* hi) {
  for (int i = 0; i < g->axes; i++) {
    soter_reach_keep_axis(g, i, &lo[i], &hi[i]);
  }
}

/* Bit i of `rises`: x_i' >= 0 on the box under all commands in [ulo, uhi]; of `falls`: x_i' <= 0.
 *
 * The box is grown by what the stages of the simulator's scheme may leave it, where that is
 * covered: there the rates have that sign as well (they enclose the values computed in binary64,
 * too), and so has a step of the scheme. */
void soter_reach_stands(const soter_reach_group* g, soter_scratch* s, const double* lo,
                        const double* hi, const double* rate, const double* ulo, const double* uhi,
                        unsigned* rises, unsigned* falls) {
  *rises = 0;
  *falls = 0;
  for (int i = 0; i < g->axes; i++) {
    const int k = g->axis[i];
    const double more = soter_up(g->scheme * rate[i]);
    const double low = soter_down(lo[i] - more), high = soter_up(hi[i] + more);
    SOTER_CHECK(!(lo[i] > hi[i]) && !(rate[i] < 0)); /* `rate`: sizes */
    if (!(low >= g->low[k] && high <= g->high[k])) {
      return;
    }
    soter_range(&s->in[k], k, low, high);
  }
  for (int a = 0; a < g->commands; a++) {
    const int k = g->states + g->command[a];
    SOTER_CHECK(!(ulo[a] > uhi[a]));
    soter_range(&s->in[k], k, ulo[a], uhi[a]);
  }
  if (g->rate(s->in, g->param, s->out)) {
    return;
  }
  for (int i = 0; i < g->axes; i++) {
    const soter_form* f = &s->out[g->axis[i]];
    *rises |= f->lo >= 0 ? 1U << i : 0U;
    *falls |= f->hi <= 0 ? 1U << i : 0U;
  }
}

/* Bit i: a box with these lower ends touches an end of axis i that has no outer end. */
unsigned soter_reach_at_low(const soter_reach_group* g, const double* lo) {
  unsigned at = 0;
  for (int i = 0; i < g->axes; i++) {
    at |= g->kept_low[i] == SOTER_REACH_UNBOUNDED && lo[i] <= g->edges[i][0] ? 1U << i : 0U;
  }
  return at;
}

/* The same of upper ends. */
unsigned soter_reach_at_high(const soter_reach_group* g, const double* hi) {
  unsigned at = 0;
  for (int i = 0; i < g->axes; i++) {
    const double end = g->edges[i][g->cells[i]];
    at |= g->kept_high[i] == SOTER_REACH_UNBOUNDED && hi[i] >= end ? 1U << i : 0U;
  }
  return at;
}

/* What is enclosed of runs that began at an end that has no outer end goes up to it. */
void soter_reach_to_ends(const soter_reach_group* g, unsigned from_low, unsigned from_high,
                         double* lo, double* hi) {
  for (int i = 0; i < g->axes; i++) {
    if (from_low >> i & 1U) {
      lo[i] = soter_least(lo[i], g->edges[i][0]);
    }
    if (from_high >> i & 1U) {
      hi[i] = soter_most(hi[i], g->edges[i][g->cells[i]]);
    }
  }
}
