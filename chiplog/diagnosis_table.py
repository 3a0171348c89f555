"""What a diagnosis prints: the verdict first, then what a person needs to act on it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

from chiplog.pages import diagnosis_words as words
from chiplog.pages import quantities as q
from chiplog.pages.log_time import from_log_start
from chiplog.terminal import show_line, show_table
from gap_diagnosis.result import Diagnosis

_WIDTH = 80
_CANDIDATES = 3
_CANDIDATE_ROWS = 8
_NOTES = 3


def show_diagnosis(
    found: Diagnosis, files: Sequence[Path] = (), scenarios: Sequence[Path] = ()
) -> None:
    """Print the verdict, the gap before and after, candidates, ambiguities and what to drive;
    *files* and *scenarios* to drive were written."""
    found = from_log_start(found)
    show_line(words.headline(found))
    show_line()
    for doubt in found.doubts:
        show_line(fill(doubt, _WIDTH))
        show_line()
    show_line(fill("".join(part.text for part in words.verdict(found)), _WIDTH))
    for sentence in (words.gap_sentence(found), words.unknown_sentence(found)):
        if sentence:
            show_line(fill(sentence, _WIDTH))
    show_line()
    candidates = words.candidate_rows(found, _CANDIDATES)
    if len(candidates) > _CANDIDATE_ROWS:
        candidates = words.candidate_rows(found, _CANDIDATES - 1)
    show_table(["probability", "explanation", "estimate", "95 % interval"], candidates, words=2)
    show_line()
    known = words.known_already(found)
    rows = [["known already", known]] if known else []
    rows += [["cannot tell", sentence] for sentence in words.ambiguity_sentences(found)[:_NOTES]]
    own = [one for one in found.advice if one.about == "verdict"][:_NOTES]
    rows += [["drive next", advice.sentence] for advice in own]
    rows += [["note", note] for note in found.notes[:_NOTES]]
    rows += [["took", f"{q.duration(found.seconds)} for {words.logs_clause(found)}"]]
    wrote = [str(path) for path in (*files, *scenarios[:1])]
    if len(scenarios) > 1:
        wrote[-1] += f" and {len(scenarios) - 1} more to drive beside it"
    rows += [["wrote", ", ".join(wrote)]] if wrote else []
    show_table(["", ""], _once(rows), words=2)


def _once(rows: Sequence[list[str]]) -> list[list[str]]:
    """Return `rows` with a repeated first word left out."""
    before = ""
    shown = []
    for name, text in rows:
        shown.append(["" if name == before else name, text])
        before = name
    return shown
