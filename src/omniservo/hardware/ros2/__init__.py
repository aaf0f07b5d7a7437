"""ROS 2 without ROS: its messages over DDS, for arms and cameras (`pip install omniservo[ros2]`)."""
