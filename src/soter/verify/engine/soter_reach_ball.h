/* What a hold calculates with: sums of products, lines, enclosures that move on.
 * Purpose: bound what rounding takes from them; the argument is (1) to (4) here.
 * Non-goals: which sums a hold needs (soter_reach_hold.c).
 *
 * u = 2^-53, EPS = 2 u; rounding is to nearest and nothing is contracted. A computed x = fl(a op b)
 * is off by at most u |x|, and by 2^-1075 more where * or / underflow (+ and - do not); fl is
 * monotonic. ulp(x), the distance to the next double away from 0, is above u |x| and at most
 * EPS |x|. Products with EPS and powers of two are exact.
 *
 * (1) soter_down(x) <= x - ulp(x), for it is fl(x - d) with d >= ulp(x), and x - ulp(x) is a
 * double. So, with x = fl(a op b), it is at most (a op b) - ulp(x) / 2. TINY covers underflow. The
 * same upwards. (2) A sum of products of numbers >= 0, no part of which goes through more than k
 * roundings, is at least (1 - u)^k of the true one. Times 1 + K EPS it is not below that, if 2 K >
 * k, where k also counts this product and all sums thereafter: (1 - k u) (1 + 2 K u) >= 1 while k K
 * < 2^50. (3) A sum of terms of any sign, t_0 given and N others that are computed products, is off
 * by at most u |t_i| for each product and u |partial sum| for each of N additions, together (N + 1)
 * u (1 + u)^N S with S = sum |t_i|. The computed S is at least (1 - u)^N of the true one. So K EPS
 * times the computed S is enough, if 2 K > N + 1. (4) R = fl(D - s) <= a - s / 2, with D =
 * soter_down(x), x = fl(a), s >= 0. Let 2^(e+1) be the smallest power of two above |x|: D <= a -
 * ulp(x) / 2 and |D| <= 2^(e+1). As long as |R| is no larger, R is off by at most ulp(x) / 2. Below
 * 2^(e+2) by at most ulp(x), and s is no less, or D - s would round to D: at most ulp(x) / 2 + s
 * / 2. Beyond, |R| <= 2 (s + u |R|), so that u |R| is far below s / 2. (Where TINY is most of d, it
 * is all the more.) The same upwards.
 *
 * ENOUGH states what (2) and (3) ask for where it is used, in terms of the numbers of axes and
 * commands: the compiler refuses more of them than the bounds are made for. */
#ifndef SOTER_REACH_BALL_H
#define SOTER_REACH_BALL_H

#include "soter_reach_internal.h"

/* Written for any number of axes and commands, and compiled for the usual ones. */
#if defined(__GNUC__)
#define ALWAYS static inline __attribute__((always_inline))
#else
#define ALWAYS static inline
#endif

#define ENOUGH(name, roundings, K) typedef char enough_##name[(roundings) < 2 * (K) ? 1 : -1]

static inline double size_of(double lo, double hi) {
  return soter_most(fabs(lo), fabs(hi));
}

/* c + [-r, r], both still to be widened: c by (3) with `size`, the sum of its |terms|; r by (2). */
typedef struct {
  double c, r, size;
} ball;

ALWAYS void ball_add(ball* b, double k, double x) {
  const double p = k * x;
  b->c += p;
  b->size += fabs(p);
}

/* A form that depends on the own states (around the centres in s->in) as gain, centre, radius. */
typedef struct {
  double gain[AXES], c, r, lo, hi;
} line;

/* Of the first-order part of `f` only what the own states do is kept: the rest becomes r.
 *
 * Exactly, r is f->r + (all |g| but the own ones) + |g - gain rad| <= u |g| of each own one. The
 * computed sum of all goes through SOTER_INPUTS roundings, that of the own ones is at most
 * (1 + u)^AXES of the true one, the difference rounds once: what is missing is below
 * (SOTER_INPUTS + AXES + 4) u of all. The last sum rounds as soter_up makes good. */
ENOUGH(slopes, SOTER_INPUTS + AXES + 4, SOTER_INPUTS + 8);

ALWAYS int line_of(int n, const soter_reach_group* g, const soter_scratch* s, const soter_form* f,
                   line* out) {
  double r = f->r, own = 0, middle, half;
  out->lo = f->lo;
  out->hi = f->hi;
  if (!(f->lo <= f->hi && size_of(f->lo, f->hi) < 1e200)) {
    return 0;
  }
  for (int k = 0; k < SOTER_INPUTS; k++) {
    r += fabs(f->g[k]);
  }
  for (int j = 0; j < n; j++) {
    const int k = g->axis[j];
    out->gain[j] = soter_slope(f->g[k], s->in[k].g[k]);
    own += out->gain[j] != 0 ? fabs(f->g[k]) : 0;
  }
  out->r = soter_up((r - own) + (SOTER_INPUTS + 8) * EPS * r);
  out->c = f->c;
  soter_centre(f->lo, f->hi, &middle, &half);
  if (!(out->r < half)) { /* the interval says more */
    memset(out->gain, 0, sizeof out->gain);
    out->c = middle;
    out->r = half;
  }
  SOTER_CHECK(out->r >= 0);
  return 1;
}

/* Ranges of x' over a box of states and commands, from the linear model. The sums have
 * 1 + n + commands terms; 16 EPS size is taken away by (4), which leaves 8. */
ENOUGH(rates, 1 + AXES + COMMANDS, 8);

ALWAYS void rates(int n, int commands, const soter_reach_model* m, const double* lo,
                  const double* hi, const double* ulo, const double* uhi, double* flo,
                  double* fhi) {
  for (int i = 0; i < n; i++) {
    double low = m->c[i], high = m->c[i], size = fabs(m->c[i]);
    for (int j = 0; j < n; j++) {
      const double p = m->a[i][j] * lo[j], q = m->a[i][j] * hi[j];
      low += soter_least(p, q);
      high += soter_most(p, q);
      size += soter_most(fabs(p), fabs(q));
    }
    for (int a = 0; a < commands; a++) {
      const double p = m->b[i][a] * ulo[a], q = m->b[i][a] * uhi[a];
      low += soter_least(p, q);
      high += soter_most(p, q);
      size += soter_most(fabs(p), fabs(q));
    }
    size = 16 * EPS * size + TINY;
    flo[i] = soter_down(low - m->w[i]) - size;
    fhi[i] = soter_up(high + m->w[i]) + size;
  }
}

/* Ranges of x' over [lo, hi] grown by everything that may happen where |integral e^A| <= dev; 0:
 * they are no finite numbers. d: a product and n sums, (2). */
ENOUGH(deviation, 1 + AXES + 2, 8);

ALWAYS int rates_around(int n, int commands, const soter_reach_model* m, const double* dev,
                        const double* lo, const double* hi, const double* ulo, const double* uhi,
                        double* flo, double* fhi) {
  double wide_lo[AXES], wide_hi[AXES];
  rates(n, commands, m, lo, hi, ulo, uhi, flo, fhi);
  for (int i = 0; i < n; i++) {
    double d = 0;
    for (int j = 0; j < n; j++) {
      d += dev[AXES * i + j] * size_of(flo[j], fhi[j]);
    }
    d = d * (1 + 8 * EPS) + TINY;
    wide_lo[i] = soter_down(lo[i] - d);
    wide_hi[i] = soter_up(hi[i] + d);
  }
  rates(n, commands, m, wide_lo, wide_hi, ulo, uhi, flo, fhi);
  for (int i = 0; i < n; i++) {
    if (!(flo[i] > -1e300 && fhi[i] < 1e300)) {
      return 0;
    }
    SOTER_CHECK(flo[i] <= fhi[i]);
  }
  return 1;
}

/* The interval hull of m + g eps + box, intersected with what stands in lo, hi. rad: n sums, (2);
 * m - rad and m + rad by (1). */
ENOUGH(hull, AXES + 2, 8);

ALWAYS int hull(int n, soter_reach_chain* x) {
  for (int i = 0; i < n; i++) {
    double rad = x->box[i];
    SOTER_CHECK(!(x->box[i] < 0));
    for (int j = 0; j < n; j++) {
      rad += fabs(x->g[i][j]);
    }
    rad = rad * (1 + 8 * EPS) + EPS * fabs(x->m[i]);
    x->lo[i] = soter_most(x->lo[i], soter_down(x->m[i] - rad));
    x->hi[i] = soter_least(x->hi[i], soter_up(x->m[i] + rad));
    if (!(x->lo[i] <= x->hi[i] && size_of(x->lo[i], x->hi[i]) < 1e200)) {
      return 0;
    }
  }
  return 1;
}

/* x -> M (x - from) + to + [-noise, noise]. `size` bounds the |terms| that an entry of M was summed
 * up from: 1 and COMMANDS products, so that the entry is off by at most (COMMANDS + 1) u size.
 * noise went through NOISE roundings, to through as many as (3) was already taken for. */
typedef struct {
  double M[AXES][AXES], size[AXES][AXES], from[AXES], to[AXES], noise[AXES];
} motion;

enum { NOISE = 1 + AXES + COMMANDS + 1 + COMMANDS };

/* m, g, box of x after the motion.
 *
 * New m: `to` and n terms M (m - from), by (3) with one more rounding for m - from and COMMANDS + 1
 * for M; g: n terms. Each term is at most size (|m| + |from| + row) in size, as is M's error times
 * |x - from|, for row bounds |x - m|. box: noise and n products, a sum, by (2) with three sums
 * thereafter; one rounding more is left over for `add_handover`. */
ENOUGH(centre, 1 + AXES + 1 + (COMMANDS + 1), 32);
ENOUGH(noise, NOISE + 1 + 1 + 2 + 1, 16);
ENOUGH(box, 1 + AXES + 1 + 1 + 2, 16);

ALWAYS int advance(int n, soter_reach_chain* x, const motion* t) {
  double m[AXES], gen[AXES][AXES], box[AXES];
  for (int i = 0; i < n; i++) {
    double s = t->to[i], slack = fabs(t->to[i]), b = 0;
    SOTER_CHECK(!(t->noise[i] < 0));
    for (int j = 0; j < n; j++) {
      double row = x->box[j];
      s += t->M[i][j] * (x->m[j] - t->from[j]);
      b += fabs(t->M[i][j]) * x->box[j];
      for (int k = 0; k < n; k++) {
        row += fabs(x->g[j][k]);
      }
      slack += t->size[i][j] * (fabs(x->m[j]) + fabs(t->from[j]) + row);
    }
    for (int k = 0; k < n; k++) {
      double e = 0;
      for (int j = 0; j < n; j++) {
        e += t->M[i][j] * x->g[j][k];
      }
      gen[i][k] = e;
    }
    m[i] = s;
    box[i] = (b + t->noise[i]) * (1 + 16 * EPS) + 32 * EPS * slack + TINY;
  }
  for (int i = 0; i < n; i++) {
    x->m[i] = m[i];
    x->box[i] = box[i];
    for (int k = 0; k < n; k++) {
      x->g[i][k] = gen[i][k];
    }
  }
  return hull(n, x);
}

/* A command that is held in place of the law. */
static inline void held_line(const soter_reach_group* g, int a, line* u) {
  memset(u, 0, sizeof *u);
  u->lo = g->held_low[g->command[a]];
  u->hi = g->held_high[g->command[a]];
  soter_centre(u->lo, u->hi, &u->c, &u->r);
}

/* The law (or the held command) over the state as it may be read: x + [dlo, dhi]. */
ALWAYS int read_law(int n, int m, const soter_reach_group* g, soter_scratch* s,
                    const soter_reach_chain* x, const double* dlo, const double* dhi, line* u) {
  if (g->held_low != 0) {
    for (int a = 0; a < m; a++) {
      held_line(g, a, &u[a]);
    }
    return 1;
  }
  for (int i = 0; i < n; i++) {
    soter_range(&s->in[g->axis[i]], g->axis[i],
                dlo[i] == 0 ? x->lo[i] : soter_down(x->lo[i] + dlo[i]),
                dhi[i] == 0 ? x->hi[i] : soter_up(x->hi[i] + dhi[i]));
  }
  if (g->law(s->in, g->param, s->out)) {
    return 0;
  }
  for (int a = 0; a < m; a++) {
    if (!line_of(n, g, s, &s->out[g->command[a]], &u[a])) {
      return 0;
    }
  }
  return 1;
}

int soter_reach_picard(const soter_reach_group* g, soter_scratch* s, const double* lo,
                       const double* hi, const double* ulo, const double* uhi, double from,
                       double to, double* flo, double* fhi);
int soter_reach_hold_map(const soter_reach_group* g, soter_scratch* s, soter_reach_chain* x,
                         soter_hold* out);

#endif
