/* ac.cpp: an advanced controller that hurries to one wall and then to the other, 100 Hz. */
#include "either_ros.hpp"

int main(int count, char** words) {
  Node node(count, words, "ac");
  double wish = 0.75;
  const Out<Float64> out = node.out<Float64>("/wish", 1);
  node.in<Odometry>("/odom", [&wish](const Odometry& m) {
    const double x = m.pose.pose.position.x;
    wish = x > 8.0 ? -0.75 : x < -8.0 ? 0.75 : wish;
  });
  while (Node::ok()) {
    Float64 m;
    m.data = wish;
    out.publish(m);
    node.spin(10000000);
  }
}
