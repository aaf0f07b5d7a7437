"""Is a choice between polynomial inequalities true on all of [0, 1]? Proof, counterexample, or neither."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Literal, NamedTuple

from omniservo.verification.polynomials import (
    Polynomial,
    bernstein,
    combine,
    halves,
    sign_changes,
    squares,
    sturm_chain,
    times,
)
from omniservo.verification.work import bits, spend

Verdict = Literal["holds", "violated", "undecided"]


class Finding(NamedTuple):
    """The answer for one constraint, and where it was lost."""

    verdict: Verdict
    w: Fraction | None = None
    note: str = ""
    """what is wrong where no w can show it"""


HOLDS = Finding("holds")
_TOUCHING_DEPTH, _DEEPEST, _MOST_PIECES, _MOST_STURM = 40, 100, 20_000, 8_000_000


def decide(
    polynomials: Sequence[Polynomial], branches: Sequence[Sequence[int]], *, strict: bool = False
) -> Finding:
    """Decide whether, at every w in [0, 1], all polynomials of at least one branch are ≥ 0 (strict: > 0).

    Pieces of [0, 1] are halved until Bernstein coefficients settle them. The values at a piece's ends are
    exact, so a counterexample is one. Where a polynomial only touches 0, halving never ends; Sturm's
    theorem then tells.
    """
    chains: dict[tuple[int, ...], list[Polynomial]] = {}
    unsettled: Fraction | None = None
    least = 1 if strict else 0
    stack = [(0, 0, [bernstein(p) for p in polynomials])]
    for _ in range(_MOST_PIECES):
        if not stack:
            return HOLDS if unsettled is None else Finding("undecided", unsettled)
        index, depth, pieces = stack.pop()
        if _settled(pieces, branches, strict):
            continue
        ends = Fraction(index, 1 << depth), Fraction(index + 1, 1 << depth)
        for side, w in zip((0, -1), ends, strict=True):
            if not any(all(pieces[i][side] >= least for i in branch) for branch in branches):
                return Finding("violated", w)
        if depth >= _TOUCHING_DEPTH and not strict and _one_root(polynomials, pieces, ends, chains):
            continue
        if depth == _DEEPEST:
            unsettled = ends[0]
            continue
        spend(sum(16 + len(b) ** 2 * (1 + (bits(b) >> 12)) for b in pieces))
        left, right = zip(*map(halves, pieces), strict=True)
        stack += [(2 * index + 1, depth + 1, list(right)), (2 * index, depth + 1, list(left))]
    return Finding("undecided", ends[0])


def nonnegative(p: Polynomial) -> Finding:
    """Decide p ≥ 0 on [0, 1]."""
    return decide([p], [[0]])


def root_sum(a: Polynomial, b: Polynomial, q: Polynomial, *, strict: bool = False) -> Finding:
    """Decide a + b√q ≥ 0 (strict: > 0) on [0, 1], where q ≥ 0.

    That is (a ≥ 0 and b ≥ 0) or (a ≥ 0 and a² ≥ b²q) or (b ≥ 0 and b²q ≥ a²); the strict form likewise.
    """
    if not strict and min(bernstein(a)) >= 0 and min(bernstein(b)) >= 0:
        return HOLDS
    gap = combine((1, squares(a)), (-1, times(squares(b), q)))
    return decide([a, b, gap, [-g for g in gap]], [(0, 1), (0, 2), (1, 3)], strict=strict)


def _settled(pieces: list[list[int]], branches: Sequence[Sequence[int]], strict: bool) -> bool:
    """True where one branch has no negative coefficient (strict: and positive values at both ends)."""
    return any(
        all(min(pieces[i]) >= 0 and (not strict or (pieces[i][0] > 0 < pieces[i][-1])) for i in branch)
        for branch in branches
    )


def _one_root(
    polynomials: Sequence[Polynomial],
    pieces: list[list[int]],
    ends: tuple[Fraction, Fraction],
    chains: dict[tuple[int, ...], list[Polynomial]],
) -> bool:
    """True where all polynomials together have at most one root on the piece, inside it.

    The signs at an end then reach up to that root, and what holds (≥ 0) on both of its sides holds on it.
    """
    if any(any(b) and (b[0] == 0 or b[-1] == 0) for b in pieces):
        return False
    mixed = tuple(i for i, b in enumerate(pieces) if min(b) < 0 < max(b))
    if mixed not in chains:
        chains[mixed] = _chain_of_product([polynomials[i] for i in mixed])
    chain = chains[mixed]
    return bool(chain) and sign_changes(chain, ends[0]) - sign_changes(chain, ends[1]) <= 1


def _chain_of_product(polynomials: list[Polynomial]) -> list[Polynomial]:
    """Return the Sturm chain of the product, of p and −p only one; empty where it would take too long."""
    product, seen = [1], []
    for p in polynomials:
        if [-a for a in p] not in seen:
            seen.append(p)
            product = times(product, p)
    work = len(product) ** 3 * bits(product)
    spend(min(work, _MOST_STURM) >> 5)
    return sturm_chain(product) if work <= _MOST_STURM else []
