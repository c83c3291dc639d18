"""``python -m pfslam``: the command line, which ``pfslam.cli.parser`` describes."""

import sys

from pfslam.cli.parser import main

if __name__ == "__main__":
    sys.exit(main())
