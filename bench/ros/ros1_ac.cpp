/* ros1_ac.cpp: an advanced controller that hurries to one wall and then to the other, 100 Hz. */
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>
#include <std_msgs/Float64.h>

static double wish = 0.75;

static void look(const nav_msgs::Odometry::ConstPtr& m) {
  const double x = m->pose.pose.position.x;
  wish = x > 8.0 ? -0.75 : x < -8.0 ? 0.75 : wish;
}

int main(int count, char** words) {
  ros::init(count, words, "ac");
  ros::NodeHandle node;
  const ros::Publisher out = node.advertise<std_msgs::Float64>("/wish", 1);
  const ros::Subscriber in = node.subscribe("/odom", 1, look, ros::TransportHints().tcpNoDelay());
  ros::WallRate rate(100.0);
  while (ros::ok()) {
    std_msgs::Float64 m;
    m.data = wish;
    out.publish(m);
    ros::spinOnce();
    rate.sleep();
  }
}
