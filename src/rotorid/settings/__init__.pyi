from rotorid.settings.settings import FlySettings as FlySettings
from rotorid.settings.settings import IdentifySettings as IdentifySettings
from rotorid.settings.settings import MeasureSettings as MeasureSettings
from rotorid.settings.settings import MotorChoices as MotorChoices
from rotorid.settings.settings import ResponseSettings as ResponseSettings
from rotorid.settings.settings import VerifySettings as VerifySettings
