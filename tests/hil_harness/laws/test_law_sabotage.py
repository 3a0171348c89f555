"""Each law is broken on purpose, in the plant or in the firmware, and its check must see it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hil_harness.laws import LAWS, Bench
from hil_harness.laws.bench import Integration, Mode
from sim_plant import Mechanisms, PlantRuns

FloatArray = NDArray[np.float64]
ROOT2 = 2**0.5
NEUTRAL = Mechanisms()


def same(value: Any) -> Any:
    return value


@dataclass(frozen=True)
class SabotagedBench(Bench):
    """A bench whose plant or firmware is not what it says."""

    mechanisms: Callable[[Mechanisms], Mechanisms] = same
    arguments: Callable[[dict[str, Any]], dict[str, Any]] = same
    journey: Callable[[PlantRuns], PlantRuns] = same
    poses: Callable[[FloatArray], FloatArray] = same

    def drive(
        self, commands: FloatArray, mechanisms: Mechanisms = NEUTRAL, **arguments: Any
    ) -> PlantRuns:
        return self.journey(
            super().drive(commands, self.mechanisms(mechanisms), **self.arguments(arguments))
        )

    def odometry(
        self, journey: PlantRuns, mode: Mode, integration: Integration = "midpoint"
    ) -> FloatArray:
        return self.poses(super().odometry(journey, mode, integration))


def scaled(**factors: float) -> dict[str, Any]:
    """Sabotage: these mechanisms act by a factor."""

    def alter(mechanisms: Mechanisms) -> Mechanisms:
        return replace(
            mechanisms, **{name: f * getattr(mechanisms, name) for name, f in factors.items()}
        )

    return {"mechanisms": alter}


def added(**amounts: float) -> dict[str, Any]:
    """Sabotage: these mechanisms are off by an amount."""

    def alter(mechanisms: Mechanisms) -> Mechanisms:
        return replace(
            mechanisms, **{name: a + getattr(mechanisms, name) for name, a in amounts.items()}
        )

    return {"mechanisms": alter}


def swapped_sides(mechanisms: Mechanisms) -> Mechanisms:
    return replace(
        mechanisms,
        contact_offset_left_m=mechanisms.contact_offset_right_m,
        contact_offset_right_m=mechanisms.contact_offset_left_m,
    )


def dead_zone(mechanisms: Mechanisms) -> Mechanisms:
    """Small mismatches do nothing."""
    return replace(mechanisms, radius_mismatch=round(mechanisms.radius_mismatch, 6))


def straightened(values: FloatArray) -> FloatArray:
    """Replace each run by a constant drift to its own end: what walked with √k grows with k."""
    share = np.linspace(0, 1, values.shape[1])
    start, end = values[:, :1], values[:, -1:]
    if values.ndim == 3:
        share = share[:, None]
    straight: FloatArray = start + share * (end - start)
    return straight


def drifting_truth(journey: PlantRuns) -> PlantRuns:
    return replace(journey, truth=straightened(journey.truth))


def drifting_counts(journey: PlantRuns) -> PlantRuns:
    def counts(wrapped: NDArray[np.int32]) -> NDArray[np.int32]:
        wide = wrapped.astype(np.int64)
        steps = np.diff(wide, axis=1, prepend=wide[:, :1])
        total = np.cumsum(np.bitwise_and(steps + 32768, 65535) - 32768, axis=1)
        drifting = np.rint(straightened(total.astype(np.float64))).astype(np.int64)
        return np.bitwise_and(drifting, 65535).astype(np.int32)

    return replace(
        journey, left_count=counts(journey.left_count), right_count=counts(journey.right_count)
    )


def even_counts(journey: PlantRuns) -> PlantRuns:
    """An encoder of half the resolution."""
    return replace(
        journey, left_count=journey.left_count & ~1, right_count=journey.right_count & ~1
    )


def jittering_counts(journey: PlantRuns) -> PlantRuns:
    """An encoder that dithers by a tick."""
    dither = np.arange(journey.left_count.shape[1]) % 2
    return replace(
        journey, left_count=(journey.left_count + dither) % 65536, right_count=journey.right_count
    )


def constant_acceleration(journey: PlantRuns) -> PlantRuns:
    """An accelerometer whose noise is one value per run: t² instead of t."""
    assert journey.accel_x_code is not None
    mean = np.rint(np.mean(journey.accel_x_code, axis=1, keepdims=True)).astype(np.int32)
    return replace(journey, accel_x_code=np.broadcast_to(mean, journey.accel_x_code.shape))


def leaning_truth(journey: PlantRuns) -> PlantRuns:
    """A plant whose y carries a share of its heading: right spreads would be wrongly correlated."""
    truth = journey.truth.copy()
    truth[..., 1] += truth[..., 2]
    return replace(journey, truth=truth)


def heading_reads(factor: float) -> dict[str, Any]:
    def alter(poses: FloatArray) -> FloatArray:
        return np.asarray(poses * np.array([1.0, 1.0, factor]))

    return {"poses": alter}


def position_reads(factor: float) -> dict[str, Any]:
    def alter(poses: FloatArray) -> FloatArray:
        return np.asarray(poses * np.array([factor, factor, 1.0]))

    return {"poses": alter}


def with_arguments(**given: Any) -> dict[str, Any]:
    """Sabotage: the plant is run with other arguments."""
    return {"arguments": lambda arguments: arguments | given}


SABOTAGE: list[tuple[str, dict[str, Any], set[str]]] = [
    ("lesson", scaled(radius_mismatch=-1), {"lesson_twin_wheel_m", "lesson_firmware_wheel_m"}),
    ("lesson", with_arguments(first_seed=8), {"lesson_twin_wheel_m"}),
    ("lesson", with_arguments(encoder_model="counter"), {"lesson_firmware_wheel_m"}),
    ("lesson", scaled(gyro_bias_rad_s=1.01), {"lesson_firmware_gyro_m"}),
    ("distance_drift", scaled(radius_scale=2), {"distance_drift"}),
    ("distance_drift", scaled(radius_scale=-1), {"distance_drift"}),
    ("distance_drift", scaled(radius_scale=1.01), {"distance_drift_per_metre"}),
    ("curvature", scaled(radius_mismatch=0.5), {"curvature"}),
    ("curvature", scaled(radius_mismatch=-1), {"curvature"}),
    ("curvature", added(radius_mismatch=1e-13), {"curvature_straight_if_equal"}),
    ("curvature", {"mechanisms": dead_zone}, {"curvature_straight_only_if_equal"}),
    ("heading_drift", scaled(wheelbase_scale=-1), {"heading_drift"}),
    ("heading_drift", scaled(wheelbase_scale=2), {"heading_drift"}),
    ("heading_drift", scaled(wheelbase_scale=0.995), {"heading_drift_exact"}),
    ("contact_biased", scaled(contact_offset_right_m=2), {"contact_biased_distance"}),
    ("contact_biased", {"mechanisms": swapped_sides}, {"contact_biased_heading"}),
    (
        "contact_noisy",
        scaled(micro_slip_step_left_m=ROOT2, micro_slip_step_right_m=ROOT2),
        {"contact_noisy_distance", "contact_noisy_heading"},
    ),
    ("contact_noisy", {"journey": drifting_truth}, {"contact_noisy_growth"}),
    (
        "quantisation",
        {"journey": even_counts},
        {
            "quantisation_angle",
            "quantisation_distance",
            "quantisation_mean",
            "quantisation_uniform",
        },
    ),
    ("quantisation", {"journey": jittering_counts}, {"quantisation_rest"}),
    ("quantisation", added(ticks_scale=1e-4), {"quantisation_half_tick_speed"}),
    (
        "random_walk",
        with_arguments(encoder_model="counter"),
        {"random_walk_mean", "random_walk_growth"},
    ),
    ("random_walk", with_arguments(noise_ticks=0.2 * ROOT2), {"random_walk_variance"}),
    ("random_walk", {"journey": drifting_counts}, {"random_walk_growth"}),
    (
        "gyro_bias_heading",
        scaled(gyro_bias_rad_s=1.01, gyro_noise_rad_per_sqrt_s=ROOT2),
        {"gyro_bias_heading", "gyro_noise_heading"},
    ),
    (
        "gyro_bias_cross_track",
        scaled(gyro_bias_rad_s=1.01),
        {"gyro_bias_cross_track", "gyro_bias_cross_track_exact"},
    ),
    (
        "accelerometer",
        scaled(accel_bias_x_m_s2=1.02, accel_noise_m_s2_per_sqrt_hz=ROOT2),
        {
            "accel_bias_velocity",
            "accel_bias_position",
            "accel_noise_velocity",
            "accel_noise_position",
        },
    ),
    (
        "accelerometer",
        {"journey": constant_acceleration},
        {"accel_noise_velocity_half_time", "accel_noise_position_half_time"},
    ),
    ("heading_increment", scaled(radius_mismatch=-1), {"heading_increment"}),
    ("heading_increment", scaled(radius_mismatch=2), {"heading_increment_position"}),
    ("heading_increment", {"poses": straightened}, {"heading_increment_growth"}),
    (
        "se2_recursion",
        position_reads(1.05),
        {"se2_recursion_position", "se2_recursion_everywhere"},
    ),
    ("se2_recursion", heading_reads(1.000001), {"se2_recursion_heading"}),
    (
        "se2_covariance",
        scaled(micro_slip_left_m_per_sqrt_m=ROOT2, micro_slip_right_m_per_sqrt_m=ROOT2),
        {
            "se2_covariance_nees_half_way",
            "se2_covariance_nees_end",
            "se2_covariance_x",
            "se2_covariance_y",
            "se2_covariance_heading",
        },
    ),
    ("se2_covariance", {"journey": leaning_truth}, {"se2_covariance_nees_end"}),
    (
        "allan",
        scaled(gyro_noise_rad_per_sqrt_s=1.1, gyro_bias_walk_rad_s_per_sqrt_s=ROOT2),
        {"allan_angle_random_walk", "allan_rate_random_walk", "allan_bias_instability"},
    ),
]


@pytest.mark.parametrize(("law_name", "sabotage", "broken"), SABOTAGE)
def test_a_sabotaged_plant_or_firmware_violates_its_law(
    bench: Bench, law_name: str, sabotage: dict[str, Any], broken: set[str]
) -> None:
    law = next(law for law in LAWS if law.name == law_name)
    sabotaged = SabotagedBench("small", bench.robot, bench.tick_period_us, **sabotage)
    found = {check.law for check in law.measure(sabotaged).checks if not check.passed}
    assert broken <= found


def test_a_bench_that_is_not_sabotaged_keeps_the_laws(bench: Bench) -> None:
    honest = SabotagedBench("small", bench.robot, bench.tick_period_us)
    for law in LAWS:
        if law.name in ("distance_drift", "contact_biased", "heading_increment"):
            assert all(check.passed for check in law.measure(honest).checks)


def test_every_number_measured_on_plant_or_firmware_has_a_sabotage(findings: list[Any]) -> None:
    measured = {check.law for finding in findings for check in finding.evidence.checks}
    in_float_alone = {
        name
        for name in measured
        if name.startswith("lesson_") and "firmware" not in name and "twin" not in name
    }
    assert measured - in_float_alone == set().union(*(broken for _, _, broken in SABOTAGE))
