"""The fast search: the scores of the definition at all perturbations of all particles, the same integers at once."""
