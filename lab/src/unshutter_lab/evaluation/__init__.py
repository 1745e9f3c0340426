"""Every estimator on the same pictures with the same metrics: ``unshutter evaluate`` and the tables of docs/results.

A *protocol* makes *cases* from folders, one for each picture. A case judges estimators and gives a *record* for each.
Records are written as CSV and JSON, and tables and plots are made from them alone.
"""
