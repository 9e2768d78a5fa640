"""``python -m fgplan``: the command line without an installed script."""

import sys

from fgplan.cli import main

if __name__ == "__main__":
    sys.exit(main())
