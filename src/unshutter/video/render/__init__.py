"""Renders the frames of a clip: each with its motion, linked to its neighbours, warped, stabilised."""
