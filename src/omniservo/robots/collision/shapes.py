"""The shapes of an arm, of what it carries and of what stands around, as arrays for kernels."""

from __future__ import annotations

from typing import NamedTuple

from omniservo.geometry.arrays import FloatArray, IntArray


class Shapes(NamedTuple):
    """What does not change of g shapes and p pairs of them."""

    kinds: IntArray
    """(g,) see `gap_kernels.SPHERE` and the rest"""
    sizes: FloatArray
    """(g, 3) as MuJoCo states them [m]"""
    radii: FloatArray
    """(g,) of balls about the shapes' origins that hold them [m]"""
    corners: FloatArray
    """(v, 3) of all hulls [m]"""
    firsts: IntArray
    """(g + 1,) index of each shape's first corner"""
    carried: IntArray
    """(g,) how many joints carry the shape"""
    spins: IntArray
    """(g,) 1 where the last of them turns it about its own axis"""
    places: FloatArray
    """(g, 3) origins at q = 0 [m]"""
    axes: FloatArray
    """(g, 9) rotations at q = 0, by rows"""
    pairs: IntArray
    """(p, 2) the second is carried by more joints"""
    first_between: IntArray
    """(p,) the first joint whose turn can bring the two nearer"""


class Bodies(NamedTuple):
    """What a gap depends on: g shapes and where they are."""

    kinds: IntArray
    """(g,) and the next four: see `Shapes`"""
    sizes: FloatArray
    """(g, 3) [m]"""
    radii: FloatArray
    """(g,) [m]"""
    corners: FloatArray
    """(v, 3) [m]"""
    firsts: IntArray
    """(g + 1,)"""
    places: FloatArray
    """(g, 3) origins [m]"""
    axes: FloatArray
    """(g, 9) rotations by rows"""


class PlacedShapes(NamedTuple):
    """Where everything is in one configuration."""

    frames: FloatArray
    """(n + 1, 3, 4) see `chain.carry`"""
    anchors: FloatArray
    """(n, 3) points on the joints' axes [m]"""
    directions: FloatArray
    """(n, 3) of the axes"""
    places: FloatArray
    """(g, 3) shapes' origins [m]"""
    axes: FloatArray
    """(g, 9) their rotations by rows"""
    moves: FloatArray
    """(g, n + 1) see `farthest_moves`"""
    normals: FloatArray
    """(p, 3) directions of slabs, of this configuration or another; 0: none is known"""
