from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from unshutter import Motion, RowMotion
from unshutter.single.network import SegmentNetwork, read_weights
from unshutter.single.register import method
from unshutter_lab.training.config import TrainConfig
from unshutter_lab.training.scenes import SceneConfig, Scenes, draw_scenes
from unshutter_lab.training.segment_transformer import (
    SegmentRecipe,
    SegmentTransformer,
    SegmentTransformerConfig,
    legendre_to_powers,
    motion_epe,
    network_of,
)

MIRROR = torch.tensor([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])
SMALL = SegmentTransformerConfig(width=16, layers=1, heads=2)


@pytest.fixture
def network() -> SegmentTransformer:
    torch.manual_seed(0)
    net = SegmentTransformer(SMALL).eval()
    torch.nn.init.normal_(net.head[-1].weight, std=0.3)  # zero at birth
    return net


@pytest.fixture(scope="module")
def scenes() -> Scenes:
    return draw_scenes(4, SceneConfig(tokens=40, drawn=120), torch.Generator().manual_seed(0))


def test_a_newborn_network_says_no_motion(scenes: Scenes) -> None:
    motions, camera = SegmentTransformer(SMALL)(scenes.tokens, scenes.mask)
    assert motions.shape == (2, 4, 2, 3)
    assert camera.shape == (4, 3)
    assert not motions.any()


def test_order_and_ends_of_segments_do_not_matter(network: SegmentTransformer, scenes: Scenes) -> None:
    expected = network(scenes.tokens, scenes.mask)[0]
    order = torch.randperm(40, generator=torch.Generator().manual_seed(1))
    shuffled = network(scenes.tokens[:, order], scenes.mask[:, order])[0]
    torch.testing.assert_close(shuffled, expected, atol=1e-4, rtol=1e-3)
    swapped = scenes.tokens[..., [2, 3, 0, 1, 4, 5]]
    torch.testing.assert_close(network(swapped, scenes.mask)[0], expected, atol=1e-4, rtol=1e-3)


def test_masked_segments_do_not_matter(network: SegmentTransformer, scenes: Scenes) -> None:
    mask = scenes.mask.clone()
    mask[:, 20:] = False
    other = scenes.tokens.clone()
    other[:, 20:, :4] = 0.1
    torch.testing.assert_close(network(other, mask)[0], network(scenes.tokens, mask)[0])


def in_use(network: SegmentTransformer, tokens: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Motions [B, 2, 3]: each iteration's correction is averaged over the picture and its mirror image."""
    motion = torch.zeros(len(tokens), 2, 3)
    for _ in range(network.config.iterations_in_use):
        straight, _ = network.correct(tokens, mask, motion)
        mirrored, _ = network.correct(tokens * MIRROR, mask, -motion)
        motion = motion + (straight - mirrored) / 2
    return motion.detach()


def recipe_of(network: SegmentTransformer) -> SegmentRecipe:
    sizes = {"width": network.config.width, "layers": network.config.layers, "heads": network.config.heads}
    return SegmentRecipe(TrainConfig("segment-transformer", network=sizes), torch.device("cpu"))


def test_the_exported_file_gives_what_torch_gives(network: SegmentTransformer, tmp_path: Path) -> None:
    recipe_of(network).export(network, tmp_path / "m.npz")
    numpy_network = SegmentNetwork(tmp_path / "m.npz").of_tokens
    for batch, count in ((1, 5), (3, 77)):  # any number of segments
        drawn = draw_scenes(batch, SceneConfig(tokens=count), torch.Generator().manual_seed(count))
        theirs = in_use(network, drawn.tokens, drawn.mask)
        for tokens, mask, expected in zip(drawn.tokens.numpy(), drawn.mask.numpy(), theirs, strict=True):
            np.testing.assert_allclose(numpy_network(tokens[mask]), expected.numpy(), atol=1e-4)


def test_the_shipped_network_gives_the_same_in_numpy_and_torch(tmp_path: Path) -> None:
    shipped = method("segment-transformer").weights
    assert shipped is not None
    network = network_of(read_weights(shipped)).eval()
    recipe_of(network).export(network, tmp_path / "shipped.npz")
    assert (tmp_path / "shipped.npz").read_bytes() == shipped.read_bytes()
    numpy_network = SegmentNetwork(shipped).of_tokens
    generator = np.random.default_rng(0)
    for count in (3, 40, 320):
        tokens = generator.uniform(-0.5, 0.5, (count, 6)).astype(np.float32)
        theirs = in_use(network, torch.from_numpy(tokens[None]), torch.ones(1, count, dtype=torch.bool))
        np.testing.assert_allclose(numpy_network(tokens), theirs[0], atol=2e-6)


def test_legendre_rows_are_the_polynomials_less_their_start() -> None:
    u = np.linspace(0, 1, 7)
    for degree, row in enumerate(legendre_to_powers().numpy(), start=1):
        expected = np.polynomial.legendre.Legendre.basis(degree)(2 * u - 1)
        np.testing.assert_allclose(np.polyval([*row[::-1], 0], u), expected - expected[0], atol=1e-6)


def test_epe_against_the_motion_type() -> None:
    """The training loss is the mean distance of GS positions; computed here with Motion at 256 rows."""
    tx, rz = torch.tensor([[0.1, -0.05, 0.0]]), torch.tensor([[0.05, 0.02, 0.0]])
    scenes = Scenes(torch.zeros(1, 1, 6), torch.ones(1, 1, dtype=torch.bool), torch.ones(1), tx, rz, torch.zeros(1, 3))
    estimate = torch.tensor([[[0.08, 0.0, 0.01], [0.02, 0.0, 0.0]]])
    error = motion_epe(estimate, scenes).item()

    def motion(coefficients) -> Motion:
        u = (np.arange(256) + 0.5) / 256
        t, r = (np.asarray(c) @ np.stack([u, u**2, u**3]) for c in coefficients)
        return RowMotion(256, t * 256, r)

    col, row = np.meshgrid(np.arange(16) * 16 + 7.5, np.arange(16) * 16 + 7.5)
    true, found = motion((tx[0], rz[0])).rs_to_gs(col, row), motion(estimate[0]).rs_to_gs(col, row)
    assert error == pytest.approx(np.hypot(true[0] - found[0], true[1] - found[1]).mean(), rel=1e-3)
