"""Kinds of frames that come from files rather than messages."""

from __future__ import annotations

ARS548 = "continental ars548 scan"
SRR520 = "continental srr520 scan"
MMWAVE = "mmwave text frame"
CSV = "csv"
ASTERIX = "asterix cat 048"
DETECTIONS = "detections"
