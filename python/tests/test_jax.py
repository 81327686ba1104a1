"""The wrappers of JAX: gradients against differences in f64, also under jit."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import small_simulator

jax = pytest.importorskip("jax", reason="jax is not installed")
jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
from gic import jax as gic_jax  # noqa: E402
from gic import splat  # noqa: E402
from test_splat import CAMERA, gaussians  # noqa: E402


def loss(modulus, velocity):
    inputs = {"youngs_modulus_pa": modulus * 1e5, "velocity_m_s": velocity}
    positions, velocities = gic_jax.rollout(small_simulator(), [1, 2], inputs)
    weights = jnp.sin(jnp.arange(positions.size)).reshape(positions.shape)
    return (weights * (positions + 0.01 * velocities)).sum()


@pytest.mark.parametrize("transform", [lambda f: f, jax.jit], ids=["plain", "jit"])
def test_gradients_through_a_rollout_are_differences(transform):
    start = (2.0, jnp.array([0.4, -3.0, 0.2]))
    by_modulus, by_velocity = transform(jax.grad(loss, argnums=(0, 1)))(*start)
    step = 1e-6
    difference = (loss(2.0 + step, start[1]) - loss(2.0 - step, start[1])) / (2 * step)
    assert float(by_modulus) == pytest.approx(float(difference), rel=1e-4)
    for axis in range(3):
        unit = jnp.eye(3)[axis] * step
        difference = (loss(2.0, start[1] + unit) - loss(2.0, start[1] - unit)) / (2 * step)
        assert float(by_velocity[axis]) == pytest.approx(float(difference), rel=1e-4)


def test_gradients_through_a_picture_are_the_rasterisers():
    set_ = gaussians()

    def brightness(positions, opacities):
        color, alpha, depth = gic_jax.render(CAMERA, positions, opacities, *set_._attributes()[2:])
        return color.sum() + 2 * alpha.sum() + 3 * depth.sum()

    by_position, by_opacity = jax.grad(brightness, argnums=(0, 1))(set_.positions_m, set_.opacities)
    picture = splat.render(set_, CAMERA)
    ones = np.ones(picture.alpha.shape)
    found = picture.backward(np.ones(picture.color.shape), 2 * ones, 3 * ones)
    np.testing.assert_array_equal(by_position, found.positions_m)
    np.testing.assert_array_equal(by_opacity, found.opacities)


def test_jax_leaves_the_simulators_bits_alone():
    """XLA's threads drop numbers below the normal range, and threads inherit that."""
    code = "; ".join([
        "import sys; sys.path.insert(0, sys.argv[1])",
        "from conftest import small_simulator",
        "simulator = small_simulator('f32')",
        "import jax; from gic import jax as gic_jax",
        "through_jax = jax.jit(lambda e: gic_jax.rollout(simulator, [2], {'youngs_modulus_pa': e}))",
        "through_jax(2e5) if sys.argv[2] == 'jax' else None",
        "import hashlib; print(hashlib.sha256(simulator.rollout(20).positions_m.tobytes()).hexdigest())",
    ])
    hashes = [
        subprocess.run([sys.executable, "-c", code, str(Path(__file__).parent), first], capture_output=True, text=True,
                       check=True).stdout
        for first in ("jax", "gic")
    ]
    assert hashes[0] == hashes[1]
