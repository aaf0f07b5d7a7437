"""JSON schemas of every file format, from the descriptions that the readers themselves use."""

from omniservo.schemas.json_schemas import FORMATS, json_schema, short_name

__all__ = ["FORMATS", "json_schema", "short_name"]
