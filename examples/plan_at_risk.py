"""Plan for an uncertain estimate at a stated risk: a chance constraint on everything the problem asks for.

Two noisy images do not give a motion but a range of them. Prints how wide that range is, how much clearance
the plan adds so that at most 1% of what the images allow violates anything, and what the plan that takes the
estimate as exact would risk.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

import omniservo
from omniservo.planning import Sphere
from omniservo.risk import Executions

NOISE = 0.3  # [px]


def main() -> None:
    rng = np.random.default_rng(4)
    camera = omniservo.preset("fe185")
    truth = rng.uniform([-0.15, -0.12, 0.4], [0.15, 0.12, 0.6], (20, 3))
    initial_T_goal = RigidTransform.from_components([0.1, -0.05, 0.12], Rotation.from_rotvec([0, -0.2, 0.1]))
    initial, goal = (camera.project(p)[0] for p in (truth, initial_T_goal.inv().apply(truth)))
    estimate = omniservo.estimate_two_view(
        camera,
        initial + NOISE * rng.standard_normal(initial.shape),
        goal + NOISE * rng.standard_normal(goal.shape),
        scale=float(np.linalg.norm(initial_T_goal.translation)),
        scale_sigma=0.03,  # the displacement is known to 3%
    )
    sigma = np.sqrt(np.diag(estimate.covariance))
    print(f"estimate: {estimate.status}, translation ± {1e3 * sigma[:3].round(4)} mm (1 sigma)")

    ball = Sphere([0.05, -0.025, 0.06], 0.01)
    rows = np.flatnonzero(estimate.inliers)
    problem = omniservo.PlanningProblem(
        camera, estimate.points[rows], estimate.initial_T_goal, obstacles=(ball,), clearance=0.04
    )
    found = omniservo.plan_with_risk(problem, estimate, risk=0.01)
    kept = 1e3 * found.plan.least_clearance([0])
    print(f"at 1% risk: {found.plan.status}, {kept:.1f} mm planned, 40 asked; {found.advice}")
    print(
        f"  violated by {100 * found.predicted:.2f}% of samples, 95% bound {100 * found.predicted_bound:.2f}%"
    )

    plain = omniservo.plan_path(problem)
    samples = Executions.of(problem, estimate.sample(rng, 2000, camera=camera), rows)
    # Each sample is executed at even places of the path, and at w = 0.5, where the ball is nearest.
    violated = (samples.margins(plain.path, np.array([0.5])) < 0.0).any(axis=1).mean()
    print(f"taken as exact: {plain.status}, {1e3 * plain.least_clearance([0]):.1f} mm planned")
    print(f"  violated by {100 * violated:.0f}% of samples")


if __name__ == "__main__":
    main()
