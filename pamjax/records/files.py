"""Reading and atomic writing of files: an interrupted run leaves no incomplete file."""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import stat
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from pamjax.errors import BadInput


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file.

    Raises:
        BadInput: if the file does not exist, cannot be read, or is a pipe or a device, which may have no end.
    """
    try:
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise BadInput.from_rule(
                f"{path} must be a file", "a pipe or a device", remedy="Write its content to a file."
            )
        return path.read_bytes()
    except FileNotFoundError as error:
        raise BadInput.from_rule(f"the file {path} does not exist", remedy="Check the path.") from error
    except IsADirectoryError as error:
        raise BadInput.from_rule(
            f"{path} must be a file", "a folder", remedy="State the path of a file."
        ) from error
    except OSError as error:
        raise BadInput.from_rule(
            f"{path} cannot be read", error.strerror or "an error", remedy="Check that it is a readable file."
        ) from error


def decode_text(raw: bytes, file: str, encoding: str = "utf-8", remedy: str = "Save it as UTF-8.") -> str:
    """Return the text of a file; a UTF-8 file may have a byte order mark.

    Args:
        raw: the bytes of the file.
        file: its name, for error messages.
        encoding: encoding of the text.
        remedy: what to do about another encoding.

    Raises:
        BadInput: if the file is not text in this encoding.
    """
    if raw[:2] == b"PK":
        raise BadInput.from_rule(
            f"{file} must be plain text",
            "a spreadsheet or an archive",
            remedy="Export the sheet as CSV, or name it in the TOML file of `pamjax import`.",
        )
    if b"\0" in raw[:4096]:
        raise BadInput.from_rule(
            f"{file} must be plain text", "a binary file", remedy="Save it as UTF-8 text."
        )
    try:
        return raw.decode("utf-8-sig" if encoding == "utf-8" else encoding)
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        got = f"the byte 0x{raw[error.start]:02x}"
        rule = f"{file} must be {encoding.upper()} text"
        raise BadInput.from_rule(rule, got, f"line {line}", remedy) from error


@contextmanager
def write_atomically(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path in the same folder, which replaces `path` at the end.

    The folder must exist. After an exception or Ctrl-C, an existing file at `path` is unchanged.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     with write_atomically(Path(folder) / "fit.json") as temporary:
    ...         _ = temporary.write_text("{}")
    ...     (Path(folder) / "fit.json").read_text()
    '{}'
    """
    path = Path(path)
    temporary = _choose_temporary_path(path)
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def write_folder_atomically(folder: str | Path) -> Iterator[Path]:
    """Yield a temporary folder whose files move to `folder` at the end, all or none.

    The folder is created if it does not exist. Its other files are unchanged.
    """
    folder = Path(folder)
    with _move_at_the_end(_choose_temporary_path(folder), folder) as temporary:
        yield temporary


@contextmanager
def write_results_together(folder: str | Path, earlier_names: Sequence[str] = ()) -> Iterator[Path]:
    """Yield a temporary folder inside `folder`, whose files move to `folder` at the end, all or none.

    So a killed command or a full disk leaves no new result next to the report of an earlier one. The folder
    is created with its parents. Its other files are unchanged.

    Args:
        folder: the output folder.
        earlier_names: names of the files of an earlier result in it, which are removed at the end.
    """
    folder = Path(folder)
    is_new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with _move_at_the_end(folder / f".pamjax-{secrets.token_hex(4)}", folder, earlier_names) as temporary:
            yield temporary
    finally:
        if is_new and not any(folder.iterdir()):
            folder.rmdir()


@contextmanager
def _move_at_the_end(temporary: Path, folder: Path, earlier_names: Sequence[str] = ()) -> Iterator[Path]:
    """Create a temporary folder, yield it, and move its files to `folder` at the end, all or none.

    Files of an earlier result that no new file replaces are removed first.
    """
    temporary.mkdir()
    try:
        yield temporary
        with _delay_interrupt():
            for name in earlier_names:
                if not (temporary / name).exists():
                    (folder / name).unlink(missing_ok=True)
            _move_files(temporary, folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def is_writable(folder: Path) -> bool:
    """Return whether a folder accepts new files, by a trial: permissions are not sufficient for /proc."""
    try:
        os.rmdir(tempfile.mkdtemp(prefix=".pamjax-", dir=folder))
    except OSError:
        return False
    return True


def _choose_temporary_path(path: Path) -> Path:
    """Return a hidden path in the same folder, so that a rename on one disk replaces the target."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise BadInput.from_rule(f"the folder of {path} must exist", remedy="Create it, or check the path.")
    if not is_writable(folder):
        raise BadInput.from_rule(f"the folder of {path} must be writable", remedy="Choose another folder.")
    # The suffix is unchanged, because some writers derive the format from it.
    return folder / f".{path.stem}-{secrets.token_hex(4)}{path.suffix}"


def _move_files(source: Path, target: Path) -> None:
    if not target.exists():
        os.replace(source, target)
        return
    for path in sorted(source.rglob("*")):
        target_path = target / path.relative_to(source)
        if path.is_dir():
            target_path.mkdir(exist_ok=True)
        else:
            os.replace(path, target_path)


@contextmanager
def _delay_interrupt() -> Iterator[None]:
    """Delay Ctrl-C and a termination, for example by a batch system, until the files are renamed."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received_signals: list[int] = []
    with ExitStack() as stack:
        for number in (signal.SIGINT, signal.SIGTERM):
            previous_handler = signal.getsignal(number)
            if previous_handler is None:  # set by another language: Python cannot restore it
                continue
            signal.signal(number, lambda received, _: received_signals.append(received))
            stack.callback(signal.signal, number, previous_handler)
        yield
    # The first handler may raise an exception; the stack calls the other one also then.
    with ExitStack() as stack:
        for number in dict.fromkeys(received_signals):
            stack.callback(signal.raise_signal, number)
