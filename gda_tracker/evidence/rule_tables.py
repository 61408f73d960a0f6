"""Index tables of the rules of combination: what becomes of every tuple of columns.

A :class:`RuleTable` is worked out once for a rule, a model and the columns of the sources, and kept
for the next call. The kernels of :mod:`gda_tracker.evidence.batches` contract masses with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from gda_tracker.evidence.destinations import Destinations, destinations
from gda_tracker.evidence.frames import Model, free_element, sort_elements, total_ignorance
from gda_tracker.evidence.rules import move_to_model
from gda_tracker.vocabulary.arrays import BoolArray, FloatArray, IntArray, MaskArray

# Numbers in a dense matrix of zeros and ones (2 MB); beyond, only the ones are kept.
_DENSE = 1 << 18
# Columns of the outcome beyond which a row of products is moved quicker by the ones alone.
_MANY_COLUMNS = 32


@dataclass(frozen=True, slots=True, eq=False)
class Shares:
    """The D dead tuples whose product PCR gives back to two or more surviving elements.

    Attributes
    ----------
    columns
        For each source, (D,) its merged column in the tuple.
    surviving
        (S, D) ones where the element of a source survives.
    first
        (S, D) ones where it survives and no source before has the same element.
    same
        (S, S, D) whether two sources have the same element in the tuple.
    scatter
        For each source, (D, G) zeros and ones that carry the shares of its elements to the columns
        of the outcome.
    places
        For each source, (Es, G) zeros and ones that carry its surviving columns to their own.
    """

    columns: tuple[IntArray, ...]
    surviving: FloatArray
    first: FloatArray
    same: BoolArray
    scatter: tuple[Any, ...]
    places: tuple[Any, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RuleTable:
    """What a rule does with the T = E1 x ... x ES tuples of columns, the last source fastest.

    Attributes
    ----------
    rule, model
        Name of the rule and the model.
    columns
        Number of columns that each source has when it comes in.
    merges
        For each source, the matrix that adds columns which the model makes one element, or
        ``None`` where there are none.
    shape
        Number of merged columns E1..ES.
    focal
        (G,) columns of the outcome in column order. They stand for elements reduced by the model,
        but are written as elements of the free model, so that a mask means the same under every
        rule.
    contraction
        (T, G) zeros and ones, where the products go; a sparse array if it is large.
    first_contraction
        The same as (E1, T/E1 G).
    row_contraction
        The same as a sparse array (G, T), for rows of products one by one; ``None`` where
        ``contraction`` is as quick.
    dead
        (T,) ones for the tuples in conflict.
    homeless
        (T,) whether the rule has no place for the product; ``None`` if it has for all.
    shares
        What PCR does with dead tuples, ``None`` if there are none.
    ignorance
        Column of total ignorance in the outcome, -1 if no product goes there.
    keeps_columns
        Whether the columns of the first source are those of the outcome.
    """

    rule: str
    model: Model
    columns: tuple[int, ...]
    merges: tuple[FloatArray | None, ...]
    shape: tuple[int, ...]
    focal: MaskArray
    contraction: Any
    first_contraction: Any
    row_contraction: Any
    dead: FloatArray
    homeless: BoolArray | None
    shares: Shares | None
    ignorance: int
    keeps_columns: bool


def rule_table(rule: str, model: Model, columns: Sequence[MaskArray]) -> RuleTable:
    """Return the table of a rule for one or more sources; kept for the next call.

    Parameters
    ----------
    rule
        One of ``RULES``.
    model
        The model.
    columns
        (Es,) Venn bitmasks of each source, elements of the free model or as reduced by the model.

    Raises
    ------
    ValueError
        For an unknown rule, no source, a mask that is no element of the hyper-power set, or more
        tuples than memory allows.
    NothingAliveError
        If the model has no Venn part.
    """
    return _rule_table(rule, model, tuple(map(_key, columns)), b"")


def history_table(
    rule: str, model: Model, history: MaskArray, measurement: MaskArray
) -> tuple[RuleTable, FloatArray | None]:
    """Table for histories that are fused again and again, over columns that stay.

    Parameters
    ----------
    rule, model
        As in :func:`rule_table`.
    history, measurement
        (E0,) and (F,) Venn bitmasks.

    Returns
    -------
    table, embedding
        ``table.focal`` are the columns of the first source as well as of the outcome: those of the
        history and total ignorance, and all that follows from fusing with the measurement however
        often. ``embedding`` (E0, G) carries histories over their own columns to them; ``None`` if
        they are the same. Except under ``dsmc`` it moves the mass of elements that are dead on the
        model (of histories that come from another one) by
        :func:`~gda_tracker.evidence.rules.move_to_model`.

    Raises
    ------
    ValueError, NothingAliveError
        As in :func:`rule_table`.
    """
    return _history_table(rule, model, _key(history), _key(measurement))


def clear() -> None:
    """Forget all tables."""
    _history_table.cache_clear()
    _rule_table.cache_clear()


def _key(masks: MaskArray) -> bytes:
    return np.asarray(masks, dtype=np.uint32).tobytes()


@lru_cache(maxsize=64)
def _history_table(
    rule: str, model: Model, history: bytes, measurement: bytes
) -> tuple[RuleTable, FloatArray | None]:
    given = np.frombuffer(history, dtype=np.uint32).tolist()
    embedded = [_embedded(rule, model, mask) for mask in given]
    everything = _reduced(rule, model, total_ignorance(model.size))
    measured = [_reduced(rule, model, mask) for mask in np.frombuffer(measurement, np.uint32)]
    right = np.array(measured, dtype=np.uint32)
    closed, size = {everything, *embedded}, 0
    if rule in ("pcr5", "pcr6"):
        closed.update(mask for mask in measured if mask & model.alive)
    while len(closed) > size:
        size = len(closed)
        left = np.array(sorted(closed), dtype=np.uint32)
        closed.update(np.unique(destinations(rule, model, [left, right]).target).tolist())
        closed.discard(0)
    reduced = sort_elements(closed)
    focal = _free(rule, model, reduced)
    table = _rule_table(rule, model, (focal.tobytes(), measurement), reduced.tobytes())
    if focal.tobytes() == history:
        return table, None
    column = {mask: index for index, mask in enumerate(reduced.tolist())}
    return table, _one_hot([column[mask] for mask in embedded], len(reduced), dense=True)


def _embedded(rule: str, model: Model, mask: int) -> int:
    """Where the mass of a history's element goes before the rule."""
    free = free_element(model, mask)
    return free if rule == "dsmc" else move_to_model(model, free)


def _reduced(rule: str, model: Model, mask: int) -> int:
    """Return an element as the rule looks at it; dead ones keep the mask of the free model."""
    free = free_element(model, int(mask))
    return free if rule == "dsmc" else free & model.alive or free


def _free(rule: str, model: Model, reduced: MaskArray) -> MaskArray:
    if rule == "dsmc":
        return reduced
    return np.array([free_element(model, mask) for mask in reduced.tolist()], dtype=np.uint32)


@lru_cache(maxsize=64)
def _rule_table(rule: str, model: Model, columns: tuple[bytes, ...], outcome: bytes) -> RuleTable:
    """Return the table; ``outcome`` are the reduced columns of the outcome, empty for those met."""
    sources = [
        [_reduced(rule, model, mask) for mask in np.frombuffer(column, np.uint32)]
        for column in columns
    ]
    elements = [np.array(list(dict.fromkeys(source)), dtype=np.uint32) for source in sources]
    moves = destinations(rule, model, elements)
    shape = tuple(map(len, elements))
    chosen = np.unravel_index(np.flatnonzero(moves.shared), shape)
    if outcome:
        reduced = np.frombuffer(outcome, dtype=np.uint32)
    else:
        reduced = sort_elements(_met(model, moves, elements, chosen))
    focal = _free(rule, model, reduced)
    size = len(focal)
    column = {mask: index for index, mask in enumerate(reduced.tolist())}
    contraction = _one_hot([column.get(mask, -1) for mask in moves.target.tolist()], size)
    merges = tuple(map(_merge, sources, elements))
    for array in (focal, moves.dead, moves.homeless):
        array.flags.writeable = False
    return RuleTable(
        rule=rule,
        model=model,
        columns=tuple(map(len, sources)),
        merges=merges,
        shape=shape,
        focal=focal,
        contraction=contraction,
        first_contraction=contraction.reshape((shape[0], -1)) if contraction.size else contraction,
        row_contraction=csr_array(contraction.T) if size > _MANY_COLUMNS else None,
        dead=moves.dead.astype(np.float64),
        homeless=moves.homeless if moves.homeless.any() else None,
        shares=_shares(model, elements, chosen, column) if len(chosen[0]) else None,
        ignorance=column.get(_reduced(rule, model, total_ignorance(model.size)), -1),
        keeps_columns=sources[0] == reduced.tolist(),
    )


def _met(
    model: Model,
    moves: Destinations,
    elements: Sequence[MaskArray],
    chosen: tuple[IntArray, ...],
) -> list[int]:
    """Reduced elements to which some product goes, in whole or in part."""
    parts = [
        source[index] & np.uint32(model.alive)
        for source, index in zip(elements, chosen, strict=True)
    ]
    met = np.unique(np.concatenate([moves.target, *parts]))
    found: list[int] = met[met > 0].tolist()
    return found


def _merge(source: Sequence[int], elements: MaskArray) -> FloatArray | None:
    if len(source) == len(elements):
        return None
    column = {mask: index for index, mask in enumerate(elements.tolist())}
    return _one_hot([column[mask] for mask in source], len(elements), dense=True)


def _shares(
    model: Model,
    elements: Sequence[MaskArray],
    chosen: tuple[IntArray, ...],
    column: dict[int, int],
) -> Shares:
    alive = np.uint32(model.alive)
    masks = np.stack([source[index] for source, index in zip(elements, chosen, strict=True)])
    surviving = (masks & alive) != 0
    same = masks[:, None, :] == masks[None, :, :]
    repeated = np.array([same[source, :source].any(axis=0) for source in range(len(masks))])

    def to_outcome(focal: MaskArray) -> Any:
        return _one_hot([column.get(mask, -1) for mask in focal.tolist()], len(column))

    return Shares(
        columns=tuple(np.asarray(index, dtype=np.int64) for index in chosen),
        surviving=surviving.astype(np.float64),
        first=(surviving & ~repeated).astype(np.float64),
        same=same,
        scatter=tuple(map(to_outcome, masks)),
        places=tuple(map(to_outcome, elements)),
    )


def _one_hot(target: Iterable[int], size: int, *, dense: bool = False) -> Any:
    """(T, size) zeros with a one in the column of each row, none for -1; sparse if large."""
    columns = np.array(list(target), dtype=np.int64)
    rows = np.flatnonzero(columns >= 0)
    shape = (len(columns), size)
    if not dense and len(columns) * size > _DENSE:
        return csr_array((np.ones(len(rows)), (rows, columns[rows])), shape=shape)
    matrix = np.zeros(shape)
    matrix[rows, columns[rows]] = 1.0
    matrix.flags.writeable = False
    return matrix
