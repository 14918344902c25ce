/* rclcpp_stub.hpp: what of rclcpp a generated bridge uses, declared as rclcpp (Humble) declares it.
 *
 * Purpose: bridges for ROS 2 are type-checked where no rclcpp is; nothing of it runs.
 * Non-goals: everything else.
 */
#ifndef RCLCPP_STUB_HPP
#define RCLCPP_STUB_HPP

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#define RMW_GID_STORAGE_SIZE 16U
struct rmw_gid_t {
  const char* implementation_identifier;
  uint8_t data[RMW_GID_STORAGE_SIZE];
};
struct rmw_message_info_t {
  rmw_gid_t publisher_gid;
};

namespace rcl_interfaces::msg {
struct ParameterDescriptor {
  bool read_only;
};
} /* namespace rcl_interfaces::msg */

namespace rclcpp {

namespace exceptions {
class InvalidParameterTypeException : public std::runtime_error {};
} /* namespace exceptions */

class InitOptions {};
enum class SignalHandlerOptions { All, SigInt, SigTerm, None };
void init(int argc, char const* const* argv, const InitOptions& options = InitOptions(),
          SignalHandlerOptions handlers = SignalHandlerOptions::All);
bool ok();
bool shutdown();

class MessageInfo {
 public:
  const rmw_message_info_t& get_rmw_message_info() const;
};

struct KeepLast {
  explicit KeepLast(size_t depth);
};
struct KeepAll {};
class QoS {
 public:
  QoS(size_t depth);
  QoS(KeepLast history);
  QoS(KeepAll history);
  QoS& reliable();
  QoS& best_effort();
  QoS& transient_local();
};
enum class QoSCompatibility { Ok, Warning, Error };
struct QoSCheckCompatibleResult {
  QoSCompatibility compatibility;
};
QoSCheckCompatibleResult qos_check_compatible(const QoS& publisher, const QoS& subscription);

class TopicEndpointInfo {
 public:
  const std::string& topic_type() const;
  const QoS& qos_profile() const;
  const std::string& node_name() const;
  const std::string& node_namespace() const;
  const std::array<uint8_t, RMW_GID_STORAGE_SIZE>& endpoint_gid() const;
};

enum class CallbackGroupType { MutuallyExclusive, Reentrant };
class CallbackGroup;
struct SubscriptionOptions {
  std::shared_ptr<CallbackGroup> callback_group;
};

class SerializedMessage {
 public:
  size_t size() const;
};
template <class M>
class Serialization {
 public:
  void serialize_message(const void* message, SerializedMessage* bytes) const;
  void deserialize_message(const SerializedMessage* bytes, void* message) const;
};

template <class M>
class Subscription {
 public:
  size_t get_publisher_count() const;
  QoS get_actual_qos() const;
};
template <class M>
class Publisher {
 public:
  void publish(const M& message);
  QoS get_actual_qos() const;
};

class Time {
 public:
  int64_t nanoseconds() const;
};
class Parameter {
 public:
  bool as_bool() const;
};
class Logger {};
class Clock {};
template <class... Arguments>
void stub_log(const Logger&, const char*, Arguments...);
#define RCLCPP_FATAL(logger, ...) rclcpp::stub_log(logger, __VA_ARGS__)
#define RCLCPP_WARN(logger, ...) rclcpp::stub_log(logger, __VA_ARGS__)
#define RCLCPP_INFO(logger, ...) rclcpp::stub_log(logger, __VA_ARGS__)
#define RCLCPP_WARN_THROTTLE(logger, clock, ms, ...) \
  rclcpp::stub_throttle(logger, clock, ms, __VA_ARGS__)
template <class... Arguments>
void stub_throttle(const Logger&, Clock&, int64_t, const char*, Arguments...);

class Node {
 public:
  explicit Node(const std::string& name);
  const char* get_fully_qualified_name() const;
  Logger get_logger() const;
  Time now() const;
  std::shared_ptr<Clock> get_clock();
  Parameter get_parameter(const std::string& name) const;
  template <class T>
  auto declare_parameter(const std::string& name, const T& value,
                         const rcl_interfaces::msg::ParameterDescriptor& descriptor = {}) -> T;
  std::vector<TopicEndpointInfo> get_publishers_info_by_topic(const std::string& topic,
                                                              bool no_mangle = false) const;
  std::vector<TopicEndpointInfo> get_subscriptions_info_by_topic(const std::string& topic,
                                                                 bool no_mangle = false) const;
  std::shared_ptr<CallbackGroup> create_callback_group(
      CallbackGroupType type, bool automatically_add_to_executor_with_node = true);
  template <class M>
  std::shared_ptr<Publisher<M>> create_publisher(const std::string& topic, const QoS& qos);
  template <class M>
  std::shared_ptr<Subscription<M>> create_subscription(
      const std::string& topic, const QoS& qos,
      std::function<void(std::shared_ptr<const M>, const MessageInfo&)> callback,
      const SubscriptionOptions& options = SubscriptionOptions());
  template <class M>
  std::shared_ptr<Subscription<M>> create_subscription(
      const std::string& topic, const QoS& qos,
      std::function<void(std::shared_ptr<const SerializedMessage>, const MessageInfo&)> callback,
      const SubscriptionOptions& options = SubscriptionOptions());
};

void spin(std::shared_ptr<Node> node);

namespace executors {
class MultiThreadedExecutor {
 public:
  void add_node(std::shared_ptr<Node> node);
  void spin();
};
} /* namespace executors */

} /* namespace rclcpp */

#endif
