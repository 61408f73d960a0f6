"""Refinement: evidence on one frame as evidence on another.

The RCS of a target speaks of Theta1 = {very small, small, big}, its type is one of Theta2 = {false
alarm, fighter, cargo}. A declared mapping says which element of Theta2 each element of Theta1
stands for (Tchamova et al. 2004, 14.3.2.2), or which union of elements where the second frame is
finer. Unions go to unions and intersections to intersections, so it is enough to say it of the
elements. Masses go along, on the free lattice; a model of the second frame is applied afterwards
(:func:`~gda_tracker.evidence.decisions.project` or a rule).

>>> import numpy as np
>>> sizes, types = ("VS", "S", "B"), ("FA", "F", "C")
>>> chapter = Refinement(sizes, types, {"VS": "FA", "S": "F", "B": "C"})
>>> chapter.element_name("(VS|S)&B")
'FA&C|F&C'
>>> finer = Refinement(("small", "large"), ("drone", "fighter", "cargo"),
...                    {"small": "drone|fighter", "large": "cargo"})
>>> finer.element_name("small&large")
'drone&cargo|fighter&cargo'
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from operator import and_, or_

import numpy as np

from gda_tracker.evidence.frames import (
    check_element,
    check_frame,
    element_name,
    minimal_terms,
    parse_element,
    sort_elements,
    total_ignorance,
)
from gda_tracker.vocabulary.arrays import FloatArray, MaskArray


class Refinement:
    """Mapping of the elements of one frame onto elements of the hyper-power set of another.

    Parameters
    ----------
    frame
        Names of the elements of the first frame.
    onto
        Names of the elements of the second frame.
    mapping
        For every element of the first frame an element of the second one's hyper-power set, as
        text; in all they must cover the second frame, so that total ignorance stays total
        ignorance.

    Raises
    ------
    ValueError
        For names that are not in the frames, an element that is not mapped, or elements of the
        second frame that nothing maps onto.
    """

    def __init__(
        self, frame: Sequence[str], onto: Sequence[str], mapping: Mapping[str, str]
    ) -> None:
        self.frame = check_frame(frame)
        self.onto = check_frame(onto)
        missing = [name for name in self.frame if name not in mapping]
        unknown = [name for name in mapping if name not in self.frame]
        if missing or unknown:
            raise ValueError(
                f"refinement of {', '.join(mapping) or 'nothing'}: allowed is each of "
                f"{', '.join(self.frame)} once"
            )
        self._images = tuple(parse_element(self.onto, mapping[name]) for name in self.frame)
        rest = total_ignorance(len(self.onto)) & ~reduce(or_, self._images)
        if rest:
            uncovered = [
                name for index, name in enumerate(self.onto) if rest >> ((1 << index) - 1) & 1
            ]
            raise ValueError(
                f"refinement onto {', '.join(self.onto)}: nothing maps onto "
                f"{', '.join(uncovered)}; allowed is a mapping that covers the frame"
            )

    def element(self, mask: int) -> int:
        """Return the element of the second frame for one of the first, both free-model masks.

        Raises
        ------
        ValueError
            For a mask that is not an element of the first frame's hyper-power set.
        """
        terms = minimal_terms(check_element(self.frame, mask))
        return reduce(or_, (self._meet(term) for term in terms))

    def element_name(self, text: str) -> str:
        """Return the element of the second frame for one of the first, both as text."""
        return element_name(self.onto, self.element(parse_element(self.frame, text)))

    def carry(self, focal: MaskArray, masses: FloatArray) -> tuple[MaskArray, FloatArray]:
        """Carry masses over.

        Parameters
        ----------
        focal
            (E,) Venn bitmasks, elements of the free model of the first frame.
        masses
            (..., E) masses.

        Returns
        -------
        focal, masses
            (E',) elements of the free model of the second frame without repetition, in column
            order, and (..., E') masses; none is lost.
        """
        images = [self.element(mask) for mask in np.asarray(focal).tolist()]
        columns = sort_elements(set(images))
        column = {mask: index for index, mask in enumerate(columns.tolist())}
        matrix = np.zeros((len(images), len(columns)))
        matrix[np.arange(len(images)), [column[mask] for mask in images]] = 1.0
        return columns, masses @ matrix

    def carry_source(self, source: Mapping[int, float]) -> dict[int, float]:
        """Carry over one source of :func:`~gda_tracker.evidence.combination.combine`."""
        columns, masses = self.carry(
            np.array(list(source), dtype=np.uint32), np.array(list(source.values()))
        )
        return dict(zip(columns.tolist(), masses.tolist(), strict=True))

    def _meet(self, term: int) -> int:
        images = (image for index, image in enumerate(self._images) if term >> index & 1)
        return reduce(and_, images)
