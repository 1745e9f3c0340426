"""The same job for many files: which files, where the results go, what went wrong, how far it is."""
