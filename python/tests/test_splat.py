"""The rasteriser: gradients against differences, files, and arguments that make no sense."""

import gic
import numpy as np
import pytest
from gic import splat

ATTRIBUTES = ("positions_m", "opacities", "scales_m", "rotations", "sh")
CAMERA = splat.Camera.looking_at((0.3, 0.4, -1.5), (0.0, 0.0, 0.0), width=48, height=40, focal_px=60.0)


def gaussians(count=12, anisotropic=True):
    n = np.arange(count)
    positions = 0.25 * np.stack([np.sin(1.3 * n), np.sin(2.7 * n), np.sin(4.1 * n)], axis=1)
    sh = 0.3 * np.sin(0.7 * np.arange(count * 12)).reshape(count, 4, 3)
    if not anisotropic:
        return splat.Gaussians(positions, 0.5 + 0.3 * np.sin(n), 0.1 + 0.03 * np.cos(n))
    rotations = np.stack([np.cos(n), np.sin(n), 0.3 * np.sin(2.1 * n), 0.2 + 0 * n], axis=1)
    scales = 0.1 + 0.03 * np.stack([np.cos(n), np.sin(n), np.cos(3 * n)], axis=1)
    return splat.Gaussians(positions, 0.5 + 0.3 * np.sin(n), scales, rotations, sh)


def weights(shape):
    """Weights of pixels that vary slowly: the edges of Gaussians, where they end at 1/255, hardly count."""
    row, column = np.mgrid[: shape[0], : shape[1]] / shape[0]
    slow = 1.0 + column + 0.5 * row**2
    return np.broadcast_to(slow.reshape(*slow.shape, *[1] * (len(shape) - 2)), shape)


def value(picture):
    """A loss that is linear in all pictures."""
    pictures = (picture.color, picture.alpha, picture.depth_m)
    return sum((weights(pixels.shape) * pixels.astype(np.float64)).sum() for pixels in pictures)


@pytest.mark.parametrize("name, step", [
    ("positions_m", 5e-3), ("opacities", 1e-2), ("scales_m", 5e-3), ("rotations", 2e-2), ("sh", 1e-1),
])
def test_gradients_are_differences(name, step):
    set_ = gaussians()
    picture = splat.render(set_, CAMERA, background=(0.2, 0.3, 0.4))
    found = picture.backward(*(weights(p.shape) for p in (picture.color, picture.alpha, picture.depth_m)))
    array = getattr(set_, name)
    way = np.sign(getattr(found, name))

    def moved(step):
        attributes = dict(zip(ATTRIBUTES, set_._attributes()))
        attributes[name] = array + step * way
        return value(splat.render(splat.Gaussians(**attributes), CAMERA, background=(0.2, 0.3, 0.4)))

    difference = (moved(step) - moved(-step)) / (2 * step)
    assert (getattr(found, name) * way).sum() == pytest.approx(difference, rel=5e-2)


def test_pictures_have_the_cameras_shape_and_what_was_asked_for():
    colored = splat.render(gaussians(), CAMERA)
    assert colored.color.shape == (40, 48, 3) and colored.depth_m.shape == colored.alpha.shape == (40, 48)
    assert colored.rejected == 0 and 0.0 < colored.alpha.max() <= 1.0
    plain = splat.render(gaussians(anisotropic=False), CAMERA, depth=False)
    assert plain.color is None and plain.depth_m is None and plain.alpha.dtype == np.float32
    assert plain.backward(alpha=np.ones((40, 48))).scales_m.shape == (12,)


def test_the_camera_sees_its_target_in_the_middle():
    ball = splat.Gaussians(np.zeros((1, 3)), [0.9], [0.02])
    picture = splat.render(ball, CAMERA)
    row, column = np.unravel_index(picture.alpha.argmax(), picture.alpha.shape)
    assert abs(row + 0.5 - 20) <= 0.5 and abs(column + 0.5 - 24) <= 0.5
    above = splat.Gaussians(np.array([[0.0, 0.2, 0.0]]), [0.9], [0.02])
    assert splat.render(above, CAMERA).alpha.argmax() // 48 < 18


def test_files_hold_what_was_written(tmp_path):
    file = tmp_path / "a.ply"
    splat.write_ply(file, gaussians())
    back = splat.read_ply(file)
    for name in ("positions_m", "opacities", "scales_m", "sh"):
        np.testing.assert_allclose(getattr(back, name), getattr(gaussians(), name), rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(splat.render(back, CAMERA).color, splat.render(gaussians(), CAMERA).color, atol=1e-4)
    with pytest.raises(gic.SplatError, match="b.ply"):
        splat.read_ply(tmp_path / "b.ply")


@pytest.mark.parametrize("change, message", [
    ({"opacities": np.ones(3)}, r"opacities must have shape \(12,\)"),
    ({"scales_m": np.ones(12)}, r"scales_m must have shape \(12, 3\)"),
    ({"sh": np.ones((12, 5, 3))}, "sh has 5 coefficients"),
    ({"positions_m": np.full((12, 3), np.nan)}, r"positions_m\[0, 0\] is nan"),
])
def test_bad_arguments_are_named(change, message):
    attributes = dict(zip(ATTRIBUTES, gaussians()._attributes()))
    with pytest.raises(gic.UsageError, match=message):
        splat.Gaussians(**{**attributes, **change})


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(gic.SplatError, match="opacity of Gaussian 0"):
        splat.render(splat.Gaussians(np.zeros((1, 3)), [-0.5], [0.1]), CAMERA)
    with pytest.raises(gic.UsageError, match="rotation"):
        splat.Camera(10, 10, (1, 1), (5, 5), np.zeros((3, 4)))
    with pytest.raises(gic.UsageError, match=r"alpha must have shape \(40, 48\)"):
        splat.render(gaussians(), CAMERA).backward(alpha=np.ones((3, 3)))
