"""The parts that JSON schemas (draft 2020-12) of our files are made of."""

from __future__ import annotations

from typing import Any

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
NOT_NEGATIVE: Schema = {"type": "number", "minimum": 0}
POSITIVE: Schema = {"type": "number", "exclusiveMinimum": 0}
SHARE: Schema = {"type": "number", "minimum": 0, "maximum": 1}
COUNT: Schema = {"type": "integer", "minimum": 0}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
NULL: Schema = {"type": "null"}


def said(schema: Schema, words: str) -> Schema:
    """Return the schema with what it describes in words."""
    return {**schema, "description": words}


def vector(count: int, item: Schema = NUMBER) -> Schema:
    """Return the schema of a list of exactly so many items."""
    return {"type": "array", "items": item, "minItems": count, "maxItems": count}


def several(item: Schema, least: int = 0, most: int | None = None) -> Schema:
    """Return the schema of a list of any length between these."""
    return {
        "type": "array",
        "items": item,
        **({"minItems": least} if least else {}),
        **({} if most is None else {"maxItems": most}),
    }


def matrix(rows: int | None, columns: int, item: Schema = NUMBER) -> Schema:
    """Return the schema of a list of rows; None: of any number of them."""
    row = vector(columns, item)
    return several(row) if rows is None else vector(rows, row)


def choice(*legal: object) -> Schema:
    """Return the schema of one of these values."""
    return {"enum": list(legal)}


def either(*kinds: Schema) -> Schema:
    """Return the schema of what one of these describes, or several."""
    return {"anyOf": list(kinds)}


def nullable(schema: Schema) -> Schema:
    """Return the schema of this, or null."""
    return either(schema, NULL)


def mapping(required: dict[str, Schema], optional: dict[str, Schema] | None = None) -> Schema:
    """Return the schema of an object with these fields and no other."""
    return {
        "type": "object",
        "properties": {**required, **(optional or {})},
        "required": list(required),
        "additionalProperties": False,
    }


def of_format(name: str, required: dict[str, Schema], optional: dict[str, Schema] | None = None) -> Schema:
    """Return the schema of a file whose first field says its format."""
    return mapping({"format": {"const": name}, **required}, optional)


POINT = vector(3)
QUATERNION = said(vector(4), "(x, y, z, w), of length 1 within 1e-6")
ROTATION_VECTOR = said(vector(3), "axis times angle [rad]")
TURNED = {"quaternion": QUATERNION, "rotation_vector": ROTATION_VECTOR}
"""Fields that say how a thing is turned, at most one of them."""

POSE = mapping({"translation": said(POINT, "[m]"), "quaternion": QUATERNION})


def turned_once(schema: Schema) -> Schema:
    """Return the schema of what may not have both of `TURNED`."""
    return {**schema, "not": {"required": list(TURNED)}}
