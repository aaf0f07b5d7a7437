"""Looking again: small certified moves after which more is known, or from whose end there is a plan."""

from omniservo.looks.certified_move import FOLLOWED, CertifiedMove, certified_move
from omniservo.looks.next_look import NextLook, next_look, uncertainty_parts, uncertainty_size
from omniservo.looks.standing import ViewingState
from omniservo.looks.what_is_missing import what_is_missing
from omniservo.renamed import renamed

__all__ = [
    "FOLLOWED",
    "CertifiedMove",
    "NextLook",
    "ViewingState",
    "certified_move",
    "next_look",
    "uncertainty_parts",
    "uncertainty_size",
    "what_is_missing",
]

__getattr__ = renamed(__name__, {"Standing": "ViewingState"})
