"""``omniservo estimate`` of more than two images."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from omniservo.cli.output import Output, answer_is_no
from omniservo.errors import InputError, spelled
from omniservo.files import require_file

if TYPE_CHECKING:
    from omniservo.cameras.models import CentralModel
    from omniservo.runs import EstimatedViews, ImageScale

Features = Literal["dots", "tags", "natural"]
_TOLD = 3
"""further images of which is said what they would gain"""


@dataclass(frozen=True)
class Lengths:
    """What only several images take."""

    length: Annotated[
        str | None,
        typer.Option(
            "--length",
            help="I:J:METRES, between two dots (by number, as the first image shows them) or tag corners"
            " (4 times the tag, plus the corner).",
        ),
    ] = None
    tag_edge: Annotated[float | None, typer.Option("--tag-edge", help="Edge of every tag, in metres.")] = None
    poses: Annotated[
        str | None, typer.Option("--poses", help="The arm's poses, as calibrate-hand-eye takes them.")
    ] = None
    mount: Annotated[
        Path | None, typer.Option("--mount", help="What calibrate-hand-eye wrote; with --poses.")
    ] = None

    @property
    def any(self) -> bool:
        """Whether anything is given."""
        return any(value is not None for value in astuple(self))

    def scale(self, displacement: float | None, target: Path | None) -> ImageScale:
        """Return what is known of lengths.

        Raises:
            InputError: a length that is not I:J:METRES.
        """
        from omniservo.runs import ImageScale

        between = None
        if self.length is not None:
            try:
                i, j, metres = self.length.split(":")
                between = int(i), int(j), float(metres)
            except ValueError:
                words = f"length: {spelled(self.length)} given; legal: I:J:METRES, as 0:5:0.12"
                raise InputError(words) from None
        return ImageScale(displacement, between, self.tag_edge, target, self.poses, self.mount)


def estimate_views_of(
    camera: CentralModel | None,
    images: Sequence[str],
    kind: tuple[Features, str | None],
    scale: ImageScale,
    output: Output,
) -> EstimatedViews:
    """Estimate, and say what came of it; ``kind``: the features, and the tags' dictionary."""
    if camera is None:
        raise InputError("camera: missing; images need --camera")
    for name in images:
        require_file(Path(name))
    with output.working("loading") as progress:
        from omniservo.runs import estimate_many_images

        found = estimate_many_images(
            camera, images, features=kind[0], dictionary=kind[1], scale=scale, progress=progress
        )
    output.result(found.to_dict())
    estimate = found.estimate
    if estimate.status != "ok":
        for image, (status, reason) in zip(found.images, found.statuses(), strict=True):
            output.line(f"{image}: {status}: {reason}")
        raise answer_is_no(f"motion and structure cannot be estimated: {estimate.status}: {estimate.message}")
    for line in _lines(found):
        output.line(line)
    return found


def _lines(found: EstimatedViews) -> Iterator[str]:
    """Yield what a person wants to know."""
    import numpy as np

    estimate, statuses = found.estimate, found.statuses()
    joined = sum(pose is not None for pose in estimate.initial_T_views)
    placed = ~np.isnan(estimate.points[:, 0])
    yield (
        f"{joined} of {len(found.images)} images joined by {int(placed.sum())} points,"
        f" rms {estimate.rms_px:.3f} px; the frame is that of {found.images[estimate.reference or 0]}"
    )
    unit = "m" if estimate.is_metric else "(the first two centres are 1 apart: no scale was given)"
    for view, image in enumerate(found.images):
        pose, (status, reason) = estimate.initial_T_views[view], statuses[view]
        if pose is None:
            yield f"{image}: {status}: {reason}"
        elif view != estimate.reference:
            sigma = np.sqrt(np.diag(estimate.covariance[view]))
            turn = pose.rotation.as_rotvec(degrees=True)
            said = "" if status == "ok" else ", by its stated displacement alone"
            yield (
                f"{image}: translation {_numbers(pose.translation)} ± {_numbers(sigma[:3])} {unit},"
                f" rotation vector {_numbers(turn)} ± {_numbers(np.degrees(sigma[3:]))} deg{said}"
            )
    away = np.linalg.norm(estimate.points[placed], axis=1)
    sure = f"its scale is known to {100.0 * estimate.size_sigma:.2g}% (1 sigma)"
    yield f"points {away.min():.3g} to {away.max():.3g} {unit.split()[0]} away; {sure}"
    if estimate.message:
        yield f"notice: {estimate.message}"
    for more in found.further[:_TOLD]:
        (a, b), (c, d), (e, f) = more.position_sigma, more.rotation_sigma, more.size_sigma
        yield (
            f"one more image from {_numbers(more.initial_T_view.translation)}: position sigma {a:.2g} to"
            f" {b:.2g}, rotation {math.degrees(c):.2g} to {math.degrees(d):.2g} deg,"
            f" scale {100.0 * e:.2g} to {100.0 * f:.2g}%"
        )


def _numbers(values: object) -> str:
    import numpy as np

    return "[" + " ".join(f"{x:.3g}" for x in np.asarray(values)) + "]"
