"""Robot poses in files: our own format, tables (CSV), and ViSP's."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.calibration.hand_eye.robot_poses import ROUNDED, pose_from_matrix
from omniservo.errors import InputError, did_you_mean, spelled, spelled_name
from omniservo.field_docs import with_field_docs
from omniservo.files import parse_document, read_text, stated_units
from omniservo.geometry.arrays import FloatArray, finite_array
from omniservo.renamed import renamed_attribute
from omniservo.short_repr import short_repr

FORMAT = "omniservo.robot_poses/1"

_MAX_BYTES = 2**20
_VISP_LISTS = ("fPe", "rPe")
_PLACE, _QUATERNION, _VECTOR = ("x", "y", "z"), ("qx", "qy", "qz", "qw"), ("rx", "ry", "rz")
_TUM_PLACE = dict(zip(("tx", "ty", "tz"), _PLACE, strict=True))
_UNUSED = ("", "timestamp", "time", "stamp")
"""columns of a table that say nothing of a pose"""
_FARTHEST = 30.0
"""[m] of a flange from its base, which may be a hall's corner"""
_MOST_TURN = 3.0 * math.pi
"""[rad] by a rotation vector; controllers report at most π"""
_STATE_UNITS = "state units: {length: mm, angle: deg} in a file of format omniservo.robot_poses/1"
_ROTATIONS = ("quaternion", "rotation_vector", "matrix")


@with_field_docs
@dataclass(frozen=True, eq=False)
class RobotPoses:
    """base_T_flange of n views, and what says which image belongs to each."""

    source: str
    """the file, for messages"""
    base_T_flange: tuple[RigidTransform, ...]
    images: tuple[str, ...] | None = None
    """names of the image files; None: in the order of the images"""
    numbers: tuple[int, ...] | None = None
    """last number in the names of the image files, as ViSP numbers its files; None: as above"""

    __repr__ = short_repr
    base_T_tool = renamed_attribute("base_T_tool", "base_T_flange")

    def of_images(self, images: Sequence[Path]) -> tuple[RigidTransform, ...]:
        """Return the pose of each image: by name or number, else by order. Other poses are left out.

        Raises:
            InputError: an image without a pose; without names, another number of images than poses.
        """
        if self.images is None and self.numbers is None:
            if len(images) != len(self.base_T_flange):
                raise InputError(
                    f"{self.source}: {len(self.base_T_flange)} poses given for {len(images)} images;"
                    " one each is needed"
                )
            self._refuse_order_of_letters(images)
            return self.base_T_flange
        keys: dict[str | int, RigidTransform] = dict(
            zip(self.images or self.numbers or (), self.base_T_flange, strict=True)
        )
        found = []
        for image in images:
            key = image.name if self.images is not None else _last_number(image)
            if key not in keys:
                known = ", ".join(str(k) for k in list(keys)[:4])
                raise InputError(
                    f"{self.source}: no pose for {image} ({spelled(key)}); there are poses for {known}, …"
                )
            found.append(keys[key])
        return tuple(found)

    def _refuse_order_of_letters(self, images: Sequence[Path]) -> None:
        """Raise where images come as a shell sorts their names (1, 10, 2), and not by their numbers."""
        names = [image.name for image in images]
        by_number = sorted(names, key=lambda name: [int(part) for part in re.findall(r"\d{1,18}", name)])
        alike = len({re.sub(r"\d+", "", name) for name in names}) == 1
        if alike and names == sorted(names) and names != by_number:
            raise InputError(
                f"{self.source}: the poses name no images, and these are sorted by letters: "
                f"{', '.join(names[:3])}, …; give them in the order of the poses (ls -v sorts by number), "
                "or name each pose's image in a column, or field, image"
            )


def load_robot_poses(path: str | Path) -> RobotPoses:
    """Read base_T_flange of several views; see docs/hand-eye.md.

    Our own format is YAML or JSON; a name that ends in .csv, or a first line of numbers or columns' names, is
    a table in metres and radians.
    ViSP's are one YAML file a pose (tx, ty, tz and θu), ``path`` then holding ``%d`` in place of the number,
    and JSON with a list ``fPe`` or ``rPe`` of {R, t}.

    Raises:
        InputError: unreadable, another format, or a field that is missing or not legal.
    """
    if "%d" in Path(path).name:
        return _numbered(Path(path))
    source = str(path)
    text = read_text(path, max_bytes=_MAX_BYTES)
    if Path(path).suffix.lower() == ".csv" or _is_row(text):
        return _table(text, source)
    fields = parse_document(text, source)
    if not isinstance(fields, dict):
        raise InputError(
            f"{source}: {spelled(fields)} found; a mapping with format and base_T_flange is needed,"
            " or a table with a header: docs/hand-eye.md"
        )
    for name in _VISP_LISTS:
        if "format" not in fields and isinstance(fields.get(name), list):
            poses = [_R_and_t(value, f"{source}: {name}[{i}]") for i, value in enumerate(fields[name])]
            return RobotPoses(source, tuple(poses))
    if fields.get("format") != FORMAT:
        raise InputError(
            f"{source}: format: {spelled(fields.get('format'))} given; legal: {FORMAT!r};"
            " how poses of other programs are written in it: docs/hand-eye.md"
        )
    return _own(fields, source)


def _own(fields: dict[str, Any], source: str) -> RobotPoses:
    name = "base_T_flange" if "base_T_tool" not in fields else "base_T_tool"  # as it was called before
    _only(fields, ("format", "units", name), source)
    units = stated_units(fields.get("units", {}), source)
    entries = fields.get(name)
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{source}: {name}: {spelled(entries)} given; a list of poses is needed")
    return _listed(entries, [f"{source}: {name}[{i}]" for i in range(len(entries))], units, source)


def _only(fields: dict[str, Any], legal: tuple[str, ...], where: str) -> None:
    for name in fields:
        if name not in legal:
            raise InputError(
                f"{where}: {spelled_name(name)}: no such field; legal: {', '.join(legal)}"
                f"{did_you_mean(name, legal)}"
            )


def _listed(entries: list[Any], places: list[str], units: dict[str, float], source: str) -> RobotPoses:
    """The poses of entries that stand at these places of the file."""
    poses = tuple(_entry(value, place, units) for value, place in zip(entries, places, strict=True))
    named = ["image" in value for value in entries]
    if not any(named):
        return RobotPoses(source, poses)
    if not all(named):
        raise InputError(f"{places[named.index(False)]}: image: missing; others have one")
    images = tuple(value["image"] for value in entries)
    for i, image in enumerate(images):
        if not isinstance(image, str) or not image or image in images[:i]:
            problem = "given twice" if image and image in images[:i] else "a file's name is needed"
            raise InputError(f"{places[i]}: image: {spelled(image)}: {problem}")
    return RobotPoses(source, poses, images=images)


def _is_row(text: str) -> bool:
    """Return whether a text begins as a table: with six numbers and more, or with the names of columns."""
    first = next((line for line in _from_header(text) if line.strip()), "")
    cells = _columns(re.split(r"[,\s]+", first.lstrip("# ").strip()))
    return set(_PLACE) <= set(cells) or (len(cells) >= 6 and all(_is_number(cell) for cell in cells if cell))


def _from_header(text: str) -> list[str]:
    """Return a table's lines from its header on: of comments that begin with # the last one may be it."""
    lines = text.splitlines()
    while len(lines) > 1 and lines[0].startswith("#") and lines[1].startswith("#"):
        lines = lines[1:]
    return lines


def _columns(names: Sequence[str]) -> list[str]:
    """Return columns' names as ours: of TUM's "# timestamp tx ty tz qx qy qz qw" the places are x, y, z."""
    plain = [name.strip(" #\t").lower() for name in names]
    return [_TUM_PLACE.get(name, name) for name in plain]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _table(text: str, source: str) -> RobotPoses:
    """A header, then a line a pose: x, y, z [m]; qx, qy, qz, qw or rx, ry, rz [rad]; image, if there.

    Commas stand between, or blanks where the header has none. A time is not used.
    """
    lines = _from_header(text)
    before = len(text.splitlines()) - len(lines)
    if lines and "," not in lines[0]:
        lines = [",".join(line.lstrip("# ").split()) for line in lines]
    reader = csv.reader(lines)
    header = _columns(next(reader, []))
    columns = set(header) - {"image", *_UNUSED}
    rotation = next((names for names in (_QUATERNION, _VECTOR) if columns == {*_PLACE, *names}), None)
    if header and all(_is_number(cell) for cell in header):
        raise InputError(
            f"{source}: line 1: numbers without a header; write above them what they are: "
            "x,y,z,qx,qy,qz,qw or x,y,z,rx,ry,rz (a rotation vector, not roll, pitch and yaw) [m, rad], after"
            " timestamp if the first of them is one"
        )
    if rotation is None or len(set(header)) < len(header):
        raise InputError(
            f"{source}: line 1: {spelled(','.join(header))} given; legal: a header of x,y,z with "
            "qx,qy,qz,qw or rx,ry,rz [m, rad], and image if the lines name theirs; timestamp is not used"
        )
    name = "quaternion" if rotation is _QUATERNION else "rotation_vector"
    entries: list[Any] = []
    places: list[str] = []
    for row in reader:
        if not row:
            continue
        place = f"{source}: line {before + reader.line_num}"
        if len(row) != len(header):
            raise InputError(f"{place}: {len(row)} entries; the header has {len(header)}")
        cells = dict(zip(header, (cell.strip() for cell in row), strict=True))
        entry: dict[str, Any] = {"image": cells["image"]} if "image" in cells else {}
        for field, columns_of_it in (("translation", _PLACE), (name, rotation)):
            try:
                entry[field] = [float(cells[column]) for column in columns_of_it]
            except ValueError:
                given = ",".join(cells[column] for column in columns_of_it)
                raise InputError(f"{place}: {field}: {spelled(given)} given; legal: numbers") from None
        entries.append(entry)
        places.append(place)
    if not entries:
        raise InputError(f"{source}: no poses below the header")
    return _listed(entries, places, {"length": 1.0, "angle": 1.0}, source)


def _entry(value: Any, where: str, units: dict[str, float]) -> RigidTransform:
    if not isinstance(value, dict):
        raise InputError(
            f"{where}: {spelled(value)} given; a mapping with translation and quaternion is needed"
        )
    given = [name for name in _ROTATIONS if name in value]
    _only(value, ("image", "translation", *_ROTATIONS), where)
    if len(given) != 1 or ("translation" in value) == (given == ["matrix"]):
        raise InputError(
            f"{where}: needed: translation with quaternion or rotation_vector, or matrix (4 × 4) alone"
        )
    if given == ["matrix"]:
        matrix = np.array(finite_array(f"{where}: matrix", value["matrix"], (4, 4)))
        matrix[:3, 3] *= units["length"]
        _near(matrix[:3, 3], f"{where}: matrix")
        return pose_from_matrix(f"{where}: matrix", matrix)
    translation = units["length"] * finite_array(f"{where}: translation", value["translation"], (3,))
    _near(translation, f"{where}: translation")
    if given == ["rotation_vector"]:
        vector = units["angle"] * finite_array(f"{where}: rotation_vector", value["rotation_vector"], (3,))
        if math.hypot(*vector) > _MOST_TURN:
            raise InputError(
                f"{where}: rotation_vector: a turn by {math.hypot(*vector):.4g} rad given; legal: at most"
                f" {_MOST_TURN:.4g} rad; if it is in degrees, {_STATE_UNITS}"
            )
        return RigidTransform.from_components(translation, Rotation.from_rotvec(vector))
    quaternion = finite_array(f"{where}: quaternion", value["quaternion"], (4,))
    if abs(math.hypot(*quaternion) - 1.0) > ROUNDED:
        raise InputError(
            f"{where}: quaternion: norm {math.hypot(*quaternion):.4g} given; legal: 1 within {ROUNDED:g}"
        )
    return RigidTransform.from_components(translation, Rotation.from_quat(quaternion))


def _near(translation: FloatArray, where: str) -> None:
    """Refuse a flange that is farther from its base than any arm reaches: its unit is another one."""
    far = math.hypot(*translation)
    if far > _FARTHEST:
        raise InputError(
            f"{where}: {far:.4g} m from the base given; legal: at most {_FARTHEST:g} m; if it is in"
            f" millimetres, {_STATE_UNITS}"
        )


def _R_and_t(value: Any, where: str) -> RigidTransform:
    """The pose of {R: 3 × 3, t: 3}."""
    if not isinstance(value, dict) or not {"R", "t"} <= set(value):
        raise InputError(f"{where}: {spelled(value)} given; a mapping with R and t is needed")
    matrix = np.eye(4)
    matrix[:3, :3] = finite_array(f"{where}: R", value["R"], (3, 3))
    matrix[:3, 3] = finite_array(f"{where}: t", value["t"], (3,))
    return pose_from_matrix(f"{where}: R", matrix)


def _numbered(pattern: Path) -> RobotPoses:
    """ViSP's vpPoseVector files: {rows: 6, cols: 1, data: [[tx], [ty], [tz], [θux], [θuy], [θuz]]}."""
    head, tail = pattern.name.split("%d", 1)
    name = re.compile(re.escape(head) + r"(\d{1,9})" + re.escape(tail))
    if not pattern.parent.is_dir():
        raise InputError(f"{pattern}: its folder does not exist")
    files = {int(found[1]): file for file in pattern.parent.iterdir() if (found := name.fullmatch(file.name))}
    if not files:
        raise InputError(f"{pattern}: no file of this name, with a number in place of %d")
    numbers = tuple(sorted(files))
    return RobotPoses(str(pattern), tuple(_pose_vector(files[n]) for n in numbers), numbers=numbers)


def _pose_vector(file: Path) -> RigidTransform:
    fields = parse_document(read_text(file, max_bytes=_MAX_BYTES), str(file))
    if not isinstance(fields, dict) or "data" not in fields:
        raise InputError(f"{file}: data: missing; a ViSP pose vector has rows, cols and data")
    data = finite_array(f"{file}: data", fields["data"], (6, 1))[:, 0]
    return RigidTransform.from_components(data[:3], Rotation.from_rotvec(data[3:]))


def _last_number(image: Path) -> int:
    numbers = re.findall(r"\d+", image.stem)
    return int(numbers[-1][-9:]) if numbers else -1
