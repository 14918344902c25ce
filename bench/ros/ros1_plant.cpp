/* ros1_plant.cpp: a shuttle that obeys /cmd_vel and says /odom 200 times a second.
 *
 * Every command is written down, when it came (CLOCK_MONOTONIC, ns), what it says and where the
 * shuttle was. A base as it is sold: the last command counts until another comes.
 */
#include <geometry_msgs/Twist.h>
#include <nav_msgs/Odometry.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <time.h>

#include <cinttypes>
#include <cmath>
#include <cstdio>
#include <cstdlib>

static double x, u, farthest;

static int64_t now_ns() {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<int64_t>(t.tv_sec) * 1000000000 + t.tv_nsec;
}

static void obey(const geometry_msgs::Twist::ConstPtr& m) {
  if (m->linear.x != u) {
    std::printf("%" PRId64 " %.6f %.6f\n", now_ns(), m->linear.x, x);
    std::fflush(stdout);
  }
  u = m->linear.x;
}

int main(int count, char** words) {
  ros::init(count, words, "plant");
  ros::NodeHandle node;
  const ros::Publisher odometry = node.advertise<nav_msgs::Odometry>("/odom", 1);
  const ros::Subscriber commands =
      node.subscribe("/cmd_vel", 1, obey, ros::TransportHints().tcpNoDelay());
  int64_t next = now_ns(), last = next;
  while (ros::ok()) {
    next += 5000000;
    for (int64_t left; (left = next - now_ns()) > 0;) {
      ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(left * 1e-9));
    }
    const int64_t now = now_ns(); /* real time passes, whether or not we were scheduled */
    x += u * static_cast<double>(now - last) * 1e-9;
    last = now;
    next = next < now - 100000000 ? now : next;
    farthest = std::fabs(x) > farthest ? std::fabs(x) : farthest;
    nav_msgs::Odometry m;
    m.header.stamp = ros::Time::now();
    m.header.frame_id = "odom";
    m.pose.pose.position.x = x;
    m.pose.pose.orientation.w = 1.0;
    m.twist.twist.linear.x = u;
    odometry.publish(m);
  }
  std::printf("farthest %.6f\n", farthest);
  return 0;
}
