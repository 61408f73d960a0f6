"""Stable fused ids: a group of tracks goes on under the id that most of its tracks had.

Of several groups with tracks of one id the one with more of them keeps it, then the one whose
tracks come first; of several ids in a group the older one stays. An id is never given again.
"""

from __future__ import annotations

import numpy as np

from gda_tracker.vocabulary.arrays import IntArray


def continue_identities(groups: IntArray, company: IntArray, next_id: int) -> tuple[IntArray, int]:
    """Give ids to groups.

    Parameters
    ----------
    groups : (M,)
        Group of each track, from 0 without a gap.
    company : (M,)
        Id that each track had, -1 for none.
    next_id
        Above all ids given.

    Returns
    -------
    (G,) id of each group, and the next id.
    """
    count = int(groups.max(initial=-1)) + 1
    found = np.full(count, -1)
    known = company >= 0
    pairs, shared = np.unique(
        np.stack([groups[known], company[known]], axis=1), axis=0, return_counts=True
    )
    taken = set()
    # Most tracks first, then the older id, then the group whose tracks come first.
    for place in np.lexsort((pairs[:, 0], pairs[:, 1], -shared)):
        group, identity = pairs[place].tolist()
        if found[group] < 0 and identity not in taken:
            found[group] = identity
            taken.add(identity)
    new = (found < 0).nonzero()[0]
    found[new] = next_id + np.arange(len(new))
    return found, next_id + len(new)
