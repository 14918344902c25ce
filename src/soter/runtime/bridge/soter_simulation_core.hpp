/* soter_simulation_core.hpp: a program that steps under /clock, whichever ROS it is.
 *
 * Purpose: every instant up to the time of /clock is run, in order, so that a system with its
 * plants inside has the trace of `soter run`, whoever ticks. Messages of the mapping come in and go
 * out; the state after every instant is hashed. /clock that goes back is a simulation that began
 * anew: so does the program, in SC.
 * Non-goals: nodes (soter_simulation.hpp of each ROS); real time (soter_bridge.hpp and the trusted
 * part): here nothing is on time or late.
 *
 * A message counts from its arrival and is as old as its stamp, both on /clock. Nothing is taken
 * before the instant of its stamp. Who stamps may hear /clock a little earlier than this node: a
 * stamp is later than now, and refused, where the next /clock has not come to it either. Of several
 * sources of a topic a message has its turn, or not, once /clock has come to its stamp. C++11.
 */
#ifndef SOTER_SIMULATION_CORE_HPP
#define SOTER_SIMULATION_CORE_HPP

#include "soter_app.h"
#include "soter_check.h"
#include "soter_sha256.h"
#include "soter_sources.hpp"

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

namespace soter {

/* A topic of ROS that is a topic of the program. `origin`: the time of /clock at instant 0, ns. */
class Simulated {
 public:
  virtual ~Simulated() {}
  virtual void begin() {}                                             /* or anew */
  virtual void clock(int64_t /*now*/) {}                              /* before its instants */
  virtual void in(APP_STATE* /*state*/, int64_t /*origin*/) {}        /* at an instant */
  virtual void out(const APP_STATE* /*state*/, int64_t /*origin*/) {} /* after it */
};

/* Whether the topic of a traits is one of this program, and its value as long. */
template <class T>
inline void check_topic() {
  SOTER_CHECK(T::index() < APP_PROGRAM->topics);
  SOTER_CHECK(APP_PROGRAM->topic[T::index()].size == sizeof(typename T::Value));
}

/* Traits as in soter_bridge_core.hpp, and index(): of the topic. */
template <class T>
class SimulatedInput : public Simulated {
 public:
  typedef typename T::Message Message;

  void begin() override {
    here_.heard = ahead_.heard = false;
    if (T::sources() != nullptr) {
      T::sources()->forget();
    }
  }

  void clock(int64_t now) override {
    now_ = now;
    if (ahead_.heard && ahead_.stamp_ns <= now) {
      accept(ahead_);
    } else if (ahead_.heard) {
      refused("a message was stamped later than now: two clocks, or a wrong one");
    }
    ahead_.heard = false;
  }

  void in(APP_STATE* state, int64_t origin) override {
    check_topic<T>();
    const int64_t ct = soter_header_of(state)->ct;
    const int64_t stamp = T::stamped() ? here_.stamp_ns - origin : ct;
    if (!here_.heard || stamp > ct) {
      return;
    }
    here_.heard = false;
    if (stamp >= soter_stamps_of(APP_PROGRAM, state)[T::index()]) {
      (void)soter_publish(APP_PROGRAM, state, T::index(), &here_.value, stamp);
    }
  }

 protected:
  void take(const Message& m, const std::string& publisher) {
    Sample sample;
    (void)std::memset(&sample.value, 0, sizeof sample.value);
    if (bound_.empty()) {
      bound_ = T::publisher()[0] != '\0' ? std::string(T::publisher()) : publisher;
    }
    sample.heard = true;
    sample.stamp_ns = T::stamped() ? T::stamp_ns(m) : 0;
    if (publisher.empty()) {
      refused("which node publishes it cannot be told: there are several, or one began");
    } else if (publisher != bound_) {
      refused("a second node publishes it");
    } else if (!T::frame(m)) {
      refused("a message is in another frame");
    } else if (T::stamped() && sample.stamp_ns <= 0) {
      refused("a message has no stamp");
    } else if (!T::convert(m, &sample.value)) {
      refused("a message has no such element, or a number that the topic cannot hold");
    } else if (!T::fits(sample.value)) {
      refused("a value is not finite, or outside the topic's set");
    } else if (sample.stamp_ns > now_) {
      ahead_ = sample;
    } else {
      accept(sample);
    }
  }

  virtual void refused(const char* why) = 0;

 private:
  struct Sample {
    bool heard;
    int64_t stamp_ns; /* 0: messages have none */
    typename T::Value value;
  };

  /* Its stamp is not later than now. Before that it is no sample, and keeps no source waiting. */
  void accept(const Sample& sample) {
    if (T::sources() == nullptr) {
      here_ = sample;
    } else {
      (void)T::sources()->take(T::rank(), sample.stamp_ns, [&] { here_ = sample; });
    }
  }

  Sample here_ = Sample(), ahead_ = Sample();
  int64_t now_ = 0;
  std::string bound_;
};

template <class T>
class SimulatedOutput : public Simulated {
 public:
  typedef typename T::Message Message;

  void begin() override { published_stamp_ = SOTER_NEVER; }

  void out(const APP_STATE* state, int64_t origin) override {
    check_topic<T>();
    /* the kernel takes states that it may change; this one it does not */
    const int64_t stamp = soter_stamps_of(APP_PROGRAM, const_cast<APP_STATE*>(state))[T::index()];
    if (stamp == SOTER_NEVER || stamp == published_stamp_) {
      return;
    }
    published_stamp_ = stamp;
    typename T::Value value;
    const uint8_t* const bytes = reinterpret_cast<const uint8_t*>(state);
    (void)std::memcpy(&value, bytes + APP_PROGRAM->topic[T::index()].offset, sizeof value);
    Message message;
    T::convert(value, origin + stamp, &message);
    publish(message);
  }

 protected:
  virtual void publish(const Message& message) = 0;

 private:
  int64_t published_stamp_ = SOTER_NEVER;
};

class SimulationCore {
 public:
  static constexpr double UNTIL_S = static_cast<double>(APP_UNTIL_NS) / 1e9; /* of the program */

  virtual ~SimulationCore() {}

  void add(Simulated* topic) { topics_.emplace_back(topic); }

  /* NULL, or why it is not run. `until_s`: 0 is for ever. */
  const char* prepare(double until_s, int64_t seed) {
    if (!(until_s >= 0.0 && until_s <= 4.0e9) || seed < 0) {
      return "`until` is no time from 0 to 4e9 s, or `seed` is below 0";
    }
    until_ns_ = until_s > 0.0 ? std::llround(until_s * 1e9) : INT64_MAX / 2;
    seed_ = static_cast<uint64_t>(seed);
    return soter_self_test(APP_PROGRAM);
  }

  /* The time of /clock; whether the end came with it. Nothing happens after the end. */
  bool clock(int64_t now) {
    if (ended_) {
      return false;
    }
    if (!began_ || now < now_) {
      begin(now);
    }
    now_ = now;
    for (const std::unique_ptr<Simulated>& topic : topics_) {
      topic->clock(now);
    }
    const int64_t last = now - origin_ < until_ns_ ? now - origin_ : until_ns_;
    while (soter_next_instant(APP_PROGRAM, &state_) <= last) {
      instant();
    }
    ended_ = soter_next_instant(APP_PROGRAM, &state_) > until_ns_;
    return ended_;
  }

  bool ended() const { return ended_; }

  /* As `soter run` exits: 0 safe, 3 violated, 130 stopped before the end. */
  int exit_code() { return !ended_ ? 130 : violations() == 0U ? 0 : 3; }

  /* What is said at the end, and on standard output. */
  std::string result() {
    char digest[65];
    soter_sha256 until_now = hash_; /* hashing may go on */
    soter_sha256_end(&until_now, digest);
    const char* const safe = violations() == 0U ? "safe" : "violated";
    (void)std::printf("%s\ntrace_sha256 %s\n", safe, digest);
    (void)std::fflush(stdout);
    return std::string(safe) + ": " + std::to_string(violations()) + " violations, trace_sha256 " +
           digest;
  }

 protected:
  virtual void began_anew() = 0;
  virtual void mode_changed() = 0;

  /* Of the last instant, on /clock, ns. */
  int64_t instant_ns() { return origin_ + soter_header_of(&state_)->ct; }

  /* A line a module into a DiagnosticArray, which ROS 1 and ROS 2 lay out alike. */
  template <class Array>
  void modes(Array* to) const {
    for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
      const bool ac = modes_[i] == SOTER_AC;
      to->status.emplace_back();
      auto& line = to->status.back();
      line.level = static_cast<decltype(line.level)>(ac ? 0 : 1); /* OK, WARN */
      line.name = std::string("soter: module ") + APP_PROGRAM->module[i].name;
      line.message = ac ? "AC has control" : "SC has control";
    }
  }

 private:
  uint32_t violations() { return soter_header_of(&state_)->violations; }

  void begin(int64_t now) {
    if (began_) {
      began_anew();
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
    compare_modes();
  }

  void compare_modes() {
    bool changed = false;
    const soter_module* const m = soter_modules_of(APP_PROGRAM, &state_);
    for (uint32_t i = 0; i < APP_PROGRAM->modules; i++) {
      changed = changed || modes_[i] != m[i].mode;
      modes_[i] = m[i].mode;
    }
    if (changed) {
      mode_changed();
    }
  }

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
