"""The bus's block: which effects act between the sensors and the log, and how strongly."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from can_bus import SENSORS
from gap_diagnosis.bus import prior
from gap_diagnosis.bus.counting import Rate, loss_of, rate_of
from gap_diagnosis.bus.crowds import happened
from gap_diagnosis.bus.events import Message, as_sent, classify
from gap_diagnosis.bus.gaps import silent_windows
from gap_diagnosis.bus.polls import polling
from gap_diagnosis.bus.stale import SURE_LENGTH, Staleness, staleness
from gap_diagnosis.bus.stamps import Choice, jitter, latencies, later_together, skew
from gap_diagnosis.hypothesis import Estimate, Fit, generator_of
from gap_diagnosis.motion.counters import unwrapped
from gap_diagnosis.priors import Range
from gap_diagnosis.recording import Recording
from hil_harness.assembly import Wire
from hil_harness.odometry_frames import ODOMETRY_ROLES
from hil_harness.robot import Robot
from hil_harness.sensor_frames import SENSOR_ROLES
from hil_harness.signal_map import REQUIRED
from hil_harness.signal_roles import Role

Floats = NDArray[np.float64]
Random = np.random.Generator
Windows = tuple[tuple[float, float], ...]

_SAMPLES: Final = 2000
_MOST_GAPS: Final = 3
_SURELY_STALE: Final = 3.0
_OFTENER: Final = 1.2
_SURELY_SD: Final = 3.0
"""What is known of a bus is no news up to this many standard deviations, and a fifth, more."""
_NEVER_OFTENER: Final = 0.9
_POLL: Final = "reception_stamp"
_POLLED: Final = frozenset({"frame_jitter", "frame_latency"})
"""A poll explains spread and delay of the stamps."""


@dataclass(frozen=True)
class _Option:
    """One way in which an effect can act: on this frame, with these draws of its parameters.

    `is_silent`: it has not struck once in this log.
    """

    frame: str | None
    log_evidence: float
    log_ratio: float
    draws: Mapping[str, Floats]
    windows: Windows = ()
    is_silent: bool = False


def bus_block(recording: Recording, robot: Robot, wire: Wire) -> BusBlock | None:
    """Return the block, or None where the log tells nothing of frames or clock."""
    block = BusBlock(recording, robot, wire)
    return block if block.effects else None


class BusBlock:
    """Evidence for bus effects from stamps, counters and payloads.

    What the bus is known to do is usual, up to as often and as much as it is known for. An effect
    of a frame is weighed for each message, and for all that carry sensors together (`frame` is then
    ``sensors``).
    """

    name = "bus"

    def __init__(self, recording: Recording, robot: Robot, wire: Wire) -> None:
        self._recording = recording
        self._robot = robot
        self._wire = wire
        sensors = {
            mapped.message.name
            for role in SENSOR_ROLES
            if (mapped := wire.signal_map.get(role)) is not None
        }
        found = _classified(recording, sensors)
        answers = {
            mapped.message.name
            for role in ODOMETRY_ROLES
            if (mapped := wire.signal_map.get(role)) is not None
        }
        sent = as_sent(found, answers)
        self._messages = [
            replace(
                one,
                known_late_s=self._known(one, "frame_latency.delay")[0],
                usual_spread_s=self._most(one, "frame_jitter.sigma"),
            )
            for one in sent
        ]
        self._counted = [one for one in self._messages if one.has_counter]
        self._telling = [one for one in self._messages if one.tells_losses]
        self._options: dict[tuple[str, Windows], list[_Option]] = {}

    @cached_property
    def effects(self) -> frozenset[str]:
        """The effects this log's frames can tell."""
        found = set()
        if math.isfinite(self._recording.clock_skew_sd):
            found.add("clock_skew")
        if self._messages:
            found |= {"frame_duplication", "stale_producer"}
        if self._telling:
            found |= {"bus_gap", "frame_loss"}
        if self._counted:
            found |= {"frame_jitter", "frame_latency", "frame_reordering", "reception_stamp"}
        return frozenset(found)

    def fit(self, effects: frozenset[str]) -> Fit:
        """Return the fit of these effects; those of different evidence are independent."""
        names = sorted(effects)
        windows: Windows = ()
        log_evidence = log_ratio = 0.0
        log_silent = -math.inf
        parameters: dict[str, Estimate] = {}
        gap = self._gap() if "bus_gap" in effects else None
        if gap is not None:
            log_evidence, log_ratio, windows = gap.log_evidence, gap.log_ratio, gap.windows
            log_silent = log_evidence if gap.is_silent else -math.inf
            parameters |= _estimates("bus_gap", [gap])
        excluded = windows
        for name in names:
            if name == "bus_gap":
                continue
            if name == "clock_skew":
                option = self._skew()
                log_evidence += option.log_evidence
                log_ratio += option.log_ratio
                parameters |= _estimates(name, [option])
                continue
            options = self._of_frames(name, excluded if name == "frame_loss" else ())
            logs = np.array([one.log_evidence for one in options])
            best = max(options, key=lambda one: one.log_evidence)
            weighed = float(logsumexp(logs)) - math.log(len(logs))
            if _POLL in effects and name in _POLLED:
                weighed = min(weighed, -1.0)
            silent = [one.log_evidence for one in options if one.is_silent]
            if silent:
                log_silent = float(logsumexp(silent)) - math.log(len(logs))
            log_evidence += weighed
            log_ratio += best.log_ratio
            parameters |= _estimates(name, options)
            windows = (*windows, *best.windows)
        return Fit(
            tuple(names),
            log_evidence,
            max(log_ratio, 0.0),
            parameters,
            windows,
            log_silent=log_silent if len(names) == 1 else -math.inf,
        )

    def shown(self, effect: str) -> tuple[str | None, Windows, float]:
        """Return in which frames a trace shows that this effect would leave, when, and the share of
        it that goes with these windows: none where it is there all along or cannot be told."""
        fit = self.fit(frozenset({effect}))
        where = fit.parameters.get(f"{effect}.frame")
        frame = None if where is None else str(where.value)
        if fit.windows:
            return frame, fit.windows, 0.0
        telling = self._telling if effect == "frame_loss" else self._counted
        own = [messages for name, messages in self._groups(telling) if name == frame]
        return frame, *happened(effect, own[0] if own else ())

    def _known(self, message: Message, key: str) -> tuple[float, float]:
        """Return how large an effect of this message is known to be, and its standard deviation;
        0 where nothing is known."""
        granted = self._recording.granted
        values = granted.values.get(key.partition(".")[0])
        if values is None or values["frame"] not in _groups_of(message):
            return 0.0, 0.0
        return granted.number(key), granted.sds.get(key, 0.0)

    def _most(self, message: Message, key: str) -> float:
        """Return up to which size an effect of this message is usual by what is known."""
        size, sd = self._known(message, key)
        return _OFTENER * (size + _SURELY_SD * sd)

    def _usual(self, effect: str, message: Message) -> Range:
        """Return the range of what this message may do without being news."""
        low, high = prior.usual(effect)
        most = max(high, self._most(message, f"{effect}.probability"))
        return low, min(most, _NEVER_OFTENER)

    def _of_frames(self, effect: str, excluded: Windows) -> list[_Option]:
        key = (effect, excluded)
        if key not in self._options:
            make: Mapping[str, Callable[[Random], list[_Option]]] = {
                "frame_loss": lambda random: self._losses(excluded, random),
                "frame_duplication": lambda random: self._rates(
                    self._messages, lambda one: one.repeated, effect, random
                ),
                "frame_reordering": lambda random: self._rates(
                    self._counted, lambda one: one.swapped, effect, random
                ),
                "stale_producer": self._stale,
                "frame_jitter": self._jitters,
                "reception_stamp": self._polls,
                "frame_latency": self._latencies,
            }
            self._options[key] = make[effect](generator_of([effect]))
        return self._options[key]

    def _groups(self, messages: Sequence[Message]) -> list[tuple[str, list[Message]]]:
        """Return each message by its name, and the sensors' together if there are several."""
        groups = [(one.name, [one]) for one in messages]
        sensors = [one for one in messages if one.is_sensor]
        return [*groups, (SENSORS, sensors)] if len(sensors) > 1 else groups

    def _losses(self, excluded: Windows, random: Random) -> list[_Option]:
        made = []
        for frame, messages in self._groups(self._telling):
            runs = [one.runs(excluded) for one in messages]
            news = loss_of(runs, prior.present("frame_loss"), prior.BURST)
            usual = [
                loss_of([one], self._usual("frame_loss", message), prior.BURST)
                for one, message in zip(runs, messages, strict=True)
            ]
            draws = {
                "probability": news.draw(random, _SAMPLES),
                "burst": news.draw_burst(random, _SAMPLES),
            }
            is_silent = not any(one.lost for one in runs)
            made.append(_against(frame, news, usual, draws, is_silent=is_silent))
        return made

    def _rates(
        self,
        of: Sequence[Message],
        happened: Callable[[Message], NDArray[np.bool_]],
        effect: str,
        random: Random,
    ) -> list[_Option]:
        made = []
        span = prior.present(effect)
        for frame, messages in self._groups(of):
            counts = [(int(np.count_nonzero(happened(one))), one.frames) for one in messages]
            news = rate_of(sum(a for a, _ in counts), sum(b for _, b in counts), span)
            usual = [
                rate_of(*one, self._usual(effect, message))
                for one, message in zip(counts, messages, strict=True)
            ]
            draws = {"probability": news.draw(random, _SAMPLES)}
            is_silent = not any(events for events, _ in counts)
            made.append(_against(frame, news, usual, draws, is_silent=is_silent))
        return made

    def _stale(self, random: Random) -> list[_Option]:
        sensors = [one for one in self._messages if one.is_sensor]
        found = self._staleness
        made = []
        effect = "stale_producer"
        for frame, messages in self._groups(sensors):
            several = [found[one.name] for one in messages]
            lengths = np.concatenate([one.lengths for one in several])
            events, chances = len(lengths), sum(one.chances for one in several)
            news = rate_of(min(events, chances), chances, prior.present(effect))
            usual = [
                rate_of(min(len(one.lengths), one.chances), one.chances, self._usual(effect, sent))
                for one, sent in zip(several, messages, strict=True)
            ]
            cycles = float(np.median(lengths)) if events else 1.0
            draws = {
                "probability": news.draw(random, _SAMPLES),
                "cycles": np.full(_SAMPLES, round(cycles), dtype=np.float64),
            }
            windows = tuple(window for one in several for window in one.windows)
            made.append(_against(frame, news, usual, draws, windows, is_silent=not events))
        return made or [_Option(None, 0.0, 0.0, {})]

    @cached_property
    def _staleness(self) -> dict[str, Staleness]:
        sensors = [one for one in self._messages if one.is_sensor]
        gyro = self._carrier("gyro")
        speeds = self._speed_carriers
        # To and fro across the edge of a narrow counter no wheel turns.
        counted = unwrapped(self._recording, self._robot)
        return {
            one.name: staleness(
                one, counted, has_gyro=one.name == gyro, has_speeds=one.name in speeds
            )
            for one in sensors
        }

    @property
    def _speed_carriers(self) -> set[str]:
        """The messages that say how fast a wheel turns, not how far."""
        return {
            mapped.message.name
            for role in REQUIRED
            if (mapped := self._wire.signal_map.get(role)) is not None
            and mapped.quantity in ("speed", "turn rate")
        }

    def _carrier(self, role: Role) -> str | None:
        mapped = self._wire.signal_map.get(role)
        return None if mapped is None else mapped.message.name

    def without_stale(self) -> Recording:
        """Return the recording without what a stale producer said again: those rows are empty.

        Counts that stood for some cycles and then leapt by what they had missed surely were; how
        often that happens says what is wrong, not what these rows are worth. Anything else only
        where it is likelier than not that a producer does so.
        """
        recording = self._recording
        is_likely = self.fit(frozenset({"stale_producer"})).log_evidence >= _SURELY_STALE
        leaping = {self._carrier("left_count")} - self._speed_carriers
        rows = {}
        for name, one in self._staleness.items():
            least = 1 if is_likely else SURE_LENGTH if name in leaping else math.inf
            again = zip(one.ticks, one.lengths, strict=True)
            said_again = [ticks for ticks, length in again if length >= least]
            rows[name] = np.isin(recording.tick, _within(said_again))
        none = np.zeros(len(recording.tick), dtype=np.bool_)
        gyro = rows.get(self._carrier("gyro") or "", none)
        wheels = rows.get(self._carrier("left_count") or "", none)
        return replace(
            recording,
            left_ticks=np.where(wheels, np.nan, recording.left_ticks),
            right_ticks=np.where(wheels, np.nan, recording.right_ticks),
            gyro_code=_but(recording.gyro_code, gyro),
            gyro_rate_rad_s=_but(recording.gyro_rate_rad_s, gyro),
        )

    def _jitters(self, random: Random) -> list[_Option]:
        return [
            self._chosen(frame, "sigma", jitter(messages), random)
            for frame, messages in self._groups(self._counted)
        ]

    def _polls(self, random: Random) -> list[_Option]:
        return [
            self._chosen(frame, "period", polling(messages), random, is_late=True)
            for frame, messages in self._groups(self._counted)
        ]

    def _latencies(self, random: Random) -> list[_Option]:
        sensors = [one for one in self._counted if one.is_sensor]
        made = [
            self._chosen(name, "delay", choice, random)
            for name, choice in latencies(sensors).items()
        ]
        together = later_together(sensors)
        if together is not None:
            return [*made, self._chosen(SENSORS, "delay", together, random)]
        # A delay common to all sensors leaves no trace in the stamps: it is as likely as before.
        scales = np.geomspace(prior.LATENCY.tolerance, prior.LATENCY.high, 6)
        drawn = np.abs(random.standard_normal(_SAMPLES))
        delay = drawn * random.choice(scales, _SAMPLES)
        return [*made, _Option(SENSORS, 0.0, 0.0, {"delay": delay})]

    def _chosen(
        self,
        frame: str,
        parameter: str,
        choice: Choice,
        random: Random,
        *,
        is_late: bool = False,
    ) -> _Option:
        """Return an option of one parameter; *is_late*: the earliest frames may be late as well."""
        besides = 0.0
        if is_late and choice.log_evidence > 0:
            options = self._of_frames("frame_latency", ())
            besides = max([0.0, *(one.log_evidence for one in options if one.frame == frame)])
        value = random.choice(choice.value, size=_SAMPLES, p=choice.weight)
        if parameter == "sigma":
            step = math.log(choice.value[1] / choice.value[0])
            value = value * np.exp(random.uniform(-0.5, 0.5, _SAMPLES) * step)
        evidence, ratio = choice.log_evidence + besides, choice.log_ratio + besides
        return _Option(frame, evidence, ratio, {parameter: value}, choice.windows)

    def _skew(self) -> _Option:
        recording = self._recording
        granted, key = recording.granted, "clock_skew.skew"
        sd = math.hypot(recording.clock_skew_sd, granted.sds.get(key, 0.0))
        evidence, ratio, rows, _ = skew(recording.clock_skew - granted.number(key), sd)
        random = generator_of(["clock_skew"])
        chosen = random.choice(len(rows), size=_SAMPLES, p=rows[:, 2])
        draws = rows[chosen, 0] + rows[chosen, 1] * random.standard_normal(_SAMPLES)
        return _Option(None, evidence, ratio, {"skew": draws})

    def _gap(self) -> _Option:
        """Return the best windows of silence."""
        total, ratio, chosen = self._silence
        if not chosen:
            return _Option(None, -math.log(2.0), 0.0, {}, is_silent=True)
        start, stop = chosen[0]
        even = generator_of(["bus_gap"]).uniform(0, self._recording.tick_period_s, (2, _SAMPLES))
        draws = {"start_s": start + even[0], "stop_s": stop - even[1]}
        return _Option(None, total, ratio, draws, chosen)

    @cached_property
    def _silence(self) -> tuple[float, float, Windows]:
        """What windows of silence save in losses, less their prior; the same without; they."""
        period = self._recording.tick_period_s
        price = 2 * math.log(max(self._recording.duration_s / period, 2.0))
        total, ratio = -price, 0.0
        chosen: Windows = ()
        base = self._usual_losses(())
        candidates = silent_windows(self._messages)[:_MOST_GAPS]
        for count in range(1, len(candidates) + 1):
            windows = tuple(candidates[:count])
            saved = self._usual_losses(windows) - base
            if saved - count * price > total or count == 1:
                total, chosen, ratio = saved - count * price, windows, saved
        return total, ratio, chosen

    def _usual_losses(self, excluded: Windows) -> float:
        return sum(
            loss_of([one.runs(excluded)], self._usual("frame_loss", one), prior.BURST).log_evidence
            for one in self._telling
        )


def _classified(recording: Recording, sensors: set[str]) -> list[Message]:
    """Return the messages of a recording; what changes for one of them on the way may for any."""

    def classified(changes_s: Sequence[float]) -> list[Message]:
        made = [
            classify(name, frames, recording, is_sensor=name in sensors, changes_s=changes_s)
            for name, frames in sorted(recording.frames.items())
        ]
        return [one for one in made if one is not None]

    found = classified(())
    longest = max(found, key=lambda one: (len(one.changes_s), one.frames), default=None)
    return classified(longest.changes_s) if longest is not None and longest.changes_s else found


def _groups_of(message: Message) -> tuple[str, ...]:
    """Return the frames that a message is of, by the names that effects have for them."""
    return (message.name, SENSORS) if message.is_sensor else (message.name,)


def _within(ticks: Sequence[tuple[int, int]]) -> NDArray[np.int64]:
    return np.array([one for start, stop in ticks for one in range(start, stop)], dtype=np.int64)


def _but(values: Floats | None, rows: NDArray[np.bool_]) -> Floats | None:
    return None if values is None else np.where(rows, np.nan, values)


def _against(
    frame: str,
    news: Rate,
    usual: Sequence[Rate],
    draws: Mapping[str, Floats],
    windows: Windows = (),
    *,
    is_silent: bool,
) -> _Option:
    evidence = news.log_evidence - sum(one.log_evidence for one in usual)
    ratio = news.log_best - sum(one.log_best for one in usual)
    return _Option(frame, evidence, ratio, draws, windows, is_silent)


def _estimates(effect: str, options: Sequence[_Option]) -> dict[str, Estimate]:
    """Return the estimates of an effect, its frame with probabilities."""
    logs = np.array([one.log_evidence for one in options])
    weight = np.exp(logs - logs.max())
    weight = weight / weight.sum()
    best = options[int(np.argmax(weight))]
    found: dict[str, Estimate] = {}
    for name, draws in best.draws.items():
        found[f"{effect}.{name}"] = Estimate(float(draws.mean()), float(draws.std()), draws)
    if best.frame is not None:
        chances = {str(one.frame): float(w) for one, w in zip(options, weight, strict=True)}
        found[f"{effect}.frame"] = Estimate(best.frame, probabilities=chances)
    return found
