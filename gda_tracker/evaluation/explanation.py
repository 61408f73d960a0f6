"""One track on one scan, explained from the entries of an association log (docs/why.md).

An entry is what :mod:`gda_tracker.evaluation.association_log` makes of a scan.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from gda_tracker.errors import UserError
from gda_tracker.evaluation.association_log import CHOSEN, MHT
from gda_tracker.evaluation.group_entries import group_lines

Entry = dict[str, Any]

LAST = "last"
NS_PER_S = 1_000_000_000
# A stamp that is given to the millisecond means the scan within this.
STAMP_TOLERANCE_NS = 1_000_000
MOST_NAMED = 12
LARGEST_EXPONENT = 20.0

DECISIONS = {
    "map": "the most probable joint hypothesis of the scan: the largest sum of log likelihood "
    "ratios, no detection and no track twice",
    "gda": "as many pairs as possible, of these the largest sum of P_gen = P_k P_a",
    "jpda": "every detection in the gate counts as far as it is probable; chosen, for hits and "
    "misses, are the pairs of the most probable joint hypothesis",
    MHT: "the hypothesis with the largest sum of log likelihood ratios over several scans leads; "
    "a later scan may revise it",
}
VALUE_NAMES = {
    "log_likelihood_ratio": "log likelihood ratio",
    "p_generalised": "P_gen",
    "joint_marginal": "probability",
}


class NoSuchScan(UserError):
    """A scan or a track that is not in the log; the message says which are."""


def pick_scan(entries: Sequence[Entry], word: str) -> int:
    """Return the number of the scan that is meant.

    Parameters
    ----------
    entries
        Entries of the log, counted from 0 as in the table of ``replay --tracks``.
    word
        A number, a stamp in seconds with a point, a stamp in nanoseconds, or ``last``.

    Raises
    ------
    NoSuchScan
        If there is none; the message says which there are.
    """
    if not entries:
        raise NoSuchScan("the log has no scans")
    if word == LAST:
        return len(entries) - 1
    if re.fullmatch(r"\d+", word) and int(word) < len(entries):
        return int(word)
    stamp_ns = _stamp_of(word)
    stamps = [int(entry["stamp_ns"]) for entry in entries]
    if stamp_ns is not None:
        nearest = min(range(len(stamps)), key=lambda place: abs(stamps[place] - stamp_ns))
        if abs(stamps[nearest] - stamp_ns) <= STAMP_TOLERANCE_NS:
            return nearest
    text = (
        f"scan {word}: there are {len(entries)}, numbers 0 to {len(entries) - 1}, stamps "
        f"{_seconds(min(stamps))} to {_seconds(max(stamps))} s"
    )
    if stamp_ns is not None and "." in word:
        text += f"; nearest is scan {nearest} at {_seconds(stamps[nearest])}"
    elif stamp_ns is None:
        text += f"; allowed is a number, a stamp in seconds with a point, or {LAST}"
    raise NoSuchScan(text)


def _stamp_of(word: str) -> int | None:
    """Nanoseconds of a word, exact also beyond what a float holds."""
    if not re.fullmatch(r"\d+(\.\d{0,9})?", word):
        return None
    second, point, fraction = word.partition(".")
    return int(second) * NS_PER_S + int(fraction.ljust(9, "0")) if point else int(word)


def _seconds(stamp_ns: int) -> str:
    return f"{stamp_ns // NS_PER_S}.{stamp_ns % NS_PER_S:09d}"


def explain(entries: Sequence[Entry], number: int, track_id: int) -> Entry:
    """Return what the log says of a track on a scan, for ``json.dumps``.

    The pairs stand in the order of the deciding term, the best first.

    Raises
    ------
    NoSuchScan
        If the scan was not associated, or the track was not there.
    """
    entry = entries[number]
    check_associated(entry, number)
    hypotheses = [row for row in entry["tracks"] if row["track_id"] == track_id]
    if not hypotheses:
        raise NoSuchScan(_no_such_track(entries, number, track_id))
    by = entry["decided_by"]
    pairs = sorted(
        (pair for pair in entry["pairs"] if pair["track_id"] == track_id),
        key=lambda pair: (not pair["chosen"], -_sortable(_terms(pair)[by]["value"])),
    )
    # Of tracks that share a detection it is the other one.
    owner = {row["detection"]: row["track_id"] for row in entry["tracks"]} | {
        row["detection"]: row["track_id"] for row in entry["tracks"] if row["track_id"] != track_id
    }
    taken = next((row["detection"] for row in hypotheses if row["detection"] is not None), None)
    found = {key: value for key, value in entry.items() if key not in ("tracks", "pairs")}
    return found | {
        "scan": number,
        "track_id": track_id,
        "detection": taken,
        "hypotheses": hypotheses,
        "pairs": [
            {**pair, "detection_went_to_track": owner.get(pair["detection"])} for pair in pairs
        ],
    }


def check_associated(entry: Entry, number: int) -> None:
    """Raise :class:`NoSuchScan` for a scan without a decision."""
    if "pairs" in entry:
        return
    reason = f": {entry['reason']}" if entry.get("reason") else ""
    raise NoSuchScan(f"scan {number} was {entry['outcome']}{reason}; nothing was decided on it")


def tracks_of(entry: Entry) -> list[int]:
    """Track ids that an entry has, by size."""
    return sorted({int(row["track_id"]) for row in entry.get("tracks", ())})


def _no_such_track(entries: Sequence[Entry], number: int, track_id: int) -> str:
    there = tracks_of(entries[number])
    text = f"track {track_id} was not predicted for scan {number}; "
    text += f"tracks there: {_listed(there)}" if there else "there were no tracks yet"
    lives = [place for place, entry in enumerate(entries) if track_id in tracks_of(entry)]
    if lives:
        text += f"; track {track_id} is in scans {lives[0]} to {lives[-1]}"
    elif len(entries) > 1:
        every = sorted({track for entry in entries for track in tracks_of(entry)})
        text += f"; tracks of all scans: {_listed(every)}"
    return text


def _listed(numbers: Sequence[int]) -> str:
    more = len(numbers) - MOST_NAMED
    return ", ".join(map(str, numbers[:MOST_NAMED])) + (f" and {more} more" if more > 0 else "")


def _terms(pair: Entry) -> dict[str, Entry]:
    return {item["term"]: item for item in pair["terms"]}


def _sortable(value: float | None) -> float:
    return math.inf if value is None else float(value)


# --- in words -------------------------------------------------------------------------------------


def overview_lines(entry: Entry, number: int) -> list[str]:
    """All tracks of a scan, a line each."""
    check_associated(entry, number)
    lines = [_head(entry, number)]
    for track_id in tracks_of(entry):
        rows = [row for row in entry["tracks"] if row["track_id"] == track_id]
        taken = next((row["detection"] for row in rows if row["detection"] is not None), None)
        gated = sorted({p["detection"] for p in entry["pairs"] if p["track_id"] == track_id})
        got = "no detection" if taken is None else f"detection {taken}"
        lines.append(f"track {track_id}: {got}; in its gate: {_listed(gated) or 'none'}")
    if len(lines) == 1:
        lines.append("no tracks yet")
    return lines


def explanation_lines(found: Entry) -> list[str]:
    """What :func:`explain` has found, in words, with units."""
    decision, track = found["decision"], found["track_id"]
    lines = [_head(found, found["scan"]), f"decided by {DECISIONS.get(decision, decision)}"]
    if found["degraded"]:
        lines.append("degraded: the attributes were given up, kinematics alone decided")
    taken, hypotheses = found["detection"], found["hypotheses"]
    got = "got no detection" if taken is None else f"got detection {taken}"
    n = len({pair["detection"] for pair in found["pairs"]})
    lines.append(
        f"track {track}: {got}; {n} of {found['detections']} detections in its gate"
        + (f", {len(hypotheses)} hypotheses of the track" if len(hypotheses) > 1 else "")
    )
    miss = hypotheses[0]["log_miss_probability"]
    lines.append(
        f"  without a detection: log(1 - P_d) = {_plain(miss)}, a chance of "
        f"{_percent(0.0 if miss is None else math.exp(miss))} to be missed"
    )
    for pair, others in _by_detection(found["pairs"], found["decided_by"]):
        lines += ["", *_pair_lines(pair, found)]
        if others:
            lines.append(f"    hypotheses  {_others(others, found)}")
    lines += group_lines(found)
    if not found["pairs"]:
        lines.append(
            "  no detection lay in its gate: it is missed, or the motion model or the noise is too "
            "narrow (gate_probability, process_noise_std_mps2, range_std_m, azimuth_std_rad)"
        )
    return lines


def _head(entry: Entry, number: int) -> str:
    return (
        f"scan {number} of {entry['sensor_id']}, stamp {_seconds(entry['stamp_ns'])} s: decision "
        f"{entry['decision']}, attribute term {entry['attribute_term']}, "
        f"{entry['detections']} detections, clutter density "
        f"{entry['clutter_density_per_m_rad']:.3g} 1/(m rad)"
    )


def _by_detection(pairs: Sequence[Entry], by: str) -> list[tuple[Entry, list[Entry]]]:
    """The pair of each detection with the best hypothesis of the track, and its other pairs."""
    groups: dict[int, list[Entry]] = {}
    for pair in pairs:
        groups.setdefault(pair["detection"], []).append(pair)
    return [
        (best, [pair for pair in group if pair is not best])
        for group in groups.values()
        for best in [max(group, key=lambda pair: _sortable(_terms(pair)[by]["value"]))]
    ]


def _others(others: Sequence[Entry], found: Entry) -> str:
    values = sorted(_sortable(_terms(p)[found["decided_by"]]["value"]) for p in others)
    least, most = _signed(values[0]), _signed(values[-1])
    span = least if least == most else f"{least} to {most}"
    return (
        f"{len(others)} more of this track have it in their gate, log likelihood ratio {span}; "
        "--json has their terms"
    )


def _pair_lines(pair: Entry, found: Entry) -> list[str]:
    terms = _terms(pair)
    several = len(found["hypotheses"]) > 1
    of = f" with hypothesis {pair['hypothesis_id']}" if several else ""
    lines = [f"  detection {pair['detection']}{of}: {_outcome(pair, found)}"]
    gate = terms["mahalanobis_squared"]
    lines.append(
        f"    gate        Mahalanobis distance {math.sqrt(gate['value']):.2f} sigma (squared "
        f"{gate['value']:.2f}, gate {gate['threshold']:.2f} for "
        f"{_percent(found['gate_probability'])} of a target's detections)"
    )
    lines.append(
        "    kinematics  "
        + _weighed(
            terms["kinematic_log_likelihood"],
            "1/(m rad)",
            "a miss and a false alarm are as likely at",
        )
    )
    attribute = terms.get("attribute_log_likelihood")
    if attribute is not None:
        text = _weighed(attribute, "1/m2", "from a false alarm")
        if not attribute["value"] and not attribute["threshold"]:
            text = "unknown for this detection: says nothing"
        lines.append(f"    attribute   {text}")
    ratio = terms["log_likelihood_ratio"]
    lines.append(
        f"    together    log likelihood ratio {_signed(ratio['value'])}, from 0 on the pair is "
        f"likelier than a miss and a false alarm: {_times(ratio['value'], 0.0)}"
    )
    distance = terms.get("attribute_distance")
    if distance is not None:
        lines.append(
            f"    belief      distance {_plain(distance['value'])} between the track's history and "
            "the history with this detection (0: the same)"
        )
    lines.append(f"    probability {_probabilities(terms, found)}")
    if not pair["converged"]:
        lines.append(f"    {pair['engine']} has not converged: these are approximate")
    if pair["rival"] is not None:
        lines.append(f"    rival       {_rival(pair, found)}")
    return lines


def _weighed(term: Entry, unit: str, against: str) -> str:
    return (
        f"log likelihood {_signed(term['value'])} [log {unit}], {against} "
        f"{_signed(term['threshold'])}: {_times(term['value'], term['threshold'])}"
    )


def _times(value: float | None, threshold: float | None) -> str:
    """For or against, and by which factor."""
    if value is None or threshold is None:
        return "beyond comparison (P_d = 1 or no clutter)"
    gain = value - threshold
    if abs(gain) < 1e-9:
        return "neither for nor against"
    size = abs(gain)
    factor = f"e^{size:.0f}" if size > LARGEST_EXPONENT else f"{math.exp(size):.3g}"
    return f"speaks {'for' if gain > 0 else 'against'} the pair, {factor} times"


def _probabilities(terms: dict[str, Entry], found: Entry) -> str:
    value = {name: item["value"] for name, item in terms.items()}
    text = f"{_share(value['joint_marginal'])} with all that is known"
    if found["decision"] == MHT:
        return f"{_share(value['joint_marginal'])} on this scan alone, other tracks left aside"
    text += f"; P_k {_share(value['p_kinematic'])} by the kinematics"
    if found["decision"] == "gda":
        text += (
            f", P_a {_share(value['p_attribute'])} by the attribute, P_gen = P_k P_a "
            f"{_share(value['p_generalised'])}"
        )
    return text


def _outcome(pair: Entry, found: Entry) -> str:
    elsewhere = pair["detection_went_to_track"]
    words = {
        CHOSEN: "CHOSEN"
        + (" by the hypothesis that leads now" if found["decision"] == MHT else ""),
        "track_has_another_detection": f"not chosen, the track has detection {found['detection']}",
        "detection_has_another_track": f"not chosen, it went to track {elsewhere}",
        "track_and_detection_are_elsewhere": f"not chosen, it went to track {elsewhere}, and the "
        f"track has detection {found['detection']}",
        "miss_and_false_alarm_preferred": "not chosen, a miss and a false alarm are likelier",
        "detection_is_shared": f"shared with track {elsewhere}, the sensor did not resolve them",
        "another_hypothesis_leads": "not in the hypothesis that leads",
    }
    return words.get(pair["reason"], str(pair["reason"]))


def _rival(pair: Entry, found: Entry) -> str:
    rival, by = pair["rival"], found["decided_by"]
    if rival["track_id"] == pair["track_id"]:
        other = f"detection {rival['detection']} for the same track"
        if rival["detection"] == pair["detection"]:
            other = f"hypothesis {rival['hypothesis_id']} of the same track"
    else:
        other = f"track {rival['track_id']} for the same detection"
    own = _terms(pair)[by]["value"]
    text = f"{other}, {VALUE_NAMES.get(by, by)} {_plain(rival['value'])}"
    if own is None or rival["value"] is None:
        return text
    lead = own - rival["value"]
    return f"{text}, {'less by' if lead >= 0 else 'more by'} {abs(lead):.3g}"


def _plain(value: float | None) -> str:
    return "infinite" if value is None else f"{value:.4g}"


def _signed(value: float | None) -> str:
    return "infinite" if value is None or math.isinf(value) else f"{value:+.2f}"


def _share(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.3f}"


def _percent(value: float) -> str:
    return f"{100.0 * value:.4g} %"
