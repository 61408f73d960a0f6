"""Attributes as a parameter file declares them: lists side by side, checked and made fuzzifiers.

>>> lists = AttributeLists(names=["length_m"], models=["lognormal"], numbers=[5, 0.3, 15, 0.2])
>>> list(declared_attributes(lists, ["fighter", "cargo"]))
['length_m']
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gda_tracker.attributes.attribute_evidence import AttributeFuzzifier
from gda_tracker.attributes.class_models import CLASS_MODELS, ClassModelError, numbers_per_class
from gda_tracker.parameters import LONGEST_VALUE, ParameterError
from gda_tracker.vocabulary.arrays import BoolArray

MAX_ATTRIBUTES = 8
# What scans have as fields of their own.
RESERVED_NAMES = ("rcs_m2",)


@dataclass(frozen=True)
class AttributeLists:
    """The parameters ``attribute_*`` without their prefix; one entry per attribute or empty.

    ``numbers`` holds the numbers of all models in a row, attribute after attribute, class after
    class. ``unknown_classes`` names the pairs ``attribute/class`` that have none.
    """

    names: Sequence[str] = ()
    models: Sequence[str] = ()
    numbers: Sequence[float] = ()
    unknown_classes: Sequence[str] = ()
    reliability: Sequence[float] = ()
    minimum: Sequence[float] = ()
    maximum: Sequence[float] = ()
    prefix: str = field(default="attribute_", repr=False)

    def error(self, name: str, allowed: str) -> ParameterError:
        """Return the error of one of the lists."""
        value = repr(list(getattr(self, name)))
        if len(value) > LONGEST_VALUE:
            value = value[:LONGEST_VALUE] + " ..."
        return ParameterError(f"parameter {self.prefix}{name} = {value}: allowed is {allowed}")


def declared_attributes(
    lists: AttributeLists, class_names: Sequence[str]
) -> dict[str, AttributeFuzzifier]:
    """Return the fuzzifier of each declared attribute, by its name in the order of declaration.

    Raises
    ------
    ParameterError
        If the lists do not fit together or the numbers do not make a model; one line that names
        the parameter, its value and what is allowed.
    """
    _check_lists(lists)
    known = _known_classes(lists, class_names)
    shapes = [
        (int(known[name].sum()), numbers_per_class(kind, len(class_names)))
        for name, kind in zip(lists.names, lists.models, strict=True)
    ]
    total = sum(rows * each for rows, each in shapes)
    if len(lists.numbers) != total:
        parts = ", ".join(
            f"{each} for each of {rows} classes of {name}"
            for name, (rows, each) in zip(lists.names, shapes, strict=True)
        )
        raise lists.error("numbers", f"a list of {total} numbers" + (f", {parts}" if parts else ""))
    found, begin = {}, 0
    for index, (name, kind) in enumerate(zip(lists.names, lists.models, strict=True)):
        rows, each = shapes[index]
        end = begin + rows * each
        try:
            model = CLASS_MODELS[kind](np.reshape(lists.numbers[begin:end], (rows, each)))
        except ClassModelError as error:
            raise lists.error("numbers", f"for {name}, {kind}: {error}") from None
        found[name] = AttributeFuzzifier(
            model,
            known[name],
            lists.reliability[index] if lists.reliability else 1.0,
            lists.minimum[index] if lists.minimum else -np.inf,
            lists.maximum[index] if lists.maximum else np.inf,
        )
        begin = end
    return found


def _check_lists(lists: AttributeLists) -> None:
    names, count = lists.names, len(lists.names)
    if count > MAX_ATTRIBUTES or len(set(names)) < count or "" in names:
        raise lists.error("names", f"at most {MAX_ATTRIBUTES} names that differ")
    if set(names) & set(RESERVED_NAMES):
        raise lists.error("names", f"names other than {', '.join(RESERVED_NAMES)}")
    if len(lists.models) != count:
        raise lists.error("models", f"a list with one entry per attribute, {count} in all")
    for name in ("reliability", "minimum", "maximum"):
        if len(getattr(lists, name)) not in (0, count):
            raise lists.error(name, f"one entry per attribute, {count} in all, or an empty list")
    if lists.minimum and lists.maximum:
        for low, high in zip(lists.minimum, lists.maximum, strict=True):
            if not low < high:
                raise lists.error("maximum", f"numbers > attribute_minimum = {list(lists.minimum)}")


def _known_classes(lists: AttributeLists, class_names: Sequence[str]) -> dict[str, BoolArray]:
    """Return which classes each attribute knows, (C,) by name."""
    pairs = [f"{name}/{each}" for name in lists.names for each in class_names]
    for pair in lists.unknown_classes:
        if pair not in pairs:
            raise lists.error("unknown_classes", f"a list of attribute/class, {', '.join(pairs)}")
    known = {
        name: np.array([f"{name}/{each}" not in lists.unknown_classes for each in class_names])
        for name in lists.names
    }
    if any(row.sum() < 2 for row in known.values()):
        raise lists.error("unknown_classes", "pairs that leave two classes to each attribute")
    return known
