"""The parameter table of track fusion."""

from __future__ import annotations

from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter

EQUIVALENT_MEASUREMENTS = "equivalent_measurements"
INDEPENDENT = "independent"
COVARIANCE_INTERSECTION = "covariance_intersection"
FUSION_RULES = (EQUIVALENT_MEASUREMENTS, INDEPENDENT, COVARIANCE_INTERSECTION)

SAME_FRAME, POSES, TF = "same_frame", "poses", "tf"

DIFFUSE = -1.0
MOST_RADARS = 8


@dataclass(frozen=True)
class TrackFusionParameters:
    """Which radars, how far they are trusted, how their tracks are associated and fused."""

    radars: list[str] = parameter(
        ["radar_1", "radar_2"],
        f"names of 2 to {MOST_RADARS} radars; the tracks of each are read from NAME/tracks",
        live=False,
    )
    tracks_topics: list[str] = parameter(
        [], "topics of their tracks, one entry per radar; empty: NAME/tracks", live=False
    )
    fusion_frame: str = parameter("map", "frame of the fused tracks", live=False)
    alignment: str = parameter(
        SAME_FRAME,
        "how tracks come into the fusion_frame: same_frame (they are in it, others are refused), "
        "poses (radar_poses) or tf (transforms from /tf at the time of the tracks)",
        choices=(SAME_FRAME, POSES, TF),
        live=False,
    )
    radar_poses: list[float] = parameter(
        [],
        "alignment poses: x [m], y [m] and yaw [rad] of each radar's tracking frame in the "
        "fusion_frame, 3 numbers per radar",
        live=False,
    )
    bias_std_m: list[float] = parameter(
        [],
        "standard deviation of each radar's bias, a shift of all its positions, per coordinate: "
        "0 for none, -1 for unknown; empty: unknown for all, and then only the biases relative to "
        "the first radar can be told",
        unit="m",
        minimum=-1.0,
        maximum=1e6,
        live=False,
    )
    bias_memory_s: float = parameter(
        0.0,
        "time after which what was learnt of the biases counts only exp(-1) as much; 0: biases "
        "are constant for ever",
        unit="s",
        minimum=0.0,
    )
    fusion_rule: str = parameter(
        EQUIVALENT_MEASUREMENTS,
        "how tracks of one target are fused: equivalent_measurements (what each radar learnt since "
        "its last report, which is independent of the others), independent (the tracks as if their "
        "errors were independent) or covariance_intersection (whatever their correlation)",
        choices=FUSION_RULES,
    )
    track_process_noise_std_mps2: float = parameter(
        2.0,
        "process noise that the radars' own trackers use, an acceleration constant for a scan; "
        "less than theirs is cautious, more counts the same detections twice",
        unit="m/s2",
        minimum=0.0,
    )
    process_noise_density_m2ps3: float = parameter(
        4.0,
        "process noise of fused tracks: power spectral density of a white acceleration",
        unit="m2/s3",
        minimum=0.0,
    )
    track_probability: list[float] = parameter(
        [0.9],
        "chance that a target has a track of the radar, one entry for all radars or one each",
        minimum=0.0,
        minimum_excluded=True,
        maximum=0.999999,
    )
    expected_false_tracks: list[float] = parameter(
        [0.1],
        "mean number of tracks without a target, one entry for all radars or one each",
        minimum=0.0,
        maximum=1e6,
    )
    region_std_m: float = parameter(
        10000.0,
        "standard deviation of the targets' positions about their unknown centre, per coordinate",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e7,
    )
    speed_std_mps: float = parameter(
        200.0,
        "standard deviation of the targets' velocities, per coordinate",
        unit="m/s",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e5,
    )
    class_reliability: float = parameter(
        0.95, "share of the class beliefs that counts, the rest tells nothing", minimum=0.0,
        maximum=1.0,
    )  # fmt: skip
    class_belief_prior: list[str] = parameter(
        [],
        "prior of the classes that is in the class beliefs, as class=number; empty: all alike",
    )
    switching_odds: float = parameter(
        20.0,
        "how many times as probable an association must be before a track leaves its company, or "
        "two that stood apart join",
        minimum=1.0,
        maximum=1e12,
    )
    late_after_s: float = parameter(
        5.0, "a radar whose last tracks are older than this is late", unit="s", minimum=0.0
    )
    silent_after_s: float = parameter(
        15.0,
        "a radar whose last tracks are older than this is silent: its tracks no longer count",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
    )
    time_jump_s: float = parameter(
        10.0,
        "a radar's stamps that step back by more begin the fusion anew, less is refused",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        advanced=True,
    )
    tentative: bool = parameter(False, "use tracks that are not confirmed yet, too")
    max_tracks_per_radar: int = parameter(
        200, "messages with more tracks are refused", minimum=1, maximum=400, advanced=True
    )
    max_associated_tracks: int = parameter(
        100,
        "tracks of all radars that are associated together; where more come near each other they "
        "stay as they were",
        minimum=2,
        maximum=1000,
        advanced=True,
    )
    track_memory_s: float = parameter(
        20.0,
        "what was learnt of the biases until so long ago helps to associate: later than that it "
        "comes from the same detections as the tracks",
        unit="s",
        minimum=0.0,
        advanced=True,
    )
    bias_minimum_probability: float = parameter(
        0.9,
        "tracks that belong together at least as probably tell of the biases",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
    )
    bias_reset_fusions: int = parameter(
        3,
        "after so many fusions in a row in which another bias would join more tracks, what was "
        "learnt of the biases is dropped",
        minimum=1,
        advanced=True,
    )
    max_enumerated: int = parameter(
        2000,
        "up to so many associations all are scored, beyond they are sampled",
        minimum=1,
        maximum=1_000_000,
        advanced=True,
    )
    sampling_sweeps: int = parameter(
        8, "times that each sensor is drawn anew when sampling", minimum=1, maximum=1000,
        advanced=True,
    )  # fmt: skip
    top_associations: int = parameter(
        10, "associations that are published", minimum=1, maximum=1000, advanced=True
    )

    def __post_init__(self) -> None:
        """Refuse lists whose lengths do not go together."""
        n = len(self.radars)
        if not 2 <= n <= MOST_RADARS or len(set(self.radars)) < n or not all(self.radars):
            raise ParameterError(
                f"parameter radars = {self.radars}: allowed are 2 to {MOST_RADARS} names that "
                "differ"
            )
        self._check_length("tracks_topics", (0, n))
        if len(set(self.topics)) < n:
            raise ParameterError(
                f"parameter tracks_topics = {self.tracks_topics}: allowed are topics that differ"
            )
        self._check_length("bias_std_m", (0, n))
        for value in self.bias_std_m:
            if value < 0.0 and value != DIFFUSE:
                raise ParameterError(
                    f"parameter bias_std_m = {self.bias_std_m}: allowed are numbers >= 0, and -1"
                )
        self._check_length("track_probability", (1, n))
        self._check_length("expected_false_tracks", (1, n))
        self._check_length("radar_poses", (3 * n,) if self.alignment == POSES else (0, 3 * n))
        if self.late_after_s > self.silent_after_s:
            raise ParameterError(
                f"parameter late_after_s = {self.late_after_s:g}: allowed is at most "
                f"silent_after_s = {self.silent_after_s:g}"
            )
        self.class_weights()

    def _check_length(self, name: str, allowed: tuple[int, ...]) -> None:
        length = len(getattr(self, name))
        if length not in allowed:
            sizes = " or ".join(str(size) for size in dict.fromkeys(allowed))
            raise ParameterError(
                f"parameter {name} = {getattr(self, name)}: allowed are {sizes} entries"
            )

    @property
    def topics(self) -> list[str]:
        """Topic of each radar's tracks."""
        return self.tracks_topics or [f"{name}/tracks" for name in self.radars]

    def of_radars(self, name: str) -> list[float]:
        """Return a list that holds one number for all radars, or one each, as one each."""
        values: list[float] = getattr(self, name)
        return values * len(self.radars) if len(values) == 1 else values

    def class_weights(self) -> dict[str, float]:
        """Return ``class_belief_prior`` as numbers by class.

        Raises
        ------
        ParameterError
            If an entry is no class with a positive number.
        """
        found: dict[str, float] = {}
        for entry in self.class_belief_prior:
            name, sign, text = (part.strip() for part in entry.partition("="))
            try:
                number = float(text)
            except ValueError:
                number = -1.0
            if not sign or not name or name in found or not 0.0 < number < float("inf"):
                raise ParameterError(
                    f"parameter class_belief_prior: {entry!r}, allowed are entries class=number "
                    "with numbers > 0 and classes that differ"
                )
            found[name] = number
        return found
