/* soter_stamp_numbers.hpp: stamps that are numbers, in whatever unit a mapping says.
 *
 * Purpose: nanoseconds of them. Non-goals: times of ROS (soter_messages.hpp of each). C++11.
 */
#ifndef SOTER_STAMP_NUMBERS_HPP
#define SOTER_STAMP_NUMBERS_HPP

#include <cstdint>

namespace soter {

/* A stamp that is a number of `numerator`/`denominator` ns; 0 where it is no time. */
template <class Number>
inline int64_t ns_of_number(Number number, int64_t numerator, int64_t denominator) {
  const long double ns =
      static_cast<long double>(number) * numerator / static_cast<long double>(denominator);
  return ns > 0.0L && ns < 4.0e18L ? static_cast<int64_t>(ns) : 0; /* NaN is no time either */
}

} /* namespace soter */

#endif
