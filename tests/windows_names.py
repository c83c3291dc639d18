"""What Windows does not take as the name of a file."""

import re
from collections import Counter
from collections.abc import Iterable

DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³])(\..*)?", re.IGNORECASE)
FORBIDDEN = re.compile(r'[<>:"|?*\\\x00-\x1f]|[. ]$')
LONGEST = 259
"""Letters of a whole path, as long as nobody with administrator rights allows more."""


def refused(names: Iterable[str], below: str = "") -> list[str]:
    """The paths, with slashes between their parts, that Windows does not take in a folder.

    Two that differ only by large and small letters are one file there, and so both are refused.
    """
    names = list(names)
    same = Counter(name.lower() for name in names)

    def taken(name: str) -> bool:
        parts = name.split("/")
        clean = not any(DEVICE.fullmatch(part) or FORBIDDEN.search(part) for part in parts)
        return clean and same[name.lower()] == 1 and len(below) + len(name) <= LONGEST

    return [name for name in names if not taken(name)]
