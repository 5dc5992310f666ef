"""PX4: what is known of it, which filters it runs, how its next log holds more."""
