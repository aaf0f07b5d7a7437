"""Which part would have to be better for a plan, and by how much: found by planning with it made smaller."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from omniservo.cameras import ModelError
from omniservo.errors import InputError
from omniservo.estimation import TwoViewEstimate
from omniservo.estimation.arm_views import ArmViews, ArmViewsOptimum, LengthPrior
from omniservo.estimation.estimate_arm_views import estimate_at
from omniservo.geometry.arrays import FloatArray
from omniservo.looks.next_look import Plans
from omniservo.looks.standing import ViewingState

SHARES = (0.5, 0.25, 0.1)
"""to which a part is made smaller, the first that does is named"""


def what_is_missing(here: ViewingState, plans: Plans) -> str:
    """Return a sentence that names each part by which alone there would be a plan, and to what share of it.

    Pixels (their noise), lens (its covariance and the model's error), scale, mount, structure (the points'
    places; the goal's pose stays as uncertain as it is), tube (what an arm deviates), singular value
    (what a tube requires of it).

    Args:
        here: where the arm stands.
        plans: whether there is a plan; it must take the mount's covariance from `ViewingState.mount`.
    """
    found, known = [], {}
    for name, smaller in _parts(here):
        exact = _try(plans, smaller(0.0))
        known[name] = exact
        if not exact:
            continue
        share = next((s for s in SHARES if _try(plans, smaller(s))), 0.0)
        found.append(f"{name}: {_spelled(share)}")
    if found:
        return f"there would be a plan with one of these better: {'; '.join(found)}"
    everything: ViewingState | None = here
    for name in known:
        if everything is not None:
            everything = dict(_parts(everything)).get(name, lambda share, e=everything: e)(0.0)
    if len(known) > 1 and _try(plans, everything):
        return f"only with all of these better there would be a plan: {', '.join(known)}"
    return "there would be none if everything were known and followed exactly"


def _spelled(share: float) -> str:
    words = {0.5: "half as uncertain", 0.25: "a quarter as uncertain", 0.1: "a tenth as uncertain"}
    return words.get(share, "exact")


def _try(plans: Plans, there: ViewingState | None) -> bool:
    try:
        return there is not None and plans(there)
    except InputError:
        return False


def _parts(here: ViewingState) -> Iterator[tuple[str, Callable[[float], ViewingState | None]]]:
    """Yield the parts that there are, and what makes each smaller."""
    if (optimum := here.optimum) is not None:
        yield "pixels", lambda share: _with(here, replace(optimum, views=_quieter(optimum, share)))
        if optimum.views.known.lens is not None or optimum.views.camera.model_error is not None:
            yield "lens", lambda share: _with(here, _clearer(optimum, share))
        if (length := optimum.views.known.length) is not None:
            yield "scale", lambda share: _with(here, _scaled_better(optimum, length, share))
    if (mount := here.mount) is not None:
        yield "mount", lambda share: _better_mounted(here, mount, share)
    yield "structure", lambda share: replace(here, estimate=_known_better(here.estimate, share))
    if here.tube is not None:
        tube = here.tube
        yield "tube", lambda share: replace(
            here,
            tube=replace(
                tube, joints=share * tube.joints, position=share * tube.position, image=share * tube.image,
                links={name: share * most for name, most in tube.links.items()},
            ),
        )  # fmt: skip
        yield (
            "singular value",
            lambda share: replace(here, tube=replace(tube, singular_value=share * tube.singular_value)),
        )


_LEAST = 1e-3
"""So small a share stands for nothing, where nothing is not legal."""


def _with(here: ViewingState, optimum: ArmViewsOptimum) -> ViewingState | None:
    estimate = estimate_at(optimum)
    return None if estimate is None else replace(here, estimate=estimate, optimum=optimum)


def _quieter(optimum: ArmViewsOptimum, share: float) -> ArmViews:
    views = optimum.views
    return replace(views, noise=max(share, _LEAST) * views.noise)


def _clearer(optimum: ArmViewsOptimum, share: float) -> ArmViewsOptimum:
    views, share = optimum.views, max(share, _LEAST)
    error, lens = views.camera.model_error, views.known.lens
    camera = views.camera
    if error is not None:
        camera = replace(camera, model_error=ModelError(share * error.sigma_px, error.length_px))
    known = views.known if lens is None else replace(views.known, lens=share**2 * lens)
    # the camera that was found stays: its deviation is a larger number of smaller σ
    return replace(optimum, views=replace(views, camera=camera, known=known), lens=optimum.lens / share)


def _scaled_better(optimum: ArmViewsOptimum, length: LengthPrior, share: float) -> ArmViewsOptimum:
    views = optimum.views
    known = replace(views.known, length=length._replace(sigma=share * length.sigma))
    return replace(optimum, views=replace(views, known=known))


def _better_mounted(here: ViewingState, known_mount: FloatArray, share: float) -> ViewingState | None:
    share = max(share, _LEAST)
    mount = share**2 * known_mount
    better = replace(here, mount=mount)
    if here.optimum is None:
        return better
    views = here.optimum.views
    known = replace(views.known, mount=mount)
    return _with(
        better,
        replace(here.optimum, views=replace(views, known=known), mount=here.optimum.mount / share),
    )


def _known_better(estimate: TwoViewEstimate, share: float) -> TwoViewEstimate:
    law = estimate.uncertainty
    if law is None:
        return estimate
    noise, calibration = law.noise.copy(), law.calibration.copy()
    noise[:, 6:] *= share
    calibration[:, 6:] *= share
    return replace(
        estimate,
        points_covariance=share**2 * estimate.points_covariance,
        uncertainty=replace(
            law, noise=noise, calibration=calibration, own=share**2 * law.own, pixel_sigma=None
        ),
    )
