/* soter_messages.hpp: times of ROS 2 for the traits of topics.
 *
 * Purpose: between builtin_interfaces and nanoseconds. Non-goals: nodes. C++17.
 */
#ifndef SOTER_MESSAGES_HPP
#define SOTER_MESSAGES_HPP

#include <builtin_interfaces/msg/time.hpp>

#include <cstdint>

namespace soter {

inline int64_t ns_of(const builtin_interfaces::msg::Time& t) {
  return static_cast<int64_t>(t.sec) * 1000000000 + static_cast<int64_t>(t.nanosec);
}

inline builtin_interfaces::msg::Time stamp_of(int64_t ns) {
  builtin_interfaces::msg::Time t;
  if (ns > 0 && ns / 1000000000 <= INT32_MAX) {
    t.sec = static_cast<int32_t>(ns / 1000000000);
    t.nanosec = static_cast<uint32_t>(ns % 1000000000);
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
