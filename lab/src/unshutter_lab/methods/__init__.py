"""The methods of the paper, its predecessor and its rivals, one file each; none imports another."""

from pathlib import Path

from unshutter.single import Method

_WEIGHTS = Path(__file__).parents[1] / "weights"
_SCORES = _WEIGHTS / "scores.json"  # written with docs/results, never by hand

KANDULA2020_RESEARCH = Method(
    "kandula2020-research",
    "the paper's network with its row block, trained on photos that are not free (ONNX) -> row motion and row map",
    "unshutter_lab.methods.networks:Kandula2020Research",
    weights=_WEIGHTS / "kandula2020-research.onnx",
    takes_weights=True,
    scores=_SCORES,
)
RENGARAJAN2017 = Method(
    "rengarajan2017",
    "the predecessor's main network, RowColCNN (ONNX), on a square of 256 px -> motion at 15 key rows -> quadratic",
    "unshutter_lab.methods.networks:Rengarajan2017",
    weights=_WEIGHTS / "rengarajan2017.onnx",
    takes_weights=True,
    scores=_SCORES,
)
RENGARAJAN2017_VANILLA = Method(
    "rengarajan2017-vanilla",
    "the predecessor's smaller network, VanillaCNN (ONNX) -> motion at 15 key rows -> quadratic",
    "unshutter_lab.methods.networks:Rengarajan2017",
    weights=_WEIGHTS / "rengarajan2017-vanilla.onnx",
    takes_weights=True,
    scores=_SCORES,
)
RENGARAJAN2016 = Method(
    "rengarajan2016",
    "curves that were straight lines -> polynomial rotations about three axes",
    "unshutter_lab.methods.rengarajan2016:Rengarajan2016",
    grey_px=512,
    scores=_SCORES,
)
PURKAIT2017 = Method(
    "purkait2017",
    "segments of a Manhattan world -> one rate of rotation about the viewing direction",
    "unshutter_lab.methods.purkait2017:Purkait2017",
    grey_px=512,
    scores=_SCORES,
)
LAO2018 = Method(
    "lao2018",
    "curves that were straight lines -> one angular velocity for the whole picture",
    "unshutter_lab.methods.lao2018:Lao2018",
    grey_px=512,
    scores=_SCORES,
)
