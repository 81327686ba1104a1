"""The posterior of Young's modulus and Poisson's ratio by emcee, beside the interval that gic's way gives: the
covariance of a least-squares fit."""

import emcee
import numpy as np
from scene import cube

FRAMES = range(2, 12, 3)
TRUTH = (5e4, 0.3)
NOISE_M = 1e-3
#: Every so many particles are seen.
SEEN = 50


def main(walkers=8, steps=40):
    random = np.random.default_rng(1)
    seen = cube(*TRUTH).rollout(FRAMES).positions_m[:, ::SEEN]
    observed = seen + NOISE_M * random.standard_normal(seen.shape)
    # In log E and nu, at the truth.
    jacobian = cube(*TRUTH, precision="f64").jacobian(FRAMES, ["youngs_modulus_pa", "poisson_ratio"]).positions_m
    rows = jacobian[:, ::SEEN].reshape(-1, 2) * [TRUTH[0], 1.0] / NOISE_M
    deviations = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))

    def log_posterior(unknowns):
        if not 0.0 <= unknowns[1] <= 0.49:
            return -np.inf
        miss = cube(np.exp(unknowns[0]), unknowns[1]).rollout(FRAMES).positions_m[:, ::SEEN] - observed
        return -0.5 * (miss**2).sum() / NOISE_M**2

    start = [np.log(TRUTH[0]), TRUTH[1]] + deviations * random.standard_normal((walkers, 2))
    sampler = emcee.EnsembleSampler(walkers, 2, log_posterior)
    sampler.random_state = np.random.RandomState(1).get_state()
    sampler.run_mcmc(start, steps)
    samples = sampler.get_chain(discard=steps // 4, flat=True)
    for name, values, truth, deviation in zip(("log E", "nu"), samples.T, (np.log(TRUTH[0]), TRUTH[1]), deviations):
        low, high = np.quantile(values, [0.025, 0.975])
        print(f"{name}: posterior {low:.4f} .. {high:.4f}; least squares +- {1.96 * deviation:.4f}; truth {truth:.4f}")
    return samples.std(axis=0), deviations


if __name__ == "__main__":
    main()
