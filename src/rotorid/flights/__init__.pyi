from rotorid.flights.flights import Flight as Flight
