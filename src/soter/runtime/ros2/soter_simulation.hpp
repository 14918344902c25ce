/* soter_simulation.hpp: the program under /clock, in rclcpp.
 *
 * Purpose: the node NAME_simulation of a package that `soter build --target ros2` writes: for
 * simulators, for bags that are played. soter_simulation_core.hpp does the work.
 * Non-goals: real time (soter_bridge.hpp). C++17.
 */
#ifndef SOTER_SIMULATION_HPP
#define SOTER_SIMULATION_HPP

#include "soter_messages.hpp"
#include "soter_publishers.hpp"
#include "soter_simulation_core.hpp"

#include <diagnostic_msgs/msg/diagnostic_array.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rosgraph_msgs/msg/clock.hpp>
#include <std_msgs/msg/string.hpp>

#include <memory>
#include <string>

namespace soter {

template <class T>
class SimulatedIn : public SimulatedInput<T> {
 public:
  typedef typename T::Message Message;

  explicit SimulatedIn(rclcpp::Node* node)
      : node_(node),
        publishers_(node, T::topic(), rosidl_generator_traits::name<Message>()),
        subscription_(node->create_subscription<Message>(
            T::topic(), T::qos(),
            [this](std::shared_ptr<const rclcpp::SerializedMessage> bytes,
                   const rclcpp::MessageInfo& info) {
              Message m;
              if (whole(*bytes, &m)) {
                this->take(m, publishers_.name_of(info, subscription_->get_publisher_count()));
              } else {
                refused("bytes are no value of its type");
              }
            })) {}

 private:
  void refused(const char* why) override {
    RCLCPP_WARN_THROTTLE(node_->get_logger(), *node_->get_clock(), 1000, "%s: %s", T::topic(), why);
  }

  rclcpp::Node* const node_;
  Publishers publishers_;
  std::shared_ptr<rclcpp::Subscription<Message>> subscription_;
};

template <class T>
class SimulatedOut : public SimulatedOutput<T> {
 public:
  typedef typename T::Message Message;

  explicit SimulatedOut(rclcpp::Node* node)
      : publisher_(node->create_publisher<Message>(T::topic(), T::qos())) {}

 private:
  void publish(const Message& message) override { publisher_->publish(message); }

  std::shared_ptr<rclcpp::Publisher<Message>> publisher_;
};

class Simulation : public SimulationCore {
 public:
  explicit Simulation(const std::string& name) : node_(std::make_shared<rclcpp::Node>(name)) {}

  template <class T>
  void in() {
    add(new SimulatedIn<T>(node_.get()));
  }

  template <class T>
  void out() {
    add(new SimulatedOut<T>(node_.get()));
  }

  /* As `soter run` exits; 1: it cannot run. */
  int run() {
    using rosgraph_msgs::msg::Clock;
    const double until_s = node_->declare_parameter<double>("until", double(UNTIL_S));
    const int64_t seed = node_->declare_parameter<int64_t>("seed", 1);
    if (const char* const wrong = prepare(until_s, seed)) {
      RCLCPP_FATAL(node_->get_logger(), "not run: %s", wrong);
      return 1;
    }
    result_ = node_->create_publisher<std_msgs::msg::String>(
        "~/result", rclcpp::QoS(1).reliable().transient_local());
    diagnostics_ = node_->create_publisher<diagnostic_msgs::msg::DiagnosticArray>(
        "/diagnostics", rclcpp::QoS(1).reliable());
    /* a /clock that is missed is none the less: the next one runs its instants, too */
    const auto ticks = node_->create_subscription<Clock>(
        "/clock", rclcpp::QoS(1000).best_effort(),
        [this](std::shared_ptr<const Clock> m, const rclcpp::MessageInfo&) { on(*m); });
    rclcpp::spin(node_);
    if (!ended()) {
      say();
    }
    return exit_code();
  }

 private:
  void on(const rosgraph_msgs::msg::Clock& message) {
    if (clock(ns_of(message.clock))) {
      say();
      rclcpp::shutdown();
    }
  }

  void began_anew() override {
    RCLCPP_WARN(node_->get_logger(), "/clock went back: the program begins anew, in SC");
  }

  void mode_changed() override {
    diagnostic_msgs::msg::DiagnosticArray all;
    all.header.stamp = stamp_of(instant_ns());
    modes(&all);
    diagnostics_->publish(all);
  }

  void say() {
    std_msgs::msg::String m;
    m.data = result();
    if (rclcpp::ok()) {
      result_->publish(m);
    }
    RCLCPP_INFO(node_->get_logger(), "%s: %s", APP_PROGRAM->name, m.data.c_str());
  }

  const std::shared_ptr<rclcpp::Node> node_;
  std::shared_ptr<rclcpp::Publisher<std_msgs::msg::String>> result_;
  std::shared_ptr<rclcpp::Publisher<diagnostic_msgs::msg::DiagnosticArray>> diagnostics_;
};

} /* namespace soter */

#endif
