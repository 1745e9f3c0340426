"""Exports motions for other programs and for people: maps, points, plots."""
