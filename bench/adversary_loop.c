/* One run of a closed loop against an adversary that knows everything.
 *
 * Purpose: plant, sensor, path nodes, DM, SC, gate and actuation as the definitions of the model
 * of time have them (docs/proof.md), a tick at a time; every choice that they leave open is made
 * against the module, by a policy. Shares no code with the run-time kernel or the prover.
 * Non-goals: choosing policies (adversary_search.py), reading programs (adversary_modules.py).
 *
 * Within a tick: publications of path nodes under way (seen now or after the module, both are
 * schedules), the sensor, the DM, SC, path nodes in order, AC, acting, then the plant moves.
 */

#include <math.h>
#include <stdint.h>
#include <string.h>

enum { N = 4, U = 2, TERMS = 2, LAWS = 2, NODES = 4, QUEUE = 64 };
enum { NEVER = -1000000000 };

/* Mirrored by `adversary_loop.Loop`; all times in ticks. */
typedef struct {
  int32_t n, m, linear, is_map, substeps, terms, laws, pred_tables, groups, faces[2];
  int32_t dm_period, dm_phase, sc_period, sc_phase, sensor_period, sensor_phase;
  int32_t j_dm, r_dm, j_sc, r_sc, acts[U], acts_least[U], max_age, dropout;
  int32_t nodes, node_period[NODES], node_phase[NODES], node_j[NODES], node_r[NODES];
  int32_t drivers, driver_period[NODES], driver_phase[NODES], driver_j[NODES], driver_r[NODES];
  int32_t rows, grads;
  int32_t term_kind[TERMS], term_of[TERMS], term_to[TERMS];
  int32_t axes[2], axis[2][3], cells[2][3];
  double h, phi[N * N], gam_u[N * U], gam_w[N * N], a[N * N], b[N * U], term_k[TERMS];
  double u_low[U], u_high[U], u_first[U], wind[N], error[N], low[N], high[N];
  double gain[LAWS * U * N], bias[U], force[U];
  const double *edges[2][3];
  const uint8_t *level[2];
  const double *face[2]; /* each n coefficients, that of x1|x1|, and the limit */
  const double *row;     /* co-states: n coefficients each */
  const double *grad;    /* n x n each */
} loop;

enum { GKIND, GINDEX, FLIP, WIND, ACKIND, ERR_AC, ERR_SC, LJ_DM, LR_DM, LJ_SC, LR_SC, L_ACT };
enum { LJ_NODE = L_ACT + 1, LR_NODE, SEEN, PATTERN, DROP, NEAR, GSWITCH, SIDE, POLICY };

typedef struct {
  double worst;    /* the largest |x - middle| / half that was seen */
  double worst_sc; /* the same while SC acts */
  double x[N];
  int64_t steps, at, switches;
  int32_t left;
} outcome;

typedef struct {
  int64_t t;
  int32_t what;
  double value;
} event;

typedef struct {
  double v[N];
  int64_t stamp, state;
} value;

typedef struct {
  double u[QUEUE];
  int64_t at[QUEUE];
  int32_t first, count;
  int64_t last;
} queue;

typedef struct {
  const loop *m;
  const int32_t *p;
  uint64_t seed;
  double x[N], g[N], u[U], w[N];
  value topic[NODES + 1];
  double output[NODES + 1][U]; /* what stands on the topics between SC and the plant */
  int64_t t;
  int ac;
  double held[U], held_w[N];
  int64_t counts[16];
  event *log;
  int32_t logged, room;
} state;

static uint64_t draw(state *s) {
  uint64_t z = (s->seed += 0x9e3779b97f4a7c15ULL);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
  return z ^ (z >> 31);
}

static double unit(state *s) { return (double)(draw(s) >> 11) * 0x1p-53; }

static void note(state *s, int32_t what, double v) {
  if (s->logged < s->room) {
    s->log[s->logged++] = (event){s->t, what, v};
  }
}

/* ---------------------------------------------------------------- plant */

static void rate(const loop *m, const double *x, const double *u, const double *w, double *out) {
  for (int i = 0; i < m->n; i++) {
    double r = w[i];
    for (int k = 0; k < m->n; k++) {
      r += m->a[i * N + k] * x[k];
    }
    for (int k = 0; k < m->m; k++) {
      r += m->b[i * U + k] * u[k];
    }
    out[i] = r;
  }
  for (int k = 0; k < m->terms; k++) {
    double v = x[m->term_of[k]];
    double f = m->term_kind[k] == 1 ? v * fabs(v) : v * (1.0 - v * v / 6.0);
    out[m->term_to[k]] += m->term_k[k] * f;
  }
}

static void rk4(const loop *m, double *x, const double *u, const double *w) {
  double k[4][N], y[N], h = m->h / m->substeps;
  for (int step = 0; step < m->substeps; step++) {
    rate(m, x, u, w, k[0]);
    for (int stage = 1; stage < 4; stage++) {
      double f = stage == 3 ? h : 0.5 * h;
      for (int i = 0; i < m->n; i++) {
        y[i] = x[i] + f * k[stage - 1][i];
      }
      rate(m, y, u, w, k[stage]);
    }
    for (int i = 0; i < m->n; i++) {
      x[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
    }
  }
}

static void move(const loop *m, double *x, const double *u, const double *w) {
  double y[N];
  if (m->is_map) {
    rate(m, x, u, w, y);
    memcpy(x, y, sizeof y);
    return;
  }
  if (!m->linear) {
    rk4(m, x, u, w);
    return;
  }
  for (int i = 0; i < m->n; i++) {
    double r = 0.0;
    for (int k = 0; k < m->n; k++) {
      r += m->phi[i * N + k] * x[k] + m->gam_w[i * N + k] * w[k];
    }
    for (int k = 0; k < m->m; k++) {
      r += m->gam_u[i * U + k] * u[k];
    }
    y[i] = r;
  }
  memcpy(x, y, sizeof y);
}

/* ---------------------------------------------------------------- module */

static void law(const loop *m, int which, const double *y, double *u) {
  for (int k = 0; k < m->m; k++) {
    double r = m->bias[k];
    for (int i = 0; i < m->n; i++) {
      r -= m->gain[(which * U + k) * N + i] * y[i];
    }
    u[k] = fmin(fmax(r, -m->force[k]), m->force[k]);
  }
}

/* 0: ttf; 1: in S_0; 2: AC may have control back. */
int adversary_level(const loop *m, const double *y) {
  int least = 2;
  for (int i = 0; i < m->n; i++) {
    if (!isfinite(y[i])) {
      return 0;
    }
  }
  if (m->pred_tables) {
    for (int g = 0; g < m->groups; g++) {
      int64_t cell = 0;
      for (int a = 0; a < m->axes[g]; a++) {
        const double *e = m->edges[g][a];
        double v = y[m->axis[g][a]];
        int low = 0, high = m->cells[g][a];
        if (!(v >= e[0] && v <= e[high])) {
          return 0;
        }
        while (high - low > 1) {
          int mid = (low + high) / 2;
          if (v >= e[mid]) {
            low = mid;
          } else {
            high = mid;
          }
        }
        cell = cell * m->cells[g][a] + low;
      }
      least = m->level[g][cell] < least ? m->level[g][cell] : least;
    }
    return least;
  }
  for (int which = 0; which < 2; which++) {
    for (int f = 0; f < m->faces[which]; f++) {
      const double *r = m->face[which] + (size_t)f * (size_t)(m->n + 2);
      double v = 0.0;
      for (int i = 0; i < m->n; i++) {
        v += r[i] * y[i];
      }
      if (m->n > 1) {
        v += r[m->n] * y[1] * fabs(y[1]);
      }
      if (!(v < r[m->n + 1])) {
        return which == 0 ? 0 : 1;
      }
    }
  }
  return 2;
}

/* ---------------------------------------------------------------- adversary */

/* The direction in which the state is to be pushed. */
static void direction(state *s) {
  const loop *m = s->m;
  int kind = s->p[GKIND];
  double sign = 1.0;
  if (s->p[GSWITCH] > 0 && (s->t / s->p[GSWITCH]) % 2 == 1) {
    kind = (kind + 1) % 3;
  }
  if (s->p[FLIP] > 0 && (s->t / s->p[FLIP]) % 2 == 1) {
    sign = -1.0;
  }
  if (kind == 0 && m->grads > 0) {
    const double *g = m->grad + (size_t)(s->p[GINDEX] % m->grads) * N * N;
    for (int i = 0; i < m->n; i++) {
      s->g[i] = 0.0;
      for (int k = 0; k < m->n; k++) {
        s->g[i] += sign * g[i * N + k] * s->x[k];
      }
    }
    return;
  }
  int best = s->p[GINDEX] % m->rows;
  double most = 0.0;
  for (int r = kind == 1 ? 0 : best; r < (kind == 1 ? m->rows : best + 1); r++) {
    double v = 0.0;
    for (int i = 0; i < m->n; i++) {
      v += m->row[r * N + i] * s->x[i];
    }
    if (fabs(v) > fabs(most)) {
      most = v;
      best = r;
    }
  }
  if (kind == 3) {
    sign = s->p[SIDE] > 0 ? sign : -sign;
  } else if (most < 0.0) {
    sign = -sign;
  }
  for (int i = 0; i < m->n; i++) {
    s->g[i] = sign * m->row[best * N + i];
  }
}

static double effect(const state *s, int k) {
  double r = 0.0;
  for (int i = 0; i < s->m->n; i++) {
    r += s->g[i] * s->m->b[i * U + k];
  }
  return r;
}

/* Whether what acts now harms more than what SC would publish now. */
static int harms(const state *s) {
  double now[U], sum = 0.0;
  law(s->m, 0, s->x, now);
  for (int k = 0; k < s->m->m; k++) {
    sum += effect(s, k) * (s->u[k] - now[k]);
  }
  return sum > 0.0;
}

static int64_t choose(state *s, int what, int64_t most) {
  int64_t n = s->counts[what & 15]++;
  int64_t pattern = s->p[PATTERN] > 1 ? s->p[PATTERN] : 2;
  if (most <= 0) {
    return 0;
  }
  switch (s->p[what]) {
  case 0:
    return 0;
  case 1:
    return most;
  case 2:
    return (int64_t)(draw(s) % (uint64_t)(most + 1));
  case 3:
    return n % 2 == 0 ? most : 0;
  case 4:
    return draw(s) & 1U ? most : 0;
  case 5:
    return harms(s) ? most : 0;
  case 6:
    return n % pattern < pattern / 2 ? most : 0;
  default:
    return harms(s) ? 0 : most;
  }
}

static void errors(state *s, double *y) {
  const loop *m = s->m;
  int kind = s->p[s->ac ? ERR_AC : ERR_SC];
  int which = (int)(draw(s) & 1U) % m->laws;
  for (int i = 0; i < m->n; i++) {
    double e = m->error[i], f = 0.0;
    if (e == 0.0) {
      y[i] = s->x[i];
      continue;
    }
    switch (kind) {
    case 0:
      e = 0.0;
      break;
    case 1: /* nearer to the middle than it is */
      e = s->x[i] > 0.5 * (m->low[i] + m->high[i]) ? -e : e;
      break;
    case 2:
      e *= 2.0 * unit(s) - 1.0;
      break;
    case 3: /* what SC answers to it harms most */
      for (int k = 0; k < m->m; k++) {
        f -= effect(s, k) * m->gain[(which * U + k) * N + i];
      }
      e = f > 0.0 ? e : -e;
      break;
    case 4:
      e = draw(s) & 1U ? e : -e;
      break;
    case 5:
      e = s->p[SIDE] > 0 ? e : -e;
      break;
    default:
      e = s->g[i] > 0.0 ? -e : e;
    }
    y[i] = s->x[i] + e;
  }
}

static double nearness(const loop *m, const double *x) {
  double worst = 0.0;
  for (int i = 0; i < m->n; i++) {
    double half = 0.5 * (m->high[i] - m->low[i]);
    double v = fabs(x[i] - 0.5 * (m->low[i] + m->high[i])) / half;
    worst = v > worst ? v : worst;
  }
  return worst;
}

static void winds(state *s) {
  for (int i = 0; i < s->m->n; i++) {
    double w = s->m->wind[i];
    if (w == 0.0) {
      s->w[i] = 0.0;
      continue;
    }
    switch (s->p[WIND]) {
    case 0:
      s->w[i] = s->g[i] > 0.0 ? w : -w;
      break;
    case 1:
      s->w[i] = 0.0;
      break;
    case 2:
      if (draw(s) % 64 == 0) {
        s->held_w[i] = draw(s) & 1U ? w : -w;
      }
      s->w[i] = s->held_w[i];
      break;
    default:
      s->w[i] = s->p[SIDE] > 0 ? w : -w;
    }
  }
}

/* AC's command; it may be anything in the declared set, at every tick. */
static double advanced(state *s, int k) {
  const loop *m = s->m;
  int up = effect(s, k) > 0.0;
  double near = 0.0625 * s->p[NEAR];
  switch (s->p[ACKIND]) {
  case 0:
    break;
  case 1: /* keeps away from the border until something is late */
    up = nearness(m, s->x) > near ? !up : up;
    break;
  case 2:
    if (draw(s) % 32 == 0) {
      s->held[k] = m->u_low[k] + unit(s) * (m->u_high[k] - m->u_low[k]);
    }
    return fmin(fmax(s->held[k], m->u_low[k]), m->u_high[k]);
  case 3:
    up = s->p[SIDE] > 0;
    break;
  default: /* only pushes near the border */
    if (nearness(m, s->x) < near) {
      return 0.5 * (m->u_low[k] + m->u_high[k]);
    }
  }
  return up ? m->u_high[k] : m->u_low[k];
}

/* ---------------------------------------------------------------- one run */

typedef struct {
  int busy, phase; /* 0: waits to start, 1: runs */
  int64_t release, start, done;
} task;

static int due(int64_t t, int32_t period, int32_t phase) {
  return t >= phase && (t - phase) % period == 0;
}

/* A command acts, within its latency and in order. */
static void act(state *s, queue *q, int k, double u) {
  const loop *m = s->m;
  int64_t at = s->t + m->acts_least[k] + choose(s, L_ACT, m->acts[k] - m->acts_least[k]);
  at = at > q->last ? at : q->last;
  int slot = (q->first + q->count) % QUEUE;
  q->u[slot] = u;
  q->at[slot] = q->last = at;
  q->count += q->count < QUEUE;
}

/* A node behind the module publishes; the last one moves the plant. */
static void deliver(state *s, queue *q, task *driver, int i, const double *u) {
  memcpy(s->output[i + 1], u, sizeof s->output[i + 1]);
  driver[i].busy = 0;
  for (int k = 0; k < s->m->m && i + 1 == s->m->drivers; k++) {
    act(s, &q[k], k, u[k]);
  }
}

/*
 * `ticks` from `t0`, at `x0`; `ac`: AC has control, and `y0` is what the sensor publishes at `t0`.
 * `log`: room for events, or null.
 */
void adversary_run(const loop *m, const int32_t *policy, uint64_t seed, int64_t t0, int64_t ticks,
    const double *x0, int ac, const double *y0, outcome *out, event *log, int32_t *logged) {
  state s = {.m = m, .p = policy, .seed = seed, .t = t0, .ac = ac};
  task dm = {0}, sc = {0}, node[NODES] = {{0}}, driver[NODES] = {{0}};
  double carried[NODES][U];
  queue q[U] = {{{0}}};
  value sent[NODES] = {{{0}}};
  double command[U] = {0};
  int verdict = 0, which = 0;
  int64_t ac_since = ac ? t0 : NEVER, ac_until[U] = {NEVER, NEVER};
  s.log = log;
  s.room = log == 0 ? 0 : *logged;
  memset(out, 0, sizeof *out);
  memcpy(s.x, x0, (size_t)m->n * sizeof(double));
  for (int k = 0; k < m->m; k++) {
    s.u[k] = ac ? m->u_high[k] : m->u_first[k];
    q[k].last = t0;
    for (int i = 0; i <= m->drivers; i++) {
      s.output[i][k] = m->u_first[k];
    }
  }
  for (int i = 0; i <= m->nodes; i++) {
    s.topic[i].stamp = s.topic[i].state = NEVER;
  }
  int64_t end = t0 + ticks;
  for (; s.t < end; s.t++) {
    int64_t t = s.t;
    int later[NODES] = {0};
    direction(&s);
    /* what path nodes publish that started before */
    for (int i = 0; i < m->nodes; i++) {
      if (node[i].busy && node[i].phase == 1 && node[i].done == t) {
        int seen = s.p[SEEN] == 2 ? (int)(draw(&s) & 1U) : s.p[SEEN] == 1;
        later[i] = !seen;
        if (seen) {
          s.topic[i + 1] = sent[i];
          s.topic[i + 1].stamp = t;
          node[i].busy = 0;
        }
      }
    }
    if (due(t, m->sensor_period, m->sensor_phase)) {
      /* silent for `dropout` longer than its period, from the first release on */
      int64_t since = s.topic[0].stamp == NEVER ? m->sensor_phase : s.topic[0].stamp + m->sensor_period;
      int drop = t + m->sensor_period <= since + m->dropout && !(ac && t == t0)
          && choose(&s, DROP, 1) > 0;
      if (!drop) {
        if (ac && t == t0) {
          memcpy(s.topic[0].v, y0, (size_t)m->n * sizeof(double));
        } else {
          errors(&s, s.topic[0].v);
        }
        s.topic[0].stamp = s.topic[0].state = t;
      } else {
        note(&s, 1, 0.0);
      }
    }
    const value *read = &s.topic[m->nodes];
    /* DM */
    int before = s.ac;
    if (dm.busy && dm.phase == 1 && dm.done == t) {
      s.ac = verdict;
      dm.busy = 0;
    }
    if (due(t, m->dm_period, m->dm_phase)) {
      dm = (task){1, 0, t, t + choose(&s, LJ_DM, m->j_dm), 0};
    }
    if (dm.busy && dm.phase == 0 && dm.start == t) {
      int level = read->stamp == NEVER || t - read->stamp > m->max_age
          ? 0
          : adversary_level(m, read->v);
      verdict = s.ac ? level >= 1 : level >= 2;
      dm.phase = 1;
      dm.done = t + choose(&s, LR_DM, m->r_dm);
      note(&s, 2, (double)verdict);
      if (dm.done == t) {
        s.ac = verdict;
        dm.busy = 0;
      }
    }
    if (s.ac != before) {
      out->switches++;
      if (s.ac) {
        ac_since = t;
      } else {
        for (int k = 0; k < m->m; k++) {
          ac_until[k] = t;
        }
      }
      note(&s, 3, (double)s.ac);
    }
    /* SC */
    if (due(t, m->sc_period, m->sc_phase)) {
      sc = (task){1, 0, t, t + choose(&s, LJ_SC, m->j_sc), 0};
    }
    if (sc.busy && sc.phase == 0 && t >= sc.start && !(dm.busy && dm.release <= sc.release)) {
      law(m, which, read->v, command); /* zeros, the default, before anything was published */
      which = (which + 1) % m->laws;
      sc.phase = 1;
      sc.done = t + choose(&s, LR_SC, m->r_sc);
      note(&s, 4, read->state == NEVER ? -1.0 : (double)(t - read->state));
    }
    if (sc.busy && sc.phase == 1 && sc.done == t) {
      sc.busy = 0;
      for (int k = 0; k < m->m && !s.ac; k++) {
        s.output[0][k] = command[k];
        if (m->drivers == 0) {
          act(&s, &q[k], k, command[k]);
        }
      }
    }
    /* path nodes */
    for (int i = 0; i < m->nodes; i++) {
      if (later[i]) {
        s.topic[i + 1] = sent[i];
        s.topic[i + 1].stamp = t;
        node[i].busy = 0;
      }
      if (due(t, m->node_period[i], m->node_phase[i])) {
        node[i] = (task){1, 0, t, t + choose(&s, LJ_NODE, m->node_j[i]), 0};
      }
      if (node[i].busy && node[i].phase == 0 && node[i].start == t) {
        sent[i] = s.topic[i];
        node[i].phase = 1;
        node[i].done = t + choose(&s, LR_NODE, m->node_r[i]);
        if (node[i].done == t) {
          s.topic[i + 1] = sent[i];
          s.topic[i + 1].stamp = t;
          node[i].busy = 0;
        }
      }
    }
    /* nodes behind the module; what AC publishes stands on its topic until SC's replaces it */
    for (int k = 0; k < m->m && s.ac && m->drivers > 0; k++) {
      s.output[0][k] = advanced(&s, k);
    }
    for (int i = 0; i < m->drivers; i++) {
      /* what it publishes now may be read by the next one now, or only later */
      int last = s.p[SEEN] == 1 ? i : m->drivers - 1 - i;
      if (driver[last].busy && driver[last].phase == 1 && driver[last].done == t) {
        deliver(&s, q, driver, last, carried[last]);
      }
      if (due(t, m->driver_period[last], m->driver_phase[last])) {
        driver[last] = (task){1, 0, t, t + choose(&s, LJ_NODE, m->driver_j[last]), 0};
      }
      if (driver[last].busy && driver[last].phase == 0 && driver[last].start == t) {
        memcpy(carried[last], s.output[last], sizeof carried[last]);
        driver[last].phase = 1;
        driver[last].done = t + choose(&s, LR_NODE, m->driver_r[last]);
        if (driver[last].done == t) {
          deliver(&s, q, driver, last, carried[last]);
        }
      }
    }
    /* what acts */
    for (int k = 0; k < m->m; k++) {
      int64_t l = m->acts[k];
      int tail = !s.ac && m->drivers == 0 && ac_until[k] != NEVER && t < ac_until[k] + l && t - l >= ac_since;
      while (q[k].count > 0 && q[k].at[q[k].first] <= t) {
        s.u[k] = q[k].u[q[k].first];
        q[k].first = (q[k].first + 1) % QUEUE;
        q[k].count--;
        tail = 0;
        if (!s.ac) {
          ac_until[k] = NEVER; /* order: nothing of AC acts after SC */
        }
        note(&s, 5 + k, s.u[k]);
      }
      if ((s.ac && m->drivers == 0 && t >= q[k].last) || tail) {
        s.u[k] = advanced(&s, k);
      }
    }
    winds(&s);
    move(m, s.x, s.u, s.w);
    out->steps++;
    double near = nearness(m, s.x);
    out->worst = near > out->worst ? near : out->worst;
    if (!s.ac && near > out->worst_sc) {
      out->worst_sc = near;
    }
    if (!(near <= 1.0 + 1e-6)) {
      out->left = 1;
      out->at = t + 1;
      break;
    }
  }
  memcpy(out->x, s.x, sizeof s.x);
  if (log != 0) {
    *logged = s.logged;
  }
}
