"""Every estimator on the same pictures with the same metrics: ``unshutter evaluate`` and the tables of docs/results.

A *protocol* makes *cases* (one picture each) from folders; a case judges estimators and gives one record for each;
records go to CSV and JSON, and tables and plots are made from these alone.
"""
