"""The world and its sensors: SI floats inside, raw counts out."""

from sim_plant.batch import Batch, PlantRuns, simulate
from sim_plant.description import PlantDescription
from sim_plant.errors import PlantError
from sim_plant.mechanisms import Mechanisms, MechanismSchedule
from sim_plant.plant import NoiseModel, Plant, SensorCounts
from sim_plant.records import DriveModel, EncoderModel
from sim_plant.streams import BLOCK_TICKS, stream_generator

__all__ = [
    "BLOCK_TICKS",
    "Batch",
    "DriveModel",
    "EncoderModel",
    "MechanismSchedule",
    "Mechanisms",
    "NoiseModel",
    "Plant",
    "PlantDescription",
    "PlantError",
    "PlantRuns",
    "SensorCounts",
    "simulate",
    "stream_generator",
]
