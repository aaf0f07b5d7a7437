"""From a problem to a proven path: starts, descents at samples, proofs, least effort."""
