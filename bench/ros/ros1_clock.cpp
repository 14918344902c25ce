/* ros1_clock.cpp: /clock in uneven steps, quicker than time, until it is ended.
 *
 * usage: ros1_clock STEP_MS [JUMP_BACK_AT_S]: at that time, once, /clock goes back to its begin.
 */
#include <ros/ros.h>
#include <rosgraph_msgs/Clock.h>

#include <cstdlib>

int main(int count, char** words) {
  ros::init(count, words, "clock");
  ros::NodeHandle node;
  const ros::Publisher out = node.advertise<rosgraph_msgs::Clock>("/clock", 1000);
  const double step_s = std::atof(words[1]) * 1e-3;
  double back_at_s = count > 2 ? std::atof(words[2]) : 0.0;
  while (ros::ok() && out.getNumSubscribers() == 0) {
    ros::WallDuration(0.01).sleep();
  }
  double t = 100.0;
  for (unsigned long k = 0; ros::ok(); k++) {
    rosgraph_msgs::Clock m;
    m.clock = ros::Time(t);
    out.publish(m);
    t += step_s * (k % 3 == 0 ? 0.5 : k % 3 == 1 ? 1.0 : 1.5); /* Gazebo's are even, bags' are not */
    if (back_at_s > 0.0 && t > 100.0 + back_at_s) {
      t = 100.0;
      back_at_s = 0.0;
    }
    ros::WallDuration(0.0002).sleep();
  }
}
