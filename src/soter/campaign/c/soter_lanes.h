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

/* f(0, ...), f(1, ...), ...: one a lane. */
#define SOTER_FOUR_LANES(f, ...) \
  f(0, __VA_ARGS__), f(1, __VA_ARGS__), f(2, __VA_ARGS__), f(3, __VA_ARGS__)
#if defined(__AVX512F__) && defined(__AVX512DQ__)
#define SOTER_LANES 8
#define SOTER_EACH_LANE(f, ...)                                                              \
  SOTER_FOUR_LANES(f, __VA_ARGS__), f(4, __VA_ARGS__), f(5, __VA_ARGS__), f(6, __VA_ARGS__), \
      f(7, __VA_ARGS__)
#else
#define SOTER_LANES 4
#define SOTER_EACH_LANE(f, ...) SOTER_FOUR_LANES(f, __VA_ARGS__)
#endif
#define soter_lane_always soter_lane_all_bool(true)
#define SOTER_LANE_INLINE static inline __attribute__((always_inline, unused))

typedef double soter_lane_float __attribute__((vector_size(8 * SOTER_LANES)));
typedef int64_t soter_lane_int __attribute__((vector_size(8 * SOTER_LANES)));
typedef soter_lane_int soter_lane_bool; /* 0, or -1 */
typedef uint64_t soter_lane_bits __attribute__((vector_size(8 * SOTER_LANES)));

/* What `member` is in each of the states that SOTER_LANE_STATES named. */
#define SOTER_LANE_STATE(k, type) (type*)given_states[k]
#define SOTER_LANE_STATES(type) \
  type* const given_s[SOTER_LANES] = {SOTER_EACH_LANE(SOTER_LANE_STATE, type)}
#define SOTER_LANE_MEMBER(k, member) given_s[k]->member
#define SOTER_LANE_OF(kind, member) ((kind){SOTER_EACH_LANE(SOTER_LANE_MEMBER, member)})
#define SOTER_LANE_BITS(member) SOTER_LANE_OF(soter_lane_bits, member)

/* The same of elements of an array that each state has (AT), that all share (IN), or whose elements
 * are lanes (PICK): each lane has its own index, and `rest` leads on from the element. */
#define SOTER_LANE_ELEMENT(k, array, index, rest) given_s[k]->array[(index)[k]] rest
#define SOTER_LANE_AT(kind, array, index, rest) \
  ((kind){SOTER_EACH_LANE(SOTER_LANE_ELEMENT, array, index, rest)})
#define SOTER_LANE_ROW(k, array, index, rest) array[(index)[k]] rest
#define SOTER_LANE_IN(kind, array, index, rest) \
  ((kind){SOTER_EACH_LANE(SOTER_LANE_ROW, array, index, rest)})
#define SOTER_LANE_OWN(k, array, index, rest) (array)[(index)[k]] rest[k]
#define SOTER_LANE_PICK(kind, array, index, rest) \
  ((kind){SOTER_EACH_LANE(SOTER_LANE_OWN, array, index, rest)})

#define SOTER_LANE_FLAG(k, flags) (flags)[k]
#define SOTER_LANE_ENABLED(flags) \
  (-((soter_lane_bool){SOTER_EACH_LANE(SOTER_LANE_FLAG, flags)} & SOTER_ENABLED))

/* Lanes on their way into the states, where `on` says so. */
#define SOTER_LANE_PUT_ONE(k, member, type) \
  (void)(given_on[k] != 0 ? (given_s[k]->member = (type)given_put[k], 0) : 0)
#define SOTER_LANE_PUT_AS(kind, on, member, lanes, type) \
  do {                                                   \
    const kind given_put = (lanes);                      \
    const soter_lane_bool given_on = (on);               \
    SOTER_EACH_LANE(SOTER_LANE_PUT_ONE, member, type);   \
  } while (0)
#define SOTER_LANE_PUT(on, member, lanes) \
  SOTER_LANE_PUT_AS(soter_lane_float, on, member, lanes, double)
#define SOTER_LANE_PUT_INT(on, member, lanes, type) \
  SOTER_LANE_PUT_AS(soter_lane_int, on, member, lanes, type)

#define SOTER_LANE_SAME(k, x) x
SOTER_LANE_INLINE soter_lane_float soter_lane_all(double x) {
  return (soter_lane_float){SOTER_EACH_LANE(SOTER_LANE_SAME, x)};
}

SOTER_LANE_INLINE soter_lane_bool soter_lane_all_bool(bool x) {
  const int64_t all = -(int64_t)x;
  return (soter_lane_bool){SOTER_EACH_LANE(SOTER_LANE_SAME, all)};
}

SOTER_LANE_INLINE soter_lane_int soter_lane_all_int(int64_t x) {
  return (soter_lane_int){SOTER_EACH_LANE(SOTER_LANE_SAME, x)};
}

SOTER_LANE_INLINE bool soter_lane_any(soter_lane_bool x) {
#if SOTER_LANES == 8
  return _mm512_test_epi64_mask((__m512i)x, (__m512i)x) != 0;
#elif defined(__AVX2__)
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
#if SOTER_LANES == 8
  return (soter_lane_float)_mm512_mask_blend_pd(_mm512_movepi64_mask((__m512i)on), (__m512d)b,
                                                (__m512d)a);
#elif defined(__AVX2__)
  return (soter_lane_float)_mm256_blendv_pd((__m256d)b, (__m256d)a, (__m256d)on);
#else
  return (soter_lane_float)((on & (soter_lane_bool)a) | (~on & (soter_lane_bool)b));
#endif
}

/* min(a, b) = b < a ? b : a, max(a, b) = b > a ? b : a, as soter_min and soter_max: of equal ones,
 * and where one is NaN, it is a. So does the instruction of x86 with its operands the other way. */
SOTER_LANE_INLINE soter_lane_float soter_lane_min(soter_lane_float a, soter_lane_float b) {
#if SOTER_LANES == 8
  return (soter_lane_float)_mm512_min_pd((__m512d)b, (__m512d)a);
#elif defined(__AVX2__)
  return (soter_lane_float)_mm256_min_pd((__m256d)b, (__m256d)a);
#else
  return soter_lane_select((soter_lane_bool)(b < a), b, a);
#endif
}

SOTER_LANE_INLINE soter_lane_float soter_lane_max(soter_lane_float a, soter_lane_float b) {
#if SOTER_LANES == 8
  return (soter_lane_float)_mm512_max_pd((__m512d)b, (__m512d)a);
#elif defined(__AVX2__)
  return (soter_lane_float)_mm256_max_pd((__m256d)b, (__m256d)a);
#else
  return soter_lane_select((soter_lane_bool)(b > a), b, a);
#endif
}

SOTER_LANE_INLINE soter_lane_float soter_lane_sqrt(soter_lane_float x) {
#if SOTER_LANES == 8
  return (soter_lane_float)_mm512_sqrt_pd((__m512d)x);
#elif defined(__AVX2__)
  return (soter_lane_float)_mm256_sqrt_pd((__m256d)x);
#else
  return (soter_lane_float){sqrt(x[0]), sqrt(x[1]), sqrt(x[2]), sqrt(x[3])};
#endif
}

SOTER_LANE_INLINE soter_lane_float soter_lane_floor(soter_lane_float x) {
#if SOTER_LANES == 8
  return (soter_lane_float)_mm512_floor_pd((__m512d)x);
#elif defined(__AVX2__)
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
  return __builtin_convertvector(x, soter_lane_float);
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
#define SOTER_LANE_EACH(name, made)                             \
  for (int lane = 0; lane < SOTER_LANES; lane++) {              \
    soter_fault fault = SOTER_OK;                               \
    name[lane] = (made);                                        \
    (*bad)[lane] |= mask[lane] & -(int64_t)(fault != SOTER_OK); \
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
