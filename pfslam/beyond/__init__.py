"""What lies beyond the report: a map for every particle, a robot lost in a known map, and loops that are closed."""
