/* plant.cpp: a shuttle that obeys /cmd_vel and says /odom 200 times a second.
 *
 * Every command is written down, when it came (CLOCK_MONOTONIC, ns), what it says and where the
 * shuttle was. A base as it is sold: the last command counts until another comes.
 */
#include "either_ros.hpp"

#include <cinttypes>
#include <cmath>
#include <cstdio>

int main(int count, char** words) {
  Node node(count, words, "plant");
  double x = 0.0, u = 0.0, farthest = 0.0;
  const Out<Odometry> odometry = node.out<Odometry>("/odom", 1);
  node.in<Twist>("/cmd_vel", [&](const Twist& m) {
    if (m.linear.x != u) {
      std::printf("%" PRId64 " %.6f %.6f\n", now_ns(), m.linear.x, x);
      std::fflush(stdout);
    }
    u = m.linear.x;
  });
  int64_t next = now_ns(), last = next;
  while (Node::ok()) {
    next += 5000000;
    node.spin(next - now_ns());
    const int64_t now = now_ns(); /* real time passes, whether or not we were scheduled */
    x += u * static_cast<double>(now - last) * 1e-9;
    last = now;
    next = next < now - 100000000 ? now : next;
    farthest = std::fabs(x) > farthest ? std::fabs(x) : farthest;
    Odometry m;
    m.header.stamp = time_of(now_ns(CLOCK_REALTIME));
    m.header.frame_id = "odom";
    m.pose.pose.position.x = x;
    m.pose.pose.orientation.w = 1.0;
    m.twist.twist.linear.x = u;
    odometry.publish(m);
  }
  std::printf("farthest %.6f\n", farthest);
  return 0;
}
