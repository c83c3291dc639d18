"""Pack folders for others: `pack.py zip FOLDER FILE.zip` and `pack.py sums FOLDER`.

The same files give the same archive, byte for byte: entries are sorted and carry no time, owner or mode of this
machine. Beside the archive stands its SHA-256, as ``sha256sum --check`` reads it.
"""

import hashlib
import sys
import zipfile
from pathlib import Path

EPOCH = (1980, 1, 1, 0, 0, 0)
MODE = 0o100644 << 16
SUMS = "SHA256SUMS"


def pack(folder: Path, archive: Path) -> Path:
    """All files of a folder below one top folder, named like the archive; gives the file with the checksum."""
    files = sorted((path for path in folder.rglob("*") if path.is_file()), key=lambda path: path.as_posix())
    if not files:
        sys.exit(f"{folder}: found no file to pack")
    archive.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as target:
        for path in files:
            entry = zipfile.ZipInfo(f"{archive.stem}/{path.relative_to(folder).as_posix()}", EPOCH)
            entry.compress_type, entry.external_attr, entry.create_system = zipfile.ZIP_DEFLATED, MODE, 3
            target.writestr(entry, path.read_bytes())
    return write_sums(archive.with_name(archive.name + ".sha256"), [archive])


def write_sums(target: Path, files: list[Path]) -> Path:
    """The SHA-256 of each file, one a line, written to ``target``."""
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files]
    target.write_text("".join(lines), encoding="utf-8", newline="\n")
    return target


def main(arguments: list[str]) -> None:
    """Do what the command line asks for."""
    match arguments:
        case ["zip", folder, archive]:
            print(pack(Path(folder), Path(archive)).read_text(encoding="utf-8"), end="")
        case ["sums", folder]:
            files = sorted(p for p in Path(folder).iterdir() if p.is_file() and p.suffix != ".sha256")
            files = [path for path in files if path.name != SUMS]
            print(write_sums(Path(folder) / SUMS, files).read_text(encoding="utf-8"), end="")
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
