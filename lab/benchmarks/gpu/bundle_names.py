"""Folders of a bundle: the small photos, others to validate on, places, and the packages that training imports."""

PHOTOS, VALIDATION, PLACES, SOURCES = "photos", "validation", "panoramas", "packages"
