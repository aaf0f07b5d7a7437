"""Joint paths that carry a camera along its path, and how far an arm deviates from one."""
