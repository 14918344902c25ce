/* soter_form_math.h: functions of the prelude over first-order forms.
 *
 * Purpose: enclose sin, sqrt and others. Each encloses the mathematical function and what the
 * prelude computes in its place. `ulps` is the bound of
 * src/soter/language/prelude/function_error_bounds.py on the difference of the two: tested, not
 * proved. The values come from libm, which is taken to be within SOTER_LIBM ulps of the true ones.
 *
 * First-order parts by the mean value theorem: f(x) in f(m) + [f'] (x - m), with an enclosure [f']
 * of the derivative over the whole interval. Non-goals: + - * / and comparisons (soter_form.h).
 */
#ifndef SOTER_FORM_MATH_H
#define SOTER_FORM_MATH_H

#define SOTER_LIBM 8.0
#define SOTER_MATH_PI 3.14159265358979323846

/* How far a value of size 1 may be off: ulp(v) <= 2^-52 |v|, doubled for the roundings here. */
SOTER_INLINE double soter_off(double ulps) {
  return (ulps + SOTER_LIBM) * 0x1p-51;
}

SOTER_INLINE double soter_lower(double v, double off) {
  return v >= -DBL_MAX
             ? soter_least(v, DBL_MAX) - (fabs(soter_least(v, DBL_MAX)) * off + SOTER_TINY)
             : -SOTER_INF;
}

SOTER_INLINE double soter_upper(double v, double off) {
  return -soter_lower(-v, off);
}

/* Completes `out`, whose ends are set: f(m) = v within `off`, f' in [least, most] over a. */
SOTER_OPERATION void soter_n_mean(int n, soter_form* out, const soter_form* a, double m, double v,
                                  double least, double most, double off) {
  const double slope = 0.5 * least + 0.5 * most;
  const double beside = soter_most(most - slope, slope - least);
  SOTER_CHECK(soter_holds(least, most) && m >= a->lo && m <= a->hi && off > 0.0);
  const double reach = soter_above(soter_most(a->hi - m, m - a->lo));
  const double apart = beside * reach * (1.0 + 0x1p-49) + soter_size(out) * off + SOTER_TINY;
  const double lo = soter_rest_below(soter_lower(v, off), slope, m) - apart;
  const double hi = soter_rest_above(soter_upper(v, off), slope, m) + apart;
  soter_n_line(n, out, a, slope, soter_below(lo), soter_above(hi), 0.0);
}

/* The middle of a form's interval, somewhere in it. */
SOTER_INLINE double soter_middle(const soter_form* a) {
  return soter_least(a->hi, soter_most(a->lo, 0.5 * a->lo + 0.5 * a->hi));
}

/* A form that encloses an exact value, widened by a relative deviation. */
SOTER_OPERATION void soter_n_widen(int n, soter_form* out, double off) {
  const double apart = soter_size(out) * off + SOTER_TINY;
  SOTER_CHECK(apart > 0.0);
  if (soter_n_ends(n, out, soter_below(out->lo - apart), soter_above(out->hi + apart))) {
    out->r += apart * (1.0 + 0x1p-49);
  }
}

/* Whether [lo, hi] contains phase + 2 pi k for some k, or nearly does; |lo|, |hi| <= 1e5. */
SOTER_INLINE bool soter_meets(double lo, double hi, double phase) {
  const double turn = 2.0 * SOTER_MATH_PI;
  SOTER_CHECK(soter_holds(lo, hi) && lo >= -1.0e5 && hi <= 1.0e5);
  return floor((hi - phase) / turn + 1e-9) >= ceil((lo - phase) / turn - 1e-9);
}

/* The ends of sin (quarter 0) or cos (quarter 1) over [lo, hi]. */
SOTER_INLINE void soter_wave(double lo, double hi, bool quarter, double off, double* least,
                             double* most) {
  const double top = quarter ? 0.0 : 0.5 * SOTER_MATH_PI;
  const double a = quarter ? cos(lo) : sin(lo), b = quarter ? cos(hi) : sin(hi);
  *least = soter_meets(lo, hi, top + SOTER_MATH_PI)
               ? -1.0
               : soter_most(-1.0, soter_lower(soter_least(a, b), off));
  *most = soter_meets(lo, hi, top) ? 1.0 : soter_least(1.0, soter_upper(soter_most(a, b), off));
  SOTER_CHECK(-1.0 <= *least && *least <= *most && *most <= 1.0);
}

SOTER_OPERATION void soter_n_wave(int n, soter_form* out, const soter_form* a, bool quarter,
                                  double ulps) {
  const double off = soter_off(ulps), m = soter_middle(a);
  double least = 0.0, most = 0.0;
  if (!(a->lo >= -1.0e5 && a->hi <= 1.0e5)) {
    soter_n_top(n, out); /* NaN there */
    return;
  }
  soter_wave(a->lo, a->hi, !quarter, off, &least, &most);
  soter_wave(a->lo, a->hi, quarter, off, &out->lo, &out->hi);
  if (quarter) { /* cos' = -sin */
    soter_n_mean(n, out, a, m, cos(m), -most, -least, off);
  } else {
    soter_n_mean(n, out, a, m, sin(m), least, most, off);
  }
}

SOTER_OPERATION void soter_n_sin(int n, soter_form* out, const soter_form* a, double ulps) {
  soter_n_wave(n, out, a, false, ulps);
}

SOTER_OPERATION void soter_n_cos(int n, soter_form* out, const soter_form* a, double ulps) {
  soter_n_wave(n, out, a, true, ulps);
}

/* What a sum that holds angles may be off where each is any number of turns further: up to 2^16 all
 * together, with a rest of up to 2^15, and 8 roundings of 2^-37 each. */
#define SOTER_FAR_TURNS 0x1p-33

/* The argument of a function of a full turn, which may be turns further, as one that is not. */
SOTER_OPERATION void soter_n_any_turn(int n, soter_form* out, const soter_form* a) {
  if (a->lo >= -0x1p15 && a->hi <= 0x1p15) {
    soter_n_shift(n, out, a, -SOTER_FAR_TURNS, SOTER_FAR_TURNS);
  } else {
    soter_n_top(n, out); /* it may leave the functions' domain */
  }
}

/* The angle within half a turn, modulo a turn within `off`; any where it may be half a turn. */
SOTER_OPERATION void soter_n_wrap_angle(int n, soter_form* out, const soter_form* a, double off) {
  const double turn = 2.0 * SOTER_MATH_PI;
  soter_form near;
  if (!(a->lo >= -0x1p16 && a->hi <= 0x1p16)) {
    soter_n_top(n, out);
    return;
  }
  const double back = -turn * floor(soter_middle(a) / turn + 0.5);
  const double apart = off + fabs(back) * 0x1p-50;
  soter_n_shift(n, &near, a, back - apart, back + apart);
  SOTER_CHECK(off > 0.0);
  if (near.lo > -SOTER_MATH_PI && near.hi < SOTER_MATH_PI) {
    soter_n_copy(n, out, &near);
  } else {
    soter_n_range(n, out, -SOTER_MATH_PI, SOTER_MATH_PI);
  }
}

/* Rises between its poles; tan' = 1 + tan^2. */
SOTER_OPERATION void soter_n_tan(int n, soter_form* out, const soter_form* a, double ulps) {
  const double off = soter_off(ulps), m = soter_middle(a), half = 0.5 * SOTER_MATH_PI;
  if (!(a->lo >= -1.0e5 && a->hi <= 1.0e5) || soter_meets(a->lo, a->hi, half) ||
      soter_meets(a->lo, a->hi, -half)) {
    soter_n_top(n, out);
    return;
  }
  out->lo = soter_lower(tan(a->lo), off);
  out->hi = soter_upper(tan(a->hi), off);
  const double far = soter_size(out);
  const double near =
      out->lo <= 0.0 && out->hi >= 0.0 ? 0.0 : soter_least(fabs(out->lo), fabs(out->hi));
  soter_n_mean(n, out, a, m, tan(m), (1.0 + near * near) * (1.0 - 0x1p-49),
               (1.0 + far * far) * (1.0 + 0x1p-49), off);
}

SOTER_OPERATION void soter_n_exp(int n, soter_form* out, const soter_form* a, double ulps) {
  const double off = soter_off(ulps), m = soter_middle(a);
  if (soter_form_wild(a)) {
    soter_n_top(n, out);
    return;
  }
  out->lo = soter_most(0.0, soter_lower(exp(a->lo), off));
  out->hi = soter_upper(exp(a->hi), off);
  SOTER_CHECK(soter_holds(out->lo, out->hi));
  soter_n_mean(n, out, a, m, exp(m), out->lo, out->hi, off);
}

SOTER_OPERATION void soter_n_log(int n, soter_form* out, const soter_form* a, double ulps) {
  const double off = soter_off(ulps), m = soter_middle(a);
  if (!(a->lo >= 0.0)) {
    soter_n_top(n, out); /* NaN below zero */
    return;
  }
  /* Near 1 the error of libm is relative to the logarithm, which is small; so is that here. */
  out->lo = a->lo > 0.0 ? soter_lower(log(a->lo), off) : -SOTER_INF;
  out->hi = a->hi > 0.0 ? soter_upper(log(a->hi), off) : -SOTER_INF;
  SOTER_CHECK(soter_holds(out->lo, out->hi));
  if (soter_form_wild(out) || !(a->lo > 0.0)) {
    soter_n_plain(n, out);
    return;
  }
  soter_n_mean(n, out, a, m, log(m), soter_below_product(1.0 / a->hi),
               soter_above_product(1.0 / a->lo), off);
}

/* The smallest and the largest |x| over a form. */
SOTER_INLINE double soter_nearest(const soter_form* a) {
  return a->lo <= 0.0 && a->hi >= 0.0 ? 0.0 : soter_least(fabs(a->lo), fabs(a->hi));
}

/* tanh' = 1 - tanh^2, which falls with |x|. */
SOTER_OPERATION void soter_n_tanh(int n, soter_form* out, const soter_form* a, double ulps) {
  const double off = soter_off(ulps), m = soter_middle(a);
  if (soter_form_wild(a)) {
    soter_n_top(n, out);
    return;
  }
  const double near = tanh(soter_nearest(a)), far = tanh(soter_size(a));
  out->lo = soter_most(-1.0, soter_lower(tanh(a->lo), off));
  out->hi = soter_least(1.0, soter_upper(tanh(a->hi), off));
  SOTER_CHECK(soter_holds(out->lo, out->hi));
  soter_n_mean(n, out, a, m, tanh(m), soter_most(0.0, 1.0 - far * far - 4.0 * off),
               soter_least(1.0, 1.0 - near * near + 4.0 * off), off);
}

/* atan' = 1 / (1 + x^2), which falls with |x|. */
SOTER_OPERATION void soter_n_atan(int n, soter_form* out, const soter_form* a, double ulps) {
  const double off = soter_off(ulps), m = soter_middle(a);
  if (soter_form_wild(a)) {
    soter_n_top(n, out);
    return;
  }
  const double near = soter_nearest(a), far = soter_size(a);
  out->lo = soter_lower(atan(a->lo), off);
  out->hi = soter_upper(atan(a->hi), off);
  SOTER_CHECK(soter_holds(out->lo, out->hi));
  soter_n_mean(n, out, a, m, atan(m), 1.0 / (1.0 + far * far) * (1.0 - 0x1p-49),
               1.0 / (1.0 + near * near) * (1.0 + 0x1p-49), off);
}

/* asin' = 1 / sqrt(1 - x^2), which rises with |x|. */
SOTER_OPERATION void soter_n_asin(int n, soter_form* out, const soter_form* a, double ulps) {
  const double off = soter_off(ulps), m = soter_middle(a);
  if (!(a->lo >= -1.0 && a->hi <= 1.0)) {
    soter_n_top(n, out);
    return;
  }
  const double near = soter_nearest(a), far = soter_size(a);
  out->lo = soter_lower(asin(a->lo), off);
  out->hi = soter_upper(asin(a->hi), off);
  SOTER_CHECK(soter_holds(out->lo, out->hi));
  soter_n_mean(n, out, a, m, asin(m), 1.0 / sqrt((1.0 - near) * (1.0 + near)) * (1.0 - 0x1p-49),
               1.0 / sqrt((1.0 - far) * (1.0 + far)) * (1.0 + 0x1p-49), off);
}

SOTER_OPERATION void soter_n_acos(int n, soter_form* out, const soter_form* a, double ulps) {
  const double off = soter_off(ulps), m = soter_middle(a);
  if (!(a->lo >= -1.0 && a->hi <= 1.0)) {
    soter_n_top(n, out);
    return;
  }
  const double near = soter_nearest(a), far = soter_size(a);
  out->lo = soter_most(0.0, soter_lower(acos(a->hi), off));
  out->hi = soter_upper(acos(a->lo), off);
  SOTER_CHECK(soter_holds(out->lo, out->hi));
  soter_n_mean(n, out, a, m, acos(m), -1.0 / sqrt((1.0 - far) * (1.0 + far)) * (1.0 + 0x1p-49),
               -1.0 / sqrt((1.0 - near) * (1.0 + near)) * (1.0 - 0x1p-49), off);
}

/* Where the signs decide, atan of a quotient beside a quarter turn; elsewhere any angle. */
SOTER_OPERATION void soter_n_atan2(int n, soter_form* out, const soter_form* y, const soter_form* x,
                                   double ulps) {
  const double half = 0.5 * SOTER_MATH_PI;
  soter_form ratio, angle, turned;
  if (soter_form_wild(x) || soter_form_wild(y)) {
    soter_n_top(n, out);
    return;
  }
  if (x->lo > 0.0) {
    soter_n_div(n, &ratio, y, x);
    soter_n_atan(n, out, &ratio, 0.0);
  } else if (y->lo > 0.0 || y->hi < 0.0) {
    soter_n_div(n, &ratio, x, y);
    soter_n_atan(n, &angle, &ratio, 0.0);
    soter_n_neg(n, &turned, &angle);
    soter_n_shift(n, out, &turned, y->lo > 0.0 ? half * (1.0 - 0x1p-52) : -half * (1.0 + 0x1p-52),
                  y->lo > 0.0 ? half * (1.0 + 0x1p-52) : -half * (1.0 - 0x1p-52));
  } else {
    soter_n_range(n, out, -3.1415926535897936, 3.1415926535897936);
    return;
  }
  if (soter_form_wild(out)) { /* infinite both: still an angle */
    soter_n_range(n, out, -3.1415926535897936, 3.1415926535897936);
    return;
  }
  soter_n_widen(n, out, soter_off(ulps));
}

SOTER_OPERATION void soter_n_hypot(int n, soter_form* out, const soter_form* a, const soter_form* b,
                                   double ulps) {
  const double off = soter_off(ulps);
  soter_form p, q, sum;
  if (soter_form_wild(a) || soter_form_wild(b)) {
    soter_n_top(n, out);
    return;
  }
  soter_n_square(n, &p, a);
  soter_n_square(n, &q, b);
  soter_n_add(n, &sum, &p, &q);
  soter_n_sqrt(n, out, &sum);
  if (soter_form_wild(out)) {
    soter_n_range(n, out, 0.0, SOTER_INF);
  }
  out->lo = soter_most(out->lo, soter_lower(hypot(soter_nearest(a), soter_nearest(b)), off));
  out->hi = soter_least(out->hi, soter_upper(hypot(soter_size(a), soter_size(b)), off));
  SOTER_CHECK(soter_holds(out->lo, out->hi));
  soter_n_widen(n, out, off);
  out->lo = soter_most(out->lo, 0.0);
}

/* x^y for x > 0 is exp(y log x), and y log x takes its ends in corners. */
SOTER_OPERATION void soter_n_pow(int n, soter_form* out, const soter_form* x, const soter_form* y,
                                 double ulps) {
  const double off = soter_off(ulps);
  soter_form logarithm, exponent;
  if (!(x->lo > 0.0 && x->hi <= DBL_MAX && soter_size(y) <= DBL_MAX)) {
    soter_n_top(n, out);
    if (x->lo >= 0.0 && y->lo > 0.0 && x->hi <= DBL_MAX && y->hi <= DBL_MAX) {
      const double most = soter_most(pow(x->hi, y->lo), pow(x->hi, y->hi));
      soter_n_range(n, out, 0.0, soter_upper(most, off));
    }
    return;
  }
  const double p = pow(x->lo, y->lo), q = pow(x->lo, y->hi);
  const double s = pow(x->hi, y->lo), t = pow(x->hi, y->hi);
  soter_n_log(n, &logarithm, x, 0.0);
  soter_n_mul(n, &exponent, y, &logarithm);
  soter_n_exp(n, out, &exponent, 0.0);
  soter_n_widen(n, out, off);
  out->lo = soter_most(soter_most(out->lo, 0.0),
                       soter_lower(soter_least(soter_least(p, q), soter_least(s, t)), off));
  out->hi = soter_least(out->hi, soter_upper(soter_most(soter_most(p, q), soter_most(s, t)), off));
  SOTER_CHECK(soter_holds(out->lo, out->hi));
}

#endif
