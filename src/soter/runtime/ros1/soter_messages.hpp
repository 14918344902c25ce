/* soter_messages.hpp: what the traits of topics use.
 *
 * Purpose: stamps that are numbers. Non-goals: nodes. C++11.
 */
#ifndef SOTER_MESSAGES_HPP
#define SOTER_MESSAGES_HPP

#include <ros/time.h>

#include <cstdint>

namespace soter {

/* A stamp that is a number of `numerator`/`denominator` ns; zero where it is no time. */
template <class Number>
inline ros::Time time_of(Number number, int64_t numerator, int64_t denominator) {
  const long double ns =
      static_cast<long double>(number) * numerator / static_cast<long double>(denominator);
  ros::Time at;
  if (ns > 0.0L && ns < 4.0e18L) { /* NaN is no time either */
    const uint64_t whole = static_cast<uint64_t>(ns);
    at.sec = static_cast<uint32_t>(whole / 1000000000U);
    at.nsec = static_cast<uint32_t>(whole % 1000000000U);
  }
  return at;
}

} /* namespace soter */

#endif
