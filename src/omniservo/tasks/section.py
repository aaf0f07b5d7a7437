"""What every part of a task file has in common."""

from pydantic import BaseModel, ConfigDict


class Section(BaseModel):
    """Unknown fields are errors, and nothing changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)
