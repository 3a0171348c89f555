"""`chiplog blind`: trials on data whose effect is sealed: make, run, score."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from chiplog.commands.output import STANDARD_OUTPUT, write_json
from chiplog.errors import CommandError

if TYPE_CHECKING:
    from gap_diagnosis.trials.case import Stratum
    from gap_diagnosis.trials.opening import Opened
    from gap_diagnosis.trials.secret import Secret

app = typer.Typer(
    help="Blind trials: cases with a sealed effect, their diagnosis, and the scores.",
    rich_markup_mode=None,
    no_args_is_help=True,
)

_STRATA = "prior,limit,field"

FolderArgument = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the trial.")]
KeyOption = Annotated[
    Path | None,
    typer.Option("--key", metavar="FILE", help="Key of the answers; default: DIR.key, beside DIR."),
]
JobsOption = Annotated[
    int | None, typer.Option("--jobs", min=1, help="At once; default: one per processor.")
]
MethodOption = Annotated[
    Path | None,
    typer.Option(
        "--method",
        metavar="FILE.py",
        help="Another method: diagnose(log, robot, reference, without) gives OUT.json.",
    ),
]


@app.command("make", short_help="Draw cases, write their logs, seal the answers.")
def make(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="New folder of the trial.")],
    cases: Annotated[int, typer.Option("--cases", min=1, help="How many cases.")],
    nulls: Annotated[
        int | None, typer.Option("--nulls", min=0, help="Without an effect; default: a fifth.")
    ] = None,
    pairs: Annotated[
        int | None, typer.Option("--pairs", min=0, help="With two effects; default: a tenth.")
    ] = None,
    withheld: Annotated[
        int,
        typer.Option(
            "--withheld",
            min=0,
            help="Whose effect is taken out of the library; as many decoys come with them.",
        ),
    ] = 0,
    other_engine: Annotated[
        int,
        typer.Option(
            "--other-engine",
            min=0,
            help="Without an effect, in another engine's physics: MuJoCo, an extra.",
        ),
    ] = 0,
    strata: Annotated[
        str,
        typer.Option(
            "--strata",
            help="prior: drawn from the tool's own prior; limit: sizes about the detection limit; "
            "field: typical of real robots.",
        ),
    ] = _STRATA,
    factor: Annotated[
        tuple[float, float],
        typer.Option("--factor", help="Smallest and largest size over the limit, in limit."),
    ] = (0.3, 10.0),
    effects: Annotated[
        list[str] | None, typer.Option("--only", help="Only this effect (repeatable).")
    ] = None,
    new: Annotated[
        float,
        typer.Option(
            "--new", min=0, max=1, help="Share of new manoeuvres, noises and robots, each."
        ),
    ] = 0.15,
    key: KeyOption = None,
    jobs: JobsOption = None,
    seed_file: Annotated[
        Path | None,
        typer.Option(
            "--seed-file", help="32 hexadecimal digits, to make the same again; default: secret."
        ),
    ] = None,
) -> None:
    """Draw effects, sizes, drives, noise, robots and errors of description, and seal them.

    Writes a folder per case with bus.log, robot.toml, reference.tum and task.json; the answers,
    enciphered; and seal.json, which commits to them. Their key goes to a file of its own.
    """
    from chiplog.terminal import progress, show_line
    from gap_diagnosis.trials.make import make_trial
    from gap_diagnosis.trials.plan import Counts
    from gap_diagnosis.trials.run import processors
    from gap_diagnosis.trials.seal import key_of

    counts = Counts(
        cases,
        nulls=nulls,
        pairs=pairs,
        withheld=withheld,
        other_engine=other_engine,
        strata=cast("tuple[Stratum, ...]", tuple(strata.split(","))),
        factor=factor,
        effects=tuple(effects or ()),
        new_share=new,
    )
    chosen = key or key_of(out)
    secret = _secret(seed_file)
    with progress("making cases", cases) as bar:
        digest = make_trial(
            counts,
            out,
            chosen,
            secret,
            bar or (lambda done, total: None),
            jobs=jobs or processors(),
        )
    show_line(f"{out}: {cases} cases; answers sealed, SHA-256 {digest}")
    show_line(f"key: {chosen}; keep it from whoever diagnoses")


@app.command("run", short_help="Diagnose every case in a process that cannot read the answers.")
def run(
    folder: FolderArgument,
    jobs: JobsOption = None,
    method: MethodOption = None,
    key: Annotated[
        Path | None,
        typer.Option(
            "--key",
            metavar="FILE",
            help="Key of the answers, closed to whoever diagnoses; default: DIR.key, beside DIR.",
        ),
    ] = None,
) -> None:
    """Diagnose every case that has no result yet; a run that was stopped goes on where it was."""
    from chiplog.terminal import progress, show_line
    from gap_diagnosis.trials.run import run_trial

    with progress("diagnosing") as bar:
        ran = run_trial(
            folder, jobs=jobs, method=method, key=key, progress=bar or (lambda done, total: None)
        )
    show_line(f"{ran.results}: {ran.done} cases diagnosed, {ran.before} were there before")


@app.command("again", short_help="Drive ambiguous cases again: what is recommended is worth.")
def again(
    folder: FolderArgument,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="New folder of that trial.")],
    key: KeyOption = None,
) -> None:
    """Make a trial of every case for which a diagnosis recommended a manoeuvre, with one log more.

    Each comes twice, in any order: the same robot drives what is recommended, and any other
    manoeuvre of the menu. `run` and `score` take the new folder as any other.
    """
    from chiplog.terminal import progress, show_line
    from gap_diagnosis.trials.again import make_again
    from gap_diagnosis.trials.seal import key_of
    from gap_diagnosis.trials.secret import fresh_secret

    with progress("driving again") as bar:
        count = make_again(
            folder,
            key or key_of(folder),
            out,
            key_of(out),
            fresh_secret(),
            bar or (lambda done, total: None),
        )
    show_line(f"{out}: {count} cases with a second log; answers sealed, key: {key_of(out)}")


@app.command("score", short_help="Check the seal, open it, and score what was diagnosed.")
def score(
    folder: FolderArgument,
    key: KeyOption = None,
    method: MethodOption = None,
    again_folder: Annotated[
        Path | None,
        typer.Option("--again", metavar="DIR", help="What was recommended, driven and diagnosed."),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write all scores; - prints them.")
    ] = None,
    html_file: Annotated[
        Path | None,
        typer.Option(
            "--html", metavar="FILE", help="Write the page of scores, every method run beside it."
        ),
    ] = None,
) -> None:
    """Check that the answers are those committed to, open them, and score every result."""
    from chiplog.terminal import progress
    from gap_diagnosis.trials.opening import methods_run, open_methods, open_trial
    from gap_diagnosis.trials.run import processors, results_of
    from gap_diagnosis.trials.score import scores
    from gap_diagnosis.trials.seal import key_of

    own = results_of(folder, method).name
    beside = [] if html_file is None else [one for one in methods_run(folder) if one != own]
    with progress("scoring") as bar:
        opened = open_methods(
            folder,
            key or key_of(folder),
            [own, *beside],
            bar or (lambda done, total: None),
            processors(),
        )
    driven = None
    if again_folder is not None:
        driven = open_trial(again_folder, key_of(again_folder), jobs=processors())
    found = scores(opened[own], driven)
    if json_file is not None:
        write_json(json_file, found)
    if html_file is not None:
        _write_page(html_file, folder, own, opened, driven)
    if json_file != STANDARD_OUTPUT:
        _show(found)


def _write_page(
    file: Path, folder: Path, own: str, opened: Mapping[str, Opened], again: Opened | None
) -> None:
    from chiplog.pages.trial import trial_page

    file.write_text(trial_page(folder.resolve().name, own, opened, again), encoding="utf-8")


def _show(found: dict[str, Any]) -> None:
    from chiplog.terminal import show_line, show_table
    from gap_diagnosis.trials.score import summary, words

    show_table(["", "share (95 %), cases"], [list(row) for row in summary(found)], words=2)
    show_line()
    rows = [
        [name, str(one["cases"]), words(one["group_top1"]), _first(one["verdicts"])]
        for name, one in found["effects"].items()
    ]
    show_table(["effect", "cases", "in the group, at 2 limits", "told most often"], rows, words=1)
    if found["wrong"]:
        show_line()
        wrong = [
            [one["case"], one["truth"], one["verdict"], f"{one['probability']:.2f}"]
            for one in found["wrong"]
        ]
        show_table(["told wrong", "truth", "verdict", "probability"], wrong, words=3)


def _first(verdicts: dict[str, int]) -> str:
    return next(iter(verdicts), "")


def _secret(file: Path | None) -> Secret:
    from gap_diagnosis.trials.secret import SECRET_BYTES, Secret, fresh_secret

    if file is None:
        return fresh_secret()
    text = file.read_text(encoding="utf-8", errors="replace").strip()
    try:
        word = bytes.fromhex(text)
    except ValueError:
        word = b""
    if len(word) != SECRET_BYTES:
        raise CommandError(f"{file}: expected {2 * SECRET_BYTES} hexadecimal digits and no more")
    return Secret(word)
