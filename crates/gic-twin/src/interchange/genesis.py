"""Loads NAME.npz into Genesis: pip install torch genesis-world"""

import json
import pathlib

import genesis as gs
import numpy as np


def load(path=pathlib.Path(__file__).with_name("NAME.npz"), steps_per_frame=10):
    """The scene, the body, and Genesis' steps in a frame of the video."""
    arrays = np.load(path)
    twin = json.loads(path.with_suffix(".particles.json").read_text())
    material, rho, n = twin["material"], twin["density_kg_m3"], twin["particles"]
    substeps = 2 * max(1, -(-(twin["substeps_per_frame"] or 400) // steps_per_frame))
    # The stress of Genesis' liquid is 2 mu times the strain of one substep, gic's its viscosity times the strain rate.
    mu = material.get("viscosity_pa_s", 0.0) / 2 * twin["frame_rate_hz"] * steps_per_frame * substeps
    # gic's pressure kappa (J - J^-6) has the slope 7 kappa at rest, Genesis' lam + 2 / 3 mu. A negative lam drives apart
    # what expands, so that a fluid of much viscosity is stiffer than the twin.
    lam = max(0.0, 7 * material.get("bulk_modulus_pa", 0.0) - 2 / 3 * mu)
    # Of a fluid E and nu are there to be positive.
    fluid = {"youngs_modulus_pa": 1.2 * material.get("bulk_modulus_pa", 1e5), "poisson_ratio": 0.3}
    moduli = twin["elasticity"] or fluid
    elastic = {"E": moduli["youngs_modulus_pa"], "nu": moduli["poisson_ratio"], "rho": rho, "sampler": "regular"}
    laws = {
        "elastic": lambda: gs.materials.MPM.Elastic(model="neohooken", **elastic),
        "plasticine": lambda: gs.materials.MPM.ElastoPlastic(
            von_mises_yield_stress=material["yield_stress_pa"], **elastic
        ),
        "sand": lambda: gs.materials.MPM.Sand(friction_angle=material["friction_angle_deg"], **elastic),
        "newtonian": lambda: gs.materials.MPM.Liquid(viscous=True, mu=mu, lam=lam, **elastic),
    }
    if material["model"] not in laws:
        raise ValueError(f"Genesis has no law for {material['model']}")
    low, high = arrays["positions"].min(axis=0), arrays["positions"].max(axis=0)
    # Room to fall and to fly; Genesis' particles stay three cells away from the border.
    room = 2 * (high - low).max() + 3 * twin["grid_spacing_m"]
    floors = [np.array(c["point_m"]) for c in twin["colliders"] if c["shape"] == "half_space"]
    low, high = np.min([low, *floors], axis=0) - room, np.max([high, *floors], axis=0) + room
    scene = gs.Scene(
        sim_options=gs.options.SimOptions(
            dt=1 / twin["frame_rate_hz"] / steps_per_frame, substeps=substeps, gravity=tuple(twin["gravity_m_s2"])
        ),
        mpm_options=gs.options.MPMOptions(
            lower_bound=tuple(low), upper_bound=tuple(high), grid_density=1 / twin["grid_spacing_m"],
            particle_size=(twin["mass_kg"] / rho / n) ** (1 / 3),
        ),
        show_viewer=False,
    )
    for collider in twin["colliders"]:
        if collider["shape"] == "half_space":
            friction = collider.get("friction", 2.0 if collider["contact"] == "sticky" else 0.0)
            plane = gs.morphs.Plane(pos=tuple(collider["point_m"]), normal=tuple(collider["normal"]))
            scene.add_entity(plane, material=gs.materials.Rigid(coup_friction=friction))
    body = scene.add_entity(gs.morphs.Nowhere(n_particles=n), material=laws[material["model"]]())
    scene.build()
    body.set_particles_pos(arrays["positions"])
    body.set_particles_vel(arrays["velocities"])
    body.set_particles_active(np.ones(n, dtype=bool))
    return scene, body, steps_per_frame


if __name__ == "__main__":
    gs.init(backend=gs.cpu)
    scene, body, steps = load()
    for _ in range(24 * steps):
        scene.step()
