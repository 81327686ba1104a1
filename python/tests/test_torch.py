"""The wrappers of torch: gradients reach what they should, in f64 against differences."""

import numpy as np
import pytest
from conftest import small_body, small_simulator

torch = pytest.importorskip("torch", reason="torch is not installed")

from gic import splat  # noqa: E402
from gic import torch as gic_torch  # noqa: E402
from test_splat import ATTRIBUTES, CAMERA, gaussians  # noqa: E402


def test_gradients_through_a_rollout_are_differences():
    simulator = small_simulator()
    keys = ("youngs_modulus_pa", "velocity_m_s", "volume_factors")
    start = [torch.tensor(2.0, dtype=torch.float64), torch.tensor([0.4, -3.0, 0.2], dtype=torch.float64),
             torch.tensor(small_body().volume_factors)]

    def outcome(modulus, velocity, factors):
        values = dict(zip(keys, (modulus * 1e5, velocity, factors)))
        positions, velocities = gic_torch.rollout(simulator, [1, 2], values)
        weights = torch.sin(torch.arange(positions.numel(), dtype=torch.float64)).reshape(positions.shape)
        return (weights * positions).sum(), (weights * velocities).sum()

    inputs = [tensor.requires_grad_() for tensor in start[:2]]
    assert torch.autograd.gradcheck(lambda *free: outcome(*free, start[2]), inputs, eps=1e-6, rtol=1e-3, atol=1e-5)
    factors = start[2].requires_grad_()
    sum(outcome(start[0].detach(), start[1].detach(), factors)).backward()
    way = torch.sin(1.7 * torch.arange(210, dtype=torch.float64))
    with torch.no_grad():
        ahead, behind = (sum(outcome(start[0], start[1], factors + sign * 1e-6 * way)) for sign in (1, -1))
    assert float((factors.grad * way).sum()) == pytest.approx(float((ahead - behind) / 2e-6), rel=1e-4)


def test_a_loss_reaches_youngs_modulus():
    modulus = torch.tensor(2e5, requires_grad=True)
    positions, _ = gic_torch.rollout(small_simulator("f32"), [2], {"youngs_modulus_pa": modulus})
    positions.square().sum().backward()
    assert modulus.grad is not None and modulus.grad.dtype == torch.float32 and float(modulus.grad) != 0.0


def test_without_gradients_nothing_is_recorded():
    positions, velocities = gic_torch.rollout(small_simulator(), 2, {"youngs_modulus_pa": torch.tensor(2e5)})
    assert not positions.requires_grad and positions.shape == velocities.shape == (2, 210, 3)


def test_gradients_through_a_picture_are_the_rasterisers():
    set_ = gaussians()
    tensors = [torch.tensor(array, requires_grad=True) for array in set_._attributes()]
    color, alpha, depth = gic_torch.render(CAMERA, *tensors)
    (color.sum() + 2 * alpha.sum() + 3 * depth.sum()).backward()
    ones = np.ones(alpha.shape)
    found = splat.render(set_, CAMERA).backward(np.ones(color.shape), 2 * ones, 3 * ones)
    for tensor, name in zip(tensors, ATTRIBUTES):
        np.testing.assert_array_equal(tensor.grad.numpy(), getattr(found, name))


def test_a_picture_without_colour_has_gradients():
    plain = gaussians(anisotropic=False)
    tensors = [torch.tensor(array, requires_grad=True) for array in plain._attributes()[:3]]
    _, alpha, _ = gic_torch.render(CAMERA, *tensors)
    alpha.sum().backward()
    assert all(float(tensor.grad.abs().sum()) > 0.0 for tensor in tensors)
