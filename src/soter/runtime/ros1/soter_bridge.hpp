/* soter_bridge.hpp: between topics of ROS 1 and the channels of a trusted part.
 *
 * Purpose: the roscpp side of a package that `soter build --target ros1` writes. Messages that the
 * mapping names are judged (publisher, frame, stamp), converted and written into the channel of
 * their topic; what the actuators hold is published; what the trusted part says of itself goes to
 * /diagnostics. The trusted part is another process, which knows nothing of ROS: it judges values,
 * ages and sets by itself, so that nothing here is trusted to be right, or alive.
 * Non-goals: the trusted part and the actuators (soter_posix.h, soter_actuator.h); simulated time
 * (soter_simulation.hpp).
 *
 * Stamps of ROS are on the machine's wall clock, channels on CLOCK_MONOTONIC: a message of age a
 * was measured a (and ~clock_error) before now. C++11.
 */
#ifndef SOTER_BRIDGE_HPP
#define SOTER_BRIDGE_HPP

#include "soter_outside.h"
#include "soter_status.h"

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/callback_queue.h>
#include <ros/master.h>
#include <ros/ros.h>
#include <ros/this_node.h>
#include <time.h>

#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace soter {

inline int64_t monotonic_ns() {
  struct timespec t = {0, 0};
  (void)clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<int64_t>(t.tv_sec) * 1000000000 + t.tv_nsec;
}

template <class Number>
inline void said(diagnostic_msgs::DiagnosticStatus* to, const std::string& key, Number value) {
  diagnostic_msgs::KeyValue pair;
  pair.key = key;
  pair.value = std::to_string(value);
  to->values.push_back(pair);
}

inline void said(diagnostic_msgs::DiagnosticStatus* to, const std::string& key,
                 const std::string& value) {
  diagnostic_msgs::KeyValue pair;
  pair.key = key;
  pair.value = value;
  to->values.push_back(pair);
}

/* What the trusted part says of itself; generated. */
struct StatusNames {
  uint64_t hash;
  std::vector<std::string> modules, leases, topics;
};

/* A topic of ROS that is bridged, either way. */
class Bridged {
 public:
  virtual ~Bridged() {}
  /* NULL, or why it cannot be opened. */
  virtual const char* open(const std::string& folder) = 0;
  /* Of one that goes out: until the end, on a thread of its own. */
  virtual void serve() {}
  virtual void diagnose(diagnostic_msgs::DiagnosticStatus* to) = 0;
  /* The topic of ROS that only this node may publish; "": it does not publish. */
  virtual std::string published() const { return ""; }
  /* Who else publishes it. */
  virtual void others(const std::string& /*names*/) {}
};

/* ------------------------------------------------------------------ in */

/* Traits `T` of a topic that comes in, generated:
 *   Message, Value       types
 *   channel(), hash()    of the channel
 *   topic()              of ROS
 *   publisher()          the node that may publish; "": the first one that is heard
 *   frame(m)             whether the message is in the frame of the mapping
 *   stamped()            whether messages say when they were measured
 *   stamp(m)             when
 *   convert(m, &value)   false: something that is needed is not there */
template <class T>
class Inward : public Bridged {
 public:
  Inward(ros::NodeHandle* node, double clock_error_s)
      : error_ns_(std::llround(clock_error_s * 1e9)), own_(*node), spinner_(1, &queue_) {
    own_.setCallbackQueue(&queue_); /* a flood on one topic is a flood on one thread */
  }

  const char* open(const std::string& folder) override {
    const char* const wrong = soter_outside_open(&channel_, folder.c_str(), T::channel(), T::hash(),
                                                 sizeof(typename T::Value), true);
    if (wrong == nullptr) {
      subscriber_ =
          own_.subscribe(T::topic(), 1, &Inward::on, this, ros::TransportHints().tcpNoDelay());
      spinner_.start();
    }
    return wrong;
  }

  void diagnose(diagnostic_msgs::DiagnosticStatus* to) override {
    const std::lock_guard<std::mutex> held(named_);
    to->name = std::string("soter: ") + T::topic();
    to->hardware_id = bound_;
    to->level = diagnostic_msgs::DiagnosticStatus::OK;
    to->message = taken_ > 0 ? "taken" : "nothing was taken yet";
    const uint64_t refused = stranger_ + frame_ + unstamped_ + future_ + absent_;
    if (refused != refused_told_) {
      to->level = diagnostic_msgs::DiagnosticStatus::ERROR;
      to->message = why_;
    } else if (taken_ == taken_told_) {
      to->level = diagnostic_msgs::DiagnosticStatus::WARN;
      to->message = "silent";
    }
    refused_told_ = refused;
    taken_told_ = taken_;
    said(to, "taken", taken_.load());
    said(to, "of another publisher", stranger_.load());
    said(to, "in another frame", frame_.load());
    said(to, "without a stamp", unstamped_.load());
    said(to, "stamped later than now", future_.load());
    said(to, "without a value", absent_.load());
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

  bool measured_at(const typename T::Message& m, int64_t* measured) {
    const int64_t now = monotonic_ns();
    *measured = now;
    if (!T::stamped()) {
      return true;
    }
    const ros::Time stamp = T::stamp(m);
    if (stamp.isZero()) {
      refuse(&unstamped_, "a message has no stamp");
      return false;
    }
    const int64_t age_ns = static_cast<int64_t>(ros::Time::now().toNSec()) -
                           static_cast<int64_t>(stamp.toNSec()); /* a Duration may not hold it */
    if (age_ns < -error_ns_) {
      refuse(&future_, "a message was stamped later than now: two clocks, or a wrong one");
      return false;
    }
    *measured = now - age_ns - error_ns_;
    *measured = *measured > now ? now : *measured;
    return true;
  }

  void on(const ros::MessageEvent<typename T::Message const>& event) {
    const typename T::Message& m = *event.getConstMessage();
    typename T::Value value;
    int64_t measured = 0;
    (void)std::memset(&value, 0, sizeof value);
    if (is_stranger(event.getPublisherName())) {
      refuse(&stranger_, "a second node publishes it: " + event.getPublisherName());
    } else if (!T::frame(m)) {
      refuse(&frame_, "a message is in another frame");
    } else if (measured_at(m, &measured)) {
      if (T::convert(m, &value)) {
        soter_outside_write(&channel_, measured, &value);
        taken_++;
      } else {
        refuse(&absent_, "a message has no such element, or a number that the topic cannot hold");
      }
    }
  }

  const int64_t error_ns_;
  soter_outside channel_ = soter_outside();
  ros::NodeHandle own_;
  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_;
  ros::Subscriber subscriber_;
  std::mutex named_;
  std::string bound_, why_;
  std::atomic<uint64_t> taken_{0}, stranger_{0}, frame_{0}, unstamped_{0}, future_{0}, absent_{0};
  uint64_t refused_told_ = 0, taken_told_ = 0;
};

/* ------------------------------------------------------------------ out */

/* Traits `T` of a topic that goes out, generated:
 *   Message, Value, channel(), hash(), topic()
 *   convert(value, stamp, &m)
 *   law(&value)          the fail-safe law; false: it has none, and silence follows silence
 *   silent_ns()          without a value for so long, whoever writes it is gone */
template <class T>
class Outward : public Bridged {
 public:
  static const int64_t RESEND_NS = 20000000; /* what does not change is said so often */
  static const int64_t WAIT_NS = 5000000;

  explicit Outward(ros::NodeHandle* node) : node_(node) {}

  const char* open(const std::string& folder) override {
    const char* const wrong = soter_outside_open(&channel_, folder.c_str(), T::channel(), T::hash(),
                                                 sizeof(typename T::Value), false);
    (void)std::memset(&value_, 0, sizeof value_);
    publisher_ = node_->advertise<typename T::Message>(T::topic(), 1);
    return wrong;
  }

  std::string published() const override { return publisher_.getTopic(); }

  void others(const std::string& names) override {
    const std::lock_guard<std::mutex> held(named_);
    others_ = names;
  }

  void serve() override {
    while (ros::ok()) {
      soter_outside_wait(&channel_, WAIT_NS);
      turn(monotonic_ns());
    }
  }

  void diagnose(diagnostic_msgs::DiagnosticStatus* to) override {
    const std::lock_guard<std::mutex> held(named_);
    to->name = std::string("soter: ") + T::topic();
    to->level =
        silent_ ? diagnostic_msgs::DiagnosticStatus::ERROR : diagnostic_msgs::DiagnosticStatus::OK;
    to->message = silent_ ? "nobody writes it: the actuators, or the trusted part, are gone"
                          : (count_ > 0 ? "published" : "nothing to publish yet");
    said(to, "published", count_.load());
    if (!others_.empty()) {
      to->level = diagnostic_msgs::DiagnosticStatus::ERROR;
      to->message = "published by another node, too, which nobody can keep from it: " + others_;
    }
  }

 private:
  void turn(int64_t now) {
    typename T::Value value;
    int64_t written = 0;
    if (soter_outside_read(&channel_, &written, &value, nullptr) && written >= begun_) {
      const bool changed = std::memcmp(&value, &value_, sizeof value) != 0;
      value_ = value;
      heard_ = now;
      silent_ = false;
      if (changed || now - told_ >= RESEND_NS) {
        tell(now, written);
      }
    } else if (heard_ > 0 && now - heard_ > T::silent_ns() && now - told_ >= RESEND_NS) {
      silent_ = true; /* nobody holds a lease, and nobody holds the law: it is held from here */
      if (T::law(&value_)) {
        tell(now, now);
      }
    }
  }

  void tell(int64_t now, int64_t written) {
    const ros::Time stamp = ros::Time::now() - ros::Duration().fromNSec(now - written);
    typename T::Message message;
    T::convert(value_, stamp, &message);
    publisher_.publish(message);
    told_ = now;
    count_++;
  }

  ros::NodeHandle* const node_;
  soter_outside channel_ = soter_outside();
  ros::Publisher publisher_;
  typename T::Value value_;
  const int64_t begun_ = monotonic_ns(); /* a channel may hold what somebody wrote long ago */
  int64_t told_ = 0, heard_ = 0;
  std::atomic<uint64_t> count_{0};
  std::atomic<bool> silent_{false};
  std::mutex named_;
  std::string others_;
};

/* ------------------------------------------------------------------ the node */

class Bridge {
 public:
  static const int64_t WAIT_NS = 20000000;
  static const int64_t DIAGNOSTICS_NS = 1000000000;

  explicit Bridge(const StatusNames& names) : names_(names), own_("~") {}

  /* False, and said, where it cannot run. */
  bool begin() {
    if (ros::Time::isSimTime()) {
      ROS_FATAL(
          "use_sim_time is set, and the trusted part runs on the machine's clock: under "
          "/clock start the simulation node");
      return false;
    }
    own_.param<std::string>("channels", folder_, "");
    own_.param<double>("clock_error", clock_error_s_, 0.0);
    if (folder_.empty()) {
      ROS_FATAL("the parameter ~channels is not set: the folder of the trusted part's channels");
      return false;
    }
    if (!(clock_error_s_ >= 0.0 && clock_error_s_ <= 1.0)) {
      ROS_FATAL("the parameter ~clock_error is no time from 0 to 1 s");
      return false;
    }
    diagnostics_ = node_.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 1);
    return true;
  }

  template <class T>
  void in() {
    topics_.emplace_back(new Inward<T>(&node_, clock_error_s_));
  }

  template <class T>
  void out() {
    topics_.emplace_back(new Outward<T>(&node_));
    outward_.push_back(topics_.back().get());
  }

  int run() {
    for (const std::unique_ptr<Bridged>& topic : topics_) {
      if (const char* const wrong = topic->open(folder_)) {
        ROS_FATAL("a channel of `%s` cannot be opened: %s", folder_.c_str(), wrong);
        return 1;
      }
    }
    words_.resize(
        SOTER_STATUS_WORDS(names_.modules.size(), names_.leases.size(), names_.topics.size()));
    if (const char* const wrong =
            soter_outside_open(&status_, folder_.c_str(), SOTER_STATUS_CHANNEL, names_.hash,
                               words_.size() * sizeof words_[0], false)) {
      ROS_FATAL("the channel `%s` cannot be opened: %s", SOTER_STATUS_CHANNEL, wrong);
      return 1;
    }
    std::vector<std::thread> threads;
    threads.emplace_back(&Bridge::watch, this); /* asks the master, which may be slow, or gone */
    for (Bridged* const topic : outward_) {
      threads.emplace_back(&Bridged::serve, topic);
    }
    turns();
    for (std::thread& thread : threads) {
      thread.join();
    }
    return 0;
  }

 private:
  void turns() {
    int64_t told = monotonic_ns();
    while (ros::ok()) {
      soter_outside_wait(&status_, WAIT_NS);
      const int64_t now = monotonic_ns();
      const bool changed = hear(now);
      if (changed || now - told >= DIAGNOSTICS_NS) {
        diagnose(now);
        told = now;
      }
      ros::spinOnce();
    }
  }

  /* Once a second: does somebody else publish what only this node may? */
  void watch() {
    while (ros::ok()) {
      XmlRpc::XmlRpcValue request(ros::this_node::getName()), answer, state;
      if (ros::master::execute("getSystemState", request, answer, state, false) &&
          state.getType() == XmlRpc::XmlRpcValue::TypeArray && state.size() == 3) {
        for (Bridged* const topic : outward_) {
          topic->others(publishers(&state[0], topic->published()));
        }
      }
      for (int i = 0; i < 10 && ros::ok(); i++) {
        ros::WallDuration(0.1).sleep();
      }
    }
  }

  static std::string publishers(XmlRpc::XmlRpcValue* all, const std::string& topic) {
    std::string names;
    for (int i = 0; i < all->size(); i++) {
      XmlRpc::XmlRpcValue& entry = (*all)[i];
      if (static_cast<std::string>(entry[0]) != topic) {
        continue;
      }
      for (int k = 0; k < entry[1].size(); k++) {
        const std::string name = entry[1][k];
        names += name == ros::this_node::getName() ? "" : (names.empty() ? "" : ", ") + name;
      }
    }
    return names;
  }

  /* Whether a module changed its mode, or leases ended. */
  bool hear(int64_t now) {
    std::vector<uint64_t> words(words_.size());
    int64_t written = 0;
    if (!soter_outside_read(&status_, &written, words.data(), nullptr)) {
      return false;
    }
    heard_ = now;
    status_at_ = written;
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

  size_t lease_at(size_t k) const {
    return SOTER_STATUS_HEAD + SOTER_STATUS_MODULE * names_.modules.size() + SOTER_STATUS_LEASE * k;
  }

  void of_module(size_t k, bool alive, diagnostic_msgs::DiagnosticStatus* to) const {
    static const char* const causes[SOTER_STATUS_CAUSES] = {
        "takeovers: ttf", "takeovers: what the DM reads is old", "takeovers: the gate",
        "takeovers: AC is silent", "takeovers: the trusted part was late"};
    const uint64_t* const m = &words_[SOTER_STATUS_HEAD + SOTER_STATUS_MODULE * k];
    const bool ac = m[SOTER_STATUS_MODE] == 1U;
    to->name = "soter: module " + names_.modules[k];
    to->level = !alive ? diagnostic_msgs::DiagnosticStatus::STALE
                : ac   ? diagnostic_msgs::DiagnosticStatus::OK
                       : diagnostic_msgs::DiagnosticStatus::WARN;
    to->message = !alive ? "the trusted part is silent" : ac ? "AC has control" : "SC has control";
    said(to, "mode", std::string(ac ? "AC" : "SC"));
    for (size_t c = 0; c < SOTER_STATUS_CAUSES; c++) {
      said(to, causes[c], m[SOTER_STATUS_TAKEOVERS + c]);
    }
    for (size_t l = 0; l < names_.leases.size(); l++) {
      if (names_.leases[l] != names_.modules[k]) {
        continue;
      }
      const uint64_t* const lease = &words_[lease_at(l)];
      said(to, "leases given", lease[SOTER_STATUS_GIVEN]);
      if (lease[SOTER_STATUS_ENDED] != 0U) {
        to->level = diagnostic_msgs::DiagnosticStatus::ERROR;
        to->message = "its leases have ended: the actuators hold the fail-safe law";
      }
    }
  }

  void diagnose(int64_t now) {
    diagnostic_msgs::DiagnosticArray all;
    all.header.stamp = ros::Time::now();
    const bool alive = heard_ > 0 && now - status_at_ < 5 * SOTER_STATUS_EVERY_NS;
    for (size_t k = 0; k < names_.modules.size(); k++) {
      diagnostic_msgs::DiagnosticStatus status;
      of_module(k, alive, &status);
      said(&status, "late releases and completions", words_[SOTER_STATUS_MISSED]);
      all.status.push_back(status);
    }
    for (size_t k = 0; k < names_.topics.size(); k++) {
      const size_t at = lease_at(names_.leases.size()) + SOTER_STATUS_TOPIC * k;
      diagnostic_msgs::DiagnosticStatus status;
      status.name = "soter: the trusted part's " + names_.topics[k];
      status.level = diagnostic_msgs::DiagnosticStatus::OK;
      said(&status, "taken", words_[at + SOTER_STATUS_TAKEN]);
      said(&status, "not finite, or outside its set", words_[at + SOTER_STATUS_REFUSED]);
      said(&status, "older than the one before", words_[at + SOTER_STATUS_OLDER]);
      said(&status, "later than now", words_[at + SOTER_STATUS_FUTURE]);
      all.status.push_back(status);
    }
    for (const std::unique_ptr<Bridged>& topic : topics_) {
      diagnostic_msgs::DiagnosticStatus status;
      topic->diagnose(&status);
      all.status.push_back(status);
    }
    diagnostics_.publish(all);
  }

  const StatusNames names_;
  ros::NodeHandle node_, own_;
  std::string folder_;
  double clock_error_s_ = 0.0;
  ros::Publisher diagnostics_;
  std::vector<std::unique_ptr<Bridged>> topics_;
  std::vector<Bridged*> outward_;
  soter_outside status_ = soter_outside();
  std::vector<uint64_t> words_;
  int64_t heard_ = 0, status_at_ = 0;
};

} /* namespace soter */

#endif
