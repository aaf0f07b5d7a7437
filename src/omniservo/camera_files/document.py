"""A calibration file's text as fields, whatever it is written in, with the line of each field."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

import yaml

from omniservo.camera_files.xml_document import number_or_word, parse_xml
from omniservo.errors import InputError
from omniservo.files import parse_document

FieldPath = tuple[str | int, ...]
"""Names of fields and places in lists, from the outermost inwards."""

LENS = "omniservo_lens"
"""where our largest angle, dead zone and mask stand in a foreign file, whose own readers ignore the field"""

STREAMS = "streams of a RealSense camera"
"""the field under which what ``rs-enumerate-devices -c`` prints is kept"""

_LONGEST_SEARCHED = 2**18
"""characters; in a longer file the line of a field is not looked for, which would take seconds"""

OST = "cameras of camera_calibration"
"""the field under which the cameras of ROS's ``ost.txt`` are kept"""

MRCAL = "camera model of mrcal"
"""the field under which what a ``.cameramodel`` of mrcal says of its lens is kept"""

_STREAM = re.compile(r'^ *Intrinsic of "([^"\n]+)" +(?:/ *)?(\d+x\d+)', flags=re.MULTILINE)

_OST = re.compile(r"^\[image\]\s+width\s", flags=re.MULTILINE)

_LENSMODEL = re.compile(r"^[ \t{]*'lens_?model'[ \t]*:", flags=re.MULTILINE)

_OF_LENS = re.compile(
    r"^[ \t{]*'(lens_?model|intrinsics|imagersize)'\s*:\s*('[^']*'|\[[^\]]*\])", flags=re.MULTILINE
)

_TABLE_ROW = re.compile(r"[-+.\d][^:{}\[\],]*")


def parse_fields(text: str, source: str) -> tuple[Mapping[str, Any], Callable[[FieldPath], int]]:
    """Return the fields of XML, of a table of numbers, of JSON or of YAML, also as OpenCV writes them.

    What ``rs-enumerate-devices -c`` prints is ``{STREAMS: {"Color-640x480": {"Width": …}}}``, and what ROS's
    camera_calibration saves as ost.txt ``{OST: {"narrow_stereo": {"width": […], "camera matrix": […], …}}}``.
    Of a dictionary that mrcal writes, which is Python, three fields are found, and nothing is evaluated.

    A table's rows are ``{"rows": [[…], …]}``: what stands between blanks. Of its comments one is read,
    ``# omniservo_lens: {…}`` in JSON, as a field.

    Returns:
        the fields, and a function that gives the line of a field, 0 where it is not found.

    Raises:
        InputError: none of these, or no mapping of fields.
    """
    if text.lstrip().startswith("<"):
        fields, lines = parse_xml(text, source)
        return fields, lambda path: lines.get(path, 0)
    if _STREAM.search(text):
        return {STREAMS: _streams(text)}, lambda _: 0
    if _OST.search(text):
        return {OST: _ost_cameras(text)}, lambda _: 0
    if _LENSMODEL.search(text):
        return {MRCAL: _mrcal_lens(text)}, lambda _: 0
    rows = _rows(text)
    if rows is not None:
        numbers = [number for number, _ in rows]
        table: dict[str, Any] = {"rows": [row for _, row in rows]}
        lens = re.search(rf"^# {LENS}: (\{{.*\}})\s*$", text, flags=re.MULTILINE)
        if lens is not None:
            table[LENS] = parse_document(lens[1], source)
        return table, lambda path: _line_of_row(numbers, path)
    plain = re.sub(r"^%YAML.*$", "", text, count=1, flags=re.MULTILINE)
    plain = re.sub(r"!!opencv-(nd-)?matrix", "", plain)
    plain = re.sub(r"\n---\s*\Z", "\n", plain)
    fields = parse_document(plain, source)
    if not isinstance(fields, Mapping):
        raise InputError(
            f"{source}: {type(fields).__name__} found; a calibration is a mapping of fields, of a format that"
            " docs/camera.md lists"
        )
    return fields, lambda path: _line_in_yaml(plain, path)


def _streams(text: str) -> dict[str, Any]:
    """Return the fields of each stream in each resolution, by the name of both; a list of those that differ.

    Such are printed of several cameras, and of formats of which one is rectified and another is not.
    """
    starts = [*_STREAM.finditer(text)]
    streams: dict[str, Any] = {}
    for start, end in zip(starts, [*(found.start() for found in starts[1:]), len(text)], strict=True):
        fields: dict[str, Any] = {}
        for line in text[start.end() : end].splitlines()[1:]:
            name, colon, said = line.strip().partition(":")
            if not colon:
                break
            words = [number_or_word(word) for word in said.split()]
            worded = len(words) == 0 or any(isinstance(word, str) for word in words)
            fields[name] = said.strip() if worded else words if name == "Coeffs" else words[0]
        name = "-".join(start.groups())
        known = streams.setdefault(name, fields)
        if known != fields:
            streams[name] = [known, fields]
    return streams


def _ost_cameras(text: str) -> dict[str, dict[str, list[Any]]]:
    """Return the values of each camera by its name: a section [image], then one that has its name."""
    cameras: dict[str, dict[str, list[Any]]] = {}
    image: dict[str, list[Any]] = {}
    fields: dict[str, list[Any]] = image
    values: list[Any] = []
    for line in (line.strip() for line in text.splitlines()):
        if line.startswith("[") and line.endswith("]"):
            image = {} if line == "[image]" else image
            fields = image if line == "[image]" else cameras.setdefault(line[1:-1], dict(image))
        elif _TABLE_ROW.fullmatch(line):
            values.extend(number_or_word(word) for word in line.split())
        elif line:
            values = fields.setdefault(line, [])
    return cameras


def _mrcal_lens(text: str) -> dict[str, Any]:
    """Return the three fields; older files have lens_model for lensmodel."""
    fields: dict[str, Any] = {}
    for name, said in _OF_LENS.findall(text):
        words = said[1:-1].replace(",", " ").split()
        values = [number_or_word(word) for word in words] if said.startswith("[") else said[1:-1]
        fields[name.replace("_", "")] = values
    return fields


def _rows(text: str) -> list[tuple[int, list[Any]]] | None:
    """Return line numbers and values of a text whose every line begins with a number, or None."""
    rows = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#")[0].strip()
        if not words:
            continue
        if not _TABLE_ROW.fullmatch(words):
            return None
        rows.append((number, [number_or_word(word) for word in words.split()]))
    return rows or None


def _line_of_row(numbers: list[int], path: FieldPath) -> int:
    return numbers[path[1]] if len(path) > 1 and isinstance(path[1], int) and path[1] < len(numbers) else 0


def _line_in_yaml(text: str, path: FieldPath) -> int:
    """Return the line on which a field's name stands; JSON reads as YAML. The text was read before."""
    if len(text) > _LONGEST_SEARCHED:
        return 0
    try:
        node: Any = yaml.compose(text, Loader=yaml.SafeLoader)
    except (yaml.YAMLError, RecursionError):
        return 0
    line = 0
    for step in path:
        if isinstance(node, yaml.MappingNode):
            found = next(((key, value) for key, value in node.value if key.value == str(step)), None)
            if found is None:
                return line
            line, node = found[0].start_mark.line + 1, found[1]
        elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
            node = node.value[step]
            line = node.start_mark.line + 1
        else:
            return line
    return line
