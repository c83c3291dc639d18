"""The fast search: the integers of the definition, a thousand times faster."""
