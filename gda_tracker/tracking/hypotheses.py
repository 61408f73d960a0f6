"""The track manager's table of hypotheses, as arrays, one row per live hypothesis."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np

from gda_tracker.vocabulary.arrays import (
    BoolArray,
    FloatArray,
    Int32Array,
    IntArray,
    MaskArray,
    empty_floats,
)


def _ints() -> IntArray:
    return np.zeros(0, dtype=np.int64)


@dataclass(slots=True)
class HypothesisTable:
    """H live hypotheses; the rows stand in the order of their ids.

    ``mean`` (H, s) [m, m/s], ``covariance`` (H, s, s); ``history`` (H,) has the hits of the last
    scans as bits, newest in bit 0; ``detection_index`` (H,) is the row of the last scan's detection
    in the source's array, -1 for none. Beliefs: ``masses`` (H, E) over the Venn bitmasks ``focal``
    of the frame, ``class_probability`` (H, C), ``conflict`` (H,). ``log_likelihood_ratio`` (H,) is
    that of sequential extraction, kept under every rule; with ``log_prior_odds`` (H,) of the start
    and ``log_room`` (H,), see :mod:`gda_tracker.tracking.existence`, it says how probably there is
    a target; ``blind_scans`` (H,) of the ``coasted_scans`` are explained by a blind zone, see
    :mod:`gda_tracker.tracking.blind_zone`. The fields of the history window
    are those of ``Predictions``, see :mod:`gda_tracker.tracking.history_window`; no columns without
    a window.

    With interacting multiple models ``mean`` and ``covariance`` are the moments of the mixture of
    the M motion ``models``, named, with ``model_weight`` (H, M), ``model_mean`` (H, M, c),
    ``model_covariance`` (H, M, c, c), as far as position and velocity go: the first s of the c
    components, see :mod:`gda_tracker.kinematics.model_sets`. With the filter ``gpb2`` the
    predictions of a scan have a component for each pair of models, M^2 of them. With one motion
    model M is 0 and the moments are all there is.

    Where a measurement did not give a position, a state is a Gaussian sum of ``spread`` parts, each
    with its models: G M columns, part by part, or G with one motion model; parts that a row has not
    weigh 0. ``spread`` is 1 without, see :mod:`gda_tracker.tracking.gaussian_sums`.

    Under ``mht`` a track has several rows, its leaves, one after the other: ``chosen`` (H,) marks
    the one that speaks for it (else all do), ``log_score`` (H,) is the log likelihood ratio of the
    leaf against false alarms, ``detection_numbers`` (H, W) the running numbers of the detections of
    the last W scans, newest first, -1 for none (W = 0 under the other decisions).

    Of extended objects ``extended`` (H, 6) is what :mod:`gda_tracker.tracking.extended.columns`
    says, (H, 0) without; ``cell_members`` (m, 2) are the rows in the source's array of the
    detections of the last scan's cells, each behind that by which its cell is called.

    ``strength`` (H, 2) are shape and scale of what is known of the strength of the target's
    signals, see :mod:`gda_tracker.tracking.signal_strength`; (H, 0) without.
    """

    hypothesis_id: IntArray = field(default_factory=_ints)
    parent_id: IntArray = field(default_factory=_ints)
    track_id: IntArray = field(default_factory=_ints)
    status: IntArray = field(default_factory=_ints)
    mean: FloatArray = field(default_factory=lambda: empty_floats(0, 4))
    covariance: FloatArray = field(default_factory=lambda: empty_floats(0, 4, 4))
    history: IntArray = field(default_factory=_ints)
    age_scans: IntArray = field(default_factory=_ints)
    hits: IntArray = field(default_factory=_ints)
    misses: IntArray = field(default_factory=_ints)
    coasted_scans: IntArray = field(default_factory=_ints)
    first_detection_ns: IntArray = field(default_factory=_ints)
    last_detection_ns: IntArray = field(default_factory=_ints)
    detection_index: IntArray = field(default_factory=_ints)
    log_likelihood_ratio: FloatArray = field(default_factory=empty_floats)
    log_prior_odds: FloatArray = field(default_factory=empty_floats)
    log_room: FloatArray = field(default_factory=empty_floats)
    blind_scans: FloatArray = field(default_factory=empty_floats)
    conflict: FloatArray = field(default_factory=empty_floats)
    masses: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
    class_probability: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
    model_weight: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
    model_mean: FloatArray = field(default_factory=lambda: empty_floats(0, 0, 4))
    model_covariance: FloatArray = field(default_factory=lambda: empty_floats(0, 0, 4, 4))
    window_kind: Int32Array = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int32))
    window_masses: FloatArray = field(default_factory=lambda: empty_floats(0, 0, 0))
    window_log_class_likelihood: FloatArray = field(default_factory=lambda: empty_floats(0, 0, 0))
    chosen: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    log_score: FloatArray = field(default_factory=empty_floats)
    detection_numbers: IntArray = field(default_factory=lambda: np.zeros((0, 0), dtype=np.int64))
    extended: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
    strength: FloatArray = field(default_factory=lambda: empty_floats(0, 0))
    # Not per row:
    frame: tuple[str, ...] = ()
    focal: MaskArray = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))
    class_names: tuple[str, ...] = ()
    window_focal: MaskArray = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))
    models: tuple[str, ...] = ()
    spread: int = 1
    cell_members: Int32Array = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int32))

    def __post_init__(self) -> None:
        """Give rows that were made without a window, models, trees or odds empty ones."""
        if not self.window_kind.size and len(self.window_kind) != len(self):
            self.clear_windows(0)
        if len(self.model_weight) != len(self) and not self.model_weight.size:
            # Not given: no models, for as many rows as there are.
            h, s = self.mean.shape
            self.model_weight = empty_floats(h, 0)
            self.model_mean = empty_floats(h, 0, s)
            self.model_covariance = empty_floats(h, 0, s, s)
        count = len(self)
        if len(self.chosen) != count:
            self.chosen = np.ones(count, dtype=np.bool_)
        for name in ("log_score", "log_prior_odds", "log_room", "blind_scans"):
            if len(getattr(self, name)) != count:
                setattr(self, name, np.zeros(count))
        if len(self.detection_numbers) != count:
            self.detection_numbers = np.zeros((count, 0), dtype=np.int64)
        if len(self.extended) != count:
            self.extended = empty_floats(count, 0)
        if len(self.strength) != count:
            self.strength = empty_floats(count, 0)

    def __len__(self) -> int:
        return len(self.hypothesis_id)

    def copy(self) -> HypothesisTable:
        """Return a table that shares the arrays; assigning to one of its fields leaves this one."""
        twin = object.__new__(HypothesisTable)
        for name in ALL_FIELDS:
            setattr(twin, name, getattr(self, name))
        return twin

    def select(self, rows: np.ndarray) -> HypothesisTable:
        """Return a table with the given rows or mask."""
        if rows.dtype == np.bool_:
            rows = np.flatnonzero(rows)
        twin = object.__new__(HypothesisTable)
        for name in WHOLE_FIELDS:
            setattr(twin, name, getattr(self, name))
        for name in ROW_FIELDS:
            setattr(twin, name, getattr(self, name)[rows])
        return twin

    def append(self, other: HypothesisTable) -> HypothesisTable:
        """Return a table with the rows of both; frames and classes must be equal."""
        twin = object.__new__(HypothesisTable)
        for name in WHOLE_FIELDS:
            setattr(twin, name, getattr(self, name))
        for name in ROW_FIELDS:
            setattr(twin, name, np.concatenate((getattr(self, name), getattr(other, name))))
        return twin

    def use_frame(self, frame: tuple[str, ...], class_names: tuple[str, ...]) -> None:
        """Make the beliefs speak of ``frame`` and ``class_names``.

        If they spoke of others (the classes were changed while running), what was believed is void:
        all masses go to total ignorance, all classes become equally likely.
        """
        if frame == self.frame and class_names == self.class_names:
            return
        h = len(self)
        self.frame, self.class_names = frame, class_names
        self.focal = np.array([(1 << ((1 << len(frame)) - 1)) - 1], dtype=np.uint32)
        self.masses = np.ones((h, 1))
        self.class_probability = np.full((h, len(class_names)), 1.0 / max(len(class_names), 1))
        self.conflict = np.zeros(h)
        self.clear_windows(self.window_kind.shape[1])

    def clear_windows(self, rows: int) -> None:
        """Let every hypothesis have a history window of so many rows with nothing in it."""
        h = len(self)
        self.window_focal = np.zeros(0, dtype=np.uint32)
        self.window_kind = np.zeros((h, rows), dtype=np.int32)
        self.window_masses = empty_floats(h, rows, 0)
        classes = len(self.class_names) if rows else 0
        self.window_log_class_likelihood = empty_floats(h, rows, classes)

    def use_focal(self, focal: MaskArray) -> None:
        """Widen the focal columns so that they start with ``focal``; no mass is lost."""
        if np.array_equal(focal, self.focal):
            return
        carried = self.focal[(self.masses != 0.0).any(axis=0)]
        extra = carried[~np.isin(carried, focal)]
        columns = np.concatenate([focal, extra]).astype(np.uint32)
        self.masses = move_columns(self.masses, self.focal, columns)
        self.focal = columns


def move_columns(masses: FloatArray, focal: MaskArray, columns: MaskArray) -> FloatArray:
    """Masses (N, E) over ``focal`` as masses over ``columns``; these hold all that carry mass."""
    moved = np.zeros((len(masses), len(columns)))
    order = np.argsort(columns, kind="stable")
    place = np.searchsorted(columns, focal, sorter=order)
    place = order[np.minimum(place, len(columns) - 1)] if len(columns) else place
    present = columns[place] == focal if len(columns) else np.zeros(len(focal), dtype=bool)
    moved[:, place[present]] = masses[:, present]
    return moved


WHOLE_FIELDS = (
    "frame",
    "focal",
    "class_names",
    "window_focal",
    "models",
    "spread",
    "cell_members",
)
ALL_FIELDS = tuple(f.name for f in fields(HypothesisTable))
ROW_FIELDS = tuple(name for name in ALL_FIELDS if name not in WHOLE_FIELDS)
