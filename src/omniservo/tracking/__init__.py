"""Following a plan by the image: the one place that joins a plan and features."""
