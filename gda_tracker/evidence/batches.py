"""Rules of combination on arrays: many pairs of sources, or many tuples of sources, at once.

Masses are arrays (P, E) over focal columns, one row per problem; columns are elements of the free
model (Venn bitmasks of :mod:`gda_tracker.evidence.frames`). What a rule does with each tuple of
columns is worked out once per set of columns in a :class:`RuleTable` and kept. Then a rule is one
contraction, for PCR plus the shares of the dead tuples.

:func:`combine_rows` fuses row with row, for two sources or more; :func:`combine_grid` every row of
one source with every row of another. For sources that follow each other in time (a track's history
and its measurements) :func:`history_table` closes the columns, so that the outcome is the next
history over the same columns.

>>> from gda_tracker.evidence.frames import element_name, shafer_model
>>> model = shafer_model(("A", "B"))
>>> table = rule_table("pcr5", model, [np.array([0b101, 0b111]), np.array([0b110, 0b111])])
>>> masses, conflict = combine_rows(table, [np.array([[0.6, 0.4]]), np.array([[0.3, 0.7]])])
>>> [element_name(model.names, mask) for mask in table.focal]
['A', 'B', 'A|B']
>>> masses.round(2).tolist(), conflict.round(2).tolist()
([[0.54, 0.18, 0.28]], [0.18])
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import repeat
from math import prod

import numpy as np

from gda_tracker.evidence.destinations import NothingAliveError
from gda_tracker.evidence.rule_tables import (
    RuleTable,
    Shares,
    history_table,
    rule_table,
)
from gda_tracker.evidence.rules import TotalConflictError
from gda_tracker.vocabulary.arrays import FloatArray

__all__ = [
    "RuleTable",
    "combine_grid",
    "combine_rows",
    "discount_columns",
    "history_table",
    "rule_table",
]

# Numbers in one block of products, and of shares (of which there are several arrays): they stay in
# the cache of a core.
_BLOCK = 1 << 17
_SHARE_BLOCK = 1 << 14


def combine_rows(
    table: RuleTable, sources: Sequence[FloatArray], *, keep_first: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Fuse the p-th rows of all sources with each other, jointly.

    Parameters
    ----------
    table
        Rule, model and columns.
    sources
        (P, Es) masses of each source over its columns.
    keep_first
        Under ``dempster``, in total conflict: keep the masses of the first source, whose columns
        must be those of the outcome, as :func:`history_table` makes them.

    Returns
    -------
    masses, conflict
        (P, G) over ``table.focal``, and (P,) the mass K of the dead tuples, under every rule.

    Raises
    ------
    ValueError
        For arrays that do not fit the table.
    TotalConflictError
        Under ``dempster`` in total conflict without ``keep_first``.
    NothingAliveError
        Under ``dubois_prade`` and ``disjunctive`` if a row has mass on a tuple of dead elements.
    """
    merged = _merged(table, sources)
    rows = len(merged[0])
    if any(len(source) != rows for source in merged):
        raise ValueError(
            f"sources of {', '.join(str(len(source)) for source in merged)} rows: allowed is one "
            "number of rows"
        )
    masses = np.empty((rows, len(table.focal)))
    conflict, rest = np.empty(rows), np.empty(rows)
    width = prod(table.shape)
    for block in _blocks(rows, width):
        parts = [source[block] for source in merged]
        products = reduce(_row_products, parts)
        _check_homeless(table, products)
        if table.row_contraction is None:
            masses[block] = products @ table.contraction
        else:
            masses[block] = (table.row_contraction @ products.T).T
        conflict[block] = products @ table.dead
        if table.rule == "dempster":
            rest[block] = products @ (1.0 - table.dead)
    if table.shares is not None and len(merged) == 2:
        inverse, own = _inverses(table.shares, merged), _own_columns(table.shares, merged)
        for block in _blocks(rows, len(table.shares.columns[0]), _SHARE_BLOCK):
            total = inverse[0][block] + inverse[1][block]
            masses[block] += _shares_of_two(table.shares, total, own[0][block], own[1][block])
    elif table.shares is not None:
        for block in _blocks(rows, len(table.shares.columns[0]), _SHARE_BLOCK):
            values = [
                source[block][:, column]
                for source, column in zip(merged, table.shares.columns, strict=True)
            ]
            masses[block] += _shares_of_many(table.rule, table.shares, values)
    if table.rule == "dempster":
        _normalise(masses, rest, _history(table, sources[0]) if keep_first else None)
    return masses, conflict


def combine_grid(
    table: RuleTable, first: FloatArray, second: FloatArray, *, keep_first: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Fuse every row of one source with every row of another.

    Parameters
    ----------
    table
        Rule, model and the columns of two sources; quickest if the second has few.
    first, second
        (N, E) and (M, F) masses.
    keep_first
        As in :func:`combine_rows`.

    Returns
    -------
    masses, conflict
        (N, M, G) over ``table.focal``, and (N, M) the mass K of the dead tuples.

    Raises
    ------
    ValueError, TotalConflictError, NothingAliveError
        As in :func:`combine_rows`.
    """
    if len(table.shape) != 2:
        raise ValueError(f"a table of {len(table.shape)} sources: allowed is one of two for a grid")
    left, right = _merged(table, [first, second])
    n, m, size = len(left), len(right), len(table.focal)
    if table.homeless is not None and n and m:
        _check_homeless(table, _row_products(left.max(axis=0)[None], right.max(axis=0)[None]))
    # What each first row makes of each column of the second: the second rows only mix these.
    per_column = (left @ table.first_contraction).reshape(n, table.shape[1], size)
    masses = np.matmul(right, per_column)
    dead = table.dead.reshape(table.shape)
    conflict = (left @ dead) @ right.T
    if table.shares is not None:
        inverse = _inverses(table.shares, [left, right])
        own = _own_columns(table.shares, [left, right])
        for block in _blocks(n, m * len(table.shares.columns[0]), _SHARE_BLOCK):
            total = inverse[0][block, None, :] + inverse[1]
            masses[block] += _shares_of_two(table.shares, total, own[0][block, None, :], own[1])
    if table.rule == "dempster":
        kept = _history(table, first)[:, None, :] if keep_first else None
        _normalise(masses, (left @ (1.0 - dead)) @ right.T, kept)
    return masses, conflict


def discount_columns(table: RuleTable, masses: FloatArray, reliability: float) -> FloatArray:
    """Discounting: m'(A) = reliability m(A), the rest goes to total ignorance.

    Parameters
    ----------
    table
        A table with a column of total ignorance in its outcome, as every :func:`history_table`.
    masses
        (..., G) masses over ``table.focal``.
    reliability
        1 changes nothing, 0 leaves total ignorance.

    Raises
    ------
    ValueError
        For a reliability outside 0 to 1, or a table without a column of total ignorance.
    """
    if not 0.0 <= reliability <= 1.0:
        raise ValueError(f"reliability = {reliability}: allowed is 0 to 1")
    if table.ignorance < 0:
        raise ValueError("a table without a column of total ignorance: allowed is a history_table")
    discounted = reliability * masses
    discounted[..., table.ignorance] += 1.0 - reliability
    return discounted


def _merged(table: RuleTable, sources: Sequence[FloatArray]) -> list[FloatArray]:
    """Masses over merged columns."""
    if tuple(source.shape[1:] for source in sources) != tuple((n,) for n in table.columns):
        found = ", ".join(str(source.shape) for source in sources)
        raise ValueError(
            f"masses of shapes {found}: allowed are rows of {', '.join(map(str, table.columns))}"
        )
    return [
        source if merge is None else source @ merge
        for source, merge in zip(sources, table.merges, strict=True)
    ]


def _blocks(rows: int, width: int, size: int = _BLOCK) -> Iterator[slice]:
    """Slices of rows of so many numbers each."""
    step = max(1, size // max(width, 1))
    for begin in range(0, rows, step):
        yield slice(begin, begin + step)


def _row_products(left: FloatArray, right: FloatArray) -> FloatArray:
    """(P, A) and (P, B) to (P, A B), the second varying fastest."""
    return (left[:, :, None] * right[:, None, :]).reshape(len(left), -1)


def _check_homeless(table: RuleTable, products: FloatArray) -> None:
    if table.homeless is not None and (products[:, table.homeless] > 0.0).any():
        raise NothingAliveError(
            f"mass on elements that are all dead on the model: rule {table.rule!r} has no place "
            "for their product; dsmh, pcr5, pcr6 and yager have"
        )


def _inverses(shares: Shares, sources: Sequence[FloatArray]) -> list[FloatArray]:
    """1/m (P, D) of each source in the dead tuples, infinite where there is no mass."""
    with np.errstate(divide="ignore", over="ignore"):
        return [
            np.reciprocal(source)[:, column]
            for source, column in zip(sources, shares.columns, strict=True)
        ]


def _own_columns(shares: Shares, sources: Sequence[FloatArray]) -> list[FloatArray]:
    """Masses of each source over the columns of the outcome, (P, G)."""
    return [source @ place for source, place in zip(sources, shares.places, strict=True)]


def _shares_of_two(
    shares: Shares, total: FloatArray, first: FloatArray, second: FloatArray
) -> FloatArray:
    """Shares (..., G) of dead pairs, from ``total`` (..., D), the sum of 1/m1(X) and 1/m2(Y).

    With r = m1(X) m2(Y)/(m1(X) + m2(Y)) = 1/(1/m1(X) + 1/m2(Y)) the element X gets r m1(X) and Y
    gets r m2(Y). As X takes part in several pairs, its r are added before they are multiplied.
    """
    pairs = total.shape[:-1]
    ratio = np.reciprocal(total, out=total).reshape(-1, total.shape[-1])
    result = (ratio @ shares.scatter[0]).reshape(*pairs, -1)
    result *= first
    other = (ratio @ shares.scatter[1]).reshape(*pairs, -1)
    other *= second
    result += other
    return np.asarray(result)


def _shares_of_many(rule: str, shares: Shares, values: Sequence[FloatArray]) -> FloatArray:
    """Shares (P, G) of dead tuples of three or more sources, from the masses (P, D) in them."""
    if rule == "pcr6":
        weights = [value * here for value, here in zip(values, shares.surviving, strict=True)]
    else:
        weights = [
            here * reduce(np.multiply, map(np.where, same, values, repeat(1.0)))
            for here, same in zip(shares.first, shares.same, strict=True)
        ]
    # No weight is below the product: where the total is zero there is nothing to share.
    total = np.maximum(reduce(np.add, weights), np.finfo(np.float64).tiny)
    ratio = reduce(np.multiply, values) / total
    parts = zip(weights, shares.scatter, strict=True)
    return reduce(np.add, [(ratio * weight) @ scatter for weight, scatter in parts])


def _history(table: RuleTable, first: FloatArray) -> FloatArray:
    if not table.keeps_columns:
        raise ValueError("keep_first: allowed with a table of history_table")
    return first


def _normalise(masses: FloatArray, rest: FloatArray, kept: FloatArray | None) -> None:
    """Divide by what is not in conflict, in place; it is summed, 1 - K would lose its digits."""
    total = rest < np.finfo(np.float64).tiny
    if not total.any():
        masses /= rest[..., None]
        return
    if kept is None:
        raise TotalConflictError(f"rows {np.argwhere(total).tolist()}: sources in total conflict")
    masses /= np.where(total, 1.0, rest)[..., None]
    np.copyto(masses, np.broadcast_to(kept, masses.shape), where=total[..., None])
