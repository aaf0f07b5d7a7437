"""mrcal's answers, read as JSON from the standard input and printed as JSON. For Debian's python3 alone.

Debian's mrcal is built for Debian's Python and NumPy; so this file is run by ``/usr/bin/python3`` and imports
nothing of ours (`compare` runs it).

{"task": "project", "lensmodel", "intrinsics", "points" (n, 3)} → "pixels" (n, 2), "back" (n, 3) unprojected.
{"task": "calibrate", "lensmodel", "focal", "size", "board" [columns, rows], "square" [m], "views" (v, n, 2),
"held_out" likewise, "at" (m, 2), "folder"} → what ``mrcal-calibrate-cameras`` makes of the views with its
default settings: "rms" of them (outliers aside) and of those held out, each pose adjusted, "outliers",
"bearings" (3, m, 3) of the pixels ``at`` and of those 1 px farther in u and in v, "stated" (m,) the standard
deviation of a coordinate there, at infinity.
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np


def calibrated(given: dict[str, Any], mrcal: Any) -> Any:
    """Return the model that the command makes."""
    folder = Path(given["folder"])
    (folder / "corners.vnl").write_text(
        "# filename x y level\n"
        + "".join(
            f"view{k:04d}.png {x!r} {y!r} 0\n" for k, view in enumerate(given["views"]) for x, y in view
        )
    )
    columns, rows = given["board"]
    command = [
        "mrcal-calibrate-cameras", "--corners-cache", str(folder / "corners.vnl"),
        "--lensmodel", given["lensmodel"], "--focal", str(given["focal"]),
        "--object-spacing", str(given["square"]), "--object-width-n", str(columns),
        "--object-height-n", str(rows), "--imagersize", *map(str, given["size"]),
        "--outdir", str(folder), "view*.png",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError((done.stderr or done.stdout).strip().splitlines()[-1])
    return mrcal.cameramodel(str(folder / "camera-0.cameramodel"))


def corner_errors(inputs: dict[str, Any], mrcal: Any) -> Any:
    """Return the errors (v, rows, columns, 2) [px] of board views, outliers NaN."""
    observed = inputs["observations_board"]
    x = mrcal.optimizer_callback(**inputs, no_jacobian=True, no_factorization=True)[1]
    errors = x[: observed[..., 0].size * 2].reshape(*observed.shape[:-1], 2)
    return np.where(observed[..., 2:] > 0.0, errors, np.nan)


def held_out_errors(model: Any, given: dict[str, Any], mrcal: Any) -> Any:
    """Return the errors of other views, of which the pose alone is adjusted."""
    columns, rows = given["board"]
    corners = np.array(given["held_out"]).reshape(-1, rows, columns, 2)
    observed = np.concatenate([corners, np.ones((*corners.shape[:3], 1))], axis=-1)
    indices = np.zeros((len(corners), 2), dtype=np.int32)
    indices[:, 0] = np.arange(len(corners))
    poses = mrcal.estimate_monocular_calobject_poses_Rt_tocam(indices, observed, given["square"], [model])
    made, of_both = model.optimization_inputs(), ("lensmodel", "imagersizes", "calobject_warp")
    inputs = {name: made[name] for name in of_both} | {
        "intrinsics": made["intrinsics"].copy(),
        "extrinsics_rt_fromref": np.zeros((0, 6)),
        "frames_rt_toref": mrcal.rt_from_Rt(poses),
        "points": None,
        "observations_point": None,
        "indices_point_camintrinsics_camextrinsics": None,
        "observations_board": observed,
        "indices_frame_camintrinsics_camextrinsics": np.concatenate(
            [indices, np.full((len(corners), 1), -1, dtype=np.int32)], axis=1
        ),
        "calibration_object_spacing": given["square"],
        "do_optimize_intrinsics_core": False,
        "do_optimize_intrinsics_distortions": False,
        "do_optimize_extrinsics": False,
        "do_optimize_calobject_warp": False,
        "do_apply_regularization": False,
    }
    mrcal.optimize(**inputs, do_apply_outlier_rejection=False)
    return corner_errors(inputs, mrcal)


def rms(errors: Any) -> float:
    """Return the root mean square length of errors (…, 2)."""
    return float(np.sqrt(np.nanmean((errors**2).sum(axis=-1))))


def calibrate(given: dict[str, Any], mrcal: Any) -> dict[str, Any]:
    """Answer "calibrate"."""
    model = calibrated(given, mrcal)
    inputs = model.optimization_inputs()
    at = np.array(given["at"])
    lens = model.intrinsics()
    shifted = at + np.array([[[0.0, 0.0]], [[1.0, 0.0]], [[0.0, 1.0]]])
    bearings = mrcal.unproject(shifted, *lens, normalize=True)
    stated = mrcal.projection_uncertainty(bearings[0], model=model, atinfinity=True, what="rms-stdev")
    errors = corner_errors(inputs, mrcal)
    return {
        "rms": rms(errors),
        "held_out": rms(held_out_errors(model, given, mrcal)) if given["held_out"] else None,
        "outliers": int(np.isnan(errors[..., 0]).sum()),
        "bearings": bearings.tolist(),
        "stated": stated.tolist(),
    }


def project(given: dict[str, Any], mrcal: Any) -> dict[str, Any]:
    """Answer "project"."""
    points = np.array(given["points"])
    lens = given["lensmodel"], np.array(given["intrinsics"])
    pixels = mrcal.project(points, *lens)
    return {"pixels": pixels.tolist(), "back": mrcal.unproject(pixels, *lens, normalize=True).tolist()}


def main() -> None:
    """Answer one question."""
    import mrcal

    given = json.load(sys.stdin)
    answer = {"project": project, "calibrate": calibrate}[given["task"]](given, mrcal)
    json.dump(answer, sys.stdout)


if __name__ == "__main__":
    main()
