"""Writing files so that nothing is ever half there, and telling a user in one sentence what went wrong."""

import contextlib
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path


@contextlib.contextmanager
def atomic_write(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside ``path`` that is renamed to it on success and deleted on failure.

    The temporary name keeps the suffix, because OpenCV and Matplotlib choose their format by it.

    Raises:
        ValueError: there is a file in the place of the folder around it.
    """
    path = Path(path)
    _make_folder(path.parent)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())  # mkstemp makes files private; a result is as readable as any other file
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def atomic_folder(path: Path | str) -> Iterator[Path]:
    """Yield a temporary folder beside ``path`` that is renamed to it on success and deleted on failure.

    Raises:
        ValueError: there is something at ``path`` already, or a file in the place of the folder around it.
    """
    path = Path(path)
    expect_new_folder(path)
    _make_folder(path.parent)
    temporary = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
    try:
        yield temporary
        temporary.chmod(0o777 & ~_umask())
        temporary.replace(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def expect_new_folder(path: Path) -> None:
    """Insist that there is nothing at ``path``, or an empty folder.

    Raises:
        ValueError: there is something.
    """
    if path.exists() and not (path.is_dir() and not any(path.iterdir())):
        raise ValueError(f"{path}: there already, expected the name of a new folder")


def _make_folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ValueError(f"{path}: expected a folder, but there is a file in its place") from None


def _umask() -> int:
    umask = os.umask(0)
    os.umask(umask)
    return umask


@contextlib.contextmanager
def alone_in(folder: Path | str) -> Iterator[None]:
    """Keep other processes that ask for the same out of a folder; the lock goes with the process, however it ends.

    Raises:
        ValueError: another process is in it.
    """
    try:
        import fcntl
    except ImportError:  # Windows has no lock for folders
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(f"{folder}: another run is writing into this folder") from None
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(handle)


def run_program(main: Callable[[], object]) -> None:
    """Run ``main`` and turn bad input into one line on stderr and exit code 2.

    Ctrl-C becomes exit code 130. SIGTERM, which would end Python where it stands and leave half-written files, does the
    same as Ctrl-C, with exit code 143.
    """
    try:
        with terminated_like_interrupted():
            main()
    except (ValueError, OSError) as error:
        sentence = " ".join(_told(error).split())
        print(f"error: {sentence}", file=sys.stderr)
        sys.exit(2)
    except Terminated:
        print("terminated", file=sys.stderr)
        sys.exit(128 + signal.SIGTERM)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(128 + signal.SIGINT)


def _told(error: Exception) -> str:
    """``model.ts: permission denied`` where the system says ``[Errno 13] Permission denied: 'model.ts'``."""
    if isinstance(error, OSError) and error.strerror and error.filename is not None:
        return f"{error.filename}: {error.strerror[:1].lower()}{error.strerror[1:]}"
    return str(error)


class Terminated(KeyboardInterrupt):
    """SIGTERM, wherever it came: everything that cleans up after Ctrl-C cleans up after it."""


@contextlib.contextmanager
def terminated_like_interrupted() -> Iterator[None]:
    """Raise :class:`Terminated` on SIGTERM, once: a second one does not disturb the cleaning up.

    What was raised may have become another KeyboardInterrupt on the way; it leaves as Terminated.
    """
    caught = False

    def terminate(number: int, _: object) -> None:
        nonlocal caught
        caught = True
        signal.signal(number, signal.SIG_IGN)
        raise Terminated

    before = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    except KeyboardInterrupt:
        if caught:
            raise Terminated from None
        raise
    finally:
        signal.signal(signal.SIGTERM, before)
