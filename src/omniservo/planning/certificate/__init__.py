"""What is proven of a path: every constraint with its margin and, about bodies, the planes that show it."""
