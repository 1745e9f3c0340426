"""The paper's system and its data, as small as tests want them; the losses that it trains with."""

NETWORK = {"size": 64, "width": 4, "hidden": 16, "row_width": 4}
DATA = {"size": 64, "canvas": 88, "drawn": 5, "held_out": 2, "validation_motions": 1}
PICTURE_LOSSES = ("rectified", "regenerated", "rectified_edges", "regenerated_edges")
