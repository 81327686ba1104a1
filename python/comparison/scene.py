"""What all simulate: a neo-Hookean cube falls onto a sticky floor; f32, quadratic B-splines, the same substeps."""

from dataclasses import dataclass

import gic
import numpy as np


@dataclass(frozen=True)
class Scene:
    """A cube of ``side`` particles along each edge, ``substeps`` of ``dt`` seconds each; two particles a cell and axis.

    The grid has ``nodes`` nodes along each axis from the origin on; the floor lies at the node of height ``floor``.
    """

    side: int = 39
    substeps: int = 32
    dt: float = 1e-4
    spacing: float = 0.01
    floor: int = 3
    youngs_modulus_pa: float = 1e5
    poisson_ratio: float = 0.3
    density: float = 1000.0
    gravity: float = -9.8
    speed: float = -2.0

    @property
    def nodes(self) -> int:
        return self.side // 2 + 12

    @property
    def volume(self) -> float:
        return (self.spacing / 2) ** 3

    @property
    def positions(self) -> np.ndarray:
        """Initial positions [m], shape [n, 3]: the lowest particles touch the floor in the first substeps."""
        half = self.spacing / 2
        return gic.block((self.side * half,) * 3, half, (4 * self.spacing, self.floor * self.spacing, 4 * self.spacing))

    @property
    def lame(self):
        """mu and lambda per Pa of Young's modulus."""
        nu = self.poisson_ratio
        return 1 / (2 * (1 + nu)), nu / ((1 + nu) * (1 - 2 * nu))

    def simulator(self) -> gic.Simulator:
        """The scene in gic: one frame."""
        material = {"model": "elastic", "youngs_modulus_pa": self.youngs_modulus_pa,
                    "poisson_ratio": self.poisson_ratio}
        body = gic.Body(material, self.positions, self.volume, self.density, velocity_m_s=(0.0, self.speed, 0.0))
        floor = {"shape": "half_space", "point_m": [0, self.floor * self.spacing, 0], "normal": [0, 1, 0],
                 "contact": "sticky"}
        # The others' substeps, however stiff the body is.
        return gic.Simulator(body, [floor], self.spacing, gravity_m_s2=(0, self.gravity, 0),
                             frame_rate_hz=1 / (self.dt * self.substeps), least_substeps_per_frame=self.substeps,
                             courant=0.999)


class Gic:
    """The scene in gic: mean height at the end [m], and its derivative with respect to Young's modulus."""

    def __init__(self, scene: Scene) -> None:
        self.simulator = scene.simulator()
        count = self.simulator.particles
        self.adjoint = np.zeros((1, count, 3))
        self.adjoint[..., 1] = 1.0 / count

    def forward(self) -> float:
        return float(self.simulator.rollout([1]).positions_m[..., 1].mean())

    def gradient(self) -> float:
        return self.simulator.gradient([1], self.adjoint)[0].material["youngs_modulus_pa"]
