/* soter_bridge.hpp: the bridge in roscpp.
 *
 * Purpose: subscriptions, publications, parameters, /diagnostics and the master around
 * soter_bridge_core.hpp, for a package that `soter build --target ros1` writes.
 * Non-goals: what is judged (the core), simulated time (soter_simulation.hpp). C++11.
 */
#ifndef SOTER_BRIDGE_HPP
#define SOTER_BRIDGE_HPP

#include "soter_bridge_core.hpp"
#include "soter_messages.hpp"

#include <diagnostic_msgs/DiagnosticArray.h>
#include <ros/callback_queue.h>
#include <ros/master.h>
#include <ros/ros.h>
#include <ros/this_node.h>
#include <ros/xmlrpc_manager.h>

#include <cmath>
#include <functional>
#include <memory>
#include <thread>

namespace soter {

/* A topic of ROS that is bridged, either way. */
class Bridged {
 public:
  virtual ~Bridged() {}
  virtual const char* open(const std::string& folder) = 0;
  virtual Status status() = 0;
  /* Of one that goes out: until the end, on a thread of its own. */
  virtual void serve() {}
  /* The topic that only this node may publish, and who else does. */
  virtual std::string published() const { return ""; }
  virtual void others(const std::string& /*names*/) {}
};

template <class T>
class BridgedIn : public Bridged {
 public:
  BridgedIn(ros::NodeHandle* node, int64_t clock_error_ns)
      : inward_(clock_error_ns), own_(*node), spinner_(1, &queue_) {
    own_.setCallbackQueue(&queue_); /* a flood on one topic is a flood on one thread */
  }

  const char* open(const std::string& folder) override {
    const char* const wrong = inward_.open(folder);
    if (wrong == nullptr) {
      subscriber_ =
          own_.subscribe(T::topic(), 1, &BridgedIn::on, this, ros::TransportHints().tcpNoDelay());
      spinner_.start();
    }
    return wrong;
  }

  Status status() override { return inward_.status(); }

 private:
  typedef ros::MessageEvent<typename T::Message const> Event;

  void on(const Event& event) {
    const int64_t now = monotonic_ns();
    if (!T::stamped() && is_latched(event.getConnectionHeader())) {
      inward_.refuse_undated();
      return;
    }
    inward_.take(*event.getConstMessage(), event.getPublisherName(), now, ns_of(ros::Time::now()));
  }

  Inward<T> inward_;
  ros::NodeHandle own_;
  ros::CallbackQueue queue_;
  ros::AsyncSpinner spinner_;
  ros::Subscriber subscriber_;
};

template <class T>
class BridgedOut : public Bridged {
 public:
  explicit BridgedOut(ros::NodeHandle* node) : node_(node) {}

  const char* open(const std::string& folder) override {
    publisher_ = node_->advertise<typename T::Message>(T::topic(), 1);
    return outward_.open(folder);
  }

  void serve() override {
    outward_.serve([] { return ros::ok() && stage() == 1; }, [] { return ns_of(ros::Time::now()); },
                   [this](const typename T::Value& value, int64_t stamp_ns) {
                     typename T::Message message;
                     T::convert(value, stamp_ns, &message);
                     publisher_.publish(message);
                   });
  }

  Status status() override { return outward_.status(); }
  std::string published() const override { return publisher_.getTopic(); }
  void others(const std::string& names) override { outward_.others(names); }

 private:
  ros::NodeHandle* const node_;
  ros::Publisher publisher_;
  Outward<T> outward_;
};

class Bridge {
 public:
  static const int64_t DIAGNOSTICS_NS = 1000000000;

  explicit Bridge(const StatusNames& names) : trusted_(names), own_("~") {}

  /* False, and said, where it cannot run. */
  bool begin() {
    double clock_error_s = 0.0;
    if (ros::Time::isSimTime()) {
      ROS_FATAL(
          "use_sim_time is set, and the trusted part runs on the machine's clock: under "
          "/clock start the simulation node");
      return false;
    }
    own_.param<std::string>("channels", folder_, "");
    const bool told = own_.hasParam("clock_error");
    if (folder_.empty()) {
      ROS_FATAL("the parameter ~channels is not set: the folder of the trusted part's channels");
      return false;
    }
    if ((told && !own_.getParam("clock_error", clock_error_s)) ||
        !(clock_error_s >= 0.0 && clock_error_s <= 1.0)) {
      ROS_FATAL(
          "the parameter ~clock_error is no time from 0 to 1 s (0.01 is a number, and 1e-2 a text "
          "in YAML)");
      return false;
    }
    clock_error_ns_ = std::llround(clock_error_s * 1e9);
    diagnostics_ = node_.advertise<diagnostic_msgs::DiagnosticArray>("/diagnostics", 1);
    return true;
  }

  template <class T>
  void in() {
    topics_.emplace_back(new BridgedIn<T>(&node_, clock_error_ns_));
  }

  template <class T>
  void out() {
    topics_.emplace_back(new BridgedOut<T>(&node_));
  }

  /* How the modules are, for machines, on ~status: a message of this type each. */
  template <class Message>
  void status() {
    status_ =
        own_.advertise<Message>("status", static_cast<uint32_t>(trusted_.modules().size()), true);
    tell_ = [this](const ModuleStatus& of, const ros::Time& now) {
      Message to;
      to.stamp = now;
      to.module = of.name;
      to.mode = of.mode;
      to.margin = of.margin_s;
      to.takeovers = of.takeovers;
      to.why = of.why;
      to.armed = of.armed ? 1U : 0U;
      to.unchecked = of.unchecked ? 1U : 0U;
      to.message = of.message;
      status_.publish(to);
    };
  }

  int run() {
    const char* wrong = trusted_.open(folder_);
    for (size_t k = 0; wrong == nullptr && k < topics_.size(); k++) {
      wrong = topics_[k]->open(folder_);
    }
    if (wrong != nullptr) {
      ROS_FATAL("a channel in `%s` cannot be opened: %s", folder_.c_str(), wrong);
      return 1;
    }
    std::vector<std::thread> threads;
    stage() = 1;
    ros::XMLRPCManager::instance()->unbind("shutdown");
    ros::XMLRPCManager::instance()->bind(
        "shutdown", [](XmlRpc::XmlRpcValue&, XmlRpc::XmlRpcValue& answer) {
          stage() = 2; /* `rosnode kill`, or another node of this name */
          answer = ros::xmlrpc::responseInt(1, "", 0);
        });
    std::thread master(&Bridge::watch, this); /* asks the master, which may be slow, or gone */
    for (const std::unique_ptr<Bridged>& topic : topics_) {
      threads.emplace_back(&Bridged::serve, topic.get());
    }
    turns();
    for (std::thread& thread : threads) {
      thread.join();
    }
    soter_process_ending();
    ros::WallDuration(0.1).sleep(); /* what was published last goes out */
    ros::shutdown();
    master.join();
    return 0;
  }

 private:
  void turns() {
    int64_t told = monotonic_ns();
    while (ros::ok() && stage() == 1) {
      const bool changed = trusted_.hear();
      const int64_t now = monotonic_ns();
      if (changed || now - told >= DIAGNOSTICS_NS) {
        diagnose();
        told = now;
      }
      ros::spinOnce();
    }
  }

  void diagnose() {
    std::vector<Status> all = trusted_.statuses();
    for (const std::unique_ptr<Bridged>& topic : topics_) {
      all.push_back(topic->status());
    }
    diagnostic_msgs::DiagnosticArray message;
    message.header.stamp = ros::Time::now();
    fill(all, &message);
    diagnostics_.publish(message);
    for (const ModuleStatus& module : trusted_.modules()) {
      tell_(module, message.header.stamp);
    }
  }

  /* Once a second: does another node publish what only this one may? */
  void watch() {
    while (ros::ok()) {
      XmlRpc::XmlRpcValue request(ros::this_node::getName()), answer, state;
      if (ros::master::execute("getSystemState", request, answer, state, false) &&
          state.getType() == XmlRpc::XmlRpcValue::TypeArray && state.size() == 3) {
        for (const std::unique_ptr<Bridged>& topic : topics_) {
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

  TrustedPart trusted_;
  ros::NodeHandle node_, own_;
  std::string folder_;
  int64_t clock_error_ns_ = 0;
  ros::Publisher diagnostics_, status_;
  std::function<void(const ModuleStatus&, const ros::Time&)> tell_ = [](const ModuleStatus&,
                                                                        const ros::Time&) {};
  std::vector<std::unique_ptr<Bridged>> topics_;
};

} /* namespace soter */

#endif
