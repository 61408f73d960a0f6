"""The table that declares what the marker layers look like, and which there are."""

from __future__ import annotations

import re
from dataclasses import dataclass

from gda_tracker.parameters import ParameterError, parameter

# Each is published on the topic markers/<layer>.
LAYERS = (
    "detections",
    "associations",
    "gates",
    "tracks",
    "velocities",
    "covariances",
    "labels",
    "trails",
    "tracks_delayed",
    "sensors",
    "formations",
)
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"
COLOUR_SOURCES = ("class", "status", "track")
# By name too, for in YAML and on a command line a # begins a comment unless it stands in quotes.
COLOUR_NAMES = {
    "white": "#ffffff",
    "black": "#000000",
    "grey": "#999999",
    "red": "#ff0000",
    "orange": "#e69f00",
    "sky_blue": "#56b4e9",
    "green": "#009e73",
    "yellow": "#f0e442",
    "blue": "#0072b2",
    "vermillion": "#d55e00",
    "purple": "#cc79a7",
}
_COLOUR = re.compile(r"#([0-9a-fA-F]{6})([0-9a-fA-F]{2})?")

Colour = tuple[float, float, float, float]


def marker_topic(layer: str) -> str:
    """Return the topic of a layer, relative to the namespace."""
    return f"markers/{layer}"


def marker_topics() -> list[str]:
    """Return ``topic=type`` of all layers, as parameter ``also`` of node ``recorder`` takes it."""
    return [f"{marker_topic(layer)}={MARKER_ARRAY}" for layer in LAYERS]


def colour_of(text: str) -> Colour:
    """Return red, green, blue and opacity, 0 to 1 each, of ``#rrggbb``, ``#rrggbbaa`` or a name.

    Raises
    ------
    ParameterError
        If it is none.
    """
    found = _COLOUR.fullmatch(COLOUR_NAMES.get(text, text))
    if found is None:
        raise ParameterError(
            f"colour {text!r}: allowed is '#rrggbb' or '#rrggbbaa' in quotes, or one of "
            f"{', '.join(COLOUR_NAMES)}"
        )
    red, green, blue, opacity = bytes.fromhex(found[1] + (found[2] or "ff"))
    return red / 255.0, green / 255.0, blue / 255.0, opacity / 255.0


@dataclass(frozen=True)
class MarkerParameters:
    """Which layers are published, and what they look like."""

    layers: list[str] = parameter(
        list(LAYERS), "layers that are published, each on the topic markers/<layer>", choices=LAYERS
    )
    scale: float = parameter(
        1.0,
        "all sizes below times this: 1 suits a road, 10 to 30 the sea",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e6,
    )
    show_tentative: bool = parameter(True, "show tracks that are not confirmed yet, too")
    colour_by: str = parameter(
        "class",
        "what gives a confirmed track its colour: class (the most probable one), status (all the "
        "same) or track (its number, to tell neighbours apart)",
        choices=COLOUR_SOURCES,
    )
    class_colours: list[str] = parameter(
        [],
        "colours of classes as class=colour, e.g. cargo=#0072b2 or cargo=blue; those that are not "
        "named take one of eight that colour-blind people can tell apart",
    )
    confirmed_colour: str = parameter(
        "#009e73", "colour of confirmed tracks with colour_by status", advanced=True
    )
    tentative_colour: str = parameter("#999999", "colour of tentative tracks", advanced=True)
    detection_colour: str = parameter("#f0e442", "colour of detections", advanced=True)
    association_colour: str = parameter(
        "#f0e442a0", "colour of the lines from tracks to the detections they took", advanced=True
    )
    gate_colour: str = parameter("#56b4e9a0", "colour of gates", advanced=True)
    delayed_colour: str = parameter(
        "#cc79a7", "colour of the revised past (tracks_delayed)", advanced=True
    )
    sensor_colour: str = parameter("#ffffff", "colour of sensors", advanced=True)
    formation_colour: str = parameter("#e69f00", "colour of formations", advanced=True)
    ellipse_probability: float = parameter(
        0.95,
        "chance that the target lies in the ellipse of its covariance",
        minimum=0.0,
        minimum_excluded=True,
        maximum=0.999999,
    )
    ellipse_opacity: float = parameter(
        0.25, "opacity of the ellipses", minimum=0.0, maximum=1.0, advanced=True
    )
    detection_size_m: float = parameter(
        1.0, "diameter of a detection", unit="m", minimum=0.0, minimum_excluded=True, maximum=1e6
    )
    track_size_m: float = parameter(
        2.0, "diameter of a track", unit="m", minimum=0.0, minimum_excluded=True, maximum=1e6
    )
    label_size_m: float = parameter(
        2.0, "height of a label", unit="m", minimum=0.0, minimum_excluded=True, maximum=1e6
    )
    line_width_m: float = parameter(
        0.2,
        "width of lines: gates, trails, associations",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e6,
    )
    formation_margin_m: float = parameter(
        5.0,
        "width of the margin between a formation's outermost tracks and its outline",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e6,
    )
    velocity_s: float = parameter(
        2.0,
        "an arrow ends where its track will be in so long",
        unit="s",
        minimum=0.0,
        minimum_excluded=True,
        maximum=3600.0,
    )
    detection_persistence_s: float = parameter(
        0.0,
        "detections stay for so long, by the time of the scans; 0: those of the last scan of each "
        "sensor",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    curve_farthest_m: float = parameter(
        20_000.0,
        "how far bearings and the hyperbolas of time differences are drawn",
        unit="m",
        minimum=0.0,
        minimum_excluded=True,
        maximum=1e7,
    )
    trail_scans: int = parameter(
        50, "scans that the trail of a track reaches back", minimum=2, maximum=2000
    )
    delayed_scans: int = parameter(
        50, "the same of the revised past", minimum=2, maximum=2000, advanced=True
    )
    height_m: float = parameter(
        0.0,
        "z of everything in the tracking frame: tracks are made in its plane",
        unit="m",
        minimum=-1e5,
        maximum=1e5,
        advanced=True,
    )
    lifetime_s: float = parameter(
        0.0,
        "markers vanish by themselves after so long without news, by the clock of the viewer; 0: "
        "they stay until their track ends",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )

    def __post_init__(self) -> None:
        """Refuse what is no colour."""
        for name in (
            "confirmed_colour",
            "tentative_colour",
            "detection_colour",
            "association_colour",
            "gate_colour",
            "delayed_colour",
            "sensor_colour",
            "formation_colour",
        ):
            self.colour(name)
        self.colours_of_classes()

    def colour(self, name: str) -> Colour:
        """Return the colour that a parameter names."""
        try:
            return colour_of(getattr(self, name))
        except ParameterError as error:
            raise ParameterError(f"parameter {name}: {error}") from error

    def colours_of_classes(self) -> dict[str, Colour]:
        """Return the colours of the classes that are named."""
        found: dict[str, Colour] = {}
        for entry in self.class_colours:
            name, sign, text = (part.strip() for part in entry.partition("="))
            if not sign or not name or name in found:
                raise ParameterError(
                    f"parameter class_colours: {entry!r}, allowed are entries class=colour that "
                    "differ"
                )
            try:
                found[name] = colour_of(text)
            except ParameterError as error:
                raise ParameterError(f"parameter class_colours: {error}") from error
        return found
