"""The world and its sensors: SI floats inside, raw counts out."""

from sim_plant.batch import PlantRuns, simulate
from sim_plant.description import PlantDescription
from sim_plant.errors import PlantError
from sim_plant.mechanisms import Mechanisms, MechanismSchedule
from sim_plant.plant import NoiseModel, Plant, SensorCounts
from sim_plant.records import DriveModel, EncoderModel

__all__ = [
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
]
