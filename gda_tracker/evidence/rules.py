"""Rules of combination, batched over pairs of a history and a measurement.

Masses are arrays (P, E) over focal columns, one row per pair; the columns are given by the Venn
bitmasks of :mod:`gda_tracker.evidence.frames` on the free model. Which product of columns goes
where is worked out once per set of columns in a :class:`ConjunctionTable`; a rule is then one
contraction.

>>> from gda_tracker.evidence.frames import element_name, free_model
>>> model = free_model(("A", "B"))
>>> table = conjunction_table(model, np.array([0b101, 0b110]), np.array([0b101, 0b111]))
>>> history, measurement = table.embed(np.array([[0.4, 0.6]])), np.array([[0.5, 0.5]])
>>> masses, conflict = conjunctive(table, history, measurement)
>>> [element_name(model.names, mask) for mask in table.focal]
['A', 'B', 'A&B', 'A|B']
>>> masses.round(2).tolist(), conflict.round(2).tolist()    # on Shafer's model A & B is a conflict
([[0.4, 0.3, 0.3, 0.0]], [0.3])
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gda_tracker.evidence.frames import (
    Model,
    check_element,
    intersection_closure,
    shafer_model,
    total_ignorance,
    union_of_atoms,
    upward_closure,
)
from gda_tracker.vocabulary.arrays import FloatArray, IntArray, MaskArray


class TotalConflictError(ValueError):
    """All mass falls on the empty set: Dempster's rule has no answer."""


def move_to_model(model: Model, mask: int) -> int:
    """Return where a model leaves the mass of a focal element of the free model.

    The element itself as reduced by the model; if that is dead, the union u(X) of the atoms that
    occur in its minimal form; if that is dead too, total ignorance (hybrid DSm rule, Tchamova et
    al. 2004, 14.3.2.2, terms S1 and S2 for a single source).
    """
    mask = check_element(model.names, mask)
    for candidate in (mask, union_of_atoms(model.size, mask)):
        if candidate & model.alive:
            return candidate & model.alive
    return model.alive


@dataclass(frozen=True, slots=True, eq=False)
class ConjunctionTable:
    """Where the products of E history columns and F measurement columns go.

    Attributes
    ----------
    focal
        (E,) fused columns, closed under intersection, total ignorance among them. They stand for
        elements reduced by the model, but are written as elements of the free model, so that masks
        mean the same under every rule.
    embedding
        (E0, E) zeros and ones that carry the columns of a history to the fused ones, with the mass
        of dead elements moved by :func:`move_to_model`; ``None`` if the columns are the same.
    target
        (E, F) fused column of each product, E for a product that is dead on the model.
    contraction
        (E F, E + 1) zeros and ones: ``target`` one-hot, and a last column for the products whose
        intersection is empty on Shafer's model.
    ignorance
        Column of total ignorance.
    """

    focal: MaskArray
    embedding: FloatArray | None
    target: IntArray
    contraction: FloatArray
    ignorance: int

    def embed(self, history: FloatArray) -> FloatArray:
        """Histories (P, E0) over the fused columns, (P, E)."""
        return history if self.embedding is None else history @ self.embedding


def conjunction_table(
    model: Model, history_focal: MaskArray, measurement_focal: MaskArray
) -> ConjunctionTable:
    """Return the table for columns of a history and of a measurement; kept for the next call.

    Parameters
    ----------
    model
        The model on which the products are looked at.
    history_focal, measurement_focal
        (E0,) and (F,) Venn bitmasks, elements of the free model in any order.

    Raises
    ------
    ValueError
        For a mask that is not an element of the hyper-power set.
    """
    return _conjunction_table(
        model,
        np.asarray(history_focal, dtype=np.uint32).tobytes(),
        np.asarray(measurement_focal, dtype=np.uint32).tobytes(),
    )


@lru_cache(maxsize=128)
def _conjunction_table(
    model: Model, history_focal: bytes, measurement_focal: bytes
) -> ConjunctionTable:
    history = [move_to_model(model, mask) for mask in np.frombuffer(history_focal, np.uint32)]
    measurement = [
        move_to_model(model, mask) for mask in np.frombuffer(measurement_focal, np.uint32)
    ]
    everything = total_ignorance(model.size) & model.alive
    reduced = intersection_closure([*history, *measurement, everything], model.alive).tolist()
    column = {mask: index for index, mask in enumerate(reduced)}
    size = len(reduced)
    focal = np.array([upward_closure(model.size, mask) for mask in reduced], dtype=np.uint32)

    same = focal.tobytes() == history_focal
    embedding = np.zeros((len(history), size))
    embedding[np.arange(len(history)), [column[mask] for mask in history]] = 1.0

    meet = (
        np.array(reduced, dtype=np.int64)[:, None] & np.array(measurement, dtype=np.int64)[None, :]
    )
    target = np.array([column.get(mask, size) for mask in meet.ravel().tolist()], dtype=np.int64)
    contraction = np.zeros((meet.size, size + 1))
    contraction[np.arange(meet.size), target] = 1.0
    contraction[:, size] = (meet.ravel() & shafer_model(model.names).alive) == 0
    for array in (focal, embedding, target, contraction):
        array.flags.writeable = False
    return ConjunctionTable(
        focal=focal,
        embedding=None if same else embedding,
        target=target.reshape(meet.shape),
        contraction=contraction,
        ignorance=column[everything],
    )


def conjunctive(
    table: ConjunctionTable, history: FloatArray, measurement: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Conjunctive rule: m(C) = sum over A & B = C of m1(A) m2(B) (Tchamova et al. 2004, 14.3.2.1).

    On the free model this is the classic DSm rule, on Shafer's model the unnormalised Dempster
    rule.

    Parameters
    ----------
    table
        Table of the columns.
    history
        (P, E) masses over the fused columns, see :meth:`ConjunctionTable.embed`.
    measurement
        (P, F) masses over the measurement's columns.

    Returns
    -------
    masses, conflict
        (P, E) without the products that are dead on the model, and (P,) the mass of the products
        that are empty on Shafer's model.
    """
    pairs, (columns, measured) = len(history), table.target.shape
    product = (history[:, :, None] * measurement[:, None, :]).reshape(pairs, columns * measured)
    fused = product @ table.contraction
    return fused[:, :columns], fused[:, columns]


def dempster(
    table: ConjunctionTable,
    history: FloatArray,
    measurement: FloatArray,
    *,
    keep_history: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Dempster's rule: the conjunctive rule, normalised by what is not in conflict.

    Arguments and results are those of :func:`conjunctive` with a table of Shafer's model. In total
    conflict the rule has no answer: the pair keeps its history if ``keep_history``.

    Raises
    ------
    TotalConflictError
        In total conflict without ``keep_history``.
    """
    masses, conflict = conjunctive(table, history, measurement)
    # A sum of what is left: 1 - K would lose the digits of a small rest.
    rest = np.add.reduce(masses, axis=1)
    total = rest < np.finfo(np.float64).tiny
    if not total.any():
        return masses / rest[:, None], conflict
    if not keep_history:
        raise TotalConflictError(
            f"pairs {np.flatnonzero(total).tolist()}: history and measurement are in total conflict"
        )
    masses = np.where(total[:, None], history, masses / np.where(total, 1.0, rest)[:, None])
    return masses, np.where(total, 1.0, conflict)


def discount(table: ConjunctionTable, history: FloatArray, factor: float) -> FloatArray:
    """Discounting: m'(A) = factor m(A), the rest goes to total ignorance.

    ``history`` is (P, E) over the columns of the table; ``factor`` 1 changes nothing, 0 forgets
    all.
    """
    discounted = factor * history
    discounted[:, table.ignorance] += 1.0 - factor
    return discounted
