"""A module that ends its process, as a network's file might."""

import os

os.abort()
