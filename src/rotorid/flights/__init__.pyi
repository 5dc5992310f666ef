from rotorid.flights.flights import Flight as Flight
from rotorid.flights.given_controllers import GivenController as GivenController
from rotorid.flights.given_controllers import read_controllers as read_controllers
