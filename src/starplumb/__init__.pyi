from typing import Final

from .physics.errors import AlignmentFailed as AlignmentFailed
from .physics.errors import InputError as InputError
from .session.budget import Budget as Budget
from .session.budget import budget as budget
from .session.calibration import calibrate as calibrate
from .session.campaign import Campaign as Campaign
from .session.campaign import demo as demo
from .session.campaign import read_campaign as read_campaign
from .session.check import Check as Check
from .session.check import check as check
from .session.comparison import Comparison as Comparison
from .session.comparison import compare as compare
from .session.diagnosis import Diagnosis as Diagnosis
from .session.diagnosis import diagnose as diagnose
from .session.ground.location import locate as locate
from .session.ground.projection import Projection as Projection
from .session.ground.projection import project as project
from .session.imagery.measurement import Measurement as Measurement
from .session.imagery.measuring import measure as measure
from .session.mission.archive import Archive as Archive
from .session.mission.archive import open_archive as open_archive
from .session.motion.prediction import Prediction as Prediction
from .session.motion.prediction import predict as predict
from .session.planning.plan import Plan as Plan
from .session.planning.plan import plan_images as plan_images
from .session.result import Result as Result
from .session.scenario import Scenario as Scenario
from .session.scenario import scenario as scenario
from .session.study import Study as Study
from .session.study import simulate as simulate

__version__: Final[str]
