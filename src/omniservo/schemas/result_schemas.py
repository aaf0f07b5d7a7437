"""JSON schemas of estimates, targets, and what is measured of an arm and its camera."""

from __future__ import annotations

from omniservo.calibration.hand_eye.hand_eye import FORMAT as HAND_EYE
from omniservo.calibration.hand_eye.robot_poses_file import FORMAT as ROBOT_POSES
from omniservo.estimation.two_view_estimate import FORMAT as ESTIMATE
from omniservo.estimation.two_view_estimate import STATUSES
from omniservo.files import UNITS
from omniservo.robots.path_following.tracking_tube import FORMAT as TUBE
from omniservo.run_methods import METHODS
from omniservo.runs.estimate_many_images import FORMAT as VIEWS
from omniservo.runs.robot_records import CHECK, DELAY
from omniservo.runs.run_inputs import FORMAT as RUN
from omniservo.schemas.camera_schema import camera_schema
from omniservo.schemas.shapes import (
    COUNT,
    FLAG,
    NOT_NEGATIVE,
    NUMBER,
    POINT,
    POSE,
    POSITIVE,
    TEXT,
    TURNED,
    Schema,
    choice,
    either,
    mapping,
    matrix,
    nullable,
    of_format,
    said,
    several,
    turned_once,
)
from omniservo.targets.target import FORMAT as TARGET
from omniservo.targets.target import MOST_MEMBERS

_OR_NULL = nullable(NUMBER)
_SPREAD = matrix(6, 6)
UNITS_FIELD = said(
    mapping({}, {quantity: choice(*legal) for quantity, legal in UNITS.items()}),
    "of all lengths and angles in the file; where absent m and rad",
)


def estimate_schema() -> Schema:
    """Return the schema of motion and structure from two views."""
    law = mapping(
        {
            "noise": several(several(NUMBER)),
            "own": several(matrix(3, 3)),
            "freedom": nullable(NUMBER),
            "calibration": several(several(NUMBER)),
            "camera": several(several(NUMBER)),
        },
        {"pixel_sigma": nullable(matrix(None, 2)), "size_variance": NOT_NEGATIVE},
    )
    return of_format(
        ESTIMATE,
        {
            "status": choice(*STATUSES),
            "message": said(TEXT, "the evidence in one sentence; empty for ok"),
            "goal": said(nullable(POSE), "initial_T_goal; null unless ok"),
            "points": said(matrix(None, 3, _OR_NULL), "[m], or in lengths of the translation"),
            "is_metric": FLAG,
            "covariance": said(matrix(6, 6, _OR_NULL), "translation, rotation vector on the right [m, rad]"),
            "points_covariance": several(matrix(3, 3, _OR_NULL)),
            "inliers": several(FLAG),
            "rms_px": _OR_NULL,
            "noise_px": _OR_NULL,
            "residuals_px": matrix(None, 4, _OR_NULL),
            "seconds": NOT_NEGATIVE,
        },
        {
            "scale_sigma": NOT_NEGATIVE,
            "uncertainty": nullable(law),
            "camera": nullable(camera_schema()),
            "alternatives": several(POSE),
        },
    )


def views_schema() -> Schema:
    """Return the schema of what ``estimate`` says of several images."""
    image = mapping(
        {
            "image": TEXT,
            "status": TEXT,
            "reason": TEXT,
            "points": COUNT,
            "pose": said(nullable(POSE), "in the frame of `frame`"),
            "covariance": nullable(_SPREAD),
        }
    )
    further = mapping(
        {
            "pose": POSE,
            "points": said(NOT_NEGATIVE, "that it is expected to show"),
            "position_sigma": several(NUMBER),
            "rotation_sigma": several(NUMBER),
            "size_sigma": several(NUMBER),
        }
    )
    return of_format(
        VIEWS,
        {
            "status": TEXT,
            "message": TEXT,
            "frame": said(nullable(TEXT), "the image whose camera frame poses and points are stated in"),
            "images": several(image),
            "is_metric": FLAG,
            "size_sigma": _OR_NULL,
            "points": matrix(None, 3),
            "points_covariance": several(matrix(3, 3)),
            "rms_px": _OR_NULL,
            "noise_px": _OR_NULL,
            "seconds": NOT_NEGATIVE,
            "further": said(several(further), "what one more image would gain, the best first"),
        },
    )


def target_schema() -> Schema:
    """Return the schema of a target of known geometry."""
    name = {"type": "string", "minLength": 1, "maxLength": 100}
    point = mapping({"name": name, "position": POINT})
    required = {"dictionary": TEXT, "id": COUNT, "edge": said(POSITIVE, "of the dark border")}
    tag = turned_once(mapping(required, {"translation": POINT, **TURNED}))
    lists = {"points": several(point, 0, MOST_MEMBERS), "tags": several(tag, 0, MOST_MEMBERS)}
    some = [{"required": [kind], "properties": {kind: {"minItems": 1}}} for kind in lists]
    return {**of_format(TARGET, {}, {"units": UNITS_FIELD, **lists}), "anyOf": some}


def hand_eye_schema() -> Schema:
    """Return the schema of a hand-eye calibration; further fields are evidence that no reader needs."""
    mount = ("flange_T_camera", "tool_T_camera")
    known: dict[str, Schema] = {
        "format": {"const": HAND_EYE},
        mount[0]: said(POSE, "the camera in the flange frame"),
        mount[1]: said(POSE, "its name of before"),
        "covariance": said(_SPREAD, "translation, rotation vector on the right [m, rad]"),
        "base_T_board": POSE,
        "board_covariance": _SPREAD,
        "robot_position_m": NUMBER,
        "robot_rotation_rad": NUMBER,
        "noise_px": NUMBER,
        "board_scale": NUMBER,
        "board_scale_sigma": NUMBER,
        "views_used": COUNT,
    }
    return {
        "type": "object",
        "properties": known,
        "required": ["format", "covariance"],
        "anyOf": [{"required": [name]} for name in mount],
    }


def robot_poses_schema() -> Schema:
    """Return the schema of the flange's poses, one an image."""
    rotations = [
        {"required": ["translation", "quaternion"]},
        {"required": ["translation", "rotation_vector"]},
        {"required": ["matrix"]},
    ]
    known: dict[str, Schema] = {
        "image": said({"type": "string", "minLength": 1}, "name of its file"),
        "translation": POINT,
        **TURNED,
        "matrix": matrix(4, 4),
    }
    pose = {**mapping({}, known), "oneOf": rotations}
    lists = {name: several(pose, 1) for name in ("base_T_flange", "base_T_tool")}
    schema = of_format(ROBOT_POSES, {}, {"units": UNITS_FIELD, **lists})
    return {**schema, "oneOf": [{"required": [name]} for name in lists]}


def tracking_tube_schema() -> Schema:
    """Return the schema of how far an arm deviates from its paths."""
    sizes = several(NOT_NEGATIVE, 1)
    return of_format(
        TUBE,
        {
            "arm": TEXT,
            "links": several(TEXT),
            "source": TEXT,
            "singular_value": NOT_NEGATIVE,
            "shape": said(sizes, "joints [rad], links [m], camera [m], points [px]"),
            "ratios": said(sizes, "of every run to the shape"),
        },
    )


def run_schema() -> Schema:
    """Return the schema of what a run is computed from."""
    robot = mapping({"file": TEXT, "speed": {"type": "number", "exclusiveMinimum": 0, "maximum": 1}})
    return of_format(
        RUN,
        {
            "method": choice(*METHODS),
            "seed": COUNT,
            "task": said(TEXT, "its file, beside this one"),
            "packages": {"type": "object", "additionalProperties": TEXT},
        },
        {
            "version": said(TEXT, "of the program"),
            "start_joints": said(nullable(several(NUMBER)), "[rad]"),
            "robot": nullable(robot),
        },
    )


def robot_check_schema() -> Schema:
    """Return the schema of the record that a robot was checked."""
    digest = {"type": "string", "pattern": "^[0-9a-f]{64}$"}
    return of_format(
        CHECK,
        {
            "driver": TEXT,
            "address": TEXT,
            "camera_source": TEXT,
            "robot_sha256": said(digest, "SHA-256 of the robot's file and those that it names"),
            "time": said(NUMBER, "[s] since 1970"),
        },
    )


def robot_delay_schema() -> Schema:
    """Return the schema of how late a robot's images and motions are."""
    return of_format(
        DELAY,
        {
            "driver": TEXT,
            "address": TEXT,
            "camera_source": TEXT,
            "camera_offset_s": said(NUMBER, "is added to the stamps of images"),
            "camera_offset_sigma_s": NOT_NEGATIVE,
            "actuation_lag_s": NOT_NEGATIVE,
        },
        {
            "actuation_lag_sigma_s": either(NOT_NEGATIVE, {"type": "null"}),
            "image_age_s": said(NUMBER, "from the stamps of images until they came; 99% came sooner"),
        },
    )
