"""One physical model of flight, from hover to fast flight, fitted to records: force, moment, wind, stamps, errors."""
