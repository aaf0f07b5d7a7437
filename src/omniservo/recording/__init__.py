"""Runs as MCAP files, which Foxglove and ROS 2 tools open."""
