/* soter_stamp_numbers.h: stamps that are numbers, in whatever unit a mapping says.
 *
 * Purpose: nanoseconds of them, for every bridge. Non-goals: times of ROS. C99, and C++11.
 */
#ifndef SOTER_STAMP_NUMBERS_H
#define SOTER_STAMP_NUMBERS_H

#include <stdint.h>

/* A stamp that is a number of `numerator`/`denominator` ns; -1 where it is no time. */
static inline int64_t soter_ns_of_number(long double number, int64_t numerator,
                                         int64_t denominator) {
  const long double ns = number * (long double)numerator / (long double)denominator;
  return ns >= 0.0L && ns < 4.0e18L ? (int64_t)ns : -1; /* NaN is no time either */
}

#endif
