"""Fields as JSON and YAML text, with lists on one line as the originals have them."""

from __future__ import annotations

import json
from typing import Any

import yaml


def as_json(fields: dict[str, Any]) -> str:
    """Return fields as JSON."""
    return json.dumps(fields, indent=2) + "\n"


def as_yaml(fields: dict[str, Any], header: str = "") -> str:
    """Return fields as YAML after ``header``."""
    return header + yaml.dump(fields, Dumper=_Dumper, sort_keys=False, width=1000)


class _Dumper(yaml.SafeDumper):
    """Lists on one line; OpenCV's reader refuses the other way that YAML has."""


def _list_on_one_line(dumper: yaml.SafeDumper, values: list[Any]) -> yaml.SequenceNode:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=True)


_Dumper.add_representer(list, _list_on_one_line)
