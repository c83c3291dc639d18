"""Texture mapping: from image pairs to a picture of the floor (Eq. 4, 16 to 18)."""
