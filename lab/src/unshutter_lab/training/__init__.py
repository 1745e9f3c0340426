"""Training: everything that needs torch. It imports inference; inference never imports it."""
