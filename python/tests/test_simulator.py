"""The simulator: gradients, Jacobians, threads, memory, and arguments that make no sense."""

import os
import threading

import gic
import numpy as np
import pytest
from conftest import ELASTIC, FLOOR, small_body, small_simulator


def directions(shape):
    """Fixed numbers without pattern."""
    return np.sin(1.3 * np.arange(np.prod(shape)).reshape(shape) ** 1.1 + 0.2)


def loss(rollout):
    """A smooth loss on positions and velocities, and its derivatives."""
    x, v = rollout.positions_m, 0.01 * rollout.velocities_m_s
    d = directions(x.shape)
    value = (d * (x + v) + 0.5 * x**2 + 0.5 * v**2).sum() / len(d[0])
    return value, (d + x) / len(d[0]), 0.01 * (d + v) / len(d[0])


def value_of(simulator):
    return loss(simulator.rollout([1, 2]))[0]


@pytest.fixture(scope="module")
def gradient():
    recording = small_simulator().record([1, 2])
    _, positions, velocities = loss(recording.rollout)
    return recording.gradient(positions, velocities)[0]


@pytest.mark.parametrize("name", ["youngs_modulus_pa", "poisson_ratio", "density_kg_m3"])
def test_gradients_of_numbers_are_differences(gradient, simulator, name):
    body = simulator.bodies[0]
    value = body.parameters.get(name) or getattr(body, name)
    step = 1e-6 * value
    difference = (value_of(simulator.replace({name: value + step})) - value_of(simulator.replace({name: value - step})))
    assert float(gradient.of(name)) == pytest.approx(difference / (2 * step), rel=1e-4)


@pytest.mark.parametrize("name, step", [
    ("positions_m", 2e-8), ("own_velocities_m_s", 1e-6), ("volume_factors", 1e-6), ("velocity_m_s", 1e-6),
    ("angular_velocity_rad_s", 1e-6),
])
def test_gradients_of_arrays_are_differences(gradient, simulator, name, step):
    found = gradient.of(name)
    start = getattr(simulator.bodies[0], name)
    start = np.zeros(found.shape) if start is None else np.asarray(start)
    way = directions(found.shape)
    ahead, behind = (value_of(simulator.replace({name: start + sign * step * way})) for sign in (1, -1))
    assert (found * way).sum() == pytest.approx((ahead - behind) / (2 * step), rel=1e-4)


def test_volumes_are_factors_times_a_particles_volume(gradient):
    np.testing.assert_array_equal(gradient.volumes_m3, gradient.volume_factors / 1e-6)


def test_single_precision_gives_nearly_the_same_gradient(gradient):
    recording = small_simulator("f32").record([1, 2])
    _, positions, velocities = loss(recording.rollout)
    fast = recording.gradient(positions, velocities)[0]
    assert fast.material == pytest.approx(gradient.material, rel=1e-2)
    size = np.abs(gradient.volume_factors).max()
    np.testing.assert_allclose(fast.volume_factors, gradient.volume_factors, atol=5e-3 * size)


def test_a_small_memory_budget_gives_the_same_gradient(simulator):
    tight = simulator.replace(gradient_memory_bytes=210 * 24 * 8 * 55, least_substeps_per_frame=160)
    roomy = simulator.replace(least_substeps_per_frame=160)
    adjoint = np.ones((1, 210, 3))
    found = [world.gradient([4], adjoint)[0] for world in (tight, roomy)]
    assert found[0].material == found[1].material
    with pytest.raises(gic.SimulationError, match="gradient_memory_bytes"):
        simulator.replace(gradient_memory_bytes=10_000).record(3)


def test_a_recording_reverses_more_than_one_loss(simulator):
    recording = simulator.record([1, 2])
    np.testing.assert_array_equal(recording.rollout.positions_m, simulator.rollout([1, 2]).positions_m)
    x, y = (recording.gradient(directions((2, 210, 3)) * axis)[0] for axis in ([1, 0, 0], [0, 1, 0]))
    both = recording.gradient(directions((2, 210, 3)) * [1, 1, 0])[0]
    np.testing.assert_allclose(x.positions_m + y.positions_m, both.positions_m, rtol=1e-6, atol=1e-9)


def test_the_jacobian_agrees_with_the_gradient(gradient, simulator):
    _, positions, velocities = loss(simulator.rollout([1, 2]))
    jacobian = simulator.jacobian([1, 2], ["youngs_modulus_pa", "velocity_m_s", "density_kg_m3"])
    assert jacobian.parameters[1] == "velocity_m_s.x" and jacobian.positions_m.shape == (2, 210, 3, 5)
    found = np.einsum("fnkp,fnk->p", jacobian.positions_m, positions)
    found += np.einsum("fnkp,fnk->p", jacobian.velocities_m_s, velocities)
    expected = [gradient.material["youngs_modulus_pa"], *gradient.velocity_m_s, gradient.density_kg_m3]
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_bodies_have_gradients_of_their_own():
    low, high = small_body(), small_body(positions_m=small_body().positions_m + [0.0, 0.07, 0.0])
    world = gic.Simulator([low, high], [FLOOR], 0.02, frame_rate_hz=100, least_substeps_per_frame=50, precision="f64")
    adjoint = np.zeros((1, 420, 3))
    adjoint[:, 210:] = directions((1, 210, 3))
    found = world.gradient([3], adjoint)
    assert found[0].material["youngs_modulus_pa"] != 0.0
    step = 2e-1
    moved = [world.replace({"youngs_modulus_pa": 2e5 + sign * step}) for sign in (1, -1)]
    ahead, behind = (world.rollout([3]).positions_m for world in moved)
    expected = ((ahead - behind) * adjoint).sum() / (2 * step)
    assert found[0].material["youngs_modulus_pa"] == pytest.approx(expected, rel=1e-3)


def test_deformation_and_stress_are_those_of_the_law(simulator):
    rollout = simulator.rollout(3, deformation=True)
    gradients, stress = rollout.deformation_gradients[2], rollout.cauchy_stress_pa[2]
    ratio = np.linalg.det(gradients)
    np.testing.assert_allclose(ratio, rollout.volume_ratios[2], rtol=1e-6)
    # Neo-Hookean: tau = mu (F F^T - I) + lambda log(J) I.
    mu, lam = 2e5 / 2.6, 2e5 * 0.3 / (1.3 * 0.4)
    left = gradients @ np.swapaxes(gradients, 1, 2)
    tau = mu * (left - np.eye(3)) + lam * np.log(ratio)[:, None, None] * np.eye(3)
    deviator = stress - np.trace(stress, axis1=1, axis2=2)[:, None, None] * np.eye(3) / 3
    np.testing.assert_allclose(np.sqrt(1.5 * (deviator**2).sum((1, 2))), rollout.von_mises_pa[2], rtol=1e-5)
    np.testing.assert_allclose(stress, tau / ratio[:, None, None], rtol=1e-6, atol=1e-3)


def test_two_simulators_in_two_threads_do_not_disturb_each_other():
    fine, soft = small_simulator("f32", least_substeps_per_frame=400), small_simulator("f32")
    worlds = [fine, soft.replace({"youngs_modulus_pa": 5e4})]
    expected = [world.rollout(20).positions_m for world in worlds]
    found = {}

    def work(index):
        for turn in range(3):
            found[index, turn] = worlds[index].rollout(20).positions_m
            worlds[index].gradient([5], np.ones((1, 210, 3)))

    threads = [threading.Thread(target=work, args=(index,)) for index in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 6
    for (index, _), positions in found.items():
        np.testing.assert_array_equal(positions, expected[index])


def test_long_calls_leave_the_interpreter_to_others():
    world = small_simulator("f64", least_substeps_per_frame=2000)
    ticks, done = [], threading.Event()

    def tick():
        while not done.wait(0.001):
            ticks.append(1)

    other = threading.Thread(target=tick)
    other.start()
    world.rollout(4)
    done.set()
    other.join()
    assert len(ticks) > 20


def resident_bytes():
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="resident memory is read from /proc")
def test_two_hundred_rollouts_leave_no_memory_behind():
    positions = gic.block((0.2, 0.2, 0.2), 0.01, (0.0, 0.05, 0.0))
    world = gic.Simulator(gic.Body(ELASTIC, positions, 1e-6), [FLOOR], 0.02, frame_rate_hz=1000)

    def work():
        world.rollout(4, deformation=True)
        world.gradient([3], np.ones((1, len(positions), 3)))

    for _ in range(40):
        work()
    before = resident_bytes()
    for _ in range(200):
        work()
    # A rollout's arrays alone take 8 MB.
    assert resident_bytes() - before < 30e6


@pytest.mark.parametrize("change, message", [
    ({"positions_m": np.zeros((3, 2))}, r"positions_m must have shape \(n, 3\), found \(3, 2\)"),
    ({"positions_m": np.full((210, 3), np.nan)}, r"positions_m\[0, 0\] is nan"),
    ({"positions_m": np.zeros((210, 3), complex)}, "positions_m must hold real numbers, not complex128"),
    ({"positions_m": [["a", "b", "c"]]}, "positions_m must hold real numbers"),
    ({"positions_m": [[0, 0, 0], [1, 1]]}, "positions_m is no array"),
    ({"volume_factors": np.ones(3)}, r"volume_factors must have shape \(210,\), found \(3,\)"),
    ({"volume_factors": np.full(210, np.inf)}, r"volume_factors\[0\] is inf"),
    ({"velocity_m_s": (1.0, 2.0)}, r"velocity_m_s must have shape \(3,\)"),
    ({"density_kg_m3": [1.0, 2.0]}, "density_kg_m3 must be one number"),
    ({"youngs_modulus_pa": "stiff"}, "youngs_modulus_pa must hold real numbers"),
    ({"youngs_modulus": 1e5}, "the body has no `youngs_modulus`; it has youngs_modulus_pa"),
])
def test_bad_arguments_of_a_body_are_named(change, message):
    with pytest.raises(gic.UsageError, match=message):
        small_body(**change)


@pytest.mark.parametrize("call, error, message", [
    (lambda s: s.rollout(0), gic.UsageError, "frames must be a count of at least 1"),
    (lambda s: s.rollout([2, 1]), gic.UsageError, "frames must .* ascend"),
    (lambda s: s.rollout(2.5), gic.UsageError, "frames must be a count"),
    (lambda s: s.gradient([1], np.ones((1, 209, 3))), gic.UsageError, r"positions must have shape \(1, 210, 3\)"),
    (lambda s: s.gradient([1], None, np.full((1, 210, 3), np.nan)), gic.UsageError, r"velocities\[0, 0, 0\] is nan"),
    (lambda s: s.jacobian([1], ["viscosity_pa_s"]), gic.UsageError, "no parameter `viscosity_pa_s`; there are young"),
    (lambda s: s.jacobian([1], ["density_kg_m3"], body=1), gic.UsageError, "body 1 is not among the 1"),
    (lambda s: s.replace(precision="f16"), gic.UsageError, "precision must be"),
    (lambda s: s.replace(grid_spacing_m=-1.0), gic.SimulationError, "grid_spacing_m = -1"),
    (lambda s: s.replace({"youngs_modulus_pa": -1.0}), gic.TwinError, "youngs_modulus_pa` is -1"),
    (lambda s: s.replace({}, {}), gic.UsageError, "changes of 2 bodies"),
    (lambda s: s.replace({"positions_m": s.bodies[0].positions_m - 1.0}), gic.SimulationError, "inside colliders"),
])
def test_bad_arguments_of_a_simulator_are_named(simulator, call, error, message):
    with pytest.raises(error, match=message):
        call(simulator)


def test_other_types_and_layouts_are_copied(simulator):
    positions = simulator.bodies[0].positions_m
    wide = np.zeros((420, 6))
    wide[::2, ::2] = positions
    same = simulator.replace({"positions_m": wide[::2, ::2]})
    assert not wide[::2, ::2].flags.c_contiguous
    np.testing.assert_array_equal(same.rollout(2).positions_m, simulator.rollout(2).positions_m)
    rounded = simulator.replace({"positions_m": positions.astype(np.float32)}).bodies[0].positions_m
    np.testing.assert_array_equal(rounded, positions.astype(np.float32).astype(np.float64))


def test_a_body_keeps_contiguous_arrays_without_a_copy():
    positions = gic.block((0.1, 0.1, 0.1), 0.02)
    assert np.shares_memory(gic.Body(ELASTIC, positions, 8e-6).positions_m, positions)


def test_doubts_about_a_world_are_warnings():
    positions = gic.block((0.05, 0.05, 0.05), 0.025)
    world = gic.Simulator(gic.Body(ELASTIC, positions, 0.025**3), [], 0.025, frame_rate_hz=100)
    with pytest.warns(gic.GicWarning, match="grid"):
        world.rollout(2)
