/* Vectors of doubles: a box a lane.
 * Purpose: do the same with several boxes at once. Every operation on a lane is the one on a
 * double, rounded once. Non-goals: a whole hold (soter_reach_lanes.c). */
#ifndef SOTER_REACH_LANES_H
#define SOTER_REACH_LANES_H

#include "soter_reach_ball.h"

#if defined(__AVX__)
#include <immintrin.h>
#endif

typedef double lanes __attribute__((vector_size(sizeof(double) * LANES)));
typedef int64_t truths __attribute__((vector_size(sizeof(int64_t) * LANES))); /* 0, or -1 */

ALWAYS lanes all(double x) {
  return x - (lanes){0};
}

ALWAYS lanes either(truths on, lanes a, lanes b) {
  return (lanes)((on & (truths)a) | (~on & (truths)b));
}

/* As soter_least and soter_most: so do these instructions, NaN and zeros included. */
ALWAYS lanes least(lanes a, lanes b) {
#if defined(__AVX512F__)
  return (lanes)_mm512_min_pd((__m512d)b, (__m512d)a);
#elif defined(__AVX__)
  return (lanes)_mm256_min_pd((__m256d)b, (__m256d)a);
#else
  return either(b < a, b, a);
#endif
}

ALWAYS lanes most(lanes a, lanes b) {
#if defined(__AVX512F__)
  return (lanes)_mm512_max_pd((__m512d)b, (__m512d)a);
#elif defined(__AVX__)
  return (lanes)_mm256_max_pd((__m256d)b, (__m256d)a);
#else
  return either(b > a, b, a);
#endif
}

ALWAYS lanes size(lanes x) {
  return (lanes)((truths)x & INT64_MAX);
}

ALWAYS lanes up(lanes x) {
  return x + (size(x) * EPS + TINY);
}

ALWAYS lanes down(lanes x) {
  return x - (size(x) * EPS + TINY);
}

#endif
