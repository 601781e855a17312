"""``python -m hapticd``: the same as the ``hapticd`` command."""

import sys

from hapticd.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
