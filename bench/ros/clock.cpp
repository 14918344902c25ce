/* clock.cpp: /clock in uneven steps, quicker than time, until it is ended.
 *
 * usage: clock STEP_MS [JUMP_BACK_AT_S]: at that time, once, /clock goes back to its begin.
 */
#include "either_ros.hpp"

#include <cstdlib>

int main(int count, char** words) {
  Node node(count, words, "clock");
  const Out<Clock> out = node.out<Clock>("/clock", 1000);
  const double step_s = std::atof(words[1]) * 1e-3;
  double back_at_s = count > 2 ? std::atof(words[2]) : 0.0;
  while (Node::ok() && out.listeners() == 0) {
    node.spin(10000000);
  }
  double t = 100.0;
  for (unsigned long k = 0; Node::ok(); k++) {
    Clock m;
    m.clock = time_of(static_cast<int64_t>(t * 1e9));
    out.publish(m);
    t += step_s * (k % 3 == 0 ? 0.5 : k % 3 == 1 ? 1.0 : 1.5); /* Gazebo's are even, bags' are not */
    if (back_at_s > 0.0 && t > 100.0 + back_at_s) {
      t = 100.0;
      back_at_s = 0.0;
    }
    node.spin(200000);
  }
}
