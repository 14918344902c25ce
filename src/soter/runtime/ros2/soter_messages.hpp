/* soter_messages.hpp: times of ROS 2 for the traits of topics, and messages from their bytes.
 *
 * Purpose: between builtin_interfaces and nanoseconds; what is whole. Some middlewares (Cyclone
 * DDS) hand on what they could read of bytes that are no value of a type, and the rest is zeros.
 * Non-goals: nodes. C++17.
 */
#ifndef SOTER_MESSAGES_HPP
#define SOTER_MESSAGES_HPP

#include "soter_stamp_numbers.h"

#include <builtin_interfaces/msg/time.hpp>
#include <rclcpp/serialization.hpp>
#include <rclcpp/serialized_message.hpp>

#include <cstdint>
#include <exception>

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

/* A message from its bytes; false: they are no value of its type, and nothing but one. A payload is
 * padded to four bytes. */
template <class Message>
inline bool whole(const rclcpp::SerializedMessage& bytes, Message* to) {
  const rclcpp::Serialization<Message> type;
  rclcpp::SerializedMessage again;
  try {
    type.deserialize_message(&bytes, to);
    type.serialize_message(to, &again);
  } catch (const std::exception&) {
    return false;
  }
  return (bytes.size() + 3U) / 4U == (again.size() + 3U) / 4U;
}

} /* namespace soter */

#endif
