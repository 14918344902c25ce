/* soter_messages.hpp: times of ROS 1 for the traits of topics.
 *
 * Purpose: between ros::Time and nanoseconds. Non-goals: nodes. C++11.
 */
#ifndef SOTER_MESSAGES_HPP
#define SOTER_MESSAGES_HPP

#include <ros/time.h>

#include <cstdint>

namespace soter {

inline int64_t ns_of(const ros::Time& t) {
  return static_cast<int64_t>(t.sec) * 1000000000 + static_cast<int64_t>(t.nsec);
}

inline ros::Time stamp_of(int64_t ns) {
  ros::Time t;
  if (ns > 0 && ns / 1000000000 <= UINT32_MAX) {
    t.sec = static_cast<uint32_t>(ns / 1000000000);
    t.nsec = static_cast<uint32_t>(ns % 1000000000);
  }
  return t;
}

template <class Number>
inline int64_t ns_of_number(Number number, int64_t numerator, int64_t denominator) {
  const long double ns =
      static_cast<long double>(number) * numerator / static_cast<long double>(denominator);
  return ns > 0.0L && ns < 4.0e18L ? static_cast<int64_t>(ns) : 0; /* NaN is no time either */
}

} /* namespace soter */

#endif
