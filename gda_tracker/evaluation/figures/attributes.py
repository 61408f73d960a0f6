"""Beliefs on classes: where they come from, how they go on, how sure they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import cycle
from typing import Any

import numpy as np

from gda_tracker.attributes.fuzzification import RcsFuzzifier
from gda_tracker.attributes.rcs import density
from gda_tracker.evaluation.figures.canvas import GREY, INK, canvas, colour, legend_below
from gda_tracker.evidence.decisions import pignistic_entropy
from gda_tracker.evidence.frames import Model, free_model, shafer_model
from gda_tracker.vocabulary.arrays import FloatArray
from gda_tracker.vocabulary.tracks import Tracks

RCS_POINTS = 1500
THETA_1_COLOUR, THETA_2_COLOUR = "#0072b2", "#c1272d"
RUN_ALPHA = 0.16
LINE_STYLES = ("-", "--", "-.", ":")


def class_colours(n_classes: int) -> list[str]:
    """Grey for class 0, the false alarm, then the colours of targets."""
    return [GREY, *(colour(index) for index in range(n_classes - 1))]


def membership_functions(fuzzifier: RcsFuzzifier) -> Any:
    """Draw how the fuzzifier reads a radar cross section.

    On the left the grades of membership of each label, with the exact densities of the classes (per
    bin, where the grades are shares of draws per bin); on the right the masses that a detection of
    this RCS gets.
    """
    p = fuzzifier.parameters
    largest = max(p.class_rcs_mean_m2)
    rcs = np.geomspace(0.1 * min(p.class_rcs_mean_m2), 4.0 * largest, RCS_POINTS)
    grades = fuzzifier.membership(rcs)
    masses = grades / grades.sum(axis=1, keepdims=True)
    histogram = p.membership == "histogram"
    per_bin = histogram and p.histogram_normalisation == "area"
    exact = density(rcs[:, None], np.array(p.class_rcs_mean_m2), np.array(p.class_rcs_swerling))
    tints = class_colours(len(p.class_labels))
    with canvas(9.6, 3.7) as figure:
        left, right = figure.subplots(1, 2, sharex=True)
        for index, label in enumerate(p.class_labels):
            name = p.class_names[index].replace("_", " ")
            entry = f"{label}: {name}, mean {p.class_rcs_mean_m2[index]:g} m²"
            left.plot(rcs, grades[:, index], color=tints[index], lw=1.8, label=entry)
            right.plot(rcs, masses[:, index], color=tints[index], lw=1.8)
            if per_bin:
                curve = exact[:, index] * p.histogram_bin_width_m2
                left.plot(rcs, curve, "--", color=INK, lw=0.8)
        if per_bin:
            left.plot([], [], "--", color=INK, lw=0.8, label="exact Swerling density per bin")
        left.set_title("Grade of membership")
        left.set_ylabel("share of draws per bin" if per_bin else "grade [1]")
        right.set_title("Belief of one detection")
        right.set_ylabel("mass m [1]")
        right.set_ylim(0.0, 1.02)
        for axes in (left, right):
            axes.set_xscale("log")
            axes.set_xlim(rcs[0], rcs[-1])
            axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
            axes.set_xlabel("radar cross section [m²]")
        legend_below(figure, left, 2)
    return figure


def class_beliefs(
    runs: Sequence[Sequence[Tracks]],
    track_names: Sequence[str],
    *,
    shown: int = 0,
    first_scan: int = 1,
) -> Any:
    """Draw the class probabilities of each track over the scans.

    Parameters
    ----------
    runs
        Tracks of each run, one entry per scan; the i-th track by id is the same in every run.
    track_names
        What the tracks follow, in the order of their ids.
    shown
        Run drawn with strong lines; the others are pale.
    first_scan
        Number of the first scan.
    """
    classes = runs[shown][0].class_names
    tints = class_colours(len(classes))
    with canvas(9.6, 3.6) as figure:
        panels = figure.subplots(1, len(track_names), sharey=True, squeeze=False)[0]
        for place, (axes, name) in enumerate(zip(panels, track_names, strict=True)):
            for index, tracks in enumerate(runs):
                belief = _per_scan(tracks, place, lambda t: t.class_probability)
                scans = first_scan + np.arange(len(belief))
                for row, tint in enumerate(tints):
                    strong = index == shown
                    axes.plot(
                        scans,
                        belief[:, row],
                        color=tint,
                        lw=2.0 if strong else 1.0,
                        alpha=1.0 if strong else RUN_ALPHA,
                        zorder=3 if strong else 2,
                        label=classes[row].replace("_", " ") if strong else None,
                    )
            axes.axhline(1.0 / len(classes), color=INK, lw=0.8, ls=":")
            axes.set_title(f"Track started on the {name}")
            axes.set_xlabel("scan")
            axes.set_ylim(0.0, 1.02)
        panels[0].set_ylabel("class probability [1]")
        panels[0].plot([], [], ":", color=INK, lw=0.8, label="all classes alike")
        legend_below(figure, panels[0], len(classes) + 1)
    return figure


def pignistic_entropies(
    runs: Sequence[Sequence[Tracks]], track_names: Sequence[str], *, first_scan: int = 1
) -> Any:
    """Draw the pignistic entropy of the tracks' attribute histories in both frames.

    Above on the free model of the labels (Theta 1), below after the hybrid projection onto Shafer's
    model of the classes (Theta 2), as in figure 14.8 of Tchamova et al. (2004). Strong lines are
    means over the runs, pale ones the runs; the dotted line is the largest entropy possible.
    Parameters as in :func:`class_beliefs`.

    Raises
    ------
    ValueError
        If the tracks carry no masses.
    """
    frame, classes = runs[0][0].frame, runs[0][0].class_names
    if not frame or not runs[0][0].masses.size:
        raise ValueError("the tracks carry no masses: their attribute term works without")
    free, shafer = free_model(frame), shafer_model(frame)
    labels = ", ".join(frame)
    names = ", ".join(name.replace("_", " ") for name in classes)
    rows = (
        (free, THETA_1_COLOUR, rf"$\Theta_1$ = {{{labels}}}, free DSm model"),
        (shafer, THETA_2_COLOUR, rf"$\Theta_2$ = {{{names}}}, hybrid model = Shafer's"),
    )
    with canvas(8.2, 5.8) as figure:
        panels = figure.subplots(2, 1, sharex=True)
        for axes, (model, tint, title) in zip(panels, rows, strict=True):
            for place, style in zip(range(len(track_names)), cycle(LINE_STYLES), strict=False):
                curves = [_entropies(tracks, place, model) for tracks in runs]
                scans = first_scan + np.arange(len(curves[0]))
                for curve in curves:
                    axes.plot(scans, curve, style, color=tint, lw=0.8, alpha=RUN_ALPHA)
                axes.plot(scans, np.mean(curves, axis=0), style, color=tint, lw=2.2)
            most = np.log2(int(model.alive).bit_count())
            axes.axhline(most, color=INK, lw=0.9, ls=":")
            axes.set_title(title)
            axes.set_ylabel("entropy [bit]")
            axes.set_ylim(0.0, 1.08 * most)
        for name, style in zip(track_names, cycle(LINE_STYLES), strict=False):
            label = f"track started on the {name}, mean of {len(runs)} runs"
            panels[0].plot([], [], style, color=INK, lw=2.2, label=label)
        panels[0].plot([], [], "-", color=INK, lw=0.8, alpha=0.4, label="the same, one run")
        panels[0].plot([], [], ":", color=INK, lw=0.9, label="maximum")
        panels[-1].set_xlabel("scan")
        legend_below(figure, panels[0], 2)
    return figure


def _entropies(tracks: Sequence[Tracks], place: int, model: Model) -> FloatArray:
    return _per_scan(tracks, place, lambda t: pignistic_entropy(model, t.focal, t.masses))


def _per_scan(
    tracks: Sequence[Tracks], place: int, value: Callable[[Tracks], FloatArray]
) -> FloatArray:
    """Value of the ``place``-th track by id on every scan, NaN where it does not live."""
    ids = np.unique(np.concatenate([t.track_id for t in tracks]))
    rows = [np.flatnonzero(t.track_id == ids[place]) for t in tracks]
    values = [value(t)[row[0]] if len(row) else None for t, row in zip(tracks, rows, strict=True)]
    shape = next(np.shape(v) for v in values if v is not None)
    return np.array([np.full(shape, np.nan) if v is None else v for v in values])
