"""JSON schemas of what each command prints with ``--json``, where that is no file's format."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from omniservo.reporting.metric_meanings import metrics_in_words
from omniservo.schemas.camera_schema import camera_schema
from omniservo.schemas.shapes import (
    COUNT,
    FLAG,
    NOT_NEGATIVE,
    NUMBER,
    POINT,
    SHARE,
    TEXT,
    Schema,
    choice,
    either,
    mapping,
    matrix,
    nullable,
    of_format,
    said,
    several,
    vector,
)
from omniservo.studies.study_row import StudyRow
from omniservo.studies.study_summary import MEDIANS, RATES

_OUT = said(TEXT, "where it was written")
_OR_NULL = nullable(NUMBER)
_POSE = said(matrix(4, 4), "homogeneous, translation in m")
_FIT: dict[str, Schema] = {
    "largest_px": NOT_NEGATIVE,
    "rms_px": NOT_NEGATIVE,
    "largest_rad": NOT_NEGATIVE,
    "lost": said(SHARE, "of the image that it does not hold"),
}
_RATE = mapping({"count": COUNT, "of": COUNT, "share": _OR_NULL, "interval_95": vector(2, _OR_NULL)})
_OF_ARM = mapping(dict.fromkeys(("success", "collision", "joint_limit"), _RATE))
_COUNTS: Schema = {"type": "object", "additionalProperties": COUNT}
_METHOD = mapping(
    {
        "method": TEXT,
        **dict.fromkeys(RATES, _RATE),
        "arms": {"type": "object", "additionalProperties": _OF_ARM},
        **dict.fromkeys(("statuses", "stops"), _COUNTS),
        **dict.fromkeys(MEDIANS, _OR_NULL),
        "median_intervals_95": mapping(dict.fromkeys(MEDIANS, vector(2, _OR_NULL))),
    }
)
_ROWS = several(COUNT)
_STREAM = mapping(dict.fromkeys(("rate", "age_median", "age_p99", "jitter"), _OR_NULL))
_CLOCK = nullable(mapping(dict.fromkeys(("offset", "drift", "spread", "later"), NUMBER)))
_METRIC = either(NUMBER, TEXT, {"type": "null"}, {"type": "array"})


def output_schema(full: str) -> Schema:
    """Return the schema of the output that has this format."""
    name = full.removeprefix("omniservo.").removesuffix("-output/1")
    if name == "camera-show":
        return {"oneOf": [_shown(full, model) for model in camera_schema()["oneOf"]]}
    required, optional = _FIELDS[name]
    return of_format(full, required, optional)


def _shown(full: str, model: Schema) -> Schema:
    """Return the schema of a camera's fields with what was computed of it."""
    fields = {"format": {"const": full}, **model["properties"], **_SHOWN, "polygon_shortfall": SHARE}
    return {**model, "properties": fields, "required": ["format", *model["required"], *_SHOWN]}


def _of_row() -> dict[str, Schema]:
    fields: dict[str, Any] = TypeAdapter(StudyRow).json_schema()["properties"]
    return {name: {k: v for k, v in field.items() if k != "title"} for name, field in fields.items()}


def _metrics() -> dict[str, Schema]:
    return {name: said(_METRIC, words) for name, words in metrics_in_words().items()}


_METRICS = _metrics()
_SURE = ("task", "method", "status", "reason", "contacts", "frames", "plan_status", "whole_seconds")
_RUN: dict[str, Schema] = {
    **{name: _METRICS[name] for name in _SURE},
    "seed": COUNT,
    "status": choice("converged", "contact", "stopped"),
}
_MORE = {name: metric for name, metric in _METRICS.items() if name not in _RUN}

_CAMERA_CHECK: dict[str, Schema] = {
    "moved": said(nullable(FLAG), "null: it cannot be decided"),
    "rotation_rad": nullable(NOT_NEGATIVE),
    "direction": said(nullable(POINT), "axis of the rotation, of length 1"),
    "sigma": said(nullable(NOT_NEGATIVE), "of the rotation's angle [rad]"),
    "rotation_vector": said(nullable(POINT), "[rad]"),
    "translation_over_distance": nullable(POINT),
    "covariance": nullable(matrix(6, 6)),
    "displacement_px": nullable(NOT_NEGATIVE),
    "probability": said(nullable(SHARE), "of such a difference without a motion"),
    "false_alarm_rate": SHARE,
    "features": COUNT,
    "found_again": COUNT,
    "reason": TEXT,
}
_CALIBRATION: dict[str, Schema] = {
    "status": TEXT,
    "camera": camera_schema(),
    "rms_px": NOT_NEGATIVE,
    "held_out": nullable(mapping({"px": NOT_NEGATIVE, "deg": NOT_NEGATIVE})),
    "deviation_px": _OR_NULL,
    "largest_angle": said(NOT_NEGATIVE, "from the axis, of a corner [rad]"),
    "image_fraction": SHARE,
    "parameters": several(TEXT),
    "covariance": several(several(NUMBER)),
    "identifiable": {"type": "object", "additionalProperties": FLAG},
    "used": several(TEXT),
    "not_used": said({"type": "object", "additionalProperties": TEXT}, "image: reason"),
    "seconds": nullable(NOT_NEGATIVE),
}
_JOINT = mapping(
    {
        "name": TEXT,
        "type": TEXT,
        **dict.fromkeys(("lower", "upper"), said(NUMBER, "[rad]")),
        **dict.fromkeys(("speed", "acceleration"), said(NOT_NEGATIVE, "[rad/s], [rad/s²]")),
        "effort": said(_OR_NULL, "[N m]"),
    }
)
_SHAPE = mapping({"kind": TEXT, "extents": said(vector(3), "[m]")})
_ROBOT: dict[str, Schema] = {
    "name": TEXT,
    "joints": several(_JOINT),
    "reach": said(NOT_NEGATIVE, "[m]"),
    "flange": mapping({"name": TEXT, "link": TEXT, "link_T_flange": _POSE}),
    "flange_T_camera": said(_POSE, "a mount to try"),
    "posture": said(several(NUMBER), "a start configuration to try [rad]"),
    "table": nullable(mapping({"center": POINT, "half_extents": POINT, "frame": TEXT})),
    "closed_form": said(FLAG, "whether all inverse solutions are known in closed form"),
    "links": several(mapping({"name": TEXT, "joint": nullable(TEXT), "shapes": several(_SHAPE)})),
    "notices": several(TEXT),
}
_CHECKED: dict[str, Schema] = {
    "joints": _STREAM,
    "images": nullable(_STREAM),
    "arm_clock": _CLOCK,
    "camera_clock": _CLOCK,
    "answers": several(mapping({"joint": TEXT, "sent": NUMBER, "turned": NUMBER})),
    "self_clearance": said(_OR_NULL, "[m]"),
    "stop_seconds": _OR_NULL,
    "findings": said(several(TEXT), "what must be mended before the arm is moved"),
    "fit": FLAG,
    "notice": nullable(TEXT),
}
_RENDERED: dict[str, Schema] = {
    "out": _OUT,
    "frames": COUNT,
    "size": said(vector(2, COUNT), "width, height [px]"),
    "valid": said(SHARE, "of the image that the lens sees"),
    "nearest_m": nullable(NOT_NEGATIVE),
    "geoms": several(mapping({"geom": COUNT, "name": nullable(TEXT), "body": TEXT})),
}
_JUDGED = mapping(
    {
        "name": TEXT,
        "margin": said(NUMBER, "as the plan states it, in unit"),
        "unit": TEXT,
        "verdict": choice("holds", "violated", "undecided"),
        "w": said(_OR_NULL, "where it does not hold"),
    }
)
_REPLAYED: dict[str, Schema] = {
    "status": choice("equal", "differs"),
    "task": TEXT,
    "version": TEXT,
    "steps": COUNT,
    "largest_difference": _OR_NULL,
    "differences": several(TEXT),
    "images_missing": COUNT,
    "steps_left": COUNT,
    "cut": FLAG,
    "ended": nullable(TEXT),
}
_STUDY: dict[str, Schema] = {
    "study": TEXT,
    "version": TEXT,
    "rows": COUNT,
    "methods": several(_METHOD),
    "cpu_seconds_per_row": {"type": "object", "additionalProperties": _OR_NULL},
}
_FINISHED = {"status": choice("done"), "study_hash": TEXT, "out": _OUT, **_STUDY}
_SHOWN: dict[str, Schema] = {
    "usable_angle": said(NOT_NEGATIVE, "from the axis [rad]"),
    "past_right_angle": said(SHARE, "of the image, more than 90° from the axis"),
    "warnings": several(TEXT),
    "unified": said(nullable(mapping({"camera": camera_schema(), **_FIT})), "what planning uses"),
    "limits": nullable(several(TEXT)),
}
_CONVERTED: dict[str, Schema] = {"out": _OUT, "to": TEXT, "model": TEXT, **_FIT, "deviation_px": NOT_NEGATIVE}
_MASKED: dict[str, Schema] = {
    "mask_polygons": COUNT,
    "mask_lost_pixels": COUNT,
    "mask_overhang_px": NOT_NEGATIVE,
}
_DELAYED: dict[str, Schema] = {
    **dict.fromkeys(("camera_offset_s", "camera_offset_sigma_s", "actuation_lag_s", "image_age_s"), NUMBER),
    **dict.fromkeys(("actuation_lag_sigma_s", "residual_px"), _OR_NULL),
    "images": COUNT,
}
_CHANGED: dict[str, Schema] = {
    **dict.fromkeys(("before", "after"), _RATE),
    "difference": _OR_NULL,
    "interval_95": vector(2, _OR_NULL),
    "differs": FLAG,
}
_COMPARED = mapping(
    {
        "method": TEXT,
        **_CHANGED,
        "rates": mapping({name: mapping(_CHANGED) for name in RATES if name != "success"}),
        "medians": mapping(dict.fromkeys(MEDIANS, vector(2, _OR_NULL))),
        **dict.fromkeys(("lost", "won"), _ROWS),
    }
)
_MACHINE = mapping(
    {
        **dict.fromkeys(("name", "found", "next_step"), TEXT),
        "verdict": choice("ok", "note", "wrong"),
        "values": {"type": "object"},
    }
)
_LISTED = mapping(dict.fromkeys(("name", "format", "summary"), TEXT))
_DIFFERENCE = mapping({"field": TEXT, "plan": {}, "problem": {}})

_FIELDS: dict[str, tuple[dict[str, Schema], dict[str, Schema]]] = {
    "run": (
        _RUN,
        {**_MORE, "out": _OUT, "methods": said({"type": "object"}, "the metrics of each, by name")},
    ),
    "run-replay": (_REPLAYED, {}),
    "run-replay-row": ({**_of_row(), "figure": _OUT, "out": _OUT}, {}),
    "export": ({"out": _OUT, "repeated": FLAG, "bytes": COUNT}, {}),
    "verify": (
        {
            "status": choice("certified", "refuted", "undecided"),
            "constraints": several(_JUDGED),
            "reasons": several(TEXT),
            "differences": said(nullable(several(_DIFFERENCE)), "null: no --problem was given"),
        },
        {},
    ),
    "teach": (
        {"out": _OUT, "features": said(matrix(None, 2), "[px]"), "joints": said(several(NUMBER), "[rad]")},
        {},
    ),
    "view": ({"name": TEXT, "url": TEXT}, {}),
    "examples": ({"tasks": several(mapping({"name": TEXT, "summary": TEXT}))}, {}),
    "render": (_RENDERED, {}),
    "schema": ({"formats": several(_LISTED)}, {}),
    "warm-up": ({"compiled": COUNT, "seconds": NOT_NEGATIVE, "already": FLAG}, {}),
    "doctor": ({"well": FLAG, "checks": several(_MACHINE)}, {}),
    "camera-convert": (_CONVERTED, {**_MASKED, "calibration_covariance": FLAG}),
    "camera-calibrate": (_CALIBRATION, {}),
    "camera-rectify": ({"out": _OUT, "view": TEXT, "size": vector(2, COUNT), "seen": SHARE}, {}),
    "camera-check": (_CAMERA_CHECK, {}),
    "robot-show": (_ROBOT, {}),
    "robot-expand": ({"written": _OUT}, {}),
    "robot-measure-tube": ({"arm": TEXT, "runs": COUNT, "least_share": NUMBER, "written": _OUT}, {}),
    "robot-check": (_CHECKED, {}),
    "robot-delay": (_DELAYED, {}),
    "sim-serve": ({"task": TEXT, "at": TEXT, "where": TEXT, "robot_file": nullable(TEXT)}, {}),
    "study": (_FINISHED, {}),
    "study-share": ({"status": choice("share done"), "out": _OUT, "study_hash": TEXT}, {}),
    "study-compare": ({"methods": several(_COMPARED)}, {}),
}
"""By the output's name: fields that are always there, and others."""
