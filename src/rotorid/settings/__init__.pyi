from rotorid.settings.flying import FlySettings as FlySettings
from rotorid.settings.given_controllers import GivenController as GivenController
from rotorid.settings.given_controllers import read_controllers as read_controllers
from rotorid.settings.identifying import IdentifySettings as IdentifySettings
from rotorid.settings.measuring import MeasureSettings as MeasureSettings
from rotorid.settings.measuring import ResponseSettings as ResponseSettings
from rotorid.settings.motors import MotorSettings as MotorSettings
from rotorid.settings.verifying import VerifySettings as VerifySettings
