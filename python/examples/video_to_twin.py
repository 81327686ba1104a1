"""From the bundled scene's videos to its twin, and the twin's future on the Moon.

    python video_to_twin.py [SCENE OUT]
"""

import sys
from pathlib import Path

import gic

DEMO = Path(__file__).resolve().parents[2] / "crates/gic/demo"


def main(scene=DEMO, out="out/python", **flags):
    run = gic.run(scene, material="elastic", out=out, **flags)
    for row in run.table():
        print("{parameter}: {value:.4g}, 95 % between {low_95} and {high_95}".format(**row))
    moon = run.twin.simulate(frames=12, set={"gravity_m_s2": [0, -1.62, 0]})
    print(f"on the Moon the twin is {moon.positions_m[-1, :, 1].mean():.3f} m high after {moon.times_s[-1]:.2f} s")
    return run


if __name__ == "__main__":
    main(*sys.argv[1:])
