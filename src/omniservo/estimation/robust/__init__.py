"""Outliers: consensus over random samples, and which matches belong to a motion."""
