"""The unified camera: pixels to bearings and back, its domain, its image limits as cones."""
