"""Ours beside other people's: planners, motion and pose, and the suites that Debian packages.

`planning`; `motion`, `pose`; `visp`, `opengv`, `mrcal`. They need what requirements-bench.lock lists, and
write docs/benchmark-planning.md, docs/benchmark-estimation.md and docs/outside-suites.md (`make
bench-planning`, `make bench-estimation`, `make bench-outside`). Every other benchmark measures this package
alone.
"""
