/* A fall-back run, as "Decisions by tubes" (docs/proof-flight.md) defines it, beside a tube.
 *
 * Purpose: `fall_back`: any command until an output of SC acts, then SC, read late and wrong, acting
 * within its windows; every state compared with the tube, and, once it rests, with what `moves` and
 * Y say.
 * Non-goals: which adversary (tube_adversary.h).
 */

#ifndef FALL_BACK_H
#define FALL_BACK_H

#define TOLERANCE 1e-7 /* of the integration, in parts of a state's size */
enum { OUTPUTS = 1200 };

typedef struct {
  const config *c;
  policy *p;
  told *o;
  double eps[NS];
  int64_t first; /* a_0 */
  int64_t read[OUTPUTS], act[OUTPUTS][M], last[OUTPUTS];
  double u[OUTPUTS][M];
  int count;
  double rested[N];
  bool rests;
} following;

static void drawn_times(following *f, double *y) {
  const config *c = f->c;
  policy *p = f->p;
  (void)y;
  f->first = c->alpha + pick(p, p->late, c->horizon - c->alpha, c->tick);
  int64_t t0 = f->first - pick(p, p->late == NONE ? ANY_TIME : p->late, c->jitter, c->tick);
  for (int k = 0; k < f->count; k++) {
    int64_t soonest = INT64_MAX, latest = -1;
    for (int i = 0; i < M; i++) {
      int64_t most = k == 0 ? f->first - t0 : c->jitter;
      int64_t at = t0 + k * c->delta_sc + pick(p, draw(p) % 2 ? EITHER : ANY_TIME, most, c->tick);
      at = k == 0 && i == 0 ? f->first : at < 0 ? 0 : at;
      f->act[k][i] = at;
      soonest = at < soonest ? at : soonest;
      latest = at > latest ? at : latest;
    }
    int64_t from = latest - c->delay < 0 ? 0 : latest - c->delay;
    from = from > soonest ? soonest : from;
    f->read[k] = soonest - pick(p, p->age, soonest - from, c->tick);
    f->last[k] = latest;
  }
}

static void found(following *f, double off, int64_t t, int where) {
  f->o->off = where == 14 ? f->o->off : fmax(f->o->off, off);
  if (off > TOLERANCE && f->o->outside++ == 0) {
    f->o->seed = f->p->shown;
    f->o->at = t;
    f->o->where = where;
  }
}

/* The state at t after the estimate's instant, beside every part of the tube that is of then. */
static void compared(following *f, int64_t t, const double *all) {
  const config *c = f->c;
  double x[NS];
  for (int i = 0; i < NS; i++) x[i] = all[FOLLOWED[i]];
  if (t == 0) {
    found(f, outside(trace.begun, x, f->eps, NS), t, 1);
  }
  for (int k = 0; k < c->free && t <= f->first; k++) {
    if (k * c->alpha <= t * c->free && t * c->free <= (k + 1) * c->alpha) {
      found(f, outside(trace.free[k].way, x, f->eps, NS), t, 2);
      if (t * c->free == (k + 1) * c->alpha) {
        found(f, outside(trace.free[k].end, x, f->eps, NS), t, 3);
      }
    }
  }
  if (t >= c->alpha && t <= f->first) {
    found(f, outside(trace.window.way, x, f->eps, NS), t, 4);
    if (t == c->horizon) {
      found(f, outside(trace.window.end, x, f->eps, NS), t, 5);
    }
  }
  int64_t since = t - f->first, j = c->jitter, d = c->delta_sc;
  if (since < 0) {
    return;
  }
  for (int n = 0; trace.timed && n < trace.spans; n++) {
    if (since >= trace.from[n] && since <= trace.to[n]) {
      found(f, outside(trace.span[n].way, x, f->eps, NS), t, 9);
      if (since == trace.to[n]) found(f, outside(trace.span[n].end, x, f->eps, NS), t, 10);
    }
  }
  if (trace.timed) {
    return;
  }
  for (int64_t n = (since - j) / d; n <= (since + j) / d; n++) {
    if (n < 0 || n > trace.end) continue;
    if (n > 0 && j > 0 && since >= n * d - j && since <= n * d + j) {
      found(f, outside(trace.closed[n].way, x, f->eps, NS), t, 6);
      if (since == n * d + j) found(f, outside(trace.closed[n].end, x, f->eps, NS), t, 7);
      int64_t soonest = INT64_MAX;
      for (int i = 0; i < M; i++) soonest = f->act[n][i] < soonest ? f->act[n][i] : soonest;
      if (t <= soonest && trace.opens) found(f, outside(trace.open[n].way, x, f->eps, NS), t, 8);
    }
    int64_t from = n * d + (n > 0 ? j : 0), to = (n + 1) * d - j;
    for (int k = 0; n < trace.end && k < c->steps; k++) {
      int64_t a = from * c->steps + k * (to - from), at = since * c->steps;
      if (at >= a && at <= a + to - from) {
        found(f, outside(trace.step[n][k].way, x, f->eps, NS), t, 9);
        if (at == a + to - from) found(f, outside(trace.step[n][k].end, x, f->eps, NS), t, 10);
      }
    }
  }
}

/* What is said of a run from the output at which it rests on. */
static void at_rest(following *f, int64_t t, const double *x) {
  const config *c = f->c;
  if (trace.end < 0 || t < (trace.timed ? f->first + trace.rest : f->last[trace.end])) {
    return;
  }
  if (!f->rests) {
    memcpy(f->rested, x, sizeof f->rested);
    f->rests = true;
    found(f, -resting(x), t, 11);
  }
  for (int i = 0; i < NS; i++) {
    int s = FOLLOWED[i];
    double size = 1.0 + fabs(x[s]), by = x[s] - f->rested[s];
    found(f, fmax(by - c->above[s], -c->below[s] - by) / size, t, 12);
    found(f, fmax(x[s] - c->y_high[s], c->y_low[s] - x[s]) / size, t, 13);
  }
}

/* From x, where y is read; `tube`: beside what was traced, and on after it rests. */
static void fall_back(const config *c, policy *p, double *x, const double *y, bool tube, told *o) {
  static following f;
  double u[M], w[W + 1], m[AIMS];
  memset(&f, 0, sizeof f);
  f = (following){.c = c, .p = p, .o = o};
  int rests = trace.timed ? (int)(trace.rest / c->delta_sc) : trace.end;
  int ends = tube ? rests + 12 : (int)(c->within / c->delta_sc) + 4;
  f.count = ends + 2 < OUTPUTS ? ends + 2 : OUTPUTS;
  for (int i = 0; i < NS; i++) {
    double e = c->error[FOLLOWED[i]];
    f.eps[i] = e > 0.0 ? (x[FOLLOWED[i]] - y[FOLLOWED[i]]) / e : 0.0;
  }
  drawn_times(&f, x);
  int64_t all = f.first + (f.count - 2) * c->delta_sc;
  o->runs++;
  int soon = 0;
  for (int64_t t = 0; t <= all; t += c->tick) {
    while (soon < f.count && f.read[soon] <= t - 3 * c->delta_sc - c->delay) soon++;
    for (int k = soon; k < f.count && k < soon + 12 + c->delay / c->delta_sc; k++) {
      if (f.read[k] == t) {
        double e[N], seen[N];
        errors(c, p, e);
        for (int i = 0; i < N; i++) seen[i] = x[i] + e[i];
        if (p->error == GREEDY && !tube) worst_read(c, p, x, seen);
        keeps(p);
        law(seen, f.u[k]);
        if (tube && k < trace.laws) {
          found(&f, outside(trace.law[k], f.u[k], f.eps, M), t, 14);
        }
      }
    }
    bool any = t % p->u_every == 0 || t == 0;
    double v[M];
    bool judged = p->judged != NULL && t < f.first - c->any_for;
    any = any || (p->judged != NULL && !judged && t - c->tick < f.first - c->any_for);
    if (any && t < f.first) wanted(c, p, x, t, v);
    if (judged) memcpy(v, p->judged, sizeof v);
    any = any || judged;
    for (int i = 0; i < M; i++) {
      if (t < f.act[0][i]) {
        if (any) u[i] = v[i];
        continue;
      }
      int64_t n = (t - f.first) / c->delta_sc + 1;
      for (n = n < 0 ? 0 : n >= f.count ? f.count - 1 : n; n > 0 && f.act[n][i] > t; n--) {
      }
      u[i] = f.u[n][i];
    }
    if (t % p->w_every == 0) winds(c, p, x, u, w);
    if (tube) {
      compared(&f, t, x);
      at_rest(&f, t, x);
    }
    margins(x, m);
    for (int i = 0; i < AIMS; i++) {
      o->least = fmin(o->least, m[i]);
      if (!(m[i] >= -TOLERANCE)) {
        o->violated++;
        return;
      }
    }
    moved(x, u, w, 1e-9 * (double)c->tick);
  }
  o->holds += f.count;
}

#endif
