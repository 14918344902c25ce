/* One hold of a command where the plant is a map.
 * Purpose: states step by step, the last one as the image.
 * Non-goals: flows (soter_reach_hold.c). */
#include "soter_reach_ball.h"

/* One step of a map from y, whose commands stand in `s`, and own states for the range of y. Here M
 * is not summed up, and what a gain lacks is in the line's radius. */
ALWAYS int map_step(int n, const soter_reach_group* g, soter_scratch* s, soter_reach_chain* y) {
  motion t = {.to = {0}, .noise = {0}};
  line f;
  for (int i = 0; i < n; i++) {
    t.from[i] = s->in[g->axis[i]].c;
  }
  if (g->rate(s->in, g->param, s->out)) {
    return 0;
  }
  for (int i = 0; i < n; i++) {
    if (!line_of(n, g, s, &s->out[g->axis[i]], &f)) {
      return 0;
    }
    for (int j = 0; j < n; j++) {
      t.M[i][j] = f.gain[j];
      t.size[i][j] = fabs(f.gain[j]);
    }
    t.to[i] = f.c;
    t.noise[i] = f.r + g->extra_w[i];
    y->lo[i] = soter_down(f.lo - g->extra_w[i]);
    y->hi[i] = soter_up(f.hi + g->extra_w[i]);
  }
  return advance(n, y, &t);
}

/* The commands that act in the first step. The law's form has the inputs' symbols. */
ALWAYS void set_first_commands(int m, const soter_reach_group* g, soter_scratch* s, const line* u) {
  for (int a = 0; a < m; a++) {
    const int k = g->states + g->command[a];
    if (g->held_low != 0) {
      soter_set(&s->in[k], k, u[a].lo, u[a].hi);
    } else {
      s->in[k] = s->out[g->command[a]];
    }
  }
}

/* The steps after the first: the law read the first state, not these. */
ALWAYS int make_later_steps(int n, int m, const soter_reach_group* g, soter_scratch* s,
                            const line* u, soter_reach_chain* y, soter_hold* out) {
  for (int a = 0; a < m && g->hold_steps > 1; a++) {
    const int c = g->states + g->command[a];
    soter_set(&s->in[c], c, u[a].lo, u[a].hi);
  }
  for (int k = 1; k < g->hold_steps; k++) {
    for (int i = 0; i < n; i++) {
      soter_range(&s->in[g->axis[i]], g->axis[i], y->lo[i], y->hi[i]);
      out->tube_lo[i] = soter_least(out->tube_lo[i], y->lo[i]);
      out->tube_hi[i] = soter_most(out->tube_hi[i], y->hi[i]);
    }
    if (!map_step(n, g, s, y)) {
      return 0;
    }
  }
  return 1;
}

/* The tube of a map: every state under the command but the last, which the image encloses. */
ALWAYS int hold_map(int n, int m, const soter_reach_group* g, soter_scratch* s,
                    soter_reach_chain* x, soter_hold* out) {
  static const double none[AXES] = {0, 0, 0, 0};
  line u[COMMANDS];
  soter_reach_chain y;
  SOTER_CHECK(g->hold_steps >= 1);
  soter_copy_state(&y, x);
  for (int i = 0; i < n; i++) {
    soter_range(&s->in[g->axis[i]], g->axis[i], x->lo[i], x->hi[i]);
    out->tube_lo[i] = x->lo[i];
    out->tube_hi[i] = x->hi[i];
  }
  if (!read_law(n, m, g, s, x, none, none, u)) {
    return 0;
  }
  set_first_commands(m, g, s, u);
  if (!map_step(n, g, s, &y) || !make_later_steps(n, m, g, s, u, &y, out)) {
    return 0;
  }
  soter_copy_state(x, &y);
  x->holds++;
  memcpy(out->image_lo, x->lo, sizeof x->lo);
  memcpy(out->image_hi, x->hi, sizeof x->hi);
  return 1;
}

int soter_reach_hold_map(const soter_reach_group* g, soter_scratch* s, soter_reach_chain* x,
                         soter_hold* out) {
  if (g->commands == 1 && g->axes == 2) {
    return hold_map(2, 1, g, s, x, out);
  }
  return hold_map(g->axes, g->commands, g, s, x, out);
}
