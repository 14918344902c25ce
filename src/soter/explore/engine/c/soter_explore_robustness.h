/* soter_explore_robustness.h: what generated margins are written with.
 *
 * A margin is positive where a condition holds, negative where it does not, never 0; the smaller,
 * the nearer the values are to changing that. `scale` is the widest distance seen so far at one
 * comparison: what is compared in metres and what in radians count alike.
 */
#ifndef SOTER_EXPLORE_MARGIN_H
#define SOTER_EXPLORE_MARGIN_H

#include <float.h>

#include "soter_explore.h"

/* How far `left` and `right` are apart, in parts of the scale; never 0. */
SOTER_INLINE double soter_unprivileged(double left, double right, double* scale) {
  const double distance = fabs(left - right);
  if (!(distance <= DBL_MAX)) {
    return 1.0;
  }
  if (distance > *scale) {
    *scale = distance;
  }
  const double share = *scale > 0.0 ? distance / *scale : 0.0;
  return share > DBL_MIN ? share : DBL_MIN;
}

/* Of a comparison by size. */
SOTER_INLINE double soter_margin(bool holds, double left, double right, double* scale) {
  const double apart = soter_unprivileged(left, right, scale);
  return holds ? apart : -apart;
}

/* Of an equality: where it holds there is no distance. */
SOTER_INLINE double soter_equal_margin(bool holds, double left, double right, double* scale) {
  return holds ? 1.0 : -soter_unprivileged(left, right, scale);
}

#endif
