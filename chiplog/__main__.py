"""`python -m chiplog` is `chiplog`."""

import sys

from chiplog.entry import main

if __name__ == "__main__":
    sys.exit(main())
