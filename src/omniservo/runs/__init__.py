"""Whole jobs: a task becomes a folder of results."""
