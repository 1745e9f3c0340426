"""The predecessor's networks and their training."""
