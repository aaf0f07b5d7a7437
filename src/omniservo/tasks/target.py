"""The target: dots, tags or textured faces, and the boards that carry them."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator
from scipy.spatial.distance import pdist
from scipy.spatial.transform import RigidTransform

from omniservo import targets
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.tag_dictionaries import dictionary_name, dictionary_size
from omniservo.tasks.placed import Block, Framed, Placed
from omniservo.tasks.quantities import A_NUMBER, Direction, Point, PositiveLength
from omniservo.tasks.section import Section

MOST_FACES = 64
"""most tags, and most textured faces, of a target"""

_ALIKE = 1e-3
"""[m] to which distances on targets are alike: what is measured again differs by so much"""


class Dot(Section):
    """One dark dot of the target."""

    center: Point
    """[m]"""
    normal: Direction = (0.0, 0.0, -1.0)
    """out of the dot's face, towards the viewer"""

    def transformed(self, a_T_b: RigidTransform) -> Self:
        """Return the same, stated in frame b, in frame a."""
        center, normal = a_T_b.apply(self.center), a_T_b.rotation.apply(self.normal)
        return self.model_copy(update={"center": tuple(center.tolist()), "normal": tuple(normal.tolist())})


class TagSection(Placed):
    """One printed tag. Its frame: x right and y down in the upright print, z into the face.

    Without a rotation it stands upright and faces the initial camera.
    """

    id: Annotated[int, Field(ge=0), A_NUMBER]
    """number in the dictionary"""
    edge: PositiveLength
    """side of the square whose corners count, as of `targets.Tag` [m]"""


def _known(name: str) -> str:
    try:
        return dictionary_name(name)
    except InputError as error:
        raise ValueError(str(error).removeprefix("dictionary: ")) from None


class TagsSection(Section):
    """Tags of one dictionary, with their white borders."""

    dictionary: Annotated[str, AfterValidator(_known)]
    """its name, as ``tag36h11``, ``4x4_50`` or ``tagStandard41h12``"""
    panels: Annotated[tuple[TagSection, ...], Field(min_length=1, max_length=MOST_FACES)]

    @model_validator(mode="after")
    def _each_once_and_in_the_dictionary(self) -> TagsSection:
        ids = [tag.id for tag in self.panels]
        size = dictionary_size(self.dictionary)
        for number in ids:
            if number >= size:
                raise ValueError(f"id {number} given; {self.dictionary} has 0 to {size - 1}")
            if ids.count(number) > 1:
                raise ValueError(f"id {number} given {ids.count(number)} times; once is legal")
        return self


class TexturedFace(Placed):
    """A flat face with an image that looks like a real surface. Its frame is that of a `TagSection`."""

    kind: Literal["stones", "poster", "crate"]
    """what surface"""
    seed: Annotated[int, Field(ge=0), A_NUMBER] = 0
    """which one of its kind"""
    size: tuple[PositiveLength, PositiveLength]
    """width along x, height along y [m]"""


class TargetSection(Framed):
    """Dots, tags or textured faces: exactly one of the three; all places in its one frame."""

    dot_radius: PositiveLength | None = None
    """[m]; stands with dots"""
    dots: Annotated[tuple[Dot, ...], Field(min_length=1, max_length=400)] = ()
    tags: TagsSection | None = None
    textures: Annotated[tuple[TexturedFace, ...], Field(min_length=1, max_length=MOST_FACES)] = ()
    boards: tuple[Block, ...] = ()
    """the bodies that carry dots, tags or faces, or stand behind them"""

    @model_validator(mode="after")
    def _one_kind(self) -> TargetSection:
        if bool(self.dots) + (self.tags is not None) + bool(self.textures) != 1:
            raise ValueError("give exactly one of dots, tags, textures")
        if bool(self.dots) != (self.dot_radius is not None):
            raise ValueError("dot_radius stands with dots, and only with them")
        return self

    def transformed(self, a_T_b: RigidTransform) -> Self:
        """Return the same, stated in frame b, in frame a."""
        parts = {
            name: tuple(part.transformed(a_T_b) for part in getattr(self, name))
            for name in ("dots", "textures", "boards")
        }
        tags = self.tags
        if tags is not None:
            tags = tags.model_copy(update={"panels": tuple(tag.transformed(a_T_b) for tag in tags.panels)})
        return self.model_copy(update={**parts, "tags": tags})

    def unlike(self, other: TargetSection) -> str:
        """Return by what another target differs from this one, wherever it stands; "" where it does not."""
        if self._shown != other._shown:
            return f"{other._shown}, not {self._shown}"
        apart = float(np.abs(self._distances - other._distances).max())
        return f"distances on it differ by {1e3 * apart:.1f} mm" if apart > _ALIKE else ""

    @property
    def _shown(self) -> str:
        if self.tags is not None:
            ids = sorted(tag.id for tag in self.tags.panels)
            return f"tags {', '.join(map(str, ids))} of {self.tags.dictionary}"
        if self.textures:
            return ", ".join(sorted(f"{face.kind} {face.seed}" for face in self.textures))
        return f"{len(self.dots)} dots"

    @property
    def _distances(self) -> FloatArray:
        """Of dots and their radius, or of three points of every face, each from each, sorted [m]."""
        if self.dots:
            apart = np.sort(pdist([dot.center for dot in self.dots]))
            return np.append(apart, self.dot_radius or 0.0)
        points = [face.transform.apply(np.diag([*face.size, 0.0])) for face in self.textures]
        if self.tags is not None:
            points = [tag.transform.apply(np.diag([tag.edge, tag.edge, 0.0])) for tag in self.tags.panels]
        return np.sort(pdist(np.concatenate(points)))

    @property
    def known(self) -> targets.Target | None:
        """The tags as a target of known geometry, in the frame of the first; None where it has no tags.

        Where the tags are as a whole is left out: that is for the images to tell.
        """
        if self.tags is None:
            return None
        target_T_initial = self.tags.panels[0].transform.inv()
        return targets.Target(
            tags=tuple(
                targets.Tag(self.tags.dictionary, tag.id, tag.edge, target_T_initial * tag.transform)
                for tag in self.tags.panels
            )
        )
