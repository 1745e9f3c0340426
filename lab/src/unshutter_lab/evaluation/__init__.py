"""Evaluates all estimators on the same pictures and metrics: ``unshutter evaluate`` and the tables of docs/results.

A *protocol* creates *cases* from folders, one per picture. A case judges estimators and returns a *record* for each.
Records are written as CSV and JSON; tables and plots are made from them alone.
"""
