"""Recordings for the tools of robotics: MCAP files of ROS 2 messages, without ROS."""
