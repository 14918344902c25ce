/* soter_publishers.hpp: which node a message of ROS 2 is from.
 *
 * Purpose: from the identity that a message carries to the full name of its node, for the bridge
 * and the simulation. Non-goals: nodes that lie about their name. C++17.
 */
#ifndef SOTER_PUBLISHERS_HPP
#define SOTER_PUBLISHERS_HPP

#include <rclcpp/rclcpp.hpp>

#include <cstdint>
#include <map>
#include <string>

namespace soter {

/* Who publishes a topic: nodes by the identity that messages carry. */
class Publishers {
 public:
  Publishers(rclcpp::Node* node, const std::string& topic) : node_(node), topic_(topic) {}

  /* The full name of the node, or the identity in hex where the graph does not know it. */
  std::string name_of(const rclcpp::MessageInfo& info) {
    const std::string id = hex(info.get_rmw_message_info().publisher_gid.data);
    if (known_.count(id) == 0U) {
      look();
    }
    const auto there = known_.find(id);
    return there == known_.end() ? id : there->second;
  }

 private:
  void look() {
    known_.clear();
    for (const auto& endpoint : node_->get_publishers_info_by_topic(topic_)) {
      known_[hex(endpoint.endpoint_gid())] = name(endpoint);
    }
  }

  template <class Bytes>
  static std::string hex(const Bytes& bytes) {
    static const char* const digits = "0123456789abcdef";
    std::string text;
    for (const uint8_t byte : bytes) {
      text += digits[byte >> 4];
      text += digits[byte & 15];
    }
    return text;
  }

  static std::string name(const rclcpp::TopicEndpointInfo& endpoint) {
    const std::string& space = endpoint.node_namespace();
    return (space == "/" ? "" : space) + "/" + endpoint.node_name();
  }

  rclcpp::Node* const node_;
  const std::string topic_;
  std::map<std::string, std::string> known_;
};

} /* namespace soter */

#endif
