/* soter_messages.hpp: times of ROS 2 for the traits of topics.
 *
 * Purpose: between builtin_interfaces and nanoseconds. Non-goals: nodes. C++17.
 */
#ifndef SOTER_MESSAGES_HPP
#define SOTER_MESSAGES_HPP

#include "soter_stamp_numbers.h"

#include <builtin_interfaces/msg/time.hpp>

#include <cstdint>

namespace soter {

/* 0 where it is no time: its ns are a second, or more. */
inline int64_t ns_of(const builtin_interfaces::msg::Time& t) {
  return t.nanosec < 1000000000U ? static_cast<int64_t>(t.sec) * 1000000000 + t.nanosec : 0;
}

inline builtin_interfaces::msg::Time stamp_of(int64_t ns) {
  builtin_interfaces::msg::Time t;
  if (ns > 0 && ns / 1000000000 <= INT32_MAX) {
    t.sec = static_cast<int32_t>(ns / 1000000000);
    t.nanosec = static_cast<uint32_t>(ns % 1000000000);
  }
  return t;
}

} /* namespace soter */

#endif
