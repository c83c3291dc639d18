"""The one error that bad input raises."""


class DataError(ValueError):
    """Report input that cannot be used.

    The message is one line that names the source, the field, the value found and what was expected,
    so that the command line can print it as it is.
    """

    def __init__(self, source: object, field: str, found: object, expected: str):
        self.source, self.field, self.found, self.expected = str(source), field, _short(found), expected
        super().__init__(" ".join(f"{self.source}: {field}: found {self.found}, expected {expected}".split()))


def _short(found: object) -> str:
    """Cut what was found where it gets long, because damaged input can have any length."""
    text = str(found)
    return text if len(text) <= 160 else text[:157] + "..."
