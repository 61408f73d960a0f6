"""What ``docs/evidence-flow.md`` says about its scan: the text of every generated block."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from evidence_flow_case import CHAPTER, HYPOTHESES, LIKELIHOOD, METHODS, SEED, Case, weights

from gda_tracker.evaluation.summary import Run, run_purity
from gda_tracker.evidence.frames import element_name
from gda_tracker.kinematics.gating import gate_threshold

TRACKS, DETECTIONS = ("T1", "T2"), ("O1", "O2")


def blocks(case: Case) -> dict[str, str]:
    """Text of every generated block of the page."""
    writers: tuple[Callable[[Case], str], ...] = (
        rule,
        kinematics,
        hypotheses,
        fuzzification,
        masses,
        histories,
        distances,
        pairs,
        likelihoods,
        outcome,
    )
    return {writer.__name__: writer(case) for writer in writers}


def rule(case: Case) -> str:
    """Where the scan comes from."""
    result, truth = case.result(CHAPTER), case.play.truth[case.shown]
    gap = np.hypot(*(truth.target_state[0, :2] - truth.target_state[1, :2]))
    scan = result.scan
    head = ["detection", "range [m]", "azimuth [deg]", "radar cross section [m²]", "comes from"]
    rows = [
        [
            name,
            f"{scan.range_m[row]:.0f}",
            f"{np.degrees(scan.azimuth_rad[row]):.2f}",
            f"{scan.rcs_m2[row]:.3f}",
            f"the {kind}",
        ]
        for name, row, kind in zip(DETECTIONS, case.rows, truth.target_class, strict=True)
    ]
    return (
        f"The first such scan of seed {SEED} is scan {case.number} of run {case.run}. "
        f"The two aircraft are {gap:.0f} m apart. "
        f"The scan has {len(scan)} detections, of which two lie in "
        f"gates, and both lie in both:\n\n{markdown(head, rows)}"
    )


def kinematics(case: Case) -> str:
    """Gate and kinematic likelihood of each pair."""
    settings = case.result(CHAPTER).predictions.settings
    head = ["pair", "d²", "log g [log 1/(m rad)]", "P_k"]
    columns = [
        case.table(CHAPTER, "associations", name)
        for name in ("mahalanobis_squared", "kinematic_log_likelihood", "p_kinematic")
    ]
    own = columns[2][0, 0]
    return (
        f"{pair_rows(head, columns)}\n\nThe gate ends at d² = "
        f"{gate_threshold(settings.gate_probability):.3g}. P_d is "
        f"{case.result(CHAPTER).predictions.detection_probability[0]:g}, beta "
        f"{settings.clutter_density:g} per m and rad. Kinematics give the right pairing a "
        f"probability of {own:.3f} and the swap {columns[2][0, 1]:.3f}: alone they swap the tracks."
    )


def hypotheses(case: Case) -> str:
    """The seven joint hypotheses, as in the chapter's tables 14.2 and 14.3."""
    found = weights(case)
    head = ["hypothesis", *TRACKS, "P_k(H), step 1", "P_a(H), step 6", "with class likelihoods"]
    rows = []
    for index, hypothesis in enumerate(HYPOTHESES):
        taken = [DETECTIONS[d - 1] if d else "none" for d in hypothesis]
        rows.append([f"H{index + 1}", *taken, *(f"{w[index]:.4g}" for w in found.values())])
    return markdown(head, rows)


def fuzzification(case: Case) -> str:
    """Grades of membership of each detection."""
    result, fuzzifier = case.result(CHAPTER), case.rings[CHAPTER].fuzzifier
    rcs = result.scan.rcs_m2[case.rows]
    grades = fuzzifier.membership(rcs)
    frame = result.evidence.frame
    head = ["detection", "radar cross section [m²]", *(f"mu_{label}" for label in frame)]
    rows = [
        [name, f"{value:.3f}", *(f"{grade:.5f}" for grade in row)]
        for name, value, row in zip(DETECTIONS, rcs, grades, strict=True)
    ]
    return markdown(head, rows)


def masses(case: Case) -> str:
    """Masses of each detection."""
    evidence = case.result(CHAPTER).evidence
    names = list(mass_of(evidence.frame, evidence.focal, evidence.masses[0]))
    own = evidence.masses[case.rows]
    rows = [[n, *(f"{m:.4f}" for m in row)] for n, row in zip(DETECTIONS, own, strict=True)]
    best = [names[column] for column in own.argmax(axis=1)]
    return (
        markdown(["detection", *(f"m({name})" for name in names)], rows)
        + f"\n\nMost of O1's mass, {own[0].max():.3f}, lies on {best[0]}, most of O2's, "
        f"{own[1].max():.3f}, on {best[1]}."
    )


def histories(case: Case) -> str:
    """Masses of histories and candidates, conflict, and one mass worked out by hand."""
    result = case.result(CHAPTER)
    frame, scores, before = result.evidence.frame, result.scores, result.predictions
    columns = {}
    for row, track in enumerate(TRACKS):
        columns[f"{track} history"] = mass_of(frame, before.focal, before.masses[row])
        for column, detection in enumerate(DETECTIONS):
            values = scores.masses[case.pairs()[row, column]]
            columns[f"{track} with {detection}"] = mass_of(frame, scores.focal, values)
    # The products of history and measurement whose elements meet in S∩B.
    factors = [("B", "S"), ("S", "B"), ("S∩B", "S"), ("S∩B", "B")]
    rows = [
        [f"m({element})", *(small(c.get(element, 0.0)) for c in columns.values())]
        for element in columns["T1 with O1"]
        if any(c.get(element, 0.0) > 0.0 for c in columns.values())
    ]
    conflict = [[f"{c:.3f}" for c in row] for row in case.table(CHAPTER, "scores", "conflict")]
    rows.append(["conflict", "", *conflict[0], "", *conflict[1]])
    history = columns["T2 history"]
    evidence = result.evidence
    own = mass_of(frame, evidence.focal, evidence.masses[case.rows[0]])
    names = ", ".join(f"m_hist({one}) m({two})" for one, two in factors)
    terms = " + ".join(f"{small(history[one])} * {own[two]:.4f}" for one, two in factors)
    total = sum(history[one] * own[two] for one, two in factors)
    largest = [
        max(columns[f"{track} history"].items(), key=lambda item: item[1]) for track in TRACKS
    ]
    (one, first), (two, second) = largest
    return (
        f"{markdown(['', *columns], rows)}\n\nThe largest mass of T1's history, {first:.3f}, is on "
        f"{one}, that of T2's, {second:.3f}, on {two}.\n\nOne mass by hand, S∩B of T2 with O1. "
        f"The products that meet in S∩B are {names}: {terms} = {three(total)}."
    )


def distances(case: Case) -> str:
    """Distances, their products and P'_a."""
    d = case.table(CHAPTER, "scores", "distance")
    own, swap = d[0, 0] * d[1, 1], d[0, 1] * d[1, 0]
    p = own / (own + swap)
    return (
        f"{pair_rows(['pair', 'd_e'], [d])}\n\nEach its own: {three(d[0, 0])} * {three(d[1, 1])} = "
        f"{three(own)}. Swapped: {three(d[0, 1])} * {three(d[1, 0])} = {three(swap)}. So "
        f"P'_a(T1, O1) = {three(own)} / ({three(own)} + {three(swap)}) = {three(p)} and "
        f"P_a(T1, O1) = {1.0 - p:.4g}."
    )


def pairs(case: Case) -> str:
    """The table of pairs, and the two sums that Munkres compares."""
    names = (
        ("associations", "kinematic_log_likelihood"),
        ("associations", "p_kinematic"),
        ("scores", "distance"),
        ("associations", "p_attribute"),
        ("associations", "p_generalised"),
    )
    columns = [case.table(CHAPTER, stage, name) for stage, name in names]
    chosen = case.table(CHAPTER, "associations", "chosen")
    cost = 1.0 - columns[-1]
    head = ["pair", "log g", "P_k", "d_e", "P_a", "P_gen = P_k P_a", "a = 1 - P_gen", "chosen"]
    table = pair_rows(head, [*columns, cost, np.where(chosen, "yes", "no")])
    return (
        f"{table}\n\nEach its own costs {cost[0, 0]:.3f} + {cost[1, 1]:.3f} = "
        f"{np.trace(cost):.3f}, the swap {cost[0, 1]:.3f} + {cost[1, 0]:.3f} = "
        f"{cost[0, 1] + cost[1, 0]:.3f}."
    )


def likelihoods(case: Case) -> str:
    """The other way: class probabilities times class likelihoods."""
    result = case.result(LIKELIHOOD)
    evidence, before = result.evidence, result.predictions
    names = [name.replace("_", " ") for name in evidence.class_names]
    density = np.exp(evidence.log_class_likelihood[case.rows])
    known = before.class_probability
    rows = [[f"P(c \\| {t})", *map(three, row)] for t, row in zip(TRACKS, known, strict=True)]
    rows += [
        [f"f({d} \\| c) [1/m²]", *map(three, row)]
        for d, row in zip(DETECTIONS, density, strict=True)
    ]
    log_l = case.table(LIKELIHOOD, "scores", "log_likelihood")
    log_g = case.table(LIKELIHOOD, "associations", "kinematic_log_likelihood")
    marginal = case.table(LIKELIHOOD, "associations", "joint_marginal")
    chosen = np.where(case.table(LIKELIHOOD, "associations", "chosen"), "yes", "no")
    terms = " + ".join(
        f"{three(p)} * {three(f)}" for p, f in zip(known[0], density[0], strict=True)
    )
    total = known[0] @ density[0]
    head = ["pair", "log g", "log l", "log g + log l", "joint marginal", "chosen by map"]
    sums = log_g + log_l
    own, swap = np.trace(sums), sums[0, 1] + sums[1, 0]
    kinematic = (log_g[0, 1] + log_g[1, 0]) - np.trace(log_g)
    return (
        f"{markdown(['', *names], rows)}\n\nT1 with O1: {terms} = {three(total)} per m², "
        f"log l = {np.log(total):.3f}.\n\n{pair_rows(head, [log_g, log_l, sums, marginal, chosen])}"
        f"\n\nEach its own: {added(sums[0, 0], sums[1, 1])}, swapped: "
        f"{added(sums[0, 1], sums[1, 0])}. The kinematics speak for the swap by "
        f"{kinematic:.3f}, the radar cross sections for each its own by "
        f"{own - swap + kinematic:.3f}; the difference is {own - swap:.3f}, "
        f"a factor of {np.exp(own - swap):.3g}."
    )


def outcome(case: Case) -> str:
    """What comes of it in this run, and how such scans end in all runs."""
    purity = {
        name: run_purity(Run([r.tracks for r in results], case.play.truth))
        for name, results in case.results.items()
    }
    first = ", ".join(f"`{name}` {value:.2f}" for name, value in purity.items())
    total = sum(case.contested.values())
    head = ["method", "right", "right where kinematics are wrong", "wrong where they are right"]
    rows = []
    for index, name in enumerate(METHODS):
        counts = [
            sum(n for verdict, n in case.contested.items() if wanted(verdict[0], verdict[index]))
            for wanted in (
                lambda _, own: own,
                lambda base, own: own and not base,
                lambda base, own: base and not own,
            )
        ]
        cells = [str(counts[0]), *(map(str, counts[1:]) if index else ["-", "-"])]
        rows.append([f"`{name}`", *cells])
    return (
        f"Purity of this run, the share of scans on which the tracks took their own targets' "
        f"detections: {first}.\n\nIn {case.runs} runs of seed {SEED} there are {total} contested "
        f"scans, by rules 1 and 2 above:\n\n{markdown(head, rows)}"
    )


# --- words and numbers --------------------------------------------------------------------------


def chapter_name(frame: Sequence[str], mask: int) -> str:
    """Name of an element with the signs of the chapter; a bar would end the cell of a table."""
    return element_name(frame, mask).replace("&", "∩").replace("|", "∪")


def small(mass: float) -> str:
    """A mass with three significant digits, as long as it matters."""
    return three(mass) if mass == 0.0 or mass >= 1e-6 else "< 1e-6"


def mass_of(frame: Sequence[str], focal: np.ndarray, values: np.ndarray) -> dict[str, float]:
    """Masses by the name of the element."""
    return {
        chapter_name(frame, int(mask)): float(value)
        for mask, value in zip(focal, values, strict=True)
    }


def three(value: float) -> str:
    """A number with three significant digits."""
    return f"{value:.3g}"


def added(one: float, other: float) -> str:
    """A sum of two numbers, written out."""
    sign = "-" if other < 0.0 else "+"
    return f"{one:.3f} {sign} {abs(other):.3f} = {one + other:.3f}"


def pair_rows(head: Sequence[str], columns: Sequence[np.ndarray]) -> str:
    """Markdown: a row for each pair, of columns (2, 2)."""
    rows = []
    for place in np.ndindex(2, 2):
        cells = [column[place] for column in columns]
        written = [c if isinstance(c, str) else f"{c:.4g}" for c in cells]
        rows.append([f"{TRACKS[place[0]]}, {DETECTIONS[place[1]]}", *written])
    return markdown(head, rows)


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)
