"""Features with their interaction matrices, control law and time laws."""
