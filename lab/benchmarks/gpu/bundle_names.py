"""Folders of a bundle: the small photos, and the packages that training imports."""

PHOTOS, SOURCES = "photos", "packages"
