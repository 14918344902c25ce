/* The adversary's choices: errors, winds, lateness and AC's commands, against the module.
 *
 * Purpose: everything that the definitions leave open, by the policy of a run.
 * Non-goals: when something is chosen (adversary_loop.c).
 */

#ifndef ADVERSARY_CHOICES_H
#define ADVERSARY_CHOICES_H

#include "adversary_model.h"

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

#endif
