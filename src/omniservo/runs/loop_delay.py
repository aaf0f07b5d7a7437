"""How much later than an image of a real robot its twist acts, as it was measured."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import finite_number


@with_field_docs
@dataclass(frozen=True)
class LoopDelay:
    """Upper bounds of what was measured: three standard deviations are in them."""

    images: float
    """from the middle of an image's exposure until it is there [s]"""
    motions: float
    """from a command until the joints turn as it says [s]"""

    def __post_init__(self) -> None:
        finite_number("images", self.images, minimum=0.0, maximum=1.0)
        finite_number("motions", self.motions, minimum=0.0, maximum=1.0)
        finite_number("images and motions", self.total, maximum=1.0)

    @property
    def total(self) -> float:
        """From the middle of an image's exposure until its twist acts [s], computing apart."""
        return self.images + self.motions

    def to_dict(self) -> dict[str, float]:
        """Return the fields of a document."""
        return {"images": self.images, "motions": self.motions}

    @classmethod
    def from_fields(cls, fields: object, place: str) -> LoopDelay | None:
        """Return it from a document's fields, which need not be trusted; None where there are none.

        Raises:
            InputError: another type, or a number that is not legal; ``place`` names it.
        """
        if fields is None:
            return None
        if not isinstance(fields, dict):
            raise InputError(
                f"{place}: {spelled(fields)} given; legal: {{images: SECONDS, motions: SECONDS}}"
            )
        try:
            return cls(
                finite_number("images", fields.get("images")), finite_number("motions", fields.get("motions"))
            )
        except InputError as error:
            raise InputError(f"{place}: {error}") from None
