"""``python -m LAFlatteningLib`` is the command ``la-flatten``."""

import sys

try:
    from .cli import main

    code = main()
except KeyboardInterrupt:
    code = 130
sys.exit(code)
