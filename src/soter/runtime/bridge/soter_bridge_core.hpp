/* soter_bridge_core.hpp: between messages of a middleware and the channels of a trusted part.
 *
 * Purpose: what every bridge in C++ does: messages that the mapping names are judged (publisher,
 * frame, stamp), converted and written into the channel of their topic; what the actuators hold is
 * published; what the trusted part and the actuators say of themselves becomes lines for whoever
 * shows them (soter_status_text.h has the words). The trusted part is another process, which knows
 * nothing of the middleware: it judges values, ages and sets by itself, so that nothing here is
 * trusted to be right, or alive.
 * Non-goals: a middleware (soter_bridge.hpp of each).
 *
 * Stamps of messages are on the middleware's clock, channels on CLOCK_MONOTONIC: a message of age a
 * was measured a (and the clocks' error) before now. C++11.
 */
#ifndef SOTER_BRIDGE_CORE_HPP
#define SOTER_BRIDGE_CORE_HPP

#include "soter_check.h"
#include "soter_outside.h"
#include "soter_process.h"
#include "soter_sources.hpp"
#include "soter_status_text.h"

#include <time.h>

#include <atomic>
#include <cstdint>
#include <cstdlib>
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

/* 0: nothing acts yet, and a signal ends the process; 1: it acts; 2: it ends, with the law. */
inline std::atomic<int>& stage() {
  static std::atomic<int> at{0};
  return at;
}

inline void on_end(int /*signal*/) {
  if (stage().exchange(2) == 0) {
    std::_Exit(EXIT_FAILURE);
  }
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

/* The channel that the sources of a topic write, one at a time: Sources sees to that. */
template <class Shared>
inline soter_outside* shared_channel() {
  static soter_outside made = soter_outside();
  return &made;
}

/* Traits `T` of a topic that comes in, generated:
 *   Message, Value       types
 *   channel(), hash()    of the channel
 *   topic()              of the middleware
 *   publisher()          who may publish; "": the first one that is heard
 *   frame(m)             whether the message is in the frame of the mapping
 *   stamped()            whether messages say when they were measured
 *   delay_ns()           where not: how long before its arrival a message may have been measured
 *   stamp_ns(m)          when; 0: it does not
 *   convert(m, &value)   false: something that is needed is not there
 * and those of OneSource, or of one of several. */
template <class T>
class Inward {
 public:
  typedef typename T::Message Message;

  explicit Inward(int64_t clock_error_ns) : error_ns_(clock_error_ns) {
    SOTER_CHECK(clock_error_ns >= 0); /* below, messages would be younger than they are */
  }

  /* NULL, or why the channel cannot be opened. */
  const char* open(const std::string& folder) {
    if (channel()->place[0] != nullptr) { /* another source opened it */
      return nullptr;
    }
    return soter_outside_open(channel(), folder.c_str(), T::channel(), T::hash(),
                              sizeof(typename T::Value), true);
  }

  /* Now on two clocks: `now`, CLOCK_MONOTONIC, has to be read first, and then `now_ns`, the clock
   * of the stamps. Whoever is held up in between makes a message older, never newer. */
  void take(const Message& m, const std::string& publisher, int64_t now, int64_t now_ns) {
    typename T::Value value;
    int64_t measured = 0;
    SOTER_CHECK(channel()->size == sizeof value);
    (void)std::memset(&value, 0, sizeof value);
    if (publisher.empty()) {
      refuse(&stranger_, "which node publishes it cannot be told: there are several, or one began");
    } else if (is_stranger(publisher)) {
      refuse(&stranger_, "a second node publishes it: " + publisher);
    } else if (!T::frame(m)) {
      refuse(&frame_, "a message is in another frame");
    } else if (measured_at(m, now, now_ns, &measured)) {
      if (!T::convert(m, &value)) {
        refuse(&absent_, "a message has no such element, or a number that the topic cannot hold");
      } else if (T::sources() == nullptr) {
        soter_outside_write(channel(), measured, &value);
        heard_++;
        taken_++;
      } else if (!T::fits(value)) {
        refuse(&unfit_, "a value is not finite, or outside the topic's set");
      } else {
        heard_++; /* where it is not taken, that is no silence either */
        (void)T::sources()->take(T::rank(), T::stamp_ns(m), [&] {
          soter_outside_write(channel(), measured, &value);
          taken_++;
        });
      }
    }
  }

  /* Who publishes the topic and is not heard, as its type or its QoS does not fit. */
  void unheard(const std::string& names) {
    const std::lock_guard<std::mutex> held(named_);
    unheard_ = names;
  }

  /* A message without a stamp that may have been published at any time before it came. */
  void refuse_undated() {
    refuse(&unstamped_, "a latched message has no stamp: nobody knows how old it is");
  }

  void refuse_torn() { refuse(&torn_, "bytes are no value of its type"); }

  Status status() {
    const std::lock_guard<std::mutex> held(named_);
    Status to;
    to.name = std::string("soter: ") + T::topic();
    to.of = bound_;
    to.message = taken_ > 0 ? "taken" : "nothing was taken yet";
    const uint64_t refused = stranger_ + frame_ + unstamped_ + future_ + absent_ + unfit_ + torn_;
    const bool spoke = heard_ != heard_told_;
    if (refused != refused_told_) {
      to.level = Status::ERROR;
      to.message = why_;
    } else if (!spoke) {
      to.level = Status::WARN;
      to.message = "silent";
    }
    if (!unheard_.empty()) {
      to.level = Status::ERROR;
      to.message = "not heard, as its type or its QoS does not fit: " + unheard_;
    }
    refused_told_ = refused;
    heard_told_ = heard_;
    to.said("taken", taken_);
    to.said("of another publisher", stranger_);
    to.said("in another frame", frame_);
    to.said("without a stamp", unstamped_);
    to.said("stamped later than now", future_);
    to.said("without a value", absent_);
    to.said("no value of its type", torn_);
    if (T::sources() != nullptr) {
      among_sources(&to, spoke);
    }
    return to;
  }

 private:
  soter_outside* channel() {
    return T::sources() == nullptr ? &channel_ : shared_channel<typename T::Shared>();
  }

  /* Whether it is the source that is read, and how often it took over. */
  void among_sources(Status* to, bool spoke) {
    const Sources::Counts counts = T::sources()->counts(T::rank());
    if (to->level == Status::OK && spoke) {
      to->level = counts.read && T::rank() > 0 ? Status::WARN : Status::OK;
      to->message = counts.read ? "it is read" : "it stands by";
    }
    to->values.emplace_back("read", counts.read ? "yes" : "no");
    to->said("took over", counts.takeovers);
    to->said("not its turn", counts.waited);
    to->said("older than what was taken", counts.older);
    to->said("not finite, or outside the set", unfit_);
    to->said("longest between stamps taken, us", static_cast<uint64_t>(counts.gap_ns / 1000));
  }

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
    *measured = now - T::delay_ns();
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
  std::string bound_, why_, unheard_;
  std::atomic<uint64_t> taken_{0}, stranger_{0}, frame_{0}, unstamped_{0}, future_{0}, absent_{0},
      unfit_{0}, torn_{0}, heard_{0};
  uint64_t refused_told_ = 0, heard_told_ = 0;
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

  /* On a thread of its own, as long as `go_on` says so, and then the law. `now_ns`: of the clock of
   * the stamps; `publish` gets a value and its stamp. */
  void serve(const std::function<bool()>& go_on, const std::function<int64_t()>& now_ns,
             const std::function<void(const Value&, int64_t)>& publish) {
    const Tell tell = [&](int64_t written) {
      const int64_t stamps_now = now_ns(); /* first: who is held up here makes a value older */
      publish(value_, stamps_now - (monotonic_ns() - written));
    };
    while (go_on()) {
      soter_outside_wait(&channel_, WAIT_NS);
      turn(monotonic_ns(), tell);
    }
    if (heard_ > 0 && T::law(&value_)) {
      told(monotonic_ns(), tell, monotonic_ns());
    }
  }

  /* Who else publishes the topic, and who would hear it and does not. */
  void others(const std::string& names, const std::string& unheard = "") {
    const std::lock_guard<std::mutex> held(named_);
    others_ = names;
    unheard_ = unheard;
  }

  Status status() {
    const std::lock_guard<std::mutex> held(named_);
    Status to;
    to.name = std::string("soter: ") + T::topic();
    to.level = silent_ ? Status::ERROR : Status::OK;
    to.message = soter_outward_text(silent_, count_);
    to.said("published", count_);
    if (!unheard_.empty()) {
      to.level = Status::ERROR;
      to.message = "not heard, as its type or its QoS does not fit, by " + unheard_;
    }
    if (!others_.empty()) {
      to.level = Status::ERROR;
      to.message = "published by another node, too, which nobody can keep from it: " + others_;
    }
    return to;
  }

 private:
  typedef std::function<void(int64_t)> Tell; /* the value, written then */

  void turn(int64_t now, const Tell& tell) {
    Value value;
    int64_t written = 0;
    const bool there = soter_outside_read(&channel_, &written, &value, nullptr);
    before_ = before_ || there;
    if (there && is_of_now(written)) {
      const bool changed = std::memcmp(&value, &value_, sizeof value) != 0;
      value_ = value;
      heard_ = now;
      silent_ = false;
      if (changed || now - told_ >= RESEND_NS) {
        told(now, tell, written);
      }
    } else if (heard_ > 0 && now - heard_ > T::silent_ns() && now - told_ >= RESEND_NS) {
      silent_ = true; /* nobody holds a lease, and nobody holds the law: it is held from here */
      if (T::law(&value_)) {
        told(now, tell, now);
      }
    } else if (heard_ == 0 && before_ && now - begun_ > T::silent_ns()) {
      silent_ = true; /* who wrote it was gone when the bridge began */
    }
  }

  /* A channel may hold what somebody wrote long ago, or before this machine was started; and
   * whoever writes it may have been stopped between the time and the value. */
  bool is_of_now(int64_t written) const {
    const int64_t age_ns = monotonic_ns() - written;
    return written >= begun_ && age_ns >= 0 && age_ns <= T::silent_ns();
  }

  void told(int64_t now, const Tell& tell, int64_t written) {
    tell(written);
    told_ = now;
    count_++;
  }

  soter_outside channel_ = soter_outside();
  Value value_;
  const int64_t begun_ = monotonic_ns();
  int64_t told_ = 0, heard_ = 0;
  bool before_ = false; /* a value was there, of now or not */
  std::atomic<uint64_t> count_{0};
  std::atomic<bool> silent_{false};
  std::mutex named_;
  std::string others_, unheard_;
};

/* ------------------------------------------------------------------ the trusted part */

/* Who says something of itself; generated. `arm`: the command of a person. */
struct StatusNames {
  uint64_t hash;
  std::vector<std::string> modules, leases, topics;
  uint64_t actuators_hash;
  std::string arm;
};

/* A module, for machines. */
struct ModuleStatus {
  std::string name, mode, why, message;
  double margin_s = 0.0;
  uint64_t takeovers = 0;
  bool armed = false, unchecked = false;
};

/* The trusted part, and its actuators: what they say of themselves. For one thread. */
class TrustedPart {
 public:
  static const int64_t WAIT_NS = 20000000;

  explicit TrustedPart(const StatusNames& names)
      : names_(names),
        words_(SOTER_STATUS_WORDS(names.modules.size(), names.leases.size(), names.topics.size())),
        actuators_(SOTER_ACTUATORS_WORDS(names.leases.size())) {}

  const char* open(const std::string& folder) {
    const char* wrong = soter_outside_open(&channel_, folder.c_str(), SOTER_STATUS_CHANNEL,
                                           names_.hash, words_.size() * sizeof words_[0], false);
    if (wrong == nullptr && !names_.leases.empty()) {
      wrong = soter_outside_open(&of_actuators_, folder.c_str(), SOTER_ACTUATORS_CHANNEL,
                                 names_.actuators_hash, actuators_.size() * sizeof actuators_[0],
                                 false);
    }
    return wrong;
  }

  /* Waits for a while; whether what is said of a module has changed: who has control, and whether
   * its actuators obey. Numbers go on without being news. */
  bool hear() {
    soter_outside_wait(&channel_, WAIT_NS);
    int64_t at = 0;
    if (soter_outside_read(&channel_, &at, room(words_.size()), nullptr)) {
      words_ = room_;
      at_ = at;
    }
    if (!names_.leases.empty() &&
        soter_outside_read(&of_actuators_, &at, room(actuators_.size()), nullptr)) {
      actuators_ = room_;
      actuators_at_ = at;
    }
    std::string news;
    for (size_t k = 0; k < names_.modules.size(); k++) {
      const soter_module_facts f = facts(k);
      news += message(f) + "\n" + (f.ac ? "AC" : "SC") + soter_armed_text(&f) + "\n";
    }
    const bool changed = news != news_;
    news_ = news;
    return changed;
  }

  std::vector<Status> statuses() const {
    std::vector<Status> all;
    for (size_t k = 0; k < names_.modules.size(); k++) {
      all.push_back(of_module(k));
    }
    for (size_t k = 0; k < names_.topics.size(); k++) {
      const size_t at = SOTER_STATUS_HEAD + SOTER_STATUS_MODULE * names_.modules.size() +
                        SOTER_STATUS_LEASE * names_.leases.size() + SOTER_STATUS_TOPIC * k;
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

  /* The same of the modules, for machines. */
  std::vector<ModuleStatus> modules() const {
    std::vector<ModuleStatus> all;
    for (size_t k = 0; k < names_.modules.size(); k++) {
      const soter_module_facts f = facts(k);
      ModuleStatus to;
      to.name = names_.modules[k];
      to.mode = f.alive ? (f.ac ? "AC" : "SC") : "";
      to.margin_s = soter_margin_s(&f, monotonic_ns());
      to.why = soter_takeover_text(f.why);
      for (size_t c = 0; c < SOTER_STATUS_CAUSES; c++) {
        to.takeovers += f.takeovers[c];
      }
      to.armed = f.leased && f.actuators_alive && f.state != SOTER_LEASE_ENDED;
      to.unchecked = to.armed && f.how == SOTER_ARMED_UNCHECKED;
      to.message = message(f);
      all.push_back(to);
    }
    return all;
  }

 private:
  uint64_t* room(size_t words) {
    room_.resize(words);
    return room_.data();
  }

  soter_module_facts facts(size_t k) const {
    soter_module_place place = {static_cast<uint32_t>(names_.modules.size()),
                                static_cast<uint32_t>(k), -1};
    for (size_t l = 0; l < names_.leases.size(); l++) {
      place.lease = names_.leases[l] == names_.modules[k] ? static_cast<int32_t>(l) : place.lease;
    }
    return soter_module_facts_of(place, monotonic_ns(), words_.data(), at_, actuators_.data(),
                                 actuators_at_);
  }

  std::string message(const soter_module_facts& f) const {
    char text[SOTER_MESSAGE_MAX];
    soter_module_message(&f, names_.arm.c_str(), text, sizeof text);
    return text;
  }

  Status of_module(size_t k) const {
    const soter_module_facts f = facts(k);
    Status to;
    to.name = "soter: module " + names_.modules[k];
    to.level = static_cast<Status::Level>(soter_module_level(&f));
    to.message = message(f);
    to.values.emplace_back("mode", !f.alive ? "unknown" : f.ac ? "AC" : "SC");
    to.values.emplace_back("margin, s", std::to_string(soter_margin_s(&f, monotonic_ns())));
    to.values.emplace_back("armed", soter_armed_text(&f));
    if (f.leased && f.actuators_alive && f.state == SOTER_LEASE_ENDED) {
      to.values.emplace_back("arming", soter_arming_text(&f));
    }
    to.values.emplace_back("SC took over last", soter_takeover_text(f.why));
    for (uint32_t c = 0; c < SOTER_STATUS_CAUSES; c++) {
      to.said(std::string("takeovers: ") + soter_takeover_text(1 + c), f.takeovers[c]);
    }
    if (f.leased) {
      to.said("leases given", f.given);
      if (f.old_topic > 0) {
        const bool outside = f.old_topic <= names_.topics.size();
        char text[SOTER_MESSAGE_MAX];
        soter_old_read_text(&f, outside ? names_.topics[f.old_topic - 1].c_str() : "a topic inside",
                            text, sizeof text);
        to.values.emplace_back(SOTER_OLD_READ, text);
      }
    }
    to.said("late releases and completions", f.missed);
    return to;
  }

  const StatusNames names_;
  soter_outside channel_ = soter_outside(), of_actuators_ = soter_outside();
  std::vector<uint64_t> words_, actuators_, room_;
  int64_t at_ = 0, actuators_at_ = 0;
  std::string news_;
};

} /* namespace soter */

#endif
