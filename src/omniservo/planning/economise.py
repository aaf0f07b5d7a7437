"""From a proven path to one of less effort nearby, proven again (method section 6)."""

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import PROVEN, REFUTED
from omniservo.planning.constraints.demands import Demands
from omniservo.planning.path_family import Family, path_energy
from omniservo.planning.prove_path import prove_path
from omniservo.planning.settle import THRIFTY_PULL, power_path, settle

SHORTER = 0.7
"""Where the whole way to the least effort is not proven, this part of it is tried next."""

SHORTEST = 0.1
"""Less than this part of the way is not worth a proof."""


@kernel
def economise(
    demands: Demands, family: Family, ends: FloatArray, x: FloatArray, least: FloatArray
) -> tuple[int, FloatArray, FloatArray, float]:
    """Lower the bending energy of a proven path in place; where it stays proven part of the way, go so far.

    Args:
        demands: the problem.
        family: where to move.
        ends: `settle.end_values`.
        x: offsets of a proven path; of the better path where status is PROVEN, else unchanged.
        least: the smallest g of every group at the samples is written here.

    Returns:
        PROVEN or REFUTED (no better path was proven), φ and t by powers, and the energy at x.
    """
    ell, found = demands.numbers[2], x.copy()
    before = path_energy(family, ell, x)
    status, rotation, translation, _ = settle(demands, family, ends, THRIFTY_PULL, x, least)
    part = 1.0
    while status != PROVEN and part > SHORTEST:
        part *= SHORTER
        for i in range(x.shape[0]):
            x[i] = found[i] + part * (x[i] - found[i])
        rotation, translation = power_path(family, ell, x)
        status, _ = prove_path(demands, rotation, translation)
    energy = path_energy(family, ell, x)
    if status == PROVEN and energy < before:
        return PROVEN, rotation, translation, energy
    for i in range(x.shape[0]):
        x[i] = found[i]
    return REFUTED, rotation, translation, before
