/* Several boxes move at once, each under one command: a box a lane.
 * Purpose: a hold of a linear flow, as `soter_reach_hold` makes it.
 * Non-goals: laws, delays, jitter, axes that stand or have no end: who asks knows what a hold needs
 * of them (soter_reach_around.c).
 *
 * Every operation on a lane is the one of soter_reach_ball.h and soter_reach_hold.c, in their
 * order, rounded once: the bits are the same. What is left out are sums with products of a gain
 * that is 0, of drifts that are 0 and of an earlier command: they add nothing. */
#include "soter_reach_lanes.h"
#include "soter_reach_ball.h"

typedef struct {
  lanes m[AXES], g[AXES][AXES], box[AXES], lo[AXES], hi[AXES];
} chains;

/* Commands as c + [-r, r], and what was asked for. */
typedef struct {
  lanes asked[COMMANDS], c[COMMANDS], r[COMMANDS];
} commands;

/* Lanes beyond `count` repeat the last one. */
ALWAYS void take_chains(int n, int m, int count, const soter_reach_mover* from, chains* x,
                        commands* u) {
  SOTER_CHECK(count >= 1 && count <= LANES);
  for (int l = 0; l < LANES; l++) {
    const soter_reach_mover* one = &from[l < count ? l : count - 1];
    for (int i = 0; i < n; i++) {
      x->m[i][l] = one->x->m[i];
      x->box[i][l] = one->x->box[i];
      x->lo[i][l] = one->x->lo[i];
      x->hi[i][l] = one->x->hi[i];
      for (int j = 0; j < n; j++) {
        x->g[i][j][l] = one->x->g[i][j];
      }
    }
    for (int a = 0; a < m; a++) {
      u->asked[a][l] = one->command[a];
    }
  }
}

/* Writes what a lane holds back into its chain. */
ALWAYS void give_chain(int n, int l, const chains* from, soter_reach_chain* x) {
  for (int i = 0; i < n; i++) {
    x->m[i] = from->m[i][l];
    x->box[i] = from->box[i][l];
    x->lo[i] = from->lo[i][l];
    x->hi[i] = from->hi[i][l];
    SOTER_CHECK(x->lo[i] <= x->hi[i]);
    for (int j = 0; j < n; j++) {
      x->g[i][j] = from->g[i][j][l];
    }
  }
  x->holds++;
}

/* Ranges of x' over boxes: `rates`. */
ALWAYS void rate_ranges(int n, int m, const soter_reach_model* model, const lanes* lo,
                        const lanes* hi, const commands* u, lanes* flo, lanes* fhi) {
  for (int i = 0; i < n; i++) {
    lanes low = all(model->c[i]), high = low, sum = size(low);
    for (int j = 0; j < n; j++) {
      const lanes p = model->a[i][j] * lo[j], q = model->a[i][j] * hi[j];
      low += least(p, q);
      high += most(p, q);
      sum += most(size(p), size(q));
    }
    for (int a = 0; a < m; a++) {
      const lanes p = model->b[i][a] * u->asked[a];
      low += p;
      high += p;
      sum += size(p);
    }
    sum = 16 * EPS * sum + TINY;
    SOTER_CHECK(!(model->w[i] < 0));
    flo[i] = down(low - model->w[i]) - sum;
    fhi[i] = up(high + model->w[i]) + sum;
  }
}

/* Where all rates over x alone are above the dust: they are no larger than those over all of the
 * tube, so that no axis stands. */
ALWAYS truths lanes_that_move(int n, const soter_reach_group* g, const lanes* flo,
                              const lanes* fhi) {
  truths found = ~(truths){0};
  for (int i = 0; i < n; i++) {
    SOTER_CHECK(!(g->dust[i] < 0));
    found &= most(size(flo[i]), size(fhi[i])) > g->dust[i];
  }
  return found;
}

typedef struct {
  lanes lo[AXES], hi[AXES];
} boxes;

/* The tube from x, whose rates are [flo, fhi], to y: `rates_around`, of which it says where they
 * are numbers, and `enclose_between`. */
ALWAYS truths tube_of(int n, int m, const soter_reach_group* g, const chains* x, const chains* y,
                      const commands* u, const lanes* flo, const lanes* fhi, boxes* out) {
  const soter_reach_step* step = &g->first;
  lanes lo[AXES], hi[AXES], least_rate[AXES], most_rate[AXES];
  truths found = ~(truths){0};
  for (int i = 0; i < n; i++) {
    lanes d = all(0);
    for (int j = 0; j < n; j++) {
      d += step->dev[i][j] * most(size(flo[j]), size(fhi[j]));
    }
    d = d * (1 + 8 * EPS) + TINY;
    lo[i] = down(x->lo[i] - d);
    hi[i] = up(x->hi[i] + d);
  }
  rate_ranges(n, m, &g->model, lo, hi, u, least_rate, most_rate);
  SOTER_CHECK(!(step->h < 0));
  for (int i = 0; i < n; i++) {
    const lanes rise = up(step->h * most(most_rate[i], all(0)));
    const lanes fall = up(step->h * most(-least_rate[i], all(0)));
    const lanes high = least(up(x->hi[i] + rise), up(y->hi[i] + fall));
    const lanes low = most(down(x->lo[i] - fall), down(y->lo[i] - rise));
    out->hi[i] = most(high, most(x->hi[i], y->hi[i]));
    out->lo[i] = least(low, least(x->lo[i], y->lo[i]));
    found &= (least_rate[i] > -1e300) & (most_rate[i] < 1e300);
  }
  return found;
}

/* As `add_drift` leaves a number where nothing drifts. */
ALWAYS void number_command(commands* u, int a) {
  const lanes r = 8 * EPS * size(u->asked[a]);
  u->c[a] = u->asked[a];
  u->r[a] = either(r == 0, all(0), r + TINY);
  SOTER_CHECK(a >= 0 && a < COMMANDS);
}

/* Row i of the motion: `motion_of`. */
ALWAYS void motion_row(int n, int m, const soter_reach_step* step, int i, const chains* x,
                       const lanes* from, const commands* u, lanes* to, lanes* noise) {
  lanes c = all(step->c[i]), r = all(step->w[i] + step->c_r[i]), sum = size(c);
  for (int j = 0; j < n; j++) {
    const lanes p = step->phi[i][j] * from[j];
    c += p;
    sum += size(p);
    r += step->phi_r[i][j] * most(size(x->lo[j]), size(x->hi[j]));
  }
  for (int a = 0; a < m; a++) {
    const lanes p = step->gamma[i][a] * u->c[a];
    c += p;
    sum += size(p);
    r += fabs(step->gamma[i][a]) * u->r[a] + step->gamma_r[i][a] * size(u->asked[a]);
  }
  SOTER_CHECK(!(step->w[i] < 0));
  *to = c;
  *noise = r + 32 * EPS * sum;
}

/* Row i of what is there after the motion: `advance`. */
ALWAYS void advance_row(int n, const double* phi, int i, const chains* x, const lanes* from,
                        const lanes* rows, lanes to, lanes noise, chains* y) {
  lanes s = to, slack = size(to), b = all(0);
  for (int j = 0; j < n; j++) {
    s += phi[j] * (x->m[j] - from[j]);
    b += fabs(phi[j]) * x->box[j];
    slack += (fabs(phi[j]) + TINY) * (size(x->m[j]) + size(from[j]) + rows[j]);
  }
  for (int k = 0; k < n; k++) {
    lanes e = all(0);
    for (int j = 0; j < n; j++) {
      e += phi[j] * x->g[j][k];
    }
    y->g[i][k] = e;
  }
  SOTER_CHECK(i >= 0 && i < n);
  y->m[i] = s;
  y->box[i] = (b + noise) * (1 + 16 * EPS) + 32 * EPS * slack + TINY;
}

/* The ends of axis i: `hull`, of which it says where they are numbers, and soter_reach_keep. */
ALWAYS truths hull_row(int n, const soter_reach_group* g, int i, chains* y) {
  const double low = g->edges[i][0], high = g->edges[i][g->cells[i]];
  lanes rad = y->box[i];
  truths found;
  for (int j = 0; j < n; j++) {
    rad += size(y->g[i][j]);
  }
  rad = rad * (1 + 8 * EPS) + EPS * size(y->m[i]);
  y->lo[i] = most(all(-HUGE_VAL), down(y->m[i] - rad));
  y->hi[i] = least(all(HUGE_VAL), up(y->m[i] + rad));
  found = (y->lo[i] <= y->hi[i]) & (most(size(y->lo[i]), size(y->hi[i])) < 1e200);
  SOTER_CHECK(low < high);
  if (g->kept_low[i] == SOTER_REACH_KEPT) {
    y->lo[i] = either((y->lo[i] < low) & (y->hi[i] >= low), all(low), y->lo[i]);
  }
  if (g->kept_high[i] == SOTER_REACH_KEPT) {
    y->hi[i] = either((y->hi[i] > high) & (y->lo[i] <= high), all(high), y->hi[i]);
  }
  return found;
}

static int tells_tubes(int count, const soter_reach_mover* movers) {
  int any = 0;
  SOTER_CHECK(count <= LANES);
  for (int l = 0; l < count; l++) {
    any |= movers[l].out != 0;
  }
  return any;
}

/* The tube and image of a lane, where they are wanted. */
ALWAYS void tell_tube(int n, int l, const boxes* tubes, const soter_reach_mover* one) {
  soter_hold* out = one->out;
  if (out == 0) {
    return;
  }
  for (int i = 0; i < n; i++) {
    out->image_lo[i] = one->x->lo[i];
    out->image_hi[i] = one->x->hi[i];
    out->tube_lo[i] = tubes->lo[i][l];
    out->tube_hi[i] = tubes->hi[i][l];
    SOTER_CHECK(out->tube_lo[i] <= out->image_lo[i] && out->tube_hi[i] >= out->image_hi[i]);
  }
}

ALWAYS unsigned move_lanes(int n, int m, const soter_reach_group* g, int count,
                           const soter_reach_mover* movers) {
  chains x, y;
  commands u;
  boxes tubes = {0};
  lanes from[AXES], rows[AXES], flo[AXES], fhi[AXES];
  truths found;
  unsigned moved = 0;
  take_chains(n, m, count, movers, &x, &u);
  rate_ranges(n, m, &g->model, x.lo, x.hi, &u, flo, fhi);
  found = lanes_that_move(n, g, flo, fhi);
  for (int a = 0; a < m; a++) {
    number_command(&u, a);
  }
  for (int i = 0; i < n; i++) {
    from[i] = either(x.lo[i] == x.hi[i], x.lo[i], x.lo[i] / 2 + x.hi[i] / 2);
    rows[i] = x.box[i];
    for (int k = 0; k < n; k++) {
      rows[i] += size(x.g[i][k]);
    }
  }
  for (int i = 0; i < n; i++) {
    lanes to, noise;
    motion_row(n, m, &g->first, i, &x, from, &u, &to, &noise);
    advance_row(n, g->first.phi[i], i, &x, from, rows, to, noise, &y);
    found &= hull_row(n, g, i, &y);
  }
  if (tells_tubes(count, movers)) {
    found &= tube_of(n, m, g, &x, &y, &u, flo, fhi, &tubes);
  }
  for (int l = 0; l < count; l++) {
    if (found[l] != 0) {
      give_chain(n, l, &y, movers[l].x);
      tell_tube(n, l, &tubes, &movers[l]);
      moved |= 1U << l;
    }
  }
  SOTER_CHECK(moved >> count == 0);
  return moved;
}

/* Runs a hold of a linear flow to its end for up to LANES boxes, each under commands that are
 * numbers: what `soter_reach_hold` makes of them, and of their images. Bit k: the k-th moved;
 * others are as they were, and that one is to be asked. */
unsigned soter_reach_move(const soter_reach_group* g, int count, const soter_reach_mover* movers) {
  SOTER_CHECK(!g->is_map && !g->is_local && g->delay <= 0 && g->jitter <= 0);
  if (g->commands == 1 && g->axes == 2) {
    return move_lanes(2, 1, g, count, movers);
  }
  if (g->commands == 1 && g->axes == 3) {
    return move_lanes(3, 1, g, count, movers);
  }
  return move_lanes(g->axes, g->commands, g, count, movers);
}
