"""A run against an ECU outside goes on while the ECU is gone, and its summary says when it was."""

import json
import os
from pathlib import Path

from other_processes import chiplog, under_way


def test_an_ecu_that_restarts_is_told_and_in_the_summary(tmp_path: Path) -> None:
    group = f"239.77.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF or 1}"
    bus = ("--interface", "udp_multicast", "--channel", group)
    out = tmp_path / "out"
    run_words = ("run", *bus, "--device", "none", "--duration-s", "3600", "--out", str(out))
    ecu_words = ("node", "firmware", *bus, "--kernel", "python", "--log")
    first, second = tmp_path / "first.log", tmp_path / "second.log"
    with (
        chiplog(*ecu_words, str(first), folder=tmp_path / "ecu") as ecu,
        chiplog(*run_words, folder=tmp_path / "run") as run,
    ):
        run.until(under_way(first))
        ecu.kill()
        run.until(lambda: "firmware: silent since" in run.stderr)
        with chiplog(*ecu_words, str(second), folder=tmp_path / "ecu again"):
            run.until(lambda: "firmware: back at" in run.stderr)
            assert run.stop() == 130
    timing = json.loads((out / "summary.json").read_text())["timing"]
    gone = timing["outages"][0]
    assert gone["node"] == "firmware"
    assert 0 <= gone["start_s"] < gone["stop_s"]
    assert timing["unsent_frames"] == 0
    jitter_us = timing["jitter_us"]
    assert 0 <= jitter_us["p50"] <= jitter_us["p99"] <= jitter_us["max"]
    table, page = (tmp_path / "run" / "stdout").read_text(), (out / "report.html").read_text()
    span = f"from {gone['start_s']:.2f} s to {gone['stop_s']:.2f} s"
    assert f"firmware out {span}" in " ".join(table.split())
    assert span in page
