"""The estimator that is used unless another is asked for.

Known here, apart from the others: their package imports NumPy, and a photo is being decoded before that.
"""

DEFAULT_ESTIMATOR = "segment-manhattan"
