"""Real arms and cameras: their adapters, their clocks, the file that names them."""
