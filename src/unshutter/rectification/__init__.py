"""From photos to their rectified pictures: one photo alone, and photos with their neighbours in time."""
