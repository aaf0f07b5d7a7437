"""The taught goal: what a person shows once, kept in one file."""

from __future__ import annotations

import base64
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from pydantic import ValidationError

from omniservo.cameras.models import CentralModel, camera_from_dict
from omniservo.errors import InputError, did_you_mean, spelled_name
from omniservo.files import read_document, write_whole
from omniservo.geometry.arrays import ByteArray, FloatArray, finite_array, owned
from omniservo.short_repr import short_repr
from omniservo.tasks.load_task import first_problem
from omniservo.tasks.section import Section
from omniservo.tasks.target import TargetSection

FORMAT = "omniservo.goal/2"
"""The file format that this version writes; it also reads /1, which calls the features dots."""

_FIRST_FORMAT = "omniservo.goal/1"
_FIELDS = ("format", "camera", "image_png", "features", "joints")
_LEGAL = (*_FIELDS, "target")
_MAX_PIXELS = 64_000_000


@dataclass(frozen=True)
class TaughtGoal:
    """The goal image with the camera that took it, its features and, where known, the arm's joints."""

    camera: CentralModel
    image: ByteArray
    """(height, width) grey values"""
    features: FloatArray
    """(n, 2) [px] what was found in the image"""
    joints: FloatArray | None
    """(n,) [rad], None where the arm's pose was not recorded"""
    target: TargetSection | None = None
    """what it was taught of, wherever that stands; None in files that do not say it"""

    __repr__ = short_repr

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the goal as one JSON file (image as PNG inside).

        Raises:
            InputError: the file exists and ``force`` is False.
        """
        write_whole(path, json.dumps(self.to_dict()), force=force)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of the file."""
        buffer = io.BytesIO()
        Image.fromarray(self.image).save(buffer, format="PNG")
        return {
            "format": FORMAT,
            "camera": self.camera.to_dict(),
            "features": self.features.tolist(),
            "joints": None if self.joints is None else self.joints.tolist(),
            "target": None
            if self.target is None
            else self.target.model_dump(mode="json", exclude_defaults=True),
            "image_png": base64.b64encode(buffer.getvalue()).decode("ascii"),
        }

    @classmethod
    def load(cls, path: str | Path) -> TaughtGoal:
        """Read what `save` wrote.

        Raises:
            InputError: not such a file; the message names file, field and what is legal.
        """
        return cls.from_dict(read_document(path), str(path))

    @classmethod
    def from_dict(cls, document: Any, path: str = "goal") -> TaughtGoal:
        """Return the goal of the fields of a file, ``path``, which stands first in messages.

        Raises:
            InputError: as `load`.
        """
        if not isinstance(document, dict) or document.get("format") not in (FORMAT, _FIRST_FORMAT):
            raise InputError(f"{path}: format: not a taught goal; legal: {FORMAT!r}, {_FIRST_FORMAT!r}")
        if document["format"] == _FIRST_FORMAT and "dots" in document:
            document = {"features" if name == "dots" else name: value for name, value in document.items()}
        for name in document:
            if name not in _LEGAL:
                raise InputError(
                    f"{path}: {spelled_name(name)}: no such field; legal: {', '.join(_LEGAL)}"
                    f"{did_you_mean(name, _LEGAL)}"
                )
        for name in _FIELDS:
            if name not in document:
                raise InputError(f"{path}: {name}: missing; needed: {', '.join(_FIELDS)}")
        camera = camera_from_dict(document["camera"], f"{path}: camera")
        joints = document["joints"]
        return cls(
            camera,
            _image(document["image_png"], camera, path),
            owned(finite_array(f"{path}: features", document["features"], (None, 2))),
            None if joints is None else owned(finite_array(f"{path}: joints", joints, (None,))),
            _target(document.get("target"), path),
        )


class _Taught(Section):
    target: TargetSection | None


def _target(fields: Any, path: str) -> TargetSection | None:
    try:
        return _Taught.model_validate({"target": fields}).target
    except ValidationError as error:
        raise InputError(first_problem(error, path, _Taught)) from None


def _image(encoded: object, camera: CentralModel, source: str) -> ByteArray:
    try:
        data = base64.b64decode(str(encoded), validate=True)
        with Image.open(io.BytesIO(data), formats=["PNG"]) as picture:
            if picture.size != (camera.width, camera.height) or camera.width * camera.height > _MAX_PIXELS:
                raise InputError(
                    f"{source}: image_png: {picture.size[0]}×{picture.size[1]} px; "
                    f"the camera has {camera.width}×{camera.height}"
                )
            return np.asarray(picture.convert("L"), dtype=np.uint8)
    except InputError:
        raise
    except Exception:  # whatever a broken image makes the decoder raise
        raise InputError(f"{source}: image_png: not a PNG image") from None
