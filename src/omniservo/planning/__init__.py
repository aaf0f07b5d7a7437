"""Certified camera paths: problem, constraints, search, certificate, plan."""
