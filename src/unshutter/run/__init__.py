"""Processes many photos: finds them, plans the results, works through them and reports."""
