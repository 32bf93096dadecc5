"""The project's types <-> ROS messages, coded once, for the message classes of rclpy and of bags alike."""
