"""The paths among which a descent moves: a base, and the offsets of its free control points.

φ and t start at the identity and end at the goal; where the camera's velocity at w = 0 is given, the second
control point is fixed as well, p′(0) = n (P₁ − P₀). The base bends least among all of them, so the bending
energy is the base's plus a quadratic form of the offsets, without a linear term. Without a velocity the base
is the straight line and the linearly interpolated quaternion.

Unknowns x: the offsets of the free control points of φ, in blocks of 4, then those of t/ℓ, in blocks of 3.
"""

from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import set_basis
from omniservo.planning.search.bending import bending_form, least_bent

MAX_SAMPLES = 48
"""Samples of w that a descent can hold; the search adds witnesses up to it."""


class Ends(NamedTuple):
    """What all paths of a search have in common."""

    quaternion: FloatArray
    """φ(1) (4,), of any length"""
    translation: FloatArray
    """t(1) (3,) [m]"""
    departure: FloatArray
    """φ′(0) (4,), then t′(0) (3,) [m] per unit w; (0,) where they are free"""


class PathFamily(NamedTuple):
    """Paths of one degree between the same ends, and where a descent looks at them."""

    rotation_base: FloatArray
    """control points of φ (4, σ+1)"""
    translation_base: FloatArray
    """control points of t (3, τ+1) [m]"""
    base_energy: FloatArray
    """∫‖φ″‖² dw and ∫‖t″‖² dw [m²] of the base (2,)"""
    rotation_form: FloatArray
    """`bending_form` of φ's free control points, the last ones before the end"""
    translation_form: FloatArray
    """`bending_form` of t's free control points"""
    rotation_basis: FloatArray
    """Bernstein polynomials at the samples (MAX_SAMPLES, σ+1)"""
    translation_basis: FloatArray
    """(MAX_SAMPLES, τ+1)"""
    places: FloatArray
    """w of every sample (MAX_SAMPLES,)"""
    samples: IntArray
    """how many samples there are (1,)"""


@kernel
def path_family(ends: Ends, sigma: int, tau: int) -> PathFamily:
    """Return the family of degrees σ, τ, both at least 2 where a departure is given, without samples."""
    phi, t, energy = np.zeros((4, sigma + 1)), np.zeros((3, tau + 1)), np.empty(2)
    phi[3, 0] = 1.0
    turn, move, fixed = np.empty(4), np.empty(3), 1
    for c in range(4):
        turn[c] = ends.quaternion[c] - phi[c, 0]
    for c in range(3):
        move[c] = ends.translation[c]
    if ends.departure.shape[0] > 0:
        fixed = 2
        for c in range(4):
            turn[c] = ends.departure[c]
        for c in range(3):
            move[c] = ends.departure[4 + c]
    energy[0], energy[1] = least_bent(ends.quaternion, turn, phi), least_bent(ends.translation, move, t)
    return PathFamily(
        phi,
        t,
        energy,
        bending_form(sigma, fixed),
        bending_form(tau, fixed),
        np.empty((MAX_SAMPLES, sigma + 1)),
        np.empty((MAX_SAMPLES, tau + 1)),
        np.empty(MAX_SAMPLES),
        np.zeros(1, dtype=np.int64),
    )


@kernel
def family_like(family: PathFamily, samples: int) -> PathFamily:
    """Return the same paths with ``samples`` evenly spaced samples of their own."""
    other = held(
        PathFamily(
            family.rotation_base,
            family.translation_base,
            family.base_energy,
            family.rotation_form,
            family.translation_form,
            np.empty_like(family.rotation_basis),
            np.empty_like(family.translation_basis),
            np.empty_like(family.places),
            np.zeros(1, dtype=np.int64),
        )
    )
    set_uniform_samples(other, samples)
    return other


@kernel
def add_sample(family: PathFamily, w: float) -> bool:
    """Add a sample at w; False where there is no room."""
    index = family.samples[0]
    if index == MAX_SAMPLES:
        return False
    family.samples[0] = index + 1
    set_basis(family.rotation_basis, index, w)
    set_basis(family.translation_basis, index, w)
    family.places[index] = w
    return True


@kernel
def set_samples(family: PathFamily, places: FloatArray) -> None:
    """Replace the samples by those at places (m,), as many as there is room for."""
    family.samples[0] = 0
    for w in places:
        add_sample(family, w)


@kernel
def set_uniform_samples(family: PathFamily, count: int) -> None:
    """Replace the samples by ``count`` ones evenly inside (0, 1)."""
    family.samples[0] = 0
    for i in range(count):
        add_sample(family, (i + 1.0) / (count + 1.0))


@kernel
def unknowns(family: PathFamily) -> int:
    """Return how many offsets there are: without a departure 4(σ−1) + 3(τ−1)."""
    return int(4 * family.rotation_form.shape[0] + 3 * family.translation_form.shape[0])


@kernel
def path_controls(family: PathFamily, ell: float, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the control points of φ (4, σ+1) and t (3, τ+1) [m] for the offsets x."""
    phi, t = family.rotation_base.copy(), family.translation_base.copy()
    turns, moves = family.rotation_form.shape[0], family.translation_form.shape[0]
    first = phi.shape[1] - 1 - turns
    for k in range(turns):
        for c in range(4):
            phi[c, first + k] += x[4 * k + c]
    first = t.shape[1] - 1 - moves
    for k in range(moves):
        for c in range(3):
            t[c, first + k] += ell * x[4 * turns + 3 * k + c]
    return phi, t


@kernel
def offsets(family: PathFamily, ell: float, phi: FloatArray, t: FloatArray, x: FloatArray) -> None:
    """Write the offsets of a path of the family's degrees from its control points, see `path_controls`."""
    turns, moves = family.rotation_form.shape[0], family.translation_form.shape[0]
    first = phi.shape[1] - 1 - turns
    for k in range(turns):
        for c in range(4):
            x[4 * k + c] = phi[c, first + k] - family.rotation_base[c, first + k]
    first = t.shape[1] - 1 - moves
    for k in range(moves):
        for c in range(3):
            x[4 * turns + 3 * k + c] = (t[c, first + k] - family.translation_base[c, first + k]) / ell


@kernel
def path_energy(family: PathFamily, ell: float, x: FloatArray) -> float:
    """Return ∫‖t″‖² dw / ℓ² + ∫‖φ″‖² dw at the offsets x."""
    turns, moves = family.rotation_form.shape[0], family.translation_form.shape[0]
    energy: float = family.base_energy[0] + family.base_energy[1] / (ell * ell)
    for i in range(turns):
        for j in range(turns):
            for c in range(4):
                energy += family.rotation_form[i, j] * x[4 * i + c] * x[4 * j + c]
    for i in range(moves):
        for j in range(moves):
            for c in range(4 * turns, 4 * turns + 3):
                energy += family.translation_form[i, j] * x[3 * i + c] * x[3 * j + c]
    return energy
