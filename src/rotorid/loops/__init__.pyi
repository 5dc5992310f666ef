from rotorid.loops.responses import Responses as Responses
from rotorid.loops.responses import response as response
