"""What a command prints with --json is what `omniservo schema` says of it."""

import json
from functools import cache

import jsonschema

from omniservo.schemas import json_schema


def check_output(printed):
    """Return the object that a command printed; it fails where no schema describes it."""
    found = json.loads(printed)
    if "$schema" in found:
        jsonschema.Draft202012Validator.check_schema(found)
    else:
        _validator(found["format"]).validate(found)
    return found


@cache
def _validator(name):
    return jsonschema.Draft202012Validator(json_schema(name))
