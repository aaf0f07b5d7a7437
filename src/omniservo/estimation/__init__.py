"""Bearings of two views to motion and structure."""
