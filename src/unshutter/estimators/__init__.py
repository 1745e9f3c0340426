"""Estimators: from what can be seen in one photo to its Motion.

``register`` knows every method by name and imports no NumPy; ``base`` says what an estimator is given and must be;
``methods`` has one file a method, none of which imports another. To add one, write its file and its entry in
``register.METHODS``, or publish it in a package of your own (entry point group ``unshutter.estimators``).
"""
