"""ViSP's own suites: its tutorial scene's velocities (`velocities.cpp`) and its AprilTag images."""
