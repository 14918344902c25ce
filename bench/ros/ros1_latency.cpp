/* ros1_latency.cpp: how long a message is on its way.
 *
 * usage: ros1_latency echo|bridge COUNT FOLDER. `echo`: from publishing /odom until /cmd_vel is
 * there, with ros1_echo between. `bridge`: from publishing /odom until the value is in the channel
 * of the topic, and from writing the channel of the command until /cmd_vel is there, with the
 * bridge of a package between, each by itself. A line a sample: microseconds.
 */
#include "shuttle_ros_topics.hpp"
#include "soter_outside.h"

#include <geometry_msgs/Twist.h>
#include <nav_msgs/Odometry.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <time.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>

static double back = -1.0;

static int64_t now_ns() {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<int64_t>(t.tv_sec) * 1000000000 + t.tv_nsec;
}

static void hear(const geometry_msgs::Twist::ConstPtr& m) {
  back = m->linear.x;
}

static void say(const ros::Publisher& out, double x) {
  nav_msgs::Odometry m;
  m.header.stamp = ros::Time::now();
  m.header.frame_id = "odom";
  m.pose.pose.position.x = x;
  out.publish(m);
}

static bool await_message(double x) {
  const int64_t end = now_ns() + 200000000;
  while (back != x && now_ns() < end) {
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.01));
  }
  return back == x;
}

static bool await_value(soter_outside* channel, double x) {
  const int64_t end = now_ns() + 200000000;
  double value = -1.0;
  int64_t at = 0;
  while (value != x && now_ns() < end) {
    soter_outside_wait(channel, 10000000);
    (void)soter_outside_read(channel, &at, &value, nullptr);
  }
  return value == x;
}

int main(int count, char** words) {
  const bool bridge = std::strcmp(words[1], "bridge") == 0;
  ros::init(count, words, "latency");
  ros::NodeHandle node;
  const ros::Publisher out = node.advertise<nav_msgs::Odometry>("/odom", 1);
  const ros::Subscriber in =
      node.subscribe("/cmd_vel", 1, hear, ros::TransportHints().tcpNoDelay());
  soter_outside position, speed;
  if (bridge) {
    (void)soter_outside_open(&position, words[3], PositionIn::channel(), PositionIn::hash(), 8,
                             false);
    (void)soter_outside_open(&speed, words[3], SpeedOut::channel(), SpeedOut::hash(), 8, true);
  }
  while (ros::ok() && (out.getNumSubscribers() == 0 || in.getNumPublishers() == 0)) {
    ros::WallDuration(0.05).sleep();
  }
  ros::WallDuration(1.0).sleep();
  for (int k = 1; ros::ok() && k <= std::atoi(words[2]); k++) {
    const double x = 1e-3 * k;
    const int64_t start = now_ns();
    say(out, x);
    bool fine = bridge ? await_value(&position, x) : await_message(x);
    const int64_t middle = now_ns();
    if (bridge && fine) {
      soter_outside_write(&speed, now_ns(), &x);
      fine = await_message(x);
    }
    const int64_t end = now_ns();
    if (fine) {
      std::printf("%.1f %.1f\n", 1e-3 * static_cast<double>(middle - start),
                  1e-3 * static_cast<double>(end - middle));
    } else {
      std::printf("lost\n");
    }
    ros::WallDuration(0.005).sleep(); /* as odometry comes */
  }
}
