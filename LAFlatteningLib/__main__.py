"""``python -m LAFlatteningLib`` is the command ``la-flatten``."""

import sys

from .cli import main

sys.exit(main())
