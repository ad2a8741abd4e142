"""Campaigns solved together: their normal equations summed over unknowns by name.

A campaign states ``z + A x`` about references of its own, as N, b and c over named blocks (the mounting, landmarks,
parameters, errors in common).  Blocks that no other campaign has are eliminated with what is known of them beforehand,
``N_kk - N_kr N_rr^-1 N_rk``; what is left is moved to common references, ``b - N d``, and summed; what is known of a
block that several have is added once.  The solution is ``x = -N^-1 b`` with the covariance ``N^-1`` and chi-square
``c + b^T x``.  The mountings' unknowns are arc seconds, those of the other blocks in their own units.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.units import ARCSEC

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MOUNTING = "mounting"
"""The block of three that turns ``C_EK``; its reference is no turn."""
CAMERA = f"{MOUNTING}["
"""How the block of a further camera's mounting begins, ``mounting[NAME]``: it turns ``C_EC = exp(reference)``."""
KNOWN_TOGETHER = "known[mountings]"
"""The entry among the blocks of a campaign that says what was known of all its mountings, in their order."""
TIE = "shared[tie "
"""How the block of a tie point's place begins."""
Image = tuple[Sequence[str], Array, Array, float, int]
"""Equations of an image: the names of its blocks, information, vector, constant and count."""


@dataclass(frozen=True)
class Known:
    """What a block of k unknowns is counted from, ``reference`` (k,), and what was known of it beforehand: ``expected``
    (k,) with ``covariance`` (k, k), None for nothing."""

    reference: Array
    expected: Array
    covariance: Array | None


@dataclass(frozen=True)
class Together:
    """What was known beforehand of the mountings of several cameras: of the turns of the blocks ``names`` (k,) that
    they were ``expected`` (3 k,) arcsec, with one ``covariance`` (3 k, 3 k) of all."""

    names: tuple[str, ...]
    expected: Array
    covariance: Array


def apart(name: str, a: Array, b: Array) -> Array:
    """How far a value (k,) of a block is from another: ``a - b``, of a camera's mountings the turn between them."""
    if not name.startswith(CAMERA):
        return a - b
    return np.asarray(so3.log(so3.exp(ARCSEC * a) @ so3.exp(ARCSEC * b).T) / ARCSEC)


@dataclass(frozen=True)
class Equations:
    """Normal equations of a campaign about the mounting ``C_EK`` (3, 3) and the references of ``blocks``, in their
    order: ``information`` (n, n), ``vector`` (n,), ``constant`` of ``count`` numbers.  ``together`` is what was known
    of all mountings of several cameras, of which the first one's block has its part."""

    C_EK: Array
    blocks: Mapping[str, Known]
    information: Array
    vector: Array
    constant: float
    count: int
    together: Together | None = None

    @cached_property
    def places(self) -> dict[str, Index]:
        """Where each block stands."""
        places, start = {}, 0
        for name, known in self.blocks.items():
            places[name] = np.arange(start, start + known.reference.size)
            start += known.reference.size
        return places

    def at(self, names: Iterable[str]) -> Index:
        """Where some blocks stand, one behind the other."""
        found = [self.places[name] for name in names]
        return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)

    def with_known(self, names: Iterable[str]) -> Equations:
        """With what was known beforehand of some blocks, each of which becomes so many numbers more; what is as good as
        free (a camera within some degrees, a tie point's place) only where the sightings determine less of it."""
        N, b, constant, count = self.information.copy(), self.vector.copy(), self.constant, 0.0
        stated = {name: P for name in names if (P := self.blocks[name].covariance) is not None}
        for name, W in zip(stated, _inverses(list(stated.values())), strict=True):
            known, at = self.blocks[name], self.places[name]
            pull, own = apart(name, known.reference, known.expected), (at[:, None], at)
            count += at.size
            if name.startswith((CAMERA, TIE)):
                count -= float(np.trace(np.linalg.solve(N[own] + W, N[own])))
            N[own] += W
            b[at] += W @ pull
            constant += float(pull @ W @ pull)
        return replace(self, information=N, vector=b, constant=constant, count=self.count + round(count))

    def with_together(self, known: Together) -> Equations:
        """With what was known beforehand of several mountings."""
        N, b, at, W = (
            self.information.copy(),
            self.vector.copy(),
            self.at(known.names),
            np.linalg.inv(known.covariance),
        )
        N[at[:, None], at] += W
        b[at] -= W @ known.expected
        constant = self.constant + float(known.expected @ W @ known.expected)
        return replace(self, information=N, vector=b, constant=constant, count=self.count + at.size)

    def only(self, names: Sequence[str]) -> Equations:
        """Over some blocks, in this order, the others eliminated with what was known of them."""
        kept = set(names)
        others = [name for name in self.blocks if name not in kept]
        if not others:
            return self._ordered(names)
        whole = self.with_known(others)
        k, r = whole.at(names), whole.at(others)
        N, b = whole.information, whole.vector
        N_kr = N[k[:, None], r]
        S = np.linalg.solve(N[r[:, None], r], np.concatenate([N_kr.T, b[r, None]], axis=1))
        return Equations(
            self.C_EK,
            {name: self.blocks[name] for name in names},
            N[k[:, None], k] - N_kr @ S[:, :-1],
            b[k] - N_kr @ S[:, -1],
            whole.constant - float(b[r] @ S[:, -1]),
            whole.count - r.size,
            self.together if self.together is not None and kept >= set(self.together.names) else None,
        )

    def _ordered(self, names: Sequence[str]) -> Equations:
        """All blocks in another order."""
        if list(self.blocks) == list(names):
            return self
        k, blocks = self.at(names), {name: self.blocks[name] for name in names}
        return replace(
            self, blocks=blocks, information=self.information[k[:, None], k], vector=self.vector[k]
        )

    def about(
        self, C_EK: Array, references: Mapping[str, Array], turn: Array, *, exactly: bool = False
    ) -> Equations:
        """The same about another mounting, from which ``turn`` (3,) arc seconds leads to this one, and other references
        of the blocks: ``z + A (x - d)``, or ``exactly`` about mountings close to which the answer is,
        ``z + A (M x - d)``."""
        moved = {
            name: turn if name == MOUNTING else apart(name, known.reference, references[name])
            for name, known in self.blocks.items()
        }
        d = np.concatenate(list(moved.values()))
        N, b, M = self.information, self.vector, None
        if exactly:
            turns = {name: turned for name, turned in moved.items() if name.startswith(MOUNTING)}
            at, M = self.at(turns), np.eye(d.size)
            M[at[:, None], at], d[at] = _turned(turns)
        Nd = N @ d
        constant = self.constant - 2.0 * float(self.vector @ d) + float(d @ Nd)
        blocks = {
            name: Known(known.reference, known.expected + turn, known.covariance)
            if name == MOUNTING
            else Known(references[name], known.expected, known.covariance)
            for name, known in self.blocks.items()
        }
        b = b - Nd
        N, b = (N, b) if M is None else (M.T @ N @ M, M.T @ b)
        together = self.together
        if together is not None:
            turned = np.concatenate([moved[name] for name in together.names])
            together = replace(together, expected=together.expected + turned)
        return replace(
            self, C_EK=C_EK, blocks=blocks, information=N, vector=b, constant=constant, together=together
        )


def _turned(turns: Mapping[str, Array]) -> tuple[Array, Array]:
    """How far turns x of mountings move a campaign's own ones, ``M x - d``, M (3 k, 3 k) and d (3 k,) arcsec, where
    ``turns`` of its cameras lead from the mountings that x turns to its own.

    Turns do not commute.  Its equations know the turn u of its first camera and how far each other is turned against
    it, w of ``exp(u) exp(w)``, by their sum::

        exp(u) = exp(x) exp(-t),   exp(w) = exp(t) exp(x' - x) exp(-t'),   d' = t - log(exp(t) exp(-t'))
    """
    t, *others = (ARCSEC * turn for turn in turns.values())
    M, d = np.zeros((3 * len(turns), 3 * len(turns))), np.tile(t, len(turns))
    M[:3, :3] = np.linalg.inv(so3.left_jacobian(-t))
    for k, other in enumerate(others, start=1):
        at = slice(3 * k, 3 * k + 3)
        w = so3.log(so3.exp(t) @ so3.exp(-other))
        apart = np.linalg.solve(so3.left_jacobian(w), so3.exp(t))
        M[at, :3], M[at, at] = M[:3, :3] - apart, apart
        d[at] -= w
    return M, d / ARCSEC


def _inverses(matrices: Sequence[Array]) -> list[Array]:
    """The inverse of each, those of one size together."""
    alike: dict[int, list[int]] = {}
    for k, P in enumerate(matrices):
        alike.setdefault(len(P), []).append(k)
    inverses = list(matrices)
    for mine in alike.values():
        for k, W in zip(mine, np.linalg.inv(np.array([matrices[k] for k in mine])), strict=True):
            inverses[k] = W
    return inverses


def summed(C_EK: Array, blocks: Mapping[str, Known], images: Iterable[Image]) -> Equations:
    """The equations of a campaign from those of its images."""
    known = blocks.get(KNOWN_TOGETHER)
    blocks = {name: block for name, block in blocks.items() if name != KNOWN_TOGETHER}
    size = sum(known.reference.size for known in blocks.values())
    whole = Equations(C_EK, blocks, np.zeros((size, size)), np.zeros(size), 0.0, 0)
    constant, count = 0.0, 0
    for names, N, b, c, n in images:
        at = whole.at(names)
        if len(set(names)) == len(names):
            whole.information[at[:, None], at] += N
            whole.vector[at] += b
        else:  # as in what earlier versions wrote of cameras that see one landmark
            np.add.at(whole.information, (at[:, None], at), N)
            np.add.at(whole.vector, at, b)
        constant, count = constant + c, count + n
    together = None
    if known is not None and known.covariance is not None:
        names = tuple(name for name in blocks if name.startswith(MOUNTING))
        if known.expected.size != 3 * len(names):
            raise ValueError(f"{KNOWN_TOGETHER} of {known.expected.size} numbers for {len(names)} mountings")
        together = Together(names, known.expected, known.covariance)
    return replace(whole, constant=constant, count=count, together=together)


@dataclass(frozen=True)
class Joint:
    """The least-squares solution of several campaigns: the mounting with its covariance rad^2 about E, and chi-square
    of ``count`` numbers with ``degrees`` of freedom; ``values`` of the unknowns that several campaigns have, by name,
    in their own units.  Of further ``cameras`` ``C_EC`` (k, 3, 3), and ``covariance_all_E`` (3 + 3 k, 3 + 3 k) of all
    mountings, the first camera's before theirs."""

    C_EK: Array
    covariance_E: Array
    cameras: tuple[str, ...]
    C_EC: Array
    covariance_all_E: Array
    chi2: float
    count: int
    degrees: int
    values: Mapping[str, Array]


def shared_names(parts: Sequence[Equations]) -> tuple[str, ...]:
    """The mounting, and the blocks that two campaigns or more have, in the order in which they first occur; without the
    mountings of further cameras, which may move from one campaign to the next."""
    times = Counter(name for part in parts for name in part.blocks)
    several = (name for name, n in times.items() if n > 1 and not name.startswith(MOUNTING))
    return (MOUNTING, *several)


def cameras_of(parts: Sequence[Equations]) -> tuple[str, ...]:
    """The blocks of further cameras' mountings, in the order in which they first occur."""
    return tuple(dict.fromkeys(name for part in parts for name in part.blocks if name.startswith(CAMERA)))


def linked(parts: Sequence[Equations], names: Sequence[str], found: Joint | None = None) -> list[Equations]:
    """Each campaign over some blocks, in its own order (its first camera before others), about the mountings that were
    ``found``, or like the other blocks about the references of the first that has each."""
    C_0 = next(part.C_EK for part in parts if MOUNTING in part.blocks) if found is None else found.C_EK
    first: dict[str, Array] = {}
    if found is not None:
        there = zip(found.cameras, so3.log(found.C_EC) / ARCSEC, strict=True)
        first = {f"{CAMERA}{camera}]": turn for camera, turn in there}
    for part in parts:
        first |= {name: known.reference for name, known in part.blocks.items() if name not in first}
    wanted = set(names)
    few = [part.only([name for name in part.blocks if name in wanted]) for part in parts]
    turns = so3.log(np.array([part.C_EK for part in few]) @ C_0.T) / ARCSEC
    exactly = found is not None
    return [part.about(C_0, first, turn, exactly=exactly) for part, turn in zip(few, turns, strict=True)]


def joint(parts: Sequence[Equations], *, mounting_known: bool = True) -> Joint:
    """The solution of campaigns whose blocks of one name are one unknown; what is known of such a block is taken from
    the first campaign that states it.  ``mounting_known`` False leaves out what is known of the mounting."""
    names = (*shared_names(parts), *cameras_of(parts))
    found = _solved(parts, linked(parts, names), mounting_known)
    # turns of several cameras do not commute: about where they are they are small
    return _solved(parts, linked(parts, names, found), mounting_known) if found.cameras else found


def _solved(parts: Sequence[Equations], few: Sequence[Equations], mounting_known: bool) -> Joint:
    """Of campaigns from the ``few`` blocks that count, about common references."""
    cameras = cameras_of(few)
    blocks: dict[str, Known] = {}
    for part in few:
        for name, known in part.blocks.items():
            if name not in blocks or (blocks[name].covariance is None and known.covariance is not None):
                blocks[name] = known
    whole = summed(few[0].C_EK, blocks, ((tuple(p.blocks), p.information, p.vector, 0.0, 0) for p in few))
    constant, numbers = sum(p.constant for p in few), sum(p.count for p in few)
    whole = replace(whole, constant=constant, count=numbers)
    together = next((part.together for part in few if part.together is not None), None)
    if mounting_known and together is not None:
        whole, mounting_known = whole.with_together(together), False
    whole = whole.with_known([name for name in blocks if mounting_known or name != MOUNTING])
    P = np.linalg.inv(whole.information)
    x = -P @ whole.vector
    turn, turns = whole.places[MOUNTING], whole.at((MOUNTING, *cameras))
    C_EC = [so3.exp(ARCSEC * x[whole.places[n]]) @ so3.exp(ARCSEC * blocks[n].reference) for n in cameras]
    values = {n: x[at] + blocks[n].reference for n, at in whole.places.items() if n not in cameras}
    return Joint(
        so3.exp(ARCSEC * x[turn]) @ whole.C_EK,
        np.asarray(ARCSEC**2 * P[np.ix_(turn, turn)]),
        tuple(name[len(CAMERA) : -1] for name in cameras),
        np.array(C_EC).reshape(-1, 3, 3),
        np.asarray(ARCSEC**2 * P[np.ix_(turns, turns)]),
        whole.constant + float(whole.vector @ x),
        sum(part.count for part in parts),
        whole.count - x.size,
        values,
    )
