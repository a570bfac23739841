"""Files replaced as a whole: written beside the target, then put in its place, so that none is ever half written."""

import errno
import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """A temporary path in the target's folder that takes the target's place when the block ends well.

    On any exception the temporary file is removed and the target stays as it was. The folder is made if missing.

    Raises:
        OSError: the target is a folder or a device.
    """
    target = Path(path)
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, "is no file that could be replaced", str(target))
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(8)}.part")
    os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))  # less what the process's umask takes
    try:
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())  # the content is on the disk before the name points at it
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text_atomic(path: Path | str, text: str) -> None:
    """Write UTF-8 text with its line ends as they are, as a whole or not at all."""
    write_bytes_atomic(path, text.encode("utf-8"))


def write_bytes_atomic(path: Path | str, content: bytes) -> None:
    """Write a file's content, as a whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def write_json_atomic(path: Path | str, record: Any) -> None:
    """Write a JSON record, as a whole or not at all.

    Raises:
        ValueError: NaN or infinity in it.
    """
    write_text_atomic(path, record_text(record))


def record_text(record: Any) -> str:
    """The text of a record's file.

    Raises:
        ValueError: NaN or infinity in it.
    """
    return json.dumps(record, indent=2, allow_nan=False) + "\n"
