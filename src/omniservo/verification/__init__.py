"""The independent, exact check of a plan file. Imports nothing else of ours."""
