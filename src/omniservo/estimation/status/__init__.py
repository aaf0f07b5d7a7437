"""What residuals allow to say: degenerate motions, another camera, rival answers, squares."""
