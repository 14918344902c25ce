/* soter_gym_leaves.h: numbers of structs as doubles.
 *
 * Purpose: what arrays of NumPy and structs of a program have in common, leaf by leaf.
 * Non-goals: lists, which have no fixed number of leaves; the gate, which looks at values.
 */
#ifndef SOTER_GYM_LEAVES_H
#define SOTER_GYM_LEAVES_H

#include <string.h>

#include "soter_gym.h"

SOTER_INLINE void soter_put_int(void* at, uint32_t kind, int64_t x) {
  const uint64_t bits = (uint64_t)x;
  const uint8_t one = (uint8_t)bits;
  const uint16_t two = (uint16_t)bits;
  const uint32_t four = (uint32_t)bits;
  if (kind <= (uint32_t)SOTER_LEAF_U8) {
    (void)memcpy(at, &one, sizeof one);
  } else if (kind <= (uint32_t)SOTER_LEAF_U16) {
    (void)memcpy(at, &two, sizeof two);
  } else if (kind <= (uint32_t)SOTER_LEAF_U32) {
    (void)memcpy(at, &four, sizeof four);
  } else {
    (void)memcpy(at, &bits, sizeof bits);
  }
}

/* Writes a number; false, and nothing is written, where it is no value of the leaf's type. */
SOTER_INLINE bool soter_put(const soter_leaf* leaf, double x, uint8_t* base) {
  uint8_t* const at = base + leaf->offset;
  if (leaf->kind == (uint32_t)SOTER_LEAF_FLOAT) {
    const double kept = soter_canonical(x);
    (void)memcpy(at, &kept, sizeof kept);
    return true;
  }
  if (leaf->kind == (uint32_t)SOTER_LEAF_BOOL) {
    *at = x != 0.0 ? 1U : 0U;
    return x - x == 0.0 && floor(x) == x;
  }
  if (!(x >= -9223372036854775808.0 && x < 9223372036854775808.0) || floor(x) != x) {
    return false;
  }
  const int64_t whole = (int64_t)x;
  if (whole < leaf->low || whole > leaf->high) {
    return false;
  }
  soter_put_int(at, leaf->kind, whole);
  return true;
}

SOTER_INLINE bool soter_put_all(const soter_leaves* leaves, const double* from, uint8_t* base) {
  bool fits = true;
  for (uint32_t i = 0; i < leaves->count; i++) {
    fits = soter_put(&leaves->at[i], from[i], base) && fits;
  }
  return fits;
}

SOTER_INLINE double soter_get_small(const uint8_t* at, uint32_t kind) {
  int8_t one = 0;
  int16_t two = 0;
  uint16_t plain = 0;
  switch (kind) {
    case SOTER_LEAF_I8:
      (void)memcpy(&one, at, sizeof one);
      return one;
    case SOTER_LEAF_I16:
      (void)memcpy(&two, at, sizeof two);
      return two;
    case SOTER_LEAF_U16:
      (void)memcpy(&plain, at, sizeof plain);
      return plain;
    default:
      return *at;
  }
}

SOTER_INLINE double soter_get(const soter_leaf* leaf, const uint8_t* base) {
  const uint8_t* const at = base + leaf->offset;
  double real = 0.0;
  int32_t four = 0;
  uint32_t plain = 0;
  int64_t eight = 0;
  switch (leaf->kind) {
    case SOTER_LEAF_FLOAT:
      (void)memcpy(&real, at, sizeof real);
      return real;
    case SOTER_LEAF_I32:
      (void)memcpy(&four, at, sizeof four);
      return four;
    case SOTER_LEAF_U32:
      (void)memcpy(&plain, at, sizeof plain);
      return plain;
    case SOTER_LEAF_I64:
      (void)memcpy(&eight, at, sizeof eight);
      return (double)eight;
    default:
      return soter_get_small(at, leaf->kind);
  }
}

SOTER_INLINE void soter_get_all(const soter_leaves* leaves, const void* base, double* to) {
  for (uint32_t i = 0; i < leaves->count; i++) {
    to[i] = soter_get(&leaves->at[i], (const uint8_t*)base);
  }
}

#endif
