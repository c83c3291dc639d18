"""How good a run was, and whether to trust it."""
