"""The arm (kinematics, limits) and the protocol that every robot, real or simulated, implements."""
