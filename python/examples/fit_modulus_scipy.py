"""Young's modulus and Poisson's ratio from a trajectory, by SciPy's least squares with the simulator's Jacobian."""

import numpy as np
from scene import cube
from scipy.optimize import least_squares

FRAMES = range(2, 12, 3)


def main(true_pa=5e4, true_ratio=0.3, start_pa=2e5, start_ratio=0.2):
    target = cube(true_pa, true_ratio).rollout(FRAMES).positions_m

    def world(unknowns):
        return cube(np.exp(unknowns[0]), unknowns[1])

    def residuals(unknowns):
        return (world(unknowns).rollout(FRAMES).positions_m - target).ravel()

    def jacobian(unknowns):
        found = world(unknowns).jacobian(FRAMES, ["youngs_modulus_pa", "poisson_ratio"]).positions_m.reshape(-1, 2)
        return found * [np.exp(unknowns[0]), 1.0]

    start = [np.log(start_pa), start_ratio]
    fit = least_squares(residuals, start, jacobian, bounds=([0.0, 0.0], [30.0, 0.49]), x_scale=[1.0, 0.1])
    modulus, ratio = float(np.exp(fit.x[0])), float(fit.x[1])
    print(f"E = {modulus:.4g} Pa, nu = {ratio:.4f} after {fit.nfev} rollouts; the truth is {true_pa:.4g}, {true_ratio}")
    return modulus, ratio


if __name__ == "__main__":
    main()
