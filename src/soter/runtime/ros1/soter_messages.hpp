/* soter_messages.hpp: times of ROS 1 for the traits of topics.
 *
 * Purpose: between ros::Time and nanoseconds. Non-goals: nodes. C++11.
 */
#ifndef SOTER_MESSAGES_HPP
#define SOTER_MESSAGES_HPP

#include "soter_stamp_numbers.h"

#include <ros/time.h>

#include <cstdint>

namespace soter {

/* 0 where it is no time: its ns are a second, or more. */
inline int64_t ns_of(const ros::Time& t) {
  return t.nsec < 1000000000U ? static_cast<int64_t>(t.sec) * 1000000000 + t.nsec : 0;
}

inline ros::Time stamp_of(int64_t ns) {
  ros::Time t;
  if (ns > 0 && ns / 1000000000 <= UINT32_MAX) {
    t.sec = static_cast<uint32_t>(ns / 1000000000);
    t.nsec = static_cast<uint32_t>(ns % 1000000000);
  }
  return t;
}

} /* namespace soter */

#endif
