/* soter_simulation.hpp: a program that steps under /clock.
 *
 * Purpose: the node NAME_simulation of a package that `soter build --target ros1` writes: for
 * Gazebo, for bags that are played, for tests. Every instant up to the time of /clock is run, in
 * order, so that a system with its plants inside has the trace of `soter run`, whoever ticks.
 * Topics of the mapping come in and go out; the state after every instant is hashed.
 * Non-goals: real time (soter_bridge.hpp and the trusted part): here nothing is on time or late.
 *
 * /clock that goes back is a simulation that began anew: so does the program, in SC. C++11.
 */
#ifndef SOTER_SIMULATION_HPP
#define SOTER_SIMULATION_HPP

#include "soter_app.h"
#include "soter_messages.hpp"
#include "soter_sha256.h"
#include "soter_sources.hpp"

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/ros.h>
#include <rosgraph_msgs/Clock.h>
#include <std_msgs/String.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

namespace soter {

class Simulation;

/* A topic of ROS that is a topic of the program. */
class Simulated {
 public:
  virtual ~Simulated() {}
  virtual void in(APP_STATE* /*state*/, int64_t /*origin*/) {}
  virtual void out(const APP_STATE* /*state*/, int64_t /*origin*/) {}
  virtual void begin() {}
};

/* Traits as in soter_bridge_core.hpp, and index(): of the topic. */
template <class T>
class SimulatedIn : public Simulated {
 public:
  explicit SimulatedIn(ros::NodeHandle* node)
      : subscriber_(node->subscribe(T::topic(), 1, &SimulatedIn::on, this,
                                    ros::TransportHints().tcpNoDelay())) {}

  void begin() override {
    heard_ = false;
    if (T::sources() != nullptr) {
      T::sources()->forget();
    }
  }

  void in(APP_STATE* state, int64_t origin) override {
    if (!heard_) {
      return;
    }
    heard_ = false;
    const int64_t ct = soter_header_of(state)->ct;
    const int64_t measured = measured_ < 0 ? ct : measured_ - origin;
    const int64_t stamp = measured > ct ? ct : measured;
    if (stamp >= soter_stamps_of(APP_PROGRAM, state)[T::index()]) {
      (void)soter_publish(APP_PROGRAM, state, T::index(), &value_, stamp);
    }
  }

 private:
  void on(const ros::MessageEvent<typename T::Message const>& event) {
    const typename T::Message& m = *event.getConstMessage();
    if (bound_.empty()) {
      bound_ = T::publisher()[0] != '\0' ? std::string(T::publisher()) : event.getPublisherName();
    }
    typename T::Value value;
    (void)std::memset(&value, 0, sizeof value);
    if (event.getPublisherName() != bound_ || !T::frame(m) || !T::convert(m, &value)) {
      ROS_WARN_THROTTLE(1.0, "%s: a message was refused", T::topic());
      return;
    }
    const auto take = [&] {
      measured_ = T::stamped() ? T::stamp_ns(m) : -1;
      value_ = value;
      heard_ = true;
    };
    if (T::sources() == nullptr) {
      take();
    } else if (T::stamp_ns(m) > 0 && T::fits(value)) {
      /* a stamp ahead of /clock would keep every other source waiting: it counts as now */
      const int64_t now = ns_of(ros::Time::now());
      (void)T::sources()->take(T::rank(), T::stamp_ns(m) < now ? T::stamp_ns(m) : now, take);
    }
  }

  ros::Subscriber subscriber_;
  typename T::Value value_ = typename T::Value();
  int64_t measured_ = -1;
  bool heard_ = false;
  std::string bound_;
};

template <class T>
class SimulatedOut : public Simulated {
 public:
  explicit SimulatedOut(ros::NodeHandle* node)
      : publisher_(node->advertise<typename T::Message>(T::topic(), 10)) {}

  void begin() override { told_ = SOTER_NEVER; }

  void out(const APP_STATE* state, int64_t origin) override {
    /* the kernel takes states that it may change; this one it does not */
    const int64_t stamp = soter_stamps_of(APP_PROGRAM, const_cast<APP_STATE*>(state))[T::index()];
    if (stamp == SOTER_NEVER || stamp == told_) {
      return;
    }
    told_ = stamp;
    typename T::Value value;
    const uint8_t* const bytes = reinterpret_cast<const uint8_t*>(state);
    (void)std::memcpy(&value, bytes + APP_PROGRAM->topic[T::index()].offset, sizeof value);
    typename T::Message message;
    T::convert(value, origin + stamp, &message);
    publisher_.publish(message);
  }

 private:
  ros::Publisher publisher_;
  int64_t told_ = SOTER_NEVER;
};

class Simulation {
 public:
  Simulation() : own_("~") {}

  template <class T>
  void in() {
    topics_.emplace_back(new SimulatedIn<T>(&node_));
  }

  template <class T>
  void out() {
    topics_.emplace_back(new SimulatedOut<T>(&node_));
  }

  /* As `soter run` exits: 0 safe, 3 violated, 1 it cannot run, 130 stopped before the end. */
  int run() {
    double until_s = static_cast<double>(APP_UNTIL_NS) / 1e9;
    int seed = 1;
    own_.param<double>("until", until_s, until_s);
    own_.param<int>("seed", seed, 1);
    if (!(until_s >= 0.0 && until_s <= 4.0e9) || seed < 0) {
      ROS_FATAL("~until is no time from 0 to 4e9 s, or ~seed is below 0");
      return 1;
    }
    if (const char* const wrong = soter_self_test(APP_PROGRAM)) {
      ROS_FATAL("not run: %s", wrong);
      return 1;
    }
    until_ns_ = until_s > 0.0 ? std::llround(until_s * 1e9) : INT64_MAX / 2;
    seed_ = static_cast<uint64_t>(seed);
    result_ = own_.advertise<std_msgs::String>("result", 1, true);
    diagnostics_ = node_.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 1);
    const ros::Subscriber clock = node_.subscribe("/clock", 1000, &Simulation::on, this);
    ros::spin();
    if (!ended_) {
      say();
    }
    return !ended_ ? 130 : soter_header_of(&state_)->violations == 0U ? 0 : 3;
  }

 private:
  void on(const rosgraph_msgs::Clock::ConstPtr& clock) {
    const int64_t now = static_cast<int64_t>(clock->clock.toNSec());
    if (!began_ || now < now_) {
      begin(now);
    }
    now_ = now;
    const int64_t last = now - origin_ < until_ns_ ? now - origin_ : until_ns_;
    while (!ended_ && soter_next_instant(APP_PROGRAM, &state_) <= last) {
      instant();
    }
    if (!ended_ && soter_next_instant(APP_PROGRAM, &state_) > until_ns_) {
      ended_ = true;
      say();
      ros::requestShutdown();
    }
  }

  void begin(int64_t now) {
    if (began_) {
      ROS_WARN("/clock went back: the program begins anew, in SC");
    }
    began_ = true;
    origin_ = now;
    soter_start(APP_PROGRAM, &state_, seed_);
    soter_sha256_start(&hash_);
    modes_.assign(APP_PROGRAM->modules, SOTER_SC);
    for (const std::unique_ptr<Simulated>& topic : topics_) {
      topic->begin();
    }
  }

  void instant() {
    uint32_t due = 0;
    soter_progress(APP_PROGRAM, &state_);
    for (const std::unique_ptr<Simulated>& topic : topics_) {
      topic->in(&state_, origin_);
    }
    for (uint32_t i = 0; i < APP_PROGRAM->inputs; i++) {
      if (soter_header_of(&state_)->ct % APP_PROGRAM->input[i].every_ns == 0) {
        APP_PROGRAM->input[i].draw(&state_, nullptr);
      }
    }
    while (soter_instant(APP_PROGRAM, &state_, &due) == SOTER_EXTERN_DUE) {
      soter_app_answer(&state_, due);
    }
    soter_sha256_add(&hash_, &state_, APP_PROGRAM->state_size);
    for (const std::unique_ptr<Simulated>& topic : topics_) {
      topic->out(&state_, origin_);
    }
    diagnose();
  }

  void diagnose() {
    bool changed = false;
    const soter_module* const m = soter_modules_of(APP_PROGRAM, &state_);
    for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
      changed = changed || modes_[i] != m[i].mode;
      modes_[i] = m[i].mode;
    }
    if (!changed) {
      return;
    }
    diagnostic_msgs::DiagnosticArray all;
    all.header.stamp = stamp_of(origin_ + soter_header_of(&state_)->ct);
    for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
      diagnostic_msgs::DiagnosticStatus status;
      const bool ac = m[i].mode == SOTER_AC;
      status.name = std::string("soter: module ") + APP_PROGRAM->module[i].name;
      status.level =
          ac ? diagnostic_msgs::DiagnosticStatus::OK : diagnostic_msgs::DiagnosticStatus::WARN;
      status.message = ac ? "AC has control" : "SC has control";
      all.status.push_back(status);
    }
    diagnostics_.publish(all);
  }

  void say() {
    char digest[65];
    soter_sha256 until_now = hash_; /* hashing may go on */
    soter_sha256_end(&until_now, digest);
    const uint32_t violations = soter_header_of(&state_)->violations;
    std_msgs::String m;
    m.data = std::string(violations == 0U ? "safe" : "violated") + ": " +
             std::to_string(violations) + " violations, trace_sha256 " + digest;
    result_.publish(m);
    ROS_INFO("%s: %s", APP_PROGRAM->name, m.data.c_str());
    (void)std::printf("%s\ntrace_sha256 %s\n", violations == 0U ? "safe" : "violated", digest);
    (void)std::fflush(stdout);
  }

  ros::NodeHandle node_, own_;
  ros::Publisher result_, diagnostics_;
  std::vector<std::unique_ptr<Simulated>> topics_;
  APP_STATE state_ = APP_STATE();
  soter_sha256 hash_ = soter_sha256();
  std::vector<uint8_t> modes_;
  int64_t until_ns_ = 0, origin_ = 0, now_ = 0;
  uint64_t seed_ = 1;
  bool began_ = false, ended_ = false;
};

} /* namespace soter */

/* In simulated time nothing moves: the run ends, with the exit code of a defect. */
extern "C" void soter_check_failed(const char* file, int line, const char* what) {
  (void)std::fprintf(stderr, "soter has a defect: %s:%d: not %s\n", file, line, what);
  std::_Exit(70);
}

#endif
