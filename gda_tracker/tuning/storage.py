"""Where a study is kept: Optuna's storages, so that processes and machines can share it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gda_tracker.errors import UserError

if TYPE_CHECKING:
    from optuna.storages import BaseStorage

JOURNAL_SUFFIX = ".journal"


class MissingOptunaError(ImportError):
    """Optuna is not installed; the message names the command that installs it."""


def require_optuna() -> None:
    """Import Optuna, and keep it from writing a line about every trial.

    Raises
    ------
    MissingOptunaError
        If it is not installed.
    """
    try:
        import optuna
    except ImportError as error:
        raise MissingOptunaError(
            "the search needs Optuna, install it with: pip install gda_tracker[tune]"
        ) from error
    optuna.logging.set_verbosity(optuna.logging.WARNING)


def open_storage(url: str) -> BaseStorage:
    """Open ``sqlite:///FILE``, another database's URL, or a file ``NAME.journal``.

    A journal is a text file to which all processes append; it works on network file systems too.

    Raises
    ------
    UserError
        If it cannot be opened.
    """
    require_optuna()
    import optuna
    from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

    if url.endswith(JOURNAL_SUFFIX) and "://" not in url:
        folder = Path(url).resolve().parent
        if not folder.is_dir():
            raise UserError(f"--storage {url}: the folder {folder} does not exist")
        lock = JournalFileOpenLock(url)
        return optuna.storages.JournalStorage(JournalFileBackend(url, lock_obj=lock))
    if "://" not in url:
        raise UserError(
            f"--storage {url}: allowed is a file NAME{JOURNAL_SUFFIX}, sqlite:///FILE, or the URL "
            "of another database"
        )
    try:
        return optuna.storages.RDBStorage(url)
    except Exception as error:  # whatever the database's driver raises: the URL is the user's
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise UserError(f"--storage {url}: cannot be opened: {reason}") from error
