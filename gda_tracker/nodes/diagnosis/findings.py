"""A finding: what is wrong, why it matters, and the command that mends it."""

from __future__ import annotations

from dataclasses import asdict, dataclass

ERROR, WARNING, NOTE = "error", "warning", "note"
LEVELS = (ERROR, WARNING, NOTE)


@dataclass(frozen=True)
class Finding:
    """One thing that was found.

    Attributes
    ----------
    level
        ``error`` (no tracks, or wrong ones), ``warning`` (works, but not as meant) or ``note``.
    name
        What kind it is of, always the same word, for programs.
    subject
        The node, topic or variable.
    what, why, fix
        For people; ``fix`` is a command where one mends it.
    """

    level: str
    name: str
    subject: str
    what: str
    why: str
    fix: str

    def record(self) -> dict[str, str]:
        """For JSON."""
        return asdict(self)


def by_level(findings: list[Finding]) -> list[Finding]:
    """The gravest first, otherwise in the order in which they were found; each once."""
    return sorted(dict.fromkeys(findings), key=lambda found: LEVELS.index(found.level))
