"""A throw that ends at a place, by gradient descent on the initial velocity: through flight and bounce."""

import numpy as np
from scene import cube


def main(target_m=(0.35, 0.07, 0.2), frame=30, steps=40, rate=3.0):
    target = np.asarray(target_m)
    velocity = np.array([0.5, -2.0, 0.0])
    simulator = cube()
    for step in range(steps):
        recording = simulator.replace({"velocity_m_s": velocity}).record([frame])
        miss = recording.rollout.positions_m[0].mean(axis=0) - target
        if step % 10 == 0:
            print(f"step {step}: thrown at {velocity.round(3)} m/s, misses by {np.linalg.norm(miss) * 100:.2f} cm")
        adjoint = np.broadcast_to(miss / simulator.particles, recording.rollout.positions_m.shape)
        velocity -= rate * recording.gradient(adjoint)[0].velocity_m_s / recording.rollout.times_s[-1]
    distance = float(np.linalg.norm(miss))
    print(f"throw it at {velocity.round(3)} m/s: it ends {distance * 1000:.1f} mm from the target")
    return distance


if __name__ == "__main__":
    main()
