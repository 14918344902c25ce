/* soter_explore_pack.h: what generated `pack` and `unpack` functions are written with.
 *
 * Purpose: read and write single fields of a packed configuration: a row of bits in words, lowest
 * bit first. Times are relative to now and in ticks, so that equal futures have equal bits.
 * Non-goals: which fields there are, and where (explore/model/bit_packing.py).
 */
#ifndef SOTER_EXPLORE_PACK_H
#define SOTER_EXPLORE_PACK_H

#include "soter_explore.h"

/* The bits of a double and back. */
SOTER_INLINE uint64_t soter_float_bits(double x) {
  const union {
    double x;
    uint64_t bits;
  } both = {x};
  return both.bits;
}

SOTER_INLINE double soter_float_of(uint64_t bits) {
  const union {
    uint64_t bits;
    double x;
  } both = {bits};
  return both.x;
}

/* All ones where a bit is set: what is packed of a value that may be absent. */
SOTER_INLINE uint64_t soter_if(bool present) {
  return present ? UINT64_MAX : 0U;
}

/* Bits of long arrays, whose words are zero beforehand: `width` (1 to 64) of them from bit `at`. */
SOTER_INLINE void soter_put(uint64_t* words, uint64_t at, uint32_t width, uint64_t value) {
  const uint64_t shift = at % 64U;
  words[at / 64U] |= value << shift;
  if (shift + width > 64U) {
    words[at / 64U + 1U] |= value >> (64U - shift);
  }
}

SOTER_INLINE uint64_t soter_get(const uint64_t* words, uint64_t at, uint32_t width) {
  const uint64_t shift = at % 64U;
  uint64_t value = words[at / 64U] >> shift;
  if (shift + width > 64U) {
    value |= words[at / 64U + 1U] << (64U - shift);
  }
  return width < 64U ? value & ((UINT64_C(1) << width) - 1U) : value;
}

/* Releases phase + k * period up to the last one whose window ended before `now`; all in one unit,
 * `now` -1 before the first step. */
SOTER_INLINE int64_t soter_must(int64_t now, int64_t window, int64_t phase, int64_t period,
                                int64_t last) {
  const int64_t before = now - window - 1 < last ? now - window - 1 : last;
  return before < phase ? 0 : (int64_t)((uint64_t)(before - phase) / (uint64_t)period) + 1;
}

/* Ticks from now until a deadline: 0 none, 1 it has passed, else 2 + ticks. */
SOTER_INLINE uint64_t soter_pack_due(int64_t due, int64_t now, int64_t tick) {
  if (due == INT64_MAX) {
    return 0U;
  }
  return due < now ? 1U : (uint64_t)(due - now) / (uint64_t)tick + 2U;
}

SOTER_INLINE int64_t soter_unpack_due(uint64_t packed, int64_t now, int64_t tick) {
  return packed == 0U ? INT64_MAX : now + ((int64_t)packed - 2) * tick;
}

/* Ticks since something, at most `most`. */
SOTER_INLINE uint64_t soter_pack_since(int64_t since, int64_t now, int64_t tick, uint64_t most) {
  const uint64_t ticks = (uint64_t)(now - since) / (uint64_t)tick;
  return ticks < most ? ticks : most;
}

/* Ticks since a publication, where every age matters: 0 never. */
SOTER_INLINE uint64_t soter_pack_stamp(int64_t stamp, int64_t now, int64_t tick) {
  return stamp == SOTER_NEVER ? 0U : (uint64_t)(now - stamp) / (uint64_t)tick + 1U;
}

SOTER_INLINE int64_t soter_unpack_stamp(uint64_t packed, int64_t now, int64_t tick) {
  return packed == 0U ? SOTER_NEVER : now - ((int64_t)packed - 1) * tick;
}

/* Where it matters only whether it is older than `most - 1` ticks: `most`, and never, are older. */
SOTER_INLINE int64_t soter_unpack_fresh(uint64_t packed, int64_t now, int64_t tick, uint64_t most) {
  return packed == most ? SOTER_NEVER : now - (int64_t)packed * tick;
}

#endif
