"""Batches: one job for each of many photos, their results, failures and progress."""
