"""Young's modulus from a trajectory, by torch's Adam: `loss.backward()` goes through the simulator."""

import math

import gic.torch
import torch
from scene import cube

FRAMES = range(2, 12, 3)


def main(true_pa=5e4, start_pa=2e5, steps=50):
    target = torch.from_numpy(cube(true_pa).rollout(FRAMES).positions_m)
    simulator = cube()
    logarithm = torch.tensor(math.log(start_pa), requires_grad=True)
    optimizer = torch.optim.Adam([logarithm], lr=0.2)
    schedule = torch.optim.lr_scheduler.ExponentialLR(optimizer, 0.93)
    for step in range(steps):
        optimizer.zero_grad()
        positions, _ = gic.torch.rollout(simulator, FRAMES, {"youngs_modulus_pa": logarithm.exp()})
        loss = (positions - target).square().mean()
        loss.backward()
        optimizer.step()
        schedule.step()
        if step % 10 == 0:
            print(f"step {step}: E = {logarithm.exp().item():.4g} Pa, loss {loss.item():.3g} m^2")
    found = logarithm.exp().item()
    print(f"E = {found:.4g} Pa; the truth is {true_pa:.4g} Pa")
    return found


if __name__ == "__main__":
    main()
