/* soter_messages.hpp: what messages of ROS 1 say of themselves, for the nodes and their traits.
 *
 * Purpose: between ros::Time and nanoseconds; who sends old ones again. Non-goals: nodes. C++11.
 */
#ifndef SOTER_MESSAGES_HPP
#define SOTER_MESSAGES_HPP

#include "soter_stamp_numbers.h"

#include <ros/datatypes.h>
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

/* Whether a publisher, as its connection says, sends its last message again, however old, to
 * whoever connects. */
inline bool is_latched(const ros::M_string& connection) {
  const ros::M_string::const_iterator found = connection.find("latching");
  return found != connection.end() && found->second == "1";
}

} /* namespace soter */

#endif
