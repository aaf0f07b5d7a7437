"""Polynomials with integer coefficients, lowest power first: exact, whatever their size.

Every number of a plan file is a fraction. A polynomial is multiplied by a positive number until its
coefficients are integers; only its sign is ever needed, so that factor is forgotten.
"""

from fractions import Fraction
from functools import lru_cache
from itertools import accumulate, pairwise
from math import comb, gcd, lcm
from operator import add, mul

from omniservo.verification.work import bits, products, spend

Polynomial = list[int]


def integers(*numbers: Fraction) -> list[int]:
    """Return the numbers times their least common denominator."""
    factor = lcm(*(number.denominator for number in numbers))
    return [number.numerator * (factor // number.denominator) for number in numbers]


def combine(*terms: tuple[int, Polynomial]) -> Polynomial:
    """Return Σ kᵢ pᵢ of terms (kᵢ, pᵢ)."""
    total = [0] * max(len(p) for _, p in terms)
    for k, p in terms:
        if k:
            for i, coefficient in enumerate(p):
                total[i] += k * coefficient
    return total


def times(p: Polynomial, q: Polynomial) -> Polynomial:
    """Return p·q."""
    spend(products(24 + len(p) * len(q), bits(p), bits(q)))
    product = [0] * (len(p) + len(q) - 1)
    for i, a in enumerate(p):
        if a:
            for j, b in enumerate(q):
                product[i + j] += a * b
    return product


def squares(*polynomials: Polynomial) -> Polynomial:
    """Return Σ pᵢ²."""
    return combine(*((1, times(p, p)) for p in polynomials))


def minus(p: Polynomial, bound: Fraction) -> Polynomial:
    """Return p − bound, times the bound's denominator."""
    return [p[0] * bound.denominator - bound.numerator, *(bound.denominator * a for a in p[1:])]


def value(p: Polynomial, w: Fraction) -> Fraction:
    """Return p(w)."""
    total, power, longest = 0, 1, len(p) * w.denominator.bit_length()
    spend(products(4 * len(p), bits(p) + longest, longest))
    for a in reversed(p):
        total = total * w.numerator + a * power
        power *= w.denominator
    return Fraction(total * w.denominator, power)


@lru_cache(maxsize=256)
def _weights(n: int) -> tuple[int, ...]:
    return tuple(integers(*(Fraction(1, comb(n, j)) for j in range(n + 1))))


def bernstein(p: Polynomial) -> list[int]:
    """Return the Bernstein coefficients Σⱼ C(i,j) pⱼ/C(n,j) on [0, 1], times one positive integer.

    p lies between the smallest and the largest of them; the first and last are p's values at 0 and 1.
    """
    spend(products(16 + len(p) ** 2, bits(p) + len(p), 16))
    first = list(map(mul, _weights(len(p) - 1), p))
    # Pascal's rule: the i-th row begins with Σⱼ C(i,j) times the first one's j-th.
    rows = accumulate(p[1:], lambda row, _: list(map(add, row, row[1:])), initial=first)
    return [row[0] for row in rows]


def on_piece(p: Polynomial, start: Fraction, end: Fraction) -> Polynomial:
    """Return u ↦ p(start + (end − start)u), times a positive integer: what p is on a piece, on [0, 1]."""
    factor = lcm(start.denominator, end.denominator)
    line = [int(start * factor), int((end - start) * factor)]
    total, power = [p[-1]], 1
    for a in reversed(p[:-1]):
        power *= factor
        total = combine((1, times(total, line)), (a * power, [1]))
    return total


def halves(b: list[int]) -> tuple[list[int], list[int]]:
    """Return the Bernstein coefficients on both halves, times 2ⁿ (de Casteljau)."""
    n = len(b) - 1
    left, right = [b[0] << n], [b[n] << n]
    for k in range(n - 1, -1, -1):
        b = list(map(add, b, b[1:]))
        left.append(b[0] << k)
        right.append(b[-1] << k)
    return left, right[::-1]


def sturm_chain(p: Polynomial) -> list[Polynomial]:
    """Return p, p′ and the negated remainders of Euclid's algorithm, each times a positive number."""
    chain = [_reduced(p), _reduced([i * a for i, a in enumerate(p)][1:])]
    while len(chain[-1]) > 1:
        chain.append(_reduced([-a for a in _remainder(chain[-2], chain[-1])]))
    return chain if chain[-1] else chain[:-1]


def sign_changes(chain: list[Polynomial], w: Fraction) -> int:
    """Return the changes of sign along the chain at w.

    Where neither end is a root, their difference counts the distinct roots between the ends (Sturm).
    """
    signs = [v > 0 for v in (value(p, w) for p in chain) if v != 0]
    return sum(a != b for a, b in pairwise(signs))


def _remainder(p: Polynomial, q: Polynomial) -> Polynomial:
    lead, rest = abs(q[-1]), list(p)
    while len(rest) >= len(q):
        factor = rest[-1] if q[-1] > 0 else -rest[-1]
        rest = [a * lead for a in rest]
        shift = len(rest) - len(q)
        for i, b in enumerate(q):
            rest[shift + i] -= factor * b
        rest.pop()
    return rest


def _reduced(p: Polynomial) -> Polynomial:
    while p and p[-1] == 0:
        p = p[:-1]
    factor = gcd(*p) or 1
    return [a // factor for a in p]
