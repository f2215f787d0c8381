"""The simulated truth: a robot with hidden masses on a floor, as a dm_control task, and the recorder of its walks."""

from massid.plant.corruption import Corruption, corrupt_log, sensors_of, without_wrenches
from massid.plant.embodiment import Integrator, motorised, variant
from massid.plant.environment import PlantOptions, StayUp, make_environment
from massid.plant.masses import HiddenMasses, MassErrors, default_links
from massid.plant.recorder import Agent, Recording, StepRecorder, record
from massid.plant.truth import truth_path
from massid.plant.walk import RecordingReport, WalkerAgent, record_walk

__all__ = [
    "Agent",
    "Corruption",
    "HiddenMasses",
    "Integrator",
    "MassErrors",
    "PlantOptions",
    "Recording",
    "RecordingReport",
    "StayUp",
    "StepRecorder",
    "WalkerAgent",
    "corrupt_log",
    "default_links",
    "make_environment",
    "motorised",
    "record",
    "record_walk",
    "sensors_of",
    "truth_path",
    "variant",
    "without_wrenches",
]
