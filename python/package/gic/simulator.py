"""The differentiable simulator (MLS-MPM, six materials, rigid obstacles)."""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass, field, replace
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from . import _gic
from ._arrays import checked, frame_numbers, number, optional, vector
from .errors import GicWarning, UsageError

__all__ = ["Body", "BodyGradient", "Jacobian", "Recording", "Rollout", "Simulator", "block"]

Frames = Union[int, Sequence[int]]

_AXES = "xyz"
_VECTORS = {"velocity_m_s": "velocity", "angular_velocity_rad_s": "angular_velocity"}


def block(size_m: Sequence[float], spacing_m: float, low_m: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Particles in rows that fill a box from ``low_m`` on [m], shape [n, 3]; each has the volume ``spacing_m**3``."""
    counts = [max(1, round(side / spacing_m)) for side in vector("size_m", size_m)]
    grid = np.stack(np.meshgrid(*(np.arange(count) for count in counts), indexing="ij"), axis=-1)
    return (grid.reshape(-1, 3) + 0.5) * spacing_m + np.asarray(low_m, dtype=np.float64)


@dataclass(frozen=True)
class Body:
    """Particles of one material.

    material: law and parameters as in ``twin.json``: ``{"model": "elastic", "youngs_modulus_pa": 1e5,
        "poisson_ratio": 0.3}``. Laws are elastic, viscoelastic, plasticine,
        sand, newtonian and non-newtonian.
    positions_m: initial positions [m], shape [n, 3].
    particle_volume_m3: rest volume of a particle of factor 1 [m^3].
    density_kg_m3: density at rest [kg/m^3].
    volume_factors: rest volume, and so mass, of each particle in units of ``particle_volume_m3``, shape [n]; None
        where all are 1.
    velocity_m_s, angular_velocity_rad_s: initial motion of the body, the latter about its centre of mass.
    own_velocities_m_s: what each particle's initial velocity has beyond that [m/s], shape [n, 3]; None for nothing.

    Arrays are copied where they are not contiguous float64. Raises UsageError where one has another shape or is not
    finite, TwinError where the material is not known.
    """

    material: Mapping[str, Any]
    positions_m: np.ndarray
    particle_volume_m3: float
    density_kg_m3: float = 1000.0
    volume_factors: Optional[np.ndarray] = None
    velocity_m_s: Sequence[float] = (0.0, 0.0, 0.0)
    angular_velocity_rad_s: Sequence[float] = (0.0, 0.0, 0.0)
    own_velocities_m_s: Optional[np.ndarray] = None
    _native: _gic.Body = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.material, Mapping):
            raise UsageError('material must be a mapping such as {"model": "elastic", ...}')
        entries = self.material.items()
        material = {key: value if isinstance(value, str) else number(key, value) for key, value in entries}
        positions = checked("positions_m", self.positions_m, ("n", 3))
        checked_fields: Dict[str, Any] = {
            "positions_m": positions,
            "density_kg_m3": number("density_kg_m3", self.density_kg_m3),
            "particle_volume_m3": number("particle_volume_m3", self.particle_volume_m3),
            "volume_factors": optional("volume_factors", self.volume_factors, (len(positions),)),
            "velocity_m_s": vector("velocity_m_s", self.velocity_m_s),
            "angular_velocity_rad_s": vector("angular_velocity_rad_s", self.angular_velocity_rad_s),
            "own_velocities_m_s": optional("own_velocities_m_s", self.own_velocities_m_s, (len(positions), 3)),
        }
        native = _gic.Body(json.dumps(material), *checked_fields.values())
        # With the defaults of the law filled in.
        checked_fields["material"] = json.loads(native.material)
        for name, value in {**checked_fields, "_native": native}.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        return f"Body({len(self.positions_m)} particles, {self.material})"

    @classmethod
    def _of(cls, native: _gic.Body) -> Body:
        return cls(json.loads(native.material), native.positions, native.particle_volume, native.density,
                   native.volume_factors, native.velocity, native.angular_velocity)

    @property
    def parameters(self) -> Dict[str, float]:
        """The material's parameters by name."""
        return {key: value for key, value in self.material.items() if key != "model"}

    def replace(self, **changes: Any) -> Body:
        """The same body with other fields or material parameters, by name.

        Raises UsageError for a name that it does not have.
        """
        parameters = {key: number(key, changes.pop(key)) for key in list(changes) if key in self.parameters}
        unknown = [key for key in changes if key not in _FIELDS]
        if unknown:
            raise UsageError(f"the body has no `{unknown[0]}`; it has {', '.join([*self.parameters, *_FIELDS])}")
        if parameters:
            changes["material"] = {**changes.get("material", self.material), **parameters}
        return replace(self, **changes)


_FIELDS = ("material", "positions_m", "particle_volume_m3", "density_kg_m3", "volume_factors", "velocity_m_s",
           "angular_velocity_rad_s", "own_velocities_m_s")


@dataclass(frozen=True)
class Rollout:
    """The kept frames of a simulation: f frames of n particles, one body after the other, and c obstacles.

    frames: numbers of the frames, 0 the initial state.
    positions_m [f, n, 3], velocities_m_s [f, n, 3].
    von_mises_pa: von Mises stress [Pa], float32 [f, n].
    volume_ratios: J, float32 [f, n]; of the elastic deformation for plastic materials.
    contact_forces_n, contact_torques_n_m: means over the frame on each obstacle, about its origin, [f, c, 3].
    deformation_gradients: F [f, n, 3, 3], elastic for plastic materials, J^(1/3) I for Newtonian fluids; where asked.
    cauchy_stress_pa: [f, n, 3, 3]; where asked.
    substeps: substeps of each frame.
    """

    frames: List[int]
    positions_m: np.ndarray
    velocities_m_s: np.ndarray
    von_mises_pa: np.ndarray
    volume_ratios: np.ndarray
    contact_forces_n: np.ndarray
    contact_torques_n_m: np.ndarray
    substeps: List[int]
    frame_rate_hz: float
    deformation_gradients: Optional[np.ndarray] = None
    cauchy_stress_pa: Optional[np.ndarray] = None

    @property
    def times_s(self) -> np.ndarray:
        """Time of each kept frame [s], shape [f]."""
        return np.asarray(self.frames) / self.frame_rate_hz

    def table(self) -> List[Dict[str, float]]:
        """One row for each kept frame, for ``pandas.DataFrame``."""
        return [self._row(index) for index in range(len(self.frames))]

    def _row(self, index: int) -> Dict[str, float]:
        speeds = np.linalg.norm(self.velocities_m_s[index], axis=1)
        row = {"frame": self.frames[index], "time_s": float(self.times_s[index]), "substeps": self.substeps[index]}
        for axis, name in enumerate(_AXES):
            row[f"mean_{name}_m"] = float(self.positions_m[index, :, axis].mean())
        row["largest_speed_m_s"] = float(speeds.max())
        row["largest_von_mises_pa"] = float(self.von_mises_pa[index].max())
        return row


@dataclass(frozen=True)
class BodyGradient:
    """Derivatives of a loss with respect to what a body starts with, per unit of each.

    material: by the parameter's name; density at constant volumes; volumes at constant density.
    velocities_m_s: with respect to each particle's own velocity, shape [n, 3]; they sum to ``velocity_m_s``.
    """

    material: Dict[str, float]
    density_kg_m3: float
    particle_volume_m3: float
    volume_factors: np.ndarray
    volumes_m3: np.ndarray
    velocity_m_s: np.ndarray
    angular_velocity_rad_s: np.ndarray
    positions_m: np.ndarray
    velocities_m_s: np.ndarray

    def of(self, name: str) -> np.ndarray:
        """The derivative with respect to a field or material parameter of the body, by its name in ``Body``."""
        if name in self.material:
            return np.asarray(self.material[name])
        return np.asarray(self.velocities_m_s if name == "own_velocities_m_s" else getattr(self, name))


@dataclass(frozen=True)
class Jacobian:
    """Derivatives of trajectories with respect to single numbers: of positions and velocities, [f, n, 3, p]."""

    parameters: List[str]
    positions_m: np.ndarray
    velocities_m_s: np.ndarray


class Recording:
    """A rollout that can be differentiated any number of times; ``rollout`` holds its kept frames."""

    def __init__(self, native: _gic.Recording, rollout: Rollout, bodies: Sequence[Body]) -> None:
        self._native = native
        self._bodies = bodies
        self.rollout = rollout

    def gradient(self, positions: Any = None, velocities: Any = None) -> List[BodyGradient]:
        """Derivatives of a loss, one for each body.

        positions, velocities: derivatives of the loss with respect to the kept frames' positions [per m] and
            velocities [per m/s], shape [f, n, 3]; None where it does not depend on them.

        Costs about as much as two rollouts and a half, whatever the number of parameters. Raises UsageError for arrays
        of another shape or that are not finite.
        """
        adjoints = [self._by_frame(name, array) for name, array in
                    (("positions", positions), ("velocities", velocities))]
        found = self._native.gradient(*adjoints)
        return [self._named(body, gradient) for body, gradient in zip(self._bodies, found)]

    def _by_frame(self, name: str, array: Any) -> Dict[int, np.ndarray]:
        if array is None:
            return {}
        array = checked(name, array, self.rollout.positions_m.shape)
        return dict(zip(self.rollout.frames, array))

    @staticmethod
    def _named(body: Body, gradient: Dict[str, Any]) -> BodyGradient:
        material = dict(zip(body.parameters, gradient.pop("material").tolist()))
        volumes = gradient["volume_factors"] / body.particle_volume_m3
        return BodyGradient(material=material, volumes_m3=volumes, **gradient)


class Simulator:
    """A world and how it is simulated; it does not change: ``replace`` gives another.

    bodies: their particles are numbered one body after the other.
    colliders: rigid obstacles in the form of ``twin.json``, such as ``{"shape": "half_space", "normal": [0, 1, 0],
        "contact": "sticky"}``; shapes are half_space, sphere, box, cylinder and capsule.
    grid_spacing_m: side of a grid cell [m]; particles lie half of it apart, usually.
    gravity_m_s2: gravity [m/s^2].
    frame_rate_hz: frames per second; frame 0 is the initial state.
    least_substeps_per_frame: substeps that a frame takes at least; more where the Courant number would exceed
        ``courant``.
    precision: "f32" on SIMD lanes, or "f64": one particle at a time, some ten times slower, to check gradients.
    gradient_memory_bytes: most memory that the states kept for a gradient may take; with less, more is recomputed.
    parallel: whether one simulation uses more than one thread; the result does not depend on it.

    Raises UsageError, TwinError (obstacles) and SimulationError, which say what is wrong and the way out.
    """

    def __init__(
        self,
        bodies: Union[Body, Sequence[Body]],
        colliders: Sequence[Mapping[str, Any]] = (),
        grid_spacing_m: float = 0.02,
        *,
        gravity_m_s2: Sequence[float] = (0.0, -9.8, 0.0),
        frame_rate_hz: float = 24.0,
        least_substeps_per_frame: int = 1,
        courant: float = 0.4,
        precision: str = "f32",
        gradient_memory_bytes: int = 1 << 30,
        parallel: bool = True,
    ) -> None:
        self.bodies: Tuple[Body, ...] = (bodies,) if isinstance(bodies, Body) else tuple(bodies)
        self.colliders = tuple(dict(collider) for collider in colliders)
        self.grid_spacing_m = number("grid_spacing_m", grid_spacing_m)
        self.frame_rate_hz = number("frame_rate_hz", frame_rate_hz)
        self._options: Dict[str, Any] = {
            "gravity_m_s2": vector("gravity_m_s2", gravity_m_s2),
            "least_substeps_per_frame": least_substeps_per_frame,
            "courant": number("courant", courant),
            "precision": precision,
            "gradient_memory_bytes": gradient_memory_bytes,
            "parallel": parallel,
        }
        if precision not in ("f32", "f64"):
            raise UsageError(f'precision must be "f32" or "f64", not {precision!r}')
        natives = [body._native for body in self.bodies]
        obstacles = json.dumps(self.colliders, default=_plain)
        self._native = _gic.World(natives, obstacles, self.grid_spacing_m, self._options["gravity_m_s2"],
                                  self.frame_rate_hz, (least_substeps_per_frame, self._options["courant"]), precision,
                                  gradient_memory_bytes, parallel)

    def __repr__(self) -> str:
        laws = ", ".join(f"{len(body.positions_m)} {body.material['model']}" for body in self.bodies)
        return f"Simulator({laws}; {len(self.colliders)} colliders; {self.grid_spacing_m} m grid)"

    @property
    def particles(self) -> int:
        """Number of particles of all bodies."""
        return sum(len(body.positions_m) for body in self.bodies)

    def replace(self, *changes: Mapping[str, Any], **options: Any) -> Simulator:
        """The same simulator with other bodies or options.

        changes: one mapping for each of the first bodies, of fields or material parameters by name, as in
            ``Body.replace``. options: keyword arguments of ``Simulator``.
        """
        if len(changes) > len(self.bodies):
            raise UsageError(f"changes of {len(changes)} bodies, but the world has {len(self.bodies)}")
        bodies = list(self.bodies)
        for index, change in enumerate(changes):
            bodies[index] = bodies[index].replace(**change)
        arguments = {"bodies": bodies, "colliders": self.colliders, "grid_spacing_m": self.grid_spacing_m,
                     "frame_rate_hz": self.frame_rate_hz, **self._options, **options}
        return Simulator(**arguments)

    def rollout(self, frames: Frames, *, deformation: bool = False) -> Rollout:
        """Simulates.

        frames: how many, frame 0 included; or the ascending numbers of those to keep.
        deformation: also gives deformation gradients and stresses.

        Warns where grid, obstacles and particles do not fit each other. Raises SimulationError, Interrupted.
        """
        return self._told(self._native.rollout(*frame_numbers(frames), deformation))

    def record(self, frames: Frames) -> Recording:
        """As ``rollout``, in a way that can be differentiated."""
        native, arrays = self._native.record(*frame_numbers(frames))
        return Recording(native, self._told(arrays), self.bodies)

    def gradient(self, frames: Frames, positions: Any = None, velocities: Any = None) -> List[BodyGradient]:
        """Derivatives of a loss given by its derivatives with respect to the frames; see ``Recording.gradient``."""
        return self.record(frames).gradient(positions, velocities)

    def jacobian(self, frames: Frames, parameters: Sequence[str], body: int = 0) -> Jacobian:
        """Derivatives of trajectories with respect to single numbers of a body, by central differences of rollouts side
        by side; use ``precision="f64"`` for more than three digits.

        parameters: material parameters by name, ``density_kg_m3``, ``velocity_m_s``, ``angular_velocity_rad_s``; a
            vector gives three columns.
        """
        if not 0 <= body < len(self.bodies):
            raise UsageError(f"body {body} is not among the {len(self.bodies)} of the world")
        columns = [column for name in parameters for column in self._columns(name, body)]
        count, kept = frame_numbers(frames)
        found = self._native.jacobian(kept or list(range(count)), [(kind, body, index) for _, kind, index in columns])
        positions, velocities = (np.moveaxis(array, 0, -1) for array in found)
        return Jacobian([name for name, _, _ in columns], positions, velocities)

    def _columns(self, name: str, body: int) -> List[Tuple[str, str, int]]:
        names = list(self.bodies[body].parameters)
        if name in names:
            return [(name, "material", names.index(name))]
        if name == "density_kg_m3":
            return [(name, "density", 0)]
        if name in _VECTORS:
            return [(f"{name}.{letter}", _VECTORS[name], axis) for axis, letter in enumerate(_AXES)]
        raise UsageError(f"no parameter `{name}`; there are {', '.join([*names, 'density_kg_m3', *_VECTORS])}")

    def _told(self, arrays: Dict[str, Any]) -> Rollout:
        for doubt in arrays.pop("doubts"):
            warnings.warn(doubt, GicWarning, stacklevel=3)
        return Rollout(frame_rate_hz=self.frame_rate_hz, **arrays)


def _plain(value: Any) -> Any:
    """Numbers and arrays of NumPy as JSON has them."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise UsageError(f"{value!r} is neither number, text nor list")
