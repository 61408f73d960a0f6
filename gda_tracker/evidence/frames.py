"""Frames of discernment, hyper-power sets and models, with elements as bitmasks of Venn parts.

A frame of k elements that may overlap has 2^k - 1 disjoint Venn parts. Part ``s`` (1 <= s < 2^k) is
inside element i where bit i of s is set and outside the others; it is bit ``s - 1`` of a mask. So
intersection is ``&``, union is ``|`` and equality of masks is equality of elements, whatever they
are called. The elements of the hyper-power set D^Theta (unions and intersections of the frame's
elements) are the masks that with a part hold all parts inside more elements. (Tchamova et al. 2004,
14.3.2)

A model says which parts exist. The free model has all; Shafer's model only those inside one
element.

>>> names = ("VS", "S", "B")
>>> mask = parse_element(names, "(VS | S) & B")
>>> element_name(names, mask)
'VS&B|S&B'
>>> element_name(names, mask, constrained_model(names, ("VS&B",)))
'S&B'
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gda_tracker.vocabulary.arrays import MaskArray

# Five elements have 31 Venn parts, which fit into the 32 bits of a mask; six have 63, and 7,828,352
# elements in their hyper-power set, too many for a table of masses.
MAX_ELEMENTS = 5
_TOO_LARGE = f"allowed are 1 to {MAX_ELEMENTS} elements; six have 7828352 unions and intersections"

_NAME = re.compile(r"[^\s&|()]+")
_TOKEN = re.compile(r"\s*([^\s&|()]+|[&|()])")


def check_frame(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of a frame's elements as a tuple.

    Raises
    ------
    ValueError
        If there are none or more than ``MAX_ELEMENTS``, if two are equal, or if one is empty or has
        a blank, ``&``, ``|`` or a parenthesis.
    """
    frame = tuple(names)
    if not 1 <= len(frame) <= MAX_ELEMENTS:
        raise ValueError(f"frame = {list(frame)}: {_TOO_LARGE}")
    if len(set(frame)) < len(frame):
        raise ValueError(f"frame = {list(frame)}: allowed are names that differ")
    for name in frame:
        if not _NAME.fullmatch(name):
            raise ValueError(
                f"frame element {name!r}: allowed is a name without blanks, &, |, ( and )"
            )
    return frame


@lru_cache(maxsize=16)
def singletons(size: int) -> tuple[int, ...]:
    """Masks of the k elements of a frame of ``size`` k, on the free model."""
    return tuple(
        sum(1 << (part - 1) for part in range(1, 1 << size) if part >> element & 1)
        for element in range(size)
    )


def total_ignorance(size: int) -> int:
    """Mask of the union of all elements of a frame of ``size`` k."""
    return (1 << ((1 << size) - 1)) - 1


def parts(mask: int) -> list[int]:
    """Venn parts of a mask, each as the set of the elements it is inside of (bit i: element i)."""
    return [bit + 1 for bit in range(int(mask).bit_length()) if int(mask) >> bit & 1]


def minimal_terms(mask: int) -> list[int]:
    """Terms of the element as a union of intersections, the shortest form, rising.

    Each term is a set of elements, bit i for element i; a part is a term if no smaller part is in
    it.
    """
    found = parts(mask)
    return [part for part in found if not any(p & part == p and p != part for p in found)]


def upward_closure(size: int, mask: int) -> int:
    """Smallest element of the hyper-power set that holds all parts of ``mask``."""
    terms = minimal_terms(mask)
    return sum(
        1 << (part - 1)
        for part in range(1, 1 << size)
        if any(part & term == term for term in terms)
    )


def union_of_atoms(size: int, mask: int) -> int:
    """u(X): union of the elements that occur in the minimal-term form of X; u(A & B) = A | B."""
    atoms = 0
    for term in minimal_terms(mask):
        atoms |= term
    result = 0
    for element, singleton in enumerate(singletons(size)):
        if atoms >> element & 1:
            result |= singleton
    return result


@dataclass(frozen=True)
class Model:
    """Which Venn parts of a frame exist.

    ``names`` are the frame's elements, ``alive`` is the mask of the parts that exist. An element of
    the hyper-power set is reduced by the model to ``mask & alive``; it is dead if nothing is left.
    """

    names: tuple[str, ...]
    alive: int

    @property
    def size(self) -> int:
        """Number of elements of the frame."""
        return len(self.names)

    def reduce(self, focal: MaskArray) -> MaskArray:
        """Elements of the free model as the model sees them, 0 for dead ones."""
        return np.asarray(focal, dtype=np.uint32) & np.uint32(self.alive)


def free_model(names: Sequence[str]) -> Model:
    """Return the free DSm model: all elements may overlap."""
    frame = check_frame(names)
    return Model(frame, total_ignorance(len(frame)))


def shafer_model(names: Sequence[str]) -> Model:
    """Return Shafer's model: the elements exclude each other (Tchamova et al. 2004, M1(Theta2))."""
    frame = check_frame(names)
    return Model(frame, sum(1 << ((1 << element) - 1) for element in range(len(frame))))


def constrained_model(names: Sequence[str], empty: Iterable[str | int]) -> Model:
    """Return the hybrid model in which the ``empty`` elements (names or masks) are forced empty.

    Raises
    ------
    ValueError
        For an element that is not in the hyper-power set, or if nothing is left.
    """
    frame = check_frame(names)
    alive = total_ignorance(len(frame))
    for element in empty:
        if isinstance(element, str):
            alive &= ~parse_element(frame, element)
        else:
            alive &= ~check_element(frame, element)
    if not alive:
        raise ValueError("a model without any Venn part: allowed are constraints that leave one")
    return Model(frame, alive)


def check_element(names: Sequence[str], mask: int, model: Model | None = None) -> int:
    """Return an element of the hyper-power set as reduced by the model, by default the free one.

    Raises
    ------
    ValueError
        If ``mask`` is no such element or is empty.
    """
    alive = total_ignorance(len(names)) if model is None else model.alive
    mask = int(mask)
    foreign = mask <= 0 or mask > total_ignorance(len(names))
    if model is not None:
        mask &= alive
    if foreign or not mask or upward_closure(len(names), mask) & alive != mask:
        raise ValueError(
            f"mask {mask:#x}: allowed are elements of the hyper-power set of {list(names)}"
        )
    return mask


def free_element(model: Model, mask: int) -> int:
    """Return an element that may have been reduced by a model as an element of the free model.

    Elements of the free model are returned as they are, total ignorance of the model as total
    ignorance, other reduced elements as the smallest element that the model reduces to them.

    Raises
    ------
    ValueError
        If ``mask`` is neither.
    """
    if mask == model.alive:
        return total_ignorance(model.size)
    closed = upward_closure(model.size, mask) if mask > 0 else 0
    return check_element(model.names, closed if closed & model.alive == mask else mask)


def element_name(names: Sequence[str], mask: int, model: Model | None = None) -> str:
    """Write an element as a union of intersections, ``&`` before ``|``, e.g. ``VS&S|B``.

    Parameters
    ----------
    names
        Names of the frame's elements.
    mask
        The element; a model that is given reduces it first.
    model
        The model, by default the free one. Elements that a model merges have one name.

    Raises
    ------
    ValueError
        If ``mask`` is empty or not an element of the hyper-power set.
    """
    terms = sorted(minimal_terms(check_element(names, mask, model)), key=_term_order)
    return "|".join(
        "&".join(name for element, name in enumerate(names) if term >> element & 1)
        for term in terms
    )


def parse_element(names: Sequence[str], text: str) -> int:
    """Read an element of the free model: names, ``&``, ``|`` and parentheses; ``&`` binds first.

    Raises
    ------
    ValueError
        For a name that is not in the frame, or text that cannot be read.
    """
    frame = check_frame(names)
    tokens = _TOKEN.findall(text)
    if "".join(tokens) != "".join(text.split()):
        raise ValueError(f"element {text!r}: cannot be read")
    reader = _Reader(frame, text, tokens)
    mask = reader.union()
    if reader.tokens:
        raise ValueError(f"element {text!r}: {reader.tokens[0]!r} is out of place")
    return mask


class _Reader:
    """Reads union := intersection {"|" intersection}, intersection := atom {"&" atom}."""

    def __init__(self, frame: tuple[str, ...], text: str, tokens: list[str]) -> None:
        self.masks = dict(zip(frame, singletons(len(frame)), strict=True))
        self.text = text
        self.tokens = tokens

    def union(self) -> int:
        mask = self.intersection()
        while self.tokens[:1] == ["|"]:
            self.tokens.pop(0)
            mask |= self.intersection()
        return mask

    def intersection(self) -> int:
        mask = self.atom()
        while self.tokens[:1] == ["&"]:
            self.tokens.pop(0)
            mask &= self.atom()
        return mask

    def atom(self) -> int:
        token = self.tokens.pop(0) if self.tokens else ""
        if token == "(":
            mask = self.union()
            if self.tokens[:1] != [")"]:
                raise ValueError(f"element {self.text!r}: a closing parenthesis is missing")
            self.tokens.pop(0)
            return mask
        if token in self.masks:
            return self.masks[token]
        if token in ("", "&", "|", ")"):
            where = f"before {token!r}" if token else "at the end"
            raise ValueError(f"element {self.text!r}: a name is missing {where}")
        raise ValueError(f"element {token!r}: unknown; allowed are {', '.join(self.masks)}")


def _term_order(term: int) -> tuple[int, int]:
    return term.bit_count(), term


def _element_order(mask: int) -> tuple[int, list[tuple[int, int]]]:
    terms = sorted(map(_term_order, minimal_terms(mask)))
    return len(terms), terms


def sort_elements(masks: Iterable[int]) -> MaskArray:
    """Put elements in column order: fewer terms first, then fewer factors, then as in the frame.

    For a frame VS, S, B: VS, S, B, VS&S, VS&B, S&B, VS&S&B, then the unions, e.g. VS|S, VS|S|B.
    """
    return np.array(sorted(map(int, masks), key=_element_order), dtype=np.uint32)


def intersection_closure(focal: Iterable[int], alive: int) -> MaskArray:
    """Close focal elements under intersection, without what the model empties, in column order."""
    generators = sorted({int(mask) & alive for mask in focal} - {0})
    closed = set(generators)
    fresh = generators
    while fresh:
        fresh = sorted({a & b for a in fresh for b in generators} - closed - {0})
        closed.update(fresh)
    return sort_elements(closed)


@lru_cache(maxsize=MAX_ELEMENTS)
def hyper_power_set(size: int) -> MaskArray:
    """All non-empty elements of the free model of a frame of k elements: 1, 4, 18, 166, 7579.

    An element is a rising truth table over the sets of elements. Such a table over k elements is a
    pair of rising tables over k - 1, the lower half inside the upper half (k-th element absent or
    present).
    """
    if not 1 <= size <= MAX_ELEMENTS:
        raise ValueError(f"frame of {size} elements: {_TOO_LARGE}")
    tables = np.array([0, 1], dtype=np.uint64)
    for element in range(size):
        lower, upper = tables[:, None], tables[None, :]
        inside = (lower & upper) == lower
        pairs = lower | (upper << np.uint64(1 << element))
        tables = pairs[inside]
    # Bit 0 is the empty set of elements: the outside of the frame, in no element.
    masks = np.sort(tables[(tables & np.uint64(1)) == 0]) >> np.uint64(1)
    found = masks[masks > 0].astype(np.uint32)
    found.flags.writeable = False
    return found
