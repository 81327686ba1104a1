"""What the examples share: a soft cube that falls onto a floor."""

import gic

FLOOR = {"shape": "half_space", "normal": [0, 1, 0], "contact": "separating", "friction": 0.3}


def cube(youngs_modulus_pa=5e4, poisson_ratio=0.3, velocity_m_s=(0.0, -2.0, 0.0), **options):
    """A simulator of 1,000 particles, 5 cm above the floor, 100 frames a second."""
    material = {"model": "elastic", "youngs_modulus_pa": youngs_modulus_pa, "poisson_ratio": poisson_ratio}
    positions = gic.block((0.1, 0.1, 0.1), 0.01, (0.0, 0.05, 0.0))
    body = gic.Body(material, positions, 1e-6, velocity_m_s=velocity_m_s)
    return gic.Simulator(body, [FLOOR], 0.02, frame_rate_hz=100, least_substeps_per_frame=40, **options)
