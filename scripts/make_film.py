#!/usr/bin/env python3
"""Makes a film out of a scene of the generator: cameras that lag, that are not quite where they are said to be, noise.

    VENV/bin/python scripts/make_film.py SCENE --generator FOLDER -o FILM [--seed N]
    VENV/bin/python scripts/make_film.py SCENE --from FILM -o OTHER --seed N

SCENE is what `make_suite.py` makes: its first particles fall again, by the published simulator, and each camera films
them at its own times. The film says that all cameras share one clock, and where they are but for errors that the seed
draws; it has no masks. The second form takes the pictures of a film and draws other errors. FILM/gt is the truth.
"""

import argparse
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from make_suite import environment
from PIL import Image
from scipy.spatial.transform import Rotation

TICKS = 10  # a frame, at which a camera can take its pictures
CAMERAS, DELAYS_TICKS = [0, 3, 6, 9], [0, 3, 9, 5]  # of the rig, and by how much they lag
TURN_DEG, SHIFT_M, FOCAL_SHARE = 0.3, 0.002, 0.02  # how far a stated camera is off
NOISE = 4.0  # of 255


def simulate(scene, truth, generator, folder):
    """Writes the truth of each camera's film to a folder of its own: the moments at which it takes its pictures."""
    import bench_sim

    bench_sim.FPS, frames = TICKS * truth["fps"], truth["n_frames"]
    start = np.load(scene / "gt" / "particles_0.npz")["x"].astype(np.float64)
    simulator = str(generator / "ref" / "mpm_simulator.py")
    substeps = truth["substeps_per_frame"] // TICKS
    reference = bench_sim.Reference(simulator, truth["material"], len(start), substeps=substeps, threads=2)
    last = TICKS * (frames - 1) + max(DELAYS_TICKS)
    path, _ = reference.forward(start, truth["initial_velocity"], truth["raw"], last + 1)
    for camera, delay in zip(CAMERAS, DELAYS_TICKS):
        place = folder / str(camera) / "gt"
        place.mkdir(parents=True)
        for name in ["params.json", "rest.npz"]:
            shutil.copy(scene / "gt" / name, place)
        for frame in range(frames):
            np.savez_compressed(place / f"particles_{frame}.npz", x=path[TICKS * frame + delay].astype(np.float32))


def render(truth, folder, out):
    """Pictures of all cameras, with noise."""
    os.environ.update(environment())
    import bench_render

    poses = bench_render.rig(np.array(truth["camera_target"]), truth["camera_radius"])
    bench_render.contact_sheet = lambda *_: None
    (out / "data").mkdir()
    noise = np.random.default_rng(0)
    for camera in CAMERAS:
        bench_render.cameras = lambda *_, pose=poses[camera]: ([pose], np.zeros(3), 0.0)
        options = SimpleNamespace(size=truth["image_size"], spp=truth["spp"], shadow_blur=2.5, mesh=False, sheet=None)
        bench_render.render_scene(str(folder / str(camera)), options)
        for frame in range(-1, truth["n_frames"]):
            picture = np.asarray(Image.open(folder / str(camera) / "data" / f"r_0_{frame}.png"), float)
            noisy = np.clip(picture + noise.normal(0, NOISE, picture.shape) + 0.5, 0, 255).astype(np.uint8)
            Image.fromarray(noisy).save(out / "data" / f"r_{camera}_{frame}.png")


def drawn(generator, size):
    """A vector of this length in any direction."""
    direction = generator.normal(size=3)
    return size * direction / np.linalg.norm(direction)


def stated(pose, focal, generator):
    """A camera as the film says it is: turned, shifted, and with another focal length."""
    turn = Rotation.from_rotvec(drawn(generator, TURN_DEG), degrees=True).as_matrix()
    centre = pose[:, 3] + drawn(generator, SHIFT_M)
    return np.column_stack([turn @ pose[:, :3], centre]), focal * (1 + FOCAL_SHARE * generator.choice([-1, 1]))


def describe(scene, truth, out, seed):
    """Writes what the film says of its cameras, and the truth."""
    entries = {entry["file_path"]: entry for entry in json.loads((scene / "all_data.json").read_text())}
    generator, said, cameras = np.random.default_rng(seed), [], []
    for camera, delay in zip(CAMERAS, DELAYS_TICKS):
        first = entries[f"./data/r_{camera}_0.png"]
        focal, size = first["intrinsic"][0][0], 2 * first["intrinsic"][0][2]
        pose, stated_focal = stated(np.array(first["c2w"]), focal, generator)
        intrinsic = [[stated_focal, 0, size / 2], [0, stated_focal, size / 2], [0, 0, 1]]
        for frame in range(-1, truth["n_frames"]):
            name = f"./data/r_{camera}_{frame}.png"
            said.append({**entries[name], "c2w": pose.tolist(), "intrinsic": intrinsic})
        share = stated_focal / focal - 1
        cameras.append({"camera": camera, "delay_frames": delay / TICKS, "stated_focal_share": share})
    (out / "all_data.json").write_text(json.dumps(said, indent=0))
    shutil.copytree(scene / "gt", out / "gt")
    (out / "gt" / "cameras.json").write_text(json.dumps(cameras, indent=1))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, metavar="SCENE")
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("--generator", type=Path, metavar="FOLDER")
    source.add_argument("--from", dest="film", type=Path, metavar="FILM", help="a film of the same scene")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="FILM")
    parser.add_argument("--seed", type=int, default=0, help="of the cameras' errors")
    options = parser.parse_args()
    if options.out.exists():
        parser.error(f"{options.out} is there already")
    truth = json.loads((options.scene / "gt" / "params.json").read_text())
    options.out.mkdir(parents=True)
    if options.film:
        shutil.copytree(options.film / "data", options.out / "data")
    else:
        generator = options.generator.resolve()
        sys.path.insert(0, str(generator))
        with tempfile.TemporaryDirectory() as folder:
            simulate(options.scene, truth, generator, Path(folder))
            render(truth, Path(folder), options.out)
    describe(options.scene, truth, options.out, options.seed)


if __name__ == "__main__":
    main()
