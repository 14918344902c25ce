/* soter_simulation.hpp: the program under /clock, in roscpp.
 *
 * Purpose: the node NAME_simulation of a package that `soter build --target ros1` writes: for
 * Gazebo, for bags that are played, for tests. soter_simulation_core.hpp does the work.
 * Non-goals: real time (soter_bridge.hpp). C++11.
 */
#ifndef SOTER_SIMULATION_HPP
#define SOTER_SIMULATION_HPP

#include "soter_messages.hpp"
#include "soter_simulation_core.hpp"

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Clock.h>
#include <std_msgs/String.h>

namespace soter {

template <class T>
class SimulatedIn : public SimulatedInput<T> {
 public:
  explicit SimulatedIn(ros::NodeHandle* node)
      : subscriber_(node->subscribe(T::topic(), 1, &SimulatedIn::on, this,
                                    ros::TransportHints().tcpNoDelay())) {}

 private:
  void on(const ros::MessageEvent<typename T::Message const>& event) {
    if (!T::stamped() && is_latched(event.getConnectionHeader())) {
      refused("a latched message has no stamp: nobody knows how old it is");
      return;
    }
    this->take(*event.getConstMessage(), event.getPublisherName());
  }

  void refused(const char* why) override { ROS_WARN_THROTTLE(1.0, "%s: %s", T::topic(), why); }

  ros::Subscriber subscriber_;
};

template <class T>
class SimulatedOut : public SimulatedOutput<T> {
 public:
  explicit SimulatedOut(ros::NodeHandle* node)
      : publisher_(node->advertise<typename T::Message>(T::topic(), 10)) {}

 private:
  void publish(const typename T::Message& message) override { publisher_.publish(message); }

  ros::Publisher publisher_;
};

class Simulation : public SimulationCore {
 public:
  Simulation() : own_("~") {}

  template <class T>
  void in() {
    add(new SimulatedIn<T>(&node_));
  }

  template <class T>
  void out() {
    add(new SimulatedOut<T>(&node_));
  }

  /* As `soter run` exits; 1: it cannot run. */
  int run() {
    double until_s = 0.0;
    int seed = 1;
    own_.param<double>("until", until_s, static_cast<double>(UNTIL_S));
    own_.param<int>("seed", seed, 1);
    if (const char* const wrong = prepare(until_s, seed)) {
      ROS_FATAL("not run: %s", wrong);
      return 1;
    }
    result_ = own_.advertise<std_msgs::String>("result", 1, true);
    diagnostics_ = node_.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 1);
    const ros::Subscriber clock = node_.subscribe("/clock", 1000, &Simulation::on, this);
    ros::spin();
    if (!ended()) {
      say();
    }
    return exit_code();
  }

 private:
  void on(const rosgraph_msgs::Clock::ConstPtr& message) {
    if (clock(static_cast<int64_t>(message->clock.toNSec()))) {
      say();
      ros::requestShutdown();
    }
  }

  void began_anew() override { ROS_WARN("/clock went back: the program begins anew, in SC"); }

  void mode_changed() override {
    diagnostic_msgs::DiagnosticArray all;
    all.header.stamp = stamp_of(instant_ns());
    modes(&all);
    diagnostics_.publish(all);
  }

  void say() {
    std_msgs::String m;
    m.data = result();
    result_.publish(m);
    ROS_INFO("%s: %s", APP_PROGRAM->name, m.data.c_str());
  }

  ros::NodeHandle node_, own_;
  ros::Publisher result_, diagnostics_;
};

} /* namespace soter */

#endif
