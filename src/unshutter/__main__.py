"""``python -m unshutter``."""

import sys

from unshutter.cli import main

sys.exit(main())
