"""Forward and inverse kinematics, Jacobians and singularities of an arm."""
