/* The adversary's closed loop: what it is made of, how the plant moves, what the module answers.
 *
 * Purpose: the structures, plant, SC's law and the DM's predicates of adversary_loop.c.
 * Non-goals: time and choices.
 */

#ifndef ADVERSARY_MODEL_H
#define ADVERSARY_MODEL_H

#include <math.h>
#include <stdint.h>
#include <string.h>

enum { N = 4, U = 2, TERMS = 2, LAWS = 2, NODES = 4, QUEUE = 64, CELLS = 16, PAST = 512 };
enum { NEVER = -1000000000 };

/* Mirrored by `adversary_loop.Loop`; all times in ticks. */
typedef struct {
  int32_t n, m, linear, is_map, substeps, terms, laws, pred_tables, groups, faces[2];
  int32_t dm_period, dm_phase, sc_period, sc_phase, sensor_period, sensor_phase;
  int32_t j_dm, r_dm, j_sc, r_sc, acts[U], acts_least[U], max_age, dropout;
  int32_t nodes, node_period[NODES], node_phase[NODES], node_j[NODES], node_r[NODES];
  int32_t drivers, in_step, driver_period[NODES], driver_phase[NODES], driver_j[NODES], driver_r[NODES];
  int32_t rows, grads;
  int32_t term_kind[TERMS], term_of[TERMS], term_to[TERMS];
  int32_t axes[2], axis[2][3], cells[2][3];
  int32_t shield, slip, acted, moving[2], moved[2][U]; /* 0 cells: no shield; acted: W */
  int32_t toward; /* whether commands are moved toward SC's before they are judged */
  double h, phi[N * N], gam_u[N * U], gam_w[N * N], a[N * N], b[N * U], term_k[TERMS];
  double u_low[U], u_high[U], u_first[U], wind[N], error[N], low[N], high[N];
  double gain[LAWS * U * N], bias[U], force[U];
  const double *edges[2][3];
  const uint8_t *level[2];
  const uint8_t *tops[2];
  const uint8_t *lasting[2]; /* of each cell of commands, whether it may act for longer */
  const double *face[2]; /* each n coefficients, that of x1|x1|, and the limit */
  const double *row;     /* co-states: n coefficients each */
  const double *grad;    /* n x n each */
} loop;

enum { GKIND, GINDEX, FLIP, WIND, ACKIND, ERR_AC, ERR_SC, LJ_DM, LR_DM, LJ_SC, LR_SC, L_ACT };
enum { LJ_NODE = L_ACT + 1, LR_NODE, SEEN, PATTERN, DROP, NEAR, GSWITCH, SIDE, TRIES, OLDEST, POLICY };

/* What a wrong shield does; 0 in one that is right. */
enum { SILENCE = 1, AFTERWARDS, ALONE, HELD_ONLY, BEGAN, FIRST_ONLY, BEHIND, LOOKED };
enum { UNJUDGED = LOOKED + 1, SC_JUDGED, PROPOSED };

typedef struct {
  double worst;    /* the largest |x - middle| / half that was seen */
  double worst_sc; /* the same while SC acts */
  double x[N];
  int64_t steps, at, switches;
  int32_t left, forgot; /* forgot: something acted that was in no V */
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
  double published[U];     /* what stands on the module's topics */
  double past[U][PAST];    /* what acted, by tick */
  int64_t until[U][CELLS]; /* of each cell, until when a command of it stood there */
  int gate_fault, judges, yields;
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

/* The cell of a group's grid that holds an estimate; -1 outside. */
static int64_t cell_of(const loop *m, int g, const double *y) {
  int64_t cell = 0;
  for (int a = 0; a < m->axes[g]; a++) {
    const double *e = m->edges[g][a];
    double v = y[m->axis[g][a]];
    int low = 0, high = m->cells[g][a];
    if (!(v >= e[0] && v <= e[high])) {
      return -1;
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
  return cell;
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
      int64_t cell = cell_of(m, g, y);
      if (cell < 0) {
        return 0;
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

#endif
