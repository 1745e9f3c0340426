"""The pictures that are measured on, and how an estimator's answer is scored."""
