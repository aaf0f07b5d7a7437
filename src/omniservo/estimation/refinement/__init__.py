"""Least squares on pixels: motion, pose, planes, many views; and the search among their minima."""
