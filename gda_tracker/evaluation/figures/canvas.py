"""What all pictures share: colours, fonts, and rendering without a display."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

# Okabe and Ito's palette: told apart by colour-blind readers too. Dark ones first, for lines.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
INK = "#222222"
GREY = "#8a8a8a"
PALE = "#c9ccd1"

_STYLE: Any = {
    "axes.edgecolor": "#666666",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 10,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "figure.facecolor": "white",
    "font.family": "sans-serif",
    "font.size": 10,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.7,
    "legend.fontsize": 9,
    "legend.framealpha": 0.9,
    "legend.frameon": False,
    "lines.solid_capstyle": "round",
    "text.color": INK,
    "xtick.color": "#444444",
    "xtick.labelsize": 9,
    "ytick.color": "#444444",
    "ytick.labelsize": 9,
}


class MissingPlotLibraryError(ImportError):
    """matplotlib is not installed; the message names the command that installs it."""


def require_matplotlib() -> None:
    """Raise :class:`MissingPlotLibraryError` unless matplotlib can be imported."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MissingPlotLibraryError(
            "pictures need matplotlib, install it with: pip install matplotlib"
        ) from error


@contextmanager
def canvas(
    width_in: float, height_in: float, layout: Literal["constrained", "compressed"] = "constrained"
) -> Iterator[Any]:
    """Yield an empty figure; what is drawn inside the ``with`` has the common style.

    ``layout`` is matplotlib's, ``compressed`` for panels of equal aspect side by side.

    The figure belongs to nobody else: no window, no global state, safe in any thread.
    """
    require_matplotlib()
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(width_in, height_in), layout=layout)
        FigureCanvasAgg(figure)
        yield figure


def colour(index: int) -> str:
    """Colour of the ``index``-th target, track or method."""
    return COLOURS[index % len(COLOURS)]


def legend_below(figure: Any, axes: Any, columns: int) -> None:
    """Put one legend for the entries of ``axes`` under the panels, where it hides no data."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def png(figure: Any, dpi: int = 130) -> bytes:
    """Render a figure as PNG; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(
        buffer,
        format="png",
        dpi=dpi,
        bbox_inches="tight",
        pad_inches=0.1,
        metadata={"Software": None},
    )
    return buffer.getvalue()
