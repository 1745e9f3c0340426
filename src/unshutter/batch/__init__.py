"""Batches: runs one job for each of many photos and reports results, failures and progress."""
