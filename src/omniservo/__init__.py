"""Certified visual-servo path planning for every central camera."""

__version__ = "0.1.0"
