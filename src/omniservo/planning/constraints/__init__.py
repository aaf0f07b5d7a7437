"""One file a family of constraints: its proof on [0, 1], its push on the search, its margin at one w."""
