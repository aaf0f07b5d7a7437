"""Ours beside other people's: planners (`planning`), motion and pose estimation (`motion`, `pose`).

They need what requirements-bench.lock lists, and write docs/benchmark-planning.md and
docs/benchmark-estimation.md (`make bench-planning`, `make bench-estimation`). Every other benchmark measures
this package alone.
"""
