"""How often an unlisted cause that was as good as certain was one, by the trials that are kept."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

from scipy.stats import beta

from gap_diagnosis.priors import default_prior

KEPT = Path(__file__).parents[2] / "benchmarks" / "blind"
AS_SURE_AS_CAN_BE = 1.0 - default_prior().misdescribed - 0.005
"""Nearly; older trials were surer."""


def test_the_prior_says_how_often_sure_unlisted_causes_were_something_else() -> None:
    sure, wrong = 0, 0
    for file in sorted(KEPT.glob("*.jsonl.gz")):
        for row in map(json.loads, gzip.decompress(file.read_bytes()).splitlines()):
            if row.get("method") != "chiplog" or row["case"]["engine"] != "own":
                continue
            if row["verdict"] == "unknown" and row["group_probability"] >= AS_SURE_AS_CAN_BE:
                sure += 1
                wrong += row["truth"] != ["unknown"]
    assert sure > 400
    low, high = beta.ppf([0.05, 0.95], wrong + 1, sure - wrong + 1)
    assert low < default_prior().misdescribed < high
