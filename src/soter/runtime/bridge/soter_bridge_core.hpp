/* soter_bridge_core.hpp: between messages of a middleware and the channels of a trusted part.
 *
 * Purpose: what every bridge in C++ does: messages that the mapping names are judged (publisher,
 * frame, stamp), converted and written into the channel of their topic; what the actuators hold is
 * published; what the trusted part says of itself becomes lines for whoever shows them. The trusted
 * part is another process, which knows nothing of the middleware: it judges values, ages and sets
 * by itself, so that nothing here is trusted to be right, or alive.
 * Non-goals: a middleware (soter_bridge.hpp of each).
 *
 * Stamps of messages are on the middleware's clock, channels on CLOCK_MONOTONIC: a message of age a
 * was measured a (and the clocks' error) before now. C++11.
 */
#ifndef SOTER_BRIDGE_CORE_HPP
#define SOTER_BRIDGE_CORE_HPP

#include "soter_outside.h"
#include "soter_status.h"

#include <time.h>

#include <atomic>
#include <cstdint>
#include <cstring>
#include <functional>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

namespace soter {

inline int64_t monotonic_ns() {
  struct timespec t = {0, 0};
  (void)clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<int64_t>(t.tv_sec) * 1000000000 + t.tv_nsec;
}

/* A line for whoever shows how things are: the levels of diagnostic_msgs. */
struct Status {
  enum Level { OK = 0, WARN = 1, ERROR = 2, STALE = 3 };
  Level level = OK;
  std::string name, message, of;
  std::vector<std::pair<std::string, std::string>> values;

  void said(const std::string& key, uint64_t value) {
    values.emplace_back(key, std::to_string(value));
  }
};

/* The lines into a DiagnosticArray, which ROS 1 and ROS 2 lay out alike. */
template <class Array>
inline void fill(const std::vector<Status>& all, Array* to) {
  for (const Status& status : all) {
    to->status.emplace_back();
    auto& line = to->status.back();
    line.level = static_cast<decltype(line.level)>(status.level);
    line.name = status.name;
    line.message = status.message;
    line.hardware_id = status.of;
    for (const std::pair<std::string, std::string>& value : status.values) {
      line.values.emplace_back();
      line.values.back().key = value.first;
      line.values.back().value = value.second;
    }
  }
}

/* ------------------------------------------------------------------ in */

/* Traits `T` of a topic that comes in, generated:
 *   Message, Value       types
 *   channel(), hash()    of the channel
 *   topic()              of the middleware
 *   publisher()          who may publish; "": the first one that is heard
 *   frame(m)             whether the message is in the frame of the mapping
 *   stamped()            whether messages say when they were measured
 *   stamp_ns(m)          when; 0: it does not
 *   convert(m, &value)   false: something that is needed is not there */
template <class T>
class Inward {
 public:
  typedef typename T::Message Message;

  explicit Inward(int64_t clock_error_ns) : error_ns_(clock_error_ns) {}

  /* NULL, or why the channel cannot be opened. */
  const char* open(const std::string& folder) {
    return soter_outside_open(&channel_, folder.c_str(), T::channel(), T::hash(),
                              sizeof(typename T::Value), true);
  }

  /* Now on two clocks: `now`, CLOCK_MONOTONIC, has to be read first, and then `now_ns`, the clock
   * of the stamps. Whoever is held up in between makes a message older, never newer. */
  void take(const Message& m, const std::string& publisher, int64_t now, int64_t now_ns) {
    typename T::Value value;
    int64_t measured = 0;
    (void)std::memset(&value, 0, sizeof value);
    if (is_stranger(publisher)) {
      refuse(&stranger_, "a second node publishes it: " + publisher);
    } else if (!T::frame(m)) {
      refuse(&frame_, "a message is in another frame");
    } else if (measured_at(m, now, now_ns, &measured)) {
      if (T::convert(m, &value)) {
        soter_outside_write(&channel_, measured, &value);
        taken_++;
      } else {
        refuse(&absent_, "a message has no such element, or a number that the topic cannot hold");
      }
    }
  }

  /* A message without a stamp that may have been published at any time before it came. */
  void refuse_undated() {
    refuse(&unstamped_, "a latched message has no stamp: nobody knows how old it is");
  }

  Status status() {
    const std::lock_guard<std::mutex> held(named_);
    Status to;
    to.name = std::string("soter: ") + T::topic();
    to.of = bound_;
    to.message = taken_ > 0 ? "taken" : "nothing was taken yet";
    const uint64_t refused = stranger_ + frame_ + unstamped_ + future_ + absent_;
    if (refused != refused_told_) {
      to.level = Status::ERROR;
      to.message = why_;
    } else if (taken_ == taken_told_) {
      to.level = Status::WARN;
      to.message = "silent";
    }
    refused_told_ = refused;
    taken_told_ = taken_;
    to.said("taken", taken_);
    to.said("of another publisher", stranger_);
    to.said("in another frame", frame_);
    to.said("without a stamp", unstamped_);
    to.said("stamped later than now", future_);
    to.said("without a value", absent_);
    return to;
  }

 private:
  void refuse(std::atomic<uint64_t>* counter, const std::string& why) {
    const std::lock_guard<std::mutex> held(named_);
    (*counter)++;
    why_ = why;
  }

  /* Only one node speaks on a topic: the one of the mapping, or the first that is heard. */
  bool is_stranger(const std::string& publisher) {
    const std::lock_guard<std::mutex> held(named_);
    if (bound_.empty()) {
      bound_ = T::publisher()[0] != '\0' ? std::string(T::publisher()) : publisher;
    }
    return publisher != bound_;
  }

  bool measured_at(const Message& m, int64_t now, int64_t now_ns, int64_t* measured) {
    *measured = now;
    if (!T::stamped()) {
      return true;
    }
    const int64_t stamp_ns = T::stamp_ns(m);
    if (stamp_ns <= 0) {
      refuse(&unstamped_, "a message has no stamp");
      return false;
    }
    const int64_t age_ns = now_ns - stamp_ns;
    if (age_ns < -error_ns_) {
      refuse(&future_, "a message was stamped later than now: two clocks, or a wrong one");
      return false;
    }
    *measured = now - age_ns - error_ns_;
    *measured = *measured > now ? now : *measured;
    return true;
  }

  const int64_t error_ns_;
  soter_outside channel_ = soter_outside();
  std::mutex named_;
  std::string bound_, why_;
  std::atomic<uint64_t> taken_{0}, stranger_{0}, frame_{0}, unstamped_{0}, future_{0}, absent_{0};
  uint64_t refused_told_ = 0, taken_told_ = 0;
};

/* ------------------------------------------------------------------ out */

/* Traits `T` of a topic that goes out, generated:
 *   Message, Value, channel(), hash(), topic()
 *   convert(value, stamp_ns, &m)
 *   law(&value)          the fail-safe law; false: it has none, and silence follows silence
 *   silent_ns()          without a value for so long, whoever writes it is gone */
template <class T>
class Outward {
 public:
  typedef typename T::Value Value;
  static const int64_t RESEND_NS = 20000000; /* what does not change is said so often */
  static const int64_t WAIT_NS = 5000000;

  const char* open(const std::string& folder) {
    (void)std::memset(&value_, 0, sizeof value_);
    return soter_outside_open(&channel_, folder.c_str(), T::channel(), T::hash(), sizeof(Value),
                              false);
  }

  /* On a thread of its own, as long as `go_on` says so; `publish` gets a value and its age. */
  void serve(const std::function<bool()>& go_on,
             const std::function<void(const Value&, int64_t)>& publish) {
    while (go_on()) {
      soter_outside_wait(&channel_, WAIT_NS);
      turn(monotonic_ns(), publish);
    }
  }

  /* Who else publishes the topic. */
  void others(const std::string& names) {
    const std::lock_guard<std::mutex> held(named_);
    others_ = names;
  }

  Status status() {
    const std::lock_guard<std::mutex> held(named_);
    Status to;
    to.name = std::string("soter: ") + T::topic();
    to.level = silent_ ? Status::ERROR : Status::OK;
    to.message = silent_ ? "nobody writes it: the actuators, or the trusted part, are gone"
                         : (count_ > 0 ? "published" : "nothing to publish yet");
    to.said("published", count_);
    if (!others_.empty()) {
      to.level = Status::ERROR;
      to.message = "published by another node, too, which nobody can keep from it: " + others_;
    }
    return to;
  }

 private:
  void turn(int64_t now, const std::function<void(const Value&, int64_t)>& publish) {
    Value value;
    int64_t written = 0;
    if (soter_outside_read(&channel_, &written, &value, nullptr) && is_of_now(written)) {
      const bool changed = std::memcmp(&value, &value_, sizeof value) != 0;
      value_ = value;
      heard_ = now;
      silent_ = false;
      if (changed || now - told_ >= RESEND_NS) {
        tell(now, now - written, publish);
      }
    } else if (heard_ > 0 && now - heard_ > T::silent_ns() && now - told_ >= RESEND_NS) {
      silent_ = true; /* nobody holds a lease, and nobody holds the law: it is held from here */
      if (T::law(&value_)) {
        tell(now, 0, publish);
      }
    }
  }

  /* A channel may hold what somebody wrote long ago, or before this machine was started; and
   * whoever writes it may have been stopped between the time and the value. */
  bool is_of_now(int64_t written) const {
    const int64_t age_ns = monotonic_ns() - written;
    return written >= begun_ && age_ns >= 0 && age_ns <= T::silent_ns();
  }

  void tell(int64_t now, int64_t age_ns,
            const std::function<void(const Value&, int64_t)>& publish) {
    publish(value_, age_ns);
    told_ = now;
    count_++;
  }

  soter_outside channel_ = soter_outside();
  Value value_;
  const int64_t begun_ = monotonic_ns();
  int64_t told_ = 0, heard_ = 0;
  std::atomic<uint64_t> count_{0};
  std::atomic<bool> silent_{false};
  std::mutex named_;
  std::string others_;
};

/* ------------------------------------------------------------------ the trusted part */

/* What the trusted part says of itself; generated. */
struct StatusNames {
  uint64_t hash;
  std::vector<std::string> modules, leases, topics;
};

class TrustedPart {
 public:
  static const int64_t WAIT_NS = 20000000;

  explicit TrustedPart(const StatusNames& names)
      : names_(names),
        words_(SOTER_STATUS_WORDS(names.modules.size(), names.leases.size(), names.topics.size())) {
  }

  const char* open(const std::string& folder) {
    return soter_outside_open(&channel_, folder.c_str(), SOTER_STATUS_CHANNEL, names_.hash,
                              words_.size() * sizeof words_[0], false);
  }

  /* Waits for a while; whether a module changed its mode, or leases ended. */
  bool hear() {
    soter_outside_wait(&channel_, WAIT_NS);
    std::vector<uint64_t> words(words_.size());
    if (!soter_outside_read(&channel_, &at_, words.data(), nullptr)) {
      return false;
    }
    heard_ = true;
    bool changed = false;
    for (size_t k = 0; k < names_.modules.size(); k++) {
      const size_t at = SOTER_STATUS_HEAD + SOTER_STATUS_MODULE * k + SOTER_STATUS_MODE;
      changed = changed || words[at] != words_[at];
    }
    for (size_t k = 0; k < names_.leases.size(); k++) {
      const size_t at = lease_at(k) + SOTER_STATUS_ENDED;
      changed = changed || words[at] != words_[at];
    }
    words_ = words;
    return changed;
  }

  std::vector<Status> statuses() const {
    std::vector<Status> all;
    const int64_t age_ns = monotonic_ns() - at_; /* below 0: of before this machine was started */
    const bool alive = heard_ && age_ns >= 0 && age_ns < 5 * SOTER_STATUS_EVERY_NS;
    for (size_t k = 0; k < names_.modules.size(); k++) {
      all.push_back(of_module(k, alive));
    }
    for (size_t k = 0; k < names_.topics.size(); k++) {
      const size_t at = lease_at(names_.leases.size()) + SOTER_STATUS_TOPIC * k;
      Status status;
      status.name = "soter: the trusted part's " + names_.topics[k];
      status.said("taken", words_[at + SOTER_STATUS_TAKEN]);
      status.said("not finite, or outside its set", words_[at + SOTER_STATUS_REFUSED]);
      status.said("older than the one before", words_[at + SOTER_STATUS_OLDER]);
      status.said("later than now", words_[at + SOTER_STATUS_FUTURE]);
      all.push_back(status);
    }
    return all;
  }

 private:
  size_t lease_at(size_t k) const {
    return SOTER_STATUS_HEAD + SOTER_STATUS_MODULE * names_.modules.size() + SOTER_STATUS_LEASE * k;
  }

  Status of_module(size_t k, bool alive) const {
    static const char* const causes[SOTER_STATUS_CAUSES] = {
        "takeovers: ttf", "takeovers: what the DM reads is old", "takeovers: the gate",
        "takeovers: AC is silent", "takeovers: the trusted part was late"};
    const uint64_t* const m = &words_[SOTER_STATUS_HEAD + SOTER_STATUS_MODULE * k];
    const bool ac = m[SOTER_STATUS_MODE] == 1U;
    Status to;
    to.name = "soter: module " + names_.modules[k];
    to.level = !alive ? Status::STALE : ac ? Status::OK : Status::WARN;
    to.message = !alive ? "the trusted part is silent" : ac ? "AC has control" : "SC has control";
    to.values.emplace_back("mode", ac ? "AC" : "SC");
    for (size_t c = 0; c < SOTER_STATUS_CAUSES; c++) {
      to.said(causes[c], m[SOTER_STATUS_TAKEOVERS + c]);
    }
    for (size_t l = 0; l < names_.leases.size(); l++) {
      if (names_.leases[l] != names_.modules[k]) {
        continue;
      }
      const uint64_t* const lease = &words_[lease_at(l)];
      to.said("leases given", lease[SOTER_STATUS_GIVEN]);
      if (lease[SOTER_STATUS_ENDED] != 0U && alive) {
        to.level = Status::ERROR;
        to.message = "its leases have ended: the actuators hold the fail-safe law";
      }
    }
    to.said("late releases and completions", words_[SOTER_STATUS_MISSED]);
    return to;
  }

  const StatusNames names_;
  soter_outside channel_ = soter_outside();
  std::vector<uint64_t> words_;
  int64_t at_ = 0;
  bool heard_ = false;
};

} /* namespace soter */

#endif
