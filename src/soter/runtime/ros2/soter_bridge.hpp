/* soter_bridge.hpp: the bridge in rclcpp.
 *
 * Purpose: subscriptions, publications, parameters and /diagnostics around soter_bridge_core.hpp,
 * for a package that `soter build --target ros2` writes. Stamps are judged by the machine's clock,
 * whatever use_sim_time becomes while it runs.
 * Non-goals: what is judged (the core), simulated time (soter_simulation.hpp). C++17.
 */
#ifndef SOTER_BRIDGE_HPP
#define SOTER_BRIDGE_HPP

#include "soter_bridge_core.hpp"
#include "soter_messages.hpp"
#include "soter_publishers.hpp"

#include <diagnostic_msgs/msg/diagnostic_array.hpp>
#include <rclcpp/rclcpp.hpp>

#include <chrono>
#include <cmath>
#include <memory>
#include <thread>

namespace soter {

inline int64_t wall_ns() {
  using std::chrono::nanoseconds;
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<nanoseconds>(now).count();
}

/* A topic of ROS that is bridged, either way. */
class Bridged {
 public:
  virtual ~Bridged() = default;
  virtual const char* open(const std::string& folder) = 0;
  virtual Status status() = 0;
  /* Of one that goes out: until the end, on a thread of its own. */
  virtual void serve() {}
};

template <class T>
class BridgedIn : public Bridged {
 public:
  typedef typename T::Message Message;

  BridgedIn(rclcpp::Node* node, int64_t clock_error_ns)
      : node_(node),
        inward_(clock_error_ns),
        publishers_(node, T::topic(), rosidl_generator_traits::name<Message>()) {}

  const char* open(const std::string& folder) override {
    const char* const wrong = inward_.open(folder);
    if (wrong == nullptr) {
      rclcpp::SubscriptionOptions options; /* a flood on one topic is a flood on one thread */
      options.callback_group =
          node_->create_callback_group(rclcpp::CallbackGroupType::MutuallyExclusive);
      subscription_ = node_->create_subscription<Message>(
          T::topic(), T::qos(),
          [this](std::shared_ptr<const rclcpp::SerializedMessage> bytes,
                 const rclcpp::MessageInfo& info) {
            const int64_t now = monotonic_ns();
            const size_t matched = subscription_->get_publisher_count();
            Message m;
            if (whole(*bytes, &m)) {
              inward_.take(m, publishers_.name_of(info, matched), now, wall_ns());
            } else {
              inward_.refuse_torn();
            }
          },
          options);
    }
    return wrong;
  }

  Status status() override {
    /* The actual one: a deadline of T::qos() is 0, of the graph infinite, which would not fit. */
    const rclcpp::QoS own = subscription_->get_actual_qos();
    inward_.unheard(unmatched(node_->get_publishers_info_by_topic(T::topic()),
                              rosidl_generator_traits::name<Message>(),
                              [&own](const rclcpp::QoS& of) {
                                return rclcpp::qos_check_compatible(of, own).compatibility;
                              }));
    return inward_.status();
  }

 private:
  rclcpp::Node* const node_;
  Inward<T> inward_;
  Publishers publishers_;
  std::shared_ptr<rclcpp::Subscription<Message>> subscription_;
};

template <class T>
class BridgedOut : public Bridged {
 public:
  typedef typename T::Message Message;

  explicit BridgedOut(rclcpp::Node* node) : node_(node) {}

  const char* open(const std::string& folder) override {
    publisher_ = node_->create_publisher<Message>(T::topic(), T::qos());
    return outward_.open(folder);
  }

  void serve() override {
    outward_.serve([] { return rclcpp::ok() && stage() == 1; }, wall_ns,
                   [this](const typename T::Value& value, int64_t stamp_ns) {
                     Message message;
                     T::convert(value, stamp_ns, &message);
                     publisher_->publish(message);
                   });
  }

  Status status() override {
    std::string names;
    bool own = true; /* once it is this node */
    for (const auto& endpoint : node_->get_publishers_info_by_topic(T::topic())) {
      const std::string name = full_name(endpoint);
      if (own && name == node_->get_fully_qualified_name()) {
        own = false;
      } else {
        names += (names.empty() ? "" : ", ") + name;
      }
    }
    const rclcpp::QoS actual = publisher_->get_actual_qos();
    outward_.others(
        names,
        unmatched(node_->get_subscriptions_info_by_topic(T::topic()),
                  rosidl_generator_traits::name<Message>(), [&actual](const rclcpp::QoS& of) {
                    return rclcpp::qos_check_compatible(actual, of).compatibility;
                  }));
    return outward_.status();
  }

 private:
  rclcpp::Node* const node_;
  std::shared_ptr<rclcpp::Publisher<Message>> publisher_;
  Outward<T> outward_;
};

class Bridge {
 public:
  static constexpr int64_t DIAGNOSTICS_NS = 1000000000;

  Bridge(const std::string& name, const StatusNames& names)
      : trusted_(names), node_(std::make_shared<rclcpp::Node>(name)) {}

  /* False, and said, where it cannot run. */
  bool begin() {
    if (node_->get_parameter("use_sim_time").as_bool()) {
      RCLCPP_FATAL(node_->get_logger(),
                   "use_sim_time is set, and the trusted part runs on the machine's clock: under "
                   "/clock start the simulation node");
      return false;
    }
    double clock_error_s = -1.0;
    rcl_interfaces::msg::ParameterDescriptor fixed; /* what is set later would be for nothing */
    fixed.read_only = true;
    folder_ = node_->declare_parameter<std::string>("channels", "", fixed);
    try {
      clock_error_s = node_->declare_parameter<double>("clock_error", 0.0, fixed);
    } catch (const rclcpp::exceptions::InvalidParameterTypeException&) { /* said below */
    }
    if (folder_.empty()) {
      RCLCPP_FATAL(node_->get_logger(),
                   "the parameter channels is not set: the folder of the trusted part's channels");
      return false;
    }
    if (!(clock_error_s >= 0.0 && clock_error_s <= 1.0)) {
      RCLCPP_FATAL(node_->get_logger(), "the parameter clock_error is no time from 0.0 to 1.0 s");
      return false;
    }
    clock_error_ns_ = std::llround(clock_error_s * 1e9);
    diagnostics_ = node_->create_publisher<diagnostic_msgs::msg::DiagnosticArray>(
        "/diagnostics", rclcpp::QoS(1).reliable());
    return true;
  }

  template <class T>
  void in() {
    topics_.emplace_back(new BridgedIn<T>(node_.get(), clock_error_ns_));
  }

  template <class T>
  void out() {
    topics_.emplace_back(new BridgedOut<T>(node_.get()));
  }

  int run() {
    const char* wrong = trusted_.open(folder_);
    for (size_t k = 0; wrong == nullptr && k < topics_.size(); k++) {
      wrong = topics_[k]->open(folder_);
    }
    if (wrong != nullptr) {
      RCLCPP_FATAL(node_->get_logger(), "a channel in `%s` cannot be opened: %s", folder_.c_str(),
                   wrong);
      return 1;
    }
    std::vector<std::thread> threads;
    stage() = 1;
    threads.emplace_back(&Bridge::turns, this);
    for (const std::unique_ptr<Bridged>& topic : topics_) {
      threads.emplace_back(&Bridged::serve, topic.get());
    }
    rclcpp::executors::MultiThreadedExecutor executor;
    executor.add_node(node_);
    std::thread spinning([&executor] { executor.spin(); });
    for (std::thread& thread : threads) {
      thread.join();
    }
    soter_process_ending();
    std::this_thread::sleep_for(
        std::chrono::milliseconds(100)); /* what was published last goes out */
    rclcpp::shutdown();
    spinning.join();
    return 0;
  }

 private:
  void turns() {
    int64_t told = monotonic_ns();
    while (rclcpp::ok() && stage() == 1) {
      const bool changed = trusted_.hear();
      const int64_t now = monotonic_ns();
      if (changed || now - told >= DIAGNOSTICS_NS) {
        diagnose();
        told = now;
      }
    }
  }

  void diagnose() {
    std::vector<Status> all = trusted_.statuses();
    for (const std::unique_ptr<Bridged>& topic : topics_) {
      all.push_back(topic->status());
    }
    diagnostic_msgs::msg::DiagnosticArray message;
    message.header.stamp = stamp_of(wall_ns());
    fill(all, &message);
    diagnostics_->publish(message);
  }

  TrustedPart trusted_;
  const std::shared_ptr<rclcpp::Node> node_;
  std::string folder_;
  int64_t clock_error_ns_ = 0;
  std::shared_ptr<rclcpp::Publisher<diagnostic_msgs::msg::DiagnosticArray>> diagnostics_;
  std::vector<std::unique_ptr<Bridged>> topics_;
};

} /* namespace soter */

#endif
