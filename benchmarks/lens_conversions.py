"""What it costs to plan with real lenses whose model is not the unified one.

Run: ``python -m benchmarks.lens_conversions``. Estimates, poses, tags, tracking and hand-eye calibration
use a file's own model; only a plan's image limits need a unified camera. The nearest one lies so far away as
the table says, and plans keep that as a margin (docs/camera.md). Published numbers stand below; the files are
read from ../shared/data and left out where absent. "Sees": to the farthest pixel, from the axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from benchmarks.tables import print_table

from omniservo.camera_files import load_model
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import to_unified
from omniservo.cameras.conversion.residual import used_pixels
from omniservo.cameras.models import CentralModel, KannalaBrandt, OcamPolynomial, Pinhole

CALIBRATIONS = Path(__file__).resolve().parents[2] / "shared" / "data" / "calibrations"

HALF_TUM_VI = KannalaBrandt(
    190.97847715128717, 190.9733070521226, 254.93170605935475, 256.8974428996504, 512, 512,
    k=(0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202, 0.00020293673591811182),
)  # fmt: skip
"""TUM VI's camera 0, as OpenVINS has it"""

PUBLISHED: dict[str, CentralModel] = {
    # camera_info of a T265's fisheye1, as public settings of ORB-SLAM3 quote it
    "RealSense T265, fisheye": KannalaBrandt(
        285.0013122558594, 285.1625061035156, 424.4085998535156, 404.7959899902344, 848, 800,
        k=(-0.006391948089003563, 0.04148074984550476, -0.039229270071790245, 0.006981444079428911),
    ),
    # a RealSense's colour stream, five coefficients, as public settings of ORB-SLAM3 quote it
    "RealSense, colour": Pinhole(
        611.4509887695312, 611.4857177734375, 433.2039794921875, 249.4730224609375, 848, 480,
        distortion=(
            0.1465027779340744, -0.47989004850387573, -0.0008240030147135258, 0.0004609301104210317,
            0.4350232481956482,
        ),
    ),
    # the RGB-D benchmark's first Kinect, as its page states it
    "TUM RGB-D, freiburg1, colour": Pinhole(
        517.3, 516.5, 318.6, 255.3, 640, 480, distortion=(0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
    ),
    # the same lens at twice the pixels: focal lengths doubled, u' = 2u + 1/2
    "TUM VI at 1024 px": KannalaBrandt(
        2.0 * HALF_TUM_VI.fx, 2.0 * HALF_TUM_VI.fy, 2.0 * HALF_TUM_VI.cx + 0.5, 2.0 * HALF_TUM_VI.cy + 0.5,
        1024, 1024, k=HALF_TUM_VI.k,
    ),
    # OCamCalib's results for a Kodak action camera with a lens of 235 degrees, from a public repository
    "Kodak, OCam, 235°": OcamPolynomial(
        coefficients=(-271.6972, 0.0, -2.741744e-06, 1.840940e-06, -8.024838e-10),
        cx=729.090632, cy=728.648728, width=1440, height=1440, stretch=(1.001407, -0.000818, 0.000221),
    ),
}  # fmt: skip

ENDS = {"RealSense T265, fisheye": 90.0, "Kodak, OCam, 235°": 117.5}
"""degrees from the axis where a lens ends, as its maker says"""

FILES = {
    "OCam, Homing in Scale Space": "ocamcalib/premnirmal_Homing-in-Scale-Space__calib_results.txt",
    "OCam, SVO bluefox": "ocamcalib/uzh-rpg_rpg_svo_pro_open__bluefox_25000826_fisheye.yaml",
    "TUM VI, Kalibr": "kalibr/rpng_open_vins__tum_vi_kalibr_imucam_chain.yaml:cam0",
    "TUM VI, Basalt, double sphere": "basalt/VladyslavUsenko_basalt-mirror__tumvi_512_ds_calib.json:cam0",
    "TUM VI, Basalt, EUCM": "basalt/VladyslavUsenko_basalt-mirror__tumvi_512_eucm_calib.json:cam0",
    "Kalibr, double sphere": "kalibr/kalibr-ds_example_tiscamera_stereo.yaml:cam0",
    "Kalibr, omni": "kalibr/kalibr-wiki__yaml-formats_omni_stereo.yaml:cam0",
    "BoofCV, universal": "boofcv/example_fisheye_theta_front.yaml",
    "CamOdoCal MEI, KITTI-360": "mei_yaml/KITTI-360__image_02.yaml",
}

HEAD = "| lens | model | sees | at most [px] | at most [deg] | rms [px] | field lost |"


def lenses() -> Iterator[tuple[str, CentralModel]]:
    """Yield every lens that is there, with its name; some again, ended where their maker says."""
    for name, lens in PUBLISHED.items():
        yield name, lens
        if name in ENDS:
            yield f"{name}, --max-angle {ENDS[name]:g}", ended(lens, ENDS[name])
    for name, place in FILES.items():
        file, _, camera = place.partition(":")
        if (CALIBRATIONS / file).is_file():
            yield name, load_model(CALIBRATIONS / file, name=camera or None)


def ended(lens: CentralModel, degrees: float) -> CentralModel:
    """Return the lens with an end so far from its axis."""
    assert isinstance(lens, KannalaBrandt | OcamPolynomial)
    return replace(lens, max_angle=math.radians(degrees))


def row(name: str, lens: CentralModel) -> str:
    """Return the line of the table."""
    rays = lens.unproject(used_pixels(lens))[0]
    sees = f"{math.degrees(math.acos(float(np.min(rays[:, 2])))):.0f}°"
    start = f"{name} | {lens.to_dict()['model']} | {sees} |"
    if isinstance(lens, UnifiedCamera):
        return f"{start} it is one | – | – | –"
    found = to_unified(lens).residual
    angle, lost = math.degrees(found.largest_rad), f"{100.0 * found.lost:.1f}%"
    return f"{start} {found.largest_px:.2g} | {angle:.2g} | {found.rms_px:.2g} | {lost}"


def main() -> None:
    """Print the table as Markdown."""
    print_table(HEAD, (row(name, lens) for name, lens in lenses()))


if __name__ == "__main__":
    main()
