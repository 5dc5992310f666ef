from rotorid.io.mavlink.messages import Telemetry as Telemetry
