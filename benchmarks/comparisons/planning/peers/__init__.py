"""One file a peer, each with ``solve(problem, neutral, budget) -> Attempt`` (see `attempt`)."""
