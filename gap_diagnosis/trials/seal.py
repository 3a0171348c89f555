"""Answers under seal: enciphered with a one-time pad of their length, committed to by SHA-256.

The commitment stands beside the cases before anything is diagnosed. The pad is as long as the
answers and random, so without it the sealed file says nothing but their length; it lies outside
the trial's folder, and may be kept on another machine until the answers are opened.
"""

from __future__ import annotations

import hashlib
import json
import secrets
from pathlib import Path
from typing import Any, Final

from gap_diagnosis.errors import DiagnosisError

SEALED: Final = "answers.sealed"
COMMITMENT: Final = "seal.json"
BLOCK: Final = 1 << 16
"""Bytes: answers and keys are whole numbers of them long."""


def key_of(folder: Path) -> Path:
    """Return where the pad of a trial lies unless it is told otherwise: beside its folder."""
    return folder.resolve().with_name(folder.resolve().name + ".key")


def seal(answers: Any, folder: Path, key: Path) -> str:
    """Write sealed answers and commitment to *folder* and the pad to *key*; return the SHA-256.

    The text is padded to whole blocks, so that its length does not tell the answers either.
    """
    text = json.dumps(answers, indent=1, allow_nan=False, sort_keys=True)
    plain = text.encode() + b"\n"
    plain += b" " * (-len(plain) % BLOCK)
    pad = secrets.token_bytes(len(plain))
    digest = hashlib.sha256(plain).hexdigest()
    (folder / SEALED).write_bytes(_xor(plain, pad))
    content = {"schema": 1, "sha256": digest, "bytes": len(plain)}
    (folder / COMMITMENT).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    key.unlink(missing_ok=True)
    key.touch(mode=0o600)
    key.write_bytes(pad)
    key.chmod(0)
    return digest


def unseal(folder: Path, key: Path) -> Any:
    """Return the answers; raise DiagnosisError where they are not those committed to."""
    try:
        committed = json.loads((folder / COMMITMENT).read_text(encoding="utf-8"))["sha256"]
        sealed = (folder / SEALED).read_bytes()
    except (OSError, ValueError, KeyError, TypeError):
        raise DiagnosisError(
            f"{folder}: no sealed trial: expected {COMMITMENT} and {SEALED}, as `chiplog blind "
            "make` writes them"
        ) from None
    plain = _xor(sealed, _pad(key, len(sealed)))
    if hashlib.sha256(plain).hexdigest() != committed:
        raise DiagnosisError(
            f"{folder / SEALED}: the answers opened with {key} are not those that {COMMITMENT} "
            "commits to: expected the files as they were sealed, and their own key"
        )
    return json.loads(plain)


def _pad(key: Path, length: int) -> bytes:
    try:
        mode = key.stat().st_mode & 0o777
        key.chmod(0o600)
        try:
            pad = key.read_bytes()
        finally:
            key.chmod(mode)
    except OSError as error:
        raise DiagnosisError(
            f"{key}: cannot read the key of this trial: {error.strerror}: expected the file that "
            "`chiplog blind make` wrote"
        ) from None
    if len(pad) != length:
        raise DiagnosisError(f"{key}: {len(pad)} bytes: expected {length}, the key of this trial")
    return pad


def _xor(first: bytes, second: bytes) -> bytes:
    number = int.from_bytes(first, "big") ^ int.from_bytes(second, "big")
    return number.to_bytes(len(first), "big")
