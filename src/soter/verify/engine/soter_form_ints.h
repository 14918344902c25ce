/* soter_form_ints.h: ints as intervals, and their way to and from forms.
 *
 * Purpose: enclose what operations on ints give. They note in `fault` that a step may fault here;
 * the result then encloses what the operation gives where it does not fault.
 * Non-goals: first-order parts of ints; operations on floats (soter_form.h).
 */
#ifndef SOTER_FORM_INTS_H
#define SOTER_FORM_INTS_H

SOTER_INLINE soter_ints soter_ints_of(int64_t lo, int64_t hi) {
  soter_ints out;
  SOTER_CHECK(lo <= hi);
  out.lo = lo;
  out.hi = hi;
  return out;
}

SOTER_INLINE soter_truth soter_ints_less(soter_ints a, soter_ints b) {
  return soter_truth_of(a.lo < b.hi, a.hi >= b.lo);
}
SOTER_INLINE soter_truth soter_ints_at_most(soter_ints a, soter_ints b) {
  return soter_truth_of(a.lo <= b.hi, a.hi > b.lo);
}
SOTER_INLINE soter_truth soter_ints_equal(soter_ints a, soter_ints b) {
  const bool one = a.lo == a.hi && b.lo == b.hi && a.lo == b.lo;
  return soter_truth_of(a.lo <= b.hi && b.lo <= a.hi, !one);
}

SOTER_INLINE soter_ints soter_ints_select(soter_truth t, soter_ints a, soter_ints b) {
  SOTER_CHECK(t >= 1U && t <= 3U);
  if (t == 2U) {
    return a;
  }
  return t == 1U ? b : soter_ints_of(soter_min_int(a.lo, b.lo), soter_max_int(a.hi, b.hi));
}

SOTER_INLINE void soter_ints_merge(soter_ints* out, soter_truth t, soter_ints a) {
  SOTER_CHECK(t >= 1U && t <= 3U);
  *out = t == 3U ? soter_ints_select(3U, *out, a) : a;
}

SOTER_INLINE soter_ints soter_ints_min(soter_ints a, soter_ints b) {
  return soter_ints_of(soter_min_int(a.lo, b.lo), soter_min_int(a.hi, b.hi));
}
SOTER_INLINE soter_ints soter_ints_max(soter_ints a, soter_ints b) {
  return soter_ints_of(soter_max_int(a.lo, b.lo), soter_max_int(a.hi, b.hi));
}

SOTER_INLINE soter_ints soter_ints_table(const int64_t items[], soter_ints at) {
  soter_ints out = soter_ints_of(items[at.lo], items[at.lo]);
  SOTER_CHECK(at.lo >= 0 && at.lo <= at.hi);
  for (int64_t k = at.lo + 1; k <= at.hi; k++) {
    out = soter_ints_select(3U, out, soter_ints_of(items[k], items[k]));
  }
  return out;
}

/* `kind` is what the exact operation would have raised; the result then is that end of int64. */
SOTER_INLINE int64_t soter_saturated(int64_t value, soter_fault kind, bool negative,
                                     unsigned* fault) {
  if (kind == SOTER_OK) {
    return value;
  }
  *fault |= 1U;
  return negative ? INT64_MIN : INT64_MAX;
}

SOTER_INLINE soter_ints soter_ints_add(soter_ints a, soter_ints b, unsigned* fault) {
  soter_fault low = SOTER_OK, high = SOTER_OK;
  const int64_t lo = soter_add(a.lo, b.lo, &low), hi = soter_add(a.hi, b.hi, &high);
  return soter_ints_of(soter_saturated(lo, low, a.lo < 0, fault),
                       soter_saturated(hi, high, a.hi < 0, fault));
}

SOTER_INLINE soter_ints soter_ints_sub(soter_ints a, soter_ints b, unsigned* fault) {
  soter_fault low = SOTER_OK, high = SOTER_OK;
  const int64_t lo = soter_sub(a.lo, b.hi, &low), hi = soter_sub(a.hi, b.lo, &high);
  return soter_ints_of(soter_saturated(lo, low, a.lo < 0, fault),
                       soter_saturated(hi, high, a.hi < 0, fault));
}

SOTER_INLINE int64_t soter_corner(int64_t a, int64_t b, unsigned* fault) {
  soter_fault kind = SOTER_OK;
  const int64_t product = soter_mul(a, b, &kind);
  return soter_saturated(product, kind, (a < 0) != (b < 0), fault);
}

SOTER_INLINE soter_ints soter_ints_mul(soter_ints a, soter_ints b, unsigned* fault) {
  const int64_t p = soter_corner(a.lo, b.lo, fault), q = soter_corner(a.lo, b.hi, fault);
  const int64_t s = soter_corner(a.hi, b.lo, fault), t = soter_corner(a.hi, b.hi, fault);
  return soter_ints_of(soter_min_int(soter_min_int(p, q), soter_min_int(s, t)),
                       soter_max_int(soter_max_int(p, q), soter_max_int(s, t)));
}

SOTER_INLINE soter_ints soter_ints_neg(soter_ints a, unsigned* fault) {
  return soter_ints_sub(soter_ints_of(0, 0), a, fault);
}

SOTER_INLINE soter_ints soter_ints_abs(soter_ints a, unsigned* fault) {
  if (a.lo >= 0) {
    return a;
  }
  const soter_ints b = soter_ints_neg(a, fault);
  return a.hi <= 0 ? b : soter_ints_of(0, soter_max_int(a.hi, b.hi));
}

/* Truncated division: monotonic in either operand on either side of zero, and |a / b| <= |a|. */
SOTER_INLINE soter_ints soter_ints_div(soter_ints a, soter_ints b, unsigned* fault) {
  if (b.lo <= 0 && b.hi >= 0) {
    const soter_ints size = soter_ints_abs(a, fault);
    *fault |= 1U;
    return soter_ints_of(soter_min_int(a.lo, -size.hi), size.hi);
  }
  soter_fault kinds[4] = {SOTER_OK, SOTER_OK, SOTER_OK, SOTER_OK};
  const int64_t p = soter_saturated(soter_div(a.lo, b.lo, &kinds[0]), kinds[0], false, fault);
  const int64_t q = soter_saturated(soter_div(a.lo, b.hi, &kinds[1]), kinds[1], false, fault);
  const int64_t s = soter_saturated(soter_div(a.hi, b.lo, &kinds[2]), kinds[2], false, fault);
  const int64_t t = soter_saturated(soter_div(a.hi, b.hi, &kinds[3]), kinds[3], false, fault);
  return soter_ints_of(soter_min_int(soter_min_int(p, q), soter_min_int(s, t)),
                       soter_max_int(soter_max_int(p, q), soter_max_int(s, t)));
}

/* |a|, at most INT64_MAX. */
SOTER_INLINE int64_t soter_size_int(int64_t a) {
  return a < -INT64_MAX ? INT64_MAX : (a < 0 ? -a : a);
}

/* The sign of a, less than |b| and at most |a|. */
SOTER_INLINE soter_ints soter_ints_mod(soter_ints a, soter_ints b, unsigned* fault) {
  if (b.lo <= 0 && b.hi >= 0) {
    *fault |= 1U;
  }
  if (a.lo == a.hi && b.lo == b.hi && b.lo != 0) {
    soter_fault kind = SOTER_OK;
    const int64_t rest = soter_mod(a.lo, b.lo, &kind);
    return soter_ints_of(rest, rest);
  }
  const int64_t size = soter_max_int(soter_max_int(soter_size_int(b.lo), soter_size_int(b.hi)), 1);
  const int64_t limit = size == INT64_MAX ? size : size - 1;
  SOTER_CHECK(size >= 1 && limit >= 0);
  return soter_ints_of(a.lo >= 0 ? 0 : soter_max_int(a.lo, -limit),
                       a.hi <= 0 ? 0 : soter_min_int(a.hi, limit));
}

SOTER_INLINE soter_ints soter_ints_narrow(soter_ints a, int64_t lo, int64_t hi, unsigned* fault) {
  SOTER_CHECK(lo <= hi);
  if (a.lo < lo || a.hi > hi) {
    *fault |= 1U;
  }
  return soter_ints_of(soter_min_int(soter_max_int(a.lo, lo), hi),
                       soter_max_int(soter_min_int(a.hi, hi), lo));
}

/* An index below `limit`, which is at most `capacity`; clamped into [0, capacity - 1]. */
SOTER_INLINE soter_ints soter_ints_index(soter_ints a, soter_ints limit, int64_t capacity,
                                         unsigned* fault) {
  const int64_t last = soter_max_int(soter_min_int(capacity, limit.hi), 1) - 1;
  SOTER_CHECK(capacity >= 1 && last < capacity);
  if (a.lo < 0 || a.hi >= limit.lo) {
    *fault |= 1U;
  }
  return soter_ints_of(soter_min_int(soter_max_int(a.lo, 0), last),
                       soter_max_int(soter_min_int(a.hi, last), 0));
}

/* int(x) for x in [lo, hi]: truncation is monotonic. */
SOTER_INLINE soter_ints soter_ints_between(double lo, double hi, unsigned* fault) {
  soter_fault low = SOTER_OK, high = SOTER_OK;
  const int64_t first = soter_to_int(lo, &low), last = soter_to_int(hi, &high);
  if (low != SOTER_OK || high != SOTER_OK) {
    *fault |= 1U;
  }
  return soter_ints_of(low == SOTER_OK ? first : INT64_MIN, high == SOTER_OK ? last : INT64_MAX);
}

SOTER_INLINE soter_ints soter_ints_to_int(const soter_form* a, unsigned* fault) {
  return soter_ints_between(a->lo, a->hi, fault);
}

/* The ints among what an input says. */
SOTER_INLINE soter_ints soter_ints_input(const soter_form* a, int64_t low, int64_t high) {
  unsigned ignored = 0U;
  const soter_ints all = soter_ints_between(floor(a->lo), ceil(a->hi), &ignored);
  return soter_ints_narrow(all, low, high, &ignored);
}

/* The truth that an input between 0 and 1 says. */
SOTER_INLINE soter_truth soter_truth_input(const soter_form* a) {
  return soter_truth_of(a->hi > 0.0, a->lo < 1.0);
}

SOTER_OPERATION void soter_n_to_float(int n, soter_form* out, soter_ints a) {
  const double lo = (double)a.lo, hi = (double)a.hi;
  const bool exact = a.lo >= -(INT64_C(1) << 53) && a.hi <= (INT64_C(1) << 53);
  soter_n_range(n, out, exact ? lo : soter_below(lo), exact ? hi : soter_above(hi));
}

SOTER_OPERATION void soter_n_truth_to_float(int n, soter_form* out, soter_truth t) {
  soter_n_range(n, out, (t & 1U) != 0U ? 0.0 : 1.0, (t & 2U) != 0U ? 1.0 : 0.0);
}

#endif
