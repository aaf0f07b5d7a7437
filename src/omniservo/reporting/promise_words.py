"""The three words of every comparison, the same in tiles, tables and legends."""

REQUIRED = "required"
"""what the task requires"""
CERTIFIED = "certified (planned path)"
"""what is proven for the whole planned path, before the arm moved: a lower bound"""
EXECUTED = "executed (measured)"
"""what was measured of the arm's motion"""
