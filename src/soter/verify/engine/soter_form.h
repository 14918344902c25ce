/* soter_form.h: first-order forms, what the proofs calculate with (docs/verification.md, 2).
 *
 * Purpose: enclose what the operations of a program give. A form encloses a number x that depends
 * on the inputs of a problem:
 *
 *     x in [lo, hi]   and   x = c + sum_i g[i] eps_i + rho  with eps_i in [-1, 1], |rho| <= r
 *
 * It encloses the result of the operation on real numbers and the one rounded to binary64, for all
 * reals or doubles that the operands enclose at the same eps. r = inf: there is no first-order
 * part. lo = -inf with hi = inf: x may be anything, NaN included; no other form encloses NaN. Where
 * x may be infinite, lo or hi is.
 *
 * Rounding. u = 2^-53. The rounding mode is "to nearest", operations are not contracted. A computed
 * x = fl(a op b) is off by at most u |x| (and 2^-1075 more where * and / underflow), and fl is
 * monotonic, so the ends of an interval are the computed ends, moved outward by 2^-51 |x|: twice
 * enough, for the subtraction that moves them rounds as well. SOTER_TINY covers underflow and is
 * large enough that nothing here calculates with subnormal numbers in ordinary cases. A sum of n
 * nonnegative numbers is computed at least (1 - u)^n of the true one; SOTER_GROW makes up for that
 * with n = SOTER_INPUTS + 32: (1 - u)^(n+1) (1 + 4 n u) >= 1 for n u < 1/8.
 *
 * `out` never is an operand. No heap, no globals.
 *
 * Few of many inputs matter at a time: soter_symbols finds those, soter_n_take numbers them 0 to
 * n - 1, every operation soter_n_NAME then works on n symbols, and soter_n_give undoes the
 * numbering.
 *
 * Non-goals: sets of states (soter_reach.h), functions of the prelude (soter_form_math.h).
 */
#ifndef SOTER_FORM_H
#define SOTER_FORM_H

#include <float.h>

#include "soter.h"
#include "soter_check.h"

#ifndef SOTER_INPUTS
#error "define SOTER_INPUTS, the number of inputs, before including soter_form.h"
#endif

/* An operation on whole forms: one copy for all its calls. Inlined, the hundreds of calls of a unit
 * took four times as long to compile, and none ran faster. */
#ifdef __GNUC__
#define SOTER_OPERATION static __attribute__((noinline, unused))
#else
#define SOTER_OPERATION SOTER_INLINE
#endif

typedef struct {
  double lo, hi, c, r;
  double g[SOTER_INPUTS];
} soter_form;

/* An int between lo and hi. */
typedef struct {
  int64_t lo, hi;
} soter_ints;

typedef unsigned char soter_truth; /* bit 0: may be false, bit 1: may be true */

#define SOTER_TINY 0x1p-900
#define SOTER_GROW (1.0 + (double)(SOTER_INPUTS + 32) * 0x1p-51)
#define SOTER_INF ((double)INFINITY)

/* ------------------------------------------------------------------ rounding */

/* Not above the exact value of the sum that was rounded to x (a sum does not underflow). */
SOTER_INLINE double soter_below(double x) {
  if (fabs(x) <= DBL_MAX) {
    return x - fabs(x) * 0x1p-51;
  }
  return x > 0.0 ? DBL_MAX : -SOTER_INF; /* overflowed from below; NaN: nothing is known */
}

SOTER_INLINE double soter_above(double x) {
  return -soter_below(-x);
}

/* The same for a product, quotient or root, which may underflow. */
SOTER_INLINE double soter_below_product(double x) {
  if (fabs(x) <= DBL_MAX) {
    return x - (fabs(x) * 0x1p-51 + SOTER_TINY);
  }
  return x > 0.0 ? DBL_MAX : -SOTER_INF;
}

SOTER_INLINE double soter_above_product(double x) {
  return -soter_below_product(-x);
}

/* Whether [lo, hi] holds a number: no form is empty, so that none encloses by enclosing nothing. */
SOTER_INLINE bool soter_holds(double lo, double hi) {
  return lo <= hi;
}

SOTER_INLINE double soter_least(double a, double b) {
  return b < a ? b : a;
}
SOTER_INLINE double soter_most(double a, double b) {
  return b > a ? b : a;
}

/* An upper bound of |x| over a form. */
SOTER_INLINE double soter_size(const soter_form* a) {
  return soter_most(fabs(a->lo), fabs(a->hi));
}

/* sum |g[i]|, rounded to nearest. */
SOTER_INLINE double soter_slopes(int n, const double g[]) {
  double a = 0.0, b = 0.0, c = 0.0, d = 0.0;
  int i = 0;
  for (; i + 3 < n; i += 4) {
    a += fabs(g[i]);
    b += fabs(g[i + 1]);
    c += fabs(g[i + 2]);
    d += fabs(g[i + 3]);
  }
  for (; i < n; i++) {
    a += fabs(g[i]);
  }
  return (a + b) + (c + d);
}

/* ------------------------------------------------------------------ making forms */

SOTER_INLINE void soter_n_copy(int n, soter_form* out, const soter_form* a) {
  out->lo = a->lo;
  out->hi = a->hi;
  out->c = a->c;
  out->r = a->r;
  for (int i = 0; i < n; i++) {
    out->g[i] = a->g[i];
  }
}

/* No first-order part. */
SOTER_INLINE void soter_n_plain(int n, soter_form* out) {
  out->c = 0.0;
  out->r = SOTER_INF;
  for (int i = 0; i < n; i++) {
    out->g[i] = 0.0;
  }
}

/* Anything, NaN included. */
SOTER_INLINE void soter_n_top(int n, soter_form* out) {
  out->lo = -SOTER_INF;
  out->hi = SOTER_INF;
  soter_n_plain(n, out);
}

/* Some number in [lo, hi], independent of the inputs; lo = hi: exactly that one. */
SOTER_OPERATION void soter_n_range(int n, soter_form* out, double lo, double hi) {
  SOTER_CHECK(soter_holds(lo, hi));
  out->lo = lo;
  out->hi = hi;
  soter_n_plain(n, out);
  if (lo == hi && fabs(lo) <= DBL_MAX) {
    out->c = lo;
    out->r = 0.0;
  } else if (fabs(lo) <= DBL_MAX && fabs(hi) <= DBL_MAX) {
    out->c = 0.5 * lo + 0.5 * hi; /* any c will do, r is measured from it */
    out->r = soter_above_product(soter_most(hi - out->c, out->c - lo));
  }
}

/* Completes a form whose lo, hi, c, g are set, and r but for rounding: c and each g[i] computed
 * with relative error u; the program rounds its result where `rounds` is 1. Intersects both parts.
 */
SOTER_OPERATION void soter_n_settle(int n, soter_form* out, double rounds) {
  const double sum = soter_slopes(n, out->g);
  const double size = soter_size(out);
  const double r =
      (out->r + (fabs(out->c) + sum + rounds * size) * 0x1p-52 + SOTER_TINY) * SOTER_GROW;
  double reach = 0.0;
  SOTER_CHECK(!(out->r < 0.0));
  if (!(sum + fabs(out->c) + r <= DBL_MAX) || !(size <= DBL_MAX)) {
    soter_n_range(n, out, out->lo, out->hi); /* NaN and infinity end here, too */
    return;
  }
  out->r = r;
  reach = (sum + r) * SOTER_GROW;
  out->lo = soter_most(out->lo, soter_below(out->c - reach));
  out->hi = soter_least(out->hi, soter_above(out->c + reach));
  SOTER_CHECK(soter_holds(out->lo, out->hi)); /* both parts enclose the same numbers */
}

/* Sets the ends; makes it "anything" and says so where they are not numbers. */
SOTER_INLINE bool soter_n_ends(int n, soter_form* out, double lo, double hi) {
  out->lo = lo;
  out->hi = hi;
  if (!(lo <= hi) || (lo == -SOTER_INF && hi == SOTER_INF)) {
    soter_n_top(n, out);
    return false;
  }
  return true;
}

SOTER_INLINE bool soter_form_wild(const soter_form* a) {
  return a->lo == -SOTER_INF && a->hi == SOTER_INF;
}

/* The symbols that the inputs `read` depend on; gives how many. */
SOTER_OPERATION int soter_symbols(const soter_form in[], const int read[], int count,
                                  int symbols[]) {
  bool used[SOTER_INPUTS] = {false};
  int n = 0;
  for (int k = 0; k < count; k++) {
    SOTER_CHECK(read[k] >= 0 && read[k] < SOTER_INPUTS);
    for (int i = 0; i < SOTER_INPUTS; i++) {
      used[i] = used[i] || in[read[k]].g[i] != 0.0;
    }
  }
  for (int i = 0; i < SOTER_INPUTS; i++) {
    if (used[i]) {
      symbols[n++] = i;
    }
  }
  return n;
}

SOTER_OPERATION void soter_n_take(int n, soter_form* out, const soter_form* a,
                                  const int symbols[]) {
  out->lo = a->lo;
  out->hi = a->hi;
  out->c = a->c;
  out->r = a->r;
  for (int i = 0; i < n; i++) {
    SOTER_CHECK(symbols[i] >= i && symbols[i] < SOTER_INPUTS); /* they rise */
    out->g[i] = a->g[symbols[i]];
  }
}

SOTER_OPERATION void soter_n_give(int n, soter_form* out, const soter_form* a,
                                  const int symbols[]) {
  out->lo = a->lo;
  out->hi = a->hi;
  out->c = a->c;
  out->r = a->r;
  for (int i = 0; i < SOTER_INPUTS; i++) {
    out->g[i] = 0.0;
  }
  for (int i = 0; i < n; i++) {
    SOTER_CHECK(symbols[i] >= i && symbols[i] < SOTER_INPUTS);
    out->g[symbols[i]] = a->g[i];
  }
}

/* ------------------------------------------------------------------ + - * / */

SOTER_OPERATION void soter_n_add(int n, soter_form* out, const soter_form* a, const soter_form* b) {
  if (!soter_n_ends(n, out, soter_below(a->lo + b->lo), soter_above(a->hi + b->hi))) {
    return;
  }
  out->c = a->c + b->c;
  for (int i = 0; i < n; i++) {
    out->g[i] = a->g[i] + b->g[i];
  }
  out->r = a->r + b->r;
  soter_n_settle(n, out, 1.0);
}

SOTER_OPERATION void soter_n_sub(int n, soter_form* out, const soter_form* a, const soter_form* b) {
  if (!soter_n_ends(n, out, soter_below(a->lo - b->hi), soter_above(a->hi - b->lo))) {
    return;
  }
  out->c = a->c - b->c;
  for (int i = 0; i < n; i++) {
    out->g[i] = a->g[i] - b->g[i];
  }
  out->r = a->r + b->r;
  soter_n_settle(n, out, 1.0);
}

/* a + k for some k in [lo, hi]. */
SOTER_OPERATION void soter_n_shift(int n, soter_form* out, const soter_form* a, double lo,
                                   double hi) {
  const double k = lo == hi ? lo : 0.5 * lo + 0.5 * hi;
  SOTER_CHECK(soter_holds(lo, hi));
  if (!soter_n_ends(n, out, soter_below(a->lo + lo), soter_above(a->hi + hi))) {
    return;
  }
  out->c = a->c + k;
  for (int i = 0; i < n; i++) {
    out->g[i] = a->g[i];
  }
  out->r = a->r + (lo == hi ? 0.0 : soter_above_product(soter_most(hi - k, k - lo)));
  soter_n_settle(n, out, 1.0);
}

/* -a; exact. */
SOTER_OPERATION void soter_n_neg(int n, soter_form* out, const soter_form* a) {
  out->lo = -a->hi;
  out->hi = -a->lo;
  out->c = -a->c;
  out->r = a->r;
  for (int i = 0; i < n; i++) {
    out->g[i] = -a->g[i];
  }
}

/* Four results from the corners of two intervals, hulled outward; false where one is NaN. */
SOTER_INLINE bool soter_corners(double p, double q, double s, double t, double* lo, double* hi) {
  if (p != p || q != q || s != s || t != t) {
    return false;
  }
  *lo = soter_below_product(soter_least(soter_least(p, q), soter_least(s, t)));
  *hi = soter_above_product(soter_most(soter_most(p, q), soter_most(s, t)));
  SOTER_CHECK(soter_holds(*lo, *hi));
  return true;
}

/* The sign of a product or quotient of [a, b] and [c, d] is exact. */
SOTER_INLINE void soter_signed(double a, double b, double c, double d, double* lo, double* hi) {
  if ((a >= 0.0 && c >= 0.0) || (b <= 0.0 && d <= 0.0)) {
    *lo = soter_most(*lo, 0.0);
  }
  if ((a >= 0.0 && d <= 0.0) || (b <= 0.0 && c >= 0.0)) {
    *hi = soter_least(*hi, 0.0);
  }
  SOTER_CHECK(soter_holds(*lo, *hi)); /* the sign that is exact is among those that were bounded */
}

/* The ends of [a, b] * [c, d], outward; false where 0 * inf may happen. */
SOTER_INLINE bool soter_product(double a, double b, double c, double d, double* lo, double* hi) {
  if (!soter_corners(a * c, a * d, b * c, b * d, lo, hi)) {
    return false;
  }
  if ((a == 0.0 && b == 0.0) || (c == 0.0 && d == 0.0)) {
    *lo = 0.0;
    *hi = 0.0;
    return true;
  }
  soter_signed(a, b, c, d, lo, hi);
  return true;
}

/* How far x may be from c: by the first-order part, by the interval. */
SOTER_INLINE double soter_spread(const soter_form* a, double slopes) {
  const double by_ends = soter_most(fabs(a->hi - a->c), fabs(a->lo - a->c));
  return soter_least((slopes + a->r) * SOTER_GROW, soter_above(by_ends));
}

/* x y = cx cy + cx dy + cy dx + dx dy, where dx = x - cx. Each g[i] has two products and a sum:
 * within 4 u (|cx gy| + |cy gx|) together, u |g| of it again in settle. */
SOTER_OPERATION void soter_n_mul(int n, soter_form* out, const soter_form* a, const soter_form* b) {
  double lo = 0.0, hi = 0.0;
  if (!soter_product(a->lo, a->hi, b->lo, b->hi, &lo, &hi) || !soter_n_ends(n, out, lo, hi)) {
    soter_n_top(n, out);
    return;
  }
  const double of_a = soter_slopes(n, a->g), of_b = soter_slopes(n, b->g);
  const double weight = fabs(a->c) * of_b + fabs(b->c) * of_a;
  out->c = a->c * b->c;
  for (int i = 0; i < n; i++) {
    out->g[i] = a->c * b->g[i] + b->c * a->g[i];
  }
  out->r = soter_spread(a, of_a) * soter_spread(b, of_b) + fabs(a->c) * b->r + fabs(b->c) * a->r +
           weight * 0x1p-50;
  soter_n_settle(n, out, 1.0);
}

/* a a = c^2 + 2 c d + d^2 with 0 <= d^2 <= s^2: half of s^2 goes to the centre. */
SOTER_OPERATION void soter_n_square(int n, soter_form* out, const soter_form* a) {
  const double p = a->lo * a->lo, q = a->hi * a->hi;
  const bool across = a->lo <= 0.0 && a->hi >= 0.0;
  const double lo = across ? 0.0 : soter_most(soter_below_product(soter_least(p, q)), 0.0);
  if (soter_form_wild(a) || !soter_n_ends(n, out, lo, soter_above_product(soter_most(p, q)))) {
    soter_n_top(n, out);
    return;
  }
  const double s = soter_spread(a, soter_slopes(n, a->g));
  const double half = 0.5 * s * s;
  out->c = a->c * a->c + half;
  for (int i = 0; i < n; i++) {
    out->g[i] = 2.0 * a->c * a->g[i];
  }
  out->r = half + (half + a->c * a->c) * 0x1p-50 + 2.0 * fabs(a->c) * a->r;
  soter_n_settle(n, out, 1.0);
}

/* A form with the given ends that is alpha a + [lo, hi] at every eps; what `mul`, `div` and all
 * functions of one argument come to. The products are off by u each, which settle counts for g;
 * for c it is counted here. */
SOTER_OPERATION void soter_n_line(int n, soter_form* out, const soter_form* a, double alpha,
                                  double lo, double hi, double rounds) {
  const double middle = lo == hi ? lo : 0.5 * lo + 0.5 * hi;
  const double p = alpha * a->c;
  const double beside = lo == hi ? 0.0 : soter_above_product(soter_most(hi - middle, middle - lo));
  SOTER_CHECK(!(lo > hi) && !(beside < 0.0));
  if (soter_form_wild(out)) {
    soter_n_top(n, out);
    return;
  }
  out->c = p + middle;
  for (int i = 0; i < n; i++) {
    out->g[i] = alpha * a->g[i];
  }
  out->r = fabs(alpha) * a->r + beside + fabs(p) * 0x1p-52;
  soter_n_settle(n, out, rounds);
}

/* a k for some k in [lo, hi]. */
SOTER_OPERATION void soter_n_scale(int n, soter_form* out, const soter_form* a, double lo,
                                   double hi) {
  double below = 0.0, above = 0.0, beside = 0.0;
  const double k = lo == hi ? lo : 0.5 * lo + 0.5 * hi;
  if (!soter_product(a->lo, a->hi, lo, hi, &below, &above) || !soter_n_ends(n, out, below, above)) {
    soter_n_top(n, out);
    return;
  }
  if (lo != hi) {
    beside = soter_above_product(soter_most(hi - k, k - lo) * soter_size(a));
  }
  soter_n_line(n, out, a, k, -beside, beside, 1.0);
}

/* The ends of [a, b] / [c, d], outward; false where the divisor may be 0 or inf / inf happens. */
SOTER_INLINE bool soter_quotient(double a, double b, double c, double d, double* lo, double* hi) {
  if (!(c > 0.0 || d < 0.0) || !soter_corners(a / c, a / d, b / c, b / d, lo, hi)) {
    return false;
  }
  soter_signed(a, b, c, d, lo, hi);
  return true;
}

/* a / k for some k in [lo, hi], which does not contain 0. */
SOTER_OPERATION void soter_n_over(int n, soter_form* out, const soter_form* a, double lo,
                                  double hi) {
  double below = 0.0, above = 0.0, k_lo = 0.0, k_hi = 0.0, beside = 0.0;
  if (!soter_quotient(a->lo, a->hi, lo, hi, &below, &above) ||
      !soter_quotient(1.0, 1.0, lo, hi, &k_lo, &k_hi) || !soter_n_ends(n, out, below, above)) {
    soter_n_top(n, out);
    return;
  }
  const double k = 0.5 * k_lo + 0.5 * k_hi;
  beside = soter_above_product(soter_most(k_hi - k, k - k_lo) * soter_size(a));
  soter_n_line(n, out, a, k, -beside, beside, 1.0);
}

/* 1 / a as a real number, 0 < |a|: with A > 0, 1/x + A x is convex for x > 0, so at most its larger
 * end and at least 2 sqrt(A). For x < 0 the same of -x. */
SOTER_OPERATION void soter_n_inverse(int n, soter_form* out, const soter_form* a) {
  const bool negative = a->hi < 0.0;
  const double l = negative ? -a->hi : a->lo, h = negative ? -a->lo : a->hi;
  double lo = 0.0, hi = 0.0;
  if (!soter_quotient(1.0, 1.0, a->lo, a->hi, &lo, &hi) || !soter_n_ends(n, out, lo, hi)) {
    soter_n_top(n, out);
    return;
  }
  const double slope = (1.0 / l) / h;
  const double least = soter_below_product(soter_below_product(2.0 * sqrt(slope)));
  const double most = soter_most(1.0 / l + slope * l, 1.0 / h + slope * h);
  const double top = soter_above_product(soter_above_product(most));
  soter_n_line(n, out, a, -slope, negative ? -top : least, negative ? -least : top, 0.0);
}

/* a / b; anything where b may be 0 (which the program guards before). */
SOTER_OPERATION void soter_n_div(int n, soter_form* out, const soter_form* a, const soter_form* b) {
  double lo = 0.0, hi = 0.0;
  soter_form inverse;
  if (!soter_quotient(a->lo, a->hi, b->lo, b->hi, &lo, &hi)) {
    soter_n_top(n, out);
    return;
  }
  soter_n_inverse(n, &inverse, b);
  soter_n_mul(n, out, a, &inverse);
  if (lo > out->lo) {
    out->lo = lo;
  }
  if (hi < out->hi) {
    out->hi = hi;
  }
  SOTER_CHECK(soter_holds(out->lo, out->hi));
}

/* ------------------------------------------------------------------ abs, min, max, floor, sqrt */

/* v - alpha x, from below and from above. */
SOTER_INLINE double soter_rest_below(double v, double alpha, double x) {
  const double p = alpha * x;
  return (v - p) - ((fabs(v) + fabs(p)) * 0x1p-50 + SOTER_TINY);
}

SOTER_INLINE double soter_rest_above(double v, double alpha, double x) {
  const double p = alpha * x;
  return (v - p) + ((fabs(v) + fabs(p)) * 0x1p-50 + SOTER_TINY);
}

/* |a|: for any slope in [-1, 1], |x| - slope x is convex with its minimum 0 at 0. */
SOTER_OPERATION void soter_n_abs(int n, soter_form* out, const soter_form* a) {
  if (soter_form_wild(a)) {
    soter_n_top(n, out);
  } else if (a->lo >= 0.0) {
    soter_n_copy(n, out, a);
  } else if (a->hi <= 0.0) {
    soter_n_neg(n, out, a);
  } else {
    const double slope = soter_most(-1.0, soter_least(1.0, (a->lo + a->hi) / (a->hi - a->lo)));
    const double most =
        soter_most(soter_rest_above(-a->lo, slope, a->lo), soter_rest_above(a->hi, slope, a->hi));
    SOTER_CHECK(most >= 0.0); /* of both ends, and the minimum is 0 */
    out->lo = 0.0;
    out->hi = soter_most(-a->lo, a->hi);
    soter_n_line(n, out, a, slope, 0.0, most, 0.0);
  }
}

/* max(a, k): for any slope in [0, 1], max(x, k) - slope x is convex with its minimum at k. */
SOTER_OPERATION void soter_n_at_least(int n, soter_form* out, const soter_form* a, double k) {
  if (soter_form_wild(a)) {
    soter_n_top(n, out);
  } else if (a->lo >= k) {
    soter_n_copy(n, out, a);
  } else if (a->hi <= k) {
    soter_n_range(n, out, k, k);
  } else {
    const double slope = soter_most(0.0, soter_least(1.0, (a->hi - k) / (a->hi - a->lo)));
    const double most =
        soter_most(soter_rest_above(k, slope, a->lo), soter_rest_above(a->hi, slope, a->hi));
    SOTER_CHECK(soter_holds(k, a->hi));
    out->lo = k;
    out->hi = a->hi;
    soter_n_line(n, out, a, slope, soter_rest_below(k, slope, k), most, 0.0);
  }
}

/* min(a, k). */
SOTER_OPERATION void soter_n_at_most(int n, soter_form* out, const soter_form* a, double k) {
  if (soter_form_wild(a)) {
    soter_n_top(n, out);
  } else if (a->hi <= k) {
    soter_n_copy(n, out, a);
  } else if (a->lo >= k) {
    soter_n_range(n, out, k, k);
  } else {
    const double slope = soter_most(0.0, soter_least(1.0, (k - a->lo) / (a->hi - a->lo)));
    const double least =
        soter_least(soter_rest_below(k, slope, a->hi), soter_rest_below(a->lo, slope, a->lo));
    SOTER_CHECK(soter_holds(a->lo, k));
    out->lo = a->lo;
    out->hi = k;
    soter_n_line(n, out, a, slope, least, soter_rest_above(k, slope, k), 0.0);
  }
}

/* max(a, b) = b > a ? b : a = b + max(a - b, 0) as reals. NaN in b gives a, NaN in a stays. */
SOTER_OPERATION void soter_n_max(int n, soter_form* out, const soter_form* a, const soter_form* b) {
  soter_form d, excess;
  if (soter_form_wild(a)) {
    soter_n_top(n, out);
    return;
  }
  if (soter_form_wild(b)) {
    soter_n_range(n, out, a->lo, SOTER_INF);
    return;
  }
  soter_n_sub(n, &d, a, b);
  if (d.lo >= 0.0) {
    soter_n_copy(n, out, a);
  } else if (d.hi <= 0.0) {
    soter_n_copy(n, out, b);
  } else {
    soter_n_at_least(n, &excess, &d, 0.0);
    soter_n_add(n, out, b, &excess);
    out->lo = soter_most(out->lo, soter_most(a->lo, b->lo));
    out->hi = soter_least(out->hi, soter_most(a->hi, b->hi));
    SOTER_CHECK(soter_holds(out->lo, out->hi));
  }
}

/* min(a, b) = b < a ? b : a = b + min(a - b, 0) as reals. */
SOTER_OPERATION void soter_n_min(int n, soter_form* out, const soter_form* a, const soter_form* b) {
  soter_form d, excess;
  if (soter_form_wild(a)) {
    soter_n_top(n, out);
    return;
  }
  if (soter_form_wild(b)) {
    soter_n_range(n, out, -SOTER_INF, a->hi);
    return;
  }
  soter_n_sub(n, &d, a, b);
  if (d.hi <= 0.0) {
    soter_n_copy(n, out, a);
  } else if (d.lo >= 0.0) {
    soter_n_copy(n, out, b);
  } else {
    soter_n_at_most(n, &excess, &d, 0.0);
    soter_n_add(n, out, b, &excess);
    out->lo = soter_most(out->lo, soter_least(a->lo, b->lo));
    out->hi = soter_least(out->hi, soter_least(a->hi, b->hi));
    SOTER_CHECK(soter_holds(out->lo, out->hi));
  }
}

/* The largest whole number not above: within 1 of a. */
SOTER_OPERATION void soter_n_floor(int n, soter_form* out, const soter_form* a) {
  const double lo = floor(a->lo), hi = floor(a->hi);
  if (lo == hi) {
    soter_n_range(n, out, lo, hi);
  } else {
    out->lo = lo;
    out->hi = hi;
    soter_n_line(n, out, a, 1.0, -1.0, 0.0, 0.0);
  }
}

/* sqrt(x) - A x is concave: at least its smaller end, at most 1 / (4 A). */
SOTER_OPERATION void soter_n_sqrt(int n, soter_form* out, const soter_form* a) {
  if (!(a->lo >= 0.0)) {
    soter_n_top(n, out); /* NaN below zero */
    return;
  }
  const double l = sqrt(a->lo), h = sqrt(a->hi);
  const double slope = 1.0 / (l + h);
  SOTER_CHECK(soter_holds(l, h));
  out->lo = soter_most(0.0, soter_below_product(l));
  out->hi = a->hi > 0.0 ? soter_above_product(h) : 0.0;
  if (!(slope > 0.0 && slope <= DBL_MAX)) {
    soter_n_range(n, out, out->lo, out->hi);
    return;
  }
  soter_n_line(n, out, a, slope,
               soter_least(soter_rest_below(soter_below_product(l), slope, a->lo),
                           soter_rest_below(soter_below_product(h), slope, a->hi)),
               soter_above_product(soter_above_product(0.25 / slope)), 1.0);
}

/* One of the two, at the same eps. */
SOTER_OPERATION void soter_n_join(int n, soter_form* out, const soter_form* a,
                                  const soter_form* b) {
  double apart = fabs(a->c - b->c);
  out->lo = soter_least(a->lo, b->lo);
  out->hi = soter_most(a->hi, b->hi);
  SOTER_CHECK(soter_holds(out->lo, out->hi));
  if (!(a->r <= DBL_MAX && b->r <= DBL_MAX) || soter_form_wild(out)) {
    soter_n_range(n, out, out->lo, out->hi);
    return;
  }
  for (int i = 0; i < n; i++) {
    apart += fabs(a->g[i] - b->g[i]);
    out->g[i] = 0.5 * (a->g[i] + b->g[i]);
  }
  out->c = 0.5 * (a->c + b->c);
  out->r = soter_most(a->r, b->r);
  if (apart > 0.0) {
    out->r += 0.5 * apart * SOTER_GROW;
    soter_n_settle(n, out, 0.0);
  }
}

/* `then` where t may only be true, `otherwise` where it may only be false, else their join. */
SOTER_OPERATION void soter_n_select(int n, soter_form* out, soter_truth t, const soter_form* then,
                                    const soter_form* otherwise) {
  SOTER_CHECK(t >= 1U && t <= 3U);
  if (t == 2U) {
    soter_n_copy(n, out, then);
  } else if (t == 1U) {
    soter_n_copy(n, out, otherwise);
  } else {
    soter_n_join(n, out, then, otherwise);
  }
}

/* The same into what a branch before may have left in `out`: with t undecided it is joined. */
SOTER_OPERATION void soter_n_merge(int n, soter_form* out, soter_truth t, const soter_form* a) {
  SOTER_CHECK(t >= 1U && t <= 3U);
  if (t == 3U) {
    soter_form before;
    soter_n_copy(n, &before, out);
    soter_n_join(n, out, &before, a);
  } else {
    soter_n_copy(n, out, a);
  }
}

/* One of the items whose number is in `at`, which lies in [0, n - 1]. */
SOTER_OPERATION void soter_n_gather(int n, soter_form* out, const soter_form* const items[],
                                    soter_ints at) {
  SOTER_CHECK(at.lo >= 0 && at.lo <= at.hi);
  soter_n_copy(n, out, items[at.lo]);
  for (int64_t k = at.lo + 1; k <= at.hi; k++) {
    soter_n_merge(n, out, 3U, items[k]);
  }
}

/* The same for constants. */
SOTER_OPERATION void soter_n_table(int n, soter_form* out, const double items[], soter_ints at) {
  double lo = items[at.lo], hi = items[at.lo];
  bool nan = lo != lo;
  SOTER_CHECK(at.lo >= 0 && at.lo <= at.hi);
  for (int64_t k = at.lo + 1; k <= at.hi; k++) {
    lo = soter_least(lo, items[k]);
    hi = soter_most(hi, items[k]);
    nan = nan || items[k] != items[k];
  }
  if (nan) {
    soter_n_top(n, out);
  } else {
    soter_n_range(n, out, lo, hi);
  }
}

/* ------------------------------------------------------------------ truth */

SOTER_INLINE soter_truth soter_truth_of(bool may_be_true, bool may_be_false) {
  SOTER_CHECK(may_be_true || may_be_false);
  return (soter_truth)((may_be_true ? 2U : 0U) | (may_be_false ? 1U : 0U));
}

SOTER_INLINE soter_truth soter_not(soter_truth t) {
  SOTER_CHECK(t >= 1U && t <= 3U);
  return (soter_truth)(((t & 1U) << 1U) | (unsigned)(t >> 1U));
}

SOTER_INLINE soter_truth soter_both(soter_truth a, soter_truth b) {
  SOTER_CHECK(a >= 1U && a <= 3U && b >= 1U && b <= 3U);
  return (soter_truth)((a & b & 2U) | ((a | b) & 1U));
}

SOTER_INLINE soter_truth soter_either(soter_truth a, soter_truth b) {
  SOTER_CHECK(a >= 1U && a <= 3U && b >= 1U && b <= 3U);
  return (soter_truth)(((a | b) & 2U) | (a & b & 1U));
}

SOTER_INLINE soter_truth soter_truth_select(soter_truth t, soter_truth then,
                                            soter_truth otherwise) {
  SOTER_CHECK(t >= 1U && t <= 3U);
  return t == 2U ? then : t == 1U ? otherwise : (soter_truth)(then | otherwise);
}

SOTER_INLINE void soter_truth_merge(soter_truth* out, soter_truth t, soter_truth a) {
  SOTER_CHECK(t >= 1U && t <= 3U && a >= 1U && a <= 3U);
  *out = t == 3U ? (soter_truth)(*out | a) : a;
}

/* a < b; every comparison with NaN is false. Where the ends do not decide, a - b may, in which what
 * both have in common cancels. */
SOTER_OPERATION soter_truth soter_n_less(int n, const soter_form* a, const soter_form* b) {
  soter_form d;
  if (a->hi < b->lo) {
    return 2U;
  }
  if (soter_form_wild(a) || soter_form_wild(b)) {
    return soter_truth_of(a->lo < b->hi, true);
  }
  if (a->lo >= b->hi) {
    return 1U;
  }
  soter_n_sub(n, &d, a, b);
  return soter_truth_of(d.lo < 0.0, d.hi >= 0.0);
}

SOTER_OPERATION soter_truth soter_n_no_more(int n, const soter_form* a, const soter_form* b) {
  soter_form d;
  if (soter_form_wild(a) || soter_form_wild(b)) {
    return soter_truth_of(a->lo <= b->hi, true);
  }
  if (a->hi <= b->lo) {
    return 2U;
  }
  if (a->lo > b->hi) {
    return 1U;
  }
  soter_n_sub(n, &d, a, b);
  return soter_truth_of(d.lo <= 0.0, d.hi > 0.0);
}

SOTER_INLINE soter_truth soter_equal(const soter_form* a, const soter_form* b) {
  const bool one = a->lo == a->hi && b->lo == b->hi && a->lo == b->lo;
  return soter_truth_of(a->lo <= b->hi && b->lo <= a->hi, !one);
}

/* Whether it is no NaN, which one form alone encloses. */
SOTER_INLINE soter_truth soter_is_number(const soter_form* a) {
  return soter_truth_of(true, soter_form_wild(a));
}

/* ------------------------------------------------------------------ faults and the gate */

SOTER_INLINE void soter_possible(soter_truth holds, unsigned* fault) {
  SOTER_CHECK(holds >= 1U && holds <= 3U);
  if ((holds & 1U) != 0U) {
    *fault |= 1U;
  }
}

/* What passes is finite and in [lo, hi]. */
SOTER_OPERATION void soter_n_gate(int n, soter_form* out, const soter_form* a, double lo, double hi,
                                  unsigned* fault) {
  soter_n_copy(n, out, a);
  if (!(a->lo >= lo && a->hi <= hi && soter_size(a) <= DBL_MAX)) {
    *fault |= 1U;
    out->lo = soter_least(soter_most(a->lo, lo), hi);
    out->hi = soter_most(soter_least(a->hi, hi), lo);
  }
  SOTER_CHECK(soter_holds(out->lo, out->hi) && out->lo >= lo && out->hi <= hi);
}

#include "soter_form_ints.h"
#include "soter_form_math.h"

#endif
