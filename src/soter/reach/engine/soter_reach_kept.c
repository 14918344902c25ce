/* What does not move: ends of the grid that the plant keeps, and states that stand still.
 * Purpose: the two places where rounding outward would turn a closed cell into a larger one.
 * Non-goals: finding the ends that are kept (soter/reach/grid/borders.py).
 *
 * Ends. g->kept_low[i] says that x_i' >= 0 wherever x_i lies in a strip below the lowest edge e,
 * everything else in its range. A run that is at e or above then never gets below: were x_i(t) < e,
 * let s be the last instant before t with x_i(s) = e; just after s the run is in the strip, so that
 * x_i cannot fall. No uniqueness of solutions is needed. Hence an enclosure of such a run may be
 * cut at e. (Runs followed backwards, for what was read, are not cut.)
 *
 * Standing. Let a box hold all states of a run over some time. If x_i' is exactly 0 for every state
 * of the box and every command that may act meanwhile, x_i does not change: what was in a closed
 * cell is in it. Enclosures say 0 exactly where a sum of zeros or a product with zero makes it so.
 */
#include "soter_reach_in.h"

/* Cuts an enclosure of a run that began in the grid. */
void soter_reach_keep(const soter_reach_group* g, double* lo, double* hi) {
  for (int i = 0; i < g->axes; i++) {
    soter_reach_keep_axis(g, i, &lo[i], &hi[i]);
  }
}

/* Bit i: x_i' is exactly 0 on the box under all commands in [ulo, uhi].
 *
 * The box is grown by what the stages of the simulator's scheme may leave it: there the rates are 0
 * as well (they enclose the values computed in binary64, too), so a step of the scheme adds 0. */
unsigned soter_reach_stands(const soter_reach_group* g, soter_scratch* s, const double* lo,
                            const double* hi, const double* rate, const double* ulo,
                            const double* uhi) {
  unsigned stands = 0;
  for (int i = 0; i < g->axes; i++) {
    const int k = g->axis[i];
    const double more = soter_up(g->scheme * rate[i]);
    const double low = soter_down(lo[i] - more), high = soter_up(hi[i] + more);
    SOTER_CHECK(!(lo[i] > hi[i]) && !(rate[i] < 0)); /* `rate`: sizes */
    if (!(low >= g->low[k] && high <= g->high[k])) {
      return 0;
    }
    soter_range(&s->in[k], k, low, high);
  }
  for (int a = 0; a < g->commands; a++) {
    const int k = g->states + g->command[a];
    SOTER_CHECK(!(ulo[a] > uhi[a]));
    soter_range(&s->in[k], k, ulo[a], uhi[a]);
  }
  if (g->rate(s->in, g->param, s->out)) {
    return 0;
  }
  for (int i = 0; i < g->axes; i++) {
    const soter_form* f = &s->out[g->axis[i]];
    stands |= f->lo == 0 && f->hi == 0 ? 1U << i : 0U;
  }
  return stands;
}
