/* soter_lanes.h: several worlds of one program at once, a world a lane.
 *
 * Purpose: numbers and truth values of as many worlds as a vector of this machine holds, loaded
 * from their states and stored there, and what generated code does with them (codegen/lanes.py).
 * Every operation on a lane is the one of soter.h, rounded once: the bits are the same.
 * Non-goals: branches: a lane computes both sides and takes one.
 */
#ifndef SOTER_LANES_H
#define SOTER_LANES_H

#include "soter.h"

#if defined(__AVX2__)
#include <immintrin.h>
#endif

#define SOTER_LANES 4
#define soter_lane_always ((soter_lane_bool){-1, -1, -1, -1})
#define SOTER_LANE_INLINE static inline __attribute__((always_inline, unused))

typedef double soter_lane_float __attribute__((vector_size(8 * SOTER_LANES)));
typedef int64_t soter_lane_int __attribute__((vector_size(8 * SOTER_LANES)));
typedef soter_lane_int soter_lane_bool; /* 0, or -1 */
typedef uint64_t soter_lane_bits __attribute__((vector_size(8 * SOTER_LANES)));

/* What `member` is in each of the states that SOTER_LANE_STATES named. */
#define SOTER_LANE_STATES(type)                  \
  type* const given_s0 = (type*)given_states[0]; \
  type* const given_s1 = (type*)given_states[1]; \
  type* const given_s2 = (type*)given_states[2]; \
  type* const given_s3 = (type*)given_states[3]
#define SOTER_LANE_OF(kind, member) \
  ((kind){given_s0->member, given_s1->member, given_s2->member, given_s3->member})
#define SOTER_LANE_BITS(member) SOTER_LANE_OF(soter_lane_bits, member)

/* The same of elements of an array that each state has (AT), that all share (IN), or whose elements
 * are lanes (PICK): each lane has its own index, and `rest` leads on from the element. */
#define SOTER_LANE_AT(kind, array, index, rest)                          \
  ((kind){given_s0->array[(index)[0]] rest, given_s1->array[(index)[1]] rest, \
          given_s2->array[(index)[2]] rest, given_s3->array[(index)[3]] rest})
#define SOTER_LANE_IN(kind, array, index, rest)                     \
  ((kind){array[(index)[0]] rest, array[(index)[1]] rest, array[(index)[2]] rest, \
          array[(index)[3]] rest})
#define SOTER_LANE_PICK(kind, array, index, rest)                       \
  ((kind){(array)[(index)[0]] rest[0], (array)[(index)[1]] rest[1], (array)[(index)[2]] rest[2], \
          (array)[(index)[3]] rest[3]})

#define SOTER_LANE_ENABLED(flags) \
  (-((soter_lane_bool){(flags)[0], (flags)[1], (flags)[2], (flags)[3]} & SOTER_ENABLED))

/* Lanes on their way into the states, where `on` says so. */
#define SOTER_LANE_PUT_AS(kind, on, member, lanes, type)    \
  do {                                                      \
    const kind given_put = (lanes);                         \
    const soter_lane_bool given_on = (on);                  \
    if (given_on[0]) {                                      \
      given_s0->member = (type)given_put[0];               \
    }                                                       \
    if (given_on[1]) {                                      \
      given_s1->member = (type)given_put[1];               \
    }                                                       \
    if (given_on[2]) {                                      \
      given_s2->member = (type)given_put[2];               \
    }                                                       \
    if (given_on[3]) {                                      \
      given_s3->member = (type)given_put[3];               \
    }                                                       \
  } while (0)
#define SOTER_LANE_PUT(on, member, lanes) \
  SOTER_LANE_PUT_AS(soter_lane_float, on, member, lanes, double)
#define SOTER_LANE_PUT_INT(on, member, lanes, type) \
  SOTER_LANE_PUT_AS(soter_lane_int, on, member, lanes, type)

SOTER_LANE_INLINE soter_lane_float soter_lane_all(double x) {
  return (soter_lane_float){x, x, x, x};
}

SOTER_LANE_INLINE soter_lane_bool soter_lane_all_bool(bool x) {
  const int64_t all = -(int64_t)x;
  return (soter_lane_bool){all, all, all, all};
}

SOTER_LANE_INLINE soter_lane_int soter_lane_all_int(int64_t x) {
  return (soter_lane_int){x, x, x, x};
}

SOTER_LANE_INLINE bool soter_lane_any(soter_lane_bool x) {
#if defined(__AVX2__)
  return _mm256_testz_si256((__m256i)x, (__m256i)x) == 0;
#else
  return (x[0] | x[1] | x[2] | x[3]) != 0;
#endif
}

/* Of whole numbers and truth values. */
SOTER_LANE_INLINE soter_lane_int soter_lane_select_int(soter_lane_bool on, soter_lane_int a,
                                                       soter_lane_int b) {
  return (on & a) | (~on & b);
}

SOTER_LANE_INLINE soter_lane_float soter_lane_select(soter_lane_bool on, soter_lane_float a,
                                                     soter_lane_float b) {
#if defined(__AVX2__)
  return (soter_lane_float)_mm256_blendv_pd((__m256d)b, (__m256d)a, (__m256d)on);
#else
  return (soter_lane_float)((on & (soter_lane_bool)a) | (~on & (soter_lane_bool)b));
#endif
}

/* min(a, b) = b < a ? b : a, max(a, b) = b > a ? b : a, as soter_min and soter_max: of equal ones,
 * and where one is NaN, it is a. So does the instruction of x86 with its operands the other way. */
SOTER_LANE_INLINE soter_lane_float soter_lane_min(soter_lane_float a, soter_lane_float b) {
#if defined(__AVX2__)
  return (soter_lane_float)_mm256_min_pd((__m256d)b, (__m256d)a);
#else
  return soter_lane_select((soter_lane_bool)(b < a), b, a);
#endif
}

SOTER_LANE_INLINE soter_lane_float soter_lane_max(soter_lane_float a, soter_lane_float b) {
#if defined(__AVX2__)
  return (soter_lane_float)_mm256_max_pd((__m256d)b, (__m256d)a);
#else
  return soter_lane_select((soter_lane_bool)(b > a), b, a);
#endif
}

SOTER_LANE_INLINE soter_lane_float soter_lane_sqrt(soter_lane_float x) {
#if defined(__AVX2__)
  return (soter_lane_float)_mm256_sqrt_pd((__m256d)x);
#else
  return (soter_lane_float){sqrt(x[0]), sqrt(x[1]), sqrt(x[2]), sqrt(x[3])};
#endif
}

SOTER_LANE_INLINE soter_lane_float soter_lane_floor(soter_lane_float x) {
#if defined(__AVX2__)
  return (soter_lane_float)_mm256_floor_pd((__m256d)x);
#else
  return (soter_lane_float){floor(x[0]), floor(x[1]), floor(x[2]), floor(x[3])};
#endif
}

SOTER_LANE_INLINE soter_lane_float soter_lane_abs(soter_lane_float x) {
  return (soter_lane_float)((soter_lane_bits)x & (UINT64_MAX >> 1));
}

SOTER_LANE_INLINE soter_lane_float soter_lane_canonical(soter_lane_float x) {
  return soter_lane_select((soter_lane_bool)(x == x), x, soter_lane_all((double)NAN));
}

/* min and max of whole numbers, as soter_min_int and soter_max_int. */
SOTER_LANE_INLINE soter_lane_int soter_lane_min_int(soter_lane_int a, soter_lane_int b) {
  return soter_lane_select_int((soter_lane_bool)(b < a), b, a);
}

SOTER_LANE_INLINE soter_lane_int soter_lane_max_int(soter_lane_int a, soter_lane_int b) {
  return soter_lane_select_int((soter_lane_bool)(b > a), b, a);
}

SOTER_LANE_INLINE soter_lane_float soter_lane_to_float(soter_lane_int x) {
  return (soter_lane_float){(double)x[0], (double)x[1], (double)x[2], (double)x[3]};
}

SOTER_LANE_INLINE soter_lane_float soter_lane_seconds(soter_lane_int ns) {
  return soter_lane_to_float(ns) / 1e9;
}

SOTER_LANE_INLINE soter_lane_bool soter_lane_negative(soter_lane_int x) {
  return (soter_lane_bool)(x < soter_lane_all_int(0));
}

SOTER_LANE_INLINE soter_lane_bool soter_lane_outside_int(soter_lane_int x, int64_t low,
                                                         int64_t high) {
  return (soter_lane_bool)(x < soter_lane_all_int(low)) |
         (soter_lane_bool)(x > soter_lane_all_int(high));
}

/* Operations that may fault: in which lanes of `mask` they do is added to `bad`. What a lane gets
 * then, or outside of `mask`, is harmless: an index is inside. */
SOTER_LANE_INLINE soter_lane_int soter_lane_add(soter_lane_int a, soter_lane_int b,
                                                soter_lane_bool mask, soter_lane_bool* bad) {
  const soter_lane_int sum = (soter_lane_int)((soter_lane_bits)a + (soter_lane_bits)b);
  const soter_lane_bool over = soter_lane_negative((a ^ sum) & (b ^ sum));
  *bad |= mask & over;
  return sum & ~over;
}

SOTER_LANE_INLINE soter_lane_int soter_lane_sub(soter_lane_int a, soter_lane_int b,
                                                soter_lane_bool mask, soter_lane_bool* bad) {
  const soter_lane_int difference = (soter_lane_int)((soter_lane_bits)a - (soter_lane_bits)b);
  const soter_lane_bool over = soter_lane_negative((a ^ b) & (a ^ difference));
  *bad |= mask & over;
  return difference & ~over;
}

SOTER_LANE_INLINE soter_lane_int soter_lane_neg(soter_lane_int a, soter_lane_bool mask,
                                                soter_lane_bool* bad) {
  return soter_lane_sub(soter_lane_all_int(0), a, mask, bad);
}

SOTER_LANE_INLINE soter_lane_int soter_lane_abs_int(soter_lane_int a, soter_lane_bool mask,
                                                    soter_lane_bool* bad) {
  const soter_lane_bool negative = soter_lane_negative(a);
  return soter_lane_select_int(negative, soter_lane_neg(a, mask & negative, bad), a);
}

SOTER_LANE_INLINE soter_lane_int soter_lane_narrow(soter_lane_int a, int64_t low, int64_t high,
                                                   soter_lane_bool mask, soter_lane_bool* bad) {
  const soter_lane_bool outside = soter_lane_outside_int(a, low, high);
  *bad |= mask & outside;
  return soter_lane_select_int(outside, soter_lane_all_int(low), a);
}

SOTER_LANE_INLINE soter_lane_int soter_lane_index(soter_lane_int i, soter_lane_int limit,
                                                  soter_lane_bool mask, soter_lane_bool* bad) {
  const soter_lane_bool outside = soter_lane_negative(i) | (soter_lane_bool)(i >= limit);
  *bad |= mask & outside;
  return i & ~outside;
}

/* There are no vectors of these: each lane alone. */
#define SOTER_LANE_EACH(name, made)                                                  \
  for (int lane = 0; lane < SOTER_LANES; lane++) {                                   \
    soter_fault fault = SOTER_OK;                                                    \
    name[lane] = (made);                                                             \
    (*bad)[lane] |= mask[lane] & -(int64_t)(fault != SOTER_OK);                      \
  }

SOTER_LANE_INLINE soter_lane_int soter_lane_mul(soter_lane_int a, soter_lane_int b,
                                                soter_lane_bool mask, soter_lane_bool* bad) {
  soter_lane_int product = a;
  SOTER_LANE_EACH(product, soter_mul(a[lane], b[lane], &fault))
  return product;
}

SOTER_LANE_INLINE soter_lane_int soter_lane_div(soter_lane_int a, soter_lane_int b,
                                                soter_lane_bool mask, soter_lane_bool* bad) {
  soter_lane_int quotient = a;
  SOTER_LANE_EACH(quotient, soter_div(a[lane], b[lane], &fault))
  return quotient;
}

SOTER_LANE_INLINE soter_lane_int soter_lane_mod(soter_lane_int a, soter_lane_int b,
                                                soter_lane_bool mask, soter_lane_bool* bad) {
  soter_lane_int rest = a;
  SOTER_LANE_EACH(rest, soter_mod(a[lane], b[lane], &fault))
  return rest;
}

SOTER_LANE_INLINE soter_lane_int soter_lane_to_int(soter_lane_float x, soter_lane_bool mask,
                                                   soter_lane_bool* bad) {
  soter_lane_int whole = soter_lane_all_int(0);
  SOTER_LANE_EACH(whole, soter_to_int(x[lane], &fault))
  return whole;
}

/* Where a value may not be published (soter_check_float). */
SOTER_LANE_INLINE soter_lane_bool soter_lane_not_finite(soter_lane_float x) {
  return ~(soter_lane_bool)(x - x == soter_lane_all(0.0));
}

SOTER_LANE_INLINE soter_lane_bool soter_lane_outside(soter_lane_float x, double low, double high) {
  return ~((soter_lane_bool)(x >= soter_lane_all(low)) &
           (soter_lane_bool)(x <= soter_lane_all(high)));
}

SOTER_LANE_INLINE soter_lane_bits soter_lane_mix(soter_lane_bits z) {
  z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
  z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
  return z ^ (z >> 31);
}

/* soter_draw. What is below 2^53 becomes a double without rounding: its halves are the last bits of
 * two doubles. */
SOTER_LANE_INLINE soter_lane_float soter_lane_draw(soter_lane_bits seed_key, uint64_t stream,
                                                   int64_t index, double low, double high) {
  const soter_lane_bits key = soter_lane_mix(seed_key ^ stream);
  const soter_lane_bits bits =
      soter_lane_mix(key + ((uint64_t)index + 1U) * UINT64_C(0x9e3779b97f4a7c15)) >> 11;
  const soter_lane_bits upper = (bits >> 32) | UINT64_C(0x4530000000000000);
  const soter_lane_bits lower = (bits & UINT64_C(0xffffffff)) | UINT64_C(0x4330000000000000);
  const soter_lane_float u =
      ((soter_lane_float)upper - 19342813118337666422669312.0) + (soter_lane_float)lower;
  return soter_lane_min(low + (high - low) * (u * SOTER_ULP), soter_lane_all(high));
}

#endif
