"""The pictures used for measuring, and how estimates are scored on them."""
