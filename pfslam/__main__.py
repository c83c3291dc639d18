"""``python -m pfslam``: the command line, whose options ``pfslam.cli.parser`` describes."""

import sys

from pfslam.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
