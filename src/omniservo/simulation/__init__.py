"""The world, the ray-cast camera, the simulated robot and the closed loop."""
