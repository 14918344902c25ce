/* ros1_echo.cpp: the bare middleware: what /odom says comes back on /cmd_vel. */
#include <geometry_msgs/Twist.h>
#include <nav_msgs/Odometry.h>
#include <ros/ros.h>

static ros::Publisher out;

static void echo(const nav_msgs::Odometry::ConstPtr& in) {
  geometry_msgs::Twist m;
  m.linear.x = in->pose.pose.position.x;
  out.publish(m);
}

int main(int count, char** words) {
  ros::init(count, words, "echo");
  ros::NodeHandle node;
  out = node.advertise<geometry_msgs::Twist>("/cmd_vel", 1);
  const ros::Subscriber in =
      node.subscribe("/odom", 1, echo, ros::TransportHints().tcpNoDelay());
  ros::spin();
}
