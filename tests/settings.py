"""The numbers in nested configurations, by dotted name."""

from dataclasses import fields, is_dataclass, replace


def numbers(config, prefix=""):
    """Dotted names and values of all numbers, and pairs and triples of numbers, in nested configurations."""
    for f in fields(config):
        value = getattr(config, f.name)
        if is_dataclass(value):
            yield from numbers(value, f"{prefix}{f.name}.")
        elif isinstance(value, (int, float, tuple)) and not isinstance(value, bool) and value != ():
            yield prefix + f.name, value


def replaced(config, name, value):
    """A configuration with the field ``name``, dotted, replaced."""
    first, _, rest = name.partition(".")
    return replace(config, **{first: replaced(getattr(config, first), rest, value) if rest else value})


def field_of(config, name):
    """The dataclass field that a dotted name means."""
    first, _, rest = name.partition(".")
    return field_of(getattr(config, first), rest) if rest else type(config).__dataclass_fields__[first]
