/* soter_publishers.hpp: which node a message of ROS 2 is from, and who is not heard.
 *
 * Purpose: from the identity that a message carries to the full name of its node, for the bridge
 * and the simulation; the nodes whose type or QoS keeps them from being heard, for diagnostics.
 * Some middlewares (Cyclone DDS) give messages an identity that the graph does not have. There a
 * message is of a node if all that is heard is of that one. Each of its publishers stands for one
 * identity: a further one may be of somebody who has just ended, and is taken when it comes twice.
 * Non-goals: nodes that lie about their name. C++17.
 */
#ifndef SOTER_PUBLISHERS_HPP
#define SOTER_PUBLISHERS_HPP

#include <rclcpp/rclcpp.hpp>

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace soter {

inline std::string full_name(const rclcpp::TopicEndpointInfo& endpoint) {
  const std::string& space = endpoint.node_namespace();
  return (space == "/" ? "" : space) + "/" + endpoint.node_name();
}

/* Which of these do not fit `type`, or `fits(their QoS)`; "": all do. */
template <class Fits>
inline std::string unmatched(const std::vector<rclcpp::TopicEndpointInfo>& all,
                             const std::string& type, const Fits& fits) {
  std::string told;
  for (const auto& endpoint : all) {
    const bool typed = endpoint.topic_type() == type;
    if (!typed || fits(endpoint.qos_profile()) == rclcpp::QoSCompatibility::Error) {
      told += (told.empty() ? "" : ", ") + full_name(endpoint) +
              (typed ? " (its QoS)" : " (" + endpoint.topic_type() + ")");
    }
  }
  return told;
}

/* Who publishes a topic: nodes by the identity that messages carry. */
class Publishers {
 public:
  Publishers(rclcpp::Node* node, const std::string& topic, const std::string& type)
      : node_(node), topic_(topic), type_(type) {}

  /* The full name of the node; "": nobody can tell. `matched`: how many publishers are heard. */
  std::string name_of(const rclcpp::MessageInfo& info, size_t matched) {
    const std::string id = hex(info.get_rmw_message_info().publisher_gid.data);
    if (known_.count(id) == 0U) {
      look(id, matched);
    } else {
      again_.clear();
    }
    const auto there = known_.find(id);
    return there == known_.end() ? "" : there->second;
  }

 private:
  void look(const std::string& id, size_t matched) {
    std::map<std::string, std::string> by_gid;
    std::set<std::string> names;
    std::string unclaimed;
    for (const auto& endpoint : node_->get_publishers_info_by_topic(topic_)) {
      const std::string gid = hex(endpoint.endpoint_gid());
      if (endpoint.topic_type() == type_) {
        names.insert(by_gid[gid] = full_name(endpoint));
        unclaimed = claimed_.count(gid) == 0U ? gid : unclaimed;
      }
    }
    const bool alone = names.size() == 1U && by_gid.size() == matched && names.count(UNKNOWN) == 0U;
    const auto own = by_gid.find(id);
    if (own != by_gid.end() && own->second != UNKNOWN) {
      known_[id] = own->second;
    } else if (alone && (!unclaimed.empty() || again_ == id)) {
      claimed_.insert(unclaimed);
      known_[id] = *names.begin();
    }
    again_ = alone ? id : "";
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

  static constexpr const char* UNKNOWN = "_NODE_NAMESPACE_UNKNOWN_/_NODE_NAME_UNKNOWN_";
  rclcpp::Node* const node_;
  const std::string topic_, type_;
  std::map<std::string, std::string> known_;
  std::set<std::string> claimed_; /* endpoints that an identity stands for */
  std::string again_;             /* who was not known, and nobody else spoke since */
};

} /* namespace soter */

#endif
