"""Random numbers that were drawn elsewhere, so that two programs can throw the same dice."""

import numpy as np


class Handed:
    """Gives the numbers that it is handed, one entry a call, in the place of a generator."""

    def __init__(self, *numbers):
        self.numbers = list(numbers)

    def standard_normal(self, n):
        assert len(self.numbers[0]) == n
        return np.array(self.numbers.pop(0))

    def random(self):
        return self.numbers.pop(0)
