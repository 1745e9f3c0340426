"""Estimators derive a photo's Motion from the photo alone.

``register`` knows every method by name and does not import NumPy; ``base`` defines the Estimator interface and its
input, View; ``methods`` has one file per method, none of which imports another. To add one, write its file and its
entry in ``register.METHODS``, or publish it in your own package (entry point group ``unshutter.estimators``).
"""
