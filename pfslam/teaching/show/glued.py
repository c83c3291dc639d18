"""Numbers that a cell computes and the prose quotes."""

from __future__ import annotations


def glue_numbers(digits: int = 2, **numbers) -> None:
    """Hand numbers to the text of the book, each under its name: ``{glue:text}`name:.2f```.

    They are rounded here, so that the last bits of another processor cannot change a committed notebook. Where
    the book's machinery is not installed, as with a student, nobody asks for them and nothing happens.
    """
    try:
        from myst_nb import glue
    except ModuleNotFoundError:
        return

    for name, value in numbers.items():
        glue(name, round(float(value), digits), display=False)
