"""Figures, animation and the HTML report of a run."""
