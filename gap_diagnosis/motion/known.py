"""Effects that are known beside the description, in the log at hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gap_diagnosis.explanations.known import Known
from gap_diagnosis.motion.astray import astray, varies
from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.motion.columns import described_residuals
from gap_diagnosis.motion.evidence import gram_of
from gap_diagnosis.motion.nodes import Nodes
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats


def as_this_log_has_it(
    nodes: Nodes, course: Course, levels: Floats, known: Sequence[Known]
) -> Nodes:
    """Return the nodes with each known effect in the likeliest of its ways, at these noise levels,
    float64[levels]; one after the other."""
    chosen = [one.ways[0] for one in known]
    for place, one in enumerate(known):
        if len(one.ways) > 1:
            tried = [[*chosen[:place], way, *chosen[place + 1 :]] for way in one.ways]
            heights = [_log_likelihood(nodes.granting(some), course, levels) for some in tried]
            chosen = tried[int(np.argmax(heights))]
    return nodes.granting(chosen)


def _log_likelihood(nodes: Nodes, course: Course, levels: Floats) -> float:
    values = np.ascontiguousarray(described_residuals(nodes)[..., np.newaxis])
    for variant, _ in nodes.motion.granted:
        if variant.jumps is not None:
            course = course.jumping(nodes, variant.jumps(nodes.motion))
    return gram_of(*whiten(values, course, levels, nodes.ticks), (), levels).log_nothing


def beside_known(nodes: Nodes, course: Course) -> Course:
    """Return the course with what known effects leave to chance, and vary by."""
    granted = nodes.motion.granted
    varying = [one for one in granted if varies(one[0], nodes)]
    if varying:
        bare = replace(nodes, smooth=nodes.smooth.described)
        course = course.beside(*astray(bare, varying, np.inf))
    for variant, sizes in granted:
        if variant.scatter is not None:
            variances = variant.scatter(nodes.motion, sizes[0], **variant.fixed)
            course = course.scattered(nodes, *variances)
        if variant.jumps is not None:
            course = course.jumping(nodes, variant.jumps(nodes.motion))
    return course
