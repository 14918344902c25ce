/* either_ros.hpp: what the nodes of this folder need of rclcpp (with ROS2 defined) or of roscpp.
 *
 * Purpose: one text of each node for both. Non-goals: everything else.
 */
#ifndef EITHER_ROS_HPP
#define EITHER_ROS_HPP

#include <time.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#ifdef ROS2
#include <geometry_msgs/msg/twist.hpp>
#include <nav_msgs/msg/odometry.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rosgraph_msgs/msg/clock.hpp>
#include <std_msgs/msg/float64.hpp>
using geometry_msgs::msg::Twist;
using nav_msgs::msg::Odometry;
using rosgraph_msgs::msg::Clock;
using std_msgs::msg::Float64;
#else
#include <geometry_msgs/Twist.h>
#include <nav_msgs/Odometry.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Clock.h>
#include <std_msgs/Float64.h>
using geometry_msgs::Twist;
using nav_msgs::Odometry;
using rosgraph_msgs::Clock;
using std_msgs::Float64;
#endif

inline int64_t now_ns(clockid_t clock = CLOCK_MONOTONIC) {
  struct timespec t;
  clock_gettime(clock, &t);
  return static_cast<int64_t>(t.tv_sec) * 1000000000 + t.tv_nsec;
}

#ifdef ROS2

inline builtin_interfaces::msg::Time time_of(int64_t ns) {
  return rclcpp::Time(ns);
}

template <class M>
class Out {
 public:
  Out(rclcpp::Node& node, const char* topic, size_t depth)
      : publisher_(node.create_publisher<M>(topic, depth)) {}
  void publish(const M& message) const { publisher_->publish(message); }
  size_t listeners() const { return publisher_->get_subscription_count(); }

 private:
  std::shared_ptr<rclcpp::Publisher<M>> publisher_;
};

class Node {
 public:
  Node(int count, char** words, const char* name) {
    rclcpp::init(count, words);
    node_ = std::make_shared<rclcpp::Node>(name);
    executor_.reset(new rclcpp::executors::SingleThreadedExecutor);
    executor_->add_node(node_);
  }
  static bool ok() { return rclcpp::ok(); }

  template <class M>
  Out<M> out(const char* topic, size_t depth) {
    return Out<M>(*node_, topic, depth);
  }

  template <class M>
  void in(const char* topic, std::function<void(const M&)> hear) {
    kept_.push_back(node_->create_subscription<M>(topic, 1, [hear](const M& m) { hear(m); }));
  }

  /* Takes what comes, for that long. */
  void spin(int64_t ns) {
    const int64_t end = now_ns() + ns;
    for (int64_t left; ok() && (left = end - now_ns()) > 0;) {
      executor_->spin_once(std::chrono::nanoseconds(left));
    }
  }

 private:
  std::shared_ptr<rclcpp::Node> node_;
  std::unique_ptr<rclcpp::executors::SingleThreadedExecutor> executor_;
  std::vector<std::shared_ptr<rclcpp::SubscriptionBase>> kept_;
};

#else

inline ros::Time time_of(int64_t ns) {
  return ros::Time(static_cast<uint32_t>(ns / 1000000000), static_cast<uint32_t>(ns % 1000000000));
}

template <class M>
class Out {
 public:
  Out(ros::NodeHandle& node, const char* topic, uint32_t depth)
      : publisher_(node.advertise<M>(topic, depth)) {}
  void publish(const M& message) const { publisher_.publish(message); }
  size_t listeners() const { return publisher_.getNumSubscribers(); }

 private:
  ros::Publisher publisher_;
};

class Node {
 public:
  Node(int count, char** words, const char* name) {
    ros::init(count, words, name);
    node_.reset(new ros::NodeHandle);
  }
  static bool ok() { return ros::ok(); }

  template <class M>
  Out<M> out(const char* topic, uint32_t depth) {
    return Out<M>(*node_, topic, depth);
  }

  template <class M>
  void in(const char* topic, std::function<void(const M&)> hear) {
    const boost::function<void(const boost::shared_ptr<const M>&)> taken =
        [hear](const boost::shared_ptr<const M>& m) { hear(*m); };
    kept_.push_back(
        node_->subscribe<M>(topic, 1, taken, ros::VoidPtr(), ros::TransportHints().tcpNoDelay()));
  }

  /* Takes what comes, for that long. */
  void spin(int64_t ns) {
    const int64_t end = now_ns() + ns;
    for (int64_t left; ok() && (left = end - now_ns()) > 0;) {
      ros::getGlobalCallbackQueue()->callAvailable(
          ros::WallDuration(static_cast<double>(left) * 1e-9));
    }
  }

 private:
  std::unique_ptr<ros::NodeHandle> node_;
  std::vector<ros::Subscriber> kept_;
};

#endif
#endif
