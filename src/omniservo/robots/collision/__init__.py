"""Collision checking: convex bodies of an arm and its surroundings, proven distances, lines of sight."""
