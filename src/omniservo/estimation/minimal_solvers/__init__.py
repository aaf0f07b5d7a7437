"""Motions and poses from as few matches as determine them, and points from known views."""
