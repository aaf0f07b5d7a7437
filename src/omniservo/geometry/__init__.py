"""Array checks, compiled kernels, polynomial bases and bearings."""
