"""Blind trials: what is asked of one, and its seal."""

from __future__ import annotations

import hashlib
import json

from error_tables.row import Row

_PLAIN = b"{}" + b" " * 14
_COMMITTED = json.dumps({"sha256": hashlib.sha256(_PLAIN).hexdigest()})
_EMPTY = json.dumps({"cases": []}).encode()
_OPENED = json.dumps({"sha256": hashlib.sha256(_EMPTY).hexdigest()})

TRIALS: tuple[Row, ...] = (
    Row(
        "a trial of an effect that does not exist",
        "chiplog blind make --out trial --cases 4 --only gyro_bais",
        "gyro_bais: no effect of trials: expected a name of `chiplog effects`",
    ),
    Row(
        "a trial of a stratum that does not exist",
        "chiplog blind make --out trial --cases 4 --strata prior,sky",
        "strata prior, sky: expected some of prior, limit, field",
    ),
    Row(
        "a trial whose sizes are turned round",
        "chiplog blind make --out trial --cases 4 --factor 3 1",
        "factor (3.0, 1.0): expected two sizes, the smaller one first",
    ),
    Row(
        "a trial of more parts than cases",
        "chiplog blind make --out trial --cases 4 --nulls 5",
        "4 cases: fewer than the nulls, pairs, withheld and other engine's together",
    ),
    Row(
        "a trial over files of yours",
        "chiplog blind make --out . --cases 4",
        ".: there already: expected an empty folder or a new one",
        {"notes.txt": "mine"},
    ),
    Row(
        "a trial's seed that is none",
        "chiplog blind make --out trial --cases 4 --seed-file seed.txt",
        "seed.txt: expected 32 hexadecimal digits and no more",
        {"seed.txt": "seven"},
    ),
    Row(
        "a trial's seed that is not there",
        "chiplog blind make --out trial --cases 4 --seed-file seed.txt",
        "seed.txt: no such file or directory",
    ),
    Row(
        "a trial to run without cases",
        "chiplog blind run trial",
        "trial: no cases: expected a folder of `chiplog blind make`",
    ),
    Row(
        "a trial to run that is still being made",
        "chiplog blind run trial",
        "trial: not sealed yet: expected seal.json, which `chiplog blind make` writes last",
        {"trial/cases/0001/bus.log": ""},
    ),
    Row(
        "a trial that was never sealed",
        "chiplog blind score trial",
        "trial: no sealed trial: expected seal.json and answers.sealed, as `chiplog blind "
        "make` writes them",
    ),
    Row(
        "a sealed trial without its key",
        "chiplog blind score . --key a.key",
        "a.key: cannot read the key of this trial: No such file or directory: expected the "
        "file that `chiplog blind make` wrote",
        {"seal.json": _COMMITTED, "answers.sealed": _PLAIN},
    ),
    Row(
        "a sealed trial with a key of another length",
        "chiplog blind score . --key a.key",
        "a.key: 2 bytes: expected 16, the key of this trial",
        {"seal.json": _COMMITTED, "answers.sealed": _PLAIN, "a.key": b"12"},
    ),
    Row(
        "a sealed trial with another trial's key",
        "chiplog blind score . --key a.key",
        "answers.sealed: the answers opened with a.key are not those that seal.json commits "
        "to: expected the files as they were sealed, and their own key",
        {"seal.json": _COMMITTED, "answers.sealed": _PLAIN, "a.key": b"1" * 16},
    ),
    Row(
        "a trial to drive again in which nothing is recommended",
        "chiplog blind again . --out again --key a.key",
        ".: no diagnosis in it recommends a manoeuvre: expected results of `chiplog blind run .` "
        "with an ambiguous case",
        {"seal.json": _OPENED, "answers.sealed": _EMPTY, "a.key": bytes(len(_EMPTY))},
    ),
    Row(
        "a sealed trial that was not run",
        "chiplog blind score . --key a.key",
        "results/chiplog: no results: expected those of `chiplog blind run .`",
        {"seal.json": _OPENED, "answers.sealed": _EMPTY, "a.key": bytes(len(_EMPTY))},
    ),
)
